"""Frequency responses of all channels of a structure that nothing touches.

At s, which is iω or, where a window has damped a measurement, iω + a, the motion per unit of the
drive q solves

    (M s² + C s + K) U = -(m_b s² + c_b s + k_b)                                                (F1)

The motions at many s lie in a space of few dimensions. It is spanned by solutions at some s, and
by further ones where (F1) is satisfied worst, until it is satisfied everywhere to `TOLERANCE`, or
to the round-off that is left where it was solved.

Source: A. C. Antoulas, Approximation of Large-Scale Dynamical Systems, 2005, ch. 11 (rational
interpolation); A. Bunse-Gerstner, D. Kubalińska, G. Vossen, D. Wilczek, J. Comput. Appl. Math. 233
(2010), for points that are chosen by the residual.
"""

from __future__ import annotations

import math

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.sections import Sensor
from delam_fem.model.factors import regular
from delam_fem.model.layout import Structure, reference_channels
from delam_fem.model.operators import Operators
from delam_fem.numerics.beams import ComplexArray
from delam_fem.numerics.types import FloatArray, IntArray

FIRST, MORE = 8, 4
"""Points at which (F1) is solved at first, and in each further round."""
TOLERANCE = 1e-9
"""Largest norm of what (F1) leaves, over that of its right-hand side."""
ROUND_OFFS = 10.0
"""Multiple of what is left at solved points that is still round-off at others: of a force, whose
motion is small beside the stiffness of short elements, more than `TOLERANCE` is left."""


def motions(operators: Operators, s: ComplexArray) -> tuple[FloatArray, ComplexArray]:
    """Return the steady motions per unit of the drive as V @ Y, by (F1).

    Args:
        operators: the semi-discrete problem.
        s: where they are wanted, shape (k,) [1/s].

    Returns:
        V, orthonormal, shape (n_dofs, m); Y, shape (m, k).
    """
    o = operators
    of_drive = np.stack([o.base.stiffness, o.base.damping, o.base.mass])
    powers = np.stack([np.ones_like(s), s, s**2])  # (3, k)
    basis = np.zeros((o.n_dofs, 0))
    points = np.unique(np.linspace(0, s.size - 1, min(FIRST, s.size)).astype(np.int64))
    solved: list[int] = []
    while True:
        columns = [basis]
        solved += points.tolist()
        for k in points.tolist():
            Z = o.stiffness + s[k] * o.damping + s[k] ** 2 * o.mass
            U = regular(Z)(-(powers[:, k] @ of_drive).astype(np.complex128))
            columns.append(np.stack([U.real, U.imag], axis=1) / np.linalg.norm(U))
        left, size, _ = np.linalg.svd(np.hstack(columns), full_matrices=False)
        basis = left[:, size > 1e-14 * size[0]]
        products = [matrix @ basis for matrix in (o.stiffness, o.damping, o.mass)]
        inner = np.stack([basis.T @ product for product in products])  # (3, m, m)
        load = -(of_drive @ basis).T  # (m, 3)
        dynamic = np.einsum("pk,pij->kij", powers, inner)
        Y = np.linalg.solve(dynamic, (load @ powers).T[:, :, None])[:, :, 0].T
        residual = of_drive.T @ powers + sum(
            product @ (power * Y) for product, power in zip(products, powers, strict=True)
        )
        share = np.linalg.norm(residual, axis=0) / np.linalg.norm(of_drive.T @ powers, axis=0)
        least = max(TOLERANCE, ROUND_OFFS * float(share[solved].max()))
        if share.max() <= least or basis.shape[1] >= min(o.n_dofs, 2 * s.size):
            return basis, Y
        points = _worst(share)


def _worst(share: FloatArray) -> IntArray:
    """Return the numbers of the largest local maxima of what is left, at most `MORE`."""
    padded = np.pad(share, 1)
    is_peak = (share >= padded[:-2]) & (share >= padded[2:]) & (share > TOLERANCE)
    peaks = np.flatnonzero(is_peak)
    return np.asarray(peaks[np.argsort(-share[peaks])[:MORE]])


def of_channels(structure: Structure, case: Case, s: ComplexArray) -> dict[str, ComplexArray]:
    """Return the responses of the channels of a run to its drive, without contact.

    Args:
        structure: the discretised case.
        case: the case.
        s: iω, or iω + a, shape (k,) [1/s].

    Returns:
        By names of the record of a run (probes, their velocities, sensors), shape (k,), per m of
        the base or newton of the force. Sensors read as they are mounted, but not sampled; forces
        of contacts are left out.
    """
    o = structure.operators
    basis, Y = motions(o, s)
    probes = (o.probes @ basis) @ Y + o.probe_shift[: o.n_probes, None]
    channels: dict[str, ComplexArray] = {}
    for name, u in zip(structure.layout.names, probes, strict=False):
        channels |= zip(reference_channels(name), (u, s * u), strict=True)
    read = (o.sensors @ basis) @ Y
    by_name = {sensor.name: sensor for sensor in case.sensor}
    for rows in structure.layout.sensors:
        sensor = by_name[rows.name]
        if sensor.quantity == "contact force":
            continue
        value = rows.of_base[0] + rows.of_base[1] * s
        if rows.of_u is not None:
            value = value + read[rows.of_u]
        if rows.of_v is not None:
            value = value + s * read[rows.of_v]
        value = (s * value if rows.is_rate else value) * mounting(sensor, s)
        channels[f"sensor_{rows.name}" if rows.name in channels else rows.name] = value
    return channels


def mounting(sensor: Sensor, s: ComplexArray) -> ComplexArray:
    """Return the response of a sensor's mounting and filter, shape of s [-].

    ω²/(s² + 2 D ω s + ω²) of the mounting; a Butterworth filter of the sensor
    """
    value = np.ones_like(s)
    if sensor.resonance is not None:
        w = 2.0 * math.pi * sensor.resonance
        D = 0.02 if sensor.resonance_damping is None else sensor.resonance_damping
        value = value * w**2 / (s**2 + 2.0 * D * w * s + w**2)
    if sensor.corner is not None:
        order = sensor.order or 2
        x = s / (2.0 * math.pi * sensor.corner)
        turns = np.exp(1j * math.pi * (2.0 * np.arange(1, order + 1) + order - 1) / (2.0 * order))
        value = value / np.prod(x[:, None] - turns, axis=1)
    return np.asarray(value)

"""Compute motions without contact: exact for cantilevers, on a fine mesh for bonded stacks."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from delam_fem.api import (
    Case,
    Excitation,
    FloatArray,
    ForceExcitation,
    HarmonicExcitation,
    State,
    Structure,
    assemble,
    at_start,
    elastic,
    first_mode,
    keeping_closed,
    response,
)

FINE = 320
"""Elements of the mesh whose motion stands for the exact one of a bonded stack."""
SETTLED = 0.001
"""Share of a free motion of the slowest first mode that may be left where a motion is measured."""


def linear_amplitudes(case: Case, frequency: FloatArray) -> FloatArray:
    """Return the amplitudes at the reference probes without contact, under base or force.

    Laminae pass through one another.

    Args:
        case: the case.
        frequency: frequencies of the excitation, shape (k,) [Hz].

    Returns:
        Shape (n_laminae, k) [m]; NaN for excitations that are not harmonic, except a swept sine of
        the base where the solution is exact.
    """
    n = len(case.lamina)
    excitation = case.excitation
    if _is_exact(case) and excitation.acts_on == "base":
        return np.stack([case.linear_amplitude(i, frequency) for i in range(n)])
    if not excitation.is_harmonic:
        return np.full((n, frequency.size), np.nan)
    o = _fine(case.without_impactors.to_toml()).operators
    amplitudes = np.empty((n, frequency.size))
    for k, f in enumerate(frequency.tolist()):
        probes = (o.probes @ response(o, f) + o.probe_shift[: o.n_probes])[:n]
        amplitudes[:, k] = _size(excitation, f) * np.abs(probes)
    return amplitudes


def steady_motion(case: Case, structure: Structure, *, is_closed: bool = True) -> State | None:
    """Return the state at t = 0 of the steady motion without clapping, which is linear.

    A motion with contact that starts from this state, with closed delaminations, settles far sooner
    than from rest. It goes on about the state of rest under constant loads, if there are any. None
    if the excitation is not harmonic, or if there is nothing to keep closed, as laminae are apart.

    Args:
        case: the case.
        structure: the discretised case.
        is_closed: whether delaminations are kept as they are at rest; laminae pass through one
            another otherwise.
    """
    excitation = case.excitation
    if (is_closed and case.is_apart) or not excitation.is_harmonic:
        return None
    o = structure.operators
    f = excitation.top_frequency
    U = _size(excitation, f) * response(o, f, keeping_closed(structure) if is_closed else None)
    motion = at_start(U, f)
    if o.equilibrium is not None:
        motion[0] += o.equilibrium.displacement
    return State(motion, np.zeros(o.n_pairs, dtype=np.bool_))


def _is_exact(case: Case) -> bool:
    """Return whether the laminae are the uniform cantilevers whose solution is exact."""
    return case.has_exact_laminae and not case.is_axial and case.model.kind == "beam"


def _size(given: Excitation, frequency: float) -> float:
    """Return the amplitude of a harmonic excitation: of the base [m], or of the force [N]."""
    if isinstance(given, HarmonicExcitation):
        return given.displacement_amplitude(frequency)
    return given.amplitude if isinstance(given, ForceExcitation) else math.nan


def first_frequencies(case: Case) -> list[float]:
    """Return the angular frequencies of the first modes of all laminae [rad/s].

    In a bonded stack, each is the first frequency of the structure with free delaminations.
    """
    if _is_exact(case):
        return [float(lamina.angular_frequencies(1)[0]) for lamina in case.lamina]
    fine = _fine(case.without_impactors.to_toml())
    o = fine.operators
    if case.is_apart and not case.n_rigid:
        shapes = [first_mode(fine, i) for i in range(len(case.lamina))]
        return [math.sqrt((v @ (o.stiffness @ v)) / (v @ (o.mass @ v))) for v in shapes]
    frequencies, _ = elastic(o.stiffness, o.mass, 1, case.n_rigid)
    return [2.0 * math.pi * float(frequencies[0])] * len(case.lamina)


def slowest_decay(case: Case) -> float:
    """Return the smallest rate D ω at which the first mode of a lamina dies out [1/s]."""
    return min(
        lamina.damping_ratio * omega
        for lamina, omega in zip(case.lamina, first_frequencies(case), strict=True)
    )


def settling_periods(case: Case, settled: float = SETTLED) -> int:
    """Return after how many periods a share of a free motion is left; 0 without damping."""
    decay = slowest_decay(case)
    return math.ceil(-math.log(settled) / (decay * case.period)) if decay else 0


@lru_cache(maxsize=4)
def _fine(case_text: str) -> Structure:
    """Return the structure of a case (as TOML): beams on a fine mesh, others on their own."""
    case = Case.from_toml(case_text)
    if case.model.kind == "beam" and not case.is_of_points:
        case = case.with_overrides({"mesh.elements": max(FINE, 2 * (case.mesh.elements or 0))})
    return assemble(case, needs_dolfinx=False)

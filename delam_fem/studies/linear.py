"""The motion without contact to compare with: exact for cantilevers, of a fine mesh for stacks."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from delam_fem.case.definition import Case
from delam_fem.case.drive import Excitation, ForceExcitation, HarmonicExcitation
from delam_fem.model import discretise
from delam_fem.model.beams import closed_form
from delam_fem.model.beams.network import n_rigid
from delam_fem.model.layout import Structure
from delam_fem.model.linear import keeping_closed, lowest
from delam_fem.numerics.beams import ComplexArray
from delam_fem.numerics.types import FloatArray
from delam_fem.simulation.loop import State, first_mode

FINE = 320
"""Elements of the mesh whose motion stands for the exact one of a bonded stack."""


def linear_amplitudes(case: Case, frequency: FloatArray) -> FloatArray:
    """Return the amplitudes at the reference probes without contact, under base or force.

    Laminae pass through one another. NaN if the excitation is not harmonic.

    Args:
        case: the case.
        frequency: frequencies of the excitation, shape (k,) [Hz].

    Returns:
        Shape (n_laminae, k) [m].
    """
    n, given = len(case.lamina), case.excitation
    if _is_exact(case) and given.acts_on == "base":
        return np.stack([case.linear_amplitude(i, frequency) for i in range(n)])
    if not given.is_periodic:
        return np.full((n, frequency.size), np.nan)
    o = _fine(case.to_toml()).operators
    found = np.empty((n, frequency.size))
    for k, f in enumerate(frequency.tolist()):
        omega = 2.0 * math.pi * f
        load = -(o.base.stiffness + 1j * omega * o.base.damping - omega**2 * o.base.mass)
        dynamic = o.stiffness + 1j * omega * o.damping - omega**2 * o.mass
        per_unit = np.abs((o.probes @ splu(sp.csc_matrix(dynamic)).solve(load))[:n])
        found[:, k] = _size(given, f) * per_unit
    return found


def closed_motion(case: Case, structure: Structure) -> State | None:
    """Return the state at t = 0 of the steady motion with delaminations kept as they are at rest.

    It is linear. A motion with contact that starts from it settles far sooner than from rest. None
    if the excitation is not harmonic, or the laminae are cantilevers of their own.

    Args:
        case: the case.
        structure: the discretised case.
    """
    given = case.excitation
    if case.is_apart or not given.is_periodic:
        return None
    o, f = structure.operators, given.top_frequency
    omega = 2.0 * math.pi * f
    U = _size(given, f) * closed_response(structure, f)  # u = Im(U exp(iωt)), as the base
    motion = np.stack([U.imag, omega * U.real, -(omega**2) * U.imag])
    return State(motion, np.zeros(o.n_pairs, dtype=np.bool_))


def closed_response(structure: Structure, frequency: float) -> ComplexArray:
    """Return the motion with delaminations kept closed, per unit of the drive, shape (n_dofs,)."""
    o, S, omega = structure.operators, keeping_closed(structure), 2.0 * math.pi * frequency
    M, C, K = (S.T @ matrix @ S for matrix in (o.mass, o.damping, o.stiffness))
    load = -(o.base.stiffness + 1j * omega * o.base.damping - omega**2 * o.base.mass)
    dynamic = sp.csc_matrix(K + 1j * omega * C - omega**2 * M)
    return np.asarray(S @ splu(dynamic).solve(S.T @ load))


def _is_exact(case: Case) -> bool:
    """Return whether the laminae are the uniform cantilevers whose solution is exact."""
    return case.is_apart and not case.point_mass and case.model.kind == "beam"


def _size(given: Excitation, frequency: float) -> float:
    """Return the amplitude of a harmonic excitation: of the base [m], or of the force [N]."""
    if isinstance(given, HarmonicExcitation):
        return given.displacement_amplitude(frequency)
    return given.amplitude if isinstance(given, ForceExcitation) else math.nan


def first_frequencies(case: Case) -> list[float]:
    """Return the angular frequencies of the first modes of all laminae [rad/s].

    In a bonded stack they are all that of the structure with free delaminations.
    """
    if _is_exact(case):
        return [float(lamina.angular_frequencies(1)[0]) for lamina in case.lamina]
    fine = _fine(case.to_toml())
    rigid = n_rigid(case)
    found, _ = lowest(
        fine.operators.stiffness, fine.operators.mass, rigid + 1, is_floating=rigid > 0
    )
    return [2.0 * math.pi * float(found[rigid])] * len(case.lamina)


def first_shapes(case: Case, structure: Structure) -> FloatArray:
    """Return a displacement of all dofs in which every lamina vibrates in its first mode.

    Shape (n_dofs,).
    """
    if case.is_apart:
        n = len(structure.layout.parts)
        return np.asarray(np.sum([first_mode(structure, i) for i in range(n)], axis=0))
    rigid, o = n_rigid(case), structure.operators
    _, vectors = lowest(o.stiffness, o.mass, rigid + 1, is_floating=rigid > 0)
    shape = vectors[:, rigid]
    return np.asarray(shape / np.abs(o.probes @ shape).max())


def openings(case: Case, structure: Structure) -> FloatArray:
    """Return by how much the first mode opens each contact pair, shape (n_pairs,).

    Laminae that are apart move against one another, each in its first mode φ₁ with 1 at the tip;
    the opening is the mean of both. A bonded stack moves as in `first_shapes`.
    """
    if case.is_apart:
        n = len(structure.layout.parts)
        shape = np.sum([0.5 * (-1.0) ** i * first_mode(structure, i) for i in range(n)], axis=0)
    else:
        shape = first_shapes(case, structure)
    return np.asarray(np.abs(structure.operators.gap_matrix @ shape))


@lru_cache(maxsize=4)
def _fine(case_text: str) -> Structure:
    """Return the structure of a case (as TOML): beams on a fine mesh, other models on their own."""
    case = Case.from_toml(case_text)
    if case.model.kind != "beam":
        return discretise.assemble(case)
    n = max(FINE, 2 * (case.mesh.elements or 0))
    return closed_form.assemble(case.with_overrides({"mesh.elements": n}))

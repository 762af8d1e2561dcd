"""The map of a case with one key as the parameter."""

from __future__ import annotations

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.motion.excitation import drive
from delam_fem.case.toml import CaseError
from delam_fem.engines.choose import law_of, scheme_of
from delam_fem.model import discretise
from delam_fem.model.layout import Structure
from delam_fem.model.operators import Operators
from delam_fem.model.vibration import lowest
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.setup import span_of
from delam_fem.studies.orbits.maps import Problem, StrobeMap
from delam_fem.studies.orbits.protocol import Slow
from delam_fem.studies.sweeps.point import assembly_key

MODES = 4
"""Lowest modes of the structure whose displacements and velocities are the slow coordinates."""
FREQUENCY = "excitation.frequency"


class CaseFamily:
    """The problems of a case for the values of one key.

    Attributes:
        case: the case.
        key: the key, with dots.
    """

    def __init__(self, case: Case, key: str) -> None:
        """Check the key and assemble the case.

        Raises:
            CaseError: the drive is not periodic, or the key is not one of numbers.
        """
        if not case.is_periodic:
            raise CaseError(
                "excitation.kind: expected a drive that repeats after each period, given "
                f"{case.excitation.kind!r}"
            )
        self.case, self.key = case, key
        self._structures: dict[str, Structure] = {}

    def at(self, value: float) -> Case:
        """Return the case for a value of the key."""
        return self.case.with_overrides({self.key: value})

    def problem(self, value: float) -> Problem:
        """Return the problem for a value of the key."""
        case = self.at(value)
        structure = self.structure(case)
        return Problem(
            structure.operators,
            law_of(case),
            scheme_of(case),
            drive(case),
            span_of(case),
            tip_of(structure),
        )

    def structure(self, case: Case) -> Structure:
        """Return the discretised case; it is assembled again only if the key changes it."""
        key = assembly_key(case)
        if key not in self._structures:
            self._structures = {key: discretise.assemble(case, needs_dolfinx=False)}
        return self._structures[key]

    def map(self) -> StrobeMap:
        """Return the map of the family, with the modes of the case as its slow coordinates."""
        return StrobeMap(self.problem, modal(self.structure(self.case).operators))


def tip_of(structure: Structure) -> tuple[int, int, float] | None:
    """Return the probes and the gap at rest [m] of the last pair of the first interface."""
    layout, gap0 = structure.layout, structure.operators.gap0
    for interface in layout.interfaces:
        lower, upper = interface.parts
        for pair, points in enumerate(interface.points.tolist()):
            found = [
                number
                for part, point in zip((lower, upper), points, strict=True)
                for number, probe in enumerate(layout.probes)
                if (probe.part, probe.point) == (part, point)
            ]
            is_at_points = interface.local is None or bool(np.all(interface.local[pair] == 1.0))
            if len(found) == 2 and is_at_points:
                return found[0], found[1], float(gap0[interface.first_pair + pair])
    return None


def modal(operators: Operators, n_modes: int = MODES) -> Slow:
    """Return the displacements and velocities of the lowest modes as slow coordinates.

    The coordinates are ω_j a_j and b_j of u = Σ a_j φ_j, v = Σ b_j φ_j with φᵀ M φ = 1, so that
    their squares are twice the strain and the kinetic energy of the mode [J^½].
    """
    n = operators.n_dofs
    count = min(n_modes, n)
    frequencies, vectors = lowest(operators.stiffness, operators.mass, count)
    omega = 2.0 * np.pi * frequencies
    masses = np.sqrt(np.einsum("ij,ij->j", vectors, operators.mass @ vectors))
    phi: FloatArray = vectors / masses
    reads = (operators.mass @ phi).T
    basis, dual = np.zeros((2 * n, 2 * count)), np.zeros((2 * count, 2 * n))
    basis[:n, :count], basis[n:, count:] = phi / omega, phi
    dual[:count, :n], dual[count:, n:] = omega[:, None] * reads, reads
    return Slow(basis, dual)

"""Let a force at a point drive a structure instead of its base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.model.layout import Layout, Structure
from delam_fem.model.operators import BaseCoupling
from delam_fem.model.pairing import interpolation_rows
from delam_fem.numerics.arrays import FloatArray


def driven(structure: Structure, case: Case) -> Structure:
    """Return the structure with the drive of a case: its base, or a force at a point.

    Raises:
        CaseError: the point of the force is held, so that the force has no effect.
    """
    given = case.excitation
    name, position = getattr(given, "lamina", None), getattr(given, "position", None)
    if given.acts_on == "base" or name is None or position is None:
        return structure
    operators = structure.operators
    load = point_load(structure.layout, name, position, operators.n_dofs)
    if not load.any():
        raise CaseError(
            f"excitation.position: expected a point that can move, given {position!r} m, where "
            f"lamina {name} is held"
        )
    return replace(structure, operators=replace(operators, base=BaseCoupling.force(load)))


def point_load(layout: Layout, lamina: str, position: float, n_dofs: int) -> FloatArray:
    """Return the loads of a unit force at a point of a lamina, shape (n_dofs,) [N/N].

    They are the values of the cubic Hermite functions at the point, so that the work of the force
    is the force times the displacement of the point.

    Args:
        layout: of the structure.
        lamina: name of the part.
        position: x of the point [m].
        n_dofs: number of free dofs.
    """
    part = layout.parts[layout.names.index(lamina)]
    place = np.interp([position], part.x, np.arange(part.x.size, dtype=np.float64))
    return np.asarray(interpolation_rows(part, place, n_dofs).toarray()[0])

"""The layout of the paper's structure: laminae side by side, clamped at x = 0, free at x = L.

Both discretisations (closed_form.py and beam.py) number their dofs in the order of this layout:
lamina by lamina, node by node from the clamp to the tip, displacement before slope. The clamped
nodes are left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.gap import initial_gap, opening_at_rest
from delam_fem.case.layers import EDGE_TOLERANCE, open_ends
from delam_fem.case.toml import CaseError
from delam_fem.model.layout import BASE, FIXED, Layout, Part, Probe, Structure, Support
from delam_fem.model.operators import BaseCoupling
from delam_fem.model.pairing import interpolation_rows, neighbours, tributary_lengths
from delam_fem.model.sensors import StrainRows, with_sensors
from delam_fem.numerics.arrays import FloatArray, IntArray

CLAMP, TIP = 0, -1
"""Numbers of the first and the last point of a lamina."""


def clamped_laminae(
    case: Case, x: FloatArray, flexural_rigidity: FloatArray, mass_per_length: FloatArray
) -> Layout:
    """Return the layout of the laminae of a case.

    Args:
        case: gives the names of the laminae.
        x: positions of the nodes, clamp included, shape (n_nodes,) [m].
        flexural_rigidity: EI of each cell of each lamina, shape (n_laminae, n_nodes - 1) [N m2].
        mass_per_length: ρA of each cell of each lamina, shape (n_laminae, n_nodes - 1) [kg/m].
    """
    n = x.size - 1
    parts = tuple(
        Part(lamina.name, x, _dofs(i, n), flexural_rigidity[i], mass_per_length[i])
        for i, lamina in enumerate(case.lamina)
    )
    interfaces = neighbours(parts, case.contact.points_per_element)
    return Layout(
        parts,
        interfaces,
        tuple(Probe("tip", i, n) for i in range(len(parts))),
        tuple(Support(i, CLAMP) for i in range(len(parts))),
    )


def gap_at_rest(case: Case, layout: Layout) -> FloatArray:
    """Return the gaps at rest of all pairs, shape (n_pairs,) [m].

    Raises:
        CaseError: see `initial_gap` and `opening_at_rest`.
    """
    gaps = []
    for interface in layout.interfaces:
        x = layout.parts[interface.parts[0]].positions(interface.places(0))
        if case.gap is not None:
            gaps.append(initial_gap(case.gap, x, case.length))
        else:
            names = (layout.names[interface.parts[0]], layout.names[interface.parts[1]])
            gaps.append(_openings(case, names, x))
    return np.concatenate(gaps)


def _openings(case: Case, between: tuple[str, str], x: FloatArray) -> FloatArray:
    """Return the gaps at rest between two laminae at places within their delaminations [m]."""
    gap, margin = np.zeros(x.size), EDGE_TOLERANCE * case.length
    for own in case.delamination:
        if own.between == between:
            inside = (x >= own.start - margin) & (x <= own.end + margin)
            is_at_start = open_ends(own, case.length, case.support) == ("start",)
            gap[inside] = opening_at_rest(own, x[inside], case.length, opens_at_start=is_at_start)
    return gap


def pair_weights(case: Case, layout: Layout) -> FloatArray | None:
    """Return the factors of the springs of all pairs, shape (n_pairs,) [-].

    With contact points inside the elements a spring's stiffness holds for a mean element, and each
    pair has its share: its tributary length in lengths of the mean element. None: only the nodes
    are pairs, and each has the whole stiffness, as in the paper.
    """
    if case.contact.points_per_element == 1:
        return None
    shares: list[FloatArray] = []
    for interface in layout.interfaces:
        lower = layout.parts[interface.parts[0]]
        mean = (lower.x[TIP] - lower.x[CLAMP]) / lower.n_elements
        shares.append(tributary_lengths(layout.parts, interface) / mean)
    return np.concatenate(shares)


def _dofs(lamina: int, n: int) -> IntArray:
    """Return the dofs of the points of a lamina of n elements, shape (n + 1, 2)."""
    dofs = np.empty((n + 1, 2), dtype=np.int64)
    dofs[CLAMP] = BASE, FIXED
    dofs[1:] = 2 * n * lamina + np.arange(2 * n).reshape(n, 2)
    return dofs


def completed(structure: Structure, case: Case, strain: StrainRows | None = None) -> Structure:
    """Return the structure with the drive and the sensors of a case.

    Args:
        structure: of the case.
        case: the case.
        strain: gives the strain of surfaces, see `with_sensors`; None: laminae that are apart.
    """
    return with_sensors(driven(structure, case), case, strain)


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
    row = interpolation_rows(part, place, layout.n_numbered(n_dofs))
    return np.asarray(layout.of_dofs(row).toarray()[0])

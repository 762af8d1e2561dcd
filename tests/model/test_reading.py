"""A layout that reads deflection and slope from the dofs of a solid."""

import numpy as np
import pytest
import scipy.sparse as sp

from delam_fem.api import (
    Layout,
    Structure,
    assemble,
    first_mode,
    keeping_closed,
    nodal,
    preset,
    with_sensors,
)
from delam_fem.model.layout import BASE, Reading
from delam_fem.model.linear import kept_closed

CASE = preset("default", {"mesh.elements": 6}).with_overrides({"contact.points_per_element": 2})


def turned(structure: Structure) -> tuple[Structure, np.ndarray]:
    """Return the structure in other dofs, u = Q y, whose parts read u from y; and Q."""
    o, layout = structure.operators, structure.layout
    n = o.n_dofs
    rng = np.random.default_rng(3)
    Q = np.zeros((n, n))
    lamina_dofs = [layout.own_dofs(i) for i in range(2)]
    for dofs in lamina_dofs:
        Q[np.ix_(dofs, dofs)] = rng.normal(size=(dofs.size, dofs.size))
    part = np.zeros(n, np.int64)
    part[lamina_dofs[1]] = 1

    def both(A: sp.csr_matrix) -> sp.csr_matrix:
        return sp.csr_matrix(Q.T @ A @ Q)

    operators = type(o)(
        mass=both(o.mass),
        damping=both(o.damping),
        stiffness=both(o.stiffness),
        base=type(o.base)(*(Q.T @ c for c in (o.base.mass, o.base.damping, o.base.stiffness))),
        gap_matrix=sp.csr_matrix(o.gap_matrix @ Q),
        gap0=o.gap0,
        pair_weights=o.pair_weights,
        probes=sp.csr_matrix(o.probes @ Q),
    )
    base = np.zeros(n)
    reading = Reading(sp.csr_matrix(Q), base, part)
    other = Layout(**{**vars(layout), "reading": reading})
    return Structure(operators, other), Q


def test_fields_and_modes_are_those_of_the_readings() -> None:
    beams = assemble(CASE, needs_dolfinx=False)
    other, Q = turned(beams)
    y = np.random.default_rng(1).normal(size=(3, Q.shape[0]))
    base = np.array([0.5, -1.0, 2.0])
    np.testing.assert_allclose(
        nodal(other.layout, y, base),
        nodal(beams.layout, y @ Q.T, base),
        atol=1e-12,
    )
    for part in (0, 1):
        np.testing.assert_allclose(
            Q @ first_mode(other, part), first_mode(beams, part), rtol=1e-8, atol=1e-10
        )


def test_sensors_read_through_the_readings() -> None:
    case = CASE.with_overrides({
        "sensor": [
            {"name": "d", "lamina": "thin", "position": 0.3, "quantity": "displacement"},
            {"name": "s", "lamina": "thick", "position": 0.2, "quantity": "strain"},
            {"name": "a", "lamina": "thin", "position": 0.6, "quantity": "acceleration"},
        ]
    })  # fmt: skip
    beams = assemble(CASE, needs_dolfinx=False)
    other, Q = turned(beams)
    rows = [with_sensors(s, case).operators.sensors.toarray() for s in (beams, other)]
    np.testing.assert_allclose(rows[1], rows[0] @ Q, rtol=1e-7, atol=1e-7 * np.abs(rows[1]).max())


def test_the_base_moves_what_is_read() -> None:
    reading = Reading(sp.csr_matrix([[2.0, 0.0]]), np.array([0.25]), np.zeros(2, np.int64))
    read = reading.of(np.array([[1.0, 7.0], [3.0, 7.0]]), np.array([4.0, 8.0]))
    np.testing.assert_allclose(read, [[3.0], [8.0]])
    layout = Layout((), (), reading=reading)
    row = layout.of_dofs(sp.csr_matrix([[3.0, 5.0]]))  # of the reading and of the base
    np.testing.assert_allclose(row.toarray(), [[6.0, 0.0, 5.75]])
    assert BASE < 0


def test_keeping_closed_leaves_no_gap_and_all_other_motions() -> None:
    beams = assemble(preset("default", {"mesh.elements": 6}), needs_dolfinx=False)
    other, Q = turned(beams)
    S = keeping_closed(other)
    H = other.operators.gap_matrix
    assert np.abs(H @ S).max() < 1e-10 * np.abs(H).max()
    assert S.shape[1] == Q.shape[0] - H.shape[0]
    assert np.linalg.matrix_rank(S.toarray()) == S.shape[1]
    same = kept_closed(beams.layout, beams.operators.n_dofs)
    assert (keeping_closed(beams) != same).nnz == 0


def test_a_layout_may_not_number_more_than_it_reads() -> None:
    other, _ = turned(assemble(CASE, needs_dolfinx=False))
    reading = Reading(sp.csr_matrix((3, 24)), np.zeros(3), np.zeros(24, np.int64))
    with pytest.raises(ValueError, match="expected below 3, the number of readings"):
        Structure(other.operators, Layout(**{**vars(other.layout), "reading": reading}))

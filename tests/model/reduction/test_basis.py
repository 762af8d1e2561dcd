"""The basis: orthonormal, statically complete at the pairs, exact in its modes, cut when asked."""

from dataclasses import replace

import numpy as np
import pytest

from delam_fem.api import Operators, assemble, preset
from delam_fem.model.component_modes import basis_of

ROUND_OFF = 1e-9
"""Of static shapes, relative to stiffnesses that differ by the fourth power of the elements."""


def operators(elements: int = 20, **keys: object) -> Operators:
    return assemble(
        preset("default", {"mesh.elements": elements, **keys}), needs_dolfinx=False
    ).operators


def with_one_pair() -> Operators:
    """Return operators with the last pair alone, whose shape cannot stand in for others."""
    o = operators()
    return replace(o, gap_matrix=o.gap_matrix[-1:], gap0=o.gap0[-1:])


@pytest.mark.parametrize("points", [1, 3])  # 3: more pairs than independent shapes
def test_the_basis_makes_the_matrices_diagonal(points: int) -> None:
    o = operators(**{"contact.points_per_element": points})
    basis = basis_of(o, 6)
    V, omega = basis.vectors, np.sqrt(basis.squares)
    np.testing.assert_allclose(V.T @ o.mass @ V, np.eye(omega.size), atol=ROUND_OFF)
    scaled = V.T @ o.stiffness @ V / np.outer(omega, omega)
    np.testing.assert_allclose(scaled, np.eye(omega.size), atol=ROUND_OFF)
    assert (basis.dropped > 0) == (points == 3)


def test_pairs_give_way_to_steady_forces_as_in_the_full_model() -> None:
    o = operators()
    basis = basis_of(o, 4)
    G = o.gap_matrix @ basis.vectors
    H, K = o.gap_matrix.toarray(), o.stiffness.toarray()
    full = H @ np.linalg.solve(K, H.T)
    np.testing.assert_allclose((G / basis.squares) @ G.T, full, rtol=1e-8)
    assert abs(basis.compliance_error) < 1e-8


def test_a_slow_base_moves_the_structure_as_in_the_full_model() -> None:
    o = with_one_pair()
    V, squares = (basis := basis_of(o, 4)).vectors, basis.squares
    shape = -V @ ((V.T @ o.base.stiffness) / squares)
    np.testing.assert_allclose(shape[::2], 1.0, rtol=1e-8)
    np.testing.assert_allclose(shape[1::2], 0.0, atol=1e-8)


def test_the_inertia_of_a_base_bends_the_structure_as_in_the_full_model() -> None:
    o = with_one_pair()
    V, squares = (basis := basis_of(o, 2)).vectors, basis.squares
    stiffness = o.stiffness.toarray()
    load = o.base.mass - o.mass @ np.linalg.solve(stiffness, o.base.stiffness)
    expected = np.linalg.solve(stiffness, load)
    np.testing.assert_allclose(
        V @ ((V.T @ load) / squares), expected, atol=1e-9 * np.abs(expected).max()
    )


def test_normal_modes_are_kept_as_they_are() -> None:
    o = operators()
    basis = basis_of(o, 6)
    exact = np.linalg.eigvals(np.linalg.solve(o.mass.toarray(), o.stiffness.toarray()))
    np.testing.assert_allclose(basis.lowest, np.sort(exact.real)[:10], rtol=1e-6)
    np.testing.assert_allclose(np.sort(basis.squares[basis.is_mode])[:8], basis.lowest[:8])
    assert basis.squares[~basis.is_mode].min() > basis.squares[basis.is_mode].min()
    assert np.bincount(basis.body[basis.is_mode]).tolist() == [6, 6]


def test_a_point_force_has_its_static_shape() -> None:
    case = preset("embedded", {"mesh.elements": 20, "excitation.kind": "force",
        "excitation.lamina": "upper", "excitation.position": 0.1, "excitation.amplitude": 1.0,
        "excitation.frequency": 9.0})  # fmt: skip
    o = assemble(case, needs_dolfinx=False).operators
    basis = basis_of(o, 3)
    load = -o.base.stiffness
    answer = basis.vectors @ ((basis.vectors.T @ load) / basis.squares)
    full = np.linalg.solve(o.stiffness.toarray(), load)
    np.testing.assert_allclose(answer, full, atol=1e-8 * np.abs(full).max())


def test_the_stiffest_shapes_are_left_out_first() -> None:
    o = operators()
    full_basis, cut = basis_of(o, 4), basis_of(o, 4, max_coordinates=30)
    assert cut.squares.size == 30 and cut.dropped == full_basis.squares.size - 30
    assert 1e-4 < cut.compliance_error < 1.0
    assert cut.squares.max() < full_basis.squares.max()
    assert basis_of(o, 4, max_coordinates=8).squares.size == 8
    with pytest.raises(ValueError, match="coordinates: "):
        basis_of(o, 4, max_coordinates=7)


def test_all_modes_leave_nothing_to_residual_shapes() -> None:
    basis = basis_of(operators(4), 8)
    assert basis.is_mode.all() and basis.squares.size == 16

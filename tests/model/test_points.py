"""Contact points inside the elements: exact for cubics, the same in both discretisations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from delam_fem.api import Case, CaseError, Part, assemble, preset
from delam_fem.model.beams import closed_form, forms
from delam_fem.model.layout import (
    BASE,
    DISPLACEMENT,
    FIXED,
    SLOPE,
    at_stations,
    bending_moment,
    gap_matrix,
    interpolation_rows,
    opposite,
    tributary_lengths,
)

X = np.array([0.0, 0.1, 0.3, 0.4])
CUBIC = np.polynomial.Polynomial([0.2, -1.0, 3.0, 7.0])
ROUND_OFF = 1e-13
CONSISTENT = {"contact.impulse": "consistent"}


def case_of(p: int, elements: int = 3, **more: object) -> Case:
    return preset(
        "paper", CONSISTENT | {"contact.points_per_element": p, "mesh.elements": elements} | more
    )


def free_part(first: int = 0) -> Part:
    return Part("free", X, first + np.arange(8).reshape(4, 2), np.ones(3), np.ones(3))


def sampled(f: np.polynomial.Polynomial) -> np.ndarray:
    return np.column_stack([f(X), f.deriv()(X)]).ravel()


def test_cubics_and_their_slopes_are_exact_at_any_place_of_a_graded_part() -> None:
    part, places = free_part(), np.array([0.0, 0.3, 1.0, 1.125, 2.5, 2.9, 3.0])
    x = part.positions(places)
    assert x == pytest.approx([0.0, 0.03, 0.1, 0.125, 0.35, 0.39, 0.4], rel=ROUND_OFF)
    u, phi = (interpolation_rows(part, places, 8, c) for c in (DISPLACEMENT, SLOPE))
    assert u @ sampled(CUBIC) == pytest.approx(CUBIC(x), rel=ROUND_OFF)
    assert phi @ sampled(CUBIC) == pytest.approx(CUBIC.deriv()(x), rel=ROUND_OFF)


def test_the_interpolant_is_that_of_scipy() -> None:
    u = np.random.default_rng(3).normal(size=8)
    places = np.linspace(0.0, 3.0, 31)
    part = free_part()
    spline = CubicHermiteSpline(X, u[::2], u[1::2])
    rows = interpolation_rows(part, places, 8)
    assert rows @ u == pytest.approx(spline(part.positions(places)), abs=1e-13)


def test_a_gap_opens_as_the_upper_part_rises() -> None:
    parts = [free_part(), free_part(8)]
    interface = opposite(parts, 0, 1, per_element=4)
    assert interface.places.tolist() == [0.0, *(np.arange(1, 13) / 4)]
    H = gap_matrix(parts, (interface,), 16)
    x = parts[0].positions(interface.places)
    u = np.concatenate([np.zeros(8), sampled(CUBIC)])
    assert H @ u == pytest.approx(CUBIC(x), rel=ROUND_OFF)
    assert H @ u[::-1].reshape(2, 8)[:, ::-1].ravel() == pytest.approx(-CUBIC(x), rel=ROUND_OFF)


def test_a_held_point_is_no_pair_but_its_cell_has_pairs() -> None:
    dofs = np.vstack([[BASE, FIXED], np.arange(6).reshape(3, 2)])
    parts = [Part(f"{i}", X, dofs + 6 * i * (dofs >= 0), np.ones(3), np.ones(3)) for i in (0, 1)]
    interface = opposite(parts, 0, 1, per_element=2)
    assert interface.places.tolist() == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    H = gap_matrix(parts, (interface,), 12)
    h = 0.1  # at the middle of a cell u = (u0 + u1)/2 + h (phi0 - phi1)/8
    assert H[0].toarray().ravel()[6:8] == pytest.approx([0.5, -h / 8.0])
    assert H[1].indices.tolist() == [0, 6]
    lengths = tributary_lengths(parts, interface)
    assert lengths == pytest.approx([0.05, 0.075, 0.1, 0.075, 0.05, 0.025])


@pytest.mark.parametrize("p", [1, 3, 4])
def test_both_discretisations_have_the_same_pairs(p: int) -> None:
    case = case_of(p, 5)
    operators, expected = (module.assemble(case).operators for module in (forms, closed_form))
    assert operators.n_pairs == 5 * p
    assert abs(operators.gap_matrix - expected.gap_matrix).max() == 0.0
    np.testing.assert_array_equal(operators.gap0, expected.gap0)


def test_one_point_per_element_is_the_node_bit_for_bit() -> None:
    o = assemble(case_of(1, 4), needs_dolfinx=False).operators
    assert o.gap_matrix.data.tolist() == [-1.0, 1.0] * 4
    assert o.gap_matrix.indices.tolist() == [0, 8, 2, 10, 4, 12, 6, 14]
    assert o.pair_weights is None


def test_a_finer_mesh_of_the_same_points_has_the_same_gaps_at_rest() -> None:
    few, many = (
        assemble(case, needs_dolfinx=False).operators for case in (case_of(4, 5), case_of(1, 20))
    )
    assert few.gap0 == pytest.approx(many.gap0, rel=ROUND_OFF)


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0])
def test_laminae_that_follow_the_gap_touch_at_every_point(exponent: float) -> None:
    structure = assemble(case_of(4, 3, **{"gap.exponent": exponent}), needs_dolfinx=False)
    layout, o = structure.layout, structure.operators
    x, L = layout.parts[0].x[1:], layout.parts[0].x[-1]
    u = np.zeros(o.n_dofs)
    thick = layout.parts[0].dofs[1:]
    u[thick[:, 0]] = 0.012 * (x / L) ** exponent
    u[thick[:, 1]] = 0.012 * exponent * x ** (exponent - 1.0) / L**exponent
    inside = slice(4, None) if exponent == 1.0 else slice(None)  # a clamp has no slope
    assert (o.gap_matrix @ u + o.gap0)[inside] == pytest.approx(0.0, abs=1e-16)


def test_springs_share_the_stiffness_of_an_element() -> None:
    weights = assemble(case_of(4, 3), needs_dolfinx=False).operators.pair_weights
    assert weights is not None
    assert weights == pytest.approx([0.25] * 11 + [0.125])


def test_fields_are_given_at_nodes_and_points() -> None:
    structure = assemble(case_of(2, 2), needs_dolfinx=False)
    layout = structure.layout
    assert layout.stations.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert layout.stations_of(layout.interfaces[0]).tolist() == [1, 2, 3, 4]
    x, L = layout.parts[0].x, layout.parts[0].x[-1]
    u, phi = (np.stack([f, f])[:, None] for f in (x**3, 3.0 * x**2))
    everywhere = np.linspace(0.0, L, 5)
    deflection, slope = at_stations(layout, u, phi)
    assert deflection[1, 0] == pytest.approx(everywhere**3)
    assert slope[0, 0] == pytest.approx(3.0 * everywhere**2)
    EI = layout.parts[0].flexural_rigidity[0]
    moment = bending_moment(layout, u, phi)
    assert moment[0, 0] == pytest.approx(6.0 * EI * everywhere)


def test_a_table_is_read_at_the_points_themselves(tmp_path: Path) -> None:
    rows = [(0.0, 0.0), (0.1, 0.004), (0.2, 0.005), (0.685, 0.012)]
    table = tmp_path / "gap.csv"
    table.write_text("\n".join(f"{x},{gap}" for x, gap in rows))
    o = assemble(case_of(4, 5, **{"gap.file": str(table)}), needs_dolfinx=False).operators
    fine = assemble(case_of(1, 20, **{"gap.file": str(table)}), needs_dolfinx=False).operators
    assert o.gap0 == pytest.approx(fine.gap0, rel=1e-12)


@pytest.mark.parametrize("value", [0, 2.5, "two", 65])
def test_impossible_numbers_of_points_are_refused(value: object) -> None:
    with pytest.raises(CaseError, match=r"contact\.points_per_element: "):
        preset("paper", {"contact.points_per_element": value})


def test_separate_impulses_need_points_with_nodes_of_their_own() -> None:
    with pytest.raises(CaseError, match=r'use contact\.impulse = "consistent"'):
        preset("paper", {"contact.points_per_element": 2})
    within = {"contact.points_per_element": 2, "contact.law": "newton@moreau-jean"}
    assert preset("paper", within).contact.points_per_element == 2  # the scheme reads no impulse


def test_separate_impulses_on_points_of_one_element_would_add_energy() -> None:
    """Why they are refused: all pairs of a strip that falls flat get the whole rebound each."""
    structure = assemble(case_of(4, 3), needs_dolfinx=False)
    o, v = structure.operators, np.zeros(structure.operators.n_dofs)
    v[structure.layout.parts[1].dofs[1:, 0]] = -1.0
    inverse = np.diag(1.0 / o.require_lumped_mass())

    def added(pairs: slice) -> float:
        H = o.gap_matrix[pairs].toarray()
        W, rate = H @ inverse @ H.T, H @ v
        p = -1.1 * rate / W.diagonal()
        return float(p @ rate + 0.5 * p @ W @ p)

    assert added(slice(3, None, 4)) < 0.0  # the nodes alone
    assert added(slice(None)) > 0.0

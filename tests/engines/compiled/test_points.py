"""Contact points inside the elements in lane order: control values bound every gap from below."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest

from delam_fem.api import FloatArray, Operators, preset
from delam_fem.engines.compiled import inner_points
from delam_fem.engines.compiled.matrices import StepNumbers, System, build
from delam_fem.engines.compiled.state import Memory, memory, packed, view_at
from delam_fem.model.beams import closed_form

SCHEME = StepNumbers.moreau_jean(1e-4)
SHAPES: list[dict[str, object]] = [
    *({"gap.exponent": p} for p in (0.5, 1.0, 1.5, 2.0, 3.0, 5.0)),
    {"gap.shape": "mode"},
    {"gap.file": "table"},
]
GRADED = np.array([0.0, 0.02, 0.1, 0.3, 0.35, 0.6, 0.685])
AHEAD = 1e-3
TOLD = 0.3
"""Share of the open states, which are rough, that control values must tell without a look."""


system_at, memory_at = view_at(System), view_at(Memory)


@numba.njit
def lowest(system, state, ahead):  # type: ignore[no-untyped-def]
    s, m = system_at(system), memory_at(state)
    return (
        inner_points.lowest_control(m.X, s.size, s.points.control, ahead, False),
        inner_points.lowest_control(m.X, s.size, s.points.control, ahead, True),
    )


@numba.njit
def measured(system, state, ahead, is_closing):  # type: ignore[no-untyped-def]
    s, m = system_at(system), memory_at(state)
    return inner_points.measure_cells(s.points, s.size, m.X, ahead, is_closing, m.gap, m.rate)


def operators_of(p: int, shape: dict[str, object], folder: Path, x: FloatArray | None) -> Operators:
    if "gap.file" in shape:
        table = folder / "gap.csv"
        table.write_text("0,0\n0.05,0.002\n0.3,0.0021\n0.5,0.011\n0.685,0.012\n")
        shape = {"gap.file": str(table)}
    keys = {"contact.points_per_element": p, "contact.law": "newton@moreau-jean"}
    return closed_form.assemble(preset("paper", {"mesh.elements": 7, **keys, **shape}), x).operators


def moving(o: Operators, size: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return displacements and velocities; sizes of 1 close most gaps, small ones none."""
    rng = np.random.default_rng(seed)
    scale = np.where(np.arange(o.n_dofs) % 2 == 0, 0.01, 0.1)
    return size * scale * rng.standard_normal(o.n_dofs), 30.0 * scale * rng.standard_normal(
        o.n_dofs
    )


def loaded(o: Operators, motion: tuple[FloatArray, FloatArray]) -> tuple[System, Memory]:
    system, places = build(o, SCHEME)
    state = memory(system.size, o.n_pairs)
    state.X[: 2 * system.size] = places.inward(np.stack(motion)).ravel()
    return system, state


@pytest.mark.parametrize("x", [None, GRADED], ids=["uniform", "graded"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("p", [2, 3, 8])
def test_no_gap_is_overlooked(
    p: int, shape: dict[str, object], x: FloatArray | None, tmp_path: Path
) -> None:
    o = operators_of(p, shape, tmp_path, x)
    n_open = n_told = n_closed = 0
    for seed, size in enumerate(np.geomspace(1e-4, 1.0, 40)):
        u, v = moving(o, size, seed)
        system, state = loaded(o, (u, v))
        assert system.is_chained and system.is_within
        gap, rate = o.gap_matrix @ u + o.gap0, o.gap_matrix @ v
        exact_gaps = (gap + AHEAD * rate, gap + np.minimum(AHEAD * rate, 0.0))
        tables = packed(system), packed(state)
        at = [table.ctypes.data for table in tables]
        low = lowest(*at, AHEAD)
        for least, exact, is_closing in zip(low, exact_gaps, (False, True), strict=True):
            n_open += exact.min() > 0.0
            n_told += least > 0.0
            assert exact.min() > 0.0 or not least > 0.0
            smallest = measured(*at, AHEAD, is_closing)
            gaps, is_seen = np.array(state.gap), np.isfinite(state.gap)
            assert (exact[~is_seen] > 0.0).all()
            assert gaps[is_seen] == pytest.approx(exact[is_seen], rel=1e-12, abs=1e-16)
            assert state.rate[is_seen] == pytest.approx(rate[is_seen], rel=1e-12, abs=1e-15)
            assert smallest == gaps.min()
            n_closed += smallest <= 0.0
    assert n_told >= TOLD * n_open and n_closed >= 10


def test_at_rest_the_bound_is_near_the_gap(tmp_path: Path) -> None:
    """A parabola is a cubic, so δ = 0: only the slope at the first node lowers the bound."""
    o = operators_of(4, {"gap.exponent": 2.0}, tmp_path, None)
    system, state = loaded(o, (np.zeros(o.n_dofs), np.zeros(o.n_dofs)))
    tables = packed(system), packed(state)
    least, _ = lowest(*(table.ctypes.data for table in tables), 0.0)
    X = 0.25  # the point with the largest t' of the first cell; h G' = 2 G at its node
    t = (1.0 - X) / (3.0 - 2.0 * X)
    assert least == pytest.approx(o.gap0[3] * (1.0 - 2.0 * t), rel=1e-9)


def test_pairs_of_another_form_are_left_to_the_bands(tmp_path: Path) -> None:
    o = operators_of(2, {"gap.exponent": 2.0}, tmp_path, None)
    assert build(o, SCHEME)[0].is_within
    H = o.gap_matrix.tolil()
    H[1, 0] *= 1.5  # lower and upper point are not opposite
    others = [H.tocsr(), o.gap_matrix[[0, *range(2, 14)]], 2.0 * o.gap_matrix]
    for matrix in others:
        changed = replace(o, gap_matrix=matrix, gap0=o.gap0[-matrix.shape[0] :], pair_weights=None)
        assert not build(changed, SCHEME)[0].is_chained


def test_nodes_alone_need_no_points(tmp_path: Path) -> None:
    system, _ = build(operators_of(1, {"gap.exponent": 2.0}, tmp_path, None), SCHEME)
    assert system.is_chained and not system.is_within
    assert np.isfinite(system.rest).sum() == 7

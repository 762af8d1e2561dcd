"""The compiled engine's parts: vectors, chains, bands, and small problems with known motion."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numba
import numpy as np
import pytest
import scipy.sparse as sp
from support import compiled

from delam_fem.api import (
    BaseCoupling,
    Case,
    CaseError,
    FloatArray,
    Operators,
    Recorder,
    Span,
    State,
    assemble,
    engine_of,
    motion_of,
    preset,
    scheme_of,
    set_initial,
    span_of,
)
from delam_fem.contact import complementarity
from delam_fem.contact.decisions import IMPACTS, MOREAU, PENALTY, LawNumbers
from delam_fem.engines.compiled import (
    algebra,
    contact,
    engine as engine_module,
    matrices,
    simd_chains,
    steps,
)
from delam_fem.engines.compiled.engine import Compiled, compiled_engine
from delam_fem.engines.compiled.matrices import Problem, StepNumbers, build
from delam_fem.engines.compiled.state import PeriodBuffers, packed, view_at
from delam_fem.simulation.loop import simulate

ROUND_OFF = 1e-11
"""Relative, of a few hundred operations on matrices of condition 1e6 and less."""
SAME = 1e-10
"""m; two ways of computing the same step, some thousand times."""
G = 9.81


@numba.njit
def vector_operations(x, out):  # type: ignore[no-untyped-def]
    a, b = simd_chains.load(x, 0), simd_chains.load(x, 4)
    simd_chains.store(out, 0, simd_chains.fma(a, b, simd_chains.splat(1.0)))
    simd_chains.store(out, 4, a + b)
    simd_chains.store(out, 8, a - b * b)
    simd_chains.store(out, 12, simd_chains.swap_neighbours(a))
    simd_chains.store(out, 16, simd_chains.swap_halves(a))
    simd_chains.store(out, 20, simd_chains.smaller(a, b))
    return simd_chains.lane(a, 2)


KEPT: list[object] = []
"""Tables, and what they point to."""


def address_of(values: NamedTuple) -> int:
    """Return the address of the table of a named tuple."""
    table = packed(values)
    KEPT.append((values, table))
    return int(table.ctypes.data)


class Two(NamedTuple):
    """Two arrays of numbers."""

    start: FloatArray
    value: FloatArray


two_at = view_at(Two)
rows_at, band_at = view_at(algebra.Rows), view_at(algebra.Band)
problem_at, log_at = view_at(Problem), view_at(PeriodBuffers)


@numba.njit
def on_addresses(arrays):  # type: ignore[no-untyped-def]
    bare = two_at(arrays)
    return vector_operations(bare.value, bare.start)


@numba.njit
def smallest_of_lanes(arrays, size, ahead):  # type: ignore[no-untyped-def]
    bare = two_at(arrays)
    X, rest_gaps = bare.start, bare.value
    return (
        simd_chains.smallest_gap(X, size, rest_gaps, ahead),
        simd_chains.smallest_approach(X, size, rest_gaps, ahead),
        simd_chains.smallest_margin(X, size, rest_gaps, ahead),
    )


def test_smallest_gaps_in_lanes_are_those_of_the_rows() -> None:
    """With another gap in each row; catches a wrong row, field, lane, sign or half."""
    draw, rows = np.random.default_rng(3), 5
    for _ in range(50):
        X = draw.normal(size=(simd_chains.N_FIELDS, rows, 2, 4))
        rest_gaps = draw.normal(size=(rows, 4))
        rest_gaps[:, 2:] = np.inf  # of the halves that have the negative of the gap
        size, ahead = 8 * rows, float(draw.uniform())
        smallest = smallest_of_lanes(address_of(Two(X.ravel(), rest_gaps.ravel())), size, ahead)
        gap, rate = (
            X[k, :, 0][:, [2, 3]] - X[k, :, 0][:, [0, 1]] + (rest_gaps[:, :2] if k == 0 else 0.0)
            for k in (simd_chains.U, simd_chains.V)
        )
        expected = (
            (gap + ahead * rate).min(),
            (gap + np.minimum(ahead * rate, 0.0)).min(),
            (gap - ahead * np.abs(rate)).min(),
        )
        np.testing.assert_allclose(smallest, expected, rtol=1e-13)


def test_vector_operations() -> None:
    rng = np.random.default_rng(1)
    x, out = rng.normal(size=8), np.zeros(24)
    a, b = x[:4], x[4:]
    third = on_addresses(address_of(Two(out, x)))
    expected = [a * b + 1.0, a + b, a - b * b, a[[1, 0, 3, 2]], a[[2, 3, 0, 1]], np.minimum(a, b)]
    np.testing.assert_allclose(out, np.concatenate(expected), rtol=1e-15, atol=1e-15)
    assert third == a[2]


def test_smaller_passes_over_what_is_no_number() -> None:
    x, out = np.array([np.nan, 1.0, np.nan, 4.0, 2.0, 0.5, 3.0, 5.0]), np.zeros(24)
    on_addresses(address_of(Two(out, x)))
    assert out[20:].tolist() == [2.0, 0.5, 3.0, 4.0]


def test_aligned_zeros_begin_at_a_cache_line() -> None:
    for size in (1, 7, 80):
        zeros = simd_chains.aligned_zeros(size)
        assert zeros.ctypes.data % 64 == 0
        assert zeros.shape == (size,) and not zeros.any()


# -- chains -----------------------------------------------------------------------------------


def paper(**settings: object) -> Case:
    return preset("paper", {"time.periods": 2, "output.window_periods": 2, **settings})


def operators_of(n: int, mass: str = "consistent") -> Operators:
    return assemble(paper(**{"mesh.elements": n, "time.mass": mass}), needs_dolfinx=False).operators


@numba.njit
def solve(arrays, size):  # type: ignore[no-untyped-def]
    bare = two_at(arrays)
    simd_chains.substitute(bare.value, size, bare.start, simd_chains.R, simd_chains.Z)


@numba.njit
def form(arrays, size):  # type: ignore[no-untyped-def]
    bare = two_at(arrays)
    return simd_chains.loss(bare.value, size, bare.start)


@pytest.mark.parametrize("n", [1, 2, 3, 6, 7])
def test_chains_solve_and_measure(n: int) -> None:
    o = operators_of(n)
    A = sp.csr_matrix(o.mass + 1e-7 * o.stiffness)
    order = simd_chains.lane_order(n)
    assert sorted(set(order)) == sorted(order)
    chains = simd_chains.chains(A, order)
    assert chains is not None
    size = simd_chains.ROW * ((n + 1) // 2)
    X = simd_chains.aligned_zeros(simd_chains.N_FIELDS * size)
    fields = X.reshape(-1, size)
    rng = np.random.default_rng(n)
    right, p = rng.normal(size=(2, 4 * n))
    fields[simd_chains.R, order], fields[simd_chains.P, order] = right, p
    solve(address_of(Two(simd_chains.solution_tape(chains), X)), size)
    exact = sp.linalg.spsolve(A.tocsc(), right)
    solution = fields[simd_chains.Z, order]
    np.testing.assert_allclose(solution, exact, rtol=0.0, atol=ROUND_OFF * np.abs(exact).max())
    value = form(address_of(Two(simd_chains.form_tape(chains), X)), size)
    assert value == pytest.approx(p @ (A @ p), rel=ROUND_OFF)


def test_what_couples_more_than_neighbours_is_no_chain() -> None:
    o = operators_of(4)
    order = simd_chains.lane_order(4)
    for i, j in ((0, 4), (2, 10), (1, 8)):
        A = sp.lil_matrix(o.stiffness)
        A[i, j] = A[j, i] = 1.0
        assert simd_chains.chains(A.tocsr(), order) is None


def test_rayleigh_damping_is_recognised() -> None:
    case = paper(**{"mesh.elements": 5})
    o = assemble(case, needs_dolfinx=False).operators
    coefficients = simd_chains.rayleigh(o)
    assert coefficients is not None
    for i in (0, 1):
        assert (coefficients[0][i], coefficients[1][i]) == pytest.approx(case.rayleigh(i), rel=1e-9)
    damper = sp.csr_matrix(([1e-6], ([9], [9])), shape=o.damping.shape)
    assert simd_chains.rayleigh(dataclasses.replace(o, damping=o.damping + damper)) is None


def test_the_right_path_is_taken() -> None:
    o = operators_of(5)
    step = 1e-4
    assert build(o, StepNumbers.newmark(step))[0].is_chained
    assert build(o, StepNumbers.moreau_jean(step, 0.7))[0].is_chained
    assert not build(o, StepNumbers.newmark(step))[0].is_diagonal_load
    assert build(operators_of(5, "lumped"), StepNumbers.newmark(step))[0].is_diagonal_load
    assert not build(operators_of(5, "lumped"), StepNumbers.newmark(1e-9))[0].is_diagonal_load
    assert not build(o, StepNumbers.newmark(step, beta=0.0))[0].is_chained
    shifted = dataclasses.replace(o, gap_matrix=2.0 * o.gap_matrix)
    assert not build(shifted, StepNumbers.newmark(step))[0].is_chained


# -- bands ------------------------------------------------------------------------------------


@numba.njit
def solve_band(band, X, size):  # type: ignore[no-untyped-def]
    algebra.substitute(rows_at(X).value, size, band_at(band), 0, 1)


def numbers_in(values: object) -> list[object]:
    """Return all numbers of nested named tuples, arrays as bytes."""
    if isinstance(values, tuple):
        return [number for value in values for number in numbers_in(value)]
    return [values.tobytes() if isinstance(values, np.ndarray) else values]


def test_what_sizes_of_steps_share_is_that_of_their_operators() -> None:
    first = assemble(preset("paper", {"time.mass": "lumped"}), needs_dolfinx=False).operators
    second = dataclasses.replace(first, damping=2.0 * first.damping, gap0=2.0 * first.gap0)
    schemes = [StepNumbers.newmark(1e-3), StepNumbers.moreau_jean(1e-6), StepNumbers.newmark(1e-6)]
    order = [(o, scheme) for scheme in schemes for o in (first, second, first)]
    shared = [numbers_in(build(o, scheme)[0]) for o, scheme in order]
    for (o, scheme), numbers in zip(order, shared, strict=True):
        build.cache_clear()
        matrices._chained.cache_clear()
        assert numbers_in(build(o, scheme)[0]) == numbers
    assert shared[0] != shared[1] and shared[0] == shared[2]
    assert build(first, schemes[0])[0].is_chained


def test_band_solves() -> None:
    rng = np.random.default_rng(3)
    n = 30
    A = sp.random(n, n, density=0.1, random_state=4) + sp.diags(np.full(n, 5.0))
    A = sp.csr_matrix(A + A.T)
    order = algebra.band_order(A)
    to = sp.csr_matrix((np.ones(n), (order, np.arange(n))), (n, n))
    right = rng.normal(size=n)
    X = np.concatenate([to @ right, np.zeros(n)])
    nothing = np.zeros(0, dtype=np.int64)
    band = algebra.factorise(to @ A @ to.T)
    solve_band(address_of(band), address_of(algebra.Rows(nothing, nothing, X)), n)
    np.testing.assert_allclose(A @ (to.T @ X[n:]), right, rtol=0.0, atol=1e-12)


def test_singular_matrix_is_refused() -> None:
    with pytest.raises(ArithmeticError, match="singular at row 1"):
        algebra.factorise(sp.csr_matrix([[1.0, 1.0], [1.0, 1.0]]))


# -- small problems ---------------------------------------------------------------------------


def ball() -> Operators:
    """Return a mass of 2 kg above a floor; a base with q'' = g loads it by its weight."""
    m = np.array([2.0])
    return Operators(
        mass=sp.csr_matrix([[2.0]]),
        damping=sp.csr_matrix([[0.0]]),
        stiffness=sp.csr_matrix([[0.0]]),
        lumped_mass=m,
        base=BaseCoupling(m, np.zeros(1), np.zeros(1)),
        gap_matrix=sp.csr_matrix([[1.0]]),
        gap0=np.zeros(1),
        probes=sp.csr_matrix([[1.0]]),
    )


def drop(law: LawNumbers, scheme: StepNumbers, n_steps: int) -> Recorder:
    """Drop the ball from 1 m."""
    o = ball()
    engine = Compiled(o, [scheme] * 3, law)
    recorder = Recorder(o.base, Span(scheme.time_step, n_steps, 1, 1, 1, 10.0), n_probes=1)
    states = np.tile([0.0, 0.0, G], (n_steps + 1, 1))
    set_initial(engine, State(np.array([[1.0], [0.0], [0.0]]), np.zeros(1, dtype=bool)), states[0])
    assert simulate(engine, recorder, lambda _: states) == "completed"
    return recorder


@pytest.mark.parametrize("is_coupled", [False, True])
def test_ball_rebounds_by_restitution(is_coupled: bool) -> None:
    e, step = 0.5, 1e-4
    recorder = drop(LawNumbers(IMPACTS, is_coupled, e), StepNumbers.newmark(step), 8000)
    jumps = recorder.window[0].jumps.columns()
    at, energy = jumps.ticks[0], jumps.energies[0]
    speed = np.sqrt(2.0 * G)
    assert at * step == pytest.approx(np.sqrt(2.0 / G), abs=step)
    assert jumps.rate_pre[0] == pytest.approx(-speed, rel=1e-3)
    assert jumps.rate_post[0] == pytest.approx(e * speed, rel=1e-3)
    assert jumps.impulses[0] == pytest.approx(2.0 * (1.0 + e) * speed, rel=1e-3)
    assert energy == pytest.approx(-(1.0 - e**2) * 2.0 * G, rel=1e-3)
    assert recorder.window[0].u[at:, 3].max() == pytest.approx(e**2, rel=2e-3)


def test_ball_rebounds_under_moreau() -> None:
    recorder = drop(
        LawNumbers(MOREAU, True, 0.5, threshold=1e-3), StepNumbers.moreau_jean(1e-4), 8000
    )
    at = recorder.window[0].jumps.columns().ticks[0]
    assert recorder.window[0].u[at:, 3].max() == pytest.approx(0.25, rel=2e-3)


def test_ball_on_a_spring() -> None:
    k = 2.0e5
    recorder = drop(LawNumbers(PENALTY, stiffness=k), StepNumbers.newmark(2e-6), 260000)
    below = recorder.window[0].u[:, 3] < 0.0
    omega = np.sqrt(k / 2.0)
    duration = (np.pi + 2.0 * np.arctan(np.sqrt(G / 2.0) / omega)) / omega
    assert below.sum() * 2e-6 == pytest.approx(duration, rel=1e-3)
    assert recorder.energy_residual() < 1e-9


# -- the engine -------------------------------------------------------------------------------


def start(case: Case) -> tuple[Compiled, Recorder]:
    operators = assemble(case, needs_dolfinx=False).operators
    span = span_of(case)
    engine = compiled_engine(
        operators, case.contact_law, scheme_of(case), case.time_step, span.refinement
    )
    recorder = Recorder(operators.base, span, operators.n_probes)
    set_initial(engine, None, motion_of(case)(0)[0])
    return engine, recorder


LAWS = (
    "none",
    "none@moreau-jean",
    "newton",
    "newton-penalty",
    "penalty",
    "newton@moreau-jean",
)


@pytest.mark.parametrize("law", LAWS)
def test_both_paths_compute_the_same(law: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = paper(**{"contact.law": law, "contact.impulse": "consistent"})
    engine, recorder = start(case)
    simulate(engine, recorder, motion_of(case))
    monkeypatch.setattr(simd_chains, "rayleigh", lambda operators: None)
    banded_engine, same = start(case)
    assert engine.system.is_chained and not banded_engine.system.is_chained
    simulate(banded_engine, same, motion_of(case))
    for a, b in zip(recorder.window, same.window, strict=True):
        np.testing.assert_allclose(a.u[:, 3:], b.u[:, 3:], rtol=0.0, atol=SAME)
        np.testing.assert_array_equal(a.jumps.columns().ticks, b.jumps.columns().ticks)
    np.testing.assert_allclose(recorder.ledger, same.ledger, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("law", LAWS)
def test_restored_run_goes_on_bit_for_bit(law: str) -> None:
    case = paper(**{"contact.law": law, "time.periods": 3})
    engine, recorder = start(case)
    motion, states = motion_of(case), []
    stop = lambda period: bool(states.append(engine.state()))  # noqa: E731
    simulate(engine, recorder, motion, stop=stop, every=1)
    other, same = start(case)
    same.n_closed = 1
    other.restore(states[0], motion(1)[0])
    simulate(other, same, motion)
    for a, b in zip(list(recorder.window)[-2:], list(same.window)[-2:], strict=True):
        np.testing.assert_array_equal(a.u, b.u)
        np.testing.assert_array_equal(a.v, b.v)
    np.testing.assert_array_equal(recorder.ledger[1:], same.ledger[1:])


def test_full_buffers_lose_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    case = paper(**{"contact.law": "newton"})
    engine, recorder = start(case)
    simulate(engine, recorder, motion_of(case))
    monkeypatch.setattr(engine_module, "EVENTS", 2)
    monkeypatch.setattr(engine_module, "HITS", 1)
    small, same = start(case)
    simulate(small, same, motion_of(case))
    for a, b in zip(recorder.window, same.window, strict=True):
        assert a.jumps.columns().ticks.size > 2
        np.testing.assert_array_equal(a.u, b.u)
        np.testing.assert_array_equal(np.array(a.contact), np.array(b.contact))
        for one, other in zip(a.jumps.columns(), b.jumps.columns(), strict=True):
            np.testing.assert_array_equal(one, other)


def told(recorder: Recorder) -> list[bytes]:
    """Return all numbers of a recorder."""
    rows = [getattr(recorder, name) for name in ("strobe", "envelope", "ledger", "impulse")]
    for r in recorder.window:
        rows += [r.u, r.v, np.array(r.frames), np.array(r.contact), r.start, r.resting]
        rows += [r.is_divided, np.array([r.released, r.impact, r.n_steps]), *r.jumps.columns()]
    return [rows.tobytes() for rows in (*rows, recorder.effort, np.array(recorder.n_closed))]


@pytest.mark.parametrize(("law", "refine"), [("newton-penalty", 1), ("newton@moreau-jean", 8)])
@pytest.mark.parametrize("window", [1, 4, 14])
def test_blocks_record_what_single_periods_do(
    law: str, refine: int, window: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = {"contact.law": law, "time.refine": refine, "output.window_periods": window}
    case = paper(**keys, **{"time.periods": 23, "contact.impulse": "consistent"})
    single, alone = start(case)
    simulate(single, alone, motion_of(case), every=1)
    monkeypatch.setattr(engine_module, "EVENTS", 40)  # enlarged within a block
    monkeypatch.setattr(engine_module, "HITS", 40)
    blocks, together = start(case)
    asked: list[int] = []
    simulate(blocks, together, motion_of(case), stop=lambda n: bool(asked.append(n)))
    assert asked == [10, 20, 23]
    assert together.impulse[:, 1].sum() > 80
    assert told(together) == told(alone)


def test_a_stopped_block_leaves_the_window_of_its_last_periods() -> None:
    case = paper(**{"time.periods": 23, "output.window_periods": 12})
    engine, recorder = start(case)
    simulate(engine, recorder, motion_of(case))
    other, parted = start(case)
    assert simulate(other, parted, motion_of(case), stop=lambda n: n == 10) == "interrupted"
    first = [record.u.copy() for record in parted.window]
    assert len(first) == 10
    assert simulate(other, parted, motion_of(case)) == "completed"
    assert told(parted) == told(recorder)
    for record, u in zip(parted.window, first, strict=False):
        assert record.n_steps == case.time.steps_per_period
        assert not np.array_equal(record.u, u)
    assert len(parted.window) == 12


def test_impacts_are_added_up_as_numpy_does() -> None:
    rng, added_up = np.random.default_rng(2), compiled(steps._sum)
    for n in (0, 1, 7, 8, 100, 129, 1000, 8185, 8192):
        x = rng.normal(size=n) ** 3
        assert added_up(x, 0, n, -np.inf) == x.sum()
        assert added_up(x, 0, n, 0.0) == np.maximum(x, 0.0).sum()


def test_divergence_ends_the_period_early() -> None:
    case = paper(**{"damping.rayleigh": "mass", "time.periods": 200})
    engine, recorder = start(case)
    assert simulate(engine, recorder, motion_of(case)) == "diverged"
    assert recorder.n_closed < 200


@numba.njit
def examine(problem, log):  # type: ignore[no-untyped-def]
    p = problem_at(problem)
    return contact.examine(p.fine, p.law, p.memory, log_at(log), 1)


@pytest.mark.slow
def test_velocities_that_are_no_numbers_are_told() -> None:
    engine, recorder = start(paper(**{"contact.impulse": "consistent"}))
    motion = np.zeros((3, engine.operators.n_dofs))
    motion[0, 0], motion[1, 0] = 1.0, np.inf  # node 1 of lamina 1 far beyond lamina 2
    resting = np.zeros(engine.operators.n_pairs, dtype=bool)
    engine.restore(State(motion, resting), np.zeros(3))
    table = packed(engine._buffers(recorder, engine._block(recorder, 1)))
    ending = examine(engine.address, table.ctypes.data)
    assert ending == -complementarity.NOT_FINITE
    with pytest.raises(ArithmeticError, match="not finite"):
        complementarity.require_solved(-ending)
    with pytest.raises(ArithmeticError, match="no solution found"):
        complementarity.require_solved(complementarity.NOT_FOUND)


def test_unstable_central_difference_is_refused() -> None:
    case = paper(**{"time.scheme": "central-difference"})
    with pytest.raises(CaseError, match="the scheme needs a time step"):
        engine_of(
            assemble(case, needs_dolfinx=False).operators,
            case.contact_law,
            scheme_of(case),
            case.time_step,
        )


def test_engines_leave_their_buffers_to_the_next_one_and_write_to_them_no_more() -> None:
    """What a recorder has is its own; an engine that goes on after its end has new buffers."""
    case = paper(**{"contact.law": "newton", "time.periods": 4})
    motion = motion_of(case)
    first, recorder = start(case)
    simulate(first, recorder, motion)
    before = told(recorder)
    first.destroy()
    second, others = start(case.with_overrides({"contact.restitution": 0.7}))
    simulate(second, others, motion)
    later = told(others)
    assert told(recorder) == before != later
    of_first = recorder.of_one_period()
    simulate(first, of_first, motion)  # as if it had been forgotten
    assert of_first.impulse[0, 1] > 0
    assert told(others) == later

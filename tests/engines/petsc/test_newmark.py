"""The PETSc steppers against dense linear algebra, and their springs against a stiffer matrix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delam_fem import Decision
from delam_fem.api import Operators, assemble, preset
from delam_fem.contact.decisions import NO_PAIRS, PairState
from delam_fem.engines.petsc import newmark, theta
from delam_fem.engines.petsc.newmark import Newmark
from delam_fem.engines.petsc.theta import MoreauJean
from delam_fem.simulation.refinement import AHEAD, BACK

ROUND_OFF = 1e-9
"""Relative, after 50 steps; stiff modes make the accelerations some 1e6 times the displacements."""
DT = 2e-4
NOTHING = np.zeros(0)


def problem(elements: int = 6) -> Operators:
    return assemble(preset("paper", {"mesh.elements": elements}), needs_dolfinx=False).operators


def shaken(n_steps: int) -> np.ndarray:
    t = DT * np.arange(n_steps + 1)
    A, w = 0.0025, 20.0
    return (A * np.array([np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)])).T


def dense_step(o: Operators, state: np.ndarray, base: np.ndarray, spring: np.ndarray) -> np.ndarray:
    """Take one average-acceleration step with springs in the matrix."""
    H = o.gap_matrix.toarray()
    K = o.stiffness.toarray() + H.T @ (spring[:, None] * H)
    M, C = o.mass.toarray(), o.damping.toarray()
    q, dq, ddq = base
    f = -(o.base.mass * ddq + o.base.damping * dq + o.base.stiffness * q)
    f = f - H.T @ (spring * o.gap0)
    u, v, a = state
    u_star, v_star = u + DT * v + DT**2 / 4 * a, v + DT / 2 * a
    a_new = np.linalg.solve(M + DT / 2 * C + DT**2 / 4 * K, f - C @ v_star - K @ u_star)
    return np.array([u_star + DT**2 / 4 * a_new, v_star + DT / 2 * a_new, a_new])


@pytest.mark.parametrize("direct_pairs", [64, 0], ids=["direct", "conjugate gradients"])
@pytest.mark.parametrize("stiffness", [100.0, 1e5])
@pytest.mark.parametrize("is_weighted", [False, True])
def test_springs_are_those_of_a_stiffer_matrix(
    direct_pairs: int, stiffness: float, is_weighted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(newmark, "DIRECT_PAIRS", direct_pairs)
    o = problem()
    weights = np.linspace(0.3, 2.0, o.n_pairs) if is_weighted else np.ones(o.n_pairs)
    if is_weighted:
        o = replace(o, pair_weights=weights)
    stepper = Newmark(o, DT, spring=(stiffness, 0.0))
    base_states = shaken(50)
    stepper.begin(base_states)
    resting = np.array([True, False, True, True, False, False])
    stepper.jump(Decision(NO_PAIRS, NOTHING, NOTHING, NOTHING, PairState(resting)))
    state = stepper.state()
    for base in base_states[1:]:
        stepper.advance()
        state = dense_step(o, state, base, stiffness * weights * resting)
    for values, expected in zip(stepper.state(), state, strict=True):
        assert np.abs(values - expected).max() <= ROUND_OFF * np.abs(expected).max()
    gap = o.gap_matrix @ state[0] + o.gap0
    energy = 0.5 * stiffness * float((weights * gap**2)[resting].sum())
    assert stepper.energies().spring == pytest.approx(energy, rel=1e-6)
    stepper.destroy()


def test_renewed_acceleration_fulfils_the_equation_of_motion() -> None:
    o = problem()
    stepper = Newmark(o, DT, spring=(1e4, 3.0))
    base_states = shaken(20)
    stepper.begin(base_states)
    stepper.renew_acceleration()
    for _ in range(20):
        stepper.advance()
    resting = np.arange(o.n_pairs) < 3
    hit = np.array([4])
    stepper.jump(Decision(hit, np.array([1e-4]), NOTHING, NOTHING, PairState(resting)))
    u, v, a = stepper.state()
    q, dq, ddq = base_states[20]
    force = np.where(resting, 1e4 * (o.gap_matrix @ u + o.gap0) + 3.0 * (o.gap_matrix @ v), 0.0)
    terms = [
        o.mass @ a,
        o.damping @ v,
        o.stiffness @ u,
        o.gap_matrix.T @ force,
        o.base.mass * ddq + o.base.damping * dq + o.base.stiffness * q,
    ]
    assert np.abs(sum(terms)).max() <= ROUND_OFF * max(np.abs(t).max() for t in terms)
    stepper.destroy()


@pytest.mark.parametrize("coupled", [False, True])
def test_impulses_change_the_velocities_by_their_mass(coupled: bool) -> None:
    o = problem()
    stepper = Newmark(o, DT, coupled_impulses=coupled)
    hit, impulses = np.array([1, 5]), np.array([1e-3, 2e-3])
    before = stepper.state()[1]
    energy, switched = stepper.jump(Decision(hit, impulses, NOTHING, NOTHING))
    change = stepper.state()[1] - before
    p = np.zeros(o.n_pairs)
    p[hit] = impulses
    load = o.gap_matrix.T @ p
    M = o.mass.toarray()
    expected = np.linalg.solve(M, load) if coupled else load / o.lumped_mass
    assert change == pytest.approx(expected, rel=ROUND_OFF, abs=ROUND_OFF * np.abs(expected).max())
    assert energy == pytest.approx(0.5 * change @ M @ change, rel=ROUND_OFF)  # it was at rest
    assert switched == 0.0
    stepper.destroy()


@pytest.mark.parametrize("coupled", [False, True])
def test_compliance_is_that_of_the_mass(coupled: bool) -> None:
    o = problem()
    stepper = Newmark(o, DT, coupled_impulses=coupled)
    H = o.gap_matrix.toarray()
    M = o.mass.toarray() if coupled else np.diag(o.lumped_mass)
    W = H @ np.linalg.solve(M, H.T)
    pairs = np.array([5, 0, 3])
    assert stepper.compliance.block(pairs) == pytest.approx(W[np.ix_(pairs, pairs)], rel=ROUND_OFF)
    assert stepper.compliance.diagonal(pairs) == pytest.approx(W[pairs, pairs], rel=ROUND_OFF)
    stepper.destroy()


@pytest.mark.parametrize("theta", [0.5, 0.7])
def test_moreau_step_against_its_equations(theta: float) -> None:
    o = problem()
    stepper = MoreauJean(o, DT, theta=theta)
    base_states = shaken(10)
    stepper.begin(base_states)
    for _ in range(9):
        stepper.advance()
    u, v, _ = stepper.state()
    stepper.advance()
    hit, impulses = np.array([2, 3]), np.array([1e-4, 2e-4])
    pre, free = stepper.rate_pre()[hit], stepper.rate_free()[hit]
    post = free + stepper.compliance.block(hit) @ impulses
    stepper.jump(Decision(hit, impulses, pre, post))
    u_new, v_new, _ = stepper.state()
    v_mean, p = theta * v_new + (1 - theta) * v, np.zeros(o.n_pairs)
    p[hit] = impulses
    q, dq, ddq = (1 - theta) * base_states[9] + theta * base_states[10]
    load = -(o.base.mass * ddq + o.base.damping * dq + o.base.stiffness * q)
    u_theta = u + theta * (u_new - u)
    force = load - o.damping @ v_mean - o.stiffness @ u_theta
    left, right = o.mass @ (v_new - v), DT * force + o.gap_matrix.T @ p
    assert np.abs(left - right).max() <= ROUND_OFF * np.abs(DT * o.stiffness @ u_theta).max()
    assert u_new == pytest.approx(u + DT * v_mean, rel=ROUND_OFF, abs=1e-15)
    assert (o.gap_matrix @ v_new)[hit] == pytest.approx(post, rel=1e-6)
    stepper.destroy()


@pytest.mark.parametrize("scheme", [Newmark, MoreauJean])
def test_what_is_seen_belongs_to_the_present_state(scheme: type[Newmark | MoreauJean]) -> None:
    o = problem()
    stepper = scheme(o, 2 * DT, DT)
    push = Decision(np.array([2, 5]), np.array([2e-4, 1e-4]), np.zeros(2), np.zeros(2))
    actions = {
        "begin": lambda: stepper.begin(shaken(4)),
        "advance": stepper.advance,
        "jump": lambda: stepper.jump(push),
        "keep": stepper.keep,
        "another step": stepper.advance,
        "undo": stepper.undo,
        "restore": lambda: stepper.restore(np.ones((3, o.n_dofs))),
    }
    for name, act in actions.items():
        act()
        stepper.finish_step()
        u, v, _ = stepper.state()
        rows = np.vstack([o.base.mass, o.base.damping, o.base.stiffness, o.observed.toarray()])
        gap, rate = stepper.margins()
        for computed, expected in (
            (gap, o.gap_matrix @ u + o.gap0),
            (rate, o.gap_matrix @ v),
            (stepper.seen_u, rows @ u),
            (stepper.seen_v, o.observed @ v),
        ):
            scale = max(np.abs(expected).max(), 1e-9)
            assert np.abs(computed - expected).max() <= ROUND_OFF * scale, name
    stepper.destroy()


def test_pairs_on_springs_have_negative_margins() -> None:
    o = problem()
    stepper = Newmark(o, DT, spring=(100.0, 0.0))
    stepper.restore(np.arange(3.0 * o.n_dofs).reshape(3, -1))
    gap, rate = (values.copy() for values in stepper.margins())
    stepper.remember(PairState(np.arange(o.n_pairs) == 1))
    sign = np.where(np.arange(o.n_pairs) == 1, -1.0, 1.0)
    assert np.abs(rate).min() > 0.0
    assert [values.tolist() for values in stepper.margins()] == [
        (sign * gap).tolist(),
        (sign * rate).tolist(),
    ]
    stepper.destroy()


def test_kept_responses_make_the_jump_that_a_solve_makes(monkeypatch: pytest.MonkeyPatch) -> None:
    o = problem()
    push = Decision(np.array([2, 5]), np.array([2e-4, 1e-4]), np.array([-1.0, -2.0]), np.ones(2))
    results = []
    for room in (theta.ROOM, 0):
        monkeypatch.setattr(theta, "ROOM", room)
        stepper = MoreauJean(o, 2 * DT, DT)
        stepper.begin(shaken(9))
        for level in (0, 1, 0):  # each size of steps has responses of its own
            stepper.use(level)
            stepper.advance()
            assert stepper.jump(push)[0] == pytest.approx(-5e-5)
            stepper.finish_step()
        results.append((stepper.state()[:2], stepper.dissipated, stepper.margins()[1].copy()))
        stepper.destroy()
    (state, loss, rate), (solved, its_loss, its_rate) = results
    for row, expected in ((state[0], solved[0]), (state[1], solved[1]), (rate, its_rate)):
        assert np.abs(row - expected).max() <= ROUND_OFF * np.abs(expected).max()
    assert loss == pytest.approx(its_loss, rel=1e-9)


@pytest.mark.parametrize("scheme", [Newmark, MoreauJean])
def test_what_is_near_is_sought_anew_when_the_state_changes(
    scheme: type[Newmark | MoreauJean],
) -> None:
    o = problem()
    stepper = scheme(o, DT, **({"spring": (100.0, 0.0)} if scheme is Newmark else {}))
    hit = np.array([5])
    push = Decision(hit, np.array([-0.02]), np.zeros(1), np.zeros(1), PairState.at_start(6))
    reach = 0.1
    stepper.begin(shaken(4))
    stepper.advance()
    stepper.finish_step()
    assert stepper.nearness(reach, 1e-3) == 0
    stepper.keep()
    stepper.advance()
    stepper.jump(push)
    assert stepper.nearness(reach, 1e-3) & AHEAD
    assert stepper.nearness(1e-9, 1e-3) == 0  # nor is it that of another reach
    assert stepper.nearness(reach, 1e-3) & AHEAD
    stepper.undo()
    assert stepper.nearness(reach, 1e-3) == 0
    if scheme is Newmark:
        stepper.restore(1e-9 * np.arange(3.0 * o.n_dofs).reshape(3, -1))
        assert stepper.nearness(reach, 0.0) == 0
        # an open pair "rests": its margin is negative
        stepper.remember(PairState(np.arange(o.n_pairs) == 5))
        assert stepper.nearness(reach, 0.0) == AHEAD + BACK
    stepper.destroy()


@pytest.mark.parametrize("is_observed", [False, True])
@pytest.mark.parametrize("scheme", [Newmark, MoreauJean])
def test_a_step_that_is_undone_leaves_no_trace(
    scheme: type[Newmark | MoreauJean], is_observed: bool
) -> None:
    rows, results = shaken(2).tolist(), []
    for is_detour in (False, True):
        stepper = scheme(problem(), DT)
        stepper.begin(shaken(2))
        stepper.restore(np.random.default_rng(3).normal(size=(3, stepper.operators.n_dofs)))
        if is_detour:
            stepper.keep()
            stepper.begin_step(rows[0], rows[2])
            stepper.advance()
            if is_observed:
                stepper.finish_step()
            stepper.undo()
        lost = stepper.dissipated
        stepper.begin_step(rows[0], rows[1])
        stepper.advance()
        stepper.finish_step()
        results.append((stepper.dissipated - (lost if is_observed else 0.0), stepper.state()))
        stepper.destroy()
    (loss, state), (its_loss, its_state) = results
    assert loss == pytest.approx(its_loss, rel=1e-9) and loss > 0.0
    assert np.array_equal(state, its_state)


def test_a_step_that_nobody_observed_is_accounted_for() -> None:
    losses = []
    for is_observed in (True, False):
        stepper = MoreauJean(problem(), DT)
        stepper.begin(shaken(9))
        for _ in range(9):
            stepper.advance()
            if is_observed:
                stepper.finish_step()
        stepper.finish_step()
        losses.append((stepper.dissipated, stepper.state().tolist()))
        stepper.destroy()
    assert losses[0] == losses[1]
    assert losses[0][0] > 0.0


def test_a_table_that_may_change_is_read_in_every_period() -> None:
    stepper = Newmark(problem(), DT)
    table = shaken(3)
    stepper.begin(table)
    table[1] = 7.0
    assert list(stepper.begin(table)[1]) == [7.0, 7.0, 7.0]
    table.flags.writeable = False
    assert stepper.begin(table) is stepper.begin(table)
    assert list(stepper.begin(shaken(3))[1]) == shaken(3)[1].tolist()
    stepper.destroy()


def test_blocks_of_the_compliance_are_those_of_the_mass_and_the_last_is_at_hand() -> None:
    o = problem()
    stepper = Newmark(o, DT, coupled_impulses=True)
    W = o.gap_matrix @ np.linalg.solve(o.mass.toarray(), o.gap_matrix.T.toarray())
    for pairs in ([1, 3], [3, 1], [0, 2, 4], [5], [1, 3]):
        block = stepper.compliance.block(np.array(pairs))
        assert block == pytest.approx(W[np.ix_(pairs, pairs)], rel=ROUND_OFF)
        asked, recent_block = stepper.compliance.recent
        assert asked.tolist() == pairs and recent_block is block
    stepper.destroy()

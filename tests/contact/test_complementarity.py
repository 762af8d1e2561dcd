"""The complementarity solver against brute force over all active sets and its own definition."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from support import compiled

from delam_fem.api import FloatArray
from delam_fem.contact import complementarity
from delam_fem.contact.complementarity import SOLVED, WarmStart, nothing_known, solve

ROUND_OFF = 1e-9
"""Of solutions with condition numbers up to about 1e6, relative to the velocities."""
DEGENERATE = 1e-5
"""Where pairs are nearly alike, residuals of up to sqrt(1e-13) velocities (the solver's limit for a
pivot) cannot be told from round-off, nor can brute force tell them; some ten times that for p."""
MAX_PAIRS = 6
MASS_FLOOR = 0.1
"""Added to the random mass matrices, so that their condition stays below about 1e3."""


def brute_force(W: FloatArray, q: FloatArray) -> FloatArray:
    """Return the p of the active set that violates the conditions least, of all 2^k sets."""
    best, least = np.zeros(q.size), np.inf
    scale = np.abs(W).max()
    for size in range(q.size + 1):
        for subset in itertools.combinations(range(q.size), size):
            active = list(subset)
            p = np.zeros(q.size)
            if active:
                block = W[np.ix_(active, active)]
                p[active] = np.linalg.lstsq(block, -q[active], rcond=1e-12)[0]
            residual = W @ p + q
            inner = np.abs(residual[active]).max(initial=0.0)
            violation = max(-residual.min(), -p.min() * scale, inner)
            if violation < least:
                best, least = p, violation
    return best


class Impact:
    """A random impact: W = H M⁻¹ Hᵀ and q = H v, as mechanics gives them."""

    def __init__(self, seed: int, n_pairs: int, n_dofs: int, likeness: float | None) -> None:
        rng = np.random.default_rng(seed)
        self.H = rng.normal(size=(n_pairs, n_dofs))
        if likeness is not None and n_pairs > 1:
            first, second = rng.choice(n_pairs, size=2, replace=False)
            copy = rng.choice([0.5, 1.0, 2.0]) * self.H[first]
            self.H[second] = copy + likeness * rng.normal(size=n_dofs)
        root = rng.normal(size=(n_dofs, n_dofs))
        self.inverse_mass = np.linalg.inv(root @ root.T + MASS_FLOOR * np.eye(n_dofs))
        W = self.H @ self.inverse_mass @ self.H.T
        self.W = 0.5 * (W + W.T)
        self.q = self.H @ rng.normal(size=n_dofs)
        self.speed = float(np.abs(self.q).max())

    def gain(self, p: FloatArray) -> float:
        """Return the change of energy by the impulses p of an impact with e = 0."""
        return float(0.5 * p @ self.W @ p + self.q @ p)

    def momentum_size(self, p: FloatArray) -> float:
        """Return the length of Hᵀp in the norm of the kinetic energy."""
        momentum = self.H.T @ p
        return float(np.sqrt(momentum @ self.inverse_mass @ momentum))


impacts = st.builds(
    Impact,
    seed=st.integers(0, 2**32 - 1),
    n_pairs=st.integers(1, MAX_PAIRS),
    n_dofs=st.integers(MAX_PAIRS, MAX_PAIRS + 3),
    likeness=st.none(),
)
redundant = st.builds(
    Impact,
    seed=st.integers(0, 2**32 - 1),
    n_pairs=st.integers(2, MAX_PAIRS),
    n_dofs=st.integers(1, MAX_PAIRS - 1),
    likeness=st.sampled_from([None, 0.0]),
)
nearly_redundant = st.builds(
    Impact,
    seed=st.integers(0, 2**32 - 1),
    n_pairs=st.integers(2, MAX_PAIRS),
    n_dofs=st.integers(2, MAX_PAIRS + 3),
    likeness=st.sampled_from([1e-2, 1e-4, 1e-6, 1e-7, 1e-9, 1e-11, 1e-13]),
)
# the same examples everywhere
fixed = settings(derandomize=True, deadline=None, max_examples=150)


def check(impact: Impact, tolerance: float) -> None:
    """Compare the solution with its definition and with brute force."""
    p = solve(impact.W, impact.q)
    residual = impact.W @ p + impact.q
    assert p.min() >= 0.0
    assert residual.min() >= -tolerance * impact.speed
    pushed = p > 0.0
    assert np.abs(residual[pushed]).max(initial=0.0) <= tolerance * impact.speed
    expected = brute_force(impact.W, impact.q)
    scale = impact.momentum_size(expected) + impact.speed / np.sqrt(np.diag(impact.W).max())
    assert impact.momentum_size(p - expected) <= tolerance * scale
    assert abs(impact.gain(p) - impact.gain(expected)) <= tolerance * scale**2


@fixed
@given(impacts)
def test_independent_pairs(impact: Impact) -> None:
    check(impact, ROUND_OFF)


@fixed
@given(redundant)
def test_redundant_pairs_give_the_one_momentum(impact: Impact) -> None:
    check(impact, ROUND_OFF)


@fixed
@given(nearly_redundant)
def test_nearly_redundant_pairs(impact: Impact) -> None:
    check(impact, DEGENERATE)


@fixed
@given(st.one_of(impacts, redundant), st.floats(0.0, 1.0))
def test_impact_of_equal_restitution_never_adds_energy(impact: Impact, e: float) -> None:
    p = solve(impact.W, (1.0 + e) * impact.q)
    change = 0.5 * p @ impact.W @ p + impact.q @ p
    # p·(W p + (1 + e) q) = 0 turns it into -(1 - e)/(1 + e) p·W p / 2
    expected = -0.5 * (1.0 - e) / (1.0 + e) * float(p @ impact.W @ p)
    scale = impact.momentum_size(p) ** 2 + impact.speed**2 / np.diag(impact.W).max()
    assert change == pytest.approx(expected, abs=ROUND_OFF * scale)


@fixed
@given(impacts, st.floats(1e-12, 1e12), st.floats(1e-12, 1e12))
def test_units_do_not_matter(impact: Impact, mass: float, speed: float) -> None:
    p = solve(impact.W, impact.q)
    scaled = solve(impact.W / mass, impact.q * speed) / (mass * speed)
    difference = impact.momentum_size(p - scaled)
    assert difference <= ROUND_OFF * (impact.momentum_size(p) + impact.speed)


@pytest.mark.parametrize("n_pairs", [2, 5, 20])
def test_all_pairs_alike(n_pairs: int) -> None:
    """The same pair many times over: any share of the impulse will do, their sum is one."""
    W, q = np.full((n_pairs, n_pairs), 4.0), np.full(n_pairs, -3.0)
    p = solve(W, q)
    assert p.min() >= 0.0
    assert p.sum() == pytest.approx(0.75, rel=ROUND_OFF)


def test_no_pair() -> None:
    assert solve(np.empty((0, 0)), np.empty(0)).shape == (0,)


@pytest.mark.parametrize(("q", "p"), [(-3.0, 1.5), (0.0, 0.0), (3.0, 0.0)])
def test_one_pair(q: float, p: float) -> None:
    assert solve(np.array([[2.0]]), np.array([q])) == pytest.approx([p], abs=0.0)


def test_pair_that_another_impulse_parts_gets_none() -> None:
    """Two pairs approach; the strong impulse on the first throws the second one open."""
    W = np.array([[1.0, 2.0], [2.0, 5.0]])
    p = solve(W, np.array([-1.0, -1.0]))
    assert p == pytest.approx([1.0, 0.0], abs=ROUND_OFF)


def test_parting_pair_is_pushed_where_another_impulse_closes_it() -> None:
    W = np.array([[2.0, -1.0], [-1.0, 2.0]])
    p = solve(W, np.array([-3.0, 0.5]))
    assert p == pytest.approx([11.0 / 6.0, 2.0 / 3.0], rel=ROUND_OFF)


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["W", "q"])
def test_what_is_not_finite_is_refused(broken: float, place: str) -> None:
    W, q = np.eye(3), -np.ones(3)
    if place == "W":
        W[1, 1] = broken
    else:
        q[1] = broken
    with pytest.raises(ArithmeticError, match="not finite"):
        solve(W, q)


def test_pairs_that_no_impulse_can_part_are_told() -> None:
    W = np.array([[1.0, -1.0], [-1.0, 1.0]])
    with pytest.raises(ArithmeticError, match="no impulses can part these pairs"):
        solve(W, np.array([-1.0, -1.0]))


@pytest.mark.parametrize("n_pairs", [8, 15])
@pytest.mark.parametrize("seed", range(4))
def test_many_pairs_that_enter_and_leave_the_active_set(n_pairs: int, seed: int) -> None:
    """W of long beams has neighbours that are nearly alike; some pairs approach, some part."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0.2, 1.0, n_pairs)
    W = np.minimum.outer(x, x) ** 2 * (3.0 * np.maximum.outer(x, x) - np.minimum.outer(x, x)) / 6.0
    W += 0.02 * np.eye(n_pairs) * W.max()
    q = rng.normal(size=n_pairs)
    p = solve(W, q)
    residual, speed = W @ p + q, np.abs(q).max()
    assert p.min() >= 0.0
    assert 0 < np.count_nonzero(p) < n_pairs
    assert residual.min() >= -ROUND_OFF * speed
    assert np.abs(residual[p > 0.0]).max() <= ROUND_OFF * speed


solve_among = compiled(complementarity.solve_among)


def again(
    W: FloatArray, q: FloatArray, pairs: list[int], memory: WarmStart, origin: int = 0
) -> FloatArray:
    """Return the impulses of some pairs, from the memory of the last call."""
    p, change = np.zeros((2, len(pairs)))
    flat, places, right = W.ravel(), np.array(pairs, np.int64), q[pairs]
    shifted = np.concatenate([np.full(origin, np.nan), flat])
    ending = solve_among(shifted, origin, len(W), places, len(pairs), right, p, change, 0.0, memory)
    assert ending == SOLVED
    assert change == pytest.approx(W[np.ix_(pairs, pairs)] @ p, abs=ROUND_OFF)
    return p


@given(impact=impacts, seed=st.integers(0, 2**32 - 1))
@settings(max_examples=200, derandomize=True, deadline=None)
def test_warm_start_has_the_solution_of_the_cold_one(impact: Impact, seed: int) -> None:
    rng, n = np.random.default_rng(seed), len(impact.q)
    memory = nothing_known(n)
    for _ in range(4):
        pairs = np.flatnonzero(rng.random(n) < 0.8).tolist()
        q = impact.H @ rng.normal(size=impact.H.shape[1])
        p = again(impact.W, q, pairs, memory)
        expected = solve(impact.W[np.ix_(pairs, pairs)], q[pairs])
        scale = np.abs(expected).max(initial=0.0)
        assert p == pytest.approx(expected, abs=ROUND_OFF * scale)
        if len(pairs) > 1:
            idle = np.array(pairs, int)[p == 0.0].tolist()
            assert [k for k in pairs if memory.was_idle[k]] == idle
        fresh = again(impact.W, q, pairs, nothing_known(n), origin=3)
        assert (fresh == p).all(), "the way there must not count"
        assert (again(impact.W, 8.0 * q, pairs, nothing_known(n)) == 8.0 * p).all()


def test_a_factor_is_kept_for_the_same_pairs_alone() -> None:
    W, memory = np.diag([2.0, 4.0, 8.0]), nothing_known(3)
    assert again(W, -np.ones(3), [0, 1], memory).tolist() == pytest.approx([0.5, 0.25])
    assert again(W, -np.ones(3), [0, 2], memory).tolist() == pytest.approx([0.5, 0.125])
    assert memory.members.tolist() == [2, 0, 0, 2, -1]
    assert again(2.0 * W, -np.ones(3), [0, 2], memory).tolist() == pytest.approx([0.5, 0.125])
    compiled(complementarity.forget)(memory, np.array([0, 2]), 2, False)
    assert again(2.0 * W, -np.ones(3), [0, 2], memory).tolist() == pytest.approx([0.25, 0.0625])


def test_a_factor_is_kept_for_the_same_matrix_alone() -> None:
    """Steps of three sizes have a W each, one behind the other."""
    W, memory = np.diag([2.0, 4.0]), nothing_known(2)
    assert again(W, -np.ones(2), [0, 1], memory).tolist() == pytest.approx([0.5, 0.25])
    other = again(2.0 * W, -np.ones(2), [0, 1], memory, origin=4)
    assert other.tolist() == pytest.approx([0.25, 0.125])
    assert again(W, -np.ones(2), [0, 1], memory).tolist() == pytest.approx([0.5, 0.25])


def test_warm_start_takes_pairs_that_depend_on_one_another_one_at_a_time() -> None:
    p = again(np.ones((2, 2)), np.array([-1.0, -1.0]), [0, 1], nothing_known(2))
    assert p.tolist() == [1.0, 0.0]


def test_a_residual_of_round_off_is_no_failure() -> None:
    """Opposite rows with q out of their range: an error, unless it is round-off."""
    W, q = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([-3e-17, 1e-17])
    results = {
        noise: solve_among(
            W.ravel(), 0, 2, np.arange(2), 2, q, np.zeros(2), np.zeros(2), noise, nothing_known(2)
        )
        for noise in (0.0, 1e-15)
    }
    assert results[1e-15] == SOLVED
    assert results[0.0] != SOLVED


@pytest.mark.parametrize("seed", range(40))
def test_redundant_pairs_with_different_restitution(seed: int) -> None:
    """Then q is not in the range of W; some impulse parts all pairs, so there is a solution."""
    rng = np.random.default_rng(seed)
    n_dofs = int(rng.integers(1, 4))
    H = np.abs(rng.normal(size=(n_dofs + int(rng.integers(1, 4)), n_dofs)))
    H[1] = H[0]
    rate = H @ -rng.random(n_dofs)
    W = H @ H.T
    q = (1.0 + rng.random(rate.size)) * rate
    p = solve(W, q)
    after = W @ p + q
    assert p.min() >= 0.0
    assert after.min() > -1e-4 * np.abs(q).max()
    assert np.abs(p * after).max() < 1e-4 * np.abs(q).max() * p.max()


def test_of_equal_pairs_the_one_with_the_larger_restitution_counts() -> None:
    W = np.full((3, 3), 2.0)
    p = solve(W, np.array([-1.2, -1.9, -1.5]))
    np.testing.assert_allclose([p[0], p[1], p[2]], [0.0, 0.95, 0.0], rtol=0.0, atol=1e-8)

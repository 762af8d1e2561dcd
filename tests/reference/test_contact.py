"""Contact decisions of the reference: the identities of an impact, the sets of newton-penalty."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from delam_fem.api import BaseCoupling, Contact, Operators, Structure, assemble, preset
from delam_fem.contact import complementarity
from delam_fem.reference.loop import MassSolver, consistent_impact, decide, lumped_impact

ROUND_OFF = 1e-10  # relative; M of 6 elements has a condition number of 1e4
SEED = 20
N = 6


@pytest.fixture
def model() -> Structure:
    return assemble(preset("paper", {"mesh.elements": N}), needs_dolfinx=False)


@pytest.fixture
def ops(model: Structure) -> Operators:
    return model.operators


@pytest.fixture
def solve_mass(ops: Operators) -> MassSolver:
    return splu(ops.mass.tocsc()).solve


def approaching(ops: Operators, pairs: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return random velocities that close the pairs, and the mask of the pairs."""
    rng = np.random.default_rng(SEED)
    v = 0.1 * rng.standard_normal(ops.n_dofs)
    v[[2 * k for k in pairs]] += 2.0
    hit = np.zeros(N, dtype=bool)
    hit[pairs] = True
    assert np.all((ops.gap_matrix @ v)[hit] < 0.0)
    return v, hit


@pytest.mark.parametrize("e", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("pairs", [[3], [N - 1], [1, 2, 5]])
def test_lumped_impact_reverses_each_rate(ops: Operators, pairs: list[int], e: float) -> None:
    v, hit = approaching(ops, pairs)
    after, impulses = lumped_impact(ops, v, hit, e)
    rate_pre, rate_post = (ops.gap_matrix @ v)[hit], (ops.gap_matrix @ after)[hit]
    np.testing.assert_allclose(rate_post, -e * rate_pre, atol=ROUND_OFF)
    touched = [d for k in pairs for d in (2 * k, 2 * (N + k))]
    np.testing.assert_array_equal(np.delete(after, touched), np.delete(v, touched))
    momentum = (ops.lumped_mass * (after - v))[touched]
    np.testing.assert_allclose(momentum[0::2], -impulses, rtol=ROUND_OFF)  # u of lamina 1
    np.testing.assert_allclose(momentum[1::2], impulses, rtol=ROUND_OFF)  # u of lamina 2


def test_lumped_impact_is_equation_14(model: Structure) -> None:
    ops, k, e = model.operators, 2, 0.1
    v, hit = approaching(ops, [k])
    after, _ = lumped_impact(ops, v, hit, e)
    h = np.diff(model.layout.x)[0]
    m1, m2 = (part.mass_per_length[0] * h for part in model.layout.parts)
    rate = (ops.gap_matrix @ v)[k]
    jump1, jump2 = (after - v)[[2 * k, 2 * (N + k)]]
    assert jump1 == pytest.approx((1 + e) * m2 / (m1 + m2) * rate, rel=ROUND_OFF)
    assert jump2 == pytest.approx(-(1 + e) * m1 / (m1 + m2) * rate, rel=ROUND_OFF)


@pytest.mark.parametrize("e", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("k", [0, 3, N - 1])
def test_consistent_impact_of_one_pair(
    ops: Operators, solve_mass: MassSolver, k: int, e: float
) -> None:
    v, hit = approaching(ops, [k])
    after, impulses = consistent_impact(ops, v, hit, e, solve_mass)
    h = ops.gap_matrix[k].toarray().ravel()
    rate, W = h @ v, h @ solve_mass(h)
    assert h @ after == pytest.approx(-e * rate, rel=ROUND_OFF, abs=ROUND_OFF)
    momentum = ops.mass @ (after - v)
    np.testing.assert_allclose(momentum, h * impulses[0], atol=ROUND_OFF * impulses[0])
    energy = [0.5 * w @ ops.mass @ w for w in (v, after)]
    lost = 0.5 * (1 - e**2) * rate**2 / W
    assert energy[0] - energy[1] == pytest.approx(lost, rel=ROUND_OFF, abs=ROUND_OFF * energy[0])


def test_consistent_impact_of_many_pairs_is_complementary(
    ops: Operators, solve_mass: MassSolver
) -> None:
    e, pairs = 0.1, [0, 1, 3, 4, 5]
    v, hit = approaching(ops, pairs)
    v[2 * 5] -= 1.8  # the tip hardly approaches: the impulse next to it opens it
    rate = (ops.gap_matrix @ v)[hit]
    assert np.all(rate < 0.0)
    after, p = consistent_impact(ops, v, hit, e, solve_mass)
    excess = (ops.gap_matrix @ after)[hit] + e * rate
    scale = np.abs(rate).max()
    assert np.all(p >= 0.0)
    assert (p == 0.0).any()  # otherwise this is a linear system and shows nothing
    assert np.all(excess >= -ROUND_OFF * scale)
    np.testing.assert_allclose(p * excess, 0.0, atol=ROUND_OFF * scale * p.max())
    assert after @ ops.mass @ after < v @ ops.mass @ v


def test_more_pairs_than_an_element_can_tell_apart() -> None:
    """Eight pairs in an element with four dofs: W is singular, but the velocities are unique."""
    case = preset(
        "paper",
        {"mesh.elements": 3, "contact.points_per_element": 8, "contact.impulse": "consistent"},
    )
    ops = assemble(case, needs_dolfinx=False).operators
    v = np.zeros(ops.n_dofs)
    v[6::2] = -1.0 - np.arange(3.0)  # lamina 2 falls on lamina 1
    hit = np.ones(ops.n_pairs, dtype=bool)
    solve_mass = splu(ops.mass.tocsc()).solve
    after, p = consistent_impact(ops, v, hit, 0.5, solve_mass)
    H = ops.gap_matrix
    W = H @ solve_mass(H.T.toarray())
    assert np.linalg.matrix_rank(W) == 6
    excess = H @ after + 0.5 * (H @ v)
    scale = np.abs(H @ v).max()
    assert excess.min() > -ROUND_OFF * scale
    np.testing.assert_allclose(p * excess, 0.0, atol=ROUND_OFF * scale * p.max())
    impulses = complementarity.solve(W, 1.5 * (H @ v))
    np.testing.assert_allclose(H.T @ impulses, H.T @ p, atol=1e-9 * np.abs(H.T @ p).max())


class Pairs:
    """Four independent pairs of unit masses, to see each set of the law by itself."""

    def __init__(self) -> None:
        eye = sp.identity(4, format="csr")
        identity = sp.identity(8, format="csr")
        self.operators = Operators(
            mass=identity,
            damping=0 * identity,
            stiffness=0 * identity,
            lumped_mass=np.ones(8),
            base=BaseCoupling.none(8),
            gap_matrix=sp.hstack([-eye, eye], format="csr"),
            gap0=np.zeros(4),
        )

    def decide(
        self, law: Contact, *, gap: list[float], rate: list[float], permanent: list[bool]
    ) -> tuple[np.ndarray, list[tuple[int, float, float]], np.ndarray]:
        """Return rates after, impacts and the permanent pairs."""
        u, v = (np.concatenate([np.zeros(4), x]) for x in (gap, rate))
        state = (u, v, np.array(permanent))
        after, impacts, P = decide(self.operators, law, state, lambda force: force)
        return self.operators.gap_matrix @ after, impacts, P


@pytest.mark.parametrize("impulse", ["lumped", "consistent"])
def test_sets_of_newton_penalty(impulse: str) -> None:
    # Pair 0 hits slowly, pair 1 hits fast, pair 2 rests, pair 3 opens; e = 0.1, gamma = 0.5 mm/s.
    law = Contact(law="newton-penalty", impulse=impulse, restitution=0.1)
    rate, impacts, P = Pairs().decide(
        law,
        gap=[-1e-6, -1e-6, -1e-6, 1e-6],
        rate=[-4.9e-3, -5.1e-3, -1.0, -1.0],
        permanent=[False, False, True, True],
    )
    np.testing.assert_allclose(rate, [4.9e-4, 5.1e-4, -1.0, -1.0], rtol=1e-12)
    assert [pair for pair, _, _ in impacts] == [0, 1]
    np.testing.assert_allclose([p for _, p, _ in impacts], [1.1 * 4.9e-3 / 2, 1.1 * 5.1e-3 / 2])
    assert [before for _, _, before in impacts] == [-4.9e-3, -5.1e-3]
    assert P.tolist() == [True, False, True, False]


def test_a_pair_that_leaves_is_not_hit_in_the_same_instant() -> None:
    law = Contact(law="newton-penalty", impulse="lumped")
    _, impacts, P = Pairs().decide(law, gap=[1e-9] * 4, rate=[-1.0] * 4, permanent=[True] * 4)
    assert impacts == []
    assert not P.any()


@pytest.mark.parametrize(("gap", "rate"), [(1e-9, -1.0), (-1e-9, 0.0), (-1e-9, 1.0)])
def test_open_or_separating_pairs_are_not_hit(gap: float, rate: float) -> None:
    law = Contact(law="newton", impulse="lumped")
    after, impacts, _ = Pairs().decide(law, gap=[gap] * 4, rate=[rate] * 4, permanent=[False] * 4)
    assert impacts == []
    np.testing.assert_array_equal(after, [rate] * 4)


def test_touching_counts_as_closed() -> None:
    law = Contact(law="newton", impulse="lumped", restitution=0.5)
    rate, impacts, P = Pairs().decide(law, gap=[0.0] * 4, rate=[-1.0] * 4, permanent=[False] * 4)
    np.testing.assert_allclose(rate, 0.5)
    assert len(impacts) == 4
    assert not P.any()  # law newton has no permanent contact


def test_law_none_lets_the_laminae_pass() -> None:
    rate, impacts, _ = Pairs().decide(
        Contact(law="none"), gap=[-1.0] * 4, rate=[-1.0] * 4, permanent=[False] * 4
    )
    assert impacts == []
    np.testing.assert_array_equal(rate, -1.0)

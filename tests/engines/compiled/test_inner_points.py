"""Steps in modes: the same motion as in PETSc, scaling, resumption, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

import delam_fem as df
from delam_fem.api import SCHEMES, Operators, Solution, State, assemble, solve
from delam_fem.engines.compiled import inner_points
from delam_fem.engines.compiled.engine import compiled_engine

F, A = 63.7, 6.2e-7
SAME = 1e-7
"""Of motions in PETSc, whose stiffness matrix carries the round-off of its largest eigenvalue: 1e8
times the lowest, times 2e-16."""


@pytest.fixture(scope="module")
def operators() -> Operators:
    """Return the preset `embedded` with 20 elements."""
    return assemble(df.preset("embedded", {"mesh.elements": 20}), needs_dolfinx=False).operators


def motion(
    o: Operators, amplitude: float, engine: str, periods: int = 3, **more: object
) -> Solution:
    """Compute a few periods from rest."""
    law, base = df.Law("newton"), df.HarmonicMotion(F, amplitude)
    scheme = SCHEMES["moreau-jean"]
    return solve(o, law, scheme, base, steps_per_period=200, periods=periods, engine=engine, **more)


def test_modes_diagonalise_the_matrices(operators: Operators) -> None:
    modal, unknowns = inner_points.in_modes(operators)
    n = operators.n_dofs
    for matrix, diagonal in (
        (operators.mass, np.ones(n)),
        (operators.damping, modal.damping.diagonal()[:n]),
        (operators.stiffness, modal.stiffness.diagonal()[:n]),
    ):
        product = unknowns.shapes.T @ matrix @ unknowns.shapes
        largest = diagonal.max()
        assert np.abs(product[:n, :n] - np.diag(diagonal)).max() < 1e-12 * largest
    state = np.random.default_rng(1).normal(size=(3, n))
    assert unknowns.outward(unknowns.inward(state)) == pytest.approx(state, abs=1e-11)


def test_lowest_modes_are_as_exact_as_the_others(operators: Operators) -> None:
    modal, _ = inner_points.in_modes(operators)
    K, M = operators.stiffness.toarray(), operators.mass.toarray()
    exact = 1.0 / np.linalg.eigvalsh(_symmetric(K, M))[::-1]  # the lowest are the largest here
    squares = modal.stiffness.diagonal()[: operators.n_dofs]
    assert squares[:3] == pytest.approx(exact[:3], rel=1e-10)


def _symmetric(K: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return L⁻¹ M L⁻ᵀ with K = L Lᵀ."""
    inverse = np.linalg.inv(np.linalg.cholesky(K))
    return inverse @ M @ inverse.T


def test_motion_is_that_of_petsc(operators: Operators) -> None:
    by_modes, by_petsc = (motion(operators, A, engine) for engine in ("compiled", "petsc"))
    u, expected = by_modes.displacement, by_petsc.displacement
    assert np.abs(u - expected).max() < SAME * np.abs(expected).max()
    hits, expected_hits = (s.recorder.impulse[:, 1].sum() for s in (by_modes, by_petsc))
    assert hits > 100
    assert hits == pytest.approx(expected_hits, rel=0.01)
    assert by_modes.recorder.energy_residual() < 1e-11


def test_frames_and_state_are_in_dofs(operators: Operators) -> None:
    solutions = [
        motion(operators, A, engine, periods=1, frames_per_period=4)
        for engine in ("compiled", "petsc")
    ]
    frames, expected = (np.array(s.recorder.window[-1].frames) for s in solutions)
    for k in range(2):
        size = np.abs(expected[:, k]).max()
        assert np.abs(frames[:, k] - expected[:, k]).max() < SAME * size
    assert np.array_equal(solutions[0].state.motion[:2], frames[-1])


def test_twice_the_excitation_gives_twice_the_response_to_the_last_bit(
    operators: Operators,
) -> None:
    for engine in ("compiled", "petsc"):
        once, twice = (motion(operators, factor * A, engine) for factor in (1.0, 2.0))
        assert (twice.displacement == 2.0 * once.displacement).all()
        assert (twice.velocity == 2.0 * once.velocity).all()


def test_any_factor_scales_the_response(operators: Operators) -> None:
    once, thrice = (motion(operators, factor * A, "compiled") for factor in (1.0, 3.0))
    size = np.abs(thrice.displacement).max()
    assert np.abs(thrice.displacement - 3.0 * once.displacement).max() < 1e-11 * size


def test_nothing_opens_without_a_cause(operators: Operators) -> None:
    for engine in ("compiled", "petsc"):
        still = motion(operators, 0.0, engine)
        assert not still.displacement.any()
        assert not still.velocity.any()
        assert still.recorder.impulse[:, 1].sum() == 0


def test_run_continues_from_its_own_numbers(operators: Operators) -> None:
    engine = compiled_engine(operators, df.Law("newton"), SCHEMES["moreau-jean"], 1e-4)
    state = motion(operators, A, "compiled").state
    assert state.internal is not None
    engine.restore(state, np.zeros(3))
    assert np.array_equal(engine.state().internal, state.internal)
    round_off = 1e-11 * np.abs(state.motion).max()
    for other in (replace(state, motion=2.0 * state.motion), State(state.motion, state.resting)):
        engine.restore(other, np.zeros(3))
        assert np.abs(engine.state().motion - other.motion).max() < round_off


def test_other_damping_stays_in_bands(operators: Operators) -> None:
    C = operators.damping + sp.diags(np.r_[1.0, np.zeros(operators.n_dofs - 1)])
    other = replace(operators, damping=sp.csr_matrix(C))
    assert inner_points.in_modes(other) is None
    by_bands, by_petsc = (motion(other, A, engine, 1) for engine in ("compiled", "petsc"))
    size = np.abs(by_petsc.displacement).max()
    assert np.abs(by_bands.displacement - by_petsc.displacement).max() < SAME * size

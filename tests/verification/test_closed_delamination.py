"""Contact that lasts in the preset `embedded`: an independent judge, drift, convergence."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from embedded_judge import moreau_jean

import delam_fem as df
from delam_fem.api import Operators, Solution, assemble, base_motion, node_coordinates, solve
from delam_fem.reference import matrices as judge
from delam_fem.simulation.refinement import Refinement

F = 63.7
COARSE = {"mesh.elements": 20, "time.steps_per_period": 200}
LONG = 2000
"""Periods without drift."""
FIRST_IMPACTS = 1e-12
"""m, of displacements up to 5e-6 m over the first periods, which have some 1000 impulses."""


def operators_of(**more: object) -> Operators:
    """Return the operators of the preset with 20 elements."""
    return assemble(df.preset("embedded", COARSE | more), needs_dolfinx=False).operators


def motion(
    o: Operators, frequency: float = F, periods: int = 150, law: str = "newton", **more: object
) -> Solution:
    """Return the last two periods of a motion from rest with a base acceleration of 0.1 m/s²."""
    settings = {"steps_per_period": 200, "engine": "compiled", "window_periods": 2} | more
    e = settings.pop("restitution", 0.0)
    A = 0.1 / (2.0 * np.pi * frequency) ** 2
    return solve(
        o, df.Law(law, restitution=e), df.SCHEMES["moreau-jean"], df.HarmonicMotion(frequency, A),
        periods=periods, **settings,
    )  # fmt: skip


def gap_of(solution: Solution) -> np.ndarray:
    """Return the gap between the reference probes."""
    u = solution.displacement
    return u[:, 1] - u[:, 0]


@pytest.fixture(scope="module")
def operators() -> Operators:
    """Return the operators of the preset with 20 elements."""
    return operators_of()


def test_first_impacts_are_those_of_the_judge() -> None:
    case = df.preset("embedded", COARSE | {"time.periods": 3, "contact.restitution": 0.3})
    x = node_coordinates(case)
    o = judge.assemble(case, x, observed=len(x) // 2)
    times = np.arange(3 * 200 + 1) * case.time_step
    u, count = moreau_jean(o, base_motion(case.excitation).states(times), case.time_step, 0.3)
    expected = u @ o.probes.T.toarray()
    for engine in ("petsc", "compiled"):
        solution = motion(
            assemble(case, needs_dolfinx=False).operators,
            periods=3, engine=engine, restitution=0.3,
            window_periods=3,
        )  # fmt: skip
        assert count > 500
        assert solution.recorder.impulse[:, 1].sum() == pytest.approx(count, rel=0.01)
        assert np.abs(solution.displacement[1:] - expected).max() < FIRST_IMPACTS


def test_no_drift_over_2000_periods(operators: Operators) -> None:
    long = motion(operators, periods=LONG)
    strobe = long.recorder.strobe[:, 0]
    size = np.abs(strobe).max()
    assert np.abs(strobe[-1] - strobe[999]).max() < 1e-9 * size
    gap = gap_of(long)
    assert gap.min() > -0.05 * gap.max()
    assert long.recorder.energy_residual() < 1e-11


@pytest.mark.slow
def test_refined_steps_follow_uniform_fine_steps(operators: Operators) -> None:
    """Contact fills most of the time; open phases are computed in coarse steps."""
    uniform = motion(operators, periods=4, steps_per_period=800)
    refined = motion(operators, periods=4, refinement=Refinement(4))
    size = np.abs(uniform.displacement).max()
    assert np.abs(refined.displacement - uniform.displacement[::4]).max() < 5e-3 * size
    coarse, _, fine, *_ = refined.recorder.effort.sum(axis=0)
    assert fine > 4 * coarse
    assert refined.recorder.energy_residual() < 1e-10


def test_amplitudes_converge_with_elements_and_steps() -> None:
    halves = []
    for elements, steps in ((20, 200), (20, 800), (40, 800), (40, 3200)):
        o = operators_of(**{"mesh.elements": elements})
        u = motion(o, periods=120, steps_per_period=steps).displacement
        halves.append(0.5 * (u.max(axis=0) - u.min(axis=0)))
    by_steps, by_elements, finest = (np.abs(b / a - 1.0).max() for a, b in pairwise(halves))
    assert by_steps < 0.05
    assert by_elements < 0.005
    assert finest < 0.01

"""How a delamination claps that is closed at rest: the preset `embedded`."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from embedded_judge import moreau_jean

import delam_fem as df
from delam_fem.case.excitation import base_motion
from delam_fem.model import closed_form
from delam_fem.model.mesh import node_coordinates
from delam_fem.model.operators import Operators
from delam_fem.model.vibration import kept_closed, lowest
from delam_fem.reference import stack as judge
from delam_fem.simulation.solution import Solution

F = 63.7
COARSE = {"mesh.elements": 20, "time.steps_per_period": 200}
LONG = 2000
"""Periods without drift."""
FIRST_IMPACTS = 1e-12
"""m, of displacements up to 5e-6 m over the first periods, which have some 1000 impulses."""


def operators_of(**more: object) -> Operators:
    """Return the operators of the preset with 20 elements."""
    return closed_form.assemble(df.preset("embedded", COARSE | more)).operators


def motion(
    o: Operators, frequency: float = F, periods: int = 150, law: str = "newton", **more: object
) -> Solution:
    """Return the last two periods of a motion from rest with a base acceleration of 0.1 m/s²."""
    given = {"steps_per_period": 200, "engine": "compiled", "window_periods": 2} | more
    e = given.pop("restitution", 0.0)
    A = 0.1 / (2.0 * np.pi * frequency) ** 2
    return df.solve(
        o, df.Law(law, restitution=e), df.SCHEMES["moreau-jean"], df.HarmonicMotion(frequency, A),
        periods=periods, **given,
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
    u, count = moreau_jean(o, base_motion(case).states(times), case.time_step, 0.3)
    expected = u @ o.probes.T.toarray()
    for engine in ("petsc", "compiled"):
        found = motion(
            closed_form.assemble(case).operators, periods=3, engine=engine, restitution=0.3,
            window_periods=3,
        )  # fmt: skip
        assert count > 500
        assert found.recorder.impulse[:, 1].sum() == pytest.approx(count, rel=0.01)
        assert np.abs(found.displacement[1:] - expected).max() < FIRST_IMPACTS


def test_no_drift_over_2000_periods(operators: Operators) -> None:
    long = motion(operators, periods=LONG)
    strobe = long.recorder.strobe[:, 0]
    size = np.abs(strobe).max()
    assert np.abs(strobe[-1] - strobe[999]).max() < 1e-9 * size
    gap = gap_of(long)
    assert gap.min() > -0.05 * gap.max()
    assert long.recorder.energy_residual() < 1e-11


def test_refined_steps_follow_uniform_fine_steps(operators: Operators) -> None:
    """Contact fills most of the time; open phases are computed in coarse steps."""
    uniform = motion(operators, periods=4, steps_per_period=800)
    refined = motion(operators, periods=4, refine=4)
    size = np.abs(uniform.displacement).max()
    assert np.abs(refined.displacement - uniform.displacement[::4]).max() < 5e-3 * size
    coarse, _, fine, *_ = refined.recorder.effort.sum(axis=0)
    assert fine > 4 * coarse
    assert refined.recorder.energy_residual() < 1e-10


def test_penetration_falls_with_the_time_step(operators: Operators) -> None:
    shares = []
    for steps in (250, 1000, 4000):
        gap = gap_of(motion(operators, periods=100, steps_per_period=steps))
        shares.append(-gap.min() / gap.max())
    assert shares[0] < 0.05
    assert 0.0 < shares[2] < 0.6 * shares[1] < 0.3 * shares[0]


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


@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_peak_lies_between_the_free_and_the_closed_frequency(restitution: float) -> None:
    made = closed_form.assemble(df.preset("embedded", COARSE))
    o, S = made.operators, kept_closed(made.layout, made.operators.n_dofs)
    free = lowest(o.stiffness, o.mass, 1)[0][0]
    closed = lowest((S.T @ o.stiffness @ S).tocsr(), (S.T @ o.mass @ S).tocsr(), 1)[0][0]
    assert (free, closed) == pytest.approx((63.177, 64.521), abs=2e-3)  # reference/split_beam.py
    frequencies = np.linspace(free - 0.3, closed + 0.3, 21)
    responses = [
        np.ptp(motion(o, f, restitution=restitution).displacement[:, 0]) for f in frequencies
    ]
    k = int(np.argmax(responses))
    near = slice(k - 1, k + 2)
    bend, slope, _ = np.polyfit(frequencies[near] - frequencies[k], responses[near], 2)
    peak = frequencies[k] - 0.5 * slope / bend
    assert peak == pytest.approx(2.0 * free * closed / (free + closed), abs=0.15)
    assert free + 0.3 < peak < closed - 0.3


def test_superharmonic_at_half_the_frequency(operators: Operators) -> None:
    second = []
    for frequency in (31.0, 31.9, 32.8):
        u = motion(operators, frequency, steps_per_period=400).displacement[1:, 0]
        second.append(2.0 * np.abs(np.fft.rfft(u))[4] / len(u))  # two periods: entry 4
        assert 2.0 * np.abs(np.fft.rfft(u))[2] / len(u) > 3e-6
    assert second[1] > 3.0 * max(second[0], second[2])
    free = motion(operators, 31.9, steps_per_period=400, law="none").displacement[1:, 0]
    assert 2.0 * np.abs(np.fft.rfft(free))[4] / len(free) < 1e-3 * second[1]


def test_small_motions_of_an_open_delamination_are_free() -> None:
    o = operators_of(**{"delamination.0.opening": 1e-3})
    with_contact, without = (motion(o, periods=20, law=law) for law in ("newton", "none"))
    assert with_contact.recorder.impulse[:, 1].sum() == 0
    assert np.array_equal(with_contact.displacement, without.displacement)


def test_equal_laminae_never_open() -> None:
    thickness = {f"lamina.{name}.thickness": 0.001 for name in ("lower", "upper")}
    o = operators_of(**thickness)
    for engine in ("compiled", "petsc"):
        found = motion(o, periods=20, engine=engine)
        size = np.abs(found.displacement).max()
        assert size > 1e-6
        assert np.abs(gap_of(found)).max() < 1e-9 * size

"""Coarse multipliers of stepped maps against closed forms, and the paper's branches by night."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from calibration.oscillator import (
    forcing,
    impact_phase,
    multipliers as closed_form,
    oscillator,
    state_at_zero,
)
from problems import Law, Prescribed
from scipy.optimize import brentq

import delam_fem as df
from delam_fem.api import Span
from delam_fem.studies.orbits import continuation
from delam_fem.studies.orbits.continuation import events_of
from delam_fem.studies.orbits.maps import PeriodicProblem, StrobeMap, slow_modes
from delam_fem.studies.orbits.newton import Ensemble, Guess, Perturbations, solved
from delam_fem.studies.orbits.search import multipliers

COARSE = 0.03
"""Relative to the modulus: error of the coarse multipliers."""
KICKS = Perturbations(copies=48, size=0.01, kick=0.03)
STEPS = 8000
"""Steps per period: on coarser grids small kicks are held by the grid."""
DOUBLING = 0.004
"""In ω: error of the doubling that stepping finds."""


def stepped(s: float, e: float) -> StrobeMap:
    """Return the map of x'' + x = cos ωt, x <= s, as the program steps it; its parameter is ω."""
    operators = oscillator(s)

    def problem(omega: float) -> PeriodicProblem:
        span = Span(2.0 * np.pi / omega / STEPS, STEPS, 1, limit=1e6)
        law = Law("newton", restitution=e)
        return PeriodicProblem(
            operators, law.contact, law.scheme, Prescribed(forcing(omega, 0.0)), span
        )

    return StrobeMap(problem, slow_modes(operators))


@pytest.mark.slow
@pytest.mark.parametrize(("omega", "s", "e"), [(2.0, 0.0, 0.5), (2.2, 0.0, 0.5), (2.6, 0.0, 0.8)])
def test_coarse_multipliers_of_the_impact_oscillator(omega: float, s: float, e: float) -> None:
    """Differences of 1e-6 see the time grid instead: they give -1 and ½ for the first row."""
    start = state_at_zero(omega, s, e, impact_phase(omega, s, e))
    ensemble = Ensemble(stepped(s, e), 1, KICKS)
    scale = float(np.linalg.norm(start))
    J = ensemble.derivatives(start, omega, scale).mean(axis=0)
    solution = solved(ensemble, Guess(start, omega, scale), J)
    assert solution.is_solved
    assert solution.state == pytest.approx(start, abs=0.01 * scale)
    mu = multipliers(ensemble.decays(solution.state, omega, scale))
    exact = closed_form(omega, s, e)
    # a double multiplier splits by the root of an error; its sum and product do not
    assert mu.values.sum() == pytest.approx(exact.sum(), abs=2.0 * COARSE * abs(exact[0]))
    assert np.prod(mu.values) == pytest.approx(e**2, rel=2.0 * COARSE)
    if omega != 2.0:
        assert np.sort_complex(mu.values) == pytest.approx(
            np.sort_complex(exact), abs=COARSE * abs(exact[0])
        )
    assert mu.stability == "stable"


@pytest.mark.nightly  # the short form of the calibration of branches counts such doublings
def test_the_doubling_of_the_impact_oscillator() -> None:
    """-1 is a multiplier where 1 + trace + e² = 0 in closed form; the branch of two goes on."""
    e = 0.8
    exact = brentq(lambda w: 1.0 + closed_form(w, 0.0, e).sum().real + e**2, 2.55, 2.75)
    path = continuation.Path(2.6, 2.7, step=0.1, longest=0.15)
    ensemble = Ensemble(stepped(0.0, e), 1, KICKS)
    start = state_at_zero(2.6, 0.0, e, impact_phase(2.6, 0.0, e))
    points = [continuation.first_point(ensemble, start, path)]
    points, ending = continuation.followed(
        ensemble, points, path, keep=lambda point, count: None, is_stopped=lambda: False
    )
    assert ending == "range"
    (event,) = [ev for ev in events_of(points, path.span) if ev.kind == "period doubling"]
    assert event.parameter == pytest.approx(exact, abs=DOUBLING)
    assert event.low - DOUBLING < exact < event.high + DOUBLING


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [0, 1])
def test_the_branches_of_the_paper(tmp_path: Path, seed: int) -> None:
    """A sweep in steps of 0.01 Hz doubles at 3.53, jumps at 3.565 and comes back at 3.465 Hz."""
    data = df.follow(
        df.preset("paper"), "excitation.frequency", 3.3, 4.0, tmp_path,
        perturbations=Perturbations(seed=seed),
    )  # fmt: skip
    events = [
        (str(kind), int(branch), float(at))
        for kind, branch, at in zip(
            data.event_kind.values, data.event_branch.values, data.event_parameter.values,
            strict=True,
        )
    ]  # fmt: skip
    first = next(at for kind, branch, at in events if kind == "period doubling" and branch == 0)
    assert first == pytest.approx(3.54, abs=0.02)
    near = (data.event_branch == 0) & (data.event_kind == "period doubling")
    low, high = float(data.event_low[near][0]), float(data.event_high[near][0])
    assert low < 3.5275 < high, "an independent calculation has 3.525 to 3.530 Hz"
    if seed == 0:  # with other seeds the doubled branch may be lost where it begins
        folds = [at for kind, branch, at in events if kind == "fold" and branch == 1]
        assert folds[0] == pytest.approx(3.563, abs=0.01)
        assert min(folds) == pytest.approx(3.468, abs=0.02)
    one = data.sel(point=data.branch == 0)
    below = one.stability[one.parameter < 3.5]
    assert (below != "unstable").all() and (below == "stable").mean() > 0.8
    beyond = (one.parameter > 3.57) & (one.parameter < 3.64)
    assert (one.stability[beyond] == "unstable").all()

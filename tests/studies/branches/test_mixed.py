"""Events on made-up branches, and steps along them, in full; no two points are alike."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import golden
import numpy as np
import pytest
from toys import DelayedLogistic, Henon, Steep

from delam_fem.studies.branches.continuation import (
    Path,
    crossings,
    doubled_point,
    events_of,
    first_point,
    folds,
    followed,
    grazings,
    lengths,
    next_point,
    tangent,
    turns,
    why_lost,
)
from delam_fem.studies.orbits.newton import Ensemble, Perturbations

Check = Callable[..., None]
N, SAMPLES = 15, 24
SPAN = 1.7


def branch(parameters: np.ndarray, **more: Any) -> Any:
    """Return points whose slow coordinates and test functions are made up."""
    rng, points = np.random.default_rng(4), []
    for k, parameter in enumerate(parameters.tolist()):
        slow = np.array([np.sin(0.2 * k), 0.3 * k])
        spread = 0.03 * rng.standard_normal(2 * SAMPLES) * (1.0 + 0.1 * k)
        own: dict[str, Any] = {
            "doubling": 0.4 - 0.07 * k + 0.002 * k**2 + np.append(0.0, spread),
            "torus": 0.3 * np.cos(0.45 * k) + np.append(0.0, spread[::-1]),
            "angle": 1.0 + 0.03 * k + (0.9 if k == 4 else 0.0),
        }
        if k in (2, 9):
            own["torus"] = np.full(1 + 2 * SAMPLES, np.nan)
        point = SimpleNamespace(
            parameter=parameter, parameter_error=0.002 + 1e-4 * k, alternation=0.1 * (k % 4),
            gaps=np.array([0.4 - 0.09 * k, np.sin(0.9 * k)]), slow=slow,
            multipliers=SimpleNamespace(**own),
        )  # fmt: skip
        point.x = lambda span, p=point: np.append(p.slow / 1.3, p.parameter / span)
        for name, values in more.items():
            setattr(point, name, values[k])
        points.append(point)
    return points


PARAMETERS = {
    "rising": np.linspace(0.3, 1.4, N) ** 1.2,
    "turning": 0.3 + np.concatenate([np.linspace(0.0, 0.5, 8), 0.48 - 0.05 * np.arange(7) ** 1.1]),
    "wavy": 0.5 + 0.1 * np.sin(np.arange(N) * 0.8),
}


@pytest.mark.parametrize("name", PARAMETERS)
def test_events_are_the_stored_ones(name: str, stored: Check) -> None:
    points = branch(PARAMETERS[name])
    found: dict[str, Any] = {
        "every": events_of(points, SPAN), "few": events_of(points[:2], SPAN),
        "three": events_of(points[:3], SPAN), "lengths": lengths(points, SPAN),
        "folds": folds(points, SPAN), "coarse": folds(points, 40.0), "turns": turns(points, SPAN),
        "grazings": grazings(points),
    }  # fmt: skip
    late = branch(PARAMETERS[name], alternation=[0.0] * 5 + [0.81] * 3 + [0.1] * 7)
    rows = np.array([point.multipliers.doubling for point in late])
    found["late"] = crossings("period doubling", rows, late, SPAN)
    found["other"] = crossings("Neimark-Sacker", rows, late, SPAN)
    up = branch(PARAMETERS[name])
    for k, point in enumerate(up):  # two doublings between neighbours
        point.multipliers.doubling = abs(0.31 - 0.1 * k) + 0.02 + np.zeros(3)
    found["between"] = turns(up, SPAN)
    stored(golden.of_object(found))


def of_point(point: Any) -> dict[str, Any]:
    """Return a point without what is round-off."""
    names = ("state", "parameter", "slow", "derivatives", "by_parameter", "tangent", "step",
             "strobes", "low", "high", "gaps", "doubled", "alternation")  # fmt: skip
    told = {name: getattr(point, name) for name in names}
    told |= {"scale": point.scale, "x": point.x(0.7), "stability": point.stability}
    error = point.parameter_error
    return told | {"error": error if error > 1e-8 else 0.0, "values": point.multipliers.values}


ROUGH = Perturbations(copies=10, size=0.01, kick=0.05)
BRANCHES: dict[str, tuple[Any, np.ndarray, Path]] = {
    "rough": (Henon(1e-3), Henon().fixed(0.2), Path(0.2, 0.9, step=0.07, longest=0.08)),
    "down": (Henon(), Henon().fixed(0.1), Path(0.1, -0.3, step=0.05, shortest=0.02)),
    "logistic": (DelayedLogistic(), DelayedLogistic().fixed(1.6), Path(1.6, 1.9, most=4)),
    "steep": (Steep(), np.array([1.0, 0.0]), Path(0.6, 1.2, step=0.2, longest=0.5)),
}


@pytest.mark.parametrize("name", BRANCHES)
def test_steps_along_branches_are_the_stored_ones(name: str, stored: Check) -> None:
    map_, start, path = BRANCHES[name]
    ensemble, kept = Ensemble(map_, 1, ROUGH), list[int]()
    points = [first_point(ensemble, start, path)]
    found, ending = followed(
        ensemble, points, path, keep=lambda point, count: kept.append(count),
        is_stopped=lambda: len(kept) == 5,
    )  # fmt: skip
    told: dict[str, Any] = {
        "points": [of_point(point) for point in found], "ending": ending, "kept": kept,
        "span": path.span, "has": [path.has(x) for x in (path.start, path.stop, 5.0, -5.0)],
        "lost": why_lost(ensemble, found[-1], path),
    }  # fmt: skip
    stored(golden.of_object(told))


def test_a_doubled_branch_is_the_stored_one(stored: Check) -> None:
    path, fine = Path(0.3, 0.6, step=0.05), Perturbations(copies=6, size=1e-5, kick=1e-3)
    one = Ensemble(Henon(), 1, fine)
    near = first_point(one, Henon().fixed(0.42), Path(0.42, 0.6))
    twice = Ensemble(Henon(), 2, fine)
    first = doubled_point(twice, near, 0.3675, path)
    after = next_point(twice, first, path)
    told = {"first": of_point(first), "after": None if after is None else of_point(after)}
    stored(golden.of_object(told))


def test_the_tangent_is_the_stored_one(stored: Check) -> None:
    J = np.array([[0.3, -0.2], [0.7, 0.5]])
    slope, heading = np.array([0.4, -1.3]), np.array([0.2, -0.3, 1.1])
    stored(golden.of_object([tangent(J, slope, heading), tangent(J, slope, -2.0 * heading)]))

"""`orbit follow`: branch points.

Maps whose events are known in closed form; jumps are 1e-4 … 1e-3 of the state.

Branches of maps whose events are known in closed form. Oscillators with one stop, x'' + x = cos ωt,
x ≤ s, restitution e, over ω: s and e are drawn for each truth, and their exact motions are
followed, without steps. Hénon's maps x' = 1 − λx² + y, y' = bx, in coordinates that are drawn, too,
with jumps of 1e-4 … 1e-3 of the state. Delayed logistic maps x' = λx(1 − (1 − c)y − cx), y' = x,
with such coordinates and jumps. Where no event of its kind is found, or several, the truth counts
as undecided.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from calibration.oscillator import (
    fold_stop,
    images,
    impact_phase,
    multipliers,
    state_at_zero,
)
from calibration.row import OWN, Row
from scipy.optimize import brentq

from delam_fem.api import FloatArray
from delam_fem.studies.orbits import continuation
from delam_fem.studies.orbits.continuation import BranchEvent, events_of, first_point, followed
from delam_fem.studies.orbits.maps import MapInfo, SlowCoordinates, Trajectory
from delam_fem.studies.orbits.newton import Ensemble

DOUBLING, FOLD, TORUS = "period doubling", "fold", "Neimark-Sacker"
NAMES = {TORUS: "Neimark–Sacker point"}
TRUTHS = 200
NOMINAL = 0.95
ROUGHNESS = (1e-4, 1e-3)


class Plane:
    """A map of the plane; see `delam_fem.studies.orbits.maps.PeriodMap`.

    Args:
        image: states of shape (k, 2) and λ to the states one period later.
    """

    slow = SlowCoordinates(np.eye(2), np.eye(2))
    info = MapInfo("map of the plane", {"x": 1, "v": 1})

    def __init__(self, image: Callable[[FloatArray, float], FloatArray]) -> None:
        """Keep the map."""
        self._image = image

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        """Return the states one period later."""
        with np.errstate(over="ignore", invalid="ignore"):  # a motion may leave all numbers
            return self._image(states, parameter)

    def trajectory(self, state: FloatArray, parameter: float, periods: int) -> Trajectory:
        """Return the states at the ends of periods; nothing touches."""
        states = [state]
        for _ in range(periods):
            states.append(self.after(states[-1][None], parameter)[0])
        visited = np.array(states[1:])
        return Trajectory(visited, visited, visited.min(axis=0), visited.max(axis=0), np.inf)


def jumps(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return numbers ±1 that change from one state to the next, shape (k, 2)."""
    return np.asarray(np.sign(np.sin([1e9 * x + 3e8 * y, 7e8 * x - 1e9 * y])).T)


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return how often the interval of an event contains it."""
    families = (
        ("oscillators", of_oscillator, (DOUBLING, FOLD)),
        ("Hénon's maps with jumps", of_henon, (DOUBLING, FOLD)),
        ("delayed logistic maps with jumps", of_logistic, (TORUS,)),
    )
    result = []
    for number, (name, drawn, kinds) in enumerate(families):
        for kind in kinds:
            rng = np.random.default_rng([29, number, kind == FOLD])
            truths = TRUTHS if is_long else 1
            ends = [judged(kind, *drawn(kind, rng)) for _ in range(truths)]
            known = [(event, exact) for event, exact in ends if event is not None]
            inside = sum(event.low <= exact <= event.high for event, exact in known)
            width = [(event.high - event.low) / exact for event, exact in known]
            note = f"median width {100.0 * abs(float(np.median(width))):.2g} %" if width else ""
            what = f"interval of a {NAMES.get(kind, kind)}, {name}"
            result.append(
                Row(what, OWN, NOMINAL, inside, truths, truths - len(known), at_least=True,
                    note=note)
            )  # fmt: skip
    return result


def judged(
    kind: str, map_: Plane, state: FloatArray, path: continuation.Path, exact: float
) -> tuple[BranchEvent | None, float]:
    """Return the only event of a kind on a branch, else None, and where the truth is."""
    ensemble = Ensemble(map_)
    try:
        first = first_point(ensemble, state, path)
    except (ArithmeticError, np.linalg.LinAlgError):
        return None, exact
    points, _ = followed(
        ensemble, [first], path, keep=lambda point, count: None, is_stopped=lambda: False
    )
    events = [event for event in events_of(points, path.span) if event.kind == kind]
    return events[0] if len(events) == 1 else None, exact


def of_oscillator(
    kind: str, rng: np.random.Generator
) -> tuple[Plane, FloatArray, continuation.Path, float]:
    """Return an oscillator, a state of it, the range of ω, and where the event is."""
    e, (before, behind) = rng.uniform(0.4, 0.85), rng.uniform(0.04, 0.12, 2)
    if kind == FOLD:
        exact = rng.uniform(1.3, 1.7)
        s = fold_stop(exact, e)
    else:
        s = rng.uniform(-0.1, 0.1)
        grid = np.arange(2.1, 4.0, 0.02)
        beyond = next(w for w in grid if doubles(w, s, e) < 0.0)
        exact = brentq(doubles, beyond - 0.02, beyond, (s, e))
    path = continuation.Path(exact - before, exact + behind)
    state = state_at_zero(path.start, s, e, impact_phase(path.start, s, e))
    return Plane(lambda states, omega: images(states, omega, s, e)), state, path, exact


def doubles(omega: float, s: float, e: float) -> float:
    """Return the product of 1 + μ, which is 0 at a doubling."""
    return float(1.0 + multipliers(omega, s, e).sum().real + e**2)


def of_henon(
    kind: str, rng: np.random.Generator
) -> tuple[Plane, FloatArray, continuation.Path, float]:
    """Return a rough map in coordinates of its own, a state, the range of λ, and the truth."""
    b = rng.uniform(-0.3, 0.5)
    rough = float(np.exp(rng.uniform(*np.log(ROUGHNESS))))
    exact = (-0.25 if kind == FOLD else 0.75) * (1.0 - b) ** 2
    start = exact + (1.0 if kind == FOLD else -1.0) * rng.uniform(0.1, 0.3) * (1.0 - b) ** 2
    path = continuation.Path(start, exact - (start - exact) * rng.uniform(0.3, 1.2))
    return *henon(b, rough, start, rng), path, exact


def henon(
    b: float, rough: float, start: float, rng: np.random.Generator
) -> tuple[Plane, FloatArray]:
    """Return Hénon's map with jumps in coordinates of its own, and its fixed point at λ = start."""

    def image(x: FloatArray, y: FloatArray, a: float) -> list[FloatArray]:
        return [1.0 - a * x**2 + y, b * x]

    x = fixed(b, start)
    return turned(image, rough, np.array([x, b * x]), rng)


def of_logistic(
    kind: str, rng: np.random.Generator
) -> tuple[Plane, FloatArray, continuation.Path, float]:
    """Return a rough map, a state, the range of λ, and where multipliers are e^{±iθ}."""
    c = rng.uniform(-0.4, 0.4)
    rough = float(np.exp(rng.uniform(*np.log(ROUGHNESS))))
    exact = 1.0 + 1.0 / (1.0 - c)
    before, behind = rng.uniform(0.1, 0.3, 2)

    def image(x: FloatArray, y: FloatArray, a: float) -> list[FloatArray]:
        return [a * x * (1.0 - (1.0 - c) * y - c * x), x]

    path = continuation.Path(exact - before, exact + behind)
    return *turned(image, rough, np.full(2, 1.0 - 1.0 / path.start), rng), path, exact


def turned(
    smooth: Callable[[FloatArray, FloatArray, float], list[FloatArray]], rough: float,
    state: FloatArray, rng: np.random.Generator,
) -> tuple[Plane, FloatArray]:  # fmt: skip
    """Return a smooth map with jumps in coordinates that are drawn, and a state in them."""
    there = np.linalg.qr(rng.standard_normal((2, 2)))[0] * np.exp(rng.uniform(-0.5, 0.5, (2, 1)))
    back = np.linalg.inv(there)

    def image(states: FloatArray, a: float) -> FloatArray:
        x, y = (states @ back.T).T
        return (np.stack(smooth(x, y, a), axis=-1) + rough * jumps(x, y)) @ there.T

    return Plane(image), there @ state


def fixed(b: float, a: float) -> float:
    """Return x of the fixed point of Hénon's map from which the first doubling comes."""
    return (b - 1.0 + math.sqrt((1.0 - b) ** 2 + 4.0 * a)) / (2.0 * a)

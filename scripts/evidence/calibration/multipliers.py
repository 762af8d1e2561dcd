"""`orbit find`: multipliers.

Oscillators with one stop and Hénon's maps whose multipliers are known in closed form. Other rigs
are oscillators as the program steps them.

Orbits whose multipliers are known in closed form, up to 1.05. As modelled: oscillators with one
stop, x'' + x = cos ωt, x ≤ s, restitution e, whose exact motions are followed without steps, and
Hénon's maps in coordinates that are drawn, with jumps of 1e-4 … 1e-3 of the state. The other rigs
are oscillators as the program steps them, with impacts at the ends of steps; their truth is that
without steps. Where the mean map does not close, a truth is undecided. Before the intervals had
what larger kicks alone say, and one thousandth more on either side, they held the largest modulus
of 23 of 40 other oscillators without steps (off by 0.001 at most), and of 6 of 10 with 1000 steps.
Errors were those of all kicks together, and two of them held both multipliers of 159 of 194 others
with 1000 steps; they are the largest of those of all kicks, the smaller and the larger half since.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from calibration.branches import ROUGHNESS, Plane, fixed, henon
from calibration.oscillator import (
    forcing,
    images,
    impact_phase,
    multipliers,
    oscillator,
    state_at_zero,
)
from calibration.row import OWN, Row

from delam_fem.api import SCHEMES, FloatArray, Law, Span
from delam_fem.studies.orbits.maps import PeriodicProblem, PeriodMap, StrobeMap, slow_modes
from delam_fem.studies.orbits.newton import USUAL
from delam_fem.studies.orbits.search import coarse_orbit, matched

OSCILLATOR, HENON = "oscillators", "Hénon's maps with jumps"
RIGS = {
    OSCILLATOR: (OWN, 0),
    HENON: (OWN, 0),
    f"{OSCILLATOR}, 1000 steps": ("1000 steps per period", 1000),
    f"{OSCILLATOR}, 4000 steps": ("4000 steps per period", 4000),
}
"""Rig, and steps per period; 0: none."""
TRUTHS, LARGEST, BARS = 200, 1.05, 2.0
WHOLE, TWO_ERRORS = 0.95, 0.9545


class Harmonic:
    """The motion cos ωt of the spring's other end."""

    def __init__(self, omega: float) -> None:
        """Keep the motion."""
        self.states = forcing(omega, 0.0)


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return how often intervals of multipliers contain them."""
    result = []
    for number, (name, (rig, steps)) in enumerate(RIGS.items()):
        if steps and not is_long:
            continue
        rng = np.random.default_rng([42, number])
        truths = TRUTHS if is_long else 10
        inside = np.array([judged(name == HENON, steps, rng) for _ in range(truths)])
        known = inside[np.isfinite(inside).all(axis=1)]
        for k, (what, share) in enumerate(
            {
                "largest modulus, 95 % interval": WHOLE,
                "each multiplier ± 2 errors": TWO_ERRORS,
            }.items()
        ):
            note = f"{name}; median {('width', 'error')[k]} {np.median(known[:, 2 + k]):.2g}"
            result.append(
                Row(what, rig, share, int(known[:, k].sum()), truths, truths - len(known),
                    at_least=True, note=note)
            )  # fmt: skip
    return result


def judged(is_henon: bool, steps: int, rng: np.random.Generator) -> tuple[float, ...]:
    """Return whether both promises hold for an orbit, width and error; NaN: undecided."""
    map_, state, parameter, exact = of_henon(rng) if is_henon else of_oscillator(steps, rng)
    coarse = coarse_orbit(map_, parameter, state, 1, USUAL)
    if not coarse.solved.is_solved:
        return (math.nan,) * 4
    estimate = coarse.multipliers
    low, high = estimate.largest
    away = np.abs(estimate.values - matched(exact, estimate.values)) / estimate.errors
    is_inside = low <= np.abs(exact).max() <= high
    return float(is_inside), float(away.max() <= BARS), high - low, float(estimate.errors.max())


def of_oscillator(
    steps: int, rng: np.random.Generator
) -> tuple[PeriodMap, FloatArray, float, FloatArray]:
    """Return the map of an oscillator, a state of its orbit, ω, and the exact multipliers."""
    while True:
        e = rng.uniform(0.4, 0.85)
        s = rng.uniform(-0.1, 0.1)
        omega = rng.uniform(2.05, 3.3)
        try:
            phase = impact_phase(omega, s, e)
        except ArithmeticError:
            continue
        exact = multipliers(omega, s, e)
        if np.abs(exact).max() <= LARGEST:
            break
    exactly = Plane(lambda states, omega: images(states, omega, s, e))
    map_ = stepped(s, e, steps) if steps else exactly
    return map_, state_at_zero(omega, s, e, phase), omega, exact


def stepped(s: float, e: float, steps: int) -> StrobeMap:
    """Return the map of x'' + x = cos ωt, x <= s, as the program steps it; its parameter is ω."""
    operators = oscillator(s)

    def problem(omega: float) -> PeriodicProblem:
        span = Span(2.0 * math.pi / omega / steps, steps, 1, limit=1e6)
        law = Law("newton", restitution=e)
        return PeriodicProblem(operators, law, SCHEMES["newmark"], Harmonic(omega), span)

    return StrobeMap(problem, slow_modes(operators))


def of_henon(rng: np.random.Generator) -> tuple[PeriodMap, FloatArray, float, FloatArray]:
    """Return a rough map, its fixed point, λ, and the exact multipliers without jumps."""
    b = rng.uniform(-0.3, 0.5)
    rough = float(np.exp(rng.uniform(*np.log(ROUGHNESS))))
    a = rng.uniform(-0.15, 0.78) * (1.0 - b) ** 2
    exact = np.linalg.eigvals(np.array([[-2.0 * a * fixed(b, a), 1.0], [b, 0.0]]))
    return *henon(b, rough, a, rng), a, exact

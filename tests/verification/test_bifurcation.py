"""Lyapunov exponents against exact ones; the fold and the period doubling of the paper's case."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from calibration.oscillator import forcing, multipliers, oscillator
from problems import Law
from scipy.optimize import brentq

from delam_fem import run_sweep
from delam_fem.api import Span, session
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.point import BLOCKS, STUDENT, Exponent, largest_exponent, mean_growth

LINEAR = 2e-3
"""Relative: the distance pulses within a cycle of the mode, which is no multiple of the period;
over 200 periods that averages out to 1e-3."""
IMPACTING = 0.05
"""Relative: the exponent is that of the linearised map, and the distance is 3 % of the motion."""
IN_CHAOS = 0.06
"""In 1/s: results with 500 to 8000 steps scatter by 0.03 about the exact exponent."""
CHAOS = (2.85, 0.0, 0.8)
LOST = 300
"""Impacts before the difference has its direction."""
SETTLE, FOLLOW = 60, 100
"""Periods until the orbit is steady, and over which the distance is followed."""
ONE_CONTACT = 0.1 + 1e-9
"""Contacts per period: one in the window of 10 periods, where a strike falls on its edge; when that
is so depends on round-off."""


@pytest.mark.slow
def test_a_damped_linear_motion_contracts_as_its_slowest_mode(tmp_path: Path) -> None:
    """The largest exponent is -Dω of the thin lamina's first mode, where no contact adds any."""
    data = {
        "name": "linear",
        "base": "paper",
        "engine": "petsc",
        "set": {
            "contact.law": "none",
            "mesh.elements": 4,
            "time.steps_per_period": 200,
            "time.periods": 20,
        },
        "axis": [{"key": "excitation.frequency", "values": [2.0, 3.25]}],
        "record": {"lyapunov": 400},
    }
    sweep = sweep_of(data)
    exponents = run_sweep(sweep, tmp_path, "serial").lyapunov_exponent.to_numpy()
    thin = sweep.base.lamina[1]
    exact = -thin.damping_ratio * float(thin.angular_frequencies(1)[0])
    assert exponents == pytest.approx(exact, rel=LINEAR)


def exponent(
    omega: float,
    s: float,
    e: float,
    *,
    n_steps: int,
    perturbation: float,
    follow: int = FOLLOW,
    engine: Literal["petsc", "compiled"] = "petsc",
) -> Exponent:
    """Return the largest exponent of the impact oscillator as the program finds it."""
    T = 2.0 * math.pi / omega
    operators, dt = oscillator(s), T / n_steps
    span = Span(dt, n_steps, SETTLE, limit=1e6)
    table = forcing(omega, 0.0)(dt * np.arange(n_steps + 1))
    law = Law("newton", restitution=e)
    with session(
        operators, law.contact, law.scheme, lambda period: table, span, engine=engine
    ) as opened:
        assert opened.run() == "completed"
        return largest_exponent(
            opened,
            operators,
            direction=np.ones(1),
            period=T,
            periods=follow,
            perturbation=perturbation,
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("omega", "s", "e", "engine"),
    [(1.8, 0.2, 0.5, "compiled"), (2.2, 0.0, 0.5, "petsc"), (2.5, 0.0, 0.5, "compiled")],
)
def test_an_impact_oscillator_contracts_by_its_restitution(
    omega: float, s: float, e: float, engine: Literal["petsc", "compiled"]
) -> None:
    """Complex multipliers have the modulus e, as their product is e² without damping."""
    mu = multipliers(omega, s, e)
    assert np.abs(mu) == pytest.approx(e)
    exact = math.log(e) * omega / (2.0 * math.pi)
    estimate = exponent(omega, s, e, n_steps=2000, perturbation=0.03, engine=engine)
    assert estimate.value == pytest.approx(exact, rel=IMPACTING)


def above(
    t: np.ndarray, a: float, b: float, G: float, omega: float, phase: float, s: float
) -> np.ndarray:
    """Return by how much the free flight passes the stop at a time after the last impact."""
    return a * np.cos(t) + b * np.sin(t) + G * np.cos(omega * t + phase) - s


def chaotic(omega: float, s: float, e: float, n_impacts: int) -> float:
    """Return the largest exponent from exact flights and the exact derivative of each impact.

    A difference grows by J R (see `multipliers`) from one impact to the next; nothing is stepped.
    """
    G = 1.0 / (1.0 - omega**2)
    grid = np.linspace(0.0, 8.0 * math.pi / omega, 1601)
    phase, v, difference = 0.3, -1.0, np.ones(2)
    growth = duration = 0.0
    for number in range(n_impacts + LOST):
        a, b = s - G * math.cos(phase), v + omega * G * math.sin(phase)

        flight = (a, b, G, omega, phase, s)
        first = int(np.argmax(above(grid[1:], *flight) > 0.0))
        t = brentq(above, max(grid[first], 1e-9), grid[first + 1], flight, xtol=1e-13)
        C, S = math.cos(t), math.sin(t)
        V = -a * S + b * C - omega * G * math.sin(omega * t + phase)
        phase = (phase + omega * t) % (2.0 * math.pi)
        J = np.array([[-e, 0.0], [(1.0 + e) * (math.cos(phase) - s) / V, -e]])
        difference = J @ np.array([[C, S], [-S, C]]) @ difference
        size, v = float(np.linalg.norm(difference)), -e * V
        difference /= size
        if number >= LOST:
            growth, duration = growth + math.log(size), duration + t
    return growth / duration


def test_the_exponent_of_chaos_is_roughly_found() -> None:
    """Chaos of the impact oscillator with e = 0.8; a stable motion has at most 0 there."""
    exact = chaotic(*CHAOS, 2000)
    assert exact == pytest.approx(0.214, abs=0.02)
    estimate = exponent(*CHAOS, n_steps=500, perturbation=0.03, follow=1000, engine="compiled")
    assert estimate.value == pytest.approx(exact, abs=IN_CHAOS)
    assert 0.0 < estimate.error < IN_CHAOS


def test_the_error_of_an_exponent_is_that_of_a_mean() -> None:
    rates = np.random.default_rng(3).normal(0.2, 1.0, 4000)
    estimate = mean_growth(rates)
    assert estimate.value == pytest.approx(rates.mean())
    assert estimate.error == pytest.approx(1.0 / math.sqrt(4000), rel=0.5)
    assert math.isnan(mean_growth(rates[:5]).error)


def test_the_error_holds_what_twice_the_distance_changes() -> None:
    near, far = (
        exponent(2.2, 0.0, 0.5, n_steps=500, perturbation=d, engine="compiled")
        for d in (0.03, 0.06)
    )
    assert near.error > abs(far.value - near.value) > 1e-6


def test_a_distance_below_a_step_of_motion_misses_the_shift_of_the_impact() -> None:
    """Both motions then hit in the same step: the reason for the default perturbation."""
    exact = math.log(0.5) * 1.8 / (2.0 * math.pi)
    value = exponent(1.8, 0.2, 0.5, n_steps=400, perturbation=1e-6).value
    assert abs(value) < 0.1 * abs(exact)


def test_the_fold_and_the_period_doubling(tmp_path: Path) -> None:
    """Between 3.47 and 3.56 Hz two motions live, one contact a period or one in two."""
    data = {
        "name": "fold",
        "base": "paper",
        "order": "both",
        "set": {"time.periods": 200, "output.fields_per_period": 0},
        "axis": [
            {"key": "excitation.frequency", "values": [3.40, 3.45, 3.50, 3.52, 3.60, 3.65, 3.70]}
        ],
    }
    dataset = run_sweep(sweep_of(data), tmp_path, "serial")
    assert dataset.attrs["n_completed"] == 14
    contacts = dataset.tip_contacts_per_period
    up, down = (contacts.sel(direction=name).values for name in ("up", "down"))
    assert up == pytest.approx([1.0] * 4 + [0.5] * 3, abs=ONE_CONTACT)
    assert down == pytest.approx([1.0] * 2 + [0.5] * 5, abs=ONE_CONTACT)
    doubled = dataset.sel(frequency=3.65)
    assert doubled.periodicity.values.tolist() == [2.0, 2.0]
    assert (doubled.strobe_scatter < 0.02).all()
    thick = dataset.tip_amplitude.sel(lamina="thick", frequency=3.52).to_numpy()
    assert thick[0] > 1.5 * thick[1]


def test_errors_from_ten_blocks_are_widened_as_students_table_says() -> None:
    """t of 95.45 % with 9 degrees of freedom is 2.32 (GUM, table G.2)."""
    assert (BLOCKS, 2.0 * STUDENT) == (10, pytest.approx(2.32, abs=5e-3))

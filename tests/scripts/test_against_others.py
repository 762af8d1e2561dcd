"""The numbers of others: the cases are within the bars, and the page shows what comes out."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from project import script
from scipy.linalg import expm
from scipy.optimize import brentq, root

others = script("against_others")


RODS = [test for test in others.TESTS if test.file == "rod.toml"]
LONG = [
    pytest.param(test, marks=pytest.mark.nightly if test in RODS[:-1] else ())
    for test in others.TESTS
]


@pytest.mark.parametrize("test", LONG, ids=lambda test: test.file)
def test_numbers_are_within_the_bar_and_on_the_page(test: others.Test) -> None:
    text = others.PAGE.read_text("utf-8")
    assert text.startswith(others.HEAD)
    with others.TABLE.open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    for row in test.rows():
        assert abs(row.difference) < test.bar, row
        (ours,) = (
            float(line["ours"])
            for line in table
            if (line["what"], line["theirs"]) == (row.what, f"{row.theirs:.7g}")
            and line["case"] == test.title
        )
        rounded = 1e-5 if test.bar == others.BAR else 0.05 * test.bar  # impacts amplify round-off
        assert ours == pytest.approx(row.ours, rel=rounded)
        assert f"| `{row.file}` |" in text or not row.file
    assert test.reason in text
    assert test.bar == others.BAR or test.reason


@pytest.mark.nightly
def test_folds_of_the_rod_are_within_the_bar() -> None:
    rows = list(others.folds())
    assert len(rows) == 3
    assert all(abs(row.difference) < others.BAR for row in rows), rows


def by_waves(until: float, dt: float) -> float:
    """Return the displacement of the free bar's end of SDNL111, by its waves, in small steps."""
    speed, stiffness, damper = np.sqrt(2e11 / 7800.0), 5e9, 2e4
    impedance, turn, n = 7800.0 * speed * 4e-4, round(2.0 / speed / dt), round(until / dt)
    force, held_end, free = np.zeros(n), 0.0, 0.0
    for i in range(n):
        echoes = force[i - turn :: -turn] if i >= turn else np.zeros(0)
        of_free = -1.0 + 2.0 * echoes.sum() / impedance
        of_held = 2.0 * (echoes[::2].sum() - echoes[1::2].sum()) / impedance
        pushed = -stiffness * (free - held_end) - damper * (of_free - of_held)
        force[i] = max(pushed / (1.0 + 2.0 * damper / impedance), 0.0) if free <= held_end else 0.0
        free += dt * (of_free + force[i] / impedance)
        held_end += dt * (of_held - force[i] / impedance)
    return float(free)


def test_the_mode_between_stops_is_that_of_its_arcs() -> None:
    """Two linear motions, with the stop and without, each by the exponential of its matrix."""

    def matrix(stop: float) -> np.ndarray:
        rates = np.zeros((5, 5))  # of both displacements, both velocities, and 1
        rates[0, 2] = rates[1, 3] = 1.0
        rates[2] = [-2.0 - stop, 1.0, 0.0, 0.0, stop]
        rates[3, :2] = 1.0, -1.0
        return rates

    def quarter(start: np.ndarray) -> np.ndarray:
        state = np.array([*start, 0.0, 0.0, 1.0])
        leaves = brentq(lambda t: (expm(t * matrix(30.0)) @ state)[0] - 1.0, 1e-6, 0.5)
        flight = expm((0.25 / others.NONLINEAR_MODE - leaves) * matrix(0.0))
        return flight @ expm(leaves * matrix(30.0)) @ state

    start = root(lambda start: quarter(start)[:2], [1.0045, -0.617], tol=1e-13).x
    [test] = [test for test in others.TESTS if "arcs" in test.title]
    energy, first = test.theirs.values()
    assert start[0] == pytest.approx(first, abs=1e-8)
    assert 0.5 * np.sum(quarter(start)[2:4] ** 2) == pytest.approx(energy, abs=1e-6)


def test_smoothed_stops_act_before_they_are_touched_and_as_springs_far_behind() -> None:
    for x in (-0.5, 0.2, 0.5):
        assert others.smoothed_stop(x) == pytest.approx(0.005 * x / (1.0 - x**2), rel=1e-3)
    for x in (-2.0, 3.0):
        sharp = 30.0 * (x - np.sign(x))
        assert others.smoothed_stop(x) == pytest.approx(sharp, rel=1e-3)
    first = float(others.smoothed_mode()["first"])
    assert first == pytest.approx(0.8139, abs=1e-4)


def test_the_numbers_of_the_bars_are_those_of_their_waves() -> None:
    [test] = [test for test in others.TESTS if "waves" in test.title]
    for time, exact in zip(others.INSTANTS[:2], list(test.theirs.values())[:2], strict=True):
        assert 1e4 * by_waves(time, 4e-8) == pytest.approx(exact, abs=4e-3)

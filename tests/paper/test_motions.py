"""The four reference motions, and what counts as a strike."""

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from reference_motions import HEADINGS, row

from delam_fem.api import Result, preset
from delam_fem.paper.runs import (
    FREQUENCIES,
    MOTIONS,
    RESONANT,
    Effort,
    Laboratory,
    is_as_described,
    motion_case,
    strikes,
)
from delam_fem.results.diagnostics import contact_begins
from delam_fem.studies.executors import Serial

PLAN = Effort()
ONE_CONTACT = 0.1 + 1e-9
"""Contacts per period: one in the window of 10 periods, where a strike falls on its edge; when that
is so depends on round-off."""


@pytest.fixture(scope="module")
def lab() -> Iterator[Laboratory]:
    yield Laboratory(PLAN, Serial())


@pytest.mark.parametrize("method", ["3.1", "3.2"])
def test_four_motions_are_of_the_kind_that_the_paper_describes(
    lab: Laboratory, method: Any
) -> None:
    low, thin_beats, thick_beats, doubled = lab.motions(
        [motion_case(f, PLAN, method) for f in FREQUENCIES]
    )
    assert [r.summary["periodicity"] for r in (low, thin_beats, thick_beats, doubled)] == [
        1, 1, 1, 2,
    ]  # fmt: skip
    assert low.summary["tip_contacts_per_period"] == 0.0
    assert low.summary["minimum_tip_gap"] == pytest.approx(2.4e-3, abs=0.2e-3)
    thick, thin = strikes(thin_beats).mean
    assert abs(thin) > 2.0 * abs(thick)
    thick, thin = strikes(thick_beats).mean
    assert thick > 0.0 > thin
    contacts = [one.summary["tip_contacts_per_period"] for one in (thick_beats, doubled)]
    assert contacts == pytest.approx([1.0, 0.5], abs=ONE_CONTACT)
    assert all(is_as_described(r) for r in (low, thin_beats, thick_beats, doubled))
    assert strikes(thick_beats).approach == max(
        strikes(r).approach for r in (low, thin_beats, thick_beats, doubled)
    )


def test_a_motion_is_not_taken_for_that_of_another_frequency(lab: Laboratory) -> None:
    (result,) = lab.motions([motion_case(2.0, PLAN)])
    assert not is_as_described(result)


def test_each_motion_is_shown_by_its_own_result_alone(lab: Laboratory) -> None:
    results = lab.motions([motion_case(f, PLAN) for f in FREQUENCIES])
    matches = [[motion.is_shown_by(result) for result in results] for motion in MOTIONS]
    assert matches == np.eye(4, dtype=bool).tolist()


@pytest.mark.parametrize(
    ("index", "name", "value"),
    [
        (0, "minimum_tip_gap", 0.0),
        (0, "tip_contacts_per_period", 0.1),
        (1, "periodicity", 2),
        (1, "tip_contacts_per_period", 0.9),
        (2, "tip_contacts_per_period", 1.1),
        (2, "periodicity", None),
        (3, "tip_contacts_per_period", 1.0),
        (3, "periodicity", 1),
    ],
)
def test_a_changed_number_is_another_motion(
    lab: Laboratory, index: int, name: str, value: float | None
) -> None:
    (result,) = lab.motions([motion_case(FREQUENCIES[index], PLAN)])
    assert is_as_described(result)
    changed = replace(result, summary={**result.summary, name: value})
    assert not is_as_described(changed)


def test_a_motion_without_a_contact_law_has_no_contacts() -> None:
    summary = {"periodicity": 1, "tip_contacts_per_period": None, "minimum_tip_gap": -0.01}
    result: Any = SimpleNamespace(summary=summary)
    assert not any(motion.has_its_contacts(result) for motion in (MOTIONS[0], MOTIONS[3]))


def struck(closures: dict[int, float], n_periods: int = 3) -> Result:
    """Return a result whose tips approach with a speed [m/s] at some steps and close there.

    The thick tip alone moves. The tips touch without impacts, as with the law `penalty`.
    """
    N = 100
    case = preset("paper", {"time.steps_per_period": N, "contact.law": "penalty"})
    q, v = np.zeros((2, n_periods * N)), np.zeros((2, n_periods * N))
    for step, speed in closures.items():
        q[0, step] = 0.012
        v[0, step - 2] = speed
    history = xr.Dataset(
        {
            "tip_displacement": (("lamina", "time"), q),
            "tip_velocity": (("lamina", "time"), v),
            "strobe_displacement": (("lamina", "period"), q[:, N - 1 :: N]),
            "tip_node": ((), 1),
            "gap0": ("node", np.array([0.0, 0.012])),
            "event_node": ("event", np.zeros(0, dtype=int)),
            "event_time": ("event", np.zeros(0)),
        },
        {"time": case.time_step * np.arange(1, n_periods * N + 1)},
    )
    result: Any = SimpleNamespace(case=case, history=history)
    return result  # type: ignore[no-any-return]


def test_strikes_need_no_impact_only_a_closed_gap() -> None:
    measured_strikes = strikes(struck({50: 0.4, 150: 0.6}))
    assert measured_strikes.step.tolist() == [50, 150]
    assert measured_strikes.mean == pytest.approx((0.5, 0.0))
    assert measured_strikes.approach == pytest.approx(0.5)


def test_a_period_has_one_strike_that_of_the_fastest_approach() -> None:
    assert strikes(struck({20: 0.1, 60: 0.4, 90: 0.2, 150: 0.3})).step.tolist() == [60, 150]


def test_closures_a_twentieth_of_a_period_apart_are_two_contacts() -> None:
    assert strikes(struck({50: 0.1, 55: 0.4})).step.tolist() == [55]
    assert strikes(struck({50: 0.1, 54: 0.4})).step.tolist() == [50]


def test_a_contact_that_may_have_begun_before_the_window_is_no_strike() -> None:
    measured_strikes = strikes(struck({4: 0.4}))
    assert measured_strikes.step.size == 0
    assert np.isnan(measured_strikes.mean).all() and measured_strikes.approach == 0.0


def test_contacts_begin_after_a_pause() -> None:
    closed = np.zeros(200, dtype=bool)
    closed[[3, 4, 60, 62, 150]] = True
    assert contact_begins(closed, 1000).tolist() == [60, 150]  # pauses of 50 steps; 3 is too early
    assert contact_begins(closed, 100).tolist() == [60, 150]
    assert contact_begins(np.zeros(10, dtype=bool), 100).tolist() == []


def test_row_of_a_motion_shows_its_numbers(lab: Laboratory) -> None:
    (result,) = lab.motions([motion_case(RESONANT, PLAN)])
    cells = dict(zip(HEADINGS, row(MOTIONS[2], result), strict=True))
    assert cells["f [Hz]"] == "3.25" and cells["as paper"] == "yes"
    thick, thin = strikes(result).mean
    assert cells["strike: thick / thin [m/s]"] == f"{thick:+.2f} / {thin:+.2f}"
    assert row(MOTIONS[3], result)[-1] == "NO"

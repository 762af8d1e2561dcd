"""The sentence on a run says what its motion is known to be."""

from typing import Any

import numpy as np
import pytest
import xarray as xr
from stack import three_laminae
from synthetic import PERIODS, STEPS, SWEEP, WINDOW, small_case, synthetic_history

from delam_fem import Case
from delam_fem.api import diagnostics
from delam_fem.results.pages.report import sentence


def struck(lower: float, upper: float) -> xr.Dataset:
    """Return a history whose tips have these velocities before each strike [m/s]."""
    history = synthetic_history(small_case())
    history["tip_velocity"][:] = np.array([[lower], [upper]])
    return history


def verdict(history: xr.Dataset, case: Case | None = None, **changed: Any) -> str:
    case = case or small_case()
    return sentence(history, diagnostics.summary(history, case) | changed, case)


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        (0.6, -0.45, "at 1.05 m/s, thick beats thin."),
        (-0.07, -0.43, "at 0.36 m/s, thin beats thick."),
        (0.5, -0.5, "at 1 m/s, thick and thin equally fast."),
        (0.5, -0.476, "at 0.976 m/s, thick and thin equally fast."),
        (0.476, -0.5, "at 0.976 m/s, thick and thin equally fast."),
        (0.5, -0.474, "at 0.974 m/s, thick beats thin."),
        (0.474, -0.5, "at 0.974 m/s, thin beats thick."),
    ],
)
def test_the_faster_lamina_beats(lower: float, upper: float, words: str) -> None:
    text = verdict(struck(lower, upper))
    assert text == f"One-periodic, one tip strike a period {words}"


def test_velocities_are_read_before_the_strike() -> None:
    history = struck(0.6, -0.45)
    for k in range(WINDOW):  # after the strikes at half a period, which are at the end of a step
        after = slice(k * STEPS + STEPS // 2 - 1, (k + 1) * STEPS - STEPS // 4)
        history["tip_velocity"][:, after] = np.array([[-0.3], [0.1]])
    assert "at 1.05 m/s, thick beats thin" in verdict(history)


def test_a_settled_motion_is_called_so_where_it_was_judged() -> None:
    history = struck(0.6, -0.45)
    assert verdict(history, settled="settled").startswith("Settled, one-periodic, one tip")
    assert verdict(history, settled="not settled", periodicity=None).startswith(
        "Not settled, one tip strike"
    )
    numbers = {"transient": 0.0726, "periods_needed": 168}
    text = verdict(history, settled="not settled", periodicity=None, settling=numbers)
    assert text.startswith(
        "Not settled (7.3 % of the amplitude is transient; at most 168 further periods are needed)"
    )
    assert verdict(history, settled="irregular", periodicity=None).startswith(
        "Irregular, no repetition within eight periods, one tip"
    )


@pytest.mark.parametrize(
    ("rate", "words"),
    [
        (2.0, "two tip strikes a period"),
        (0.5, "one tip strike in two periods"),
        (2 / 3, "two tip strikes in three periods"),
        (1.234, "1.23 tip strikes a period"),
        (8.0, "eight tip strikes a period"),
        (9.0, "9 tip strikes a period"),
        (1 / 8, "one tip strike in eight periods"),
        (1 / 9, "0.111 tip strikes a period"),
        (0.9, "0.9 tip strikes a period"),
    ],
)
def test_rates_of_contacts_in_words(rate: float, words: str) -> None:
    assert f", {words} at " in verdict(struck(0.6, -0.45), tip_contacts_per_period=rate)


def test_tips_that_never_meet_and_laminae_without_contact() -> None:
    history = struck(0.6, -0.45)
    apart = verdict(history, tip_contacts_per_period=0.0, minimum_tip_gap=0.0024)
    assert apart == "One-periodic, the tips never meet (the smallest gap is 2.4 mm)."
    through = verdict(history, tip_contacts_per_period=None)
    assert through == "One-periodic, without contact: the laminae pass through one another."


def test_a_period_without_a_margin_is_undecided() -> None:
    history = struck(0.6, -0.45)
    scatters = [0.109, 0.081, 0.1]
    text = verdict(history, periodicity=2, periodicity_class="undecided", strobe_scatters=scatters)
    assert text.startswith("Of undecided period (cycles differ by 11 % of the amplitude), one tip")


def test_runs_that_did_not_end_say_so() -> None:
    text = verdict(struck(0.6, -0.45), small_case(time__periods=80), outcome="interrupted")
    assert text.startswith(f"Interrupted in period {PERIODS} of 80, one-periodic")


def test_a_sweep_is_not_judged_for_periods() -> None:
    case = small_case(**SWEEP)
    assert verdict(struck(0.6, -0.45), case).startswith("Not judged for periods")


def test_the_strongest_of_two_interfaces_is_told() -> None:
    recorded = three_laminae()
    history, case = recorded.history(), recorded.case
    assert "two probe strikes a period" in verdict(history, case)
    history["tip_velocity"][:] = np.array([[0.1], [0.0], [-0.9]])
    assert verdict(history, case).endswith("at 0.9 m/s, top beats thin.")


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({}, "Not settled, one tip"),
        (None, "Not settled, one tip"),
        ({"periods_needed": 3}, "Not settled (at most 3 further periods are needed), one tip"),
        ({"transient": 0.0, "periods_needed": 0},
         "Not settled (0 % of the amplitude is transient), one tip"),
    ],
)  # fmt: skip
def test_what_is_not_known_of_a_transient_is_not_told(
    numbers: dict[str, float] | None, words: str
) -> None:
    assert verdict(struck(0.6, -0.45), settled="not settled", settling=numbers).startswith(words)


@pytest.mark.parametrize(
    ("gap", "words"),
    [
        (1e-6, ", the tips never meet (the smallest gap is 0.001 mm)."),
        (0.0, ", the tips never meet."),
        (-1e-3, ", the tips never meet."),
        (float("nan"), "."),
        (float("inf"), "."),
        (None, "."),
    ],
)
def test_gaps_of_tips_that_never_meet(gap: float | None, words: str) -> None:
    text = verdict(struck(0.6, -0.45), tip_contacts_per_period=0.0, minimum_tip_gap=gap)
    assert text == f"One-periodic{words}"


@pytest.mark.parametrize(("number", "word"), [(7, "Seven"), (8, "Eight"), (9, "9"), (12, "12")])
def test_numbers_of_periods_in_words(number: int, word: str) -> None:
    assert verdict(struck(0.6, -0.45), periodicity=number).startswith(f"{word}-periodic, one tip")


def test_strikes_of_a_sweep_are_counted_over_the_window() -> None:
    case = small_case(**SWEEP)
    history = struck(0.6, -0.45)
    share = case.steps_per_period / history.sizes["time"]
    for number, words in ((1.0, "1 tip strike at"), (17.2, "17 tip strikes at")):
        text = verdict(history, case, tip_contacts_per_period=number * share)
        assert f", {words} 1.05 m/s" in text


def test_strikes_that_no_step_shows_have_no_speed() -> None:
    text = verdict(struck(-0.5, 0.5))  # the laminae part
    assert text == "One-periodic, one tip strike a period."


def struck_stop(kind: str, rate: float, velocity: float | None) -> dict[str, Any]:
    return {"name": f"{kind} 1", "kind": kind, "strikes_per_period": rate, "impulse": 0.1,
            "approach_velocity": velocity, "peak_force": None, "closed_share": 0.2}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "rate", "velocity", "words"),
    [
        ("stop", 2.0, 0.114, ", two strikes a period on stop 1 at 0.114 m/s"),
        ("impactor", 0.5, 0.3, ", one strike in two periods on impactor 1 at 0.3 m/s"),
        ("stop", 0.0, None, ", stop 1 is never struck"),
    ],
)
def test_strikes_on_stops_and_impactors_are_told(
    kind: str, rate: float, velocity: float | None, words: str
) -> None:
    text = verdict(struck(0.6, -0.45), contacts=[struck_stop(kind, rate, velocity)])
    assert words in text and "one tip strike a period" in text

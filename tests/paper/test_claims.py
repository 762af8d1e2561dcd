"""Criteria in words, and numbers of signals whose answer is known."""

import math
from typing import Any

import numpy as np
import pytest

from delam_fem.paper import responses
from delam_fem.paper.claims import (
    Criterion,
    Numbers,
    between,
    described,
    ends,
    has_period,
    judged,
    rough_part,
    yes,
)
from delam_fem.paper.runs import peak_frequencies
from delam_fem.results.diagnostics import PERIODIC_MARGIN, PERIODIC_SCATTER


@pytest.mark.parametrize(
    ("criterion", "words"),
    [
        (Criterion("n", 0.12345, "<", 0.5), "n 0.123, needs < 0.5"),
        (Criterion("n", 0.12345, "<", 0.5, "%"), "n 12.3, needs < 50 %"),
        (Criterion("n", 3.65432, ">", 3.5, "Hz"), "n 3.654, needs > 3.5 Hz"),
        (Criterion("n", 1234.56, ">", 999.94, "s"), "n 1235, needs > 1e+03 s"),
        (Criterion("n", -1234.56, ">", 1000.0), "n -1235, needs > 1000"),
        (Criterion("n", math.nan, "=", 2.0, "m"), "n none, needs = 2 m"),
        (Criterion("n", 0.2, "<", 0.5, "%", (0.1, 0.3)), "n 20 (10 … 30), needs < 50 %"),
        (yes("as told", True), "as told: yes"),
        (yes("as told", False), "as told: no"),
    ],
)
def test_criteria_in_words(criterion: Criterion, words: str) -> None:
    assert str(criterion) == words


def test_answers_are_criteria_too() -> None:
    assert (yes("a", True).verdict, yes("a", False).verdict) == ("holds", "does not hold")
    assert judged() == ("holds", "")


@pytest.mark.parametrize(
    ("value", "verdicts"),
    [
        (1.0, ("does not hold", "holds")),
        (1.5, ("holds", "holds")),
        (2.0, ("holds", "does not hold")),
        (math.nan, ("does not hold", "does not hold")),
    ],
)
def test_between_two_bounds_are_neither(value: float, verdicts: tuple[str, str]) -> None:
    criteria = between("n", value, (1.0, 2.0), "m", None)
    assert tuple(criterion.verdict for criterion in criteria) == verdicts
    assert [(criterion.relation, criterion.bound, criterion.unit) for criterion in criteria] == [
        (">", 1.0, "m"),
        ("<", 2, "m"),
    ]
    unsure = between("n", 1.5, (1.0, 2.0), within=(0.9, 1.6))
    assert [criterion.verdict for criterion in unsure] == ["undecided", "holds"]


def test_a_period_is_one_that_none_of_its_divisors_is() -> None:
    scatters = [0.5, 0.4, 0.3, 0.01, 0.2, 0.1]
    motion = Numbers({"strobe_scatters": scatters, "is_as_described": True})
    four = has_period(motion, 4)
    assert [criterion.name for criterion in four] == [
        "scatter 1 period apart", "scatter 2 periods apart", "scatter 4 periods apart"
    ]  # fmt: skip
    assert [criterion.value for criterion in four] == [0.5, 0.4, 0.01]
    assert [criterion.relation for criterion in four] == [">", ">", "<"]
    assert {(criterion.bound, criterion.unit) for criterion in four} == {(PERIODIC_SCATTER, "%")}
    assert [criterion.within for criterion in four] == [
        (criterion.value / PERIODIC_MARGIN, criterion.value * PERIODIC_MARGIN) for criterion in four
    ]
    assert [criterion.verdict for criterion in four] == ["holds"] * 3
    assert [criterion.value for criterion in has_period(motion, 6)] == [0.5, 0.4, 0.3, 0.1]
    assert [criterion.value for criterion in has_period(motion, 1)] == [0.5]
    assert math.isnan(has_period(motion, 7)[1].value)
    for none in (None, []):
        [criterion] = has_period(Numbers({"strobe_scatters": none}), 1)
        assert math.isnan(criterion.value) and criterion.verdict == "does not hold"
    first, *others = described(motion, 4)
    assert str(first) == "as described: yes" and len(others) == 3


def test_ends_of_values() -> None:
    assert ends(["1", "2", "3"]) == "1 … 3" and ends(iter("ab")) == "a … b"


@pytest.mark.parametrize("above", [2, 3, 20])
def test_roughness_begins_above_a_harmonic(above: int) -> None:
    t = np.arange(600) / 200.0  # three periods
    parts = [np.cos(2.0 * np.pi * k * t) for k in (0.0, above, above + 1.0 / 3.0, above + 1.0)]
    values = np.array([sum(parts), 2.0 * parts[2]])
    wanted = np.array([parts[2] + parts[3], 2.0 * parts[2]])
    np.testing.assert_allclose(rough_part(values, 3, above), wanted, atol=1e-12)


def test_peaks_that_occur_twice_are_at_the_mean() -> None:
    f = np.array([1.0, 2.0, 3.0, 4.0])
    amplitude = np.array([[np.nan, 5.0, 4.0, 5.0 - 1e-10], [7.0, 5.0, np.nan, 6.999999]])
    assert peak_frequencies(f, amplitude) == [3.0, 1.0]


# ---- stepped sines


def test_jumps_at_the_ends_are_told_as_well() -> None:
    f = np.array([1.0, 2.0, 4.0, 8.0])
    assert responses.jumps(f, np.array([1.0, 9.0, 9.0, 9.0])) == [1.5]
    assert responses.jumps(f, np.array([9.0, 9.0, 9.0, 1.0])) == [6.0]
    assert responses.jumps(f, np.array([1.0, 9.0, 9.0, 1.0])) == [1.5, 6.0]
    assert responses.jumps(f, np.full(4, 3.0)) == responses.jumps(f[:1], np.ones(1)) == []


def test_a_jump_is_large_and_stands_out() -> None:
    f = np.arange(5.0)
    share, times = responses.DIFFERS, responses.JUMP
    for factor, expected in ((0.99, []), (1.01, [1.5])):
        top = 1.0 / (1.0 - factor * share)
        assert responses.jumps(f, np.array([1.0, 1.0, top, top, top])) == expected
        assert responses.jumps(f, np.array([top, top, 1.0, 1.0, 1.0])) == expected
    for beside, expected in ((1.01, []), (1.0, []), (0.99, [1.5])):
        for sign in (1.0, -1.0):
            change = 9.0 * beside / times
            amplitudes = np.array([1.0, 1.0, 10.0, 10.0 + sign * change, 10.0])
            assert responses.jumps(f, amplitudes) == expected


def stepped(up: list[float], down: list[float], **more: Any) -> Numbers:
    f = 3.5 + 0.05 * np.arange(len(up))
    return Numbers(
        {"frequency_hz": f, "periodicity_up": np.array(up), "periodicity_down": np.array(down)}
        | more
    )


def test_windows_of_period_two_reach_to_the_ends() -> None:
    n = stepped([2, 2, 1, 2, 2, 2], [2, 2, 2, 2, 2, 1])
    for frequency, wanted in (
        (3.0, (3.5, 3.55)), (3.56, (3.5, 3.55)), (3.61, None), (3.66, (3.65, 3.7)), (3.8, None),
    ):  # fmt: skip
        window = responses.doubled_window(n, frequency)
        assert window == (None if wanted is None else pytest.approx(wanted))
    all_doubled = stepped([2, 2, 2], [2, 2, 2])
    assert responses.doubled_window(all_doubled, 3.55) == pytest.approx((3.5, 3.6))
    assert responses._window(n) == "the motion has period 2 from 3.65 to 3.70 Hz, up and down"
    assert responses._window(stepped([1, 1], [2, 2])) == "no period 2 beside 3.65 Hz"
    near = responses._inside(n)
    assert near.value == pytest.approx(0.0, abs=1e-9) and near.relation == ">"
    assert near.within == pytest.approx((0.0, 0.05), abs=1e-9)
    assert responses._inside(stepped([1, 1], [2, 2])).verdict == "does not hold"

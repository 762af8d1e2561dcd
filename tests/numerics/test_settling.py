"""The verdict on motions whose transient is known: linear modes exactly, noise by its size."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from delam_fem.numerics.settling import FEWEST, TOLERANCE, _beating, _decaying, judge

DECAY = 0.02
EXACT = 1e-9
"""The model fits a creeping transient exactly: round-off is all that remains."""
MARGIN = 3.0
"""A settled linear motion may have so many times the tolerance left: the strobes of the judged half
show a beat of several modes only in part."""


def steady(n: int, P: int = 1) -> np.ndarray:
    """Return strobes of a motion of P periods, shape (2, 1, n)."""
    cycle = np.random.default_rng(3).uniform(-1.0, 1.0, (2, 1, P))
    return np.tile(cycle, n // P + 1)[..., :n]


def fading(n: int, left: float, decay: float = DECAY, turn: float = 0.0) -> np.ndarray:
    """Return a transient that turns by an angle per period and ends with a radius `left`."""
    k = np.arange(n)
    radius = left * np.exp(decay * (n - 1 - k))
    return np.stack([radius * np.cos(turn * k + 0.3), radius * np.sin(turn * k + 0.3)])[:, None]


def scattered(n: int, size: float) -> np.ndarray:
    """Return cycles with an rms of `size` in the phase plane."""
    return size / math.sqrt(2.0) * np.random.default_rng(7).normal(size=(2, 1, n))


@pytest.mark.parametrize("left", [0.002, 0.02, 0.5])
@pytest.mark.parametrize("is_linear", [True, False])
def test_a_creeping_transient_is_measured(left: float, is_linear: bool) -> None:
    verdict = judge(steady(160) + fading(160, left), 1, DECAY, is_linear=is_linear)
    assert verdict.transient == pytest.approx(left, rel=1e-6, abs=EXACT)
    assert verdict.observed_decay == pytest.approx(DECAY, rel=1e-6)
    assert verdict.word == ("settled" if left < TOLERANCE else "not settled")
    expected = 0 if left < TOLERANCE else math.ceil(math.log(left / TOLERANCE) / DECAY)
    assert verdict.periods_needed == expected
    assert verdict.periods_judged == 80


@pytest.mark.parametrize("left", [0.003, 0.03])
def test_a_beat_of_a_linear_motion_is_measured(left: float) -> None:
    strobes = steady(200) + fading(200, left, turn=2.0)
    verdict = judge(strobes, 3, DECAY, is_linear=True)
    assert verdict.transient == pytest.approx(left, rel=0.1)
    assert (verdict.word, verdict.periodicity) == (
        ("settled", 1) if left < TOLERANCE else ("not settled", None)
    )


@example(damping=0.046875, ratios=[8.0], n=303, P=None, phase=0.0)
@given(
    damping=st.floats(1e-4, 0.05),
    ratios=st.lists(st.floats(0.02, 8.0), min_size=1, max_size=4),
    n=st.integers(1, 400),
    P=st.one_of(st.none(), st.integers(1, 8)),
    phase=st.floats(0.0, 6.3),
)
@example(damping=0.005, ratios=[1.0 / 3.0], n=160, P=3, phase=0.0)
@example(damping=0.005, ratios=[0.376, 0.752], n=160, P=3, phase=0.0)
@settings(max_examples=150, deadline=None, derandomize=True)
def test_no_linear_motion_is_called_subharmonic(
    damping: float, ratios: list[float], n: int, P: int | None, phase: float
) -> None:
    """Modes that together begin with the amplitude of the steady motion."""
    k = np.arange(1.0, n + 1)
    turns = 2.0 * np.pi * np.array(ratios)
    decays = damping * turns
    parts = np.exp(-decays[:, None] * k + 1j * (turns[:, None] * k + phase)) / len(ratios)
    motion = parts.sum(axis=0)
    verdict = judge(
        np.stack([0.3 + motion.real, 0.5 + motion.imag])[:, None], P, decays.min(), is_linear=True
    )
    assert verdict.periodicity in (None, 1)
    assert verdict.word in ("settled", "not settled")
    if verdict.word == "settled":
        assert abs(motion[-1]) < MARGIN * TOLERANCE


@pytest.mark.parametrize("P", [1, 2, 3, 8])
def test_a_steady_motion_with_contact_has_its_period(P: int) -> None:
    verdict = judge(steady(200, P) + scattered(200, 0.04), P, DECAY, is_linear=False)
    assert (verdict.word, verdict.periodicity) == ("settled", P)
    assert verdict.scatter == pytest.approx(0.04, rel=0.2)
    assert verdict.periods_needed == 0


@pytest.mark.parametrize(("P", "times", "said"), [(1, 2, 2), (3, 2, 6), (5, 2, None)])
def test_a_multiple_that_repeats_better_is_the_period(P: int, times: int, said: int | None) -> None:
    """Phases 5 % apart lie below the 10 % of a motion of P periods; ten periods are too many."""
    apart = np.repeat(0.025 * (-1.0) ** np.arange(times), P) * np.ones((2, 1, 1))
    cycles = np.tile(steady(P, P), times) + apart
    strobes = np.tile(cycles, 400 // (P * times) + 1)[..., :400]
    verdict = judge(strobes + scattered(400, 0.005), P, DECAY, is_linear=False)
    assert (verdict.word, verdict.periodicity) == ("settled" if said else "irregular", said)


def test_an_alternation_that_scatter_keeps_alive_is_undecided() -> None:
    """Next to a doubling scatter alternates for long and changes phase: neither period is sure."""
    rng, z = np.random.default_rng(2), [0.0]
    for _ in range(399):
        z.append(-0.985 * z[-1] + 0.008 * rng.normal())
    strobes = steady(400) + np.array([z, np.zeros(400)])[:, None]
    verdict = judge(strobes, 1, DECAY, is_linear=False)
    assert (verdict.word, verdict.periodicity) == ("not settled", None)
    assert verdict.transient <= verdict.allowed and verdict.periods_needed is None


def test_strobes_that_chance_calls_repeating_are_undecided() -> None:
    """sqrt(2) 0.065 lies between 0.10 / 1.2 and 0.10."""
    verdict = judge(
        steady(400, 2) + np.sqrt(2.0) * scattered(400, 0.065), 2, DECAY, is_linear=False
    )
    assert (verdict.word, verdict.periodicity) == ("not settled", None)


def test_a_decaying_alternation_is_no_period_two() -> None:
    alternating = fading(160, 0.05, turn=np.pi)
    verdict = judge(steady(160) + alternating + scattered(160, 0.002), 2, DECAY, is_linear=False)
    assert (verdict.word, verdict.periodicity) == ("not settled", None)
    assert verdict.transient == pytest.approx(0.05, rel=0.1)


def test_a_beat_is_told_from_scatter_if_it_would_have_decayed() -> None:
    """White scatter of 5 % stays; a beat of 5 % at the end was 25 % when the judged half began."""
    beat = steady(160) + fading(160, 0.05, turn=2.0)
    verdict = judge(beat + scattered(160, 0.005), 1, DECAY, is_linear=False)
    assert verdict.word == "not settled"
    assert verdict.transient == pytest.approx(0.05, rel=0.2)
    verdict = judge(steady(160) + scattered(160, 0.05), 1, DECAY, is_linear=False)
    assert verdict.word == "settled" and verdict.transient < 0.05
    short = judge(steady(40) + scattered(40, 0.05), 1, DECAY, is_linear=False)
    assert short.word == "not settled", "20 periods cannot tell"
    assert short.transient > 0.03


def test_cycles_that_do_not_repeat_are_irregular_once_the_transient_is_over() -> None:
    noise = scattered(300, 0.6)
    verdict = judge(noise, None, DECAY, is_linear=False)
    assert (verdict.word, verdict.periodicity) == ("irregular", None)
    moving = judge(noise + fading(300, 2.0), None, DECAY, is_linear=False)
    assert moving.word == "not settled"
    assert judge(noise, None, DECAY, is_linear=True).word == "not settled"


def test_the_worst_probe_decides() -> None:
    both = np.concatenate([steady(160), steady(160) + fading(160, 0.03)], axis=1)
    for strobes in (both, both[:, ::-1]):
        verdict = judge(strobes, 1, DECAY, is_linear=False)
        assert verdict.word == "not settled"
        assert verdict.transient == pytest.approx(0.03, rel=1e-6)


def test_without_damping_nothing_bounds_the_transient() -> None:
    verdict = judge(steady(160) + fading(160, 0.1, 0.0, 2.0), 1, 0.0, is_linear=True)
    assert verdict.word == "not settled" and verdict.periods_needed is None
    growing = judge(np.linspace(0.0, 1.0, 160) * np.ones((2, 1, 1)), 1, 0.0, is_linear=True)
    assert growing.word == "not settled"


@pytest.mark.parametrize("n", [0, 1, FEWEST - 1])
def test_too_few_strobes_say_nothing(n: int) -> None:
    verdict = judge(steady(n), 1, DECAY, is_linear=False)
    assert verdict.word == "not settled" and math.isnan(verdict.transient)
    assert verdict.periods_needed == math.ceil(math.log(100.0) / DECAY) - n


def test_a_motion_that_left_all_numbers_is_not_settled() -> None:
    strobes = steady(100)
    strobes[0, 0, -1] = np.nan
    assert judge(strobes, 1, DECAY, is_linear=False).word == "not settled"


@pytest.mark.parametrize("turn", [340.0, 170.0])
def test_a_torus_that_turns_slowly_has_no_period(turn: float) -> None:
    """Successive strobes change places once a turn; the last forty look like two periods."""
    k = np.arange(1200.0)
    wander = np.stack([np.cos((np.pi + 2.0 * np.pi / turn) * k)] * 2)[:, None]
    verdict = judge(0.4 * wander, 2, DECAY, is_linear=False)
    assert (verdict.word, verdict.periodicity, verdict.periods_needed) == (
        "not settled",
        None,
        None,
    )
    assert judge(0.05 * wander + steady(1200, 2), 2, DECAY, is_linear=False).periodicity == 2


def test_phases_that_do_not_differ_are_no_periods() -> None:
    """Next to a doubling cycles differ by chance in pairs for a while; their means do not."""
    noise = scattered(600, 0.06)
    assert judge(steady(600) + noise, 2, DECAY, is_linear=False).word == "not settled"
    assert judge(steady(600) + noise, 1, DECAY, is_linear=False).periodicity == 1
    assert judge(steady(600, 2) + noise, 2, DECAY, is_linear=False).periodicity == 2


def test_the_numbers_of_a_verdict_are_those_of_one_probe() -> None:
    """A probe that scatters, and one with a transient that is too large for it."""
    quiet, wild = steady(200) + fading(200, 0.05), steady(200) + scattered(200, 0.08)
    verdict = judge(np.concatenate([wild, quiet], axis=1), 1, DECAY, is_linear=False)
    assert verdict.word == "not settled" and verdict.transient == pytest.approx(0.05, rel=0.01)
    assert verdict.allowed == TOLERANCE and verdict.scatter < TOLERANCE


def test_a_beat_is_at_most_the_whole_rest() -> None:
    """The line through a power that fades twice as fast begins below 0: all is beat."""
    rate, n = 0.05, 60
    power = 1e-4 * np.exp(-4.0 * rate * (np.arange(n) + 1 - n))
    remainder = np.sqrt(power / 2.0) * np.ones((2, 1, 1))
    beat, scatter = _beating(remainder, rate)
    assert beat == pytest.approx(_decaying(remainder, rate), rel=1e-12)
    assert scatter == pytest.approx(0.0, abs=1e-6 * beat[0])

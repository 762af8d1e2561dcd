"""What a run shows, in one sentence made of its numbers.

Each clause is a function of the numbers that returns its words, or nothing. A new clause is a
function and its place in `CLAUSES`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.results import strikes
from delam_fem.results.diagnostics import LARGEST_PERIODICITY, probe_node

WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight")
EQUAL = 0.05
"""Two speeds closer than this share of the larger one count as equal."""


@dataclass(frozen=True)
class Run:
    """What the clauses are made of."""

    history: xr.Dataset
    summary: Mapping[str, Any]
    case: Case

    @property
    def end(self) -> str:
        """The word for the place of the reference probes."""
        return "tip" if probe_node(self.history) == self.history.sizes["node"] - 1 else "probe"


def sentence(history: xr.Dataset, summary: Mapping[str, Any], case: Case) -> str:
    """Return what a run shows in a sentence.

    Args:
        history: of the run; see `schema.VARIABLES`.
        summary: the numbers of summary.json; those that are missing are not mentioned.
        case: the case.
    """
    run = Run(history, summary, case)
    text = ", ".join(words for words in (clause(run) for clause in CLAUSES) if words)
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _outcome(run: Run) -> str:
    """Say whether the run came to its end."""
    outcome = run.summary.get("outcome", "completed")
    done, wanted = run.history.sizes["period"], run.case.n_periods
    return "" if outcome == "completed" else f"{outcome} in period {done} of {wanted}"


def _settled(run: Run) -> str:
    """Say whether the motion has settled, in the word of the summary, and what is missing."""
    word, numbers = str(run.summary.get("settled") or ""), run.summary.get("settling") or {}
    if word != "not settled":
        return word
    left, needed = numbers.get("transient"), numbers.get("periods_needed")
    parts = [] if left is None else [f"{100.0 * left:.2g} % of the amplitude is transient"]
    parts += [f"at most {needed} further periods are needed"] if needed else []
    return f"{word} ({'; '.join(parts)})" if parts else word


def _periodicity(run: Run) -> str:
    """Say after how many periods of the excitation the motion repeats."""
    if not run.case.is_periodic:
        return "not judged for periods, because the excitation has none"
    if run.summary.get("settled") == "not settled":
        return ""
    P = run.summary.get("periodicity")
    if run.summary.get("periodicity_class") == "undecided":
        single = 100.0 * run.summary["strobe_scatters"][0]
        return f"of undecided period (cycles differ by {single:.2g} % of the amplitude)"
    if P is None:
        return f"no repetition within {WORDS[LARGEST_PERIODICITY]} periods"
    return f"{_word(P)}-periodic"


def _contacts(run: Run) -> str:
    """Say how often the probes meet, and how fast."""
    rate, gap = run.summary.get("tip_contacts_per_period"), run.summary.get("minimum_tip_gap")
    if rate is None:
        return "without contact: the laminae pass through one another"
    if rate == 0.0:
        if gap is None or not np.isfinite(gap):  # nothing is known of contacts
            return ""
        near = f" (the smallest gap is {1e3 * gap:.3g} mm)" if gap > 0.0 else ""
        return f"the {run.end}s never meet{near}"
    found = _strongest(run)
    speed = f" at {found[1].approach:.3g} m/s" if found else ""
    if not run.case.is_periodic:
        times = rate * run.history.sizes["time"] / run.case.steps_per_period
        return f"{times:.0f} {run.end} strike{'s' * (round(times) != 1)}{speed}"
    return f"{_often(rate, run.end)}{speed}"


def _beats(run: Run) -> str:
    """Say which lamina is faster before the strikes."""
    found = _strongest(run)
    if not found:
        return ""
    interface, strike = found
    names = [str(name) for name in run.history["lamina"].to_numpy()[interface : interface + 2]]
    lower, upper = (abs(speed) for speed in strike.mean)
    if abs(lower - upper) <= EQUAL * max(lower, upper):
        return f"{names[0]} and {names[1]} equally fast"
    fast, slow = names if lower > upper else names[::-1]
    return f"{fast} beats {slow}"


CLAUSES: tuple[Callable[[Run], str], ...] = (_outcome, _settled, _periodicity, _contacts, _beats)
"""The clauses of the sentence in their order."""


def _strongest(run: Run) -> tuple[int, strikes.Strikes] | None:
    """Return the interface with the fastest strikes, and these; None if there are none."""
    if not run.summary.get("tip_contacts_per_period"):
        return None
    N, n = run.case.steps_per_period, run.history.sizes["lamina"]
    found = [(j, strikes.of_interface(run.history, N, j)) for j in range(n - 1)]
    found = [entry for entry in found if entry[1].step.size and entry[1].approach > 0.0]
    return max(found, key=lambda entry: entry[1].approach, default=None)


def _often(rate: float, end: str) -> str:
    """Return a number of contacts per period in words."""
    for periods in range(1, LARGEST_PERIODICITY + 1):
        count = rate * periods
        if np.isclose(count, round(count), atol=1e-6) and 1 <= round(count) < len(WORDS):
            times = "strike" if round(count) == 1 else "strikes"
            during = "a period" if periods == 1 else f"in {_word(periods)} periods"
            return f"{_word(round(count))} {end} {times} {during}"
    return f"{rate:.3g} {end} strikes a period"


def _word(number: int) -> str:
    """Return a small number in words."""
    return WORDS[number] if number < len(WORDS) else str(number)

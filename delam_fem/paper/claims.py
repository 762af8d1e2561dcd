"""The claims of the paper, and the numbers that they are judged by.

A statement is a row of data: the paper's words, where they stand, what came out in words, and the
criteria that decide. `judge` turns all rows into claims. A verdict follows from criteria, each a
number and its bound, so that it states its margin. A number whose own uncertainty contains the
bound decides nothing.

A piece is one figure of the paper: two functions and its statements.

    measure (laboratory → numbers)    draw (numbers → picture)    statements (numbers → claims)

Numbers stand by their names, so that a test can check a verdict with any numbers. Only `draw` and
`film` import matplotlib, and only when they are called.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from delam_fem.api import FloatArray, diagnostics, style
from delam_fem.paper.runs import Laboratory, is_as_described, strikes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delam_fem.api import Result

Verdict = Literal["holds", "does not hold", "undecided", "open"]
"""`undecided`: the uncertainty of a number contains its bound. `open`: the paper's text does not
allow a verdict."""

HEADING = ("figure", "the paper says", "where", "what came out", "margin", "verdict")
YES_OR_NO = "yes or no"
RELATIONS = {"<": operator.lt, ">": operator.gt, "=": operator.eq}


@dataclass(frozen=True)
class Criterion:
    """A number that must keep a bound.

    Attributes:
        name: name of the number.
        value: the number; NaN: there is none, and the criterion fails.
        relation: relation of the number to the bound that must hold.
        bound: the bound.
        unit: unit of both; "%": both are shares and are shown times 100; `YES_OR_NO`: 1 is yes.
        within: smallest and largest value that the uncertainty of the number allows; None: its
            uncertainty is unknown or negligible.
    """

    name: str
    value: float
    relation: Literal["<", ">", "="]
    bound: float
    unit: str = ""
    within: tuple[float, float] | None = None

    @property
    def verdict(self) -> Verdict:
        """Whether the number keeps the bound."""
        if math.isnan(self.value):
            return "does not hold"
        keeps = RELATIONS[self.relation]
        outcomes = {keeps(value, self.bound) for value in (self.value, *(self.within or ()))}
        if len(outcomes) > 1:
            return "undecided"
        return "holds" if outcomes == {True} else "does not hold"

    def __str__(self) -> str:
        """Return number, uncertainty and bound in words."""
        if self.unit == YES_OR_NO:
            return f"{self.name}: {'yes' if self.value == self.bound else 'no'}"
        text = "none" if math.isnan(self.value) else self._shown(self.value)
        if self.within is not None:
            text += " ({} … {})".format(*map(self._shown, self.within))
        needed = f"{self.relation} {self._shown(self.bound)} {self.unit}".rstrip()
        return f"{self.name} {text}, needs {needed}"

    def _shown(self, value: float) -> str:
        if self.unit == "Hz":
            return f"{value:.4g}"
        value = 100.0 * value if self.unit == "%" else value
        return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def yes(name: str, is_so: bool) -> Criterion:
    """Return the criterion that the answer to a question of yes or no is yes."""
    return Criterion(name, float(is_so), "=", 1.0, YES_OR_NO)


def between(
    name: str,
    value: float,
    bounds: tuple[float, float],
    unit: str = "",
    within: tuple[float, float] | None = None,
) -> list[Criterion]:
    """Return the criteria that a number lies between two bounds; see `Criterion`."""
    low, high = bounds
    return [
        Criterion(name, value, ">", low, unit, within),
        Criterion(name, value, "<", high, unit, within),
    ]


@dataclass(frozen=True)
class Claim:
    """One statement of the paper with the computed result.

    Attributes:
        figure: short name of the figure that measures it.
        text: the paper's statement.
        source: section of the paper that makes the statement.
        measured: the computed result, in words and numbers.
        verdict: whether the result agrees with the statement.
        margin: how far the numbers are from the bounds that decide.
    """

    figure: str
    text: str
    source: str
    measured: str
    verdict: Verdict
    margin: str

    @property
    def row(self) -> tuple[str, str, str, str, str, str]:
        """The claim as a row below `HEADING`."""
        return self.figure, self.text, self.source, self.measured, self.margin, self.verdict


def judged(*criteria: Criterion) -> tuple[Verdict, str]:
    """Return the verdict on a statement that holds if all criteria do, and its margin in words."""
    verdicts = {criterion.verdict for criterion in criteria}
    order: tuple[Verdict, ...] = ("does not hold", "undecided", "holds")
    verdict: Verdict = next((worst for worst in order if worst in verdicts), "holds")
    return verdict, "; ".join(map(str, criteria))


class Numbers(SimpleNamespace):
    """The numbers of a figure as attributes."""

    def __init__(self, kept: Mapping[str, Any] = MappingProxyType({}), **drawn: Any) -> None:
        """Store numbers under their names.

        Args:
            kept: the numbers of figNN.json by name.
            drawn: other values that the picture and the claims need, often whole results.
        """
        super().__init__(**{**kept, **drawn, "kept": kept})


@dataclass(frozen=True)
class Statement:
    """A statement of the paper that the numbers of a figure decide; each function takes them.

    Attributes:
        text: the paper's statement.
        source: section of the paper that makes the statement.
        measured: function that returns the computed result, in words and numbers.
        criteria: function that returns the criteria which must all hold.
    """

    text: str
    source: str
    measured: Callable[[Any], str]
    criteria: Callable[[Any], Iterable[Criterion]]


@dataclass(frozen=True)
class Piece:
    """A figure of the paper with everything that belongs to it.

    Attributes:
        name: short name, for example "2a".
        title: subject of the figure.
        caption: explanation of the comparison; {0.name} stands for a number.
        measure: function that computes everything the figure needs and returns its numbers.
        draw: function that returns the picture of the numbers.
        statements: statements of the paper that the numbers decide.
        film: function that writes a GIF of the numbers to a path; None: there is no film.
    """

    name: str
    title: str
    caption: str
    measure: Callable[[Laboratory], Numbers]
    draw: Callable[[Any], Figure]
    statements: tuple[Statement, ...]
    film: Callable[[Any, Path], None] | None = None

    def judge(self, numbers: Numbers) -> tuple[Claim, ...]:
        """Return the claims that the numbers decide."""
        return tuple(
            Claim(self.name, s.text, s.source, s.measured(numbers), *judged(*s.criteria(numbers)))
            for s in self.statements
        )


SMOOTH_HARMONICS = 20
"""The part of a signal above this harmonic of the excitation counts as roughness."""
FREE_GAP = 1e-3
"""Tips farther apart than this are in free flight [m]."""
CLEARLY = 0.8
"""Ratio of two roughnesses below which the smaller one counts as a distinct improvement."""
SERIES_STEP = 4
"""Distance in steps between the samples that are kept in the numbers of a figure."""


def rough_part(values: FloatArray, n_periods: int, above: int = SMOOTH_HARMONICS) -> FloatArray:
    """Return the part of a signal above a harmonic of the excitation, same shape as `values`.

    Args:
        values: signal over whole periods along the last axis.
        n_periods: number of periods in the signal.
        above: number of the highest harmonic that is removed.
    """
    spectrum = np.fft.rfft(values, axis=-1)
    spectrum[..., : above * n_periods + 1] = 0.0
    return np.fft.irfft(spectrum, n=values.shape[-1], axis=-1)


def roughness(result: Result, *, free: bool, quantity: str = "tip_velocity") -> tuple[float, float]:
    """Return, for both tips, the rms of the rough part over the rms of the whole signal [-].

    Args:
        result: a result whose window has whole periods.
        free: True: use the steps at which the tips are more than `FREE_GAP` apart; False: use the
            other steps.
        quantity: "tip_velocity" or "tip_displacement".
    """
    window = diagnostics.last_periods(result.history, result.case)
    values = window[quantity].to_numpy()
    rough = rough_part(values, values.shape[-1] // result.case.time.steps_per_period)
    chosen = (diagnostics.tip_gap(window) > FREE_GAP) == free
    values = values - values.mean(axis=1, keepdims=True)
    scale = np.sqrt((values**2).mean(axis=1))
    part = np.sqrt((rough[:, chosen] ** 2).mean(axis=1)) if chosen.any() else np.zeros(2)
    thick, thin = part / scale
    return float(thick), float(thin)


def settling(strobe: FloatArray, half_range: FloatArray, periodicity: int, within: float) -> int:
    """Return the number of periods after which a motion from rest stays near its stationary cycle.

    Args:
        strobe: displacement of both tips at the end of each period, shape (2, n) [m].
        half_range: half peak-to-peak of both tips, shape (2,) [m].
        periodicity: P, the number of periods after which the stationary motion repeats.
        within: distance from the cycle that counts as near, in half ranges [-].

    Returns:
        Number of the last period at whose end a tip is farther than that from the mean of the last
        strobes of the same phase.
    """
    n = strobe.shape[1]
    last = 0
    for phase in range(periodicity):
        periods = np.arange(n - 1 - phase, -1, -periodicity)[::-1]
        same = strobe[:, periods]
        mean = same[:, -(diagnostics.STROBES // periodicity) :].mean(axis=1, keepdims=True)
        away = (np.abs(same - mean) > within * half_range[:, None]).any(axis=0)
        last = max(last, int(periods[away].max(initial=-1)) + 1)
    return last


def describe(result: Result) -> str:
    """Return the kind of a motion in a few words."""
    s = result.summary
    thick, thin = strikes(result).mean
    period = s["periodicity_class"] or "not periodic"
    struck = "" if np.isnan(thick) else f", {thick:+.2f} / {thin:+.2f} m/s"
    return f"{period}, {s['tip_contacts_per_period']:.2g} contacts/T{struck}"


def ends(values: Iterable[str]) -> str:
    """Return the first and the last value in words: "1 … 3"."""
    first, *_, last = values
    return f"{first} … {last}"


def tip_positions(result: Result, count: int) -> tuple[FloatArray, FloatArray]:
    """Return the time and the positions of both tips over the last periods.

    Returns:
        t/T from the start of these periods, shape (n,) [-]; positions, shape (2, n) [mm].
    """
    last = diagnostics.last_periods(result.history, result.case, count)
    y = 1e3 * diagnostics.probe_positions(last)
    t = np.arange(1, y.shape[1] + 1) / result.case.time.steps_per_period
    return t, y


def motion_numbers(result: Result) -> Numbers:
    """Return the numbers that characterise a motion, and the positions of the tips at its end.

    Returns:
        Numbers of the summary of the run, and: kind, the motion in words; is_as_described, whether
        the motion is as the paper describes it for its frequency; strike_velocities, mean
        velocities of thick and thin tip before a strike [m/s]; near_share, the share of the time in
        which the tips are less than `FREE_GAP` apart [-]; t_over_T and position_mm, time and tip
        positions, every `SERIES_STEP` steps, shapes (n,) and (2, n).
    """
    t, y = tip_positions(result, style.HISTORY_PERIODS)
    names = (
        "periodicity", "periodicity_class", "strobe_scatters", "strobe_scatter",
        "tip_contacts_per_period", "impacts_per_period",
        "tip_min", "tip_max", "minimum_tip_gap", "distortion_factor", "thd", "energy_residual",
    )  # fmt: skip
    return Numbers(
        {name: result.summary[name] for name in names}
        | {
            "kind": describe(result),
            "is_as_described": is_as_described(result),
            "strike_velocities": strikes(result).mean,
            "near_share": float((diagnostics.tip_gap(result.history) < FREE_GAP).mean()),
            "t_over_T": t[::SERIES_STEP],
            "position_mm": np.round(y[:, ::SERIES_STEP], 4),
        }
    )


def has_period(motion: Numbers, periodicity: int) -> list[Criterion]:
    """Return the criteria that a motion repeats after this number of periods and not earlier.

    The scatter of cycles counts as uncertain by the factor `diagnostics.PERIODIC_MARGIN`.
    """
    margin = diagnostics.PERIODIC_MARGIN
    criteria: list[Criterion] = []
    for P in (P for P in range(1, periodicity + 1) if periodicity % P == 0):
        (value,) = (motion.strobe_scatters or ())[P - 1 : P] or (math.nan,)
        criteria.append(
            Criterion(
                f"scatter {P} period{'s' if P > 1 else ''} apart", value,
                "<" if periodicity == P else ">", diagnostics.PERIODIC_SCATTER, "%",
                (value / margin, value * margin),
            )
        )  # fmt: skip
    return criteria


def described(motion: Numbers, periodicity: int) -> list[Criterion]:
    """Return the criteria that a motion has a period and is as the paper describes it."""
    return [yes("as described", motion.is_as_described), *has_period(motion, periodicity)]

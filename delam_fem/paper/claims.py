"""What the paper states beside what the computation gives, and the pieces that are compared.

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
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal

from delam_fem.results.figures.style import WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delam_fem.paper.lab import Laboratory

Verdict = Literal["holds", "does not hold", "undecided", "open"]
"""`undecided`: the uncertainty of a number contains its bound. `open`: the paper's text does not
allow a verdict."""

HEADING = ("figure", "the paper says", "where", "what came out", "margin", "verdict")
YES_OR_NO = "yes or no"


@dataclass(frozen=True)
class Criterion:
    """A number that must keep a bound.

    Attributes:
        name: what the number is.
        value: the number; NaN: there is none, and the criterion fails.
        relation: how the number must lie to the bound.
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
        found = {self._keeps(value) for value in (self.value, *(self.within or ()))}
        if len(found) > 1:
            return "undecided"
        return "holds" if found == {True} else "does not hold"

    def _keeps(self, value: float) -> bool:
        if self.relation == "=":
            return value == self.bound
        return value < self.bound if self.relation == "<" else value > self.bound

    def __str__(self) -> str:
        """Return number, uncertainty and bound in words."""
        if self.unit == YES_OR_NO:
            return f"{self.name}: {'yes' if self.value == self.bound else 'no'}"
        found = "none" if math.isnan(self.value) else self._shown(self.value)
        if self.within is not None:
            found += " ({} … {})".format(*map(self._shown, self.within))
        return f"{self.name} {found}, needs {self.relation} {self._shown(self.bound)}{self._unit}"

    @property
    def _unit(self) -> str:
        return f" {self.unit}" if self.unit else ""

    def _shown(self, value: float) -> str:
        if self.unit == "Hz":
            return f"{value:.4g}"
        value = 100.0 * value if self.unit == "%" else value
        return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def yes(name: str, is_so: bool) -> Criterion:
    """Return the criterion that something which is either so or not is so."""
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
    found = {criterion.verdict for criterion in criteria}
    order: tuple[Verdict, ...] = ("does not hold", "undecided", "holds")
    verdict: Verdict = next((worst for worst in order if worst in found), "holds")
    return verdict, "; ".join(map(str, criteria))


class Numbers(SimpleNamespace):
    """The numbers of a figure as attributes."""

    def __init__(self, kept: Mapping[str, Any] = MappingProxyType({}), **drawn: Any) -> None:
        """Name the numbers.

        Args:
            kept: the numbers of figNN.json by name.
            drawn: what only the picture and the claims need, often whole results.
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
        statements: what the numbers decide.
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


def canvas(height: float) -> Figure:
    """Return an empty figure of full width and a height [in]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), layout="constrained")

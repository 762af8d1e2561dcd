"""Define the section `[excitation]` of a case, and read a course of values from a table.

The excitation makes the laminae move: the base moves, or a force acts at a point of a lamina. Every
kind has the properties `acts_on`, `is_periodic`, `top_frequency` and `length`, so that other code
need not know the kinds.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from delam_fem.case.tables import in_si_units, read_columns
from delam_fem.case.values import (
    FileName,
    Label,
    NotNegative,
    Positive,
    Section,
    Unit,
    inconsistent,
)
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError, require

_UNITS = {"base": ("m", "m/s2"), "force": ("N",)}
"""SI units of the values by what they act on."""


def read_series(
    path: Path, acts_on: str, least_rows: int = 6
) -> tuple[FloatArray, FloatArray, str]:
    """Read the course of an excitation from a table, and check it.

    Comments (#) are skipped. A heading gives units in brackets: `time [ms], force [kN]`. Without
    units, times are in s, values in m (base) or N (force), and a warning says so.

    Args:
        path: table with the columns time and value; see `tables.read_columns`.
        acts_on: "base" or "force".
        least_rows: smallest number of rows.

    Returns:
        Times from 0, increasing, shape (rows,) [s]; values, shape (rows,); their unit, "m", "m/s2"
        or "N".

    Raises:
        CaseError: the file is missing; a heading has another unit; a row is not a pair of finite
            numbers; the times do not begin at 0 or do not increase; or there are too few rows.
    """
    name = f"excitation.file {path}"
    table = read_columns(path, name, ("time", "value"))
    (time, value), units = in_si_units(table, ("time", "value"), (("s",), _UNITS[acts_on]), name)
    require(time.size >= least_rows, name, f"at least {least_rows} rows", time.size)
    if time[0] != 0.0:
        raise CaseError(
            f"{name}, line {table.lines[0]}: expected times from 0, given {time[0]}; subtract the "
            "first time"
        )
    for k in np.flatnonzero(~(np.diff(time) > 0.0)):
        raise CaseError(
            f"{name}, line {table.lines[k + 1]}: expected times to increase, given {time[k + 1]} "
            f"after {time[k]}"
        )
    return time, value, units[1]


Target = Literal["base", "force"]


class _Kind(Section):
    """What the kinds of excitation share; each knows its own keys."""

    @property
    def is_periodic(self) -> bool:
        """Whether the excitation repeats after each period."""
        return getattr(self, "frequency", None) is not None

    @property
    def top_frequency(self) -> float:
        """Frequency whose period is divided into steps; the highest one of a sweep [Hz]."""
        keys = ("frequency", "start_frequency", "end_frequency")
        return max(getattr(self, key, None) or 0.0 for key in keys)

    @property
    def length(self) -> float | None:
        """Time that a run must cover [s]; None: that of the section `time`."""
        return getattr(self, "duration", None)

    @property
    def size(self) -> str:
        """The amplitude in words."""
        raise NotImplementedError

    @property
    def words(self) -> str:
        """The excitation in words, for titles."""
        if self.is_periodic:
            return f"{self.top_frequency:g} Hz, {self.size}"
        start, end = (getattr(self, f"{name}_frequency") for name in ("start", "end"))
        return f"sweep {start:g}–{end:g} Hz, {self.size}"


class _OfBase(_Kind):
    """A motion of the base with a given amplitude of its displacement or of its acceleration.

    Attributes:
        amplitude: amplitude A of the displacement [m].
        acceleration: amplitude of the acceleration [m/s2], as shakers are set.
    """

    acts_on: ClassVar[Target] = "base"
    amplitude: Annotated[NotNegative, Unit("m")] | None = None
    acceleration: Annotated[NotNegative, Unit("m/s2")] | None = None

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        """Check that either the displacement or the acceleration is given."""
        if self.amplitude is None and self.acceleration is None:
            raise inconsistent(
                "amplitude", "missing, but required unless excitation.acceleration is given"
            )
        if self.amplitude is not None and self.acceleration is not None:
            raise inconsistent(
                "acceleration", "expected either amplitude [m] or acceleration [m/s2], given both"
            )
        return self

    @property
    def size(self) -> str:
        """The amplitude in words."""
        if self.acceleration is not None:
            return f"a = {self.acceleration:g} m/s²"
        return f"A = {1e3 * (self.amplitude or 0.0):g} mm"

    def displacement_amplitude(self, frequency: float) -> float:
        """Return the amplitude A: the given one, or acceleration / (2 pi f)^2 [m]."""
        if self.acceleration is None:
            return self.amplitude or 0.0
        return self.acceleration / (2.0 * math.pi * frequency) ** 2


class HarmonicExcitation(_OfBase):
    """Base motion A sin(2 pi f t).

    Attributes:
        kind: "harmonic".
        frequency: frequency f [Hz].
    """

    kind: Literal["harmonic"] = "harmonic"
    frequency: Annotated[Positive, Unit("Hz")]


class SweepExcitation(_OfBase):
    """Base motion A sin(phi(t)) with a frequency that changes from a start to an end value.

    Attributes:
        kind: "sweep".
        start_frequency: frequency at t = 0 [Hz].
        end_frequency: frequency at t = duration [Hz].
        duration: length of the sweep [s].
        spacing: "linear" or "logarithmic" change of the frequency in time.
    """

    kind: Literal["sweep"] = "sweep"
    start_frequency: Annotated[Positive, Unit("Hz")]
    end_frequency: Annotated[Positive, Unit("Hz")]
    duration: Annotated[Positive, Unit("s")]
    spacing: Literal["linear", "logarithmic"] = "linear"


class _AtPoint(_Kind):
    """A force at a point of a lamina, in the direction of the deflection.

    Attributes:
        lamina: name of the lamina.
        position: x of the point [m].
        amplitude: largest force [N]; positive acts upwards, from the first lamina to the last.
    """

    acts_on: ClassVar[Target] = "force"
    lamina: Label
    position: Annotated[NotNegative, Unit("m")]
    amplitude: Annotated[NotNegative, Unit("N")]

    @property
    def size(self) -> str:
        """The amplitude in words."""
        return f"{self.amplitude:g} N on {self.lamina} at {self.position:g} m"


class ForceExcitation(_AtPoint):
    """Force F sin(2 pi f t) at a point, or F sin(phi(t)) with a frequency that changes.

    Attributes:
        kind: "force".
        frequency: frequency f of a harmonic force [Hz].
        start_frequency: frequency of a swept force at t = 0 [Hz].
        end_frequency: frequency of a swept force at t = duration [Hz].
        duration: length of the sweep [s].
        spacing: "linear" or "logarithmic" change of the frequency in time.
    """

    kind: Literal["force"] = "force"
    frequency: Annotated[Positive, Unit("Hz")] | None = None
    start_frequency: Annotated[Positive, Unit("Hz")] | None = None
    end_frequency: Annotated[Positive, Unit("Hz")] | None = None
    duration: Annotated[Positive, Unit("s")] | None = None
    spacing: Literal["linear", "logarithmic"] = "linear"

    @model_validator(mode="after")
    def _one_course(self) -> Self:
        """Check that either one frequency is given or all keys of a sweep."""
        given = [key for key in _SWEPT if getattr(self, key) is not None]
        if given and self.frequency is not None:
            raise inconsistent(
                given[0], "expected either frequency or the keys of a sweep, given both"
            )
        if not given and self.frequency is None:
            raise inconsistent(
                "frequency", f"missing, but required; or {', '.join(_SWEPT)} of a sweep"
            )
        for key in _SWEPT:
            if given and key not in given:
                raise inconsistent(key, "missing, but required for a swept force")
        return self


_SWEPT = ("start_frequency", "end_frequency", "duration")
"""Keys that a swept force needs."""


class HammerExcitation(_AtPoint):
    """A blow of an impulse hammer: a half sine of force at a point.

    Attributes:
        kind: "hammer".
        duration: length of the blow [s].
        start: time at which the blow begins [s].
    """

    kind: Literal["hammer"] = "hammer"
    duration: Annotated[Positive, Unit("s")]
    start: Annotated[NotNegative, Unit("s")] = 0.0

    @property
    def top_frequency(self) -> float:
        """Frequency of the half sine [Hz]."""
        return 0.5 / self.duration

    @property
    def length(self) -> float | None:
        """Time that a run must cover [s]; None: `time.duration`."""
        return None

    @property
    def words(self) -> str:
        """The excitation in words, for titles."""
        return f"hammer {1e3 * self.duration:g} ms, {self.size}"


class TableExcitation(_Kind):
    """A motion of the base or a force from a table.

    Attributes:
        kind: "table".
        file: CSV table with the columns time [s] and value; a relative name counts from the
            case file.
        acts_on: "base" (displacement [m] or acceleration [m/s2]) or "force" [N].
        lamina: name of the lamina on which a force acts.
        position: x of the point at which a force acts [m].
    """

    kind: Literal["table"] = "table"
    file: FileName
    acts_on: Target
    lamina: Label | None = None
    position: Annotated[NotNegative, Unit("m")] | None = None

    @model_validator(mode="after")
    def _has_point(self) -> Self:
        """Check that a force has its point, and a motion of the base none."""
        for key in ("lamina", "position"):
            self.require_just(key, self.acts_on == "force", "acts_on")
        return self

    @property
    def top_frequency(self) -> float:
        """Frequency whose period is divided into steps [Hz]; a table has none."""
        return math.nan

    @property
    def size(self) -> str:
        """The amplitude in words: the table's name."""
        place = "base" if self.lamina is None else f"{self.lamina} at {self.position:g} m"
        return f"{self.file.name} on {place}"

    @property
    def words(self) -> str:
        """The excitation in words, for titles."""
        return self.size


Excitation: TypeAlias = Annotated[
    HarmonicExcitation | SweepExcitation | ForceExcitation | HammerExcitation | TableExcitation,
    Field(discriminator="kind"),
]
"""The section `[excitation]`; its key `kind` says which."""

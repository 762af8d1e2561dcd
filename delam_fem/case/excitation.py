"""Define the section `[excitation]` of a case, and compute its course in time, with derivatives.

The excitation makes the laminae move: the base moves, or a force acts at a point of a lamina. Every
kind has the properties `acts_on`, `is_periodic`, `top_frequency` and `length`, so that other code
need not know the kinds; `drive` gives its course. Motions of the base start at t = 0 with the
displacement 0 but not with the velocity 0: the base starts abruptly while the laminae are at rest,
as in the paper.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, Self, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy  # loads its parts when they are used
from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    create_model,
    model_serializer,
    model_validator,
)

from delam_fem.case import broadband
from delam_fem.case.broadband import Faded, Gridded, Lines, Realisations, Still, product
from delam_fem.case.sections import Position, SurfaceName, place_words
from delam_fem.case.tables import TableColumns, heading, in_si_units, read_columns
from delam_fem.case.values import (
    Count,
    CountOrNone,
    Expected,
    FileName,
    Label,
    NotNegative,
    Positive,
    Section,
    Unit,
    in_si,
    inconsistent,
)
from delam_fem.numerics.types import FloatArray, IntArray
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
    def is_harmonic(self) -> bool:
        """Whether the excitation is one sine."""
        return getattr(self, "frequency", None) is not None

    @property
    def is_periodic(self) -> bool:
        """Whether the excitation repeats after each period."""
        return self.is_harmonic

    @property
    def turns(self) -> int:
        """Number of periods of `top_frequency` that make a period of a run."""
        return 1

    @property
    def top_frequency(self) -> float:
        """Frequency whose period is divided into steps; the highest of a sweep; NaN: none [Hz]."""
        keys = ("frequency", "start_frequency", "end_frequency")
        frequencies = [getattr(self, key, None) for key in keys]
        return max((f for f in frequencies if f is not None), default=math.nan)

    @property
    def repeat_rate(self) -> Fraction:
        """Reciprocal of the time after which it repeats, as it is written [Hz]."""
        return Fraction(repr(self.top_frequency)) / self.turns

    @property
    def length(self) -> float | None:
        """Time that a run must cover [s]; None: that of the section `time`."""
        return getattr(self, "duration", None)

    @property
    def size(self) -> str:
        """The amplitude in words."""
        raise NotImplementedError

    @property
    def place(self) -> str:
        """Where it acts, in words."""
        lamina = getattr(self, "lamina", None)
        return f"{lamina} at {place_words(getattr(self, 'position', None))}" if lamina else "base"

    @property
    def words(self) -> str:
        """The excitation in words, for titles."""
        if self.is_periodic:
            return f"{self.top_frequency:g} Hz, {self.size}"
        if math.isnan(self.top_frequency):
            return self.size
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
        position: x of the point [m], or [x, z] on a plate.
        surface: of a plate: "middle", "top" or "bottom"; "middle" if it is not given.
        amplitude: largest force [N]; positive acts upwards, from the first lamina to the last.
    """

    acts_on: ClassVar[Target] = "force"
    lamina: Label
    position: Position
    surface: SurfaceName | None = None
    amplitude: Annotated[NotNegative, Unit("N")]

    @property
    def size(self) -> str:
        """The amplitude in words."""
        return f"{self.amplitude:g} N on {self.place}"


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
        keys = [key for key in _SWEPT if getattr(self, key) is not None]
        if keys and self.frequency is not None:
            raise inconsistent(
                keys[0], "expected either frequency or the keys of a sweep, given both"
            )
        if not keys and self.frequency is None:
            raise inconsistent(
                "frequency", f"missing, but required; or {', '.join(_SWEPT)} of a sweep"
            )
        for key in _SWEPT:
            if keys and key not in keys:
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
        position: x of the point at which a force acts [m], or [x, z] on a plate.
        surface: of a plate, on which a force acts: "middle", "top" or "bottom"; "middle" if it is
            not given.
        offset: the mean of accelerations, from which a base drifts away: "remove", or "refuse" if
            it moves the base by more than a thousandth of the length; otherwise it stays.
    """

    kind: Literal["table"] = "table"
    file: FileName
    acts_on: Target
    lamina: Label | None = None
    position: Position | None = None
    surface: SurfaceName | None = None
    offset: Literal["remove", "refuse"] | None = None

    @model_validator(mode="after")
    def _has_point(self) -> Self:
        """Check that a force has its point, and a motion of the base none."""
        for key in ("lamina", "position"):
            self.require_just(key, self.acts_on == "force", "acts_on")
        if self.offset is not None and self.acts_on == "force":
            raise inconsistent("offset", 'expected none with acts_on = "force"')
        return self

    @property
    def size(self) -> str:
        """The amplitude in words: the table's name."""
        return f"{self.file.name} on {self.place}"

    def series(self) -> tuple[FloatArray, FloatArray, str]:
        """Return times [s], values as they drive a run, and their SI unit; see `read_series`."""
        time, value, unit = read_series(self.file, self.acts_on)
        if self.offset is not None and unit != "m/s2":
            raise CaseError(
                f"excitation.offset: expected none with a table of displacements, given "
                f'"{self.offset}"; it is of accelerations'
            )
        if self.offset == "remove":
            value = value - scipy.integrate.trapezoid(value, time) / time[-1]
        return time, value, unit


class NoExcitation(_Kind):
    """No drive: the base rests, and what moves does so from its initial state.

    Attributes:
        kind: "none".
    """

    kind: Literal["none"] = "none"
    acts_on: ClassVar[Target] = "base"

    @property
    def size(self) -> str:
        """The amplitude in words."""
        return "no drive"


Motion = Literal["displacement", "velocity", "acceleration"]
"""What of a base is prescribed."""
_INTEGRALS = {"displacement": 0, "velocity": 1, "acceleration": 2}
_MOTION_UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2"}

if TYPE_CHECKING:
    _OfMotion = _Kind
else:  # `in` is a word of Python, so that a class body cannot have it
    _OfMotion = create_model("_OfMotion", __base__=_Kind, **{"in": (Motion | None, None)})


class _Prescribed(_OfMotion):
    """What drives of the base or of a force have in common whose motion is given in a unit.

    Attributes:
        in: what is prescribed of the base: "displacement" [m], "velocity" or "acceleration", which
            is meant without it; a force is in N.
        acts_on: "base" or "force".
        lamina: name of the lamina on which a force acts.
        position: x of the point at which a force acts [m], or [x, z] on a plate.
        surface: of a plate, on which a force acts: "middle", "top" or "bottom"; "middle" if it is
            not given.
    """

    acts_on: Target = "base"
    lamina: Label | None = None
    position: Position | None = None
    surface: SurfaceName | None = None

    @model_validator(mode="after")
    def _has_point(self) -> Self:
        """Check that a force has its point, and a motion of the base none."""
        for key in ("lamina", "position"):
            self.require_just(key, self.acts_on == "force", "acts_on")
        if self.acts_on == "force" and getattr(self, "in") is not None:
            raise inconsistent("in", 'expected none with acts_on = "force", which is in N')
        return self

    @property
    def motion(self) -> Motion:
        """What of the base is prescribed."""
        motion: Motion = getattr(self, "in") or "acceleration"
        return motion

    @property
    def unit(self) -> str:
        """SI unit of what is prescribed."""
        return "N" if self.acts_on == "force" else _MOTION_UNITS[self.motion]

    @property
    def integrals(self) -> int:
        """How often it is integrated to the displacement of the base, or to the force."""
        return 0 if self.acts_on == "force" else _INTEGRALS[self.motion]


class _OfBand(_Prescribed):
    """What drives with many lines in a band have in common.

    Attributes:
        low: lowest frequency [Hz].
        high: highest frequency [Hz].
        rms: root mean square, in the unit of what is prescribed.
        seed: decides random phases and lines.
    """

    sized: ClassVar[tuple[str, ...]] = ("rms",)
    low: Annotated[Positive, Unit("Hz")]
    high: Annotated[Positive, Unit("Hz")]
    rms: Positive | None = None
    seed: CountOrNone = 0

    @model_validator(mode="before")
    @classmethod
    def _in_si(cls, data: Any) -> Any:
        """Convert sizes that carry a unit by what is prescribed."""
        if not isinstance(data, dict):
            return data
        motion = _MOTION_UNITS.get(str(data.get("in")), "m/s2")
        unit = "N" if data.get("acts_on") == "force" else motion
        sizes = {key: in_si(data[key], unit, key) for key in cls.sized if key in data}
        return {**data, **sizes}

    @model_validator(mode="after")
    def _is_band(self) -> Self:
        """Check that the band has a width."""
        if self.high < self.low:
            raise inconsistent(
                "high", f"expected at least low = {self.low:g} Hz, given {self.high:g}"
            )
        return self

    def _require_one(self, first: str, second: str) -> None:
        """Check that one of two keys says the size."""
        if (getattr(self, first) is None) == (getattr(self, second) is None):
            both = "given both" if getattr(self, first) is not None else "given none"
            raise inconsistent(first, f"expected either {first} or {second}, {both}")

    @property
    def top_frequency(self) -> float:
        """Frequency whose period is divided into steps [Hz]: the highest."""
        return self.high

    @property
    def band(self) -> str:
        """The band in words."""
        return f"{self.low:g}–{self.high:g} Hz"


def _written(unit: str) -> str:
    """Return a unit as texts write it."""
    return unit.replace("2", "²")


class MultisineExcitation(_OfBand):
    """A sum of sines at multiples of a spacing, of the base or of a force, that repeats.

    The phases decide the peaks: random ones make it alike to noise. Its period is 1/spacing.
    Several realisations follow one another, each for some periods; each goes over into the next in
    the next one's first period.

    Attributes:
        kind: "multisine".
        spacing: distance of the lines [Hz]; lines are at its multiples.
        lines: which multiples are driven: "all", "odd", or "odd-random": of three odd lines in a
            row one is left out at random.
        phases: "random", or "schroeder", which has low peaks.
        amplitude: amplitude of each line, in the same unit; instead of rms.
        realisations: number of realisations, with other phases.
        periods: periods of each realisation, where there are several.
    """

    kind: Literal["multisine"] = "multisine"
    sized: ClassVar[tuple[str, ...]] = ("rms", "amplitude")
    spacing: Annotated[Positive, Unit("Hz")]
    lines: Literal["all", "odd", "odd-random"] = "all"
    phases: Literal["random", "schroeder"] = "random"
    amplitude: Positive | None = None
    realisations: Count = 1
    periods: Count | None = None

    @model_validator(mode="after")
    def _has_lines(self) -> Self:
        """Check that there are lines, of a size, and realisations that differ."""
        self._require_one("rms", "amplitude")
        if (self.high - self.low) / self.spacing > _MOST_LINES:
            raise inconsistent("spacing", f"expected at most {_MOST_LINES} lines in the band")
        if not self.numbers.size:
            raise inconsistent(
                "spacing", f"expected lines from {self.low:g} to {self.high:g} Hz, given none"
            )
        if (self.periods is not None) != (self.realisations > 1):
            words = "expected none of one realisation: time.periods says it"
            text = "missing, but required of several realisations"
            raise inconsistent("periods", words if self.periods else text)
        if self.realisations > 1 and self.phases == "schroeder":
            raise inconsistent(
                "realisations", 'expected 1 with phases = "schroeder", which are always the same'
            )
        return self

    @property
    def numbers(self) -> IntArray:
        """Numbers of the driven lines, multiples of the spacing."""
        first = math.ceil(self.low / self.spacing * (1.0 - _LAST))
        last = math.floor(self.high / self.spacing * (1.0 + _LAST))
        return broadband.line_numbers(first, last, self.lines, self.seed)

    @property
    def is_periodic(self) -> bool:
        """Whether the excitation repeats after each period."""
        return self.realisations == 1

    @property
    def top_frequency(self) -> float:
        """Frequency whose period is divided into steps [Hz]: that of the highest line."""
        return float(self.numbers[-1]) * self.spacing

    @property
    def turns(self) -> int:
        """Number of periods of the highest line in one of the multisine."""
        return int(self.numbers[-1])

    @property
    def repeat_rate(self) -> Fraction:
        """Reciprocal of the time after which it repeats, as it is written [Hz]."""
        return Fraction(repr(self.spacing))

    @property
    def length(self) -> float | None:
        """Time that a run must cover [s]; None: that of the section `time`."""
        return None if self.periods is None else self.realisations * self.periods / self.spacing

    @property
    def size(self) -> str:
        """The size in words."""
        if self.rms is not None:
            return f"rms {self.rms:g} {_written(self.unit)}, {self.place}"
        return f"{self.amplitude:g} {_written(self.unit)} a line, {self.place}"

    @property
    def words(self) -> str:
        """The excitation in words, for titles."""
        each = f", {self.realisations} realisations" if self.realisations > 1 else ""
        return f"multisine {self.band}, {self.numbers.size} lines{each}, {self.size}"

    def realisation(self, number: int) -> Lines:
        """Return the prescribed value of a realisation, which counts from 0."""
        numbers = self.numbers
        size = self.amplitude or (self.rms or 0.0) * math.sqrt(2.0 / numbers.size)
        phases = broadband.phases(numbers.size, self.phases, self.seed, number)
        return Lines(numbers * self.spacing, size * np.exp(1j * phases))

    def course(self) -> Drive:
        """Return the drive."""
        values = [self.realisation(r).integrated(self.integrals) for r in range(self.realisations)]
        if self.acts_on == "base":
            values[0] = values[0].from_zero()
        if len(values) == 1:
            return values[0]
        return Realisations(values, (self.periods or 1) / self.spacing, 1.0 / self.spacing)


class _Random(_OfBand):
    """What random drives have in common.

    Attributes:
        rms: root mean square, in the unit of what is prescribed; the density is then flat.
        psd: table of the one-sided power spectral density, instead of rms: frequency [Hz], density
            in the unit squared per Hz; straight lines on logarithmic axes in between.
        duration: length of the run [s].
        seed: decides the motion.
    """

    duration: Annotated[Positive, Unit("s")]
    psd: FileName | None = None

    @model_validator(mode="after")
    def _has_size(self) -> Self:
        """Check that the size is given, and that the duration holds lines of the band."""
        self._require_one("rms", "psd")
        if math.floor(self.high * self.duration) < math.ceil(self.low * self.duration):
            raise inconsistent(
                "duration",
                f"expected one in which the band {self.band} has a line k/duration, given "
                f"{self.duration:g} s",
            )
        if self.high * self.duration > _MOST_RANDOM_LINES:
            raise inconsistent(
                "duration",
                f"expected at most {_MOST_RANDOM_LINES:g} periods of high, given "
                f"{self.high * self.duration:g}",
            )
        return self

    @property
    def is_periodic(self) -> bool:
        """Whether the excitation repeats after each period."""
        return False

    @property
    def turns(self) -> int:
        """Number of periods of the highest frequency in a hundredth of the run."""
        return max(1, math.ceil(self.high * self.duration / _RANDOM_PARTS))

    @property
    def size(self) -> str:
        """The size in words."""
        if self.psd is not None:
            return f"PSD of {self.psd.name}, {self.place}"
        return f"rms {self.rms:g} {_written(self.unit)}, {self.place}"

    @property
    def rise(self) -> float:
        """Time in which it comes [s]: a period of the lowest frequency, at most a tenth of all."""
        return min(1.0 / self.low, 0.1 * self.duration)

    def stationary(self) -> Gridded:
        """Return the displacement or force before it is faded in.

        Raises:
            CaseError: the table of the power spectral density cannot be used.
        """
        T = self.duration
        numbers = np.arange(math.ceil(self.low * T), math.floor(self.high * T) + 1)
        frequency = numbers / T
        if self.psd is None:
            density = np.ones(numbers.size)
        else:
            density = read_density(self.psd, self.unit, frequency)
        amplitude = broadband.random_amplitudes(density, T, self.seed)
        if self.rms is not None:
            amplitude *= self.rms / math.sqrt(0.5 * float(np.sum(np.abs(amplitude) ** 2)))
        amplitude = Lines(frequency, amplitude).integrated(self.integrals).amplitude
        return Gridded.of(numbers, amplitude, T)


class RandomExcitation(_Random):
    """A random motion of the base, or a random force, with a power spectral density in a band.

    It is normally distributed and begins smoothly from rest.

    Attributes:
        kind: "random".
    """

    kind: Literal["random"] = "random"

    @property
    def words(self) -> str:
        """The excitation in words, for titles."""
        return f"random {self.band}, {self.size}"

    def course(self) -> Drive:
        """Return the drive."""
        return Faded(self.stationary(), self.rise)


Share = Annotated[float, Field(strict=True, gt=0.0, lt=1.0), Expected("a number between 0 and 1")]


class BurstExcitation(_Random):
    """A random motion of the base, or a random force, in the first part of a run.

    Attributes:
        kind: "burst".
        share: part of the duration after which the drive is 0 [-].
        rms: root mean square while it lasts, in the unit of what is prescribed.
    """

    kind: Literal["burst"] = "burst"
    share: Annotated[Share, Unit("1")] = 0.5

    @property
    def words(self) -> str:
        """The excitation in words, for titles."""
        return f"burst {self.band}, {self.size}"

    def course(self) -> Drive:
        """Return the drive."""
        end = self.share * self.duration
        return Faded(self.stationary(), min(self.rise, 0.1 * end), end)


class RecordExcitation(_Prescribed):
    """A measured motion of the base or a measured force: one channel of a file.

    The file is a table with headings, or a NetCDF file that `delam-fem measure read` has written of
    any format. A run is as long as the record unless `time.duration` says less.

    Attributes:
        kind: "record".
        file: the file; a relative name counts from the case file.
        channel: name of the channel: heading of a column, or variable of a NetCDF file.
        high_pass: frequency below which the record is filtered away, without a shift of phase [Hz].
        in: what the channel is, where its unit does not say it: "displacement", "velocity" or
            "acceleration" of the base.
    """

    kind: Literal["record"] = "record"
    file: FileName
    channel: Annotated[str, Field(strict=True, min_length=1), Expected("a name")]
    high_pass: Annotated[Positive, Unit("Hz")] | None = None

    @property
    def size(self) -> str:
        """The amplitude in words: the record's name."""
        return f"{self.channel} of {self.file.name} on {self.place}"

    def series(self) -> tuple[FloatArray, FloatArray, str]:
        """Return times from 0 [s], values as they drive a run, and their SI unit.

        Raises:
            CaseError: the file or the channel cannot be used; see `read_channel`.
        """
        units = ("N",) if self.acts_on == "force" else tuple(_MOTION_UNITS.values())
        motion = getattr(self, "in")
        if motion is not None:
            units = (_MOTION_UNITS[motion],)
        time, value, unit = read_channel(self.file, self.channel, units)
        if self.high_pass is None:
            return time, value, unit
        step = time[-1] / (time.size - 1)
        if np.abs(np.diff(time) - step).max() > _UNEVEN * step:
            raise CaseError(
                f"excitation.file {self.file}: expected equal steps of time with "
                "excitation.high_pass, given others; resample the record"
            )
        if self.high_pass * step >= 0.5:
            raise CaseError(
                "excitation.high_pass: expected less than half the sampling rate "
                f"{1.0 / step:g} Hz, given {self.high_pass:g} Hz"
            )
        return time, broadband.high_passed(time, value, self.high_pass), unit


MOST_TURNS = 10_000
"""Longest common period of several drives, in periods of the highest frequency."""
_MOST_LINES = 100_000
"""Most lines of a multisine."""
_MOST_RANDOM_LINES = 1e6
"""Most lines of a random drive: its polynomials take 1.5 GB."""
_RANDOM_PARTS = 100
"""Parts of a run with a random drive; each stands for a period."""
_UNEVEN = 1e-3
"""Share of a step by which the steps of a record that is filtered may differ."""


_SQUARED = re.compile(r"\(?([\w/²]+?)\)?(?:\^|\*\*)?[2²]/Hz")
"""A unit squared per Hz, as densities have it: (m/s2)^2/Hz, g²/Hz."""
_OF_SQUARES = {"m/s": "m^2/s^2", "m/s2": "m^2/s^4", "m/s²": "m^2/s^4"}
"""Squares of units that are ratios."""


def read_density(path: Path, unit: str, frequency: FloatArray) -> FloatArray:
    """Read a power spectral density, and interpolate it on logarithmic axes.

    Args:
        path: table with the columns frequency and density; see `tables.read_columns`.
        unit: SI unit of what has the density.
        frequency: frequencies at which it is wanted, shape (k,) [Hz].

    Returns:
        Densities, shape (k,) [unit²/Hz].

    Raises:
        CaseError: the table cannot be read, does not cover the frequencies, or has numbers that are
            not positive.
    """
    name = f"excitation.psd {path}"
    columns = ("frequency", "density")
    table = read_columns(path, name, columns)
    squared = {"m": "m2/Hz", "m/s": "m2/s2/Hz", "m/s2": "m2/s4/Hz", "N": "N2/Hz"}[unit]
    power = _SQUARED.fullmatch(table.unit(1) or "")
    if power is not None:
        is_gravity = power[1] == "g" and unit == "m/s2"
        of = "g_0^2" if is_gravity else _OF_SQUARES.get(power[1], f"{power[1]}^2")
        table = replace(table, headings=(table.headings[0], f"density [{of}/Hz]"))
    (f, density), _ = in_si_units(table, columns, (("Hz",), (squared,)), name)
    require(f.size >= 2, name, "at least 2 rows", f.size)
    require(bool((np.diff(f) > 0.0).all()), name, "frequencies that increase", "others")
    least = float(min(f.min(), density.min()))
    require(least > 0.0, name, "frequencies and densities above 0", least)
    covered = f[0] <= frequency[0] * (1.0 + _LAST) and f[-1] >= frequency[-1] * (1.0 - _LAST)
    asked = f"frequencies from {frequency[0]:g} to {frequency[-1]:g} Hz"
    require(bool(covered), name, asked, f"{f[0]:g} to {f[-1]:g} Hz")
    return np.asarray(np.exp(np.interp(np.log(frequency), np.log(f), np.log(density))))


def read_channel(
    path: Path, channel: str, units: tuple[str, ...]
) -> tuple[FloatArray, FloatArray, str]:
    """Read one channel over time from a table with headings or a NetCDF file.

    Args:
        path: the file.
        channel: heading of the column, without its unit, or variable over time.
        units: SI units that it may have.

    Returns:
        Times from 0 [s], shape (k,); values, shape (k,); their SI unit.

    Raises:
        CaseError: the file has no such channel, or no time; its unit is another; times do not
            increase; or there are too few.
    """
    name = f"excitation.file {path}"
    if path.suffix == ".nc":
        table, columns = _of_netcdf(path, channel, name)
    else:
        table = read_columns(path, name)
        columns = _chosen(table, channel, name)
    chosen = replace(
        table,
        values=table.values[list(columns)],
        headings=tuple(table.headings[k] for k in columns),
    )
    (time, value), (_, unit) = in_si_units(chosen, ("time", channel), (("s",), units), name)
    require(time.size >= 6, name, "at least 6 rows", time.size)
    require(bool((np.diff(time) > 0.0).all()), name, "times that increase", "others")
    return time - time[0], value, unit


def _chosen(table: TableColumns, channel: str, name: str) -> tuple[int, int]:
    """Return the numbers of the columns of the time and of a channel."""
    names = [heading(text)[0] for text in table.headings]
    times = [k for k, word in enumerate(names) if word.lower() in ("time", "t", "zeit")]
    if not times:
        raise CaseError(f'{name}: expected a column with the heading "time", given {names}')
    if channel not in names:
        others = [word for k, word in enumerate(names) if k != times[0]]
        raise CaseError(
            f"excitation.channel: expected one of {', '.join(others) or 'none'}, given {channel!r}"
        )
    return times[0], names.index(channel)


def _of_netcdf(path: Path, channel: str, name: str) -> tuple[TableColumns, tuple[int, int]]:
    """Return time and a channel of a NetCDF file as a table of two columns."""
    import xarray as xr

    try:
        data = xr.load_dataset(path, engine="h5netcdf")
    except (OSError, ValueError, RuntimeError) as error:
        raise CaseError(f"{name}: cannot be read as NetCDF ({type(error).__name__})") from None
    over_time = {
        str(key): variable
        for key, variable in data.data_vars.items()
        if variable.ndim == 1 and str(variable.dims[0]).endswith("time")
    }
    if channel not in over_time:
        raise CaseError(
            f"excitation.channel: expected one of {', '.join(over_time) or 'none'}, given "
            f"{channel!r}"
        )
    variable = over_time[channel]
    time = data[variable.dims[0]].to_numpy()
    values = np.stack([time, variable.to_numpy()]).astype(np.float64)
    is_known = np.isfinite(values).all(axis=0)
    units = str(variable.attrs.get("units", ""))
    headings = ("time [s]", f"value [{units}]" if units else "value")
    lines = tuple(range(1, int(is_known.sum()) + 1))
    return TableColumns(lines, values[:, is_known], headings), (0, 1)


Single: TypeAlias = Annotated[
    HarmonicExcitation
    | SweepExcitation
    | ForceExcitation
    | HammerExcitation
    | TableExcitation
    | RandomExcitation
    | MultisineExcitation
    | BurstExcitation
    | RecordExcitation
    | NoExcitation,
    Field(discriminator="kind"),
]
"""A table `[excitation]`; its key `kind` says which."""


class SeveralExcitations(_Kind):
    """Drives that act at once, on the base and at points: [[excitation]] tables.

    Those at one place add up; each place has a course of its own. They repeat if all of them do and
    their periods have a common multiple of at most `MOST_TURNS` periods of the highest frequency.

    Attributes:
        kind: "several"; not written in a case file.
        each: the drives.
    """

    is_written: ClassVar[bool] = False

    kind: Literal["several"] = "several"
    each: tuple[Single, ...]

    @model_validator(mode="after")
    def _has_drives(self) -> Self:
        """Check that there are drives, and that each drives."""
        if not self.each:
            raise inconsistent("kind", "expected one or more [[excitation]] tables, given none")
        for number, one in enumerate(self.each, start=1):
            if isinstance(one, NoExcitation):
                raise inconsistent(f"{number}.kind", 'expected no "none" among several drives')
        return self

    @model_serializer(mode="wrap")
    def _to_tables(self, handler: SerializerFunctionWrapHandler) -> object:
        """Return the tables."""
        return handler(self)["each"]

    @property
    def acts_on(self) -> Target:
        """The base if one of them moves it, otherwise points."""
        target: Target = places_of(self)[0][0].acts_on
        return target

    @property
    def lamina(self) -> str | None:
        """Name of the lamina on which the force at the first place acts; None: the base moves."""
        return getattr(places_of(self)[0][0], "lamina", None)

    @property
    def position(self) -> float | tuple[float, float] | None:
        """Place of the point at which that force acts [m]."""
        return getattr(places_of(self)[0][0], "position", None)

    @property
    def is_harmonic(self) -> bool:
        """Whether the excitation is one sine."""
        return False

    @property
    def _common(self) -> int | None:
        """Number of periods of the highest frequency in the common period; None: there is none."""
        if not all(drive.is_periodic for drive in self.each):
            return None
        rates = [drive.repeat_rate for drive in self.each]
        below = math.lcm(*(rate.denominator for rate in rates))
        divisor = Fraction(math.gcd(*(int(rate * below) for rate in rates)), below)
        turns = max(rate * drive.turns for rate, drive in zip(rates, self.each, strict=True))
        turns /= divisor
        return int(turns) if turns <= MOST_TURNS else None

    @property
    def is_periodic(self) -> bool:
        """Whether the excitation repeats after each period."""
        return self._common is not None

    @property
    def turns(self) -> int:
        """Number of periods of `top_frequency` that make a period of a run."""
        return self._common or max(drive.turns for drive in self.each)

    @property
    def top_frequency(self) -> float:
        """Frequency whose period is divided into steps [Hz]; NaN if one of them has none."""
        return float(np.max([drive.top_frequency for drive in self.each]))

    @property
    def length(self) -> float | None:
        """Time that a run must cover [s]; None: that of the section `time`."""
        return max((drive.length for drive in self.each if drive.length), default=None)

    @property
    def size(self) -> str:
        """The sizes in words."""
        return " + ".join(drive.size for drive in self.each)

    @property
    def words(self) -> str:
        """The excitation in words, for titles: what they are, and the common period."""
        text = " + ".join(drive.words for drive in self.each)
        if not self.is_periodic:
            return f"{text}, no common period"
        return f"{text}, common period {self.turns / self.top_frequency:.6g} s"


def _place_of(given: Any) -> tuple[Any, ...]:
    """Return where a drive acts."""
    return (
        given.acts_on,
        *(getattr(given, key, None) for key in ("lamina", "position", "surface")),
    )


def place_in_words(given: Any) -> str:
    """Return where a drive acts, in words."""
    return "the base" if given.acts_on == "base" else str(given.place)


def _gathered(value: object) -> object:
    """Return [[excitation]] tables as one; a single one stands for itself."""
    if not isinstance(value, list | tuple):
        return value
    return value[0] if len(value) == 1 else {"kind": "several", "each": value}


Excitation: TypeAlias = Annotated[
    Annotated[
        HarmonicExcitation
        | SweepExcitation
        | ForceExcitation
        | HammerExcitation
        | TableExcitation
        | RandomExcitation
        | MultisineExcitation
        | BurstExcitation
        | RecordExcitation
        | NoExcitation
        | SeveralExcitations,
        Field(discriminator="kind"),
    ],
    BeforeValidator(_gathered),
]
"""The section `[excitation]`, or [[excitation]] tables that add up."""


def parts_of(given: Excitation) -> tuple[Excitation, ...]:
    """Return the drives of an excitation: itself, or those that add up."""
    return given.each if isinstance(given, SeveralExcitations) else (given,)


def places_of(given: Excitation) -> tuple[tuple[Excitation, ...], ...]:
    """Return the drives of an excitation by their places: the base first, then points in order."""
    groups: dict[tuple[Any, ...], list[Excitation]] = {}
    for one in parts_of(given):
        groups.setdefault(_place_of(one), []).append(one)
    first = sorted(groups, key=lambda place: place[0] != "base")
    return tuple(tuple(groups[place]) for place in first)


@dataclass(frozen=True, eq=False)
class Beside:
    """Drives at several places: each has a course of its own.

    Attributes:
        each: the drives, in the order of `places_of`.
    """

    each: tuple[Drive, ...]

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return value and two derivatives of one drive after the other, shape (k, 3 n)."""
        return np.concatenate([drive.states(times) for drive in self.each], axis=-1)


@dataclass(frozen=True, eq=False)
class Sum:
    """Drives that add up.

    Attributes:
        each: the drives.
    """

    each: tuple[Drive, ...]

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return value and two derivatives, shape (k, 3); see `Drive`."""
        return np.asarray(np.sum([drive.states(times) for drive in self.each], axis=0))


_LAST = 1e-9
"""Share of a table's length by which round-off may move the last step of a run."""


@dataclass(frozen=True)
class HalfSine:
    """The blow of a hammer: F sin(pi (t - start) / duration) while it lasts, 0 otherwise.

    Attributes:
        amplitude: F [N].
        duration: length of the blow [s].
        start: its beginning [s].
    """

    amplitude: float
    duration: float
    start: float = 0.0

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return force, rate and second derivative, shape (k, 3) [N, N/s, N/s2]."""
        since = np.asarray(times, dtype=np.float64) - self.start
        lasts = (since >= 0.0) & (since < self.duration)
        w = math.pi / self.duration
        sin = np.sin(w * since)
        cos = np.cos(w * since)
        course = self.amplitude * np.stack([sin, w * cos, -(w**2) * sin], axis=-1)
        return np.where(lasts[:, None], course, 0.0)


@dataclass(frozen=True)
class HarmonicMotion:
    """The motion A sin(2 pi f t).

    Attributes:
        frequency: f [Hz].
        amplitude: A [m].
    """

    frequency: float
    amplitude: float

    def __post_init__(self) -> None:
        """Refuse what is no motion with a CaseError."""
        is_frequency = math.isfinite(self.frequency) and self.frequency > 0.0
        require(is_frequency, "frequency", "a number above 0 [Hz]", self.frequency)
        require(math.isfinite(self.amplitude), "amplitude", "a finite number [m]", self.amplitude)

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return displacement, velocity and acceleration, shape (k, 3); see `Drive`."""
        t = np.asarray(times, dtype=np.float64)
        omega = 2.0 * math.pi * self.frequency
        return _states(self.amplitude, omega * t, np.full_like(t, omega), np.zeros_like(t))

    def instantaneous_frequency(self, times: npt.ArrayLike) -> FloatArray:
        """Return the constant frequency, same shape as `times` [Hz]."""
        return np.full_like(np.asarray(times, dtype=np.float64), self.frequency)


@dataclass(frozen=True)
class SweptMotion:
    """The motion A sin(phi(t)) with the frequency f(t) = phi'(t) / (2 pi).

        linear:       f(t) = f0 + (f1 - f0) t/T,  phi = 2 pi (f0 t + (f1 - f0) t^2 / (2 T))
        logarithmic:  f(t) = f0 e^(r t/T),        phi = 2 pi f0 T (e^(r t/T) - 1) / r,  r = ln f1/f0

    The frequency stays at f1 after t = T, because a run may end with a whole period after T.

    Attributes:
        start_frequency: f0 [Hz].
        end_frequency: f1 [Hz].
        duration: T [s].
        amplitude: A [m].
        logarithmic: whether the frequency changes logarithmically in time, not linearly.
        acceleration: a [m/s2]; if given, A = a / (2 pi f(t))^2 instead of `amplitude`. The
            acceleration then has the amplitude a but for terms of the order f'/f^2.
    """

    start_frequency: float
    end_frequency: float
    duration: float
    amplitude: float
    logarithmic: bool = False
    acceleration: float | None = None

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return displacement, velocity and acceleration, shape (k, 3); see `Drive`."""
        t = np.asarray(times, dtype=np.float64)
        rate = np.where(t > self.duration, 0.0, self._law(np.minimum(t, self.duration))[1])
        rotation = 2.0 * math.pi * self.instantaneous_frequency(t)
        amplitude = self.amplitude if self.acceleration is None else 1.0
        phi = 2.0 * math.pi * self.turns(t)
        sine = _states(amplitude, phi, rotation, 2.0 * math.pi * rate)
        if self.acceleration is None:
            return sine
        return product(self._amplitudes(rotation, 2.0 * math.pi * rate), sine)

    def _amplitudes(self, omega: FloatArray, rate: FloatArray) -> FloatArray:
        """Return A = a / omega^2 with two derivatives in time, shape (k, 3)."""
        r = math.log(self.end_frequency / self.start_frequency) / self.duration
        bend = r * rate if self.logarithmic else np.zeros_like(rate)  # omega''
        amplitude = (self.acceleration or 0.0) / omega**2
        slope = -2.0 * amplitude * rate / omega
        curvature = amplitude * (6.0 * (rate / omega) ** 2 - 2.0 * bend / omega)
        return np.stack([amplitude, slope, curvature], axis=-1)

    def turns(self, times: npt.ArrayLike) -> FloatArray:
        """Return phi(t) / (2 pi), same shape as `times` [-]."""
        t = np.asarray(times, dtype=np.float64)
        beyond = np.maximum(t - self.duration, 0.0)
        return self._law(np.minimum(t, self.duration))[0] + self.end_frequency * beyond

    def instantaneous_frequency(self, times: npt.ArrayLike) -> FloatArray:
        """Return f(t), same shape as `times` [Hz]."""
        share = np.minimum(np.asarray(times, dtype=np.float64) / self.duration, 1.0)
        f0, f1 = self.start_frequency, self.end_frequency
        return np.asarray(f0 * (f1 / f0) ** share if self.logarithmic else f0 + (f1 - f0) * share)

    def _law(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return phi / (2 pi) [-] and f' [Hz/s] at times t up to T, same shapes as t."""
        f0, f1, T = self.start_frequency, self.end_frequency, self.duration
        if not self.logarithmic:
            return t * (f0 + (f1 - f0) * t / (2.0 * T)), np.full_like(t, (f1 - f0) / T)
        r = math.log(f1 / f0)
        turns = f0 * T * np.expm1(r * t / T) / r if r else f0 * t
        return turns, self.instantaneous_frequency(t) * r / T


@dataclass(frozen=True)
class Tabulated:
    """A measured force [N], or a measured motion of the base [m].

    A force is interpolated by PCHIP, which does not overshoot between the rows; it is 0 after the
    last row. A displacement counts from its first value and is interpolated by a quintic spline.
    From accelerations, the displacement is their double integral that is 0 at both ends of the
    table, so that a base that vibrates does not drift away. From velocities it is their integral.

    Attributes:
        course: the force or the displacement.
        length: last time of the table [s].
        ends: whether the value is 0 afterwards; otherwise the last value stays.
    """

    course: scipy.interpolate.BSpline | scipy.interpolate.PchipInterpolator
    length: float
    ends: bool

    @classmethod
    def of(cls, time: FloatArray, value: FloatArray, unit: str) -> Tabulated:
        """Return the drive of a table of forces [N], displacements, velocities or accelerations."""
        length = float(time[-1])
        if unit == "N":
            return cls(scipy.interpolate.PchipInterpolator(time, value), length, ends=True)
        if unit == "m":
            course = scipy.interpolate.make_interp_spline(time, value - value[0], k=5)
            return cls(course, length, ends=False)
        if unit == "m/s":
            course = scipy.interpolate.make_interp_spline(time, value, k=5)
            return cls(course.antiderivative(), length, ends=False)
        velocity = scipy.interpolate.make_interp_spline(time, value, k=3).antiderivative()
        drift = velocity.integrate(0.0, length) / length
        # the functions of a spline add up to 1
        steady = scipy.interpolate.BSpline(velocity.t, velocity.c - drift, velocity.k)
        return cls(steady.antiderivative(), length, ends=False)

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return the value and two derivatives, shape (k, 3); see `Drive`."""
        t = np.asarray(times, dtype=np.float64)
        inside = np.clip(t, 0.0, self.length)
        course = np.stack([self.course(inside, nu=order) for order in range(3)], axis=-1)
        lasts = (t <= self.length * (1.0 + _LAST)) | (not self.ends)
        return np.where(lasts[:, None], course, 0.0)


class Drive(Protocol):
    """What makes the laminae move: a motion of the base, or a force at a point."""

    def states(self, times: npt.ArrayLike) -> FloatArray:
        """Return a value and its two derivatives at `times` of shape (k,) [s], shape (k, 3).

        The value is the displacement of the base [m], or the force [N]. Drives at n places have
        3 n columns, place after place (`Beside`).
        """
        ...


def drive(given: Excitation) -> Drive:
    """Return the course of an excitation.

    Raises:
        CaseError: the table of a tabulated drive cannot be used.
    """
    if isinstance(given, HarmonicExcitation | SweepExcitation):
        return base_motion(given)
    if isinstance(given, TableExcitation | RecordExcitation):
        return Tabulated.of(*given.series())
    if isinstance(given, MultisineExcitation | RandomExcitation | BurstExcitation):
        return given.course()
    if isinstance(given, NoExcitation):
        return Still()
    if isinstance(given, SeveralExcitations):
        places = [tuple(map(drive, group)) for group in places_of(given)]
        sums = tuple(group[0] if len(group) == 1 else Sum(group) for group in places)
        return sums[0] if len(sums) == 1 else Beside(sums)
    if isinstance(given, HammerExcitation):
        return HalfSine(given.amplitude, given.duration, given.start)
    if given.frequency is not None:
        return HarmonicMotion(given.frequency, given.amplitude)
    return swept_motion(given, given.amplitude)


def base_motion(given: Excitation) -> HarmonicMotion | SweptMotion:
    """Return the harmonic or swept motion of the base of an excitation.

    Raises:
        CaseError: the excitation is another one.
    """
    if isinstance(given, HarmonicExcitation):
        return HarmonicMotion(given.frequency, given.displacement_amplitude(given.frequency))
    if isinstance(given, SweepExcitation):
        return swept_motion(given, given.amplitude or 0.0, given.acceleration)
    raise CaseError(
        f"excitation.kind: expected 'harmonic' or 'sweep' of the base, given {given.kind!r}"
    )


def swept_motion(
    given: SweepExcitation | ForceExcitation, amplitude: float, acceleration: float | None = None
) -> SweptMotion:
    """Return the motion of the base, or the force at a point, that a sweep describes."""
    return SweptMotion(
        given.start_frequency or 0.0,
        given.end_frequency or 0.0,
        given.duration or 0.0,
        amplitude,
        logarithmic=given.spacing == "logarithmic",
        acceleration=acceleration,
    )


def _states(A: float, phi: FloatArray, rotation: FloatArray, change: FloatArray) -> FloatArray:
    """Return A sin(phi) and its derivatives, shape (k, 3); phi' is `rotation`, phi'' `change`."""
    sin = np.sin(phi)
    cos = np.cos(phi)
    return np.asarray(
        A * np.stack([sin, rotation * cos, change * cos - rotation**2 * sin], axis=-1)
    )

"""Define the section `[excitation]` of a case, and compute its course in time, with derivatives.

The excitation makes the laminae move: the base moves, or a force acts at a point of a lamina. Every
kind has the properties `acts_on`, `is_periodic`, `top_frequency` and `length`, so that other code
need not know the kinds; `drive` gives its course. Motions of the base start at t = 0 with the
displacement 0 but not with the velocity 0: the base starts abruptly while the laminae are at rest,
as in the paper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Protocol, Self, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy  # loads its parts when they are used
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
        return _product(self._amplitudes(rotation, 2.0 * math.pi * rate), sine)

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
    table, so that a base that vibrates does not drift away.

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
        """Return the drive of a table of forces [N], displacements [m] or accelerations [m/s2]."""
        length = float(time[-1])
        if unit == "N":
            return cls(scipy.interpolate.PchipInterpolator(time, value), length, ends=True)
        if unit == "m":
            course = scipy.interpolate.make_interp_spline(time, value - value[0], k=5)
            return cls(course, length, ends=False)
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

        The value is the displacement of the base [m], or the force [N].
        """
        ...


def drive(given: Excitation) -> Drive:
    """Return the course of an excitation.

    Raises:
        CaseError: the table of a tabulated drive cannot be used.
    """
    if isinstance(given, HarmonicExcitation | SweepExcitation):
        return base_motion(given)
    if isinstance(given, TableExcitation):
        return Tabulated.of(*read_series(given.file, given.acts_on))
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


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the product of two functions with its derivatives, shape (k, 3)."""
    first = a[:, 1] * b[:, 0] + a[:, 0] * b[:, 1]
    second = a[:, 2] * b[:, 0] + 2.0 * a[:, 1] * b[:, 1] + a[:, 0] * b[:, 2]
    return np.stack([a[:, 0] * b[:, 0], first, second], axis=-1)

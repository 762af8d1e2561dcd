"""Options of the studies, for Python and for the command line; nothing heavy is imported here.

A class holds the options of one command. Its docstring is the help of the command, and the rows of
`Attributes` are the help of the options.
"""

from __future__ import annotations

import math
import types
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args, get_origin, get_type_hints

from delam_fem.api import CaseError

O = TypeVar("O", bound="Options")  # noqa: E741


@dataclass(frozen=True)
class Flag:
    """How the command line spells an option, and which values it takes.

    Attributes:
        names: such as "-n" and "--number"; none: the name of the field with dashes.
        metavar: what stands for the value; None: the unit of the field, or its type.
        least, most: bounds of a number.
        is_joined: whether several values stand in one text with commas between them; otherwise
            the option is repeated.
        is_argument: whether the value stands behind the case, without a name.
        kind: type of a value, read from the field: float, int, str, Path or a `Literal`.
        is_several: whether the field takes several values.
    """

    names: tuple[str, ...] = ()
    metavar: str | None = None
    least: float = -math.inf
    most: float = math.inf
    is_joined: bool = False
    is_argument: bool = False
    kind: Any = str
    is_several: bool = False

    def checked(self, name: str, value: Any) -> Any:
        """Check a value of an option and return it in the type of its field, also from a text.

        Raises:
            CaseError: the value is not allowed.
        """
        if self.is_several:
            parts = value.split(",") if isinstance(value, str) else value
            return tuple(replace(self, is_several=False).checked(name, part) for part in parts)
        if isinstance(value, str | Path) and self.kind in (int, float, str, Path):
            with suppress(ValueError):
                value = self.kind(str(value).strip())
        expected, choices = (
            f"one of {', '.join(map(str, get_args(self.kind)))}",
            get_args(self.kind),
        )
        fits = value in choices or not choices
        if self.kind in (int, float):
            fits = isinstance(value, int if self.kind is int else int | float)
            fits = fits and self.least <= value <= self.most
            expected = f"a {'whole ' * (self.kind is int)}number"
            if math.isfinite(self.least):
                upper = f" and at most {self.most:g}" if math.isfinite(self.most) else ""
                expected += f" of at least {self.least:g}{upper}"
        if not fits:
            between = " (several: with commas between them)" if self.is_joined else ""
            raise CaseError(f"{name}: expected {expected}{between}, given {value!r}")
        return value


@dataclass(frozen=True, kw_only=True)
class Options:
    """Choices of a user, checked when they are made."""

    common: ClassVar[tuple[str, ...]] = ("resume", "overwrite")
    """Options that a command has besides its own; without any, it writes over earlier results."""

    def __post_init__(self) -> None:
        """Check each value that is given."""
        for name, flag in flags_of(type(self)).items():
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, flag.checked(name, value))

    @property
    def inputs(self) -> list[Path]:
        """Files of the user that are read."""
        found: Any = getattr(self, "measured", None) or ()
        return [found] if isinstance(found, Path) else list(found)

    def part(self, kind: type[O]) -> O:
        """Return the options that belong to a class which this one extends."""
        return kind(**{field.name: getattr(self, field.name) for field in fields(kind)})


def flags_of(kind: type[Options]) -> dict[str, Flag]:
    """Return how each option of a class is spelt and what it takes."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: _flag(hints[field.name]) for field in fields(kind)}


def _flag(hint: Any) -> Flag:
    """Return the flag of a field with a type, which may be optional."""
    flag: Flag
    kind, flag = get_args(hint) if get_origin(hint) is Annotated else (hint, Flag())
    if isinstance(kind, types.UnionType):
        kind = get_args(kind)[0]
    if get_origin(kind) is tuple:
        return replace(flag, kind=get_args(kind)[0], is_several=True)
    return replace(flag, kind=kind)


@dataclass(frozen=True, kw_only=True)
class Scan(Options):
    """How a structure is measured. The points are measured at once, or one by one with a trigger.

    Attributes:
        lamina: name of the lamina whose surface is measured; by default the thinner outermost one.
        spacing: distance of the points [m].
        first: position of the first point [m].
        quantity: what the sensor measures, absolute, in the fixed frame.
        sampling_rate: rate of samples [Hz], rounded to a whole number of samples per period of the
            excitation; by default 50 per period.
        periods: length of the record of a point.
        averages: number of records that are averaged.
        noise_db: overall root mean square of the signal over that of the noise [dB].
        noise_density: noise of the sensor instead, white up to half the sampling rate [m/s/√Hz or
            m/√Hz].
        seed: seed of the noise.
    """

    lamina: Annotated[str | None, Flag(metavar="NAME")] = None
    spacing: float = 0.01
    first: float = 0.0
    quantity: Literal["velocity", "displacement"] = "velocity"
    sampling_rate: float | None = None
    periods: Annotated[int, Flag(least=1)] = 16
    averages: Annotated[int, Flag(least=1)] = 1
    noise_db: float = 40.0
    noise_density: Annotated[float | None, Flag(metavar="D")] = None
    seed: Annotated[int, Flag(least=0)] = 1


@dataclass(frozen=True, kw_only=True)
class Measured(Options):
    """Files of measurements, and how they are read.

    Attributes:
        measured: files of measurements in place of simulated motions; repeatable.
        channels: what a column is, e.g. 'tip thick=col2:mm' or 'mid=Laser 3:mm/s@0.2/upper';
            repeatable.
        units: unit of columns that name none, e.g. mm; SI: SI units.
        rate: samples per second of files without times [Hz].
    """

    measured: Annotated[tuple[Path, ...] | None, Flag(metavar="FILE")] = None
    channels: Annotated[
        tuple[str, ...] | None, Flag(("--channel",), "NAME=SOURCE[:UNIT][@X[/LAMINA]]")
    ] = None
    units: Annotated[str | None, Flag(metavar="UNIT")] = None
    rate: float | None = None


@dataclass(frozen=True, kw_only=True)
class Detect(Scan, Measured):
    """Measure a case with and without its delaminations, and mark them by what clapping adds.

    Attributes:
        index: index that calls and locates.
        periods: length of the record of a point in periods.
        measured: measurement of the surface, which is judged instead of a simulated one;
            repeatable. --channel, --units and --rate as for `measure read`.
    """

    index: Literal["curvature", "V2", "V3", "V1/2", "distortion", "thd"] = "curvature"
    periods: Annotated[int, Flag(least=4)] = 16


@dataclass(frozen=True, kw_only=True)
class Excite(Options):
    """Recommend an excitation: how well each frequency shows the delaminations of a case.

    Attributes:
        lowest: first frequency [Hz].
        highest: last frequency [Hz].
        number: number of frequencies.
        noise_db: overall root mean square of the signal over that of the noise [dB].
        spacing: distance of the points [m].
    """

    common = ("workers", "resume", "overwrite")
    lowest: Annotated[float, Flag(("--from",))] = 40.0
    highest: Annotated[float, Flag(("--to",))] = 400.0
    number: Annotated[int, Flag(("-n", "--number"), least=1)] = 37
    noise_db: float = 40.0
    spacing: float = 0.01


@dataclass(frozen=True, kw_only=True)
class Pod(Options):
    """Find the probability of detection over length, depth and position; ROC curves.

    Attributes:
        frequencies: excitations that are compared [Hz].
        supports: supports at the end of the structure.
        noise_db: overall root mean square of the signal over that of the noise [dB].
    """

    common = ("workers", "resume", "overwrite")
    frequencies: Annotated[tuple[float, ...], Flag(is_joined=True)] = (92.0, 250.0, 365.0)
    supports: Annotated[tuple[str, ...], Flag(metavar="KIND", is_joined=True)] = ("clamped", "free")
    noise_db: Annotated[tuple[float, ...], Flag(is_joined=True)] = (40.0, 20.0)


RIG = Flag(metavar="KEY=LOW:HIGH")


@dataclass(frozen=True, kw_only=True)
class Infer(Measured):
    """Infer start, end and depth of a delamination from noisy scans: a posterior.

    Attributes:
        number: number of structures in the table.
        noise_db: overall root mean square of a simulated signal over that of the noise [dB].
        frequency: excitation of a scan [Hz]; repeatable.
        uncertain: in what the rig may differ from the case; 0.9x:1.1x are multiples of the case's
            own value; repeatable (default: stiffness ± 10 %, damping 0.5x:2x, clamps that yield).
        measured: scan of the surface, a file per frequency, instead of simulated ones.
            --channel, --units and --rate as for `measure read`.
    """

    common = ("workers", "resume", "overwrite")
    number: Annotated[int, Flag(("-n", "--number"), least=100)] = 5000
    noise_db: float = 40.0
    frequency: tuple[float, ...] = (92.0, 250.0)
    uncertain: Annotated[tuple[str, ...] | None, RIG] = None


@dataclass(frozen=True, kw_only=True)
class Modulate(Options):
    """Excite a case at two frequencies, and show the sidebands that its delaminations make.

    Attributes:
        pump_frequency: low frequency beside that of the excitation [Hz].
        pump_amplitude: its amplitude in the case's own unit: m, m/s2 or N.
        spacing: distance of the points [m].
        periods: common periods of the record.
        noise_db: overall root mean square of the signal over that of the noise [dB].
        seed: seed of the noise.
    """

    pump_frequency: float
    pump_amplitude: Annotated[float, Flag(metavar="A", least=0)]
    spacing: float = 0.01
    periods: Annotated[int, Flag(least=1)] = 4
    noise_db: float = 40.0
    seed: Annotated[int, Flag(least=0)] = 1


@dataclass(frozen=True, kw_only=True)
class Tap(Measured):
    """Tap along a lamina with the impactor of a case, and mark where taps last longer.

    Attributes:
        lamina: lamina that is tapped (default: the thinner outermost one).
        spacing: distance of the taps [m].
        first: position of the first tap [m].
        noise_db: largest force of a tap over the root mean square of its noise [dB].
        seed: seed of the noise.
        measured: forces of taps at points of the lamina, instead of simulated ones; repeatable.
            --channel, --units and --rate as for `measure read`.
    """

    common = ("overwrite",)
    lamina: Annotated[str | None, Flag(metavar="NAME")] = None
    spacing: float = 0.01
    first: float = 0.0
    noise_db: float = 40.0
    seed: Annotated[int, Flag(least=0)] = 1


@dataclass(frozen=True, kw_only=True)
class Modes(Options):
    """List natural frequencies; laminae that are apart are compared with the exact cantilever.

    Attributes:
        number: modes per lamina or structure.
        delaminations: laminae pass through one another, or are kept together.
    """

    common = ()
    number: Annotated[int, Flag(("-n", "--number"), "N")] = 6
    delaminations: Literal["free", "closed"] = "free"


@dataclass(frozen=True, kw_only=True)
class Compare(Options):
    """Compare a case with an independent reference, or as beams, solids and reduced to modes.

    Attributes:
        models: models that are compared, as beam,plane-stress,solid,modes; the last reduces the
            one before it. Without this option: compare with the reference.
        at: with --models: frequencies [Hz]; repeatable.
        impacts: compare with the reference up to this impact.
        periods: periods of each run (default: 3, with --models 20).
        modes: modes of a reduced model.
    """

    common = ()
    models: Annotated[tuple[str, ...] | None, Flag(metavar="NAMES", is_joined=True)] = None
    at: Annotated[tuple[float, ...], Flag(least=0)] = ()
    impacts: Annotated[int, Flag(metavar="N")] = 20
    periods: Annotated[int | None, Flag(metavar="N")] = None
    modes: Annotated[int, Flag(metavar="N", least=1)] = 20


@dataclass(frozen=True, kw_only=True)
class OfOrbits(Options):
    """How orbits are sought.

    Attributes:
        period: periods of the drive in one of the orbit.
        kick: size of kicks, relative to the state (default: 0.02; massless contact points: 0.03).
        seed: seed of the fixed perturbations.
    """

    period: Annotated[int, Flag(metavar="P")] = 1
    kick: Annotated[float | None, Flag(metavar="X", least=1e-6, most=0.5)] = None
    seed: Annotated[int, Flag(metavar="N")] = 0


@dataclass(frozen=True, kw_only=True)
class Orbit(OfOrbits):
    """Find the periodic orbit of a case and judge its stability; write DIR/orbit.json.

    Attributes:
        settle: periods computed before the search starts.
    """

    settle: Annotated[int, Flag(metavar="N", least=0)] = 300


@dataclass(frozen=True, kw_only=True)
class Continue(OfOrbits):
    """Follow the orbits of a case over a key; write DIR/branch.nc and its diagram.

    Attributes:
        start: value where to start, as 9.5 or "9.5 Hz".
        stop: other end of the range.
        key: key of the case to vary.
        doublings: how often branches of twice the period are followed.
        step: first steps, relative to state and range.
        over: result of a sweep over the key, drawn behind: its folder.
    """

    start: Annotated[str, Flag(("--from",), "X")]
    stop: Annotated[str, Flag(("--to",), "X")]
    key: Annotated[str, Flag(metavar="KEY", is_argument=True)] = "excitation.frequency"
    doublings: Annotated[int, Flag(least=0)] = 1
    step: Annotated[float, Flag(least=1e-4, most=0.5)] = 0.04
    over: Annotated[Path | None, Flag(metavar="SWEEP")] = None


@dataclass(frozen=True, kw_only=True)
class Resonance(Options):
    """Identify frequency, damping and EI of each lamina from the swept sine of a case.

    Attributes:
        measured: tips in a swept sine; by default the case simulates it.
        noise: standard deviation of a sample [m].
        seed: seed of the noise.
    """

    measured: Annotated[Path | None, Flag(metavar="FILE")] = None
    noise: Annotated[float, Flag(least=0)] = 0.0
    seed: Annotated[int, Flag(least=0)] = 1


@dataclass(frozen=True, kw_only=True)
class Identify(Options):
    """Identify keys of a case from clapping motions, as a joint posterior.

    Attributes:
        unknown: a key that is sought; repeatable.
        frequency: frequency of a motion [Hz]; repeatable.
        measured: tips of a motion, one file per frequency; by default the case simulates them.
        noise: standard deviation of a sample [m].
        uncertain: in what the rig may differ from the case; 0.9x:1.1x are multiples of the case's
            own value; repeatable (default: stiffness ± 10 %, damping 0.5x:2x, clamps that yield).
        simulations: number of simulations.
        calibrate: number of simulations that check the intervals.
        seed: seed of the noise and of the prior.
    """

    common = ("workers", "resume", "overwrite", "dry_run", "yes")
    unknown: Annotated[tuple[str, ...], RIG]
    frequency: tuple[float, ...]
    measured: Annotated[tuple[Path, ...] | None, Flag(metavar="FILE")] = None
    noise: Annotated[float, Flag(least=0)] = 1e-4
    uncertain: Annotated[tuple[str, ...] | None, RIG] = None
    simulations: Annotated[int, Flag(least=100)] = 2000
    calibrate: Annotated[int, Flag(least=0)] = 100
    seed: Annotated[int, Flag(least=0)] = 1


@dataclass(frozen=True, kw_only=True)
class Natural(Options):
    """Identify keys of a case over time from one of its natural frequencies.

    Attributes:
        measured: what measure response --free has written.
        unknown: a key that is sought; repeatable.
        mode: number of the mode.
        uncertain: in what the rig may differ from the case, as for identify keys; repeatable.
        simulations: number of cases from the prior.
        seed: seed of the prior and of the noise.
    """

    common = ()
    measured: Annotated[Path, Flag(metavar="FILE")]
    unknown: Annotated[tuple[str, ...], RIG]
    mode: Annotated[int, Flag(least=1)] = 1
    uncertain: Annotated[tuple[str, ...] | None, RIG] = None
    simulations: Annotated[int, Flag(least=50)] = 300
    seed: Annotated[int, Flag(least=0)] = 1


@dataclass(frozen=True, kw_only=True)
class Converge(Options):
    """Refine a case, and show to which limit, how fast and at what cost each method converges.

    Attributes:
        direction: what to refine; points: contact points inside the elements; both: every mesh
            with every number of steps.
        laws: contact laws with their schemes, e.g. newton@moreau-jean, maybe with /lumped or
            /consistent (default: five of them; beside elastic stops penalty).
        elements: elements per lamina (default: 5,10,…,160).
        meshes: mesh files instead of elements, coarse first.
        points: contact points per element (default: 1,2,4,8).
        steps: steps per period (default: 250,500,…,16000).
        periods: periods in the statistics.
        limit_steps: steps per period of the rigid limit; 0, or with elastic stops: no limit.
        engine: engine that computes the steps.
        judged: numbers that the verdict is about: tip_min, tip_max, amplitude (of the drive's
            frequency), modal_impulse; others are not judged (default: tip_min,tip_max).
    """

    common = ("workers", "resume", "overwrite", "dry_run", "yes")
    direction: Annotated[Literal["elements", "points", "steps", "both"], Flag(("--in",))] = "steps"
    laws: Annotated[tuple[str, ...] | None, Flag(metavar="LAW,…", is_joined=True)] = None
    elements: Annotated[tuple[int, ...] | None, Flag((), "N,…", 1, is_joined=True)] = None
    meshes: Annotated[tuple[Path, ...] | None, Flag(metavar="FILE,…", is_joined=True)] = None
    points: Annotated[tuple[int, ...] | None, Flag((), "P,…", 1, is_joined=True)] = None
    steps: Annotated[tuple[int, ...] | None, Flag((), "N,…", 1, is_joined=True)] = None
    periods: Annotated[int, Flag(least=1)] = 60
    limit_steps: Annotated[int, Flag(least=0)] = 64000
    engine: Literal["petsc", "compiled"] = "compiled"
    judged: Annotated[tuple[str, ...] | None, Flag(("--judge",), "NAME,…", is_joined=True)] = None

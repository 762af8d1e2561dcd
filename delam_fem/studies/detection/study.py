"""Options of the studies that look for delaminations; nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from delam_fem.api import Flag, Kinds, Options, Study
from delam_fem.studies.identification.study import RIG

if TYPE_CHECKING:
    from delam_fem.studies.detection.detect import Detection
    from delam_fem.studies.detection.excitation import ExcitationMap
    from delam_fem.studies.detection.infer import Inferred
    from delam_fem.studies.detection.modulation import Modulation
    from delam_fem.studies.detection.population import PodStudy
    from delam_fem.studies.detection.tap import Taps


@dataclass(frozen=True, kw_only=True)
class Measured(Options):
    """Files of measurements, and how they are read.

    Attributes:
        measured: files of measurements in place of simulated motions; repeatable.
        channels: what a column is, e.g. 'tip thick=col2:mm' or 'mid=Laser 3:mm/s@0.2/upper';
            repeatable.
        units: unit of columns that name none, e.g. mm; SI: SI units.
        rate: samples per second of files without times [Hz].
        positions: table with the columns x and z of the points of a plate, in the order of the
            columns of the measurement.
    """

    measured: Annotated[tuple[Path, ...] | None, Flag(metavar="FILE")] = None
    channels: Annotated[
        tuple[str, ...] | None, Flag(("--channel",), "NAME=SOURCE[:UNIT][@X[:Z][/LAMINA]]")
    ] = None
    units: Annotated[str | None, Flag(metavar="UNIT")] = None
    rate: float | None = None
    positions: Annotated[Path | None, Flag(metavar="FILE")] = None


@dataclass(frozen=True, kw_only=True)
class Scan(Options):
    """How a structure is measured. The points are measured at once, or one by one with a trigger.

    Attributes:
        lamina: name of the lamina whose surface is measured; by default the thinner outermost one.
        spacing: distance of the points [m]; of a plate, along both axes.
        first: position of the first point on a beam [m].
        modes: number of modes that a plate is reduced to.
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
    modes: Annotated[int, Flag(least=1)] = 60
    quantity: Literal["velocity", "displacement"] = "velocity"
    sampling_rate: float | None = None
    periods: Annotated[int, Flag(least=1)] = 16
    averages: Annotated[int, Flag(least=1)] = 1
    noise_db: float = 40.0
    noise_density: Annotated[float | None, Flag(metavar="D")] = None
    seed: Annotated[int, Flag(least=0)] = 1


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
        lowest: first frequency [Hz] (default: 40; of a plate a quarter of its lowest defect
            resonance).
        highest: last frequency [Hz] (default: 400; of a plate 1.25 times that).
        number: number of frequencies.
        noise_db: overall root mean square of the signal over that of the noise [dB].
        spacing: distance of the points [m]; of a plate, along both axes.
        modes: number of modes that a plate is reduced to.
    """

    common = ("workers", "resume", "overwrite")
    lowest: Annotated[float | None, Flag(("--from",))] = None
    highest: Annotated[float | None, Flag(("--to",))] = None
    number: Annotated[int, Flag(("-n", "--number"), least=1)] = 37
    noise_db: float = 40.0
    spacing: float = 0.01
    modes: Annotated[int, Flag(least=1)] = 60


@dataclass(frozen=True, kw_only=True)
class Pod(Options):
    """Find the probability of detection over length, depth and position; ROC curves.

    Attributes:
        frequencies: excitations that are compared [Hz] (default: 92,250,365; of a plate that of the
            case).
        supports: supports at the end of a beam (default: clamped,free).
        lengths: of the delaminations over that of the beam, of patches over the shorter side of the
            plate (default: 0.05 to 0.4; 0.1 to 0.5).
        depths: of the delaminations over the thickness (default: 0.15,0.3,0.45).
        noise_db: overall root mean square of the signal over that of the noise [dB].
        spacing: distance of the points [m]; of a plate, along both axes.
        modes: number of modes that plates are reduced to.
    """

    common = ("workers", "resume", "overwrite")
    frequencies: Annotated[tuple[float, ...] | None, Flag(is_joined=True)] = None
    supports: Annotated[tuple[str, ...] | None, Flag(metavar="KIND", is_joined=True)] = None
    lengths: Annotated[tuple[float, ...] | None, Flag(metavar="SHARE", is_joined=True)] = None
    depths: Annotated[tuple[float, ...] | None, Flag(metavar="SHARE", is_joined=True)] = None
    noise_db: Annotated[tuple[float, ...], Flag(is_joined=True)] = (40.0, 20.0)
    spacing: float = 0.01
    modes: Annotated[int, Flag(least=1)] = 60


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


NOT_REDUCED = Kinds(
    ("beam", "plane-stress", "solid"),
    "the file of a reduced model has its delaminations; give the case that was reduced",
)
"""Kinds of model whose delaminations can be taken away."""
HOME = "delam_fem.studies.detection"
OF_SWEEPS = "delam_fem.studies.sweeps.dataset:remove_results"
DETECT: Study[Detect, Detection] = Study(
    Detect,
    f"{HOME}.detect:compute",
    "Data",
    "detect scan",
    takes=NOT_REDUCED,
    needs="delamination",
    has_checkpoints=True,
)
EXCITE: Study[Excite, ExcitationMap] = Study(
    Excite,
    f"{HOME}.excitation:compute",
    "Data",
    "detect excite",
    remove=OF_SWEEPS,
    takes=NOT_REDUCED,
    needs="delamination",
)
POD: Study[Pod, PodStudy] = Study(
    Pod,
    f"{HOME}.population:compute",
    "Data",
    "detect pod",
    remove=OF_SWEEPS,
    takes=NOT_REDUCED,
)
INFER: Study[Infer, Inferred] = Study(
    Infer,
    f"{HOME}.infer:compute",
    "Data",
    "detect infer",
    remove=OF_SWEEPS,
    takes=NOT_REDUCED,
    takes_plates=False,
)
MODULATE: Study[Modulate, Modulation] = Study(
    Modulate,
    f"{HOME}.modulation:modulation",
    "Data",
    "detect modulate",
    takes=NOT_REDUCED,
    takes_plates=False,
    has_checkpoints=True,
)
TAP: Study[Tap, Taps] = Study(
    Tap,
    f"{HOME}.tap:tap",
    "Data",
    "detect tap",
    takes=NOT_REDUCED,
    takes_plates=False,
    needs="delamination",
    takes_impactors=True,
    shares_factors=True,
)

"""Detect a delamination: measure a case with and without it, and mark where the indices are large.

In Python:

    import delam_fem as df
    found = df.detect(df.preset("embedded"), spacing=0.005)
    found.marks["curvature"].start
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.api import (
    Case,
    CaseError,
    Finding,
    FloatArray,
    Picture,
    Report,
    RunContext,
    Table,
    assemble,
    by_period,
    digest,
    drive,
    identity,
    keeping_closed,
    load_case,
    modes_of,
    number,
    read_points,
    reduced_case,
    response,
    scanned_places,
    scheme_of,
    session,
    span_of,
    style,
)
from delam_fem.studies.detection.indices import (
    CONFIDENCE,
    FALSE_CALLS,
    INDICES,
    SHARE,
    Mark,
    Repeated,
    mark,
    repeated,
)
from delam_fem.studies.detection.maps import middle_of, patches_of, plate_pictures
from delam_fem.studies.detection.region import Region
from delam_fem.studies.detection.study import Detect, Measured, Scan
from delam_fem.studies.linear import settling_periods, steady_motion
from delam_fem.studies.signals import reading
from delam_fem.studies.signals.comparison import strongest_frequency
from delam_fem.studies.signals.scan import (
    ORDERS,
    ComplexArray,
    Points,
    Shapes,
    at_points,
    points_of,
    positions_of,
    scan_field,
    shapes_of,
    surface_of,
)

SAMPLES = 50
"""Samples per period, unless a sampling rate is given: contact adds orders beyond the second and
third, which must not fold back onto them."""
LEAST_STEPS = 100
"""Steps per period below which contact is not resolved (docs/evidence/convergence.md)."""
SLOWEST = 0.125
"""Share of the excitation's frequency below which a motion is that of the surroundings. Clapping
repeats after two or four periods, seldom after eight."""
SAME_FREQUENCY, UNCERTAIN = 0.01, 0.001
"""Relative difference between the drive frequencies of a record and its case that may be one of
clocks, and periods by which both may part over the record and count as the same."""


def samples_of(scan: Scan, frequency: float) -> int:
    """Return the number of samples per period.

    Raises:
        CaseError: fewer than five, so that the second harmonic is not seen.
    """
    if scan.sampling_rate is None:
        return SAMPLES
    n = round(scan.sampling_rate / frequency)
    if n < 5:
        raise CaseError(
            f"sampling rate: expected at least 5 samples per period of {frequency:g} Hz, given "
            f"{scan.sampling_rate:g} Hz"
        )
    return n


@dataclass(frozen=True)
class Measurement:
    """A field of velocities or displacements on a lamina, measured or simulated.

    Attributes:
        times: shape (k,) [s].
        x: positions, shape (n,) [m].
        field: velocity or displacement, shape (k, n) [m/s or m].
        frequency: frequency of the excitation [Hz].
        z: positions across a plate, shape (n,) [m]; None: along a beam.
    """

    times: FloatArray
    x: FloatArray
    field: FloatArray
    frequency: float
    z: FloatArray | None = None

    @property
    def rms(self) -> float:
        """Root mean square over all times and points."""
        return float(np.sqrt(np.mean(self.field**2)))

    def noise_of(self, scan: Scan) -> float:
        """Return the root mean square of the noise in an averaged sample of this field."""
        if scan.noise_density is None:
            single = self.rms * 10.0 ** (-scan.noise_db / 20.0)
        else:
            single = scan.noise_density * math.sqrt(
                0.5 * samples_of(scan, self.frequency) * self.frequency
            )
        return float(single / math.sqrt(scan.averages))

    def noisy(self, noise: float | FloatArray, seed: int) -> Measurement:
        """Return the measurement with white noise of a root mean square, one or one per point."""
        added = np.random.default_rng(seed).normal(scale=noise, size=self.field.shape)
        return replace(self, field=self.field + added)


def simulated(
    case: Case,
    scan: Scan,
    kept: Path | None = None,
    *,
    pump: Case | None = None,
    left: float = 0.001,
) -> Measurement:
    """Compute the motion of a case and return the field that a sensor without noise would measure.

    The run begins with the linear motion of the closed structure. The record, its last periods,
    begins when little of a free motion of the lowest mode would be left, or later if the case has
    more periods. Samples are at ends of steps: the number of steps per period is raised to a
    multiple of the samples per period.

    Args:
        case: the case, with a harmonic excitation.
        scan: how to measure.
        kept: folder for a checkpoint, from which the run goes on; None: none is kept.
        pump: the same case with a lower frequency, which acts at once; the periods of the scan are
            then common periods of both, so that no spectral line leaks.
        left: share of a free motion of the lowest mode that may be left when the record begins.

    Raises:
        CaseError: the excitation is not harmonic, the lamina does not exist, the scan has no
            points, or the motion diverges.
    """
    if not case.is_harmonic:
        raise CaseError('detect: expected a harmonic excitation, given another "excitation.kind"')
    f = case.excitation.top_frequency
    tones = [case] if pump is None else [pump, case]
    turns = 1 if pump is None else common_turns(pump.excitation.top_frequency, f)
    samples = samples_of(scan, f)
    points = points_of(case, scan.spacing, scan.first)
    N = samples * math.ceil(max(case.time.steps_per_period, LEAST_STEPS) / samples)
    structure = assemble(case, needs_dolfinx=False)
    periods = math.ceil(settling_periods(case, left) / turns) + scan.periods
    span = replace(
        span_of(case),
        time_step=1.0 / (N * f),
        steps_per_period=N * turns,
        periods=periods if pump is not None else max(case.n_periods, periods),
        window_periods=scan.periods,
        frames_per_period=samples * turns,
    )
    table = np.sum(
        [by_period(drive(tone.excitation), span, is_periodic=True)(0) for tone in tones], axis=0
    )
    motions = [steady_motion(tone, structure) for tone in tones]
    closed = [solution for solution in motions if solution is not None]
    motion = np.sum([solution.motion for solution in closed], axis=0)
    start = replace(closed[0], motion=motion) if closed else None
    with session(
        structure.operators, case.contact_law, scheme_of(case), lambda _: table, span,
        initial=start, modes=modes_of(case),
    ) as opened:  # fmt: skip
        beside = None if pump is None else identity(pump)
        outcome = opened.run_with_checkpoints(kept, case, span=span, pump=beside)
        if outcome != "completed":
            raise CaseError(f"detect: the motion of case {case.name} has {outcome}")
        times, u, v = scan_field(opened.recorder, structure, surface_of(case, scan.lamina), points)
    x, z = positions_of(points)
    return Measurement(times, x, v if scan.quantity == "velocity" else u, f, z)


def with_scan(case: Case, scan: Scan, measured: Measurement | None = None) -> Case:
    """Return a plate with the scan that it is measured with; other cases as they are.

    Args:
        case: the case.
        scan: how it is measured, where the case has no [scan] of its own.
        measured: a measured field, whose points are taken; None: simulate.

    Raises:
        CaseError: the case has a [scan] of its own, and options say another one, or the points are
            not on the plate.
    """
    if not case.is_plate:
        return case
    if measured is not None and measured.z is not None:
        points = np.stack([measured.x, measured.z], axis=1).tolist()
        lamina = surface_of(case, scan.lamina)
        return case.with_overrides({"scan.points": points, "scan.lamina": lamina})
    plain = Scan()
    if scan.first != plain.first:
        raise CaseError(
            f"first: expected none on a plate, whose grid is in its middle, given {scan.first:g} m"
        )
    if case.scan is None:
        keys: dict[str, object] = {"scan.spacing": scan.spacing}
        if scan.lamina is not None:
            keys["scan.lamina"] = scan.lamina
        return case.with_overrides(keys)
    if (scan.spacing, scan.lamina) != (plain.spacing, plain.lamina):
        raise CaseError(
            "spacing: expected none beside the [scan] of the case, nor a lamina; give it there, as "
            "in --set scan.spacing=0.005"
        )
    return case


def in_modes(case: Case, modes: int, folder: Path, *, resume: bool = False) -> Case:
    """Return a plate as a model of modes, which is computed in seconds; other cases as they are.

    Args:
        case: the case, with its scan.
        modes: number of normal modes.
        folder: folder of models, each of which has a folder of its own; see `folder_of_model`.
        resume: whether to take the model that is in the folder, if there is one.

    Raises:
        CaseError: the case cannot be reduced.
    """
    if not case.is_plate or case.model.file is not None:
        return case
    model = folder_of_model(case, modes, folder)
    file = model / "case.toml"
    if not (resume and file.is_file()):
        model.mkdir(parents=True, exist_ok=True)
        reduced_case(case, modes).save(model)
    return load_case(file)


def folder_of_model(case: Case, modes: int, folder: Path) -> Path:
    """Return the folder of the model of modes of a case, which no other case has."""
    return folder / digest(identity(case, modes=modes))


def common_turns(pump: float, probe: float) -> int:
    """Return the number of periods of a frequency in a common period with a lower one."""
    return (Fraction(str(probe)) / Fraction(str(pump))).numerator


def drive_responses(
    case: Case, lamina: str, points: Points, frequency: float, orders: Sequence[float] = ORDERS
) -> dict[float, ComplexArray]:
    """Return the linear responses of points to harmonics of the drive above the first, by order.

    Delaminations are closed, and the drive has a unit amplitude. Each shape (n_points,).
    """
    structure = assemble(case, needs_dolfinx=False)
    base = np.array([1.0 if case.excitation.acts_on == "base" else 0.0, 0.0])
    responses = {}
    S = keeping_closed(structure)
    for k in orders:
        if k > 1.0:
            U = response(structure.operators, k * frequency, S)
            real, imag = at_points(structure, lamina, points, np.stack([U.real, U.imag]), base)
            responses[k] = real + 1j * imag
    return responses


def read_field(
    files: Sequence[Path], options: Measured, quantity: str, lamina: str
) -> xr.DataArray:
    """Return a quantity at the points of a lamina from files of measurements."""
    data = reading.read_measured(
        *files,
        channels=reading.assigned(options.channels),
        units=options.units,
        rate=options.rate,
    )
    if options.positions is not None:
        places = read_points(options.positions, f"positions {options.positions}")
        data = reading.placed(data, quantity, lamina, places)
    return reading.scan(data, quantity, lamina)


def read_scan(files: Sequence[Path], options: Measured, case: Case, scan: Scan) -> Measurement:
    """Return the field in files of measurements.

    The frequency of the field is that at which the record moves most, so that a clock that is a
    little wrong does no harm.

    Args:
        files: files with the histories of points along a lamina.
        options: how the files are read.
        case: case with the excitation of the record.
        scan: gives the lamina and the quantity.

    Raises:
        CaseError: fewer than five points are measured, or the record is of another frequency.
    """
    dataset = read_field(files, options, scan.quantity, surface_of(case, scan.lamina))
    field = dataset.to_numpy()
    x = dataset["position"].to_numpy()
    z = _across(dataset) if case.is_plate else None
    if z is None and (x.size < 5 or not np.all(np.diff(x) > 0.0)):
        raise CaseError(
            f"measured: expected {scan.quantity} at 5 or more different positions on the lamina "
            f"{surface_of(case, scan.lamina)!r}, given {x.tolist()}"
        )
    is_complete = np.isfinite(field).all(axis=1)
    times = dataset["time"].to_numpy()[is_complete]
    drive = case.excitation.top_frequency
    frequency = strongest_frequency(times, field[is_complete].T, SLOWEST * drive) or drive
    if abs(frequency / drive - 1.0) > SAME_FREQUENCY:
        raise CaseError(
            f"measured: expected a record of {drive:.6g} Hz, the excitation of case {case.name}, "
            f"given one of {frequency:.6g} Hz; was it --set excitation.frequency={frequency:.6g}?"
        )
    is_same = abs(frequency - drive) * (times[-1] - times[0]) < UNCERTAIN
    return Measurement(times, x, field[is_complete], drive if is_same else frequency, z)


def _across(field: xr.DataArray) -> FloatArray:
    """Return the places across a plate of the points of a measured field, shape (n,) [m].

    Raises:
        CaseError: a point has none.
    """
    across = field["across"].to_numpy()
    if not np.isfinite(across).all():
        names = field["channel"].to_numpy()[~np.isfinite(across)].tolist()
        raise CaseError(
            "measured: expected points of a plate with x and z, as in "
            "--channel 'p1=P1:m/s@0.01:-0.02/upper', or --positions FILE, given none across of "
            f"{', '.join(names[:3])}"
        )
    return np.asarray(across)


def intact(case: Case) -> Case:
    """Return the case without its delaminations: one bonded beam or plate on the same supports.

    Raises:
        CaseError: the case is a single lamina, which cannot be delaminated.
    """
    if len(case.lamina) == 1:
        raise CaseError(
            "delamination: expected a case with [[delamination]], to compare it with the intact "
            "structure, given a single lamina"
        )
    data = tomllib.loads(case.to_toml())
    for key in ("delamination", "gap"):
        data.pop(key, None)
    data["support"] = case.support.model_dump(exclude_none=True)
    return Case.checked(data, f"case {case.name} without delaminations")


INTACT_SEED = 1_000_003
"""Added to the seed, so that the intact beam has noise of its own."""


@dataclass(frozen=True)
class Detection(Finding):
    """A measurement and what the indices say of it.

    Attributes:
        case: the case that was measured.
        scan: how it was measured.
        is_measured: whether the field comes from a file.
        index: name of the index that calls and locates.
        shapes: of the measurement, with its noise.
        marks: what each index says, by name.
        intact_marks: the same of the intact structure.
        repeated: ends and calls over repeated noise.
        sample_noise: root mean square of the noise in a sample [m/s or m].
    """

    case: Case
    scan: Scan
    is_measured: bool
    index: str
    shapes: Shapes
    marks: Mapping[str, Mark]
    intact_marks: Mapping[str, Mark]
    repeated: Repeated
    sample_noise: float

    @property
    def mark(self) -> Mark:
        """Mark of the index that calls and locates."""
        return self.marks[self.index]

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Start and end of each delamination of the case [m]."""
        if self.case.gap is not None:
            return [(0.0, self.case.length)]
        return [(delamination.start, delamination.end) for delamination in self.case.delamination]

    @property
    def is_plate(self) -> bool:
        """Whether a plate was scanned."""
        return self.shapes.z is not None

    @property
    def patches(self) -> Region:
        """The delaminations of the case in the plan of the plate."""
        return patches_of(self.case)

    @property
    def overlap(self) -> float:
        """Common area of marked region and delaminations over that of both together [-]."""
        return self.mark.region.overlap(self.patches)

    def contrast(self, name: str) -> float:
        """Return the largest value within the delaminations over that outside; NaN without any.

        Of a measured scan it is that of the marked interval or region, as nobody knows where the
        delamination is.
        """
        if (index_mark := self.marks[name]).z is not None:
            inside = self.mark.region if self.is_measured else self.patches
            return index_mark.contrast_of(inside.contains(index_mark.x, index_mark.z))
        if self.is_measured:
            mark = self.marks[name]
            return mark.contrast(mark.start, mark.end)
        if not self.spans:
            return math.nan
        starts, ends = zip(*self.spans, strict=True)
        return self.marks[name].contrast(min(starts), max(ends))

    @property
    def verdict(self) -> str:
        """Sentences on what was called, where, and with what uncertainty."""
        main, again = self.mark, self.repeated
        at = f"At {self.shapes.frequency:g} Hz the index {self.index}"
        if not main.is_detected:
            less = 100.0 * (1.0 - again.calls)
            return f"{at} calls nothing; it does so in {less:.0f} % of repetitions."
        intact = "is" if self.intact_marks[self.index].is_detected else "is not"
        if self.is_plate:
            x, z = middle_of(main.region)
            low, high = 1e4 * again.area
            return (
                f"{at} marks {1e4 * main.region.area:.3g} cm² about ({x:.4g}, {z:.4g}) m. Over "
                f"repeated noise it calls {100.0 * again.calls:.0f} %, with "
                f"{100.0 * CONFIDENCE:.0f} % of the marked areas from {low:.3g} to {high:.3g} cm². "
                f"The same plate without delamination {intact} called"
                f"{', too' * (intact == 'is')}."
            )
        return (
            f"{at} marks {main.start:.4g} to {main.end:.4g} m. Over repeated noise it calls "
            f"{100.0 * again.calls:.0f} %. With {100.0 * CONFIDENCE:.0f} % each, the true start "
            f"lies within {again.start[0]:.4g}…{again.start[1]:.4g} m and the end within "
            f"{again.end[0]:.4g}…{again.end[1]:.4g} m (noise and spacing of the points). "
            f"The same structure without delamination {intact} called{', too' * (intact == 'is')}."
        )

    @property
    def _of_plate(self) -> dict[str, Any]:
        """Numbers of the report that plates alone have."""
        if not self.is_plate:
            return {}
        region = self.mark.region
        return {
            "region": [outline.tolist() for outline in region.outlines],
            "area": region.area,
            "area_bounds": [_number(value) for value in self.repeated.area],
            "patches": [outline.tolist() for outline in self.patches.outlines],
            "overlap": None if self.is_measured else self.overlap,
        }

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal; lengths in m."""
        main, again = self.mark, self.repeated
        indices = {
            name: {
                "detected": index_mark.is_detected,
                "start": _number(index_mark.start),
                "end": _number(index_mark.end),
                "contrast": _number(self.contrast(name)),
                "intact_called": self.intact_marks[name].is_detected,
                "x": index_mark.x.tolist(),
                **({} if index_mark.z is None else {"z": index_mark.z.tolist()}),
                "values": index_mark.values.tolist(),
                "limits": index_mark.limits.tolist(),
            }
            for name, index_mark in self.marks.items()
        }
        numbers = {
            "case": self.case.name,
            "frequency": self.shapes.frequency,
            "index": self.index,
            "detected": main.is_detected,
            "start": _number(main.start),
            "end": _number(main.end),
            "start_bounds": [_number(value) for value in again.start],
            "end_bounds": [_number(value) for value in again.end],
            "call_rate": again.calls,
            "contrast": _number(self.contrast(self.index)),
            "intact_called": self.intact_marks[self.index].is_detected,
            "false_call_rate": FALSE_CALLS,
            "is_measured": self.is_measured,
            "delaminations": [list(span) for span in self.spans],
            **self._of_plate,
            "sample_noise": self.sample_noise,
            "shape_noise": _rms(self.shapes.noise),
            "scan": asdict(self.scan) | {"lamina": surface_of(self.case, self.scan.lamina)},
            "indices": indices,
        }
        rows = [
            (
                name,
                "yes" if index_mark.is_detected else "no",
                number(index_mark.start),
                number(index_mark.end),
                number(self.contrast(name), ".1f"),
                "yes" if self.intact_marks[name].is_detected else "no",
            )
            for name, index_mark in self.marks.items()
        ]
        return Report(
            name="detection",
            numbers=numbers,
            case=self.case,
            title=f"Detection in {self.case.name}",
            tables=[Table(f"indices of case {self.case.name}", HEADING, rows)],
            sentences=[self.verdict],
            pictures=plate_pictures(self) if self.is_plate else _pictures(self),
        )


HEADING = ("index", "detected", "start [m]", "end [m]", "contrast", "intact called")
"""Heading of the table of indices."""


def detect(
    case: Case,
    options: Detect | None = None,
    *,
    measured: Measurement | None = None,
    repetitions: int = 200,
    kept: Path | None = None,
) -> Detection:
    """Measure a case with and without its delaminations, and compute all indices.

    Args:
        case: the case, with [[delamination]] and a harmonic excitation.
        options: how it is measured, and the index that calls and locates; None: the defaults.
        measured: a measured field in place of a simulated one. The intact structure is still
            simulated, with the noise that the field shows between its harmonics.
        repetitions: number of repetitions of the noise, for the bounds.
        kept: folder for checkpoints, from which the runs go on; None: none are kept.

    Raises:
        CaseError: the case, the scan or the record is not valid.
    """
    options = options or Detect()
    scan = options.part(Scan)
    index = options.index
    if case.is_apart:
        raise CaseError("detect: expected a case with [[delamination]], given laminae apart")
    scanned = with_scan(case, scan, measured)
    surface = surface_of(case, scan.lamina)
    with TemporaryDirectory() as scratch:
        folder = Path(scratch) if kept is None else kept
        resume = kept is not None
        intact_case = in_modes(intact(scanned), scan.modes, folder, resume=resume)
        without = simulated(intact_case, scan, kept)

        def shapes(own: Measurement) -> Shapes:
            points = own.x if own.z is None else scanned_places(intact_case)
            responses = drive_responses(intact_case, surface, points, own.frequency)
            try:
                extracted = shapes_of(own.field, own.times, own.frequency, own.x, z=own.z)
            except ValueError as error:  # the record is too short
                raise CaseError(str(error)) from None
            return extracted.without_drive(responses)

        noise: float | FloatArray
        if measured is None:
            pure = simulated(in_modes(scanned, scan.modes, folder, resume=resume), scan, kept)
            noise = pure.noise_of(scan)
            scan_shapes = shapes(pure.noisy(noise, scan.seed))
            clean = replace(shapes(pure), noise=per_shape(noise, pure.times.size))
        else:
            clean = scan_shapes = shapes(measured)
            noise = per_sample(scan_shapes.noise, measured.times.size)
        there: float | FloatArray = noise  # at the same points of a plate
        if without.z is None:
            of_points = np.broadcast_to(noise, scan_shapes.x.shape)
            there = np.interp(without.x, scan_shapes.x, of_points)
        intact_shapes = shapes(without.noisy(there, scan.seed + INTACT_SEED))
    return Detection(
        case,
        scan,
        measured is not None,
        index,
        scan_shapes,
        _marks(scan_shapes),
        _marks(intact_shapes),
        repeated(index, clean, clean.noise, repetitions=repetitions, seed=scan.seed),
        _rms(noise),
    )


def _rms(noise: float | FloatArray) -> float:
    """Return the root mean square of a noise over all points."""
    return float(np.sqrt(np.mean(np.square(noise))))


def per_shape(sample_noise: float | FloatArray, n_samples: int) -> float | FloatArray:
    """Return the root mean square of |δV| of a shape V that white noise in n samples leads to.

    V = 2/n Σ v exp(-iωt), so E|δV|² = 4 σ²/n.
    """
    return 2.0 * sample_noise / math.sqrt(n_samples)


def per_sample(shape_noise: float | FloatArray, n_samples: int) -> float | FloatArray:
    """Return the noise σ in a sample that belongs to a noise of the shapes; see `per_shape`."""
    return 0.5 * shape_noise * math.sqrt(n_samples)


def _marks(shapes: Shapes) -> dict[str, Mark]:
    """Return the mark of each index; those whose orders were not sampled are left out."""
    needed = {"V3": 3.0, "V1/2": 0.5}
    names = [name for name in INDICES if needed.get(name, 2.0) in shapes.orders]
    return {name: mark(name, shapes) for name in names}


def _number(value: float) -> float:
    """Return a number without digits of round-off."""
    return float(f"{value:.10g}")


TITLES = {
    "curvature": "2f-curvature  |V₂″|",
    "V2": "|V₂|",
    "V3": "|V₃|",
    "V1/2": "|V½|",
    "distortion": "distortion d",
    "thd": "THD",
}


def _pictures(found: Detection) -> dict[str, Picture]:
    """Return the pictures of a beam with their captions."""
    return {
        "figures/detection": (
            lambda: detection_figure(found),
            "The index that calls, with its limit of noise and 30 % of its largest value. "
            "Grey: the delamination of the case. Red bars above: bounds of the true ends.",
        ),
        "figures/indices": (
            lambda: indices_figure(found),
            "All indices. The limit is what noise alone exceeds anywhere in 1 of 100 beams.",
        ),
        "figures/shapes": (
            lambda: shapes_figure(found),
            "Complex shapes at the excitation and at twice its frequency.",
        ),
    }


def beside_intact(case: Case, own: Mark, whole: Mark, *, title: str, **look: Any) -> Figure:
    """Draw an index along the beam, that of the intact structure, and the limit of noise."""
    figure, (axes,) = style.stacked(1, 4.0)
    for d in case.delamination:
        axes.axvspan(
            d.start, d.end, color=style.GAP_COLOUR, alpha=0.25, lw=0.0, label="delamination"
        )
    axes.plot(own.x, own.values, "o-", color=style.VERMILLION, ms=3, label="with it")
    axes.plot(whole.x, whole.values, "o-", color=style.BLUE, ms=3, label="without it")
    axes.plot(own.x, own.limits, "--", color=style.GREEN, label="limit of noise")
    axes.set(xlabel="x [m]", **look)
    axes.set_title(title, loc="left")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    return figure


def detection_figure(found: Detection) -> Figure:
    """Draw the index that calls, with and without the delamination, and the marked interval."""
    figure, panels = style.stacked(2, 6.0, sharex=True)
    for axes, index_mark, text in (
        (panels[0], found.mark, "measured" if found.is_measured else "with the delamination"),
        (panels[1], found.intact_marks[found.index], "the same structure without delamination"),
    ):
        _spans(axes, found)
        _index(axes, index_mark)
        called = (
            f"called, {index_mark.start:.4g} to {index_mark.end:.4g} m"
            if index_mark.is_detected
            else "not called"
        )
        axes.set_title(f"{text}: {called}", loc="left")
        axes.set_ylabel(TITLES[found.index])
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    style.label_x(panels, "x [m]")
    again = found.repeated
    if np.isfinite(again.start).all():
        for bounds in (again.start, again.end):
            panels[0].axvspan(*bounds, ymin=0.94, color=style.VERMILLION, alpha=0.6)
    figure.suptitle(f"{found.case.name}, {found.shapes.frequency:g} Hz", x=0.01, ha="left")
    return figure


def indices_figure(found: Detection) -> Figure:
    """Draw all indices with their limits."""
    figure, panels = style.side_by_side(len(found.marks), 2.3, above=0.6, sharex=True)
    for axes, (name, index_mark) in zip(panels, found.marks.items(), strict=True):
        _spans(axes, found)
        _index(axes, index_mark)
        contrast = found.contrast(name)
        more = f", contrast {contrast:.1f}" if np.isfinite(contrast) else ""
        axes.set_title(TITLES[name] + more, loc="left")
    style.label_x(panels, "x [m]")
    style.legend_outside(figure, panels[0], 5, "outside upper right")
    return figure


def shapes_figure(found: Detection) -> Figure:
    """Draw real and imaginary part of the shapes at f and 2f."""
    figure, panels = style.stacked(2, 5.0, sharex=True)
    unit = "m/s" if found.scan.quantity == "velocity" else "m"
    for axes, order in zip(panels, (1.0, 2.0), strict=True):
        _spans(axes, found)
        V = found.shapes.order(order)
        V = V * np.exp(-1j * np.angle(V[np.abs(V).argmax()]))
        axes.plot(found.shapes.x, V.real, color=style.BLUE, marker=".", label="in phase")
        axes.plot(found.shapes.x, V.imag, color=style.GREEN, marker=".", label="out of phase")
        axes.set_ylabel(f"V at {order * found.shapes.frequency:g} Hz [{unit}]")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    style.label_x(panels, "x [m]")
    return figure


def _spans(axes: Axes, found: Detection) -> None:
    """Shade the delaminations of the case."""
    for k, (start, end) in enumerate(found.spans):
        axes.axvspan(start, end, color=style.GAP_COLOUR, label=None if k else "delamination")


def _index(axes: Axes, own: Mark) -> None:
    """Draw an index with its limit and its marks."""
    x, values, marked = own.x, own.values, own.is_marked
    axes.plot(x, values, color=style.BLUE, marker=".", label="index")
    axes.plot(x[marked], values[marked], "o", color=style.VERMILLION, label="marked")
    axes.plot(x, own.limits, color=style.BASE_COLOUR, linestyle="--", label="limit of noise")
    axes.axhline(
        SHARE * values.max(), color=style.BASE_COLOUR, linestyle=":", label="30 % of the largest"
    )
    top = np.median(own.limits)
    if values.max() > 20.0 * top > 0.0 or own.limits.max() > 3.0 * values.max():
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0)


def compute(case: Case, options: Detect, context: RunContext) -> Detection:
    """Detect with options of a user."""
    measured = (
        read_scan(options.measured, options, case, options.part(Scan)) if options.measured else None
    )
    return detect(case, options, measured=measured, kept=context.checkpoints)

"""Compute many structures with a delamination, and the probability that it is detected.

The structures are points of a sweep: each gives the shapes of a scan. Noise is added to the shapes
afterwards, so that one run serves any noise. The journal of the sweep makes a study resumable, and
any executor can compute it.

Probability of detection (POD): hit or miss over length, depth and position; ROC curves. A specimen
is a hit if the index calls it and marks an interval, or on a plate a region, that overlaps its
delamination. The length of a patch is the root of its area. Each patch needs a mesh of its own,
which is reduced to modes once. The logistic
regression of hits on ln a follows MIL-HDBK-1823A (appendix G): POD(a) = 1 / (1 + exp(-β₀ - β₁ ln
a)); a90 is the length a at which it is 0.9, a90/95 that at which its lower 95 % bound is 0.9.
"""

from __future__ import annotations

import logging
import math
import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import ndtri

from delam_fem.api import (
    BoolArray,
    Case,
    CaseError,
    Finding,
    FloatArray,
    Report,
    RunContext,
    Table,
    digest,
    scanned_places,
    style,
)
from delam_fem.studies.detection.detect import (
    drive_responses,
    in_modes,
    intact,
    per_shape,
    simulated,
    with_scan,
)
from delam_fem.studies.detection.indices import Mark, curvature, mark
from delam_fem.studies.detection.maps import patches_of
from delam_fem.studies.detection.study import Pod, Scan
from delam_fem.studies.executors import ExecutorName
from delam_fem.studies.linear import settling_periods
from delam_fem.studies.signals.scan import Shapes, shapes_of, surface_of
from delam_fem.studies.sweeps.grid import Axis, Record, ScanRecord, Sweep
from delam_fem.studies.sweeps.run import completed

PERIODS, SAMPLES = 16, 50
"""Number of periods of a record, and of samples per period."""
ELEMENTS, STEPS = 20, 100
"""Mesh and steps per period of the runs; 40 and 500 mark the same intervals (docs/detection.md)."""
SETTLED = 0.05
"""Share of a free motion of the lowest mode that may be left. Runs start from the closed motion, so
that the free motion is a small part from the first period on."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Specimen:
    """A structure with one delamination, and its excitation.

    Attributes:
        start, end: edges of the delamination [m].
        thickness: thickness of the lamina that is measured, the depth of the delamination [m].
        support: support at the end of the structure: "clamped", "free" or "pinned"; of a plate
            `AS_GIVEN`.
        frequency: frequency of the excitation [Hz].
        across: edges of a patch along z [m]; None: a beam.
    """

    start: float
    end: float
    thickness: float
    support: str
    frequency: float
    across: tuple[float, float] | None = None

    @property
    def length(self) -> float:
        """Length of the delamination, of a patch the root of its area in a rectangle [m]."""
        along = self.end - self.start
        return (
            along if self.across is None else math.sqrt(along * (self.across[1] - self.across[0]))
        )

    def keys(self, case: Case) -> dict[str, object]:
        """Return the keys of a case with this delamination that are not those of the case."""
        surface = surface_of(case, None)
        other = next(lamina.name for lamina in case.lamina if lamina.name != surface)
        keys: dict[str, object] = {
            "delamination.1.start": self.start,
            "delamination.1.end": self.end,
            f"lamina.{surface}.thickness": self.thickness,
            f"lamina.{other}.thickness": case.thickness - self.thickness,
        }
        if self.across is not None:
            low, high = self.across
            keys |= {"delamination.1.across.1": low, "delamination.1.across.2": high}
        return keys

    def is_hit(self, called: Mark, overlap: float) -> bool:
        """Return whether something is called, and overlaps this delamination; see `overlap`."""
        if self.across is not None:
            return overlap > 0.0
        return called.is_detected and called.start <= self.end and called.end >= self.start

    def overlap(self, case: Case, called: Mark) -> float:
        """Return the overlap of the marked region with this patch of a case [-].

        It is NaN of beams, and where nothing is called.
        """
        if self.across is None or not called.is_detected:
            return math.nan
        return called.region.overlap(patches_of(case.with_overrides(self.keys(case))))


@dataclass(frozen=True)
class Population:
    """The shapes of many specimens.

    Attributes:
        specimens: the structures.
        x: positions of the points of the scan, shape (n,) [m].
        orders: orders of the shapes.
        values: complex shapes without noise, NaN where a run failed, shape (n_specimens, n_orders,
            n) [m/s].
        rms: overall root mean square of each field, shape (n_specimens,) [m/s].
        z: positions of the points across plates, shape (n,) [m]; None: along beams.
        intact: model of the plate without a patch; None: beams.
    """

    specimens: tuple[Specimen, ...]
    x: FloatArray
    orders: tuple[float, ...]
    values: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
    rms: FloatArray
    z: FloatArray | None = None
    intact: Case | None = None

    def shapes(
        self, index: int, noise_db: float | FloatArray, rng: np.random.Generator,
        n_lines: float = math.inf,
    ) -> Shapes:  # fmt: skip
        """Return the shapes of a specimen as a noisy sensor measures them.

        Args:
            index: number of the specimen.
            noise_db: overall root mean square of the field over that of the noise, of all points
                or of each [dB].
            rng: source of the noise.
            n_lines: spectral lines that the noise is estimated from.
        """
        single = self.rms[index] * 10.0 ** (-noise_db / 20.0)
        frequency = self.specimens[index].frequency
        pure = Shapes(self.x, frequency, self.orders, self.values[index], z=self.z)
        return pure.noisy(per_shape(single, PERIODS * SAMPLES), rng, n_lines)

    def at_first(self, n: int | None) -> Population:
        """Return the population as scans of the first n points show it; None: of all points."""
        values = self.values[..., :n]
        # Re(V e^{iωt}) has the mean square |V|² / 2
        rms = np.sqrt(0.5 * np.sum(np.mean(np.abs(values) ** 2, axis=-1), axis=-1))
        return self if n is None else replace(self, x=self.x[:n], values=values, rms=rms)


def population(
    case: Case,
    specimens: Sequence[Specimen],
    directory: str | Path,
    executor: Executor | ExecutorName | None = None,
    *,
    name: str = "population",
    spacing: float = 0.01,
    first: float = 0.0,
    modes: int = 60,
    also: Mapping[str, FloatArray] | None = None,
    **sweeping: Any,
) -> Population:
    """Compute the shapes of all specimens as a sweep in a folder; see `run_sweep`.

    Args:
        case: two laminae with one delamination; the specimens replace its edges, the thicknesses,
            the support at the end and the frequency.
        specimens: the structures.
        directory: folder of the sweep.
        executor: "process", "mpi", "serial", or an executor of `concurrent.futures`.
        name: name of the sweep.
        spacing: distance of the scanned points [m].
        first: position of the first of them [m].
        modes: number of modes that plates are reduced to.
        also: values of further keys of the case, one for each specimen.
        sweeping: further arguments of `run_sweep`.

    Raises:
        CaseError: the case is not as described, or see `run_sweep`.
        KeyboardInterrupt: the sweep was interrupted; `resume` goes on.
    """
    if len(case.lamina) != 2 or len(case.delamination) != 1:
        raise CaseError(
            "population: expected a case with two laminae and one [[delamination]], given "
            f"{len(case.lamina)} and {len(case.delamination)}"
        )
    surface = surface_of(case, None)
    columns: dict[str, list[Any]] = {}
    for specimen in specimens:
        for key, value in specimen.keys(case).items():
            columns.setdefault(key, []).append(value)
    if case.is_plate:
        plate = with_scan(case, Scan(spacing=spacing, first=first))
        resume = bool(sweeping.get("resume", False))
        folder = Path(directory) / f"modes-{modes}"
        bonded = in_modes(intact(plate), modes, folder, resume=resume)
        structures = {AS_GIVEN: bonded}
        models = _models(plate, specimens, modes, folder, resume=resume)
        columns["model.file"] = [str(model.model.file) for model in models]
        base = models[0]
        record = ScanRecord()
    else:
        bonded = None
        kinds = sorted({specimen.support for specimen in specimens})
        structures = {kind: intact(case.with_overrides({"support.end": kind})) for kind in kinds}
        columns["support.end"] = [specimen.support for specimen in specimens]
        base = case.with_overrides({"mesh.elements": ELEMENTS})
        record = ScanRecord(lamina=surface, spacing=spacing, first=first)
    settling = {
        kind: settling_periods(structure, SETTLED) / case.excitation.top_frequency
        for kind, structure in structures.items()
    }
    columns |= {
        "excitation.frequency": [specimen.frequency for specimen in specimens],
        "time.periods": [
            PERIODS + math.ceil(settling[specimen.support] * specimen.frequency)
            for specimen in specimens
        ],
        **{key: values.tolist() for key, values in (also or {}).items()},
    }
    axes = [
        Axis(key=key, name=key.replace(".", "_"), values=tuple(values))
        for key, values in columns.items()
    ]
    data = scanned(name, base, axes, record, Path(directory), executor=executor, **sweeping)
    values = data["scan_real"].to_numpy() + 1j * data["scan_imag"].to_numpy()
    is_sampled = np.isfinite(values).any(axis=(0, 2))
    return Population(
        tuple(specimens),
        data["scan_x"].to_numpy(),
        tuple(data["order"].to_numpy()[is_sampled].tolist()),
        values[:, is_sampled],
        data["scan_rms"].to_numpy(),
        data["scan_z"].to_numpy() if case.is_plate else None,
        bonded,
    )


def _models(
    plate: Case, specimens: Sequence[Specimen], modes: int, folder: Path, *, resume: bool
) -> list[Case]:
    """Return the model of modes of each specimen; specimens with the same patch share one.

    Args:
        plate: the plate, with its scan.
        specimens: the structures.
        modes: number of modes.
        folder: folder of the models.
        resume: whether to take models that are in the folder.
    """
    models: dict[str, Case] = {}
    names = []
    for specimen in specimens:
        patched = plate.with_overrides(specimen.keys(plate))
        name = digest(patched.to_toml())
        names.append(name)
        if name not in models:
            models[name] = in_modes(patched, modes, folder, resume=resume)
    return [models[name] for name in names]


def scanned(
    name: str, case: Case, axes: Sequence[Axis], scan: ScanRecord, directory: Path, **sweeping: Any
) -> xr.Dataset:
    """Return the dataset of scans of many motions that begin with their linear steady motion.

    Args:
        name: name of the sweep that computes them.
        case: base case of the sweep.
        axes: axes whose k-th values belong together.
        scan: the points that are kept.
        directory: folder of the sweep.
        sweeping: further arguments of `run_sweep`.

    Raises:
        CaseError: a value of an axis is not valid, no motion was completed, or see `run_sweep`.
        KeyboardInterrupt: the sweep was interrupted; `resume` goes on.
    """
    fast = {
        "time.steps_per_period": STEPS,
        "output.window_periods": PERIODS,
        "output.fields_per_period": SAMPLES,
    }
    sweep = Sweep(
        case.with_overrides(fast), {}, name=name, combine="zip", start="steady",
        axis=axes, record=Record(summary=False, strobes=0, scan=scan),
    )  # fmt: skip
    data = completed(sweep, directory, is_confirmed=True, **sweeping)
    reasons = data["error"].to_numpy()[data["outcome"].to_numpy() != "completed"]
    if reasons.size:
        text = f"{name}: {reasons.size} of {sweep.n_points} motions failed: {reasons[0]}"
        if reasons.size == sweep.n_points:
            raise CaseError(text)
        _log.warning("%s; they show nothing", text)
    return data


AS_GIVEN = "as given"
"""Support of plates: that of the case."""
LENGTHS = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40)
"""Lengths of the delaminations of the grid over the length of the beam, a/L."""
DEPTHS = (0.15, 0.30, 0.45)
"""Depths of the grid over the thickness of the beam."""
MIDDLES = (0.25, 0.375, 0.5, 0.625, 0.75)
"""Middles of the delaminations of the grid over the length of the beam."""
SIZES = (0.1, 0.2, 0.3, 0.4, 0.5)
"""Sizes of the patches of the grid over the shorter side of the plate."""
PLACES = ((0.5, 0.5), (0.35, 0.7))
"""Middles of the patches of the grid over length and width of the plate."""
FREQUENCIES = (92.0, 250.0, 365.0)
"""Excitations of beams [Hz]."""
SUPPORTS = ("clamped", "free")
"""Supports at the end of beams."""
INTACT = 200
"""Number of noisy intact beams that count false calls."""
_BOUND = 0.95


@dataclass(frozen=True)
class Curve:
    """A POD curve with its lower bound.

    Attributes:
        beta: β₀, β₁; NaN where the regression has no solution.
        covariance: of β, shape (2, 2).
    """

    beta: FloatArray
    covariance: FloatArray

    def pod(self, a: FloatArray, level: float = 0.5) -> FloatArray:
        """Return the probability of detection of lengths a, same shape.

        Args:
            a: lengths, shape (n,) [m].
            level: confidence of a one-sided lower bound (Wald, on the logit); 0.5: the curve.
        """
        columns = np.stack([np.ones_like(a), np.log(a)], axis=-1)
        spread = np.sqrt(np.einsum("...i,ij,...j->...", columns, self.covariance, columns))
        logit = columns @ self.beta - ndtri(level) * spread
        return np.asarray(0.5 * (1.0 + np.tanh(0.5 * logit)))

    def length(self, probability: float, level: float = 0.5) -> float:
        """Return the length at which the POD, or its lower bound, reaches a probability; NaN: none.

        Args:
            probability: probability of detection, for example 0.9.
            level: confidence of the bound; 0.5: the curve itself.
        """
        if not np.isfinite(self.beta).all() or self.beta[1] <= 0.0:
            return math.nan
        middle = float(-self.beta[0] / self.beta[1])
        a = np.exp(np.linspace(middle - 5.0, middle + 5.0, 20_001))
        above = np.flatnonzero(self.pod(a, level) >= probability)
        return float(a[above[0]]) if above.size else math.nan


def logistic(a: FloatArray, hit: BoolArray) -> Curve:
    """Return the logistic regression of hits on ln a.

    Without misses, without hits, or with lengths that separate both, it has no solution: NaN.

    Args:
        a: lengths, shape (n,) [m].
        hit: whether each was a hit, shape (n,).
    """
    from statsmodels.api import GLM, families

    nothing = Curve(np.full(2, np.nan), np.full((2, 2), np.nan))
    if hit.all() or not hit.any() or a[hit].min() > a[~hit].max():
        return nothing
    columns = np.stack([np.ones_like(a), np.log(a)], axis=-1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = GLM(hit.astype(np.float64), columns, family=families.Binomial()).fit()
    if not np.isfinite(fit.bse).all():
        return nothing
    return Curve(np.asarray(fit.params), np.asarray(fit.cov_params()))


def grid(
    case: Case,
    supports: Sequence[str],
    frequencies: Sequence[float],
    lengths: Sequence[float] = LENGTHS,
    depths: Sequence[float] = DEPTHS,
) -> list[Specimen]:
    """Return the specimens of the grid: supports, frequencies, lengths, depths, positions.

    Args:
        case: the beam.
        supports: supports at its end.
        frequencies: frequencies of the excitation [Hz].
        lengths: of the delaminations over that of the beam.
        depths: over the thickness of the beam.
    """
    L = case.length
    h = case.thickness
    return [
        Specimen(L * (m - 0.5 * a), L * (m + 0.5 * a), h * depth, support, frequency)
        for support, frequency, a, depth, m in product(
            supports, frequencies, lengths, depths, MIDDLES
        )
    ]


def plate_grid(
    case: Case,
    frequencies: Sequence[float],
    sizes: Sequence[float] = SIZES,
    depths: Sequence[float] = DEPTHS,
) -> list[Specimen]:
    """Return the specimens of a plate: patches as long as wide by size, depth and place.

    Args:
        case: the plate.
        frequencies: frequencies of the excitation [Hz].
        sizes: of the patches over the shorter side of the plate.
        depths: over the thickness of the plate.
    """
    width = 2.0 * case.half_width
    h = case.thickness
    specimens = []
    for frequency, size, depth, (along, across) in product(frequencies, sizes, depths, PLACES):
        half = 0.5 * size * reach_of(case)
        x = along * case.length
        z = (across - 0.5) * width
        edges = (round(z - half, 9), round(z + half, 9))
        specimens.append(
            Specimen(round(x - half, 9), round(x + half, 9), h * depth, AS_GIVEN, frequency, edges)
        )
    return specimens


def reach_of(case: Case) -> float:
    """Return what lengths are compared with: length of a beam, shorter side of a plate [m]."""
    return min(case.length, 2.0 * case.half_width) if case.is_plate else case.length


def _whole(case: Case, support: str, frequency: float, intact_plate: Case | None = None) -> Case:
    """Return a beam or plate without delaminations, meshed as the population is."""
    if intact_plate is not None:
        return intact_plate.with_overrides({"excitation.frequency": frequency})
    keys: dict[str, object] = {
        "support.end": support,
        "excitation.frequency": frequency,
        "mesh.elements": ELEMENTS,
        "time.steps_per_period": STEPS,
    }
    return intact(case.with_overrides(keys))


def trials(case: Case, found: Population, noise_db: float, seed: int = 1) -> xr.Dataset:
    """Measure each specimen once with a noisy sensor and judge it as `detect` judges a scan.

    Returns:
        Dataset over `specimen`, with the noise in its attributes: `start` and `end` of the
        delamination, its `depth` and `length`, the `marked_start` and `marked_end`, NaN where
        nothing is called [m]; `support` and `frequency` [Hz]; `hit`, whether what is marked
        overlaps the delamination; `score`, the largest index over its limit of noise; `overlap` of
        the marked region with a patch, NaN of beams and where nothing is called.
    """
    rng = np.random.default_rng(seed)
    surface = surface_of(case, None)
    drives = {}
    for key in {(specimen.support, specimen.frequency) for specimen in found.specimens}:
        bonded = _whole(case, *key, found.intact)
        points = found.x if found.z is None else scanned_places(bonded)
        drives[key] = drive_responses(bonded, surface, points, key[1], (2.0,))
    n = len(found.specimens)
    start, end, score, overlap = (np.full(n, np.nan) for _ in range(4))
    hit = np.zeros(n, dtype=np.bool_)
    for k, specimen in enumerate(found.specimens):
        if not np.isfinite(found.rms[k]):  # its run failed
            continue
        noisy = found.shapes(k, noise_db, rng).without_drive(
            drives[specimen.support, specimen.frequency]
        )
        called = mark("curvature", noisy)
        start[k], end[k] = called.start, called.end
        score[k] = float(called.over_limits.max())
        overlap[k] = specimen.overlap(case, called)
        hit[k] = specimen.is_hit(called, overlap[k])
    columns = {
        "start": [specimen.start for specimen in found.specimens],
        "end": [specimen.end for specimen in found.specimens],
        "depth": [specimen.thickness for specimen in found.specimens],
        "length": [specimen.length for specimen in found.specimens],
        "support": [specimen.support for specimen in found.specimens],
        "frequency": [specimen.frequency for specimen in found.specimens],
        "marked_start": start, "marked_end": end, "hit": hit, "score": score,
        "overlap": overlap,
    }  # fmt: skip
    return xr.Dataset(
        {name: ("specimen", np.asarray(values)) for name, values in columns.items()},
        attrs={"noise_db": noise_db},
    )


def end_error(judged: xr.Dataset) -> float:
    """Return the median error of the ends of all hits of `trials` [m]; NaN without a hit."""
    hits = judged.isel(specimen=judged["hit"].to_numpy())
    errors = [abs(hits[f"marked_{end}"] - hits[end]) for end in ("start", "end")]
    return float(np.median(errors)) if hits.sizes["specimen"] else math.nan


def median_overlap(judged: xr.Dataset) -> float:
    """Return the median overlap of all hits of `trials` on plates [-]; NaN without a hit."""
    overlaps = judged["overlap"].to_numpy()[judged["hit"].to_numpy()]
    return float(np.median(overlaps)) if overlaps.size else math.nan


def intact_scores(
    case: Case,
    support: str,
    frequency: float,
    noise_db: float,
    *,
    n: int = INTACT,
    seed: int = 2,
    intact_plate: Case | None = None,
) -> FloatArray:
    """Return the largest index over its limit of n noisy intact beams or plates, shape (n,).

    The noise is in the samples, and the limit follows from the noise between the harmonics, as it
    does in a measurement. A beam is called if its score is above 1.

    Args:
        case: the beam or plate.
        support: support at the end of a beam.
        frequency: frequency of the excitation [Hz].
        noise_db: overall root mean square of the signal over that of the noise [dB].
        n: number of beams or plates.
        seed: seed of the noise.
        intact_plate: model of the plate without a patch; None: a beam.
    """
    intact_case = _whole(case, support, frequency, intact_plate)
    scan = Scan(noise_db=noise_db, periods=PERIODS, sampling_rate=SAMPLES * frequency)
    pure = simulated(intact_case, scan)
    points = pure.x if pure.z is None else scanned_places(intact_case)
    drive = drive_responses(intact_case, surface_of(case, None), points, frequency, (2.0,))
    noise = pure.noise_of(scan)
    scores = []
    for k in range(n):
        noisy = pure.noisy(noise, seed * 1_000_003 + k)
        shapes = shapes_of(
            noisy.field, noisy.times, frequency, noisy.x, orders=(1.0, 2.0), z=noisy.z
        )
        scores.append(float(curvature(shapes.without_drive(drive)).over_limits.max()))
    return np.array(scores)


def roc(damaged: FloatArray, intact_ones: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return false-call rates and rates of detection for every threshold on the score.

    Args:
        damaged: scores of damaged structures, shape (n,); NaN where a run failed.
        intact_ones: scores of intact structures, shape (m,).
    """
    thresholds = np.unique(np.concatenate([intact_ones, damaged[np.isfinite(damaged)]]))[::-1]
    thresholds = np.concatenate([[np.inf], thresholds])
    false = np.array([(intact_ones >= t).mean() for t in thresholds])
    true = np.array([(damaged >= t).mean() for t in thresholds])
    return false, true


_WORDS = {
    "clamped": "clamped at both ends",
    "free": "cantilever",
    "pinned": "clamped and pinned",
    AS_GIVEN: "supports as given",
}


@dataclass(frozen=True)
class Line:
    """The result for one support, noise and frequency.

    Attributes:
        support: support at the end of the structure.
        frequency: frequency of the excitation [Hz].
        trials: hits and misses at this noise, see `trials`.
        curve: POD over the length [m].
        intact: scores of intact beams; empty where it was not computed.
    """

    support: str
    frequency: float
    trials: xr.Dataset
    curve: Curve
    intact: FloatArray

    @property
    def a90(self) -> float:
        """Length with a POD of 0.9 [m]; NaN: none."""
        return self.curve.length(0.9)

    @property
    def a90_95(self) -> float:
        """Length at which the lower 95 % bound of the POD is 0.9 [m]; NaN: none."""
        return self.curve.length(0.9, 0.95)


@dataclass(frozen=True)
class PodStudy(Finding):
    """Probability of detection for each support, noise and frequency.

    Attributes:
        case: case whose structure carries the delaminations.
        lines: results for each support, noise and frequency.
        recommended: frequency with the most hits by support and noise [Hz].
    """

    case: Case
    lines: tuple[Line, ...]
    recommended: dict[tuple[str, float], float]

    def best(self, support: str, noise_db: float) -> Line:
        """Return the result for a support and a noise at the recommended frequency."""
        return next(
            line
            for line in self.lines
            if (line.support, line.trials.attrs["noise_db"]) == (support, noise_db)
            and line.frequency == self.recommended[support, noise_db]
        )

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal; lengths over that of the beam."""
        reach = reach_of(self.case)
        rows = [_row(self.best(*key), reach, self.case.is_plate) for key in self.recommended]
        return Report(
            name="pod",
            numbers={
                "case": self.case.name,
                "recommended": [
                    {"support": support, "noise_db": noise, "frequency": frequency}
                    for (support, noise), frequency in self.recommended.items()
                ],
                "lines": [_numbers(line) for line in self.lines],
            },
            case=self.case,
            is_sweep=True,
            title=f"POD of {self.case.name}",
            tables=[Table(f"probability of detection, {self.case.name}", self._heading, rows)],
            pictures={
                "figures/pod": (
                    self.pod_figure,
                    "Hits over length, the logistic regression on ln a, and its lower 95 % bound. "
                    "Each support and noise at its best frequency.",
                ),
                "figures/roc": (
                    self.roc_figure,
                    "Rates of detection and of false calls for every threshold, in classes of "
                    "length.",
                ),
                "figures/depths": (
                    self.depth_figure,
                    "Share of hits over length and depth, of all positions.",
                ),
            },
        )

    @property
    def _heading(self) -> tuple[str, ...]:
        """Heading of the table; lengths over that of a beam, or the shorter side of a plate."""
        where = "overlap" if self.case.is_plate else "error of ends /L"
        return (*HEADING, where, "false calls")

    @property
    def _length(self) -> str:
        """Label of an axis of lengths."""
        if self.case.is_plate:
            return "√area of the patch / shorter side"
        return "length of the delamination a/L"

    def depth_figure(self) -> Figure:
        """Draw the share of hits over length and depth, for each support and noise."""
        figure, panels = self._panels()
        for axes, line in panels:
            a = (line.trials["length"].to_numpy() / reach_of(self.case)).round(6)
            depth = (100.0 * line.trials["depth"].to_numpy() / self.case.thickness).round(4)
            hit = line.trials["hit"].to_numpy()
            lengths, column = np.unique(a, return_inverse=True)
            depths, row = np.unique(depth, return_inverse=True)
            counts = np.zeros((2, depths.size, lengths.size))
            np.add.at(counts, (0, row, column), hit)
            np.add.at(counts, (1, row, column), 1.0)
            shares = np.where(counts[1] > 0.0, counts[0] / np.maximum(counts[1], 1.0), np.nan)
            colours = axes.pcolormesh(
                style.edges(lengths), style.edges(depths), shares, vmin=0.0, vmax=1.0
            )
            axes.grid(visible=False)
            axes.set(ylabel="depth [% of the thickness]", xticks=lengths, yticks=depths)
        style.label_x([axes for axes, _ in panels], self._length)
        figure.colorbar(colours, ax=[axes for axes, _ in panels], label="share of hits")
        return figure

    def pod_figure(self) -> Figure:
        """Draw POD curves with their bounds and the hits, for each support and noise."""
        figure, panels = self._panels()
        L = reach_of(self.case)
        longest = max(float(line.trials["length"].max()) for line in self.lines)
        a = np.linspace(0.02, 1.1, 200) * longest
        for axes, line in panels:
            every = line.trials["length"].to_numpy()
            hit = line.trials["hit"].to_numpy()
            lengths = np.unique(every.round(9))
            rates = [hit[np.isclose(every, length)].mean() for length in lengths]
            axes.plot(
                lengths / L, rates, "o", color=style.lamina_colours(1)[0], label="share of hits"
            )
            axes.plot(a / L, line.curve.pod(a), color="black", label="POD")
            axes.plot(
                a / L, line.curve.pod(a, _BOUND), "--", color="black", label="lower 95 % bound"
            )
            axes.axhline(0.9, color=style.BASE_COLOUR, linewidth=0.8)
            axes.set(ylim=(-0.03, 1.03), ylabel="probability of detection")
        style.label_x([axes for axes, _ in panels], self._length)
        panels[0][0].legend(loc="lower right")
        return figure

    def roc_figure(self) -> Figure:
        """Draw ROC curves for each support and noise, in classes of length."""
        figure, panels = self._panels()
        L = reach_of(self.case)
        classes = ((0.0, 0.075), (0.075, 0.175), (0.175, np.inf))
        for axes, line in panels:
            share = line.trials["length"].to_numpy() / L
            for (low, high), colour in zip(classes, style.lamina_colours(3), strict=True):
                chosen = (share >= low) & (share < high)
                if not chosen.any():
                    continue
                false, true = roc(line.trials["score"].to_numpy()[chosen], line.intact)
                text = f"a/L {share[chosen].min():.2g} to {share[chosen].max():.2g}"
                axes.step(false, true, where="post", color=colour, label=text)
            axes.set(xlim=(-0.01, 1.01), ylim=(-0.01, 1.03), ylabel="rate of detection")
        style.label_x([axes for axes, _ in panels], "rate of false calls")
        panels[-1][0].legend(loc="lower right")
        return figure

    def _panels(self) -> tuple[Figure, list[tuple[Axes, Line]]]:
        """Return a figure with a panel for the best line of each support and noise."""
        lines = [self.best(*key) for key in self.recommended]
        figure = style.canvas(6.5)
        panels = figure.subplots(-(-len(lines) // 2), 2, sharey=True, squeeze=False).ravel()
        for axes in panels[len(lines) :]:
            axes.remove()
        for axes, line in zip(panels, lines, strict=False):
            noise = line.trials.attrs["noise_db"]
            axes.set_title(
                f"{_WORDS[line.support]}, {noise:g} dB, {line.frequency:g} Hz", loc="left"
            )
        return figure, list(zip(panels, lines, strict=False))


HEADING = ("support", "noise [dB]", "frequency [Hz]", "hits", "a90/L", "a90/95 /L")
"""Begin of the heading of the table of a study."""


def pod(case: Case, found: Population, noises: Sequence[float]) -> PodStudy:
    """Judge a population and intact beams at each noise.

    The recommended frequency of a support and a noise is that with the most hits; of equal ones the
    lowest. False calls are counted there.
    """
    lines = []
    recommended = {}
    supports = sorted({specimen.support for specimen in found.specimens})
    frequencies = sorted({specimen.frequency for specimen in found.specimens})
    for noise in noises:
        all_trials = trials(case, found, noise)
        for support in supports:
            of_support = all_trials.isel(specimen=(all_trials["support"] == support).to_numpy())
            by_frequency = {
                f: of_support.isel(specimen=(of_support["frequency"] == f).to_numpy())
                for f in frequencies
            }
            best = max(frequencies, key=lambda f: (int(by_frequency[f]["hit"].sum()), -f))
            recommended[support, noise] = best
            for f, judged in by_frequency.items():
                scores = np.empty(0)
                if f == best:
                    scores = intact_scores(case, support, f, noise, intact_plate=found.intact)
                curve = logistic(judged["length"].to_numpy(), judged["hit"].to_numpy())
                lines.append(Line(support, f, judged, curve, scores))
    order = {key: recommended[key] for key in sorted(recommended, key=lambda k: (k[0], -k[1]))}
    return PodStudy(case, tuple(lines), order)


def _row(line: Line, L: float, is_plate: bool) -> tuple[str, ...]:
    """Return the table row of a result."""
    line_trials = line.trials
    return (
        line.support,
        f"{line_trials.attrs['noise_db']:g}",
        f"{line.frequency:g}",
        f"{int(line_trials['hit'].sum())} of {line_trials['hit'].size}",
        f"{line.a90 / L:.3f}",
        f"{line.a90_95 / L:.3f}",
        f"{median_overlap(line_trials):.2f}" if is_plate else f"{end_error(line_trials) / L:.4f}",
        f"{int((line.intact > 1.0).sum())} of {line.intact.size}",
    )


def _numbers(line: Line) -> dict[str, object]:
    """Return the numbers of a result for pod.json."""
    line_trials = line.trials
    return {
        "support": line.support,
        "frequency": line.frequency,
        "noise_db": line_trials.attrs["noise_db"],
        "hits": int(line_trials["hit"].sum()),
        "specimens": line_trials["hit"].size,
        "beta": line.curve.beta,
        "a90": line.a90,
        "a90_95": line.a90_95,
        "median_end_error": end_error(line_trials),
        "median_overlap": median_overlap(line_trials),
        "false_calls": int((line.intact > 1.0).sum()) if line.intact.size else None,
        "intact_beams": line.intact.size,
        "length": line_trials["length"].to_numpy(),
        "depth": line_trials["depth"].to_numpy(),
        "middle": 0.5 * (line_trials["start"] + line_trials["end"]).to_numpy(),
        "hit": line_trials["hit"].to_numpy(),
    }


def compute(case: Case, options: Pod, context: RunContext) -> PodStudy:
    """Compute the structures of the grid with options of a user, and judge them."""
    depths = options.depths or DEPTHS
    if case.is_plate:
        if options.supports is not None:
            raise CaseError(
                "supports: expected none of a plate, whose supports are those of the case, given "
                f"{', '.join(options.supports)}"
            )
        frequencies = options.frequencies or (case.excitation.top_frequency,)
        specimens = plate_grid(case, frequencies, options.lengths or SIZES, depths)
    else:
        specimens = grid(
            case,
            options.supports or SUPPORTS,
            options.frequencies or FREQUENCIES,
            options.lengths or LENGTHS,
            depths,
        )
    runs = population(
        case, specimens, context.folder, name="pod", spacing=options.spacing, modes=options.modes,
        **context.sweeping,
    )  # fmt: skip
    return pod(case, runs, options.noise_db)

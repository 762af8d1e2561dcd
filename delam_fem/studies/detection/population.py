"""Compute many structures with a delamination, and the probability that it is detected.

The structures are points of a sweep: each gives the shapes of a scan. Noise is added to the shapes
afterwards, so that one run serves any noise. The journal of the sweep makes a study resumable, and
any executor can compute it.

Probability of detection (POD): hit or miss over length, depth and position; ROC curves. A specimen
is a hit if the index calls it and marks an interval that overlaps its delamination. The logistic
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
    style,
)
from delam_fem.studies.detection.detect import (
    drive_responses,
    intact,
    per_shape,
    simulated,
)
from delam_fem.studies.detection.indices import curvature, mark
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
        support: support at the end of the structure: "clamped", "free" or "pinned".
        frequency: frequency of the excitation [Hz].
    """

    start: float
    end: float
    thickness: float
    support: str
    frequency: float

    @property
    def length(self) -> float:
        """Length of the delamination [m]."""
        return self.end - self.start


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
    """

    specimens: tuple[Specimen, ...]
    x: FloatArray
    orders: tuple[float, ...]
    values: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
    rms: FloatArray

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
        pure = Shapes(self.x, self.specimens[index].frequency, self.orders, self.values[index])
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
    other = next(lamina.name for lamina in case.lamina if lamina.name != surface)
    total = sum(lamina.mean("thickness") for lamina in case.lamina)
    settling = {
        kind: settling_periods(intact(case.with_overrides({"support.end": kind})), SETTLED)
        / case.excitation.top_frequency
        for kind in sorted({specimen.support for specimen in specimens})
    }
    columns: dict[str, list[float | int | str]] = {
        "delamination.1.start": [specimen.start for specimen in specimens],
        "delamination.1.end": [specimen.end for specimen in specimens],
        f"lamina.{surface}.thickness": [specimen.thickness for specimen in specimens],
        f"lamina.{other}.thickness": [total - specimen.thickness for specimen in specimens],
        "support.end": [specimen.support for specimen in specimens],
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
    data = scanned(
        name,
        case.with_overrides({"mesh.elements": ELEMENTS}),
        axes,
        ScanRecord(lamina=surface, spacing=spacing, first=first),
        Path(directory),
        executor=executor,
        **sweeping,
    )
    values = data["scan_real"].to_numpy() + 1j * data["scan_imag"].to_numpy()
    is_sampled = np.isfinite(values).any(axis=(0, 2))
    return Population(
        tuple(specimens),
        data["scan_x"].to_numpy(),
        tuple(data["order"].to_numpy()[is_sampled].tolist()),
        values[:, is_sampled],
        data["scan_rms"].to_numpy(),
    )


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


LENGTHS = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40)
"""Lengths of the delaminations of the grid over the length of the beam, a/L."""
DEPTHS = (0.15, 0.30, 0.45)
"""Depths of the grid over the thickness of the beam."""
MIDDLES = (0.25, 0.375, 0.5, 0.625, 0.75)
"""Middles of the delaminations of the grid over the length of the beam."""
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


def grid(case: Case, supports: Sequence[str], frequencies: Sequence[float]) -> list[Specimen]:
    """Return the specimens of the grid: supports, frequencies, lengths, depths, positions."""
    L = case.length
    h = sum(lamina.mean("thickness") for lamina in case.lamina)
    return [
        Specimen(L * (m - 0.5 * a), L * (m + 0.5 * a), h * depth, support, frequency)
        for support, frequency, a, depth, m in product(
            supports, frequencies, LENGTHS, DEPTHS, MIDDLES
        )
    ]


def _whole(case: Case, support: str, frequency: float) -> Case:
    """Return a beam without delaminations, meshed as the population is."""
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
        nothing is called [m]; `support` and `frequency` [Hz]; `hit`, whether the marked interval
        overlaps the delamination; `score`, the largest index over its limit of noise.
    """
    rng = np.random.default_rng(seed)
    surface = surface_of(case, None)
    drives = {
        key: drive_responses(_whole(case, *key), surface, found.x, key[1], (2.0,))
        for key in {(specimen.support, specimen.frequency) for specimen in found.specimens}
    }
    n = len(found.specimens)
    start, end, score = (np.full(n, np.nan) for _ in range(3))
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
        hit[k] = (
            called.is_detected and called.start <= specimen.end and called.end >= specimen.start
        )
    columns = {
        "start": [specimen.start for specimen in found.specimens],
        "end": [specimen.end for specimen in found.specimens],
        "depth": [specimen.thickness for specimen in found.specimens],
        "length": [specimen.length for specimen in found.specimens],
        "support": [specimen.support for specimen in found.specimens],
        "frequency": [specimen.frequency for specimen in found.specimens],
        "marked_start": start, "marked_end": end, "hit": hit, "score": score,
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


def intact_scores(
    case: Case, support: str, frequency: float, noise_db: float, *, n: int = INTACT, seed: int = 2
) -> FloatArray:
    """Return the largest index over its limit of n noisy intact beams, shape (n,).

    The noise is in the samples, and the limit follows from the noise between the harmonics, as it
    does in a measurement. A beam is called if its score is above 1.
    """
    intact_case = _whole(case, support, frequency)
    scan = Scan(noise_db=noise_db, periods=PERIODS, sampling_rate=SAMPLES * frequency)
    pure = simulated(intact_case, scan)
    drive = drive_responses(intact_case, surface_of(case, None), pure.x, frequency, (2.0,))
    noise = pure.noise_of(scan)
    scores = []
    for k in range(n):
        noisy = pure.noisy(noise, seed * 1_000_003 + k)
        shapes = shapes_of(noisy.field, noisy.times, frequency, noisy.x, orders=(1.0, 2.0))
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


_WORDS = {"clamped": "clamped at both ends", "free": "cantilever", "pinned": "clamped and pinned"}


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
        rows = [_row(self.best(*key), self.case.length) for key in self.recommended]
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
            tables=[Table(f"probability of detection, {self.case.name}", HEADING, rows)],
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
            },
        )

    def pod_figure(self) -> Figure:
        """Draw POD curves with their bounds and the hits, for each support and noise."""
        figure, panels = self._panels()
        L = self.case.length
        a = np.linspace(0.01, 0.45, 200) * L
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
        style.label_x([axes for axes, _ in panels], "length of the delamination a/L")
        panels[0][0].legend(loc="lower right")
        return figure

    def roc_figure(self) -> Figure:
        """Draw ROC curves for each support and noise, in classes of length."""
        figure, panels = self._panels()
        L = self.case.length
        classes = ((0.0, 0.075), (0.075, 0.175), (0.175, 0.5))
        for axes, line in panels:
            share = line.trials["length"].to_numpy() / L
            for (low, high), colour in zip(classes, style.lamina_colours(3), strict=True):
                chosen = (share >= low) & (share < high)
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


HEADING = (
    "support", "noise [dB]", "frequency [Hz]", "hits", "a90/L", "a90/95 /L", "error of ends /L",
    "false calls",
)  # fmt: skip
"""Heading of the table of a study."""


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
                scores = intact_scores(case, support, f, noise) if f == best else np.empty(0)
                curve = logistic(judged["length"].to_numpy(), judged["hit"].to_numpy())
                lines.append(Line(support, f, judged, curve, scores))
    order = {key: recommended[key] for key in sorted(recommended, key=lambda k: (k[0], -k[1]))}
    return PodStudy(case, tuple(lines), order)


def _row(line: Line, L: float) -> tuple[str, ...]:
    """Return the table row of a result."""
    line_trials = line.trials
    return (
        line.support,
        f"{line_trials.attrs['noise_db']:g}",
        f"{line.frequency:g}",
        f"{int(line_trials['hit'].sum())} of {line_trials['hit'].size}",
        f"{line.a90 / L:.3f}",
        f"{line.a90_95 / L:.3f}",
        f"{end_error(line_trials) / L:.4f}",
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
        "false_calls": int((line.intact > 1.0).sum()) if line.intact.size else None,
        "intact_beams": line.intact.size,
        "length": line_trials["length"].to_numpy(),
        "depth": line_trials["depth"].to_numpy(),
        "middle": 0.5 * (line_trials["start"] + line_trials["end"]).to_numpy(),
        "hit": line_trials["hit"].to_numpy(),
    }


def compute(case: Case, options: Pod, context: RunContext) -> PodStudy:
    """Compute the structures of the grid with options of a user, and judge them."""
    specimens = grid(case, options.supports, options.frequencies)
    runs = population(case, specimens, context.folder, name="pod", **context.sweeping)
    return pod(case, runs, options.noise_db)

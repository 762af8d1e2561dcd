"""Infer start, end and depth of a delamination from noisy scans, as a posterior.

Likelihood-free: one table of simulations from the prior serves every observation, by semi-automatic
summaries, rejection and regression (`numerics.statistics`). The statistics of a simulation contain
noise as the observation does.

The parameters are the middle, the length and the depth, uniform within bounds; start and end
follow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from matplotlib.figure import Figure

from delam_fem.api import (
    Case,
    CaseError,
    Finding,
    FloatArray,
    Report,
    RunContext,
    Table,
    statistics,
    style,
)
from delam_fem.studies.detection.detect import (
    Measurement,
    drive_responses,
    intact,
    per_sample,
    read_scan,
)
from delam_fem.studies.detection.indices import curvature, mark
from delam_fem.studies.detection.population import (
    PERIODS,
    SAMPLES,
    Population,
    Specimen,
    population,
)
from delam_fem.studies.detection.study import Infer, Scan
from delam_fem.studies.identification.unknowns import Unknown, drawn, uncertain_keys
from delam_fem.studies.signals.scan import ComplexArray, Shapes, shapes_of, surface_of

COMPONENTS = 3
"""Principal components of the curvature along the beam that serve as statistics, per frequency."""
NAMES = ("start", "end", "depth")
STATISTICS = (
    *(f"component {k + 1} of the shape of the curvature" for k in range(COMPONENTS)),
    "the first marked point", "the last marked point", "the curvature over its limit",
    "the second harmonic over the first", "the size of the first harmonic",
)  # fmt: skip
"""Names of the statistics of each scan, in order."""


def prior_of(case: Case) -> FloatArray:
    """Return lowest and highest value of middle, length and depth, shape (3, 2) [m].

    They are in proportion to the case.
    """
    L = case.length
    h = case.thickness
    return np.array([(0.25 * L, 0.75 * L), (0.075 * L, 0.4 * L), (0.1 * h, 0.45 * h)])


def specimens_of(
    parameters: FloatArray, support: str, frequencies: tuple[float, ...]
) -> list[Specimen]:
    """Return the structures with given parameters at the first frequency, then the second, …."""
    return [
        Specimen(middle - 0.5 * length, middle + 0.5 * length, depth, support, frequency)
        for frequency in frequencies
        for middle, length, depth in parameters.tolist()
    ]


@dataclass(frozen=True)
class ScanNoise:
    """Noise and drive of the scan at one frequency, with which the table is measured alike.

    Attributes:
        noise_db: overall root mean square of the field over that of the noise in a sample of a
            record of the table, of all points or of each [dB].
        n_lines: frequencies from which the noise is estimated; inf: it is known.
        drive: linear responses to harmonics of the drive, by order, which are taken away.
    """

    noise_db: float | FloatArray
    n_lines: float = math.inf
    drive: Mapping[float, ComplexArray] = field(default_factory=dict)

    @classmethod
    def of(cls, scan: Shapes, rms: float, drive: Mapping[float, ComplexArray]) -> ScanNoise:
        """Return the sensor of a measured scan with an overall root mean square [m/s]."""
        samples = per_sample(scan.noise, PERIODS * SAMPLES)
        return cls(20.0 * np.log10(rms / np.asarray(samples)), scan.n_lines, drive)


@dataclass(frozen=True)
class SimulationTable:
    """A table of simulations, and how a scan becomes the statistics of the table.

    Attributes:
        table: parameters and statistics.
        bases: mean and principal components of the curvature at each frequency, shape (1 +
            COMPONENTS, n_points).
        frequencies: of the scans of one structure [Hz].
        sensors: sensor at each frequency.
    """

    table: statistics.Simulations
    bases: tuple[FloatArray, ...]
    frequencies: tuple[float, ...]
    sensors: tuple[ScanNoise, ...]

    def posterior(self, scans: tuple[Shapes, ...]) -> statistics.Posterior:
        """Return the posterior of middle, length and depth for noisy scans, one per frequency."""
        return self.table.posterior(self._observed(scans))

    def mismatch(self, scans: tuple[Shapes, ...]) -> str | None:
        """Return in words how scans are unlike those of all simulations; None: they are not."""
        observed = self._observed(scans)
        if self.table.misfit(observed) > statistics.UNLIKE:
            return None
        frequency, statistic = divmod(self.table.outlier(observed), len(STATISTICS))
        return (
            f"the scans are like those of no simulation: {STATISTICS[statistic]} at "
            f"{self.frequencies[frequency]:g} Hz fits none of the same place. The rig differs from "
            "the case by more than --uncertain says, or the delamination is another one; the "
            "intervals do not hold"
        )

    def _observed(self, scans: tuple[Shapes, ...]) -> FloatArray:
        """Return the statistics of scans."""
        every = zip(scans, self.bases, self.sensors, strict=True)
        return np.concatenate(
            [_statistics(s.without_drive(sensor.drive), b) for s, b, sensor in every]
        )


def simulation_table(
    found: Population, parameters: FloatArray, prior: FloatArray, sensors: tuple[ScanNoise, ...],
    seed: int = 3,
) -> SimulationTable:  # fmt: skip
    """Return the table of a population, without structures of which a run failed.

    Args:
        found: population of the specimens of `specimens_of`.
        parameters: parameters of the structures, shape (n, 3) [m].
        prior: bounds of the prior from which they were drawn, see `prior_of`.
        sensors: sensor at each frequency.
        seed: seed of the noise.
    """
    n = len(parameters)
    numbers = np.arange(len(found.specimens)).reshape(-1, n)
    is_complete = np.isfinite(found.rms[numbers]).all(axis=0)
    rng = np.random.default_rng(seed)
    columns = []
    bases = []
    for row, sensor in zip(numbers, sensors, strict=True):
        noisy = [
            found.shapes(int(k), sensor.noise_db, rng, sensor.n_lines).without_drive(sensor.drive)
            for k in row[is_complete]
        ]
        profiles = np.stack([_profile(shapes) for shapes in noisy])
        mean = profiles.mean(axis=0)
        _, _, components = np.linalg.svd(profiles - mean, full_matrices=False)
        bases.append(np.vstack([mean, components[:COMPONENTS]]))
        columns.append(np.stack([_statistics(shapes, bases[-1]) for shapes in noisy]))
    frequencies = tuple(found.specimens[row[0]].frequency for row in numbers)
    table = statistics.Simulations(parameters[is_complete], np.concatenate(columns, axis=1), prior)
    return SimulationTable(table, tuple(bases), frequencies, sensors)


def edges(parameters: FloatArray) -> FloatArray:
    """Return start, end and depth for middle, length and depth, shape (n, 3) [m]."""
    middle, length, depth = parameters.T
    return np.stack([middle - 0.5 * length, middle + 0.5 * length, depth], axis=1)


def edge_posterior(posterior: statistics.Posterior) -> statistics.Posterior:
    """Return the posterior of start, end and depth."""
    return statistics.Posterior(edges(posterior.samples), posterior.weights)


def _profile(shapes: Shapes) -> FloatArray:
    """Return the 2f-curvature over its largest value, shape (n_points,)."""
    values = curvature(shapes).values
    return np.asarray(values / values.max())


def _statistics(shapes: Shapes, basis: FloatArray) -> FloatArray:
    """Return the statistics of one scan, shape (COMPONENTS + 5,)."""
    called = mark("curvature", shapes)
    sizes = [np.sqrt(np.mean(np.abs(shapes.order(k)) ** 2)) for k in (1.0, 2.0)]
    largest = float(called.over_limits.max())
    start, end = (called.start, called.end) if called.is_detected else (0.0, shapes.x[-1])
    numbers = [start, end, np.log(largest), np.log(sizes[1] / sizes[0]), np.log(sizes[0])]
    return np.concatenate([basis[1:] @ (_profile(shapes) - basis[0]), numbers])


SAME_PLACE = 0.05
"""Share of the spacing by which a scanned point may be off the grid: less than ends are found
to."""


@dataclass(frozen=True)
class Inferred(Finding):
    """Posterior of the delamination of a case from its scans.

    Attributes:
        case: case with one delamination.
        posterior: posterior of start, end and depth [m].
        n_structures: number of structures that were drawn from the prior.
        uncertain: keys in which the rig may differ from the case.
        is_measured: whether the scans come from files.
        mismatch: how the scans are unlike those of all simulations; None: they are not.
    """

    case: Case
    posterior: statistics.Posterior
    n_structures: int
    uncertain: tuple[Unknown, ...] = ()
    is_measured: bool = False
    mismatch: str | None = None

    @property
    def truth(self) -> FloatArray:
        """Start, end and depth of the case, shape (3,) [m]; NaN if the scans come from files."""
        return np.full(3, np.nan) if self.is_measured else truth_of(self.case)

    @property
    def prior(self) -> FloatArray:
        """A sample of start, end and depth before the scans, shape (20000, 3) [m]."""
        return edges(statistics.uniform(prior_of(self.case), 20_000, 1))

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        middle = self.posterior.quantile(0.5)
        bounds = self.posterior.interval()
        prior = np.quantile(self.prior, (0.05, 0.95), axis=0).T
        is_identified = self.posterior.is_identified(prior)
        sentences = [f"{self.n_structures} structures from the prior."]
        if lost := [name for name, known in zip(NAMES, is_identified, strict=True) if not known]:
            sentences.append(
                f"The scans do not identify {', '.join(lost)}: the 90 % interval is more than "
                f"{statistics.IDENTIFIED:g} times as wide as that of the prior."
            )
        numbers = {
            "case": self.case.name,
            "structures": self.n_structures,
            "uncertain": [asdict(unknown) for unknown in self.uncertain],
            "is_measured": self.is_measured,
            "mismatch": self.mismatch,
            "parameter": NAMES,
            "truth": None if self.is_measured else self.truth,
            "median": middle,
            "interval_90": bounds,
            "identified": is_identified.tolist(),
            "correlation": self.posterior.correlation(),
        }
        every = zip(NAMES, self.truth, middle, bounds.tolist(), strict=True)
        rows = [
            (
                name,
                "" if np.isnan(true) else f"{1e3 * true:.4g}",
                f"{1e3 * m:.4g}",
                f"{1e3 * low:.4g} … {1e3 * high:.4g}",
            )
            for name, true, m, (low, high) in every
        ]
        heading = ("parameter", "truth [mm]", "median [mm]", "90 % interval [mm]")
        caption = "Prior and posterior of start, end and depth."
        return Report(
            name="inference",
            numbers=numbers,
            case=self.case,
            is_sweep=True,
            title=f"Delamination of {self.case.name}",
            tables=[Table(f"posterior, {self.case.name}", heading, rows)],
            sentences=[" ".join(sentences)],
            remarks=[self.mismatch] if self.mismatch else [],
            pictures={"figures/posterior": (self.figure, caption)},
        )

    def figure(self) -> Figure:
        """Draw the marginal distributions within the prior, and start against end."""
        figure = Figure(figsize=(style.WIDTH, 6.0), layout="constrained")
        panels = figure.subplots(2, 2).ravel()
        samples = 1e3 * self.posterior.samples
        weights = self.posterior.weights
        prior = 1e3 * self.prior
        for k, (axes, name) in enumerate(zip(panels, NAMES, strict=False)):
            bins = np.linspace(prior[:, k].min(), prior[:, k].max(), 60)
            axes.hist(prior[:, k], bins=bins, density=True, color="0.85", label="prior")
            axes.hist(
                samples[:, k], bins=bins, weights=weights, density=True, color=style.BLUE,
                label="posterior",
            )  # fmt: skip
            if not self.is_measured:
                axes.axvline(1e3 * self.truth[k], color=style.VERMILLION, label="truth")
            axes.set(xlabel=f"{name} [mm]", ylabel="density [1/mm]")
        panels[0].legend()
        panels[3].scatter(
            samples[:, 0], samples[:, 1], s=2000.0 * weights, color=style.BLUE, alpha=0.5
        )
        panels[3].plot(*(1e3 * self.truth[:2]), "+", color=style.VERMILLION, markersize=14)
        panels[3].set(xlabel="start [mm]", ylabel="end [mm]")
        return figure


def compute(case: Case, options: Infer, context: RunContext) -> Inferred:
    """Infer start, end and depth of the one delamination between two laminae.

    The delamination of the case itself serves for simulated scans only. The rig differs from the
    case in the keys of `uncertain`, drawn for each structure; by default those of `of_rig`.

    Raises:
        CaseError: the case or the scans are not valid.
        KeyboardInterrupt: the sweep was interrupted; `resume` goes on.
    """
    number, frequencies, noise_db = options.number, options.frequency, options.noise_db
    measured = _scans(case, options)
    uncertain = uncertain_keys(case, options.uncertain)
    prior = prior_of(case)
    parameters = statistics.uniform(prior, number, 7)
    drawn_keys = drawn(uncertain, case, number, 8)
    also = {key: np.tile(values, len(frequencies)) for key, values in drawn_keys.items()}
    specimens = specimens_of(parameters, case.support.kind("end"), frequencies)
    spacing, first, n_points = _grid(measured)
    runs = population(
        case, specimens, context.folder, spacing=spacing, first=first, also=also, **context.sweeping
    ).at_first(n_points)
    intact_case = intact(case)
    surface = surface_of(case, None)
    drives = [drive_responses(intact_case, surface, runs.x, f, (2.0,)) for f in frequencies]
    if measured is None:
        observed_specimens = observed(case, frequencies)
        folder = context.folder / "observation"
        observed_runs = population(
            case, observed_specimens, folder, "serial", resume=context.resume
        )
        rng = np.random.default_rng(1)
        scans = tuple(observed_runs.shapes(k, noise_db, rng) for k in range(len(frequencies)))
        sensors = tuple(ScanNoise(noise_db, drive=drive) for drive in drives)
    else:
        scans = tuple(shapes_of(m.field, m.times, m.frequency, m.x) for m in measured)
        every = zip(scans, measured, drives, strict=True)
        sensors = tuple(ScanNoise.of(scan, m.rms, drive) for scan, m, drive in every)
    known = simulation_table(runs, parameters, prior, sensors)
    posterior = edge_posterior(known.posterior(scans))
    return Inferred(
        case, posterior, number, uncertain, measured is not None, known.mismatch(scans)
    )  # fmt: skip


def _scans(case: Case, options: Infer) -> list[Measurement] | None:
    """Return the measured scans, one per frequency; None: the case simulates them."""
    if not options.measured:
        return None
    if len(options.measured) != len(options.frequency):
        raise CaseError(
            f"--measured: expected one file per frequency, given {len(options.measured)} files and "
            f"{len(options.frequency)} frequencies"
        )
    return [
        read_scan([path], options, case.with_overrides({"excitation.frequency": f}), Scan())
        for path, f in zip(options.measured, options.frequency, strict=True)
    ]


def _grid(measured: Sequence[Measurement] | None) -> tuple[float, float, int | None]:
    """Return spacing and first position [m] and number of points of the scans.

    Raises:
        CaseError: the positions are not equidistant, or differ from scan to scan.
    """
    if measured is None:
        return 0.01, 0.0, None
    x = measured[0].x
    spacing = float(np.diff(x).mean())
    expected = x[0] + spacing * np.arange(x.size)
    for scan in measured:
        if scan.x.size != x.size or np.abs(scan.x - expected).max() > SAME_PLACE * spacing:
            raise CaseError(
                "measured: expected equidistant points, the same in every scan, given "
                f"{scan.x.tolist()}"
            )
    return spacing, float(x[0]), int(x.size)


def truth_of(case: Case) -> FloatArray:
    """Return start, end and depth of the delamination of a case, shape (3,) [m]."""
    delamination = case.delamination[0]
    surface = surface_of(case, None)
    depth = next(lamina.mean("thickness") for lamina in case.lamina if lamina.name == surface)
    return np.array([delamination.start, delamination.end, depth], dtype=np.float64)


def observed(case: Case, frequencies: tuple[float, ...]) -> list[Specimen]:
    """Return the case itself as specimens, one for each frequency."""
    start, end, depth = truth_of(case).tolist()
    return [Specimen(start, end, depth, case.support.kind("end"), f) for f in frequencies]

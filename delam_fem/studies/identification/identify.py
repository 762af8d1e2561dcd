"""Identify keys of a rig from clapping motions, and check the intervals of their posterior.

The keys that are sought, and those that are uncertain, are drawn from a prior. The posterior
follows from simulations alone (`numerics/statistics.py`): one sweep over the drawn parameters for
each frequency, and the harmonics of channels as statistics: of the probes unless others are named.

The statistics describe a motion whatever the origin of time, since a measurement seldom knows the
phase of the base. A shift of the origin by τ turns the k-th harmonic c_k by k ω τ; so c_k e^{-ikφ},
with the phase φ of the first harmonic of the first channel, does not change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from delam_fem.api import (
    Case,
    CaseError,
    Cost,
    Finding,
    FloatArray,
    Report,
    RunContext,
    beams,
    of_references,
    require,
    statistics,
)
from delam_fem.studies.executors import ExecutorName
from delam_fem.studies.identification.fit import ResponseFit, has_responses, of_responses
from delam_fem.studies.identification.posterior import described
from delam_fem.studies.identification.study import Identify
from delam_fem.studies.identification.unknowns import (
    Unknown,
    drawn,
    require_values,
    uncertain_keys,
    value_of,
)
from delam_fem.studies.signals import reading
from delam_fem.studies.signals.scan import amplitudes
from delam_fem.studies.sweeps.dataset import remove_results
from delam_fem.studies.sweeps.grid import Sweep
from delam_fem.studies.sweeps.run import completed, sweep_cost


def measured_histories(path: Path, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Return times, shape (n,) [s], and channels, shape (n_channels, n), of a file.

    Raises:
        CaseError: the file cannot be read, or it has not all of the channels.
    """
    data = reading.record(reading.read_measured(path))
    if missing := [name for name in names if name not in data]:
        raise CaseError(
            f"{path}: expected the channels {', '.join(names)}, found no {', '.join(missing)} "
            f"among {', '.join(map(str, data.data_vars))}; delam-fem measure read FILE --channel "
            "'NAME=COLUMN:UNIT' makes such a file, with 'tip LAMINA' for tip_LAMINA"
        )
    return data["time"].to_numpy(), np.array([data[name].to_numpy() for name in names])


HARMONICS = 5
"""Number of harmonics of each channel."""
STEADY = ("harmonic", "force")
"""Kinds of drives whose motions have harmonics."""
FITTED = 60
"""Largest number of harmonics that are fitted: those of impacts must not count as noise."""
SAMPLES = 4
"""Least number of samples of a measurement for each unknown of its harmonics."""
QUARTERS = 4
"""Parts of a record, of whole periods each, whose sizes are compared."""
UNSTEADY = 3.0
"""Ratio of the sizes of two parts of a record from which on its motion is not steady."""


def of_points(sweep: xr.Dataset, names: Sequence[str]) -> beams.ComplexArray:
    """Return the harmonics of channels at all points of a sweep.

    Returns:
        Shape (n_points, n_channels, HARMONICS), in the units of the channels; NaN for points that
        were not completed.
    """
    rows = []
    for name in names:
        size, phase = (
            sweep[f"{name}_{part}"].to_numpy().reshape(-1, HARMONICS)
            for part in ("harmonic_amplitude", "harmonic_phase")
        )
        rows.append(size * np.exp(1j * phase))
    return np.stack(rows, axis=1)


def of_history(
    time: FloatArray, values: FloatArray, frequency: float
) -> tuple[beams.ComplexArray, FloatArray]:
    """Return the harmonics of a measured motion and the scatter about them.

    Args:
        time: times of the samples, any origin, shape (n,) [s].
        values: histories of channels, shape (n_channels, n).
        frequency: frequency of the base [Hz].

    Returns:
        Harmonics, shape (n_channels, HARMONICS), and the standard deviations of a sample, shape
        (n_channels,), in the units of the channels.

    Raises:
        CaseError: there are too few samples, or less than two periods, or the motion is a burst.
    """
    least = 2 * HARMONICS + 1
    if time.size < SAMPLES * least or np.ptp(time) * frequency < 2.0:
        raise CaseError(
            f"measured history: expected at least {SAMPLES * least} samples and two periods, "
            f"given {time.size} samples over {np.ptp(time) * frequency:.3g} periods of "
            f"{frequency:g} Hz"
        )
    _require_steady(time, values, frequency)
    below_nyquist = math.ceil(0.5 / (frequency * float(np.median(np.diff(time))))) - 1
    n_resolved = min(FITTED, below_nyquist, (time.size // SAMPLES - 1) // 2)
    frequencies = frequency * np.arange(1, max(HARMONICS, n_resolved) + 1)
    coefficients = amplitudes(values.T, time, frequencies.tolist())
    residual = values - (coefficients.T @ np.exp(2j * math.pi * np.outer(frequencies, time))).real
    freedom = 1.0 - (2 * frequencies.size + 1) / time.size
    return 1j * coefficients[:HARMONICS].T, np.sqrt(residual.var(axis=1) / freedom)


def _require_steady(time: FloatArray, values: FloatArray, frequency: float) -> None:
    """Raise a CaseError if a motion comes or goes: a burst, a decay, a beginning from rest."""
    periods = (time - time[0]) * frequency
    count = min(QUARTERS, int(periods[-1]))
    each = math.floor(periods[-1] / count)
    sizes = np.array(
        [
            values[:, (periods >= n * each) & (periods < (n + 1) * each)].std(axis=1)
            for n in range(count)
        ]
    )
    ratio = float(np.max(sizes.max(axis=0) / np.maximum(sizes.min(axis=0), 1e-300)))
    if ratio > UNSTEADY:
        raise CaseError(
            f"measured history: expected a steady motion at {frequency:g} Hz, given one that is "
            f"{ratio:.3g} times as large in one part of the record as in another; its harmonics "
            "say nothing. Take the steady part (measure read --between), or responses (measure "
            "response) of bursts and decays without contact"
        )


def invariant(harmonics: beams.ComplexArray) -> FloatArray:
    """Return harmonics as real numbers without the origin of time.

    Args:
        harmonics: shape (..., n_channels, HARMONICS).

    Returns:
        Real and imaginary parts, shape (..., 2 n_channels HARMONICS - 1); the imaginary part of
        the first harmonic of the first channel is 0 and left out.
    """
    first = harmonics[..., 0, 0]
    turns = np.exp(-1j * np.angle(first)[..., None] * np.arange(1, HARMONICS + 1))
    turned = (harmonics * turns[..., None, :]).reshape(*harmonics.shape[:-2], -1)
    return np.concatenate([turned.real, turned.imag[..., 1:]], axis=-1)


def noisy(
    harmonics: beams.ComplexArray, noise: FloatArray, rng: np.random.Generator
) -> beams.ComplexArray:
    """Return harmonics with errors of independent normal parts.

    Args:
        harmonics: shape (..., n_channels, HARMONICS).
        noise: standard deviation of the real and of the imaginary part, of a shape that fits.
        rng: random numbers.
    """
    parts = rng.standard_normal((2, *harmonics.shape))
    return np.asarray(harmonics + noise * (parts[0] + 1j * parts[1]))


FINER = 100
"""Number of simulations that are repeated with finer steps and elements."""
TIMES_FINER = 8
"""How much longer such a simulation takes."""
LIKE = 5
"""Number of repeated simulations of which one says what finer steps and elements change."""
BEYOND = 1.5
"""Largest multiple of that change: infinitely many steps change more than four times as many."""


def refined_overrides(case: Case, number: int) -> dict[str, FloatArray]:
    """Return keys of simulations that are repeated: four times the steps, twice the elements."""
    keys = {"time.steps_per_period": 4 * case.steps_per_period}
    if case.mesh.elements is not None:
        keys["mesh.elements"] = 2 * case.mesh.elements
    return {key: np.full(number, value) for key, value in keys.items()}


@dataclass(frozen=True)
class Experiment:
    """Motions of a rig at some frequencies, of which some channels are measured.

    Attributes:
        case: the rig; the unknowns replace some of its values.
        frequencies: frequencies of the drive [Hz].
        unknowns: keys that are sought.
        noise: standard deviation of a sample of each channel, or of all, in their SI units.
        n_samples: number of samples of each motion; None: as many as the window of the case.
        uncertain: keys that are not sought, but in which the rig may differ from the case, drawn
            for each simulation; those of a usual rig: see `of_rig`.
        channels: names of the channels that are measured; none: the probes of all laminae.
        levels: amplitude of the drive of each motion, in the unit of the case's own, which is a
            displacement [m], an acceleration [m/s2] or a force [N]; none: that of the case.
    """

    case: Case
    frequencies: tuple[float, ...]
    unknowns: tuple[Unknown, ...]
    noise: float | Sequence[float]
    n_samples: int | None = None
    uncertain: tuple[Unknown, ...] = ()
    channels: tuple[str, ...] = ()
    levels: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Check that the sought keys have values of their own, and that each motion has a level.

        Raises:
            CaseError: a sought key is given by multiples of the value of the case; the numbers of
                frequencies and levels differ; two motions are the same; the case has no amplitude.
        """
        require_values(self.unknowns)
        kind = self.case.excitation.kind
        require(
            kind in STEADY, "excitation.kind",
            f"{' or '.join(STEADY)} of motions with --frequency", kind,
        )  # fmt: skip
        require(
            len(self.levels) in (0, len(self.frequencies)), "level",
            f"none, or one for each of the {len(self.frequencies)} motions", len(self.levels),
        )  # fmt: skip
        names = [name for name, _ in self.motions]
        require(
            len(set(names)) == len(names), "frequency", "motions that differ",
            " and ".join(names),
        )  # fmt: skip
        require(
            np.size(self.noise) in (1, len(self.names)), "noise",
            f"one number, or one for each of {', '.join(self.names)}", np.size(self.noise),
        )  # fmt: skip

    @property
    def motions(self) -> list[tuple[str, dict[str, float]]]:
        """Name and keys of each motion: its frequency and, where there are levels, its level."""
        frequencies = [(f"{f:g}-Hz", {"excitation.frequency": float(f)}) for f in self.frequencies]
        if not self.levels:
            return frequencies
        is_acceleration = getattr(self.case.excitation, "acceleration", None) is not None
        key = f"excitation.{'acceleration' if is_acceleration else 'amplitude'}"
        return [
            (f"{level:g}-at-{name}", keys | {key: float(level)})
            for level, (name, keys) in zip(self.levels, frequencies, strict=True)
        ]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels that are measured."""
        laminae = [lamina.name for lamina in self.case.lamina]
        return self.channels or tuple(of_references(laminae))

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest value of each unknown, shape (n_unknowns, 2)."""
        return np.array([(unknown.low, unknown.high) for unknown in self.unknowns])

    @property
    def truth(self) -> list[float]:
        """Values that the case itself has for the unknowns."""
        return [value_of(self.case, unknown.keys(self.case)[0]) for unknown in self.unknowns]

    @property
    def error(self) -> FloatArray:
        """Deviation of real and imaginary part of harmonics, shape (n_channels, 1) or (1, 1)."""
        window_samples = self.case.n_window_periods * self.case.steps_per_period
        noise = np.reshape(self.noise, (-1, 1))
        return np.asarray(noise * math.sqrt(2.0 / (self.n_samples or window_samples)))

    def sweep(
        self, number: int, parameters: FloatArray, also: Mapping[str, FloatArray] | None = None
    ) -> Sweep:
        """Return the simulations of a motion; see `simulate`.

        Raises:
            CaseError: the first set of parameters is not a valid case.
        """
        columns = dict(also or {})
        for unknown, column in zip(self.unknowns, parameters.T, strict=True):
            columns |= dict.fromkeys(unknown.keys(self.case), column)
        axes = [
            {"key": key, "name": key.replace(".", "_"), "values": column.tolist()}
            for key, column in columns.items()
        ]
        name, keys = self.motions[number]
        return Sweep(
            self.case.with_overrides(dict(keys)), {},
            name=f"identification-{name}", axis=axes, combine="zip",
            record={"summary": False, "strobes": 0, "harmonics": HARMONICS, "channels": self.names},
        )  # fmt: skip

    def simulate(
        self,
        parameters: FloatArray,
        directory: Path,
        *,
        also: Mapping[str, FloatArray] | None = None,
        executor: ExecutorName | None = None,
        workers: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> beams.ComplexArray:
        """Return the harmonics of the motions with given parameters, without noise.

        Each motion is a sweep in a folder of its own, which goes on where it was interrupted.

        Args:
            parameters: values of the unknowns, shape (n, n_unknowns).
            directory: folder of the sweeps.
            also: values of further keys, shape (n,) each; the unknowns go before them.
            executor: "process", "mpi", "serial", or an executor of `concurrent.futures`.
            workers: number of processes; default: one per core.
            progress: called with the number of finished simulations and of all.

        Returns:
            Shape (n, n_frequencies, n_channels, HARMONICS); NaN for motions that diverged.

        Raises:
            CaseError: the first set of parameters is not a valid case.
            KeyboardInterrupt: a sweep was interrupted; its points are kept.
        """
        results = []
        total = len(parameters) * len(self.frequencies)
        for number, (name, _) in enumerate(self.motions):

            def report(done: int, _: int, before: int = number * len(parameters)) -> None:
                if progress is not None:
                    progress(before + done, total)

            swept = completed(
                self.sweep(number, parameters, also), directory / name, executor,
                workers=workers, resume=True, progress=report, is_confirmed=True,
            )  # fmt: skip
            results.append(of_points(swept, self.names))
        return np.stack(results, axis=1)

    def table(
        self, harmonics: beams.ComplexArray, parameters: FloatArray, seed: int,
        finer: beams.ComplexArray | None = None,
    ) -> statistics.Simulations:  # fmt: skip
        """Return the simulations with noise as a table for the inference.

        A rig has no steps and elements. So each simulation is changed by what finer ones change in
        one of the `LIKE` repeated simulations with the nearest parameters, times a random number
        between 0 and `BEYOND`.

        Args:
            harmonics: harmonics of the simulations, see `simulate`.
            parameters: values of the unknowns, shape (n, n_unknowns).
            seed: seed of the noise.
            finer: harmonics of the first simulations with `refined_overrides`; None: none is
                repeated.

        Raises:
            CaseError: too few simulations were completed.
        """
        rng = np.random.default_rng(seed)
        if finer is not None:
            harmonics = harmonics + _discrepancy(finer, harmonics, parameters, rng)
        values = invariant(noisy(harmonics, self.error, rng))
        values = values.reshape(len(values), -1)
        good = np.isfinite(values).all(axis=1)
        if np.count_nonzero(good) < statistics.FEWEST:
            raise CaseError(
                f"identification: expected at least {statistics.FEWEST} simulations, {good.sum()} "
                f"of {good.size} were completed"
            )
        return statistics.Simulations(parameters[good], values[good], self.bounds)


def _discrepancy(
    finer: beams.ComplexArray,
    harmonics: beams.ComplexArray,
    parameters: FloatArray,
    rng: np.random.Generator,
) -> beams.ComplexArray:
    """Return the change of all simulations that finer ones stand for; see `Experiment.table`."""
    change = finer - harmonics[: len(finer)]
    complete = np.flatnonzero(np.isfinite(change).reshape(len(change), -1).all(axis=1))
    if complete.size == 0:
        return np.zeros_like(harmonics)
    places = parameters / parameters.std(axis=0)
    distance = np.linalg.norm(places[:, None] - places[None, complete], axis=2)
    like = np.argsort(distance, axis=1)[:, :LIKE]
    chosen = like[np.arange(len(like)), rng.integers(like.shape[1], size=len(like))]
    share = rng.uniform(0.0, BEYOND, size=(len(like), 1, 1, 1))
    return np.asarray(share * change[complete[chosen]])


@dataclass(frozen=True)
class Identification(Finding):
    """Posterior of the unknowns of an experiment from a measurement.

    Attributes:
        experiment: the rig and its motions.
        posterior: posterior of the unknowns.
        coverage: share of 90 % intervals that contain the truth, by unknown; None: not checked.
        checks: number of simulations that served as observations for `coverage`.
        is_synthetic: whether the motions were simulated from the case itself.
        completed: number of simulations in the table.
        mismatch: how the measurement is unlike all simulations; None: it is not.
    """

    experiment: Experiment
    posterior: statistics.Posterior
    coverage: FloatArray | None
    checks: int
    is_synthetic: bool
    completed: int
    mismatch: str | None = None

    @property
    def truth(self) -> list[float] | None:
        """Values of the unknowns in a synthetic measurement; None: the motions were measured."""
        return self.experiment.truth if self.is_synthetic else None

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        experiment = self.experiment
        words = described(
            experiment.case, experiment.unknowns, self.posterior, self.truth, self.coverage
        )
        numbers = {
            "unknowns": words.entries,
            "correlation": self.posterior.correlation(),
            "frequencies_hz": experiment.frequencies,
            "levels": experiment.levels or None,
            "channels": experiment.names,
            "noise": experiment.noise,
            "simulations": self.completed,
            "checks": self.checks,
            "uncertain": [asdict(unknown) for unknown in experiment.uncertain],
            "mismatch": self.mismatch,
        }
        text = words.sentence
        return Report(
            name="identification",
            numbers=numbers,
            case=experiment.case,
            fitted=self.fitted,
            tables=[words.table],
            sentences=[f"{text} {self.mismatch}" if self.mismatch else text],
            pictures={"posterior": (words.figure, "")},
        )

    @property
    def fitted(self) -> Case:
        """The case with the medians of the unknowns."""
        middle = self.posterior.quantile(0.5).tolist()
        case = self.experiment.case
        return case.with_overrides(
            {
                key: value
                for unknown, value in zip(self.experiment.unknowns, middle, strict=True)
                for key in unknown.keys(case)
            }
        )


def identify(
    experiment: Experiment,
    directory: Path,
    *,
    measured: Sequence[Path] | None = None,
    simulations: int = 2000,
    finer: int = FINER,
    checks: int = 100,
    seed: int = 1,
    executor: ExecutorName | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Identification:
    """Infer the unknowns of an experiment from measured or simulated motions.

    Args:
        experiment: the rig, its motions and the unknowns.
        directory: folder of the simulations; those that it has are used again.
        measured: files with the channels, one per frequency; None: the case simulates them.
        simulations: number of simulations, with parameters from the prior.
        finer: number of these that are repeated with finer steps and elements, to know what these
            change.
        checks: number of simulations that serve as observations to check the intervals.
        seed: of the prior and of the noise.
        executor: "process", "mpi", "serial", or an executor of `concurrent.futures`.
        workers: number of processes.
        progress: called with the number of finished simulations and of all.

    Raises:
        CaseError: a file does not fit, or too few simulations were completed.
        KeyboardInterrupt: a sweep was interrupted; its points are kept.
    """
    observed = None
    if measured is not None:
        experiment, observed = _read(experiment, measured)
    parameters = statistics.uniform(experiment.bounds, simulations, seed)
    also = drawn(experiment.uncertain, experiment.case, simulations, seed + 3)
    simulate = partial(experiment.simulate, executor=executor, workers=workers, progress=progress)
    harmonics = simulate(parameters, directory / "simulations", also=also)
    finer = min(finer, simulations)
    repeated = None
    if finer:
        some = {key: values[:finer] for key, values in also.items()}
        repeated = simulate(
            parameters[:finer],
            directory / "finer",
            also=some | refined_overrides(experiment.case, finer),
        )
    if observed is None:
        truth = np.array([experiment.truth])
        exact = experiment.simulate(truth, directory / "observation", executor="serial")[0]
        observation = noisy(exact, experiment.error, np.random.default_rng(seed + 1))
        observed = invariant(observation).ravel()
    table = experiment.table(harmonics, parameters, seed + 2, repeated)
    checks = min(checks, len(table.parameters))
    covered = table.coverage(np.arange(checks)) if checks else None
    return Identification(
        experiment, table.posterior(observed), covered, checks, measured is None,
        len(table.parameters), mismatch(experiment, table, observed),
    )  # fmt: skip


def mismatch(
    experiment: Experiment, table: statistics.Simulations, observed: FloatArray
) -> str | None:
    """Return in words how an observation is unlike all simulations; None: it is not."""
    if table.misfit(observed) > statistics.UNLIKE:
        return None
    number = table.outlier(observed)
    names = experiment.names
    # statistics of a frequency, see `invariant`: real parts, then imaginary parts without the first
    each = 2 * len(names) * HARMONICS - 1
    number, of_one = number // each, number % each
    level = f" and level {experiment.levels[number]:g}" if experiment.levels else ""
    channel, harmonic = divmod(of_one if of_one <= each // 2 else of_one - each // 2, HARMONICS)
    return (
        f"The motions are like those of no simulation: harmonic {harmonic + 1} of "
        f"{names[channel]} at {experiment.frequencies[number]:g} Hz{level} fits none with these "
        "values. "
        "The rig differs from the case by more than --uncertain says; the intervals do not hold."
    )


def _read(experiment: Experiment, files: Sequence[Path]) -> tuple[Experiment, FloatArray]:
    """Return the statistics of measured motions, and the experiment with their noise."""
    if len(files) != len(experiment.frequencies):
        raise CaseError(
            f"--measured: expected one file per frequency, given {len(files)} files and "
            f"{len(experiment.frequencies)} frequencies"
        )
    rows = []
    noise = []
    samples = []
    for path, frequency in zip(files, experiment.frequencies, strict=True):
        time, values = measured_histories(path, experiment.names)
        harmonics, scatter = of_history(time, values, frequency)
        rows.append(invariant(harmonics))
        noise.append(scatter)
        samples.append(time.size)
    largest = tuple(np.max(noise, axis=0).tolist())
    return replace(experiment, noise=largest, n_samples=min(samples)), np.concatenate(rows)


def _experiment(case: Case, options: Identify) -> Experiment:
    """Return the experiment that options of a user describe."""
    unknowns = tuple(map(Unknown.parse, options.unknown))
    uncertain = uncertain_keys(case, options.uncertain)
    return Experiment(
        case, options.frequency, unknowns, options.noise, uncertain=uncertain,
        channels=options.channel or (), levels=options.level,
    )  # fmt: skip


def _is_of_responses(options: Identify) -> bool:
    """Return whether the measurements are frequency responses.

    Raises:
        CaseError: only some of them are, or what goes with them is missing.
    """
    are = [has_responses(path) for path in options.measured or ()]
    if any(are) and (not all(are) or options.frequency):
        raise CaseError(
            "identify keys: expected either frequency responses, as measure response writes them, "
            "or motions with --frequency, given both; a fit and simulations have no common "
            "posterior: identify from responses first, and take their intervals as the ranges "
            "KEY=LOW:HIGH of the motions"
        )
    if not any(are) and not options.frequency:
        raise CaseError(
            "identify keys: expected --frequency of motions, or --measured with frequency "
            "responses, which measure response writes, given neither"
        )
    require(
        not (any(are) and options.level), "level",
        "none with frequency responses, whose records may have any level", options.level,
    )  # fmt: skip
    if options.band is not None:
        require(any(are), "band", "none without frequency responses", options.band)
        require(
            len(options.band) == 2 and 0.0 <= options.band[0] < options.band[1], "band",
            "LOW,HIGH with LOW below HIGH", options.band,
        )  # fmt: skip
    return any(are)


def compute(case: Case, options: Identify, context: RunContext) -> Identification | ResponseFit:
    """Identify with options of a user."""
    if _is_of_responses(options):
        return of_responses(
            case,
            options.measured or (),
            tuple(map(Unknown.parse, options.unknown)),
            uncertain_keys(case, options.uncertain),
            names=options.channel or (),
            band=options.band,
            seed=options.seed,
            progress=context.progress,
        )
    return identify(
        _experiment(case, options),
        context.folder,
        measured=options.measured,
        simulations=options.simulations,
        finer=FINER,
        checks=options.calibrate,
        seed=options.seed,
        workers=context.workers,
        progress=context.progress,
    )


def cost(case: Case, options: Identify, workers: int | None) -> tuple[str, Cost]:
    """Return the name and the cost of an identification."""
    if _is_of_responses(options):
        return "fit of responses", Cost(0.0, 0.0, 0.0)
    experiment = _experiment(case, options)
    n_motions = len(options.frequency)
    count = n_motions * (options.simulations + TIMES_FINER * min(FINER, options.simulations))
    first = experiment.sweep(0, statistics.uniform(experiment.bounds, 1, options.seed))
    what = f"identification by {n_motions * options.simulations} simulations"
    return what, sweep_cost(first, workers, count)


def remove(folder: Path) -> None:
    """Remove the simulations in a folder."""
    for part in ("simulations", "finer", "observation"):
        for swept in (folder / part).glob("*-Hz"):
            remove_results(swept)

"""Identify a rig from clapping motions: measure or simulate, infer, check the intervals, write."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from delam_fem.case.atomic import atomic, write_text
from delam_fem.case.files import save_case
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.inference import UNLIKE, Posterior, Table
from delam_fem.studies.executors import ExecutorName
from delam_fem.studies.identification import statistics
from delam_fem.studies.identification.contact import FINER, Experiment
from delam_fem.studies.identification.tips import tips_of

HEADING = ("key", "median", "90 % interval", "prior", "truth", "covered")
SEPARATED = 0.5
"""Two unknowns with a larger correlation than this are hardly separated."""
NAME = "identification.json"


@dataclass(frozen=True)
class Identification:
    """What a measurement says of the unknowns.

    Attributes:
        experiment: the rig and its motions.
        posterior: of the unknowns.
        coverage: how often 90 % intervals contain the truth, by unknown; None: not checked.
        finer: number of simulations that are repeated with finer steps, to know what steps change.
        checks: number of simulations that served as observations for `coverage`.
        is_synthetic: whether the motions were simulated from the case itself.
        completed: number of simulations in the table.
        mismatch: in which way the measurement is unlike all simulations; None: it is not.
    """

    experiment: Experiment
    posterior: Posterior
    coverage: FloatArray | None
    checks: int
    is_synthetic: bool
    completed: int
    mismatch: str | None = None

    @property
    def truth(self) -> list[float] | None:
        """Values of the unknowns in a synthetic measurement."""
        return self.experiment.truth if self.is_synthetic else None

    def rows(self) -> list[tuple[str, ...]]:
        """Return the rows of a table under `HEADING`."""
        middle, interval = self.posterior.quantile(0.5), self.posterior.interval(0.9)
        rows: list[tuple[str, ...]] = []
        for k, unknown in enumerate(self.experiment.unknowns):
            covered = "" if self.coverage is None else f"{100.0 * self.coverage[k]:.0f} %"
            truth = "" if self.truth is None else f"{self.truth[k]:.4g}"
            span = f"{interval[k, 0]:.4g} … {interval[k, 1]:.4g}"
            prior = f"{unknown.low:g} … {unknown.high:g}"
            rows.append((unknown.key, f"{middle[k]:.4g}", span, prior, truth, covered))
        return rows

    def sentence(self) -> str:
        """Return which unknowns the motions do not separate, in a sentence."""
        correlation, keys = self.posterior.correlation(), self.experiment.unknowns
        pairs = [
            f"{keys[j].key} and {keys[i].key} (correlation {correlation[i, j]:+.2f})"
            for i in range(len(keys))
            for j in range(i)
            if abs(correlation[i, j]) > SEPARATED
        ]
        text = "These motions separate the unknowns."
        if pairs:
            text = f"These motions hardly separate {'; '.join(pairs)}."
        return f"{text} {self.mismatch}" if self.mismatch else text

    def save(self, directory: Path) -> list[Path]:
        """Write identification.json and the figure; return their paths."""
        from delam_fem.studies.identification.figures import posterior_figure

        middle, interval = self.posterior.quantile(0.5), self.posterior.interval(0.9)
        numbers = {
            "unknowns": {
                unknown.key: {
                    "median": middle[k],
                    "interval_90": interval[k].tolist(),
                    "prior": [unknown.low, unknown.high],
                    "truth": None if self.truth is None else self.truth[k],
                    "coverage_of_90": None if self.coverage is None else self.coverage[k],
                }
                for k, unknown in enumerate(self.experiment.unknowns)
            },
            "correlation": self.posterior.correlation().tolist(),
            "frequencies_hz": list(self.experiment.frequencies),
            "noise_m": self.experiment.noise,
            "simulations": self.completed,
            "checks": self.checks,
            "uncertain": [asdict(own) for own in self.experiment.doubts],
            "mismatch": self.mismatch,
        }
        path, image = directory / NAME, directory / "posterior.png"
        write_text(path, json.dumps(numbers, indent=2) + "\n")
        figure = posterior_figure(self.posterior, self.experiment.unknowns, self.truth)
        with atomic(image) as temporary:
            figure.savefig(temporary)
        return [path, image]


def identify(
    experiment: Experiment,
    directory: Path,
    *,
    measured: Sequence[Path] | None = None,
    simulations: int = 2000,
    finer: int = 100,
    checks: int = 100,
    seed: int = 1,
    executor: ExecutorName | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Identification:
    """Infer the unknowns of an experiment.

    Args:
        experiment: the rig, its motions and the unknowns.
        directory: folder of the simulations; those that it has are used again.
        measured: files with the tips, one per frequency; None: the case simulates the measurement.
        simulations: number of parameters from the prior.
        finer: number of simulations that are repeated with finer steps, to know what steps change.
        checks: number of simulations that serve as observations to check the intervals.
        seed: of the prior and of the noise.
        executor: see `run_sweep`.
        workers: number of processes.
        progress: called with the number of finished simulations and of all.

    Raises:
        CaseError: a file does not fit, or too few simulations were completed.
    """
    observed = None
    if measured is not None:
        experiment, observed = _read(experiment, measured)
    save_case(experiment.case, directory)
    parameters = experiment.draw(simulations, seed)
    also = experiment.disturbed(simulations, seed + 3)
    simulate = partial(experiment.simulate, executor=executor, workers=workers, progress=progress)
    harmonics = simulate(parameters, directory / "simulations", also=also)
    steps = np.full(min(finer, simulations), FINER * experiment.case.steps_per_period)
    some = {key: values[: steps.size] for key, values in also.items()}
    repeated = None
    if steps.size:
        more = {"time.steps_per_period": steps}
        repeated = simulate(parameters[: steps.size], directory / "finer", also=some | more)
    if observed is None:
        truth = np.array([experiment.truth])
        exact = experiment.simulate(truth, directory / "observation", executor="serial")[0]
        own = statistics.noisy(exact, experiment.error, np.random.default_rng(seed + 1))
        observed = statistics.invariant(own).ravel()
    table = experiment.table(harmonics, parameters, seed + 2, repeated)
    checks = min(checks, len(table.parameters))
    covered = table.coverage(np.arange(checks)) if checks else None
    return Identification(
        experiment, table.posterior(observed), covered, checks, measured is None,
        len(table.parameters), mismatch(experiment, table, observed),
    )  # fmt: skip


def mismatch(experiment: Experiment, table: Table, observed: FloatArray) -> str | None:
    """Return in which way an observation is unlike all simulations; None: it is not."""
    share, number = table.misfit(observed)
    if share > UNLIKE:
        return None
    names = [lamina.name for lamina in experiment.case.lamina]
    each = 2 * len(names) * statistics.HARMONICS - 1
    number, of_one = number // each, number % each
    lamina, harmonic = divmod(
        of_one if of_one <= each // 2 else of_one - each // 2, statistics.HARMONICS
    )
    return (
        f"The motions are like those of no simulation: harmonic {harmonic + 1} of lamina "
        f"{names[lamina]} at {experiment.frequencies[number]:g} Hz fits none with these values. "
        "The rig differs from the case by more than --uncertain says; the intervals do not hold."
    )


def _read(experiment: Experiment, files: Sequence[Path]) -> tuple[Experiment, FloatArray]:
    """Return the statistics of measured motions, and the experiment with their noise."""
    if len(files) != len(experiment.frequencies):
        raise CaseError(
            f"--measured: expected one file per frequency, given {len(files)} files and "
            f"{len(experiment.frequencies)} frequencies"
        )
    rows, noise, samples = [], [], []
    for path, frequency in zip(files, experiment.frequencies, strict=True):
        time, tips = tips_of(experiment.case, path)
        harmonics, scatter = statistics.of_history(time, tips, frequency)
        rows.append(statistics.invariant(harmonics))
        noise.append(scatter)
        samples.append(tips.shape[1])
    known = replace(experiment, noise=max(noise), n_samples=min(samples))
    return known, np.concatenate(rows)

"""Identify the gap, the restitution and other keys of a case from clapping motions.

The posterior follows from simulations alone (`numerics/inference.py`): one sweep over parameters
drawn from the prior for each frequency, and the harmonics of both tips as statistics.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.files import save_case
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.cantilever import ComplexArray
from delam_fem.numerics.inference import FEWEST, Table
from delam_fem.studies.executors import ExecutorName
from delam_fem.studies.identification import statistics
from delam_fem.studies.sweeps.load import sweep_of
from delam_fem.studies.sweeps.run import run_sweep
from delam_fem.studies.unknown import Unknown, drawn, of_rig, value_of

FINER = 4
"""How many times as many steps the repeated simulations have."""
LIKE = 5
"""Number of repeated simulations of which one says what finer steps change."""
BEYOND = 1.5
"""Largest multiple of that change: infinitely many steps change more than `FINER` times as many."""


@dataclass(frozen=True)
class Experiment:
    """Motions of a rig at some frequencies, measured at the reference probes of its laminae.

    Attributes:
        case: the rig; the unknowns replace some of its values.
        frequencies: of the base [Hz].
        unknowns: keys that are sought.
        noise: standard deviation of a sample of the displacement [m].
        n_samples: number of samples of each motion; None: as many as the window of the case.
        uncertain: in what the rig may differ from the case although it is not sought, drawn for
            each simulation; None: see `of_rig`.
    """

    case: Case
    frequencies: tuple[float, ...]
    unknowns: tuple[Unknown, ...]
    noise: float
    n_samples: int | None = None
    uncertain: tuple[Unknown, ...] | None = None

    def __post_init__(self) -> None:
        """Check that the sought keys have values, which the results show."""
        for own in self.unknowns:
            if own.is_relative:
                raise CaseError(
                    f"unknown: {own.key}: expected values of the key, given multiples of its own; "
                    "only --uncertain takes them"
                )

    @property
    def doubts(self) -> tuple[Unknown, ...]:
        """In what the rig may differ from the case."""
        return of_rig(self.case) if self.uncertain is None else self.uncertain

    @property
    def truth(self) -> list[float]:
        """Values that the case itself has for the unknowns."""
        return [value_of(self.case, unknown.keys(self.case)[0]) for unknown in self.unknowns]

    @property
    def error(self) -> float:
        """Standard deviation of the real and of the imaginary part of a harmonic [m]."""
        own = self.case.n_window_periods * self.case.steps_per_period
        return self.noise * math.sqrt(2.0 / (self.n_samples or own))

    def simulate(
        self,
        parameters: FloatArray,
        directory: Path,
        *,
        also: Mapping[str, FloatArray] | None = None,
        executor: ExecutorName | None = None,
        workers: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> ComplexArray:
        """Return the harmonics of the motions with given parameters, without noise.

        Each frequency is a sweep in a folder of its own, which goes on where it was interrupted.

        Args:
            parameters: values of the unknowns, shape (n, n_unknowns).
            directory: folder of the sweeps.
            also: values of further keys, shape (n,) each; the unknowns go before them.
            executor: see `run_sweep`.
            workers: number of processes; default: one per core.
            progress: called with the number of finished simulations and of all.

        Returns:
            Shape (n, n_frequencies, n_laminae, HARMONICS) [m]; NaN for motions that diverged.

        Raises:
            CaseError: the first set of parameters is not a valid case.
            KeyboardInterrupt: a sweep was interrupted; its points are kept.
        """
        found, total = [], len(parameters) * len(self.frequencies)
        directory.mkdir(parents=True, exist_ok=True)
        save_case(self.case, directory)
        for number, frequency in enumerate(self.frequencies):
            sweep = sweep_of(self._sweep(parameters, frequency, also or {}), folder=directory)
            done = number * len(parameters)
            report = None if progress is None else _shifted(progress, done, total)
            data = run_sweep(
                sweep, directory / f"{frequency:g}-Hz", executor, workers=workers,
                resume=True, progress=report,
            )  # fmt: skip
            with data:
                if data.attrs["outcome"] != "completed":
                    raise KeyboardInterrupt
                found.append(statistics.of_points(data))
        return np.stack(found, axis=1)

    def disturbed(self, n: int, seed: int) -> dict[str, FloatArray]:
        """Return n values of each key in which the rig may differ from the case."""
        return drawn(self.doubts, self.case, n, seed)

    def table(
        self, harmonics: ComplexArray, parameters: FloatArray, seed: int,
        finer: ComplexArray | None = None,
    ) -> Table:  # fmt: skip
        """Return the simulations with noise as a table for the inference.

        The steps of the simulations are not those of a rig. To each simulation is added, times a
        number between 0 and `BEYOND`, what finer steps change in one of the `LIKE` simulations with
        the nearest parameters that were repeated.

        Args:
            harmonics: of the simulations, see `simulate`.
            parameters: of the simulations, shape (n, n_unknowns).
            seed: of the noise.
            finer: the first of them repeated with finer steps; None: none.

        Raises:
            CaseError: too few simulations were completed.
        """
        rng = np.random.default_rng(seed)
        if finer is not None:
            harmonics = harmonics + _discrepancy(finer, harmonics, parameters, rng)
        values = statistics.invariant(statistics.noisy(harmonics, self.error, rng))
        values = values.reshape(len(values), -1)
        good = np.isfinite(values).all(axis=1)
        if np.count_nonzero(good) < FEWEST:
            raise CaseError(
                f"identification: expected at least {FEWEST} simulations, {good.sum()} of "
                f"{good.size} were completed"
            )
        bounds = np.array([(unknown.low, unknown.high) for unknown in self.unknowns])
        return Table(parameters[good], values[good], bounds)

    def draw(self, n: int, seed: int) -> FloatArray:
        """Return parameters from the prior, shape (n, n_unknowns)."""
        low = np.array([unknown.low for unknown in self.unknowns])
        high = np.array([unknown.high for unknown in self.unknowns])
        return np.asarray(np.random.default_rng(seed).uniform(low, high, (n, low.size)))

    def _sweep(
        self, parameters: FloatArray, frequency: float, also: Mapping[str, FloatArray]
    ) -> dict[str, object]:
        """Return the sweep over given parameters at a frequency."""
        columns = dict(also)
        for unknown, column in zip(self.unknowns, parameters.T, strict=True):
            columns |= dict.fromkeys(unknown.keys(self.case), column)
        axes = [
            {"key": key, "name": key.replace(".", "_"), "values": column.tolist()}
            for key, column in columns.items()
        ]
        return {
            "name": f"identification-{frequency:g}-Hz",
            "base": "case.toml",
            "set": {"excitation.frequency": frequency},
            "axis": axes,
            "combine": "zip",
            "record": {"summary": False, "strobes": 0, "harmonics": statistics.HARMONICS},
        }


def _discrepancy(
    finer: ComplexArray, harmonics: ComplexArray, parameters: FloatArray, rng: np.random.Generator
) -> ComplexArray:
    """Return what finer steps may change in all simulations; see `Experiment.table`."""
    change = finer - harmonics[: len(finer)]
    whole = np.flatnonzero(np.isfinite(change).reshape(len(change), -1).all(axis=1))
    if whole.size == 0:
        return np.zeros_like(harmonics)
    places = parameters / parameters.std(axis=0)
    distance = np.linalg.norm(places[:, None] - places[None, whole], axis=2)
    like = np.argsort(distance, axis=1)[:, :LIKE]
    chosen = like[np.arange(len(like)), rng.integers(like.shape[1], size=len(like))]
    share = rng.uniform(0.0, BEYOND, size=(len(like), 1, 1, 1))
    return np.asarray(share * change[whole[chosen]])


def _shifted(
    progress: Callable[[int, int], None], before: int, total: int
) -> Callable[[int, int], None]:
    """Return a progress function that counts on after `before` simulations."""
    return lambda done, _: progress(before + done, total)

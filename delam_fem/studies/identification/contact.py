"""Identify the gap, the restitution and other keys of a case from clapping motions.

The posterior follows from simulations alone (`numerics/inference.py`): one sweep over parameters
drawn from the prior for each frequency, and the harmonics of both tips as statistics.
"""

from __future__ import annotations

import math
from collections.abc import Callable
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

EVERY = "lamina.*."
"""Start of a key that stands for the same key of all laminae."""


@dataclass(frozen=True)
class Unknown:
    """A key whose value is sought, with a uniform prior.

    Attributes:
        key: key of the case; `lamina.*.KEY` is KEY of all laminae.
        low: lowest value.
        high: highest value.
    """

    key: str
    low: float
    high: float

    @classmethod
    def parse(cls, text: str) -> Unknown:
        """Return the unknown of a text such as "gap.exponent=1:3".

        Raises:
            CaseError: the text has another form, or its values do not rise.
        """
        key, _, bounds = text.partition("=")
        try:
            low, high = (float(part) for part in bounds.split(":"))
        except ValueError:
            low = high = math.nan
        if not key or not low < high:
            raise CaseError(f"unknown: expected KEY=LOW:HIGH with LOW below HIGH, given {text!r}")
        return cls(key, low, high)

    def keys(self, case: Case) -> tuple[str, ...]:
        """Return the keys of the case that have the value."""
        if not self.key.startswith(EVERY):
            return (self.key,)
        last = self.key.removeprefix(EVERY)
        return tuple(f"lamina.{lamina.name}.{last}" for lamina in case.lamina)


@dataclass(frozen=True)
class Experiment:
    """Motions of a rig at some frequencies, measured at the reference probes of its laminae.

    Attributes:
        case: the rig; the unknowns replace some of its values.
        frequencies: of the base [Hz].
        unknowns: keys that are sought.
        noise: standard deviation of a sample of the displacement [m].
        n_samples: number of samples of each motion; None: as many as the window of the case.
    """

    case: Case
    frequencies: tuple[float, ...]
    unknowns: tuple[Unknown, ...]
    noise: float
    n_samples: int | None = None

    @property
    def truth(self) -> list[float]:
        """Values that the case itself has for the unknowns."""
        return [self._value(unknown.keys(self.case)[0]) for unknown in self.unknowns]

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
        executor: ExecutorName | None = None,
        workers: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> ComplexArray:
        """Return the harmonics of the motions with given parameters, without noise.

        Each frequency is a sweep in a folder of its own, which goes on where it was interrupted.

        Args:
            parameters: values of the unknowns, shape (n, n_unknowns).
            directory: folder of the sweeps.
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
            sweep = sweep_of(self._sweep(parameters, frequency), folder=directory)
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

    def table(self, harmonics: ComplexArray, parameters: FloatArray, seed: int) -> Table:
        """Return the simulations with noise as a table for the inference.

        Raises:
            CaseError: too few simulations were completed.
        """
        rng = np.random.default_rng(seed)
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

    def _value(self, key: str) -> float:
        """Return a number of the case by its key."""
        found: object = self.case
        for part in key.split("."):
            if isinstance(found, tuple):
                found = next(entry for entry in found if entry.name == part)
            else:
                found = getattr(found, part, None)
        return float(found) if isinstance(found, int | float) else math.nan

    def _sweep(self, parameters: FloatArray, frequency: float) -> dict[str, object]:
        """Return the sweep over given parameters at a frequency."""
        axes = [
            {"key": key, "name": key.replace(".", "_"), "values": column.tolist()}
            for unknown, column in zip(self.unknowns, parameters.T, strict=True)
            for key in unknown.keys(self.case)
        ]
        return {
            "name": f"identification-{frequency:g}-Hz",
            "base": "case.toml",
            "set": {"excitation.frequency": frequency},
            "axis": axes,
            "combine": "zip",
            "record": {"summary": False, "strobes": 0, "harmonics": statistics.HARMONICS},
        }


def _shifted(
    progress: Callable[[int, int], None], before: int, total: int
) -> Callable[[int, int], None]:
    """Return a progress function that counts on after `before` simulations."""
    return lambda done, _: progress(before + done, total)

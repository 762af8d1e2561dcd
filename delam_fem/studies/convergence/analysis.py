"""Analyse the results of a ladder: statistics, errors against limits, extrapolations, costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.numerics import extrapolation
from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.convergence.ladder import Ladder, Rung
from delam_fem.studies.convergence.rung import RungResult
from delam_fem.studies.convergence.statistics import Statistic, extrema
from delam_fem.studies.linear import first_frequencies, linear_amplitudes

NOISE = 2.0
"""Standard errors of the means that an interval holds."""


@dataclass(frozen=True)
class Convergence:
    """A ladder with the results of its finished rungs.

    Attributes:
        ladder: the ladder.
        results: results by the key of the rung.
    """

    ladder: Ladder
    results: dict[str, RungResult]

    @property
    def n_laminae(self) -> int:
        """Number of laminae."""
        return len(self.ladder.case.lamina)

    @property
    def extrema(self) -> tuple[Statistic, ...]:
        """Extremes of all laminae, from bottom to top."""
        return extrema(self.n_laminae)

    @property
    def is_complete(self) -> bool:
        """Whether every rung has a result, with any outcome."""
        return all(rung.key in self.results for rung in self.ladder.rungs())

    def value(self, rung: Rung, name: str) -> float:
        """Return the mean of a statistic; NaN if the rung has none."""
        return self._entry(rung, name)[0]

    def scatter(self, rung: Rung, name: str) -> float:
        """Return the scatter of a statistic between blocks; NaN if the rung has none."""
        return self._entry(rung, name)[1]

    def standard_error(self, rung: Rung, name: str) -> float:
        """Return the standard error of the mean of a statistic."""
        blocks = self.value(rung, "blocks")
        return self.scatter(rung, name) / math.sqrt(blocks) if blocks > 0.0 else math.nan

    def limit(self, rungs: Sequence[Rung], name: str, *, by: str = "steps") -> extrapolation.Limit:
        """Extrapolate a statistic along rungs that refine `by` "steps", "elements" or "points"."""
        sizes = [1.0 / getattr(rung, by) for rung in rungs]
        values = [self.value(rung, name) for rung in rungs]
        errors = [self.standard_error(rung, name) for rung in rungs]
        return extrapolation.limit(sizes, values, errors)

    def error(self, rung: Rung, reference: Rung | None = None) -> float:
        """Return the distance of the tip extremes from the rigid limit.

        Args:
            rung: a rung with contact.
            reference: rung that stands for the limit; by default the limit of the same mesh.

        Returns:
            The largest difference of all extremes, each in half peak-to-peak displacements of its
            lamina in the limit [-]; NaN if either is missing or if the ladder has no limit.
        """
        if reference is None:
            if not self.ladder.has_limit:
                return math.nan
            reference = self.ladder.limit_of(rung.mesh)
        exact, half = self._scale(reference)
        found = np.array([self.value(rung, q.name) for q in self.extrema])
        return float(np.abs((found - exact) / half).max())

    def interval(self, rung: Rung, rungs: Sequence[Rung], by: str) -> tuple[float, float]:
        """Return how far a rung is from the limit, and the uncertainty of that [-].

        The distance is `error`, over meshes from the finest rung. Beyond the finest, errors go on
        as a power of the size that the last three rungs show, of order 1 at most. `NOISE` standard
        errors of the means are added.

        Args:
            rung: a rung with contact.
            rungs: rungs that refine `by` "steps", "elements" or "points", from coarse to fine.
            by: what they refine.

        Returns:
            A NaN uncertainty without two rungs that are finer; infinite if errors do not shrink.
        """
        finest = rungs[-1]
        is_limit = by == "steps" and self.ladder.has_limit
        away = self.error(rung, None if is_limit else finest)
        if rung not in rungs[:-2]:
            return away, math.nan
        first, second = (self.error(a, b) for a, b in pairwise(rungs[-3:]))
        noise = NOISE * (self._noise(rung, finest) + self._noise(finest, finest))
        a, b, c = (1.0 / getattr(one, by) for one in rungs[-3:])
        at_first_order = first * (b - c) / (a - b)
        if second <= max(noise, at_first_order):  # a small difference may be chance
            return away, max(second, at_first_order) / (b / c - 1.0) + noise
        order = extrapolation.observed_orders([a, b, c], [first + second, second, 0.0])[0]
        is_shrinking = order >= extrapolation.LOWEST_ORDER
        left = second / ((b / c) ** order - 1.0) if is_shrinking else math.inf
        return away, left + noise

    def _noise(self, rung: Rung, reference: Rung) -> float:
        """Return the largest standard error of the extremes of a rung, in units of `error`."""
        own = np.array([self.standard_error(rung, q.name) for q in self.extrema])
        return float((own / self._scale(reference)[1]).max())

    def _scale(self, reference: Rung) -> tuple[FloatArray, FloatArray]:
        """Return the extremes of a rung, and half of each lamina's peak-to-peak displacement."""
        exact = np.array([self.value(reference, q.name) for q in self.extrema])
        return exact, np.repeat((exact[1::2] - exact[0::2]) / 2.0, 2)

    def free_errors(self, rung: Rung) -> FloatArray:
        """Return the relative errors of a rung without contact; see `exact_free_motion`.

        Returns:
            Errors of the frequency and the amplitude of each lamina against the exact ones,
            lamina by lamina, shape (2 n_laminae,) [-]; NaN if the rung is missing.
        """
        frequencies, amplitudes = exact_free_motion(rung.case)
        return np.array(
            [
                self.value(rung, f"{name}_{i + 1}") / exact[i] - 1.0
                for i in range(self.n_laminae)
                for name, exact in (("frequency", frequencies), ("amplitude", amplitudes))
            ]
        )

    def cost(self, rung: Rung) -> float:
        """Return the processor time of a period [s]; NaN if the rung has no result."""
        result = self.results.get(rung.key)
        return math.nan if result is None else 1e-6 * result.microseconds_per_step * rung.steps

    def _entry(self, rung: Rung, name: str) -> tuple[float, float]:
        result = self.results.get(rung.key)
        missing = (math.nan, math.nan)
        return missing if result is None else result.statistics.get(name, missing)


def exact_free_motion(case: Case) -> tuple[list[float], list[float]]:
    """Return first frequencies [Hz] and tip amplitudes [m] of all laminae without contact."""
    amplitudes = linear_amplitudes(case, np.array([1.0 / case.period]))[:, 0]
    return [omega / (2.0 * math.pi) for omega in first_frequencies(case)], amplitudes.tolist()

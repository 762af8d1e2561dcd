"""Infer parameters from simulations alone: approximate Bayesian computation by regression.

A table of simulations with parameters from the prior serves every observation:

1. A ridge regression of the parameters on the statistics and their products predicts as many
   summary statistics as there are parameters (semi-automatic statistics: Fearnhead and Prangle,
   J. R. Stat. Soc. B 74, 2012). The regression for a simulation does not know it.
2. The simulations whose summaries are nearest to those of the observation are accepted.
3. A weighted linear regression among them moves their parameters to where the observation is, and
   scales their scatter (Beaumont, Zhang and Balding, Genetics 162, 2002; Blum and François,
   Stat. Comput. 20, 2010).

Parameters are bounded; the regressions use their logits. The statistics of the table must contain
the noise of the measurement, one realisation in each simulation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import f as f_distribution

from delam_fem.numerics.arrays import FloatArray, IntArray

PENALTIES = np.geomspace(1e-4, 1e2, 13)
"""Penalties of the ridge regression, for statistics of variance 1; cross-validation chooses."""
FOLDS = 10
"""Number of parts of the simulations, each of which is predicted from the others."""
ACCEPTED = 0.08
"""Share of the simulations that are accepted; with 3 % the 90 % intervals of 3000 simulations of a
clapping rig covered the truth in 85 to 91 of 100 cases, with 8 % in 89 to 91."""
FEWEST = 100
"""Smallest number of simulations that are accepted."""
UNLIKE = 1e-3
"""An observation is unlike the simulations if so few of them are as far from their like."""
EDGE = 1e-6
"""Parameters keep so far from their bounds, relative to the range."""


@dataclass(frozen=True)
class Posterior:
    """A sample of the posterior distribution.

    Attributes:
        samples: parameters, shape (k, n_parameters).
        weights: of the samples, sum 1, shape (k,).
    """

    samples: FloatArray
    weights: FloatArray

    def quantile(self, q: float) -> FloatArray:
        """Return a quantile of each parameter, shape (n_parameters,)."""
        found = np.empty(self.samples.shape[1])
        for j, column in enumerate(self.samples.T):
            order = np.argsort(column)
            middles = np.cumsum(self.weights[order]) - 0.5 * self.weights[order]
            found[j] = np.interp(q, middles, column[order])
        return found

    def interval(self, level: float = 0.9) -> FloatArray:
        """Return the central interval of each parameter, shape (n_parameters, 2)."""
        tail = 0.5 * (1.0 - level)
        return np.stack([self.quantile(tail), self.quantile(1.0 - tail)], axis=1)

    def correlation(self) -> FloatArray:
        """Return the correlations of the parameters, shape (n_parameters, n_parameters)."""
        covariance = np.cov(self.samples.T, aweights=self.weights)
        size = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(size, size))


@dataclass(frozen=True)
class Table:
    """Simulations with parameters from a prior that is uniform within bounds.

    Attributes:
        parameters: shape (n, n_parameters).
        statistics: of the simulations, with noise, shape (n, n_statistics).
        bounds: lowest and highest value of each parameter, shape (n_parameters, 2).
    """

    parameters: FloatArray
    statistics: FloatArray
    bounds: FloatArray

    def posterior(self, observed: FloatArray, *, accepted: float = ACCEPTED) -> Posterior:
        """Return the posterior of the parameters for an observation.

        Args:
            observed: its statistics, shape (n_statistics,).
            accepted: share of the simulations that are accepted.

        Raises:
            ValueError: the table has fewer than `FEWEST` simulations, or the observation numbers
                that are not finite.
        """
        if not np.isfinite(observed).all():
            raise ValueError(f"inference: expected finite statistics, given {observed.tolist()}")
        summaries, predict = self._regressed
        return self._accepted(self._logit(), summaries, predict(observed), accepted)

    def misfit(self, observed: FloatArray) -> tuple[float, int]:
        """Return how likely simulations are farther from their like than an observation is.

        Among the accepted simulations the statistics are regressed on the summaries. What is left
        of the observation is compared with what is left of them (Hotelling's T² of a new sample).

        Args:
            observed: its statistics, shape (n_statistics,).

        Returns:
            The probability, and the number of the statistic that is farthest off.
        """
        size = self.statistics.std(axis=0)
        varies = np.flatnonzero(size > 0.0)
        values, own = (rows[..., varies] / size[varies] for rows in (self.statistics, observed))
        logits, (summaries, predict) = self._logit(), self._regressed
        seen = predict(observed)
        distance = np.linalg.norm((summaries - seen) / (logits - summaries).std(axis=0), axis=1)
        n, p, q = max(FEWEST, len(values) // 4), varies.size, summaries.shape[1]
        near = np.argsort(distance)[: min(n, len(values))]
        columns = _products(np.concatenate([np.ones((near.size, 1)), summaries[near] - seen], 1))
        slopes = np.linalg.lstsq(columns, values[near], rcond=None)[0]
        rest, left = values[near] - columns @ slopes, own - _products(np.eye(1, 1 + q))[0] @ slopes
        covariance = np.cov(rest.T).reshape(p, p) + EDGE * np.eye(p)
        squares = float(left @ np.linalg.solve(covariance, left))
        free = near.size - columns.shape[1] - p
        share = float(f_distribution.sf(squares * free / (p * near.size), p, free))
        return share, int(varies[np.argmax(np.abs(left) / np.sqrt(np.diag(covariance)))])

    def coverage(
        self, indices: IntArray, level: float = 0.9, *, accepted: float = ACCEPTED
    ) -> FloatArray:
        """Return how often central intervals contain the truth, with simulations as observations.

        Each of them is left out of the simulations that judge it.

        Source: Talts, Betancourt, Simpson, Vehtari and Gelman, "Validating Bayesian inference
        algorithms with simulation-based calibration", arXiv:1804.06788 (2018).

        Args:
            indices: numbers of the simulations that serve as observations.
            level: of the intervals.
            accepted: share of the simulations that are accepted.

        Returns:
            Share of the observations whose interval contains the truth, shape (n_parameters,).
        """
        logits, (summaries, _) = self._logit(), self._regressed
        hits = np.zeros(self.parameters.shape[1])
        for index in indices.tolist():
            others = np.arange(len(logits)) != index
            posterior = self._accepted(
                logits[others], summaries[others], summaries[index], accepted
            )
            low, high = posterior.interval(level).T
            truth = self.parameters[index]
            hits += (truth >= low) & (truth <= high)
        return np.asarray(hits / indices.size)

    @cached_property
    def _regressed(self) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
        """The summaries of all simulations, and the function that gives those of an observation."""
        return _summaries(self.statistics, self._logit())

    def _accepted(
        self, logits: FloatArray, summaries: FloatArray, seen: FloatArray, share: float
    ) -> Posterior:
        """Return the posterior from the simulations whose summaries are nearest to an observation.

        Args:
            logits: of the parameters, shape (n, p).
            summaries: shape (n, p).
            seen: summary of the observation, shape (p,).
            share: of the simulations that are accepted.
        """
        spread = (logits - summaries).std(axis=0)
        distance = np.linalg.norm((summaries - seen) / spread, axis=1)
        near = np.argsort(distance)[: max(FEWEST, round(share * len(logits)))]
        reach = distance[near[-1]]
        weights = 1.0 - (distance[near] / reach) ** 2 if reach > 0.0 else np.ones(near.size)
        moved = _moved(logits[near], (summaries[near] - seen) / spread, weights)
        return Posterior(self._value(moved), weights / weights.sum())

    def _logit(self) -> FloatArray:
        """Return log(s / (1 - s)) of the places s of the parameters between their bounds.

        Raises:
            ValueError: the table has fewer than `FEWEST` simulations.
        """
        if len(self.parameters) < FEWEST:
            raise ValueError(
                f"inference: expected at least {FEWEST} simulations, given {len(self.parameters)}"
            )
        low, high = self.bounds.T
        share = np.clip((self.parameters - low) / (high - low), EDGE, 1.0 - EDGE)
        return np.asarray(np.log(share / (1.0 - share)))

    def _value(self, logits: FloatArray) -> FloatArray:
        low, high = self.bounds.T
        found: FloatArray = low + (high - low) * 0.5 * (1.0 + np.tanh(0.5 * logits))
        return found


def _summaries(
    statistics: FloatArray, targets: FloatArray
) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
    """Return the targets that ridge regressions predict for simulations and for an observation.

    Each tenth of the simulations is predicted by a regression on the others. Otherwise the
    simulations would seem to be known better than the observation, which gets the mean.

    Returns:
        Shape (n, p), and a function of statistics that returns shape (p,).
    """
    mean, size = statistics.mean(axis=0), statistics.std(axis=0)
    varies = size > 0.0
    columns = _products((statistics[:, varies] - mean[varies]) / size[varies])
    middle, scale = columns.mean(axis=0), columns.std(axis=0)
    columns = (columns - middle) / scale
    centre = targets.mean(axis=0)
    normal, right = columns.T @ columns, columns.T @ (targets - centre)
    penalty = _penalty(columns, targets - centre, normal, right)
    found, mean_slopes = np.empty_like(targets), np.zeros_like(right)
    for fold in range(FOLDS):
        rows = columns[fold::FOLDS]
        matrix = normal - rows.T @ rows
        matrix[np.diag_indices_from(matrix)] += penalty
        slopes = np.linalg.solve(matrix, right - rows.T @ (targets[fold::FOLDS] - centre))
        found[fold::FOLDS] = centre + rows @ slopes
        mean_slopes += slopes / FOLDS

    def predict(observed: FloatArray) -> FloatArray:
        own = _products((observed[None, varies] - mean[varies]) / size[varies])
        return np.asarray(centre + ((own - middle) / scale @ mean_slopes)[0])

    return found, predict


def _penalty(
    columns: FloatArray, targets: FloatArray, normal: FloatArray, right: FloatArray
) -> float:
    """Return the penalty of the ridge regression with the smallest errors if one row is left out.

    Args:
        columns: regressors X, shape (n, m).
        targets: Y, shape (n, p).
        normal: XᵀX, shape (m, m).
        right: XᵀY, shape (m, p).
    """
    values, vectors = np.linalg.eigh(normal)
    values, turned, projected = np.maximum(values, 0.0), columns @ vectors, vectors.T @ right
    sizes = []
    for penalty in len(columns) * PENALTIES:
        inverse = 1.0 / (values + penalty)
        leverage = 1.0 / len(columns) + turned**2 @ inverse
        errors = (targets - turned @ (inverse[:, None] * projected)) / (1.0 - leverage)[:, None]
        sizes.append(np.mean(errors**2))
    return float(len(columns) * PENALTIES[np.argmin(sizes)])


def _products(values: FloatArray) -> FloatArray:
    """Return values and their products of two, shape (n, m + m (m + 1) / 2)."""
    first, second = np.triu_indices(values.shape[1])
    return np.concatenate([values, values[:, first] * values[:, second]], axis=1)


def _moved(logits: FloatArray, offsets: FloatArray, weights: FloatArray) -> FloatArray:
    """Return accepted parameters moved to the observation: mean and scatter by regression."""
    columns = np.column_stack([np.ones(len(offsets)), offsets])
    roots = np.sqrt(weights)[:, None]
    slopes = np.linalg.lstsq(roots * columns, roots * logits, rcond=None)[0]
    rest = logits - columns @ slopes
    sizes = np.log(rest**2 + np.finfo(np.float64).tiny)
    growth = np.linalg.lstsq(roots * columns, roots * sizes, rcond=None)[0]
    result: FloatArray = slopes[0] + rest * np.exp(-0.5 * (columns[:, 1:] @ growth[1:]))
    return result

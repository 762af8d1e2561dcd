"""Infer parameters from simulations alone: approximate Bayesian computation by regression.

A table of simulations with parameters from the prior serves every observation:

1. A ridge regression of the parameters on the statistics and their products gives as many summary
   statistics as there are parameters (semi-automatic statistics: Fearnhead and Prangle, J. R. Stat.
   Soc. B 74, 2012).
2. The simulations whose summaries are nearest to those of the observation are accepted.
3. A weighted linear regression among them moves their parameters to where the observation is, and
   scales their scatter (Beaumont, Zhang and Balding, Genetics 162, 2002; Blum and François,
   Stat. Comput. 20, 2010).

Parameters are bounded; the regressions use their logits. The statistics of the table must contain
the noise of the measurement, one realisation in each simulation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from delam_fem.numerics.arrays import FloatArray, IntArray

RIDGE = 1e-3
"""Penalty of the regression for statistics of variance 1."""
ACCEPTED = 0.03
"""Share of the simulations that are accepted."""
FEWEST = 100
"""Smallest number of simulations that are accepted."""
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

    def without(self, index: int) -> Table:
        """Return the table without a simulation, which can then serve as an observation."""
        return Table(
            np.delete(self.parameters, index, axis=0),
            np.delete(self.statistics, index, axis=0),
            self.bounds,
        )

    def posterior(self, observed: FloatArray, *, accepted: float = ACCEPTED) -> Posterior:
        """Return the posterior of the parameters for an observation.

        Args:
            observed: its statistics, shape (n_statistics,).
            accepted: share of the simulations that are accepted.

        Raises:
            ValueError: the table has fewer than `FEWEST` simulations.
        """
        n = len(self.parameters)
        if n < FEWEST:
            raise ValueError(f"inference: expected at least {FEWEST} simulations, given {n}")
        logits = self._logit(self.parameters)
        summaries, seen = _summaries(self.statistics, logits, observed)
        spread = (logits - summaries).std(axis=0)
        distance = np.linalg.norm((summaries - seen) / spread, axis=1)
        near = np.argsort(distance)[: max(FEWEST, round(accepted * n))]
        reach = distance[near[-1]]
        weights = 1.0 - (distance[near] / reach) ** 2 if reach > 0.0 else np.ones(near.size)
        moved = _moved(logits[near], (summaries[near] - seen) / spread, weights)
        return Posterior(self._value(moved), weights / weights.sum())

    def _logit(self, parameters: FloatArray) -> FloatArray:
        """Return log(s / (1 - s)) of the places s of parameters between their bounds."""
        low, high = self.bounds.T
        share = np.clip((parameters - low) / (high - low), EDGE, 1.0 - EDGE)
        return np.asarray(np.log(share / (1.0 - share)))

    def _value(self, logits: FloatArray) -> FloatArray:
        low, high = self.bounds.T
        found: FloatArray = low + (high - low) * 0.5 * (1.0 + np.tanh(0.5 * logits))
        return found


def coverage(
    table: Table, indices: IntArray, level: float = 0.9, *, accepted: float = ACCEPTED
) -> FloatArray:
    """Return how often central intervals contain the truth, for simulations taken as observations.

    Source: Talts, Betancourt, Simpson, Vehtari and Gelman, "Validating Bayesian inference
    algorithms with simulation-based calibration", arXiv:1804.06788 (2018).

    Args:
        table: all simulations; each observation is left out of the table that judges it.
        indices: numbers of the simulations that serve as observations.
        level: of the intervals.
        accepted: share of the simulations that are accepted.

    Returns:
        Share of the observations whose interval contains the truth, shape (n_parameters,).
    """
    hits = np.zeros(table.parameters.shape[1])
    for index in indices.tolist():
        posterior = table.without(index).posterior(table.statistics[index], accepted=accepted)
        low, high = posterior.interval(level).T
        hits += (table.parameters[index] >= low) & (table.parameters[index] <= high)
    return hits / indices.size


def _summaries(
    statistics: FloatArray, targets: FloatArray, observed: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the predicted targets of all simulations, shape (n, p), and of the observation."""
    mean, size = statistics.mean(axis=0), statistics.std(axis=0)
    varies = size > 0.0
    columns = _products((statistics[:, varies] - mean[varies]) / size[varies])
    own = _products((observed[None, varies] - mean[varies]) / size[varies])
    middle, scale = columns.mean(axis=0), columns.std(axis=0)
    columns, own = (columns - middle) / scale, (own - middle) / scale
    centre = targets.mean(axis=0)
    normal = columns.T @ columns / len(columns)
    normal[np.diag_indices_from(normal)] += RIDGE
    slopes = np.linalg.solve(normal, columns.T @ (targets - centre) / len(columns))
    return centre + columns @ slopes, (centre + own @ slopes)[0]


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

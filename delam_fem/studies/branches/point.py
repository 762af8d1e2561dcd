"""One accepted point of a branch, and what is measured there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.orbits.coarse import Solved, by_parameter
from delam_fem.studies.orbits.ensemble import Ensemble
from delam_fem.studies.orbits.multipliers import Multipliers, Stability, multipliers
from delam_fem.studies.orbits.search import run_on, within


@dataclass(frozen=True)
class Point:
    """A point of a branch.

    Attributes:
        state: z at the beginning of the orbit, shape (2 n,).
        parameter: λ.
        slow: its slow coordinates, shape (m,).
        residual, residual_error: of the mean map, relative to the norm of the slow coordinates.
        parameter_error: standard error of λ, as the point lies on the branch.
        derivatives: of the slow coordinates, independent estimates, shape (k, m, m).
        decays: of kicks, see `Ensemble.decays`, shape (n + 1, k, m).
        by_parameter: derivative of the slow coordinates of the mean map by λ, shape (m,).
        tangent: of the branch in (slow / scale, λ / span), of length 1, shape (m + 1,).
        step: length of the step that led here, for the next one.
        iterations: evaluations of the mean map.
        strobes: displacement of the observed points once in each period, shape
            (P, n_seen) [m].
        low, high: smallest and largest displacement of these points, shape (n_seen,) [m].
        gaps: smallest gap between the tips in each period, shape (P,) [m].
        doubled: distance of states P periods apart of the motion that runs on from the point, if
            it repeats after a multiple of P only, relative to the state; 0 otherwise.
    """

    state: FloatArray
    parameter: float
    slow: FloatArray
    residual: float
    residual_error: float
    parameter_error: float
    derivatives: FloatArray
    decays: FloatArray
    by_parameter: FloatArray
    tangent: FloatArray
    step: float
    iterations: int
    strobes: FloatArray
    low: FloatArray
    high: FloatArray
    gaps: FloatArray
    doubled: float

    @property
    def scale(self) -> float:
        """Norm of the slow coordinates."""
        return float(np.linalg.norm(self.slow))

    @property
    def multipliers(self) -> Multipliers:
        """Multipliers with their samples."""
        return multipliers(self.decays)

    @property
    def stability(self) -> Stability:
        """What the multipliers say; no point is stable beside a motion of a multiple of P."""
        found = self.multipliers.stability
        return "undecided" if found == "stable" and self.doubled else found

    def x(self, span: float) -> FloatArray:
        """Return (slow / scale, λ / span), shape (m + 1,)."""
        return np.append(self.slow / self.scale, self.parameter / span)


def measured(
    ensemble: Ensemble, at: Solved, *, heading: FloatArray, span: float, step: float
) -> Point:
    """Return what is known at a solved point.

    Args:
        ensemble: the mean map.
        at: the solved point.
        heading: the way in (slow, λ) that the branch has come, in units of z and λ, shape (m + 1,).
        span: unit of λ.
        step: length of the step that led here.
    """
    map_ = ensemble.map
    y = map_.slow.of(at.state)
    scale = float(np.linalg.norm(y))
    derivatives = ensemble.derivatives(at.state, at.parameter, scale)
    slope = by_parameter(ensemble, at.guess(scale), SLOPE * span)
    try:
        multiple = run_on(ensemble, at.guess(scale))[1]
    except ArithmeticError:
        multiple = None
    kicked = within(ensemble, at.guess(scale), multiple)
    seen = map_.watched(at.state, at.parameter, ensemble.periods)
    units = np.append(np.full(y.size, scale), span)
    gaps = seen.gaps if seen.gaps.size else np.full(ensemble.periods, seen.smallest_gap)
    error = at.uncertainty[-1] * span if at.uncertainty.size > y.size else 0.0
    return Point(
        at.state,
        at.parameter,
        y,
        at.residual,
        at.residual_error,
        float(error),
        derivatives,
        kicked.decays(at.state, at.parameter, scale),
        slope,
        tangent(derivatives.mean(axis=0), slope * span / scale, heading / units),
        step,
        at.iterations,
        seen.strobes,
        seen.low,
        seen.high,
        gaps,
        0.0 if multiple is None else multiple.distance,
    )


SLOPE = 0.02
"""Step of λ for the derivative by λ, relative to the span."""


def tangent(derivative: FloatArray, slope: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the direction of the branch, of length 1, shape (m + 1,).

    It is the mean of the tangent of F(y, λ) = y and of the way that the branch has come, because
    both are known to some degrees only.

    Args:
        derivative: of F by y, shape (m, m).
        slope: of F by λ, shape (m,).
        heading: the way that the branch has come, of any length, in the same units, shape (m + 1,).
    """
    rows = np.c_[derivative - np.eye(len(derivative)), slope]
    direction, came = np.linalg.svd(rows)[2][-1], heading / np.linalg.norm(heading)
    both = came + (direction if direction @ came >= 0.0 else -direction)
    return np.asarray(both / np.linalg.norm(both))

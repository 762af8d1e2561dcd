"""Solve for an orbit of the mean map: Newton in the slow coordinates, Picard in the rest.

    y = slow part of F(z, λ),  w = rest of F(z, λ),   z = basis y + w                       (N1)

Newton's method needs the derivative in the few slow coordinates alone; the rest decays by itself
from one period to the next and is taken over. With λ unknown too, the equations are bordered by

    t · (x - x_predicted) = 0,   x = (y / scale, λ / span)                                  (N2)

which passes folds. F is known to its standard error only. An iteration ends when the residual lies
within that error; a residual that stays above it is reported as it is.

Source: Lust, Roose, Spence, Champneys, SIAM J. Sci. Comput. 19 (1998) 1188-1209.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.orbits.ensemble import Ensemble, Mean

FEWEST, MOST = 3, 14
"""Iterations: so many that the rest has settled, and so many before a step is given up."""
WITHIN = 2.0
"""Standard errors within which a residual counts as zero."""
SMOOTH = 1e-9
"""Relative residual that is small enough however small its standard error is."""
LONGEST = 0.3
"""Longest Newton step, in scales: beyond that the derivative means nothing."""


@dataclass(frozen=True)
class Guess:
    """A state near an orbit.

    Attributes:
        state: z, shape (2 n,).
        parameter: λ.
        scale: norm of the slow coordinates to which residuals and kicks are relative.
    """

    state: FloatArray
    parameter: float
    scale: float


@dataclass(frozen=True)
class Border:
    """The plane N2 in which a point of a branch is sought.

    Attributes:
        tangent: t, of length 1, shape (m + 1,).
        predicted: x_predicted, shape (m + 1,).
        span: unit of λ.
        by_parameter: derivative of the slow coordinates of F by λ, shape (m,).
    """

    tangent: FloatArray
    predicted: FloatArray
    span: float
    by_parameter: FloatArray


@dataclass(frozen=True)
class Solved:
    """A point at which the iteration ended.

    Attributes:
        state: z, shape (2 n,).
        parameter: λ.
        scale: as in the guess.
        residual: |y - slow F| / scale.
        residual_error: its standard error, relative to the scale too.
        uncertainty: standard error of x that follows from it, shape (m,), or (m + 1,) with λ.
        iterations: number of evaluations of F.
        away: distance of x from where it was predicted; 0 without a border.
    """

    state: FloatArray
    parameter: float
    scale: float
    residual: float
    residual_error: float
    uncertainty: FloatArray
    iterations: int
    away: float = 0.0

    def guess(self, scale: float) -> Guess:
        """Return the point as a guess, with a scale of its own."""
        return Guess(self.state, self.parameter, scale)

    @property
    def is_solved(self) -> bool:
        """Whether the residual is zero within its error."""
        return is_zero(self.residual, self.residual_error)


def is_zero(residual: float, error: float) -> bool:
    """Return whether a residual is zero within its standard error, or smooth."""
    return residual <= SMOOTH or residual <= WITHIN * error < np.inf


def solved(
    ensemble: Ensemble, guess: Guess, derivative: FloatArray, border: Border | None = None
) -> Solved:
    """Iterate N1 from a guess, and N2 if there is a border; return the best point.

    Args:
        ensemble: the mean map.
        guess: where to start.
        derivative: of the slow coordinates of F by those of z, near the guess, shape (m, m).
        border: None: λ stays.

    Raises:
        ArithmeticError: a motion diverges, or the equations are singular.
    """
    slow, scale = ensemble.map.slow, guess.scale
    matrix = _matrix(derivative, border, scale)
    best: Solved | None = None
    for number in range(1, MOST + 1):
        mean = ensemble.mean(guess.state, guess.parameter, scale)
        y = slow.of(guess.state)
        equations = _equations(guess, mean, y, border)
        found = _point(guess, mean, y, matrix, number)
        if border is not None:
            x = np.append(y / scale, guess.parameter / border.span)
            found = replace(found, away=float(np.linalg.norm(x - border.predicted)))
        if number >= FEWEST and (best is None or found.residual < best.residual):
            best = found
        if best is not None and best.is_solved:
            return best
        step = -np.linalg.solve(matrix, equations)
        step *= min(1.0, LONGEST / max(float(np.linalg.norm(step)), 1e-300))
        rest = mean.state - slow.lifted(mean.slow)
        guess = replace(
            guess,
            state=rest + slow.lifted(y + scale * step[: slow.size]),
            parameter=guess.parameter + (0.0 if border is None else border.span * float(step[-1])),
        )
    assert best is not None
    return best


def _matrix(derivative: FloatArray, border: Border | None, scale: float) -> FloatArray:
    """Return the derivative of the equations in units of the scale and the span."""
    matrix = derivative - np.eye(len(derivative))
    if border is None:
        return np.asarray(matrix)
    column = border.by_parameter * border.span / scale
    return np.vstack([np.c_[matrix, column], border.tangent])


def _equations(guess: Guess, mean: Mean, y: FloatArray, border: Border | None) -> FloatArray:
    """Return what N1 and N2 should make 0, in units of the scale and the span."""
    residual = (mean.slow - y) / guess.scale
    if border is None:
        return np.asarray(residual)
    x = np.r_[y / guess.scale, guess.parameter / border.span]
    return np.append(residual, border.tangent @ (x - border.predicted))


def _point(guess: Guess, mean: Mean, y: FloatArray, matrix: FloatArray, number: int) -> Solved:
    """Return the present point with its residual and the errors that follow from it."""
    m, scale = y.size, guess.scale
    inverse = np.linalg.inv(matrix)[:, :m] / scale
    return Solved(
        guess.state,
        guess.parameter,
        scale,
        float(np.linalg.norm(mean.slow - y)) / scale,
        float(np.sqrt(np.trace(mean.covariance))) / scale,
        np.sqrt(np.einsum("ij,jk,ik->i", inverse, mean.covariance, inverse)),
        number,
    )


def by_parameter(ensemble: Ensemble, guess: Guess, step: float) -> FloatArray:
    """Return the derivative of the slow coordinates of F by λ, from both sides, shape (m,)."""
    ends = [
        ensemble.mean(guess.state, guess.parameter + sign * step, guess.scale).slow
        for sign in (1.0, -1.0)
    ]
    return np.asarray((ends[0] - ends[1]) / (2.0 * step))

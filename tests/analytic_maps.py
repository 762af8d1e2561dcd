"""Maps in closed form whose orbits, folds, doublings and Neimark-Sacker points are exact."""

from __future__ import annotations

import numpy as np
from calibration.branches import Plane, jumps

from delam_fem.api import FloatArray


class Toy(Plane):
    """A map of the plane, rough at a small scale if asked for.

    Args:
        roughness: height of jumps that change from one state to the next.
    """

    def __init__(self, roughness: float = 0.0) -> None:
        super().__init__(lambda states, a: self.image(*states.T, a) + roughness * jumps(*states.T))

    def image(self, x: FloatArray, y: FloatArray, parameter: float) -> FloatArray:
        raise NotImplementedError

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        if not np.isfinite(states).all():
            return np.full_like(states, np.nan)
        return super().after(states, parameter)


class Henon(Toy):
    """x' = 1 - a x² + y, y' = b x with b = 0.3.

    Fold at a = -(1 - b)²/4, doubling at 3 (1 - b)²/4, the next one at (1 - b)² + (1 + b)²/4.
    """

    b = 0.3
    fold, doubling, second = -0.1225, 0.3675, 0.9125

    def image(self, x: FloatArray, y: FloatArray, parameter: float) -> FloatArray:
        return np.stack([1.0 - parameter * x**2 + y, self.b * x], axis=-1)

    def fixed(self, a: float) -> FloatArray:
        """Return the fixed point of the stable branch."""
        x = (self.b - 1.0 + np.sqrt((1.0 - self.b) ** 2 + 4.0 * a)) / (2.0 * a)
        return np.array([x, self.b * x])

    def derivative(self, x: float, a: float) -> FloatArray:
        return np.array([[-2.0 * a * x, 1.0], [self.b, 0.0]])


class DelayedLogistic(Toy):
    """x' = a x (1 - y), y' = x: the fixed point 1 - 1/a has a Neimark-Sacker point at a = 2."""

    torus = 2.0

    def image(self, x: FloatArray, y: FloatArray, parameter: float) -> FloatArray:
        return np.stack([parameter * x * (1.0 - y), x], axis=-1)

    def fixed(self, a: float) -> FloatArray:
        return np.full(2, 1.0 - 1.0 / a)


class Cubic(Toy):
    """x' = 1 - a (x - 1) + (x - 1)³, y' = y / 5: the fixed point (1, 0) doubles at a = 1.

    Its derivative by two-sided kicks h is h² too large, and so the doubling is found at 1 + h².
    """

    doubling = 1.0

    def image(self, x: FloatArray, y: FloatArray, parameter: float) -> FloatArray:
        return np.stack([1.0 - parameter * (x - 1.0) + (x - 1.0) ** 3, 0.2 * y], axis=-1)


class Steep(Toy):
    """x' = 1 - a t/6 + 0.6 t² with t = tanh 6(x - 1), y' = y / 5: (1, 0) has the multiplier -a.

    Beyond its doubling the motion is so large that its mean is no place for the derivative.
    """

    def image(self, x: FloatArray, y: FloatArray, parameter: float) -> FloatArray:
        t = np.tanh(6.0 * (x - 1.0))
        return np.stack([1.0 - parameter * t / 6.0 + 0.6 * t**2, 0.2 * y], axis=-1)

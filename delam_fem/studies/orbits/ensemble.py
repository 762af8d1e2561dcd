"""The mean of a map over fixed small perturbations of a state, and its derivative by finite kicks.

Where impacts are sharp, the map Φ of a period is rough below some scale: which pair is hit first,
and in which step, changes from one state to the next. Its mean over states that lie close together,

    F(z) = Σ Φ(z + ξ_i) / k,   ξ_i and -ξ_i in pairs, the same in each call,

is smoother, and the spread of the terms says how well it is known. The grid of time steps is
shifted by another share of a step for each term, because impacts are seen at steps only. A
derivative of F, for Newton's method, is a two-sided difference over kicks that are larger than the
rough scale. What becomes of kicks in many periods says whether an orbit is stable.

Source: Schilder, Bureau, Santos, Thomsen, Starke, J. Sound Vib. 358 (2015) 251-266.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.orbits.protocol import PeriodMap


@dataclass(frozen=True)
class Perturbations:
    """Fixed small perturbations in antithetic pairs, and the size of kicks.

    Attributes:
        copies: k, an even number of perturbed states.
        size: standard deviation of the perturbations, relative to the state [-].
        kick: size of the kicks, relative to the state [-].
        seed: of the random numbers.
    """

    copies: int = 48
    size: float = 0.01
    kick: float = 0.02
    seed: int = 0

    def offsets(self, m: int) -> FloatArray:
        """Return the perturbations of m coordinates, shape (k, m); row i + k/2 is minus row i."""
        half = np.random.default_rng(self.seed).standard_normal((self.copies // 2, m))
        return np.asarray(self.size / np.sqrt(m) * np.concatenate([half, -half]))

    def shifts(self) -> FloatArray:
        """Return the shift of each step grid, evenly within a step about 0, shape (k,)."""
        half = (np.arange(self.copies // 2) + 0.5) / self.copies
        order = np.random.default_rng(self.seed + 1).permutation(half.size)
        return np.concatenate([half[order], -half[order]])


USUAL = Perturbations()
PERIODS = 40
"""Periods of the orbit for which kicks are followed."""
LARGEST = 1.5
"""Size relative to the first at which a kick has left the neighbourhood of the orbit."""


@dataclass(frozen=True)
class Mean:
    """The mean of a map over the perturbations.

    Attributes:
        state: F(z), shape (2 n,).
        slow: its slow coordinates, shape (m,).
        covariance: of these as a mean, shape (m, m).
    """

    state: FloatArray
    slow: FloatArray
    covariance: FloatArray

    @property
    def error(self) -> FloatArray:
        """Standard errors of the slow coordinates, shape (m,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


@dataclass(frozen=True)
class Ensemble:
    """A map over some periods and the perturbations over which it is averaged.

    Attributes:
        map: map of one period.
        periods: P, number of periods of the drive in one of the orbit.
        perturbations: what the mean is taken over.
    """

    map: PeriodMap
    periods: int = 1
    perturbations: Perturbations = USUAL

    def mean(self, state: FloatArray, parameter: float, scale: float) -> Mean:
        """Return the mean of the map about a state.

        Args:
            state: z, shape (2 n,).
            parameter: λ.
            scale: norm of slow coordinates to which the size of perturbations is relative.

        Raises:
            ArithmeticError: a perturbed motion diverges.
        """
        copies, shifts = self._copies(state, scale)
        ends = self._ends(copies, parameter, shifts)
        pairs = 0.5 * np.add(*np.split(self.map.slow.of(ends), 2))
        covariance = np.atleast_2d(np.cov(pairs.T)) / len(pairs)
        return Mean(ends.mean(axis=0), pairs.mean(axis=0), covariance)

    def derivatives(self, state: FloatArray, parameter: float, scale: float) -> FloatArray:
        """Return the derivative of the slow coordinates for each pair, shape (k/2, m, m).

        Their mean is that of F; column j is the response to kicks of coordinate j, to both sides.

        Args:
            state: z, shape (2 n,).
            parameter: λ.
            scale: norm of slow coordinates to which sizes are relative.
        """
        copies, shifts = self._copies(state, scale)
        slow, kick = self.map.slow, scale * self.perturbations.kick
        columns = []
        for direction in slow.basis.T:
            kicked = np.concatenate([copies + kick * direction, copies - kick * direction])
            ends = slow.of(self._ends(kicked, parameter, np.tile(shifts, 2)))
            columns.append(np.subtract(*np.split(ends, 2)) / (2.0 * kick))
        each = np.stack(columns, axis=-1)
        return np.asarray(0.5 * np.add(*np.split(each, 2)))

    def decays(self, state: FloatArray, parameter: float, scale: float) -> FloatArray:
        """Return kicks before and after each of some periods, relative to their first size.

        A kick is half the difference of two motions that are kicked to both sides of the orbit in
        a random direction; each is on another grid. One that has grown to `LARGEST` is replaced by
        a new one.

        Args:
            state: z, shape (2 n,).
            parameter: λ.
            scale: norm of slow coordinates to which sizes are relative.

        Returns:
            Shape (`PERIODS`, 2, k, m); NaN before the first period of a kick, in which the
            other coordinates do not follow the slow ones yet.

        Raises:
            ArithmeticError: a kicked motion diverges.
        """
        slow, given = self.map.slow, self.perturbations
        rng, size = np.random.default_rng(given.seed + 2), given.kick * scale
        kicks = np.full((max(given.copies // 2, slow.size), slow.size), np.nan)
        shifts = (np.arange(len(kicks)) + 0.5) / len(kicks) - 0.5
        states, found = np.tile(state, (2, len(kicks), 1)), []
        for _ in range(PERIODS):
            is_new = ~(np.linalg.norm(kicks, axis=1) <= LARGEST)
            new = rng.standard_normal((int(is_new.sum()), slow.size))
            aside = slow.lifted(size / np.linalg.norm(new, axis=1, keepdims=True) * new)
            states[:, is_new] = state + np.array([aside, -aside])
            states = self._ends(np.concatenate(states), parameter, np.tile(shifts, 2))
            states = states.reshape(2, len(kicks), -1)
            before = np.where(is_new[:, None], np.nan, kicks)
            kicks = slow.of(states[0] - states[1]) / (2.0 * size)
            found.append([before, kicks])
        return np.array(found)

    def _copies(self, state: FloatArray, scale: float) -> tuple[FloatArray, FloatArray]:
        """Return the perturbed states and the shifts of their grids."""
        slow = self.map.slow
        offsets = scale * self.perturbations.offsets(slow.size)
        return state + slow.lifted(offsets), self.perturbations.shifts()

    def _ends(self, states: FloatArray, parameter: float, shifts: FloatArray) -> FloatArray:
        for _ in range(self.periods):
            states = self.map.after(states, parameter, shifts)
        if not np.isfinite(states).all():
            raise ArithmeticError("a perturbed motion diverges")
        return states

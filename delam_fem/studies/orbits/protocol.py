"""What a map of one period must offer, so that orbits of it can be found and followed.

A state z at the beginning of a period of the drive is (u, v), shape (2 n,), or what else a map says
of its `Nature`. The map Φ(z, λ) leads to the state one period later; λ is any number that the map
depends on, such as a frequency.
Nothing here knows what computes the map: an engine, a reduced model or a formula.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from delam_fem.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Nature:
    """What a map is of, for files, pictures and words.

    Attributes:
        name: of the model.
        parts: name and number of the coordinates of a state, in order; those of a part have one
            unit.
        is_stepped: whether contact is seen at time steps only, so that an orbit depends on where
            their grid lies.
    """

    name: str
    parts: Mapping[str, int]
    is_stepped: bool = False

    def split(self, state: FloatArray) -> dict[str, FloatArray]:
        """Return the coordinates of a state by part."""
        ends = np.cumsum(list(self.parts.values()))[:-1]
        return dict(zip(self.parts, np.split(state, ends), strict=True))

    def scales(self, state: FloatArray) -> FloatArray:
        """Return the largest size in the part of each coordinate, 1 in a part that is 0."""
        largest = [float(np.abs(part).max(initial=0.0)) for part in self.split(state).values()]
        return np.repeat([size or 1.0 for size in largest], list(self.parts.values()))


@dataclass(frozen=True)
class Slow:
    """The few coordinates in which an orbit is solved by Newton's method, and the scale of kicks.

        y = dual z,   z = basis y + rest,   dual basis = 1

    Attributes:
        basis: directions of the coordinates, shape (2 n, m).
        dual: rows that read the coordinates of a state, shape (m, 2 n).
    """

    basis: FloatArray
    dual: FloatArray

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return int(self.basis.shape[1])

    def of(self, states: FloatArray) -> FloatArray:
        """Return the coordinates of states, shape (…, m)."""
        return np.asarray(states @ self.dual.T)

    def lifted(self, coordinates: FloatArray) -> FloatArray:
        """Return the states with given coordinates and no rest, shape (…, 2 n)."""
        return np.asarray(coordinates @ self.basis.T)


@dataclass(frozen=True)
class Passage:
    """What is seen on the way through some periods.

    Attributes:
        states: state at the end of each period, shape (k, 2 n).
        strobes: displacement of the observed points once in each period, where the drive begins
            anew, shape (k, n_seen).
        low, high: smallest and largest displacement of these points, shape (n_seen,) [m].
        smallest_gap: smallest gap between the tips [m]; it reaches 0 where they touch.
        gaps: the same in each period, shape (k,) [m]; empty: not known.
        openings: gap between the tips at the end of each period, shape (k,) [m]; empty: not known.
            Kicks are the less harmful the larger it is.
        history: displacement of the observed points at each step, shape (n_steps, n_seen) [m];
            empty: not kept.
    """

    states: FloatArray
    strobes: FloatArray
    low: FloatArray
    high: FloatArray
    smallest_gap: float
    gaps: FloatArray = field(default_factory=lambda: np.zeros(0))
    openings: FloatArray = field(default_factory=lambda: np.zeros(0))
    history: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))


class PeriodMap(Protocol):
    """A map from one period to the next.

    Attributes:
        slow: coordinates for Newton's method. They are fixed: they do not depend on the parameter.
        nature: what the map is of.
    """

    slow: Slow
    nature: Nature

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        """Return the states one period later.

        Args:
            states: shape (k, 2 n).
            parameter: λ.
            shifts: by which share of a time step the grid of each state is shifted, for maps that
                are stepped in time and see contact only at steps, shape (k,); others ignore it.

        Returns:
            Shape (k, 2 n); NaN in the rows of motions that diverge.
        """

    def watched(self, state: FloatArray, parameter: float, periods: int) -> Passage:
        """Return what is seen in some periods from a state."""


class CaseMap(PeriodMap, Protocol):
    """The map of a case, whose periods may begin elsewhere in those of the drive."""

    def opened(self, state: FloatArray, parameter: float) -> tuple[PeriodMap, FloatArray]:
        """Return the map whose periods begin where the tips are farthest apart, and the state.

        A kick there violates no gap. A map without tips is returned as it is.

        Args:
            state: at the beginning of a period.
            parameter: λ.
        """

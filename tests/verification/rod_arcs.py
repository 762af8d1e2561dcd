"""Periodic motions of a driven rod on one elastic stop, exactly, by joining linear motions.

While it is free and while it touches, the rod is linear: each arc is a sum of exponentials and of
the driven motion. A period is shot with the exact derivative, a product of exponentials, because
forces are continuous where arcs meet. The frequency is followed by its arc length, so that stable
and unstable motions, and folds, are all the same to it. Lengths are in gaps, times in 1/`UNIT`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from delam_fem.api import Case, FloatArray, assemble

UNIT = 62711.98
"""The first angular frequency of the rod of Vadcard, Batailly and Thouverez [rad/s]."""
SAMPLES, HALVINGS, NUDGE = 2000, 60, 1e-7


@dataclass(frozen=True)
class Orbit:
    """A periodic motion at an angular frequency ω: its state, derivatives and largest |u|."""

    state: FloatArray
    omega: float
    by_state: FloatArray
    by_omega: FloatArray
    largest: float

    @property
    def growth(self) -> float:
        """Size of the largest multiplier."""
        return float(np.abs(np.linalg.eigvals(self.by_state + np.eye(self.state.size))).max())


class Rod:
    """The rod of a case, free and on its stop."""

    def __init__(self, case: Case) -> None:
        """Take the matrices of the case."""
        o, (stop,) = assemble(case, needs_dolfinx=False).operators, case.stop
        M, C, K = (A.toarray() for A in (o.mass, o.damping, o.stiffness))
        self.row, self.n = np.append(o.gap_matrix.toarray()[0], np.zeros(len(M))), len(M)
        H, inverse = self.row[: self.n], np.linalg.inv(M)
        self.force = np.zeros(2 * self.n)
        load = -o.base.stiffness * case.excitation.amplitude
        self.force[self.n :] = inverse @ load / UNIT**2 / stop.gap
        self.arcs = []
        for k in (0.0, stop.stiffness):
            A, constant = np.zeros((2 * self.n, 2 * self.n)), np.zeros(2 * self.n)
            A[: self.n, self.n :] = np.eye(self.n)
            A[self.n :, : self.n] = -inverse @ (K + k * np.outer(H, H)) / UNIT**2
            A[self.n :, self.n :] = -inverse @ C / UNIT
            constant[self.n :] = -k * inverse @ H / UNIT**2
            rates, V = np.linalg.eig(A)
            self.arcs.append((A, -np.linalg.solve(A, constant), rates, V, np.linalg.inv(V)))

    def period(self, x: FloatArray, w: float) -> tuple[FloatArray, FloatArray, float]:
        """Return the state after a period of the drive, its derivative and the largest |u|."""
        t, end, P, largest = 0.0, 2.0 * np.pi / w, np.eye(2 * self.n), 0.0
        touches = bool(1.0 + self.row @ x < 0.0)
        driven = [np.linalg.solve(1j * w * np.eye(2 * self.n) - arc[0], self.force)
                  for arc in self.arcs]  # fmt: skip
        while t < end - 1e-13:
            (_, equilibrium, rates, V, inverse), z = self.arcs[touches], driven[touches]
            c = inverse @ (x - equilibrium - (z * np.exp(1j * w * t)).imag)
            size, level, swing = (self.row @ V) * c, 1.0 + self.row @ equilibrium, self.row @ z

            def gap(after, t=t, rates=rates, size=size, level=level, swing=swing):  # type: ignore[no-untyped-def]
                free = np.exp(np.multiply.outer(after, rates)) @ size
                return level + free.real + (swing * np.exp(1j * w * (t + after))).imag

            after = np.linspace(0.0, end - t, max(int(SAMPLES * (end - t) / end), 8) + 1)
            gaps = gap(after)
            crossed = np.flatnonzero((gaps[1:] < 0.0) != touches)
            k = int(crossed[0]) + 1 if crossed.size else after.size - 1
            low, high = after[k - 1], after[k]
            for _ in range(HALVINGS if crossed.size else 0):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if (gap(middle) < 0.0) == touches else (low, middle)
            largest = max(largest, float(np.abs(1.0 - gaps[: k + 1]).max()))
            x = equilibrium + (V @ (np.exp(rates * high) * c)).real
            x = x + (z * np.exp(1j * w * (t + high))).imag
            P, t, touches = ((V * np.exp(rates * high)) @ inverse).real @ P, t + high, not touches
        return x, P, largest

    def orbit(
        self, x: FloatArray, w: float, along: FloatArray | None = None, reach: float = 0.0
    ) -> Orbit | None:
        """Return the orbit near a state: at ω, or where a plane across a direction is met."""
        first, size = np.append(x, w), np.append(np.zeros(2 * self.n), 1.0)
        along = size if along is None else along
        for _ in range(12):
            after, P, largest = self.period(x, w)
            by_state = P - np.eye(2 * self.n)
            by_omega = (self.period(x, w + NUDGE)[0] - after) / NUDGE
            if np.abs(after - x).max() < 1e-9:
                return Orbit(x, w, by_state, by_omega, largest)
            B = np.vstack([np.column_stack([by_state, by_omega]), along])
            off = along @ (np.append(x, w) - first) - reach
            step = np.linalg.solve(B, -np.append(after - x, off))
            x, w = x + step[:-1], w + step[-1]
        return None

    def branch(self, orbit: Orbit, last: float, step: float = 0.06) -> list[Orbit]:
        """Follow an orbit to higher ω, round the folds, until ω is above `last`."""
        orbits, t = [orbit], np.append(np.zeros(2 * self.n), 1.0)
        while orbits[-1].omega < last and len(orbits) < 600:
            here = orbits[-1]
            B = np.vstack([np.column_stack([here.by_state, here.by_omega]), t])
            t = np.linalg.solve(B, np.append(np.zeros(2 * self.n), 1.0))
            t, reach, next_ = t / np.linalg.norm(t), step, None
            while next_ is None and reach > 1e-5:
                x, w = here.state + reach * t[:-1], here.omega + reach * t[-1]
                next_, reach = self.orbit(x, w, t, 0.0), 0.5 * reach
            assert next_ is not None, here.omega * UNIT
            orbits.append(next_)
        return orbits


def folds(branch: list[Orbit]) -> list[float]:
    """Return ω where a branch turns, by parabolas through three points [rad/s]."""
    w, frequencies = np.array([orbit.omega for orbit in branch]), []
    s = np.cumsum([0.0, *(np.linalg.norm(np.append(b.state - a.state, b.omega - a.omega))
                          for a, b in pairwise(branch))])  # fmt: skip
    for k in np.flatnonzero(np.diff(np.sign(np.diff(w)))) + 1:
        a, b, c = np.polyfit(s[k - 1 : k + 2] - s[k], w[k - 1 : k + 2], 2)
        frequencies.append(float(UNIT * (c - b**2 / (4.0 * a))))
    return frequencies

"""The map of a reduced case from one period to the next, for studies of orbits.

A state is (q, q', s of each part), see `model.reduced`. The same fine steps resolve contact in
every call, so the map is one fixed function; it needs no shifted step grids.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.engines.modal.periods import Period
from delam_fem.model.reduced import Reduced
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.setup import BaseStates
from delam_fem.studies.orbits.family import FREQUENCY, CaseFamily, tip_of
from delam_fem.studies.orbits.protocol import Nature, Passage, Slow
from delam_fem.studies.reduced.motion import MODES, REFINE, ReducedMotion, reduced

SLOW_MODES = 4
"""Lowest modes whose displacements and velocities are the slow coordinates: two of each lamina."""
KEPT = 4
"""Problems that are kept: continuation returns to neighbouring parameters."""


class ReducedMap:
    """The map of a family of reduced cases; see `studies.orbits.protocol.PeriodMap`.

    Attributes:
        slow: coordinates for Newton's method: ω q and q' of the lowest modes [J^½].
        nature: what the map is of.
        evaluations: periods computed so far.
    """

    def __init__(
        self,
        case: Case,
        key: str = FREQUENCY,
        *,
        modes: int = MODES,
        refine: int = REFINE,
        phase: float = 0.0,
    ) -> None:
        """Check the key and reduce the case.

        Args:
            case: the case.
            key: the parameter.
            modes: number of modes of each part.
            refine: number of fine steps in a coarse one near contact.
            phase: where in a period of the drive a period of the map begins, 0 to 1.

        Raises:
            CaseError: the drive does not repeat, or the case cannot be reduced.
        """
        self._family, self._modes, self._refine = CaseFamily(case, key), modes, refine
        self._phase = phase
        self._ready: dict[float, ReducedMotion] = {}
        self.evaluations = 0
        first = reduced(case, modes, refine=refine)
        self.slow = slow_of(first.reduced)
        self.n_state, m = first.reduced.n_state, first.reduced.n_modes
        self.nature = Nature(
            f"{modes} modes of each part, r = {refine}",
            {
                "modal_displacement": m,
                "modal_velocity": m,
                "late_force": self.n_state - 2 * m,
            },
        )

    def at(self, parameter: float) -> ReducedMotion:
        """Return the reduced case for a value of the parameter."""
        if parameter not in self._ready:
            case = self._family.at(parameter)
            structure = self._family.structure(case)
            own = reduced(case, self._modes, refine=self._refine, structure=structure)
            if own.case.contact.law == "none":
                raise CaseError("contact.law: expected a law with contact, given 'none'")
            while len(self._ready) >= KEPT:
                del self._ready[next(iter(self._ready))]
            self._ready[parameter] = replace(own, motion=_later(own.motion, self._first(own)))
        return self._ready[parameter]

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        """Return the states one period later; see `PeriodMap.after`. Shifts have no effect."""
        motion = self.at(parameter)
        self.evaluations += len(states)
        return np.array([motion.advance(state) for state in states])

    def watched(self, state: FloatArray, parameter: float, periods: int) -> Passage:
        """Return what is seen in some periods from a state; see `PeriodMap.watched`."""
        motion = self.at(parameter)
        computed: list[Period] = []
        for _ in range(periods):
            computed.append(motion.period(state))
            state = computed[-1].end
        self.evaluations += periods
        u = np.concatenate([_seen(motion, period) for period in computed])
        tip, n = tip_of(motion.structure), len(u) // periods
        gap = np.full(len(u), np.inf) if tip is None else tip[2] + u[:, tip[1]] - u[:, tip[0]]
        lowest = [np.inf if tip is None else float(period.lowest[-1]) for period in computed]
        return Passage(
            np.array([period.end for period in computed]),
            u[n - 1 - self._first(motion) :: n],
            u.min(axis=0),
            u.max(axis=0),
            min(lowest),
            np.array(lowest),
            gap[n - 1 :: n],
            u,
        )

    def opened(self, state: FloatArray, parameter: float) -> tuple[ReducedMap, FloatArray]:
        """Return the map that begins with the tips apart; see `CaseMap.opened`."""
        motion = self.at(parameter)
        tip = tip_of(motion.structure)
        if tip is None:
            return self, state
        period = motion.period(state)
        u = _seen(motion, period)
        step = int(np.argmax(u[:, tip[1]] - u[:, tip[0]])) + 1
        trace, phase = period.trace, (step / len(u) + self._phase) % 1.0
        found = np.concatenate([trace.q[step], trace.v[step], trace.s[step].ravel()])
        family, sizes = self._family, {"modes": self._modes, "refine": self._refine}
        return ReducedMap(family.case, family.key, **sizes, phase=phase), found

    def _first(self, motion: ReducedMotion) -> int:
        """Return the number of the step of the drive at which a period of the map begins."""
        return round(self._phase * motion.case.steps_per_period)


def _seen(motion: ReducedMotion, period: Period) -> FloatArray:
    """Return the displacements of the probes at each step of a period, shape (N, n_seen) [m]."""
    q, s, drive = period.trace.q[1:], period.trace.s[1:], motion.motion(0)[1:, 0]
    return np.asarray(motion.reduced.displacement(q, s, drive) @ motion.reduced.probes.T)


def _later(motion: BaseStates, first: int) -> BaseStates:
    """Return a periodic drive whose periods begin some steps later."""

    def rolled(number: int) -> FloatArray:
        table = motion(number)
        return np.concatenate([table[first:-1], table[: first + 1]])

    return rolled


def slow_of(model: Reduced, n_modes: int = SLOW_MODES) -> Slow:
    """Return ω q and q' of the lowest modes as slow coordinates."""
    chosen = np.sort(np.argsort(model.squares, kind="stable")[:n_modes])
    omega, count, m = np.sqrt(model.squares[chosen]), chosen.size, model.n_modes
    basis, dual = np.zeros((model.n_state, 2 * count)), np.zeros((2 * count, model.n_state))
    own = np.arange(count)
    basis[chosen, own], dual[own, chosen] = 1.0 / omega, omega
    basis[m + chosen, count + own] = dual[count + own, m + chosen] = 1.0
    return Slow(basis, dual)

"""Map modes with massless contact points from one period to the next, for studies of orbits.

A state is (q, q', s of each part), see `model.reduced`. The same fine steps resolve contact in
every call, so the map is one fixed function; it needs no shifted step grids.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.engines.modal import Drive, Period, Periods
from delam_fem.engines.session import motion_of
from delam_fem.model.layout import Structure
from delam_fem.model.reduced import Reduced, reduce
from delam_fem.numerics.types import FloatArray
from delam_fem.studies.orbits.maps import FREQUENCY, CaseFamily, Nature, Passage, Slow, tip_of
from delam_fem.system.errors import CaseError

SLOW_MODES = 4
"""Lowest modes whose displacements and velocities are the slow coordinates: two of each lamina."""
KEPT = 4
"""Problems that are kept: continuation returns to neighbouring parameters."""


@dataclass(frozen=True)
class ModalProblem:
    """A case whose periods are computed in modes.

    Attributes:
        structure: its discretisation, which the modes are those of.
        periods: computes periods.
        drive: in a period of the map.
        first: number of the step of the drive at which a period of the map begins.
    """

    structure: Structure
    periods: Periods
    drive: Drive
    first: int

    def period(self, state: FloatArray) -> Period:
        """Compute a period and keep every step of it."""
        return self.periods.record(state, self.drive)

    def seen(self, period: Period) -> FloatArray:
        """Return the displacements of the probes at each step of a period, (N, n_seen) [m]."""
        q, s, reduced = period.trace.q[1:], period.trace.s[1:], self.periods.reduced
        return np.asarray(reduced.displacement(q, s, self.drive.motion[1:]) @ reduced.probes.T)


class ModalMap:
    """The map of a family of cases with massless contact points; see `maps.PeriodMap`.

    Attributes:
        slow: coordinates for Newton's method: ω q and q' of the lowest modes [J^½].
        nature: what the map is of.
        evaluations: periods computed so far.
    """

    def __init__(self, case: Case, key: str = FREQUENCY, *, phase: float = 0.0) -> None:
        """Check the key and compute the modes of the case.

        Args:
            case: the case; its contact points have no mass.
            key: the parameter.
            phase: where in a period of the drive a period of the map begins, 0 to 1.

        Raises:
            CaseError: the drive does not repeat, there is no contact, or the case has no such
                modes.
        """
        self._family, self._phase = CaseFamily(case, key), phase
        self._ready: dict[float, ModalProblem] = {}
        self.evaluations = 0
        if case.contact.law == "none":
            raise CaseError("contact.law: expected a law with contact, given 'none'")
        first = self._problem(case).periods.reduced
        self.slow = slow_of(first)
        self.n_state, m = first.n_state, first.n_modes
        self.nature = Nature(
            f"{m // first.n_parts} modes of each part, r = {case.time.refine}",
            {
                "modal_displacement": m,
                "modal_velocity": m,
                "late_force": self.n_state - 2 * m,
            },
        )

    def at(self, parameter: float) -> ModalProblem:
        """Return the problem for a value of the parameter."""
        if parameter not in self._ready:
            found = self._problem(self._family.at(parameter))
            while len(self._ready) >= KEPT:
                del self._ready[next(iter(self._ready))]
            self._ready[parameter] = found
        return self._ready[parameter]

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        """Return the states one period later; see `PeriodMap.after`. Shifts have no effect."""
        problem = self.at(parameter)
        self.evaluations += len(states)
        return np.array([problem.periods.advance(state, problem.drive) for state in states])

    def watched(self, state: FloatArray, parameter: float, periods: int) -> Passage:
        """Return what is seen in some periods from a state; see `PeriodMap.watched`."""
        problem = self.at(parameter)
        computed: list[Period] = []
        for _ in range(periods):
            computed.append(problem.period(state))
            state = computed[-1].end
        self.evaluations += periods
        u = np.concatenate([problem.seen(period) for period in computed])
        tip, n = tip_of(problem.structure), len(u) // periods
        gap = np.full(len(u), np.inf) if tip is None else tip[2] + u[:, tip[1]] - u[:, tip[0]]
        lowest = [np.inf if tip is None else float(period.lowest[-1]) for period in computed]
        return Passage(
            np.array([period.end for period in computed]),
            u[n - 1 - problem.first :: n],
            u.min(axis=0),
            u.max(axis=0),
            min(lowest),
            np.array(lowest),
            gap[n - 1 :: n],
            u,
        )

    def opened(self, state: FloatArray, parameter: float) -> tuple[ModalMap, FloatArray]:
        """Return the map that begins with the tips apart; see `CaseMap.opened`."""
        problem = self.at(parameter)
        tip = tip_of(problem.structure)
        if tip is None:
            return self, state
        period = problem.period(state)
        u = problem.seen(period)
        step = int(np.argmax(u[:, tip[1]] - u[:, tip[0]])) + 1
        trace, phase = period.trace, (step / len(u) + self._phase) % 1.0
        found = np.concatenate([trace.q[step], trace.v[step], trace.s[step].ravel()])
        return ModalMap(self._family.case, self._family.key, phase=phase), found

    def _problem(self, case: Case) -> ModalProblem:
        """Return the problem of a case; the table of its drive begins at the phase."""
        structure = self._family.structure(case)
        reduced = reduce(structure.operators, case.n_modes)
        periods = Periods(reduced, case.time_step, case.time.refine)
        table, first = motion_of(case)(0), round(self._phase * case.steps_per_period)
        drive = periods.drive(np.concatenate([table[first:-1], table[: first + 1]]))
        return ModalProblem(structure, periods, drive, first)


def slow_of(model: Reduced, n_modes: int = SLOW_MODES) -> Slow:
    """Return ω q and q' of the lowest modes as slow coordinates."""
    chosen = np.sort(np.argsort(model.squares, kind="stable")[:n_modes])
    omega, count, m = np.sqrt(model.squares[chosen]), chosen.size, model.n_modes
    basis, dual = np.zeros((model.n_state, 2 * count)), np.zeros((2 * count, model.n_state))
    own = np.arange(count)
    basis[chosen, own], dual[own, chosen] = 1.0 / omega, omega
    basis[m + chosen, count + own] = dual[count + own, m + chosen] = 1.0
    return Slow(basis, dual)

"""The map of a reduced case from one period to the next, for studies of orbits.

A state is (q, q', s of each part), see `model.reduced`. The same fine steps resolve contact in
every call, so the map is one fixed function; it needs no shifted step grids.
"""

from __future__ import annotations

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.engines.modal.periods import Period
from delam_fem.model.reduced import Reduced
from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.orbits.family import FREQUENCY, CaseFamily, tip_of
from delam_fem.studies.orbits.protocol import Passage, Slow
from delam_fem.studies.reduced.motion import MODES, REFINE, ReducedMotion, reduced

SLOW_MODES = 4
"""Lowest modes whose displacements and velocities are the slow coordinates: two of each lamina."""
KEPT = 4
"""Problems that are kept: continuation returns to neighbouring parameters."""


class ReducedMap:
    """The map of a family of reduced cases; see `studies.orbits.protocol.PeriodMap`.

    Attributes:
        slow: coordinates for Newton's method: ω q and q' of the lowest modes [J^½].
        evaluations: periods computed so far.
    """

    def __init__(
        self, case: Case, key: str = FREQUENCY, *, modes: int = MODES, refine: int = REFINE
    ) -> None:
        """Check the key and reduce the case.

        Args:
            case: the case.
            key: the parameter.
            modes: number of modes of each part.
            refine: number of fine steps in a coarse one near contact.

        Raises:
            CaseError: the drive does not repeat, or the case cannot be reduced.
        """
        self._family, self._modes, self._refine = CaseFamily(case, key), modes, refine
        self._ready: dict[float, ReducedMotion] = {}
        self.evaluations = 0
        first = reduced(case, modes, refine=refine)
        self.slow = slow_of(first.reduced)
        self.n_state = first.reduced.n_state

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
            self._ready[parameter] = own
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
        q, s = (
            np.concatenate([getattr(period.trace, name)[1:] for period in computed])
            for name in ("q", "s")
        )
        drive = np.tile(motion.motion(0)[1:, 0], periods)
        u = motion.reduced.displacement(q, s, drive) @ motion.reduced.probes.T
        n = len(u) // periods
        lowest = np.min([period.lowest for period in computed], axis=0)
        has_tip = tip_of(motion.structure) is not None
        return Passage(
            np.array([period.end for period in computed]),
            u[n - 1 :: n],
            u.min(axis=0),
            u.max(axis=0),
            float(lowest[-1]) if has_tip else np.inf,
        )


def slow_of(model: Reduced, n_modes: int = SLOW_MODES) -> Slow:
    """Return ω q and q' of the lowest modes as slow coordinates."""
    chosen = np.sort(np.argsort(model.squares, kind="stable")[:n_modes])
    omega, count, m = np.sqrt(model.squares[chosen]), chosen.size, model.n_modes
    basis, dual = np.zeros((model.n_state, 2 * count)), np.zeros((2 * count, model.n_state))
    own = np.arange(count)
    basis[chosen, own], dual[own, chosen] = 1.0 / omega, omega
    basis[m + chosen, count + own] = dual[count + own, m + chosen] = 1.0
    return Slow(basis, dual)

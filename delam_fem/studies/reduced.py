"""Run a case with a few modes of each part, and map it from period to period.

Record the periods of a reduced case as a run of the whole structure is recorded. Energies are those
of the energy ledger, with two differences. The damping loss includes the creep of the omitted
modes, and the impact loss is the loss at instants of closing, which tends to 0 with the fine steps.
The base work leaves out what mass-proportional damping takes from the motion of the base itself.

The contact is rigid and takes no energy. A case's law, restitution and scheme have no effect, but
for the law "none", which lets the laminae pass through one another.

The map of a reduced case from one period to the next, for studies of orbits. A state is (q, q', s
of each part), see `model.reduced`. The same fine steps resolve contact in every call, so the map is
one fixed function; it needs no shifted step grids.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.files import CaseSource, find_case
from delam_fem.engines.modal import Drive, Period, Periods
from delam_fem.engines.session import BaseStates, motion_of, span_of
from delam_fem.model import discretise
from delam_fem.model.layout import Structure
from delam_fem.model.operators import Operators
from delam_fem.model.reduced import Reduced, reduce
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.results import dataset, diagnostics
from delam_fem.results.folder import Result, json_ready
from delam_fem.simulation.recorder import N_BASE, N_SIZES, Columns, Energies, PeriodRecord, Recorder
from delam_fem.simulation.refinement import NOT_REFINED, Span
from delam_fem.studies.orbits.maps import FREQUENCY, CaseFamily, Nature, Passage, Slow, tip_of
from delam_fem.system.errors import CaseError

ENGINE = "modal"
"""Name of the engine in results."""


class _Start:
    """The start of the first period, as a recorder reads it; what it computes is replaced."""

    dissipated = contact_damped = 0.0

    def __init__(self, n_dofs: int, n_probes: int, n_pairs: int) -> None:
        self.seen_u, self.seen_v = np.zeros(N_BASE + n_probes), np.zeros(n_probes)
        self._n_dofs, self._n_pairs = n_dofs, n_pairs

    @property
    def resting(self) -> BoolArray:
        return np.zeros(self._n_pairs, dtype=np.bool_)

    def energies(self) -> Energies:
        return Energies(0.0, 0.0, 0.0)

    def state(self) -> FloatArray:
        return np.zeros((3, self._n_dofs))

    def observe(self) -> None:
        return None


class Recording:
    """A recorder of periods of a reduced case."""

    def __init__(self, structure: Structure, periods: Periods, span: Span) -> None:
        """Allocate the rows of all periods."""
        self._structure, self._periods = structure, periods
        o, reduced = structure.operators, periods.reduced
        span = Span(
            span.time_step, span.steps_per_period, span.periods, span.window_periods,
            span.frames_per_period, span.limit, NOT_REFINED,
        )  # fmt: skip
        self._recorder = Recorder(o.base, span, o.n_probes)
        self._start = _Start(o.n_dofs, o.n_probes, o.n_pairs)
        self._of_modes = reduced.probes @ reduced.shapes
        self._of_forces = np.stack([reduced.probes @ X for X in reduced.residual])
        self._of_drive = reduced.probes @ reduced.drive
        self._lowest = np.inf

    def add(self, period: Period, start: FloatArray, base_states: FloatArray) -> bool:
        """Add a period; return whether the motion stayed within bounds.

        Args:
            period: the computed period.
            start: state at its start.
            base_states: (q, q', q'') of the drive at its steps, shape (N + 1, 3).
        """
        recorder, trace, k = self._recorder, period.trace, self._recorder.n_closed
        record = recorder.open(self._start, base_states)
        late = np.einsum("scn,cpn->sp", trace.s, self._of_forces, optimize=True)
        moved = np.outer(base_states[:, 0], self._of_drive)
        record.u[:, :N_BASE] = 0.0
        record.u[:, N_BASE:] = trace.q @ self._of_modes.T + late + moved
        record.v[:] = trace.v @ self._of_modes.T + np.outer(base_states[:, 1], self._of_drive)
        self._add_frames(record, period, base_states)
        self._add_contacts(record, period)
        is_bounded = recorder.close(record, self._start, len(base_states) - 1)
        recorder.ledger[k] = self._ledger_row(period, start, base_states)
        recorder.effort[k, [0, N_SIZES - 1]] = period.effort
        return is_bounded and bool(np.isfinite(period.end).all())

    def result(self, case: Case, outcome: str, modes: int, seconds: float) -> Result:
        """Return the result of the run."""
        recorder, structure = self._recorder, self._structure
        attributes = {"outcome": outcome, "engine": ENGINE, "modes": str(modes)}
        history = dataset.history(recorder, structure, case, attributes)
        steps = int(recorder.effort[: recorder.n_closed, :N_SIZES].sum())
        summary: dict[str, Any] = {
            "outcome": outcome,
            "engine": ENGINE,
            "model": {"kind": "reduced", "modes": modes, "refine": self._periods.refine},
            "steps": steps,
            "wall_seconds": seconds,
            "microseconds_per_step": 1e6 * seconds / max(steps, 1),
            "warnings": [],
            **diagnostics.summary(history, case),
            "energy_residual": recorder.energy_residual(),
        }
        return Result(case, history, json_ready(summary), None)

    def _add_frames(self, record: PeriodRecord, period: Period, base_states: FloatArray) -> None:
        """Add displacements and velocities of all dofs at the frames."""
        reduced, own, trace = self._periods.reduced, record.frame_steps, period.trace
        if not own.size:
            return
        u = reduced.displacement(trace.q[own], trace.s[own], base_states[own, 0])
        v = reduced.velocity(trace.v[own], base_states[own, 1])
        record.frames.extend(np.stack([u, v], axis=1))
        is_closed = np.zeros((own.size, self._structure.operators.n_pairs), np.int8)
        if reduced.n_pairs:
            is_closed[:] = trace.impulse[own] > 0.0
        record.contact.extend(is_closed)

    def _add_contacts(self, record: PeriodRecord, period: Period) -> None:
        """Add the impulses of the contact forces over each coarse step, as impacts at its end."""
        trace = period.trace
        step, pair = np.nonzero(trace.impulse > 0.0)
        if not step.size:
            return
        ticks, first, sizes = np.unique(step, return_index=True, return_counts=True)
        rates = trace.v @ self._periods.reduced.gap_modes.T
        hits: tuple[IntArray, FloatArray, FloatArray, FloatArray] = (
            pair, trace.impulse[step, pair], rates[step - 1, pair], rates[step, pair]
        )  # fmt: skip
        record.jumps.extend(Columns(ticks, sizes, np.zeros(first.size), *hits))

    def _ledger_row(
        self, period: Period, start: FloatArray, base_states: FloatArray
    ) -> tuple[float, ...]:
        """Return the energies of a period in the order of `recorder.LEDGER`."""
        periods, reduced = self._periods, self._periods.reduced
        work, modal, creep, closing = period.exchanged.tolist()
        (T0, V0), (T1, V1) = periods.energies(start), periods.energies(period.end)
        residual = T1 + V1 - T0 - V0 - (work - modal - creep - closing)
        if self._structure.operators.base.is_force:
            return T1, V1, 0.0, 0.0, work, modal + creep, 0.0, closing, 0.0, residual
        carried = [
            float(reduced.loads[0] @ periods.split(at)[1]) * dq + 0.5 * reduced.base_mass * dq**2
            for at, dq in ((start, base_states[0, 1]), (period.end, base_states[-1, 1]))
        ]
        base_work = work + carried[1] - carried[0]
        return T1 + carried[1], V1, 0.0, base_work, 0.0, modal + creep, 0.0, closing, 0.0, residual


MODES, REFINE = 12, 64
"""Modes of each part, and fine steps in a coarse one, where nothing else is said."""


@dataclass(frozen=True)
class ReducedMotion:
    """A reduced case, ready to compute periods.

    A state is (q, q', s of each part), see `model.reduced`, shape (n_state,).

    Attributes:
        case: the case.
        structure: its discretisation, which the modes are those of.
        modes: number of modes of each part.
        periods: computes periods.
        motion: the drive, period by period.
    """

    case: Case
    structure: Structure
    modes: int
    periods: Periods
    motion: BaseStates

    @property
    def reduced(self) -> Reduced:
        """The reduced problem."""
        return self.periods.reduced

    @property
    def rest(self) -> FloatArray:
        """The state at t = 0 of a structure at rest, shape (n_state,)."""
        at_rest = np.zeros(self.reduced.n_state)
        if not self.structure.operators.base.is_force:  # seen from the base, which moves already
            o, (q, dq) = self.structure.operators, self.motion(0)[0, :2].tolist()
            m, pull = self.reduced.n_modes, o.mass @ self.reduced.drive @ self.reduced.shapes
            at_rest[:m], at_rest[m : 2 * m] = -q * pull, -dq * pull
        return at_rest

    def advance(self, state: FloatArray, periods: int = 1, first: int = 0) -> FloatArray:
        """Return the state some periods later; NaN if the motion diverges.

        Args:
            state: state at the beginning of a period, shape (n_state,).
            periods: number of periods.
            first: number of the first period, for drives that do not repeat.
        """
        for k in range(first, first + periods):
            state = self.periods.advance(state, self._drive(k))
        return state

    def period(self, state: FloatArray, number: int = 0) -> Period:
        """Compute a period and keep every step of it."""
        return self.periods.record(state, self._drive(number))

    def run(
        self,
        periods: int | None = None,
        *,
        initial: FloatArray | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Result:
        """Compute periods, and return what a run of the whole structure returns.

        Args:
            periods: number of periods; None: those of the case.
            initial: state at the start; None: at rest.
            progress: called after each period with the number of finished periods and of all.

        Returns:
            The result. Its energies are explained in docs/reduced.md.
        """
        span = span_of(self.case)
        n = span.periods if periods is None else periods
        window = min(span.window_periods, n)
        recording = Recording(
            self.structure, self.periods, replace(span, periods=n, window_periods=window)
        )
        state, begin = self.rest if initial is None else initial, time.perf_counter()
        outcome = "completed"
        for k in range(n):
            computed = self.period(state, k)
            if not recording.add(computed, state, self.motion(k)):
                outcome = "diverged"
                break
            state = computed.end
            if progress is not None:
                progress(k + 1, n)
        return recording.result(self.case, outcome, self.modes, time.perf_counter() - begin)

    def _drive(self, period: int) -> Drive:
        return (
            self._first_drive if self.case.is_periodic else self.periods.drive(self.motion(period))
        )

    @cached_property
    def _first_drive(self) -> Drive:
        return self.periods.drive(self.motion(0))


def reduced(
    case: CaseSource,
    modes: int = MODES,
    *,
    refine: int = REFINE,
    structure: Structure | None = None,
) -> ReducedMotion:
    """Return a case with the lowest modes of each lamina, or of a bonded structure.

    Args:
        case: the case.
        modes: number of modes of each part that is kept.
        refine: number of fine steps in a time step of the case, near contact.
        structure: the discretised case; None: beams in closed form.

    Raises:
        CaseError: the case cannot be reduced to so many modes.
    """
    case = find_case(case)
    discretise.require_no_stops(case, "modes and massless contact points")
    structure = discretise.assemble(case, needs_dolfinx=False) if structure is None else structure
    try:
        operators = structure.operators
        if case.contact.law == "none":
            operators = without_contact(operators)
        periods = Periods(reduce(operators, modes), case.time_step, refine)
    except ValueError as error:
        raise CaseError(f"case {case.name}: {error}") from None
    return ReducedMotion(case, structure, modes, periods, motion_of(case))


def without_contact(operators: Operators) -> Operators:
    """Return operators without pairs."""
    H = sp.csr_matrix((0, operators.n_dofs))
    return replace(operators, gap_matrix=H, gap0=np.zeros(0), pair_weights=None)


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

"""Map the state of a case from one period to the next, with one key as the parameter.

`PeriodMap` is what a map must offer, so that orbits of it can be found and followed. A state z at
the beginning of a period of the drive is (u, v), shape (2 n,), or what else a map says of its
`Nature`. The map Φ(z, λ) leads to the state one period later; λ is any number that the map depends
on, such as a frequency. The search knows nothing of what computes the map: an engine, modes or a
formula.

`StrobeMap` is stepped by an engine. A state (u, v) says nothing of pairs at rest, which carry a
spring in some laws. A pair counts as resting where its gap is closed at the section: that is what
the laws leave behind.

`ModalMap` is that of modes with massless contact points. A state is (q, q', s of each part), see
`model.reduced`. The same fine steps resolve contact in every call, so the map is one fixed
function; it needs no shifted step grids.

`KeptMap` keeps the results of a map on disk.
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.excitation import drive
from delam_fem.contact.laws import LAWS, Law, Scheme
from delam_fem.engines.modal import Drive, Period, Periods
from delam_fem.engines.session import Prescribed, engine_of, law_of, motion_of, scheme_of, span_of
from delam_fem.model import discretise
from delam_fem.model.layout import Structure
from delam_fem.model.linear import lowest
from delam_fem.model.operators import Operators
from delam_fem.model.reduced import Reduced, reduce
from delam_fem.numerics.types import FloatArray
from delam_fem.simulation.checkpoint import CHECKPOINT_SECONDS
from delam_fem.simulation.loop import Engine, State, one_period, set_initial
from delam_fem.simulation.recorder import N_BASE, PeriodRecord, Recorder
from delam_fem.simulation.refinement import Span
from delam_fem.studies.sweeps.point import assembly_key
from delam_fem.system.errors import CaseError
from delam_fem.system.files import read_arrays, write_arrays


@dataclass(frozen=True)
class Nature:
    """Model behind a map, and the parts of its states, for files, pictures and words.

    Attributes:
        name: name of the model.
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
        """Return the scale of each coordinate, the largest modulus in its part or 1, shape (n,)."""
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
            anew, shape (k, n_seen) [m].
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


def passage(
    states: FloatArray,
    u: FloatArray,
    first: int,
    tip: tuple[int, int, float] | None,
    lowest: FloatArray | None = None,
) -> Passage:
    """Return the passage through some periods from the displacements at their steps.

    Args:
        states: states at the ends of the periods, shape (n_periods, n).
        u: displacements of the probes after each step, shape (n_steps, n_probes) [m].
        first: number of the step of the drive at which a period of the map begins.
        tip: two probes and the gap between them at rest [m]; None: not seen.
        lowest: smallest gap of each period, where it is known more finely than at steps [m].
    """
    gap = np.full(len(u), np.inf) if tip is None else tip[2] + u[:, tip[1]] - u[:, tip[0]]
    gaps = gap.reshape(len(states), -1)
    n, lowest = gaps.shape[1], gaps.min(axis=1) if lowest is None else lowest
    low, high = u.min(axis=0), u.max(axis=0)
    # row k of u is after step k + 1 of the map; the drive begins anew after step n - first
    strobes = u[n - 1 - first :: n]
    return Passage(states, strobes, low, high, float(lowest.min()), lowest, gaps[:, -1], u)


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

    def opened(self, state: FloatArray, parameter: float) -> tuple[PeriodMap, FloatArray]:
        """Return the map whose periods begin where the tips are farthest apart, and a state there.

        A kick there violates no gap. A map without tips is returned as it is.

        Args:
            state: at the beginning of a period.
            parameter: λ.
        """


KEPT = 4
"""Number of engines that are kept: continuation returns to neighbouring parameters."""
BEGINNINGS = 20
"""Number of instants of a period among which its beginning is chosen."""


@dataclass(frozen=True)
class Problem:
    """One problem whose drive repeats after each period.

    Attributes:
        operators: the semi-discrete problem.
        law: the contact law.
        scheme: the time integration.
        motion: the drive.
        span: time step, steps per period, refinement and bound.
        tip: two probes and the gap between them at rest [m], for the smallest gap; None: not seen.
    """

    operators: Operators
    law: Law
    scheme: Scheme
    motion: Prescribed
    span: Span
    tip: tuple[int, int, float] | None = None


class StrobeMap:
    """The map of a family of problems; see `PeriodMap`.

    Attributes:
        slow: coordinates for Newton's method.
        nature: what the map is of.
        evaluations: periods computed so far.
    """

    def __init__(
        self, problem_of: Callable[[float], Problem], slow: Slow, *, phase: float = 0.0
    ) -> None:
        """Store the family; engines are made when they are needed.

        Args:
            problem_of: problem for a value of the parameter; all have the same number of dofs.
            slow: coordinates for Newton's method.
            phase: where in a period of the drive a period of the map begins, 0 to 1.
        """
        self.slow, self.evaluations, self.phase = slow, 0, phase
        n = slow.basis.shape[0] // 2
        self.nature = Nature("finite elements", {"displacement": n, "velocity": n}, is_stepped=True)
        self._problem_of = problem_of
        self._at = lru_cache(KEPT)(lambda parameter: _Ready(problem_of(parameter), phase))

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        """Return the states one period later; see `PeriodMap.after`."""
        ready = self._at(parameter)
        given = np.zeros(len(states)) if shifts is None else shifts
        self.evaluations += len(states)
        every = zip(states, given.tolist(), strict=True)
        return np.array([ready.end(state, shift)[0] for state, shift in every])

    def watched(self, state: FloatArray, parameter: float, periods: int) -> Passage:
        """Return what is seen in some periods from a state."""
        ready, states, records = self._at(parameter), [state], []
        for _ in range(periods):
            end, record = ready.end(states[-1], 0.0)
            states.append(end)
            records.append(record)
        self.evaluations += periods
        u = np.concatenate([record.u[1:, N_BASE:] for record in records])
        return passage(np.array(states[1:]), u, ready.first, ready.problem.tip)

    def opened(self, state: FloatArray, parameter: float) -> tuple[StrobeMap, FloatArray]:
        """Return the map whose periods begin where the tips are farthest apart, and a state there.

        A kick there violates no gap. A map without tips, or of a case that is too coarse in time
        for other beginnings, is returned as it is.

        Args:
            state: at the beginning of a period, shape (2 n,).
            parameter: λ.
        """
        ready = self._at(parameter)
        tip, span = ready.problem.tip, ready.problem.span
        if tip is None or span.steps_per_period % BEGINNINGS:
            return self, state
        _, record = ready.end(state, 0.0, BEGINNINGS)
        every = span.steps_per_period // BEGINNINGS
        u = record.u[every::every, N_BASE:]
        best = int(np.argmax(u[:, tip[1]] - u[:, tip[0]]))
        share = ((best + 1) / BEGINNINGS + self.phase) % 1.0
        found = record.frames[best].ravel()
        return StrobeMap(self._problem_of, self.slow, phase=share), np.asarray(found)


class _Ready:
    """A problem with its engine, and tables of its drive on shifted step grids.

    Attributes:
        problem: the problem.
        first: number of the step of the drive at which a period of the map begins.
    """

    def __init__(self, problem: Problem, phase: float) -> None:
        span = problem.span
        self.problem, self.first = problem, round(phase * span.steps_per_period)
        self.engine: Engine = engine_of(
            problem.operators,
            problem.law,
            problem.scheme,
            span.time_step,
            refinement=span.refinement,
        )
        self._recorder, self._table = cache(self._made_recorder), cache(self._made_table)

    def end(
        self, state: FloatArray, shift: float, frames: int = 0
    ) -> tuple[FloatArray, PeriodRecord]:
        """Return the state one period later, NaN if the motion diverges, and the record.

        Args:
            state: state at the beginning, shape (2 n,).
            shift: shift of the grid of time steps, as a share of a step.
            frames: number of states on the way that the record keeps.
        """
        table = self._table(shift)
        u, v = state.reshape(2, -1)
        motion = np.array([u, v, np.zeros_like(u)])
        operators = self.problem.operators
        resting = np.zeros(operators.n_pairs, dtype=np.bool_)
        if LAWS[self.problem.law.name].spring:
            resting = operators.gap_matrix @ u + operators.gap0 <= 0.0
        set_initial(self.engine, State(motion, resting), table[0])
        recorder = self._recorder(frames)
        record = one_period(self.engine, recorder, table)
        if record.n_steps < len(table) - 1:
            return np.full_like(state, np.nan), record
        return self.engine.state().motion[:2].ravel(), record

    def _made_recorder(self, frames: int) -> Recorder:
        """Return a recorder that keeps some states of each period."""
        span, o = replace(self.problem.span, frames_per_period=frames), self.problem.operators
        return Recorder(o.base, span, o.n_probes, o.n_sensors)

    def _made_table(self, shift: float) -> FloatArray:
        """Return (q, q', q'') on a grid that begins a share of a step later, shape (N + 1, 3)."""
        span = self.problem.span
        steps = np.arange(span.steps_per_period + 1) + (shift + self.first)
        table = self.problem.motion.states(steps * span.time_step)
        table[-1] = table[0]  # periodic to the last bit
        return table


MODES = 4
"""Lowest modes of the structure whose displacements and velocities are the slow coordinates."""
FREQUENCY = "excitation.frequency"


class CaseFamily:
    """The problems of a case for the values of one key.

    Attributes:
        case: the case.
        key: the key, with dots.
    """

    def __init__(self, case: Case, key: str) -> None:
        """Check the key and assemble the case.

        Raises:
            CaseError: the drive is not periodic, or the key is not one of numbers.
        """
        if not case.is_periodic:
            raise CaseError(
                "excitation.kind: expected a drive that repeats after each period, given "
                f"{case.excitation.kind!r}"
            )
        if case.is_floating:
            raise CaseError("orbit: expected a structure, points and impactors that are all held")
        self.case, self.key = case, key
        self._structures: dict[str, Structure] = {}

    def at(self, value: float) -> Case:
        """Return the case for a value of the key."""
        return self.case.with_overrides({self.key: value})

    def problem(self, value: float) -> Problem:
        """Return the problem for a value of the key."""
        case = self.at(value)
        structure = self.structure(case)
        return Problem(
            structure.operators,
            law_of(case),
            scheme_of(case),
            drive(case),
            span_of(case),
            tip_of(structure),
        )

    def structure(self, case: Case) -> Structure:
        """Return the discretised case; it is assembled again only if the key changes it."""
        key = assembly_key(case)
        if key not in self._structures:
            self._structures = {key: discretise.assemble(case, needs_dolfinx=False)}
        return self._structures[key]

    def map(self) -> StrobeMap:
        """Return the map of the family, with the modes of the case as its slow coordinates."""
        return StrobeMap(self.problem, modal(self.structure(self.case).operators))


def tip_of(structure: Structure) -> tuple[int, int, float] | None:
    """Return the probes at the first pair with one on both sides, and its gap at rest [m]."""
    layout, gap0 = structure.layout, structure.operators.gap0
    for interface in layout.interfaces:
        for pair, place in enumerate(interface.places.tolist()):
            found = [
                number
                for part in interface.parts
                for number, probe in enumerate(layout.probes)
                if (probe.part, probe.point) == (part, place)
            ]
            if len(found) == 2:
                return found[0], found[1], float(gap0[interface.first_pair + pair])
    return None


def modal(operators: Operators, n_modes: int = MODES) -> Slow:
    """Return the displacements and velocities of the lowest modes as slow coordinates.

    The coordinates are ω_j a_j and b_j of u = Σ a_j φ_j, v = Σ b_j φ_j with φᵀ M φ = 1, so that
    their squares are twice the strain and the kinetic energy of the mode [J^½].
    """
    n = operators.n_dofs
    count = min(n_modes, n)
    frequencies, vectors = lowest(operators.stiffness, operators.mass, count)
    omega = 2.0 * np.pi * frequencies
    masses = np.sqrt(np.einsum("ij,ij->j", vectors, operators.mass @ vectors))
    phi: FloatArray = vectors / masses
    reads = (operators.mass @ phi).T
    basis, dual = np.zeros((2 * n, 2 * count)), np.zeros((2 * count, 2 * n))
    basis[:n, :count], basis[n:, count:] = phi / omega, phi
    dual[:count, :n], dual[count:, n:] = omega[:, None] * reads, reads
    return Slow(basis, dual)


_log = logging.getLogger(__name__)


class KeptMap:
    """A map whose results are kept on disk, so that a search that is repeated finds them.

    A kill loses the results of the last `CHECKPOINT_SECONDS` at most.
    """

    def __init__(self, map_: PeriodMap, folder: Path) -> None:
        """Read what is known of a map.

        Args:
            map_: the map.
            folder: folder of the files, all of which are of this map.
        """
        folder.mkdir(exist_ok=True)
        self._map, self._folder, self._last = map_, folder, time.monotonic()
        self._new: dict[str, FloatArray] = {}
        self._known: dict[str, FloatArray] = {}
        for path in folder.glob("*.npz"):
            try:
                self._known |= read_arrays(path)
            except ValueError as error:
                _log.warning("%s: computed anew (%s)", path, error)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the map itself."""
        return getattr(self._map, name)

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        """Return the states one period later; see `PeriodMap`."""
        asked = [states, np.array(parameter), np.zeros(0) if shifts is None else shifts]
        key = hashlib.sha256(b"".join(values.tobytes() for values in asked)).hexdigest()
        if key not in self._known:
            self._known[key] = self._new[key] = self._map.after(states, parameter, shifts)
            if time.monotonic() - self._last > CHECKPOINT_SECONDS:
                write_arrays(self._folder / f"{key}.npz", self._new)
                self._new, self._last = {}, time.monotonic()
        return self._known[key].copy()

    def opened(self, state: FloatArray, parameter: float) -> tuple[PeriodMap, FloatArray]:
        """Return the map whose periods begin elsewhere, kept too; see `PeriodMap`."""
        map_, first = self._map.opened(state, parameter)
        return KeptMap(map_, self._folder / "opened"), first


SLOW_MODES = 4
"""Lowest modes whose displacements and velocities are the slow coordinates: two of each lamina."""


@dataclass(frozen=True)
class ModalProblem:
    """A case whose periods are computed in modes.

    Attributes:
        structure: the discretised case, whose modes are taken.
        periods: what computes periods.
        drive: drive in a period of the map.
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
        """Return the displacements of the probes at each step, shape (N, n_seen) [m]."""
        q, s, reduced = period.trace.q[1:], period.trace.s[1:], self.periods.reduced
        return np.asarray(reduced.displacement(q, s, self.drive.motion[1:]) @ reduced.probes.T)


class ModalMap:
    """The map of a family of cases with massless contact points; see `PeriodMap`.

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
        self.at = lru_cache(KEPT)(lambda parameter: self._problem(self._family.at(parameter)))
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
        tip, ends = tip_of(problem.structure), np.array([period.end for period in computed])
        lowest = None if tip is None else np.array([float(p.lowest[-1]) for p in computed])
        return passage(ends, u, problem.first, tip, lowest)

    def opened(self, state: FloatArray, parameter: float) -> tuple[ModalMap, FloatArray]:
        """Return the map that begins with the tips apart; see `PeriodMap.opened`."""
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

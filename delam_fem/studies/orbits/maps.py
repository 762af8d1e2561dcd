"""Map the state of a case from one period to the next, with one key as the parameter.

`PeriodMap` is what a map must offer, so that orbits of it can be found and followed. A state z at
the beginning of a period of the drive is (u, v), shape (2 n,), or what else a map says of its
`MapInfo`. The map Φ(z, λ) leads to the state one period later; λ is any number that the map depends
on, such as a frequency. The search knows nothing of what computes the map: an engine, modes or a
formula.

`StrobeMap` is stepped by an engine. A state (u, v) says nothing of pairs at rest, which carry a
spring in some laws. A pair counts as resting where its gap is closed at the section: that is what
the laws leave behind.

`ModalMap` is that of modes with massless contact points. A state is (q, q', s of each part), see
`model.massless`. The same fine steps resolve contact in every call, so the map is one fixed
function; it needs no shifted step grids.

`KeptMap` keeps the results of a map on disk.
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from delam_fem.api import (
    CHECKPOINT_SECONDS,
    N_BASE,
    Case,
    CaseError,
    Engine,
    FloatArray,
    Law,
    Operators,
    PairState,
    Period,
    PeriodDrive,
    PeriodRecord,
    Periods,
    Prescribed,
    Recorder,
    Reduced,
    Scheme,
    Span,
    State,
    Structure,
    assemble,
    belong,
    drive,
    engine_of,
    histories_of,
    lowest,
    motion_of,
    n_rigid,
    one_period,
    read_arrays,
    reduce,
    require_held,
    scheme_of,
    set_initial,
    span_of,
    write_arrays,
)
from delam_fem.studies.sweeps.point import assembly_key


@dataclass(frozen=True)
class MapInfo:
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
class SlowCoordinates:
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
class Trajectory:
    """What is seen on the way through some periods.

    Attributes:
        states: state at the end of each period, shape (k, 2 n).
        strobes: displacements of the probes [m], then the channels that are asked for, once in each
            period, where the drive begins anew, shape (k, n_seen).
        low, high: smallest and largest value of each, shape (n_seen,).
        smallest_gap: smallest gap at the probed pair [m]; it reaches 0 where it touches.
        gaps: the same in each period, shape (k,) [m]; empty: not known.
        openings: gap there at the end of each period, shape (k,) [m]; empty: not known. Kicks are
            the less harmful the larger it is.
        history: the same at each step, shape (n_steps, n_seen); empty: not kept.
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
        info: what the map is of.
    """

    slow: SlowCoordinates
    info: MapInfo

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

    def trajectory(self, state: FloatArray, parameter: float, periods: int) -> Trajectory:
        """Return what is seen in some periods from a state."""

    def started_at_widest_gap(
        self, state: FloatArray, parameter: float
    ) -> tuple[PeriodMap, FloatArray]:
        """Return the map whose periods begin where the gap is widest, and a state there.

        A kick there violates no gap. A map that sees no open gap is returned as it is.

        Args:
            state: at the beginning of a period.
            parameter: λ.
        """


KEPT = 4
"""Number of engines that are kept: continuation returns to neighbouring parameters."""
BEGINNINGS = 20
"""Number of instants of a period among which its beginning is chosen."""


@dataclass(frozen=True)
class PeriodSamples:
    """A period of a problem whose steps are kept.

    Attributes:
        end: state at its end, shape (n,); NaN if the motion diverges.
        u: displacements of the probes after each step, shape (N, n_probes) [m].
        record: record of the period; None: no channels are asked for.
        lowest: smallest gap at the probed pair, where it is known more finely than at steps [m].
    """

    end: FloatArray
    u: FloatArray
    record: PeriodRecord | None
    lowest: float = np.nan


@dataclass(frozen=True)
class Observer:
    """What a map shows beside the probes: channels of a run, over some of its periods.

    Attributes:
        channels: their names.
        structure: structure that moves.
        case: its case.
    """

    channels: tuple[str, ...]
    structure: Structure
    case: Case

    def recorder(self, n: int) -> Recorder:
        """Return a recorder of n periods without frames."""
        o = self.structure.operators
        span = replace(span_of(self.case), periods=n, window_periods=n, frames_per_period=0)
        return Recorder(o.base, span, o.n_probes, o.n_sensors)

    def values(self, records: list[PeriodRecord]) -> FloatArray:
        """Return the channels at each step of successive periods, shape (n_steps, n_channels).

        The motion counts as one that repeats: what a channel takes from before or after a step, as
        the filter of a sensor does, goes on at both ends.
        """
        n = len(records)
        recorder = self.recorder(3 * n)
        recorder.window.extend(3 * records)
        recorder.n_closed = 3 * n
        N = recorder.steps_per_period
        has_contacts = any(name.startswith("contact_") for name in self.channels)
        histories = histories_of(recorder, self.structure, self.case, has_contacts=has_contacts)
        middle = slice(n * N, 2 * n * N)
        return np.column_stack([histories[name].values[middle] for name in self.channels])


class ProblemMap:
    """The map of a family of problems, one for each value of the parameter; see `PeriodMap`.

    Attributes:
        slow: coordinates for Newton's method.
        info: what the map is of.
        phase: where in a period of the drive a period of the map begins, 0 to 1.
        evaluations: periods computed so far.
        at: function that returns the problem for a value of the parameter.
    """

    def __init__(
        self,
        problem_of: Callable[[float, float], PeriodicProblem | ModalProblem],
        slow: SlowCoordinates,
        info: MapInfo,
        phase: float = 0.0,
    ) -> None:
        """Store the family; problems are made when they are needed.

        Args:
            problem_of: problem for a value of the parameter and a phase; all have the same number
                of coordinates.
            slow: coordinates for Newton's method.
            info: what the map is of.
            phase: where in a period of the drive a period of the map begins, 0 to 1.
        """
        self.slow = slow
        self.info = info
        self.phase = phase
        self.evaluations = 0
        self._problem_of = problem_of
        self.at = lru_cache(KEPT)(lambda parameter: problem_of(parameter, phase))

    def after(
        self, states: FloatArray, parameter: float, shifts: FloatArray | None = None
    ) -> FloatArray:
        """Return the states one period later; see `PeriodMap.after`."""
        problem = self.at(parameter)
        offsets = np.zeros(len(states)) if shifts is None else shifts
        self.evaluations += len(states)
        every = zip(states, offsets.tolist(), strict=True)
        return np.array([problem.end(state, shift) for state, shift in every])

    def trajectory(self, state: FloatArray, parameter: float, periods: int) -> Trajectory:
        """Return what is seen in some periods from a state."""
        problem = self.at(parameter)
        pair = problem.pair
        samples: list[PeriodSamples] = []
        for _ in range(periods):
            samples.append(problem.period_samples(state))
            state = samples[-1].end
        self.evaluations += periods
        u = np.concatenate([sample.u for sample in samples])
        gap = np.full(len(u), np.inf)
        if pair is not None:
            lower, upper, at_rest = pair
            gap = at_rest + u[:, upper] - u[:, lower]
        gaps = gap.reshape(periods, -1)
        n = gaps.shape[1]
        fine = np.array([sample.lowest for sample in samples])
        lowest = np.where(np.isnan(fine), gaps.min(axis=1), fine)
        if problem.observer is not None:
            records = [sample.record for sample in samples if sample.record is not None]
            u = np.hstack([u, problem.observer.values(records)])
        # row k of u is after step k + 1 of the map; the drive begins anew after step n - first
        strobes = u[n - 1 - problem.first :: n]
        ends = np.array([sample.end for sample in samples])
        low = u.min(axis=0)
        high = u.max(axis=0)
        return Trajectory(ends, strobes, low, high, float(lowest.min()), lowest, gaps[:, -1], u)

    def started_at_widest_gap(
        self, state: FloatArray, parameter: float
    ) -> tuple[ProblemMap, FloatArray]:
        """Return the map that begins with the pair apart; see `PeriodMap`."""
        beginnings = self.at(parameter).beginnings(state)
        if beginnings is None:
            return self, state
        gaps, states = beginnings
        best = int(np.argmax(gaps))
        phase = ((best + 1) / gaps.size + self.phase) % 1.0
        return ProblemMap(self._problem_of, self.slow, self.info, phase), states[best]


@dataclass(frozen=True)
class PeriodicProblem:
    """One problem whose drive repeats after each period, stepped by an engine.

    Attributes:
        operators: the semi-discrete problem.
        law: the contact law.
        scheme: the time integration.
        motion: the drive.
        span: time step, steps per period, refinement and bound.
        pair: two probes and the gap between them at rest [m], for the smallest gap; None: not seen.
        observer: what is seen beside the probes; None: nothing.
        phase: where in a period of the drive a period of the map begins, 0 to 1.
    """

    operators: Operators
    law: Law
    scheme: Scheme
    motion: Prescribed
    span: Span
    pair: tuple[int, int, float] | None = None
    observer: Observer | None = None
    phase: float = 0.0

    @property
    def first(self) -> int:
        """Number of the step of the drive at which a period of the map begins."""
        return round(self.phase * self.span.steps_per_period)

    @cached_property
    def stepping(self) -> tuple[Engine, Recorder]:
        """Engine that computes the steps, and a recorder that keeps no states."""
        dt, refinement = self.span.time_step, self.span.refinement
        engine = engine_of(self.operators, self.law, self.scheme, dt, refinement=refinement)
        return engine, self.recorder(0)

    def recorder(self, frames: int) -> Recorder:
        """Return a recorder that keeps some states of each period."""
        span = replace(self.span, frames_per_period=frames)
        o = self.operators
        return Recorder(o.base, span, o.n_probes, o.n_sensors, forces_shift=o.forces_shift)

    @cached_property
    def table(self) -> Callable[[float], FloatArray]:
        """Function that returns (q, q', q'') on a grid that begins a share of a step later."""
        return cache(self._table)

    def _table(self, shift: float) -> FloatArray:
        steps = np.arange(self.span.steps_per_period + 1) + (shift + self.first)
        table = self.motion.states(steps * self.span.time_step)
        table[-1] = table[0]  # periodic to the last bit
        return table

    def period(
        self, state: FloatArray, shift: float, recorder: Recorder | None = None
    ) -> tuple[FloatArray, PeriodRecord]:
        """Return the state one period later, NaN if the motion diverges, and the record.

        Args:
            state: state at the beginning, shape (2 n,).
            shift: shift of the grid of time steps, as a share of a step.
            recorder: one that keeps states on the way; None: none are kept.
        """
        table, operators, (engine, usual) = self.table(shift), self.operators, self.stepping
        u, v = state.reshape(2, -1)
        motion = np.array([u, v, np.zeros_like(u)])
        numbers = self.law.numbers(self.scheme, operators.pair_numbers)
        resting = operators.gap_matrix @ u + operators.gap0 <= 0.0
        resting &= numbers.has_springs(operators.n_pairs)
        # by name: a map is one of the motion alone, which must say all that is remembered of pairs
        set_initial(engine, State(motion, PairState(resting=resting)), table[0])
        record = one_period(engine, recorder or usual, table)
        if record.n_steps < len(table) - 1:
            return np.full_like(state, np.nan), record
        return engine.state().motion[:2].ravel(), record

    def end(self, state: FloatArray, shift: float) -> FloatArray:
        """Return the state one period later; the grid of steps is shifted by a share of a step."""
        return self.period(state, shift)[0]

    def period_samples(self, state: FloatArray) -> PeriodSamples:
        """Return a period from a state, with every step."""
        end, record = self.period(state, 0.0)
        probes = slice(N_BASE, N_BASE + self.operators.n_probes)
        return PeriodSamples(end, record.u[1:, probes], record)

    def beginnings(self, state: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return gaps (k,) [m] and states (k, 2 n) at `BEGINNINGS` instants.

        The gap is that of the probed pair, or the smallest of all pairs where none is probed. None:
        the steps do not fall on these instants, or some pair is closed at each of them.
        """
        every, remainder = divmod(self.span.steps_per_period, BEGINNINGS)
        if remainder or not self.operators.n_pairs:
            return None
        record = self.period(state, 0.0, self.recorder(BEGINNINGS))[1]
        states = np.reshape(record.frames, (-1, state.size))
        if self.pair is not None:
            lower, upper, _ = self.pair
            u = record.u[every::every, N_BASE:]
            return u[:, upper] - u[:, lower], states
        o = self.operators
        gaps = (states[:, : o.n_dofs] @ o.gap_matrix.T + o.gap0).min(axis=1)
        return (gaps, states) if gaps.max() > 0.0 else None


class StrobeMap(ProblemMap):
    """The map of a family of problems that an engine steps; see `PeriodMap`."""

    def __init__(
        self,
        problem_of: Callable[[float], PeriodicProblem],
        slow: SlowCoordinates,
        *,
        phase: float = 0.0,
    ) -> None:
        """Store the family.

        Args:
            problem_of: problem for a value of the parameter; all have the same number of dofs.
            slow: coordinates for Newton's method.
            phase: where in a period of the drive a period of the map begins, 0 to 1.
        """
        n = slow.basis.shape[0] // 2
        info = MapInfo("finite elements", {"displacement": n, "velocity": n}, is_stepped=True)
        super().__init__(lambda at, phase: replace(problem_of(at), phase=phase), slow, info, phase)


MODES = 4
"""Lowest modes whose displacements and velocities are the slow coordinates: two of each lamina."""
FREQUENCY = "excitation.frequency"


class CaseFamily:
    """The problems of a case for the values of one key.

    Attributes:
        case: the case.
        key: the key, with dots.
        channels: channels that are seen beside the probes.
    """

    def __init__(self, case: Case, key: str, channels: Sequence[str] = ()) -> None:
        """Check the key and assemble the case.

        Raises:
            CaseError: the drive is not periodic, or the key is not one of numbers.
        """
        if not case.is_periodic:
            raise CaseError(
                "excitation.kind: expected a drive that repeats after each period, given "
                f"{case.excitation.kind!r}"
            )
        if not case.is_loaded:  # weight or a load brings back what floats
            require_held(case, "orbit")
        self.case = case
        self.key = key
        self.channels = tuple(channels)
        self._structures: dict[str, Structure] = {}

    def at(self, value: float) -> Case:
        """Return the case for a value of the key."""
        return self.case.with_overrides({self.key: value})

    def problem(self, value: float) -> PeriodicProblem:
        """Return the problem for a value of the key."""
        case = self.at(value)
        structure = self.structure(case)
        return PeriodicProblem(
            structure.operators,
            case.contact_law,
            scheme_of(case),
            drive(case.excitation),
            span_of(case),
            probed_pair(structure),
            self.observer(case),
        )

    def observer(self, case: Case) -> Observer | None:
        """Return what is seen of a case beside the probes; None: nothing."""
        return Observer(self.channels, self.structure(case), case) if self.channels else None

    def structure(self, case: Case) -> Structure:
        """Return the discretised case; it is assembled again only if the key changes it."""
        key = assembly_key(case)
        if key not in self._structures:
            self._structures = {key: assemble(case, needs_dolfinx=False)}
        return self._structures[key]

    def modal_problem(self, case: Case, phase: float) -> ModalProblem:
        """Return the problem of a case in modes; the table of its drive begins at the phase."""
        structure = self.structure(case)
        reduced = reduce(structure.operators, case.n_modes)
        periods = Periods(reduced, case.time_step, case.time.refine)
        table = motion_of(case)(0)
        first = round(phase * case.steps_per_period)
        shifted = np.concatenate([table[first:-1], table[: first + 1]])
        return ModalProblem(
            periods,
            periods.drive(shifted),
            first,
            probed_pair(structure),
            shifted,
            self.observer(case),
        )

    def map(self) -> StrobeMap:
        """Return the map of the family, with the modes of the case as its slow coordinates."""
        operators = self.structure(self.case).operators
        floating = 1.0 / self.case.period if self.case.is_floating else None
        return StrobeMap(self.problem, slow_modes(operators, floating=floating))


def probed_pair(structure: Structure) -> tuple[int, int, float] | None:
    """Return the probes at the first pair with one on both sides, and its gap at rest [m]."""
    layout = structure.layout
    gap0 = structure.operators.gap0
    for interface in layout.interfaces:
        for pair, place in enumerate(interface.places.tolist()):
            probes = [
                number
                for part in interface.parts
                for number, probe in enumerate(layout.probes)
                if (probe.part, probe.point) == (part, place)
            ]
            if len(probes) == 2:
                return probes[0], probes[1], float(gap0[interface.first_pair + pair])
    return None


def slow_modes(
    operators: Operators, n_modes: int = MODES, *, floating: float | None = None
) -> SlowCoordinates:
    """Return the displacements and velocities of the lowest modes as slow coordinates.

    The coordinates are ω_j a_j and b_j of u = Σ a_j φ_j, v = Σ b_j φ_j with φᵀ M φ = 1, so that
    their squares are twice the strain and the kinetic energy of the mode [J^½].

    Args:
        operators: the semi-discrete problem.
        n_modes: largest number of modes.
        floating: frequency that stands for that of motions without stiffness [Hz]; None: there are
            none.
    """
    n = operators.n_dofs
    count = min(n_modes, n)
    K = operators.stiffness
    frequencies, vectors = lowest(K, operators.mass, count, is_floating=floating is not None)
    if floating is not None:
        frequencies[: n_rigid(K)] = floating
    omega = 2.0 * np.pi * frequencies
    masses = np.sqrt(np.einsum("ij,ij->j", vectors, operators.mass @ vectors))
    phi: FloatArray = vectors / masses
    reads = (operators.mass @ phi).T
    basis = np.zeros((2 * n, 2 * count))
    dual = np.zeros((2 * count, 2 * n))
    basis[:n, :count] = phi / omega
    basis[n:, count:] = phi
    dual[:count, :n] = omega[:, None] * reads
    dual[count:, n:] = reads
    return SlowCoordinates(basis, dual)


_log = logging.getLogger(__name__)


class KeptMap:
    """A map whose results are kept on disk, so that a search that is repeated finds them.

    A kill loses the results of the last `CHECKPOINT_SECONDS` at most.
    """

    def __init__(self, map_: PeriodMap, folder: Path, case: str) -> None:
        """Read what is known of a map.

        Args:
            map_: the map.
            folder: folder of the files.
            case: identity of the case whose map it is.

        Raises:
            CaseError: the files are of the map of another case.
        """
        folder.mkdir(exist_ok=True)
        belong(folder, case)
        self._map = map_
        self._folder = folder
        self._case = case
        self._last = time.monotonic()
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
        if key not in self._known or self._known[key].shape != states.shape:
            self._known[key] = self._new[key] = self._map.after(states, parameter, shifts)
            if time.monotonic() - self._last > CHECKPOINT_SECONDS:
                write_arrays(self._folder / f"{key}.npz", self._new)
                self._new, self._last = {}, time.monotonic()
        return self._known[key].copy()

    def started_at_widest_gap(
        self, state: FloatArray, parameter: float
    ) -> tuple[PeriodMap, FloatArray]:
        """Return the map whose periods begin elsewhere, kept too; see `PeriodMap`."""
        map_, first = self._map.started_at_widest_gap(state, parameter)
        return KeptMap(map_, self._folder / "opened", self._case), first


@dataclass(frozen=True)
class ModalProblem:
    """A case whose periods are computed in modes.

    Attributes:
        periods: what computes periods.
        drive: drive in a period of the map.
        first: number of the step of the drive at which a period of the map begins.
        pair: two probes and the gap between them at rest [m]; None: not seen.
        table: (q, q', q'') of the drive at the steps of a period of the map, shape (N + 1, 3).
        observer: what is seen beside the probes; None: nothing.
    """

    periods: Periods
    drive: PeriodDrive
    first: int
    pair: tuple[int, int, float] | None
    table: FloatArray
    observer: Observer | None = None

    def end(self, state: FloatArray, shift: float) -> FloatArray:
        """Return the state one period later; contact is seen at any time, shifts have no effect."""
        return self.periods.advance(state, self.drive)

    def period_samples(self, state: FloatArray) -> PeriodSamples:
        """Return a period from a state, with every step."""
        period = self.periods.record(state, self.drive)
        lowest = np.nan if self.pair is None else float(period.lowest[-1])
        record = None if self.observer is None else self.recorded(state, self.observer)
        return PeriodSamples(period.end, self.displacements(period), record, lowest)

    def recorded(self, state: FloatArray, observer: Observer) -> PeriodRecord:
        """Return the record of a period from a state, by the engine of runs."""
        case = observer.case
        operators = observer.structure.operators
        engine = engine_of(
            operators,
            case.contact_law,
            scheme_of(case),
            case.time_step,
            refinement=span_of(case).refinement,
            modes=case.n_modes,
        )
        q, v, s = (part[None] for part in self.periods.split(state))
        reduced = self.periods.reduced
        base, rate, _ = self.table[0]
        u = reduced.displacement(q, s, np.array([base]))
        motion = np.concatenate([u, reduced.velocity(v, np.array([rate])), np.zeros_like(u)])
        resting = np.zeros(operators.n_pairs, dtype=np.bool_)
        engine.restore(State(motion, resting, internal=state), self.table[0])
        return one_period(engine, observer.recorder(1), self.table)

    def beginnings(self, state: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the gap of the probed pair (N,) [m] and the state (N, n) after each step.

        None: no pair is probed.
        """
        if self.pair is None:
            return None
        lower, upper, _ = self.pair
        period = self.periods.record(state, self.drive)
        q, v, s = (trace[1:].reshape(len(trace) - 1, -1) for trace in period.trace[:3])
        u = self.displacements(period)
        return u[:, upper] - u[:, lower], np.concatenate([q, v, s], axis=1)

    def displacements(self, period: Period) -> FloatArray:
        """Return the displacements of the probes at each step, shape (N, n_seen) [m]."""
        q = period.trace.q[1:]
        s = period.trace.s[1:]
        reduced = self.periods.reduced
        return np.asarray(reduced.displacement(q, s, self.drive.motion[1:]) @ reduced.probes.T)


class ModalMap(ProblemMap):
    """The map of a family of cases with massless contact points; see `PeriodMap`.

    Its slow coordinates are ω q and q' of the lowest modes [J^½].
    """

    def __init__(self, case: Case, key: str = FREQUENCY, channels: Sequence[str] = ()) -> None:
        """Check the key and compute the modes of the case.

        Args:
            case: the case; its contact points have no mass.
            key: the parameter.
            channels: channels that are seen beside the probes.

        Raises:
            CaseError: the drive does not repeat, there is no contact, or the case has no such
                modes.
        """
        family = CaseFamily(case, key, channels)
        if case.contact.law == "none":
            raise CaseError("contact.law: expected a law with contact, given 'none'")
        first = family.modal_problem(case, 0.0).periods.reduced
        m = first.n_modes
        parts = {
            "modal_displacement": m, "modal_velocity": m, "late_force": first.n_state - 2 * m,
        }  # fmt: skip
        info = MapInfo(f"{m // first.n_parts} modes of each part, r = {case.time.refine}", parts)
        super().__init__(
            lambda at, phase: family.modal_problem(family.at(at), phase), slow_modes_of(first), info
        )


def slow_modes_of(model: Reduced) -> SlowCoordinates:
    """Return ω q and q' of the lowest modes as slow coordinates."""
    chosen = np.sort(np.argsort(model.squares, kind="stable")[:MODES])
    omega = np.sqrt(model.squares[chosen])
    count = chosen.size
    m = model.n_modes
    basis = np.zeros((model.n_state, 2 * count))
    dual = np.zeros((2 * count, model.n_state))
    columns = np.arange(count)
    basis[chosen, columns] = 1.0 / omega
    dual[columns, chosen] = omega
    basis[m + chosen, count + columns] = dual[count + columns, m + chosen] = 1.0
    return SlowCoordinates(basis, dual)

"""Compute points of a sweep in a worker: case, structure, run, row of numbers.

Estimate the largest Lyapunov exponent from two neighbouring motions. A second motion starts at the
distance d0 from the first one, in the energy norm

    |δ|² = δvᵀ M δv + δuᵀ K δu      (Y1)

After each period of the excitation the distance d is measured, and the second motion is moved back
to the distance d0 along the line between both. The exponent is the mean of ln(d/d0)/T. It includes
the jumps at impacts as the scheme computes them. A scheme that places impacts at the ends of steps
has no derivative there: two motions closer than the approach velocity times the time step mostly
hit in the same step. The result is then the exponent of the discrete map, so a third motion at
twice the distance is followed, too.

The error is that of the mean, and the difference between both distances. How often two of it hold
is on the page docs/calibration.md.

Source: Benettin, Galgani, Giorgilli, Strelcyn, Meccanica 15 (1980) 9–20; for impacts Stefański,
Chaos, Solitons & Fractals 11 (2000) 2443–2451.

No dataset is built, and a worker keeps structures for points that share them. dolfinx and PETSc are
imported only if the sweep needs them, so that a worker starts fast.
"""

from __future__ import annotations

import logging
import math
import pickle
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.special import ndtr, stdtrit

from delam_fem.case.definition import Case
from delam_fem.case.sections import Contact
from delam_fem.engines.session import Session, initialise_petsc_alone, session_of
from delam_fem.model import discretise
from delam_fem.model.layout import Layout, Structure
from delam_fem.model.linear import first_mode
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray
from delam_fem.results.quality import OPEN, decay_of, enough_of, is_lost
from delam_fem.simulation.loop import (
    Engine,
    State,
    initial_state,
    one_period,
    set_initial,
)
from delam_fem.simulation.recorder import Recorder
from delam_fem.studies.linear import steady_motion
from delam_fem.studies.sweeps.grid import Sweep, Value, is_initial
from delam_fem.studies.sweeps.quantities import Quantity, quantities, row_of
from delam_fem.system.errors import CaseError

BLOCKS = 10
"""Number of blocks of successive periods whose means give the statistical error."""
STUDENT = float(stdtrit(BLOCKS - 1, ndtr(2.0))) / 2.0
"""Factor by which two errors of few blocks contain what two of a known normal error do."""
WIDER = 2.0
"""Second distance of neighbouring motions, relative to the first."""
ALIGNING = 0.5
"""Share of the periods at the start that are not counted, because the second motion still turns
into the direction that decays most slowly. If two decay rates differ by 0.1/s, this takes some tens
of seconds."""


@dataclass(frozen=True)
class Exponent:
    """A Lyapunov exponent.

    Attributes:
        value: the exponent [1/s].
        error: half of an interval of 95 % for the mean that it is and for what twice the distance
            changes, as a standard error [1/s]; NaN for fewer than `BLOCKS` periods.
    """

    value: float
    error: float


UNKNOWN = Exponent(math.nan, math.nan)


def largest_exponent(
    session: Session,
    operators: Operators,
    *,
    direction: FloatArray,
    period: float,
    periods: int,
    perturbation: float,
) -> Exponent:
    """Continue a session and return the largest Lyapunov exponent of its motion.

    Args:
        session: session at the end of a run, with the motion on its attractor.
        operators: operators of the session, for the norm Y1.
        direction: direction of the initial difference of displacements, of any length, shape (n,).
        period: period T of the excitation [s].
        periods: number of periods over which the distance is measured.
        perturbation: d0 relative to the norm of the motion [-].

    Returns:
        The exponent with its error; NaN if a motion diverges or the system is at rest.
    """
    engine, recorder = session.engine, session.recorder
    one = engine.state()
    d0 = perturbation * _norm(one.motion, operators)
    step = np.zeros_like(one.motion)
    step[0] = direction
    length = _norm(step, operators)
    if not (d0 > 0.0 and length > 0.0):
        return UNKNOWN
    apart = [d0, WIDER * d0]
    others = [State(one.motion + size / length * step, one.resting) for size in apart]
    growth, aligning = np.empty((periods, len(apart))), int(ALIGNING * periods)
    of_one = recorder.of_one_period()
    for number in range(periods):
        base_states = session.motion(recorder.n_closed + number)
        after = [_advanced(engine, of_one, state, base_states) for state in (one, *others)]
        if after[0] is None:
            return UNKNOWN
        one = after[0]
        for k, size in enumerate(apart):
            if (other := after[k + 1]) is None:
                return UNKNOWN
            step = other.motion - one.motion
            d = _norm(step, operators)
            if not 0.0 < d < math.inf:
                return UNKNOWN
            growth[number, k] = math.log(d / size)
            others[k] = State(one.motion + size / d * step, one.resting)
    near, far = (mean_growth(rates) for rates in growth[aligning:].T / period)
    return Exponent(near.value, math.hypot(STUDENT * near.error, far.value - near.value))


def mean_growth(rates: FloatArray) -> Exponent:
    """Return the mean of the rates of successive periods and its statistical error.

    Rates of neighbouring periods depend on one another; the means of `BLOCKS` blocks hardly do.

    Args:
        rates: ln(d/d0)/T of each period, shape (n,) [1/s].
    """
    means = [part.mean() for part in np.array_split(rates, BLOCKS) if part.size]
    error = np.std(means, ddof=1) / math.sqrt(len(means)) if len(means) == BLOCKS else math.nan
    return Exponent(float(rates.mean()), float(error))


def _advanced(
    engine: Engine, recorder: Recorder, state: State, base_states: FloatArray
) -> State | None:
    """Return the state one period later; None if the motion diverges."""
    set_initial(engine, state, base_states[0])
    record = one_period(engine, recorder, base_states)
    return engine.state() if record.n_steps == len(base_states) - 1 else None


def _norm(motion: FloatArray, operators: Operators) -> float:
    """Return the norm Y1 of a motion (u, v, …), shape (≥ 2, n) [J^½]."""
    u, v = motion[0], motion[1]
    return math.sqrt(float(v @ (operators.mass @ v) + u @ (operators.stiffness @ u)))


KEPT_STRUCTURES = 16
"""Number of structures that a worker keeps; neighbouring points mostly share one."""
_KEPT_SWEEPS = 4
NOT_ASSEMBLED: Mapping[str, bool | set[str]] = {
    "name": True,
    "excitation": True,
    "contact": set(Contact.model_fields) - {"points_per_element"},
    "output": True,
    "time": {"scheme", "steps_per_period", "periods", "most_periods"},
}
"""Sections and keys of a case that do not affect the assembly, in the notation of pydantic."""

_OF_THE_POINT = ("lamina", "position")
"""Keys of the excitation that do affect it: the point at which a force acts."""

_log = logging.getLogger(__name__)
_thread = threading.local()


@dataclass(frozen=True)
class Chunk:
    """Points that a worker computes one after the other.

    Attributes:
        track: number of the track, -1 if the points are independent.
        indices: indices of the points.
        state: state at the end of the point before the chunk; None: from the initial conditions.
    """

    track: int
    indices: tuple[int, ...]
    state: State | None = None


@dataclass(frozen=True)
class Point:
    """The result of a point.

    Attributes:
        index: index of the point.
        outcome: "completed", "diverged" or "failed".
        error: reason why the point was not completed; empty if it was.
        row: values in the order of `quantities.quantities`; None unless completed.
    """

    index: int
    outcome: str
    error: str
    row: FloatArray | None


@dataclass(frozen=True)
class Done:
    """The result of a chunk.

    Attributes:
        chunk: the chunk.
        points: results of its points, in order.
        state: final state of the last completed point, in a track.
        seconds: computing time of the chunk [s].
        idle: time that the worker waited before the chunk; 0 for its first chunk [s].
    """

    chunk: Chunk
    points: tuple[Point, ...]
    state: State | None
    seconds: float
    idle: float


@dataclass
class Discretised:
    """What points with the same model share.

    Attributes:
        structure: the discretised case.
        rate: at which its slowest mode dies out [1/s].
        modes: first modes of its parts, as far as initial conditions have needed them.
    """

    structure: Structure
    rate: float
    modes: dict[int, FloatArray] = field(default_factory=dict)

    def first_mode(self, number: int) -> FloatArray:
        """Return the first mode of a part; see `linear.first_mode`."""
        if number not in self.modes:
            self.modes[number] = first_mode(self.structure, number)
        return self.modes[number]


@dataclass
class PointRunner:
    """Computes points of one sweep.

    Attributes:
        sweep: the sweep.
    """

    sweep: Sweep
    _known: dict[str, Discretised] = field(default_factory=dict)
    _last: tuple[dict[str, Value], Case, Discretised] | None = None

    def quantities(self, layout: Layout) -> tuple[Quantity, ...]:
        """Return the quantities in a row, in order."""
        return quantities(self.sweep.file.record, layout)

    def point(self, index: int, carried: State | None) -> tuple[Point, State | None]:
        """Compute a point; an exception becomes the outcome "failed".

        Args:
            index: index of the point.
            carried: state to start from; None: the initial conditions of the point.

        Returns:
            The result of the point, and the state at its end (None unless completed).
        """
        try:
            with np.errstate(all="ignore"):  # the outcome reports a diverged motion
                return self._computed(index, carried)
        except Exception as error:
            _log.debug("point %d", index, exc_info=True)
            kind = "" if isinstance(error, CaseError) else f"{type(error).__name__}: "
            return Point(index, "failed", f"{kind}{error}", None), None

    def structure(self, case: Case) -> Structure:
        """Return the discretised case, from memory if another case with the same model made it."""
        return self._discretised(case).structure

    def _discretised(self, case: Case) -> Discretised:
        """Return the discretised case, and what goes with it."""
        key = assembly_key(case)
        if key not in self._known:
            while len(self._known) >= KEPT_STRUCTURES:
                del self._known[next(iter(self._known))]
            structure = _assemble(case, self.sweep.file.operators)
            self._known[key] = Discretised(structure, decay_of(case, structure))
        return self._known[key]

    def _prepared(self, index: int) -> tuple[Case, Discretised]:
        """Return the case of a point and its model.

        Neighbours that differ in initial conditions alone share both.
        """
        values = self.sweep.overrides(index)
        own = {key: value for key, value in values.items() if not is_initial(key)}
        if self._last is None or self._last[0] != own:
            record, case = self.sweep.file.record, self.sweep.case(index)
            if not (record.node_distortion or record.scan):
                output = case.output.model_copy(update={"fields_per_period": 0})
                case = case.model_copy(update={"output": output})
            self._last = own, case, self._discretised(case)
        return self._last[1:]

    def _computed(self, index: int, carried: State | None) -> tuple[Point, State | None]:
        record = self.sweep.file.record
        case, known = self._prepared(index)
        structure, rate = known.structure, known.rate
        operators, layout, decay = structure.operators, structure.layout, rate * case.period
        if carried is None:
            carried = self._initial(case, known, index)
        engine = self.sweep.file.engine
        with session_of(case, operators, initial=carried, engine=engine) as opened:
            recorder = opened.recorder
            outcome = opened.run(enough=enough_of(case, recorder, len(layout.parts), decay))
            if outcome != "completed":
                return Point(index, outcome, _where(recorder, case), None), None
            if is_lost(recorder.energy_residual()):
                return Point(index, "diverged", OPEN, None), None
            state = opened.engine.state()
            extra: dict[str, float] = {}
            if record.lyapunov:
                found = largest_exponent(
                    opened,
                    operators,
                    direction=np.sum(
                        [known.first_mode(i) for i in range(len(layout.parts))], axis=0
                    ),
                    period=case.period,
                    periods=record.lyapunov,
                    perturbation=record.perturbation,
                )
                extra |= {"lyapunov_exponent": found.value, "lyapunov_error": found.error}
        wanted = self.quantities(layout)
        row = row_of(wanted, case, recorder, structure, extra, decay)
        return Point(index, outcome, "", row), state

    def _initial(self, case: Case, known: Discretised, index: int) -> State | None:
        """Return the state at the start of a point; None: at rest."""
        if self.sweep.file.start == "steady":
            return steady_motion(case, known.structure)
        return initial_state(known.structure, self.sweep.initial(index), known.first_mode)


def assembly_key(case: Case) -> str:
    """Return a text that is the same for two cases only if they have the same model.

    It contains the whole case except `NOT_ASSEMBLED`, so a new section or key is included by
    itself.
    """
    drive = (case.excitation.acts_on, *(getattr(case.excitation, k, None) for k in _OF_THE_POINT))
    dofs = case.contact.impulse if case.model.is_continuum else ""  # see model/solids/unknowns.py
    weights = case.spring if case.stop or case.impactor else ""  # of pairs, see model/stops.py
    return f"{case.model_dump_json(exclude=NOT_ASSEMBLED)} {drive} {dofs} {weights}"


def compute(packed: bytes, chunk: Chunk) -> Done:
    """Compute a chunk; executors call this function.

    Args:
        packed: the pickled sweep; each worker unpickles it once.
        chunk: the chunk.
    """
    begin = time.perf_counter()
    idle = begin - getattr(_thread, "end", begin)
    runner, state = _runner(packed), chunk.state
    points = []
    for index in chunk.indices:
        carried = state if chunk.track >= 0 else None
        point, after = runner.point(index, carried)
        points.append(point)
        if chunk.track >= 0 and after is not None:
            state = after  # after a point that failed, the last good state is used again
    _thread.end = time.perf_counter()
    return Done(chunk, tuple(points), state, _thread.end - begin, idle)


@lru_cache(maxsize=_KEPT_SWEEPS)
def _runner(packed: bytes) -> PointRunner:
    return PointRunner(pickle.loads(packed))


def _assemble(case: Case, operators: str) -> Structure:
    """Assemble a case; the closed form needs no dolfinx and equals its matrices to round-off."""
    needs_dolfinx = operators != "closed-form"
    if needs_dolfinx or case.model.is_continuum:
        initialise_petsc_alone()
    return discretise.assemble(case, needs_dolfinx=needs_dolfinx)


def _where(recorder: Recorder, case: Case) -> str:
    """Return a message with the time and period in which a motion diverged."""
    last = recorder.window[-1].n_steps
    t = ((recorder.n_closed - 1) * recorder.steps_per_period + last) * case.time_step
    return f"diverged at t = {t:.6g} s (period {recorder.n_closed})"

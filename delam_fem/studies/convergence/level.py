"""Compute one level of a refinement study, and reduce its run to a few numbers with their scatter.

Each period of a motion is reduced to numbers, and these to means with their scatter. Trajectories
of an impacting motion depend on round-off; these statistics do not. The scatter of a motion that
repeats after P periods is taken between blocks of P periods, so that alternating cycles do not
count as scatter. The names of statistics contain the number of the lamina: 1, 2, ….

With contact, all levels of a mesh start from the same state, which newton@moreau-jean reaches from
rest with `SPIN_UP_STEPS` steps per period; each level then settles to its own motion. Without
contact, a level starts on the exact periodic motion of its mesh and settles until the difference
from its own periodic motion has decayed.
"""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from delam_fem.api import (
    CHANNEL_MEASURES,
    LEDGER,
    MEASURES,
    N_BASE,
    N_SIZES,
    OPEN,
    SHOWN,
    Case,
    EngineName,
    FloatArray,
    Recorder,
    State,
    Structure,
    assemble,
    blow_steps,
    diagnostics,
    first_shapes,
    harmonics,
    histories_of,
    is_lost,
    openings,
    session_of,
    span_of,
    step_hours,
)
from delam_fem.studies.convergence.refinement import FREE, RIGID, Level
from delam_fem.studies.linear import (
    first_frequencies,
    settling_periods,
    slowest_decay,
    steady_motion,
)

Statistics: TypeAlias = dict[str, tuple[float, float]]
"""Mean and scatter (standard deviation between blocks) of each statistic by name."""

HARMONICS = 100
"""Harmonics in the distortion factor; higher ones are of the size of a nanometre."""
SHOWN_HARMONICS = 5
"""Number of harmonics whose amplitudes are statistics."""


@dataclass(frozen=True)
class Statistic:
    """A statistic as tables and figures show it.

    Attributes:
        name: name of the statistic.
        symbol: symbol in headings.
        unit: unit in headings.
        factor: factor from SI to this unit.
        lamina: number of the lamina whose motion it is a length of, from 1; None: no length.
        scale: name of the statistic that is the unit of its distances; empty: itself.
        form: format of its numbers; empty: that of the table.
    """

    name: str
    symbol: str
    unit: str
    factor: float = 1.0
    lamina: int | None = None
    scale: str = ""
    form: str = ""

    @property
    def heading(self) -> str:
        """Symbol and unit as a heading."""
        return f"{self.symbol} [{self.unit or '–'}]"


IMPULSE = Statistic("modal_impulse", "Σ p φ1", "mN s", 1e3)
WORK = Statistic("contact_work", "contact work", *SHOWN["J"])


def extrema(n_laminae: int) -> tuple[Statistic, ...]:
    """Return the mean extremes of the displacements within a period, lamina by lamina.

    The extremes over several periods would grow with the scatter of cycles.
    """
    return tuple(
        Statistic(f"tip_{end}_{i}", f"y{i} {end}", *MEASURES[f"tip_{end}"].shown, i)
        for i in range(1, n_laminae + 1)
        for end in ("min", "max")
    )


def general(n_laminae: int) -> tuple[Statistic, ...]:
    """Return distortion factors, modal impulse and energy lost in contact, per period.

    The plain sum of impulses is left out: near a clamp pairs hardly move, and the share that each
    of them takes has no limit as their number grows. Their work on the first mode has one.
    """
    return (
        *(
            Statistic(f"distortion_factor_{i}", f"d{i}", *MEASURES["distortion_factor"].shown)
            for i in range(1, n_laminae + 1)
        ),
        IMPULSE,
        WORK,
    )


def amplitudes(n_laminae: int, count: int = SHOWN_HARMONICS) -> tuple[Statistic, ...]:
    """Return the amplitudes of the first harmonics, lamina by lamina."""
    return tuple(
        Statistic(f"amplitude_{i}_{k}", f"A{k} of {i}", *SHOWN["m"], i)
        for i in range(1, n_laminae + 1)
        for k in range(1, count + 1)
    )


def converging(n_laminae: int) -> tuple[Statistic, ...]:
    """Return all statistics of which a limit is computed."""
    return (*extrema(n_laminae), *general(n_laminae), *amplitudes(n_laminae))


def may_be_judged(n_laminae: int) -> tuple[Statistic, ...]:
    """Return the statistics whose intervals hold (docs/evidence/calibration.md)."""
    return (*extrema(n_laminae), *amplitudes(n_laminae, 1), IMPULSE)


def of_channel(name: str, measure: str, units: str) -> Statistic:
    """Return a measure of a channel as a statistic; one of its level is judged by its amplitude."""
    scale = f"{name}:amplitude" if measure in ("min", "max", "mean") else ""
    unit, factor = SHOWN.get(units, (units, 1.0))
    return Statistic(
        f"{name}:{measure}", f"{name} {measure}", unit, factor, scale=scale, form=".4g"
    )


def _of_channels(run: _Run, structure: Structure, level: Level, size: int) -> Statistics:
    """Return mean and scatter of all measures of a level's channels, between blocks of periods.

    Args:
        run: the run; its window has the periods of the statistics.
        structure: structure that moved.
        level: the level.
        size: number of periods in a block.
    """
    histories = histories_of(run.recorder, structure, level.case)
    entries: Statistics = {}
    for name in level.of:
        periods = histories[name].values.reshape(level.periods, level.steps)
        for key, measure in CHANNEL_MEASURES.items():
            values = measure.of(periods)
            blocks = values[values.size % size :].reshape(-1, size).mean(axis=1)
            entries[f"{name}:{key}"] = float(blocks.mean()), float(blocks.std())
    return entries


PeriodRow: TypeAlias = dict[str, Any]
"""The numbers of one period by name."""


def row_of(recorder: Recorder, n_laminae: int, opening: FloatArray) -> PeriodRow:
    """Return the numbers of the last period of a recorder.

    Args:
        recorder: recorder of the run; its first probes are the reference probes.
        n_laminae: number of laminae.
        opening: opening of each pair in the first mode, shape (n_pairs,); see `linear.openings`.

    Returns:
        Extremes of the probes [m], shape (n_laminae,); `harmonics`, the complex amplitudes of the
        excitation's harmonics there [m], shape (n_laminae, n); the sum of impulses, each
        times the opening of its pair in the first mode [N s]; the number of impulses on pairs; the
        net energy lost in contact by impacts, springs and dampers, and the part that impacts add
        [J]; the number of steps of all sizes.
    """
    record = recorder.window[-1]
    k = recorder.n_closed - 1
    u = record.u[1 : record.n_steps + 1, N_BASE : N_BASE + n_laminae].T
    below_nyquist = min(HARMONICS, (u.shape[1] - 1) // 2)
    coefficients = 2.0 * np.fft.rfft(u, axis=1)[:, 1 : below_nyquist + 1] / u.shape[1]
    jumps = record.jumps.columns()
    ledger = dict(zip(LEDGER, recorder.ledger[k].tolist(), strict=True))
    return {
        "tip_min": recorder.envelope[k, 0, :n_laminae],
        "tip_max": recorder.envelope[k, 1, :n_laminae],
        "harmonics": coefficients,
        "modal_impulse": jumps.impulses @ opening[jumps.hit],
        "impacts": recorder.impulse[k, 1],
        "contact_work": ledger["impact_loss"]
        + ledger["contact_damping_loss"]
        - ledger["spring_released"],
        "steps": recorder.effort[k, :N_SIZES].sum(),
        "impact_gain": recorder.impulse[k, 2],
    }


def statistics(rows: list[PeriodRow], strobe: FloatArray) -> Statistics:
    """Return the mean and the scatter of each statistic of a motion.

    Args:
        rows: numbers of the periods.
        strobe: displacements at the ends of these periods, shape (n_laminae, n_periods) [m].
    """
    low, high = (np.array([row[name] for row in rows]) for name in ("tip_min", "tip_max"))
    half_range = (high.max(axis=0) - low.min(axis=0)) / 2.0
    P = diagnostics.periodicity(strobe, half_range)[0]
    size = P or 1
    first = len(rows) % size  # whole blocks only, up to the last period
    blocks = [rows[k : k + size] for k in range(first, len(rows), size)]
    table = [_of_block(block) for block in blocks]
    values = {
        name: (
            float(np.mean([entry[name] for entry in table])),
            float(np.std([entry[name] for entry in table])),
        )
        for name in table[0]
    }
    return values | {"periodicity": (float(P or 0), 0.0), "blocks": (float(len(blocks)), 0.0)}


def _of_block(rows: list[PeriodRow]) -> dict[str, float]:
    """Return the statistics of a block of periods by name, with the numbers of laminae in names."""
    of_harmonics = np.abs(np.mean([row["harmonics"] for row in rows], axis=0))
    means = {
        name: np.stack([row[name] for row in rows], axis=-1).mean(axis=-1)
        for name in rows[0]
        if name != "harmonics"
    }
    means["distortion_factor"] = harmonics.distortion_factor(of_harmonics)
    means["amplitude"] = of_harmonics[:, :SHOWN_HARMONICS]
    return {
        "_".join([name, *(str(k + 1) for k in place)]): float(value)
        for name, values in means.items()
        for place, value in np.ndenumerate(values)
    }


SPIN_UP_STEPS, SPIN_UP_TIME = 2000, 30.0
"""Steps per period and length [s] of the run whose final state levels of a mesh start from. Even
without contact the slowest mode (1.4 Hz, D = 0.008) decays to a tenth in this time."""
KEPT_STATES = 16
"""Number of final states of such runs that a worker keeps."""
MOST_PERIODS = 2000
"""Largest number of settling periods without contact, for laminae with almost no damping."""
RING_PERIODS = 8
"""Number of periods of the excitation over which free vibrations are recorded."""
RING_SHARE = 0.1
"""Largest amplitude of these vibrations over the displacement at which a motion has diverged."""
FREQUENCY_STEPS = 20
"""Largest number of iterations of the frequency fit, which converges quadratically."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class LevelResult:
    """The result of a level.

    Attributes:
        key: key of the level.
        outcome: "completed", "diverged" or "failed".
        error: reason why the level was not completed; empty if it was.
        statistics: mean and scatter by name; empty unless completed.
        microseconds_per_step: processor time of a step, the median over periods [µs].
        periods: number of computed periods.
    """

    key: str
    outcome: str
    error: str = ""
    statistics: Statistics = field(default_factory=dict)
    microseconds_per_step: float = math.nan
    periods: int = 0


def compute(level: Level, engine: EngineName) -> LevelResult:
    """Compute a level; an exception becomes the outcome "failed"."""
    try:
        with np.errstate(all="ignore"):  # the outcome reports a diverged motion
            computed = _free if level.method == FREE.name else _clapping
            return computed(level, engine)
    except Exception as error:
        _log.debug("level %s", level.key, exc_info=True)
        return LevelResult(level.key, "failed", f"{type(error).__name__}: {error}")


def level_hours(level: Level, engine: EngineName) -> float:
    """Return the estimated time of a level on one processor, without the run to its start [h]."""
    periods = (
        _settling_periods(level.case) + 1 + RING_PERIODS
        if level.method == FREE.name
        else level.case.n_periods
    )
    return step_hours(level.case, engine) * periods / level.case.n_periods


@dataclass
class _Run:
    """A finished run.

    Attributes:
        outcome: outcome of the run.
        rows: numbers of its last periods.
        recorder: recorder at the end.
        state: state at the end.
        cost: processor time of a step, the median over periods, with its recording [µs].
    """

    outcome: str
    rows: list[PeriodRow]
    recorder: Recorder
    state: State
    cost: float


def _clapping(level: Level, engine: EngineName) -> LevelResult:
    """Compute a level with contact and return the statistics of its motion."""
    case = level.case
    structure = assemble(case, needs_dolfinx=False)
    run = _run(case, structure, engine, _settled_start(case, engine), level.periods)
    periods = run.recorder.n_closed
    residual = run.recorder.energy_residual()
    if run.outcome != "completed":
        return LevelResult(
            level.key, run.outcome, f"{run.outcome} in period {periods}", {}, run.cost, periods
        )
    if is_lost(residual, case.time.integration):
        return LevelResult(level.key, "diverged", f"{OPEN} ({residual:.2g})", {}, run.cost, periods)
    strobe = run.recorder.strobe[-level.periods :, 0, : len(case.lamina)]
    numbers = statistics(run.rows, strobe.T) | {
        "energy_residual": (residual, 0.0),
        "blow_steps": (blow_steps(case, structure), 0.0),
    }
    if level.of:
        numbers |= _of_channels(run, structure, level, int(numbers["periodicity"][0]) or 1)
    return LevelResult(level.key, run.outcome, "", numbers, run.cost, periods)


def _settled_start(case: Case, engine: EngineName) -> State:
    """Return the state from which the levels of a mesh start.

    A bonded stack or a single lamina runs until its slowest mode has decayed to a tenth, as that of
    laminae apart does in `SPIN_UP_TIME`. Elastic stops keep the method of the level.
    """
    slowest = slowest_decay(case)
    is_usual = case.is_apart and len(case.lamina) > 1
    length = SPIN_UP_TIME if is_usual or not slowest else math.log(10.0) / slowest
    periods = math.ceil(length / case.period)
    method = {} if case.is_elastic else RIGID
    spin = case.with_overrides(
        {**method, "time.steps_per_period": SPIN_UP_STEPS, "time.periods": periods}
    )
    return _moving(spin.to_toml(), engine)


@lru_cache(maxsize=KEPT_STATES)
def _moving(case_text: str, engine: EngineName) -> State:
    """Run a case (as TOML) from rest, once per worker, and return its final state.

    Raises:
        ArithmeticError: the motion diverged.
    """
    case = Case.from_toml(case_text)
    run = _run(case, assemble(case, needs_dolfinx=False), engine, None, 0)
    _require_completed(run, "the run to the start of the levels")
    return run.state


def _require_completed(run: _Run, name: str) -> None:
    """Raise an ArithmeticError that names a run and its period unless the run was completed."""
    if run.outcome != "completed":
        raise ArithmeticError(f"{name} {run.outcome} in period {run.recorder.n_closed}")


def _free(level: Level, engine: EngineName) -> LevelResult:
    """Compute a level without contact and return its amplitudes and frequencies."""
    structure = assemble(level.case, needs_dolfinx=False)
    case = level.case.with_overrides({"time.periods": _settling_periods(level.case) + 1})
    run = _run(case, structure, engine, steady_motion(case, structure, is_closed=False), 1)
    periods = run.recorder.n_closed
    if run.outcome != "completed":
        return LevelResult(
            level.key, run.outcome, f"{run.outcome} in period {periods}", {}, run.cost, periods
        )
    columns = {
        "amplitude": np.abs(run.rows[-1]["harmonics"][:, 0]).tolist(),
        "frequency": _frequencies(level.case, engine),
    }
    numbers: Statistics = {
        f"{name}_{i + 1}": (value, 0.0)
        for name, values in columns.items()
        for i, value in enumerate(values)
    }
    return LevelResult(level.key, run.outcome, "", numbers, run.cost, periods)


def _settling_periods(case: Case) -> int:
    """Return after how many periods a motion without contact counts as settled."""
    return min(settling_periods(case) or MOST_PERIODS, MOST_PERIODS)


def _frequencies(case: Case, engine: EngineName) -> list[float]:
    """Run free undamped vibrations; return the frequency of each lamina's first mode [Hz].

    Raises:
        ArithmeticError: the motion diverged.
    """
    undamped = {f"lamina.{lamina.name}.damping_ratio": 0.0 for lamina in case.lamina}
    ring = case.with_overrides(
        {
            **undamped,
            "excitation.amplitude": 0.0,
            "time.periods": RING_PERIODS,
            "output.window_periods": RING_PERIODS,
        }
    )
    structure = assemble(ring, needs_dolfinx=False)
    o = structure.operators
    motion = np.zeros((3, o.n_dofs))
    # the limit of a case of points goes with its loads: a metre would be beyond it
    amplitude = min(1.0, RING_SHARE * span_of(ring).limit)
    static = np.zeros(o.n_dofs) if o.equilibrium is None else o.equilibrium.displacement
    motion[0] = static + amplitude * first_shapes(case, structure)
    run = _run(ring, structure, engine, State(motion, np.zeros(o.n_pairs, dtype=np.bool_)), 0)
    _require_completed(run, "free vibrations")
    u = np.concatenate([record.u[1:, N_BASE:] for record in run.recorder.window])
    u[:, : o.n_probes] -= o.probes @ static
    t = (1 + np.arange(len(u))) * ring.time_step
    exact = first_frequencies(case)
    return [fitted_frequency(t, u[:, i], omega) / (2.0 * math.pi) for i, omega in enumerate(exact)]


def fitted_frequency(t: FloatArray, u: FloatArray, omega: float) -> float:
    """Return the angular frequency ω of the best a cos ωt + b sin ωt, by Gauss–Newton [rad/s].

    Args:
        t: times, shape (n,) [s].
        u: values, shape (n,).
        omega: initial guess close to the result [rad/s].
    """
    for _ in range(FREQUENCY_STEPS):
        cos = np.cos(omega * t)
        sin = np.sin(omega * t)
        a, b = np.linalg.lstsq(np.column_stack([cos, sin]), u, rcond=None)[0]
        columns = np.column_stack([cos, sin, t * (b * cos - a * sin)])
        change = float(np.linalg.lstsq(columns, u - a * cos - b * sin, rcond=None)[0][2])
        omega += change
        if abs(change) < 1e-15 * omega:
            break
    return omega


def _run(
    case: Case, structure: Structure, engine: EngineName, initial: State | None, last: int
) -> _Run:
    """Run a case, time its periods, and reduce each of its `last` ones to numbers."""
    opening = openings(case, structure)
    rows = []
    seconds = []
    begin = 0.0
    with session_of(case, structure.operators, initial=initial, engine=engine) as opened:
        recorder = opened.recorder

        def motion(period: int) -> FloatArray:
            nonlocal begin
            states = opened.motion(period)
            begin = time.thread_time()
            return states

        def collect(done: int) -> bool:
            seconds.append(time.thread_time() - begin)
            if done > recorder.n_periods - last:
                rows.append(row_of(recorder, len(case.lamina), opening))
            return False

        outcome = replace(opened, motion=motion).run(collect, every=1)
        cost = 1e6 * float(np.median(seconds or [math.nan])) / case.steps_per_period
        return _Run(outcome, rows, recorder, opened.engine.state(), cost)

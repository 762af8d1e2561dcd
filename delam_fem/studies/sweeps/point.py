"""Compute a point of a sweep, and define the quantities that the sweep keeps of it.

Every variable of a sweep's dataset is defined here, once. Its dimensions are those beside the grid
of the sweep. The coordinates of the axes have the names that the file of the sweep gives them.

The largest Lyapunov exponent is estimated from two neighbouring motions. A second motion starts at
the distance d0 from the first one, in the energy norm

    |δ|² = δvᵀ M δv + δuᵀ K δu      (Y1)

After each period of the excitation the distance d is measured, and the second motion is moved back
to the distance d0 along the line between both. The exponent is the mean of ln(d/d0)/T. It includes
the jumps at impacts as the scheme computes them. A scheme that places impacts at the ends of steps
has no derivative there: two motions closer than the approach velocity times the time step mostly
hit in the same step. The result is then the exponent of the discrete map, so a third motion is
followed, too, at twice the distance or at that of a few steps, whichever is larger.

The error has two parts: that of the mean, and the difference between the exponents of both
distances. The page docs/evidence/calibration.md says how often two errors contain the true value.

Source: Benettin, Galgani, Giorgilli, Strelcyn, Meccanica 15 (1980) 9–20; for impacts Stefański,
Chaos, Solitons & Fractals 11 (2000) 2443–2451.

A worker builds no dataset, and keeps structures for points that share them. dolfinx and PETSc are
imported only if the sweep needs them, so that a worker starts fast.
"""

from __future__ import annotations

import logging
import math
import pickle
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache, partial
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr, stdtrit

from delam_fem.api import (
    CHANNEL_MEASURES,
    LEDGER,
    MEASURES,
    OPEN,
    SENSOR,
    Case,
    CaseError,
    Contact,
    Engine,
    FloatArray,
    History,
    Layout,
    Operators,
    Recorder,
    Session,
    State,
    Structure,
    Variable,
    assemble,
    blow_steps,
    decay_of,
    diagnostics,
    displacements_of,
    first_mode,
    frames_of,
    harmonics,
    histories_of,
    initial_state,
    initialise_petsc_alone,
    is_lost,
    nodal,
    offered,
    one_period,
    places_of,
    require,
    require_channels,
    scanned_places,
    session_of,
    set_initial,
    settling_summary,
    stop_when_settled,
)
from delam_fem.studies.linear import steady_motion
from delam_fem.studies.signals.scan import (
    ORDERS,
    Points,
    amplitudes as complex_amplitudes,
    positions_of,
    scan_field,
    scan_positions,
    shapes_of,
    surface_of,
)
from delam_fem.studies.sweeps.grid import Record, ScanRecord, Sweep, Value, is_initial

ENERGIES = tuple(name for name in LEDGER if name != "residual")
"""Columns of the ledger that a sweep keeps."""
_STORED = ("kinetic", "strain", "spring")
_LAST = "at the end of the last periods"

RECORDED: Mapping[str, tuple[Variable, ...]] = {
    "summary": (
        *(MEASURES[name] for name in ("tip_min", "tip_max", "tip_amplitude", "periodicity")),
        Variable(
            "settled", (), "1", "1 settled, 0 not settled, -1 irregular; NaN without a period"
        ),
        MEASURES["transient"],
        Variable("periods_computed", (), "1", "periods that the run of the point took"),
        MEASURES["strobe_scatter"],
        Variable("is_decided", (), "1", "whether the periodicity has a margin to the threshold"),
        *(
            MEASURES[name]
            for name in (
                "tip_contacts_per_period",
                "impacts_per_period",
                "distortion_factor",
                "thd",
                "minimum_tip_gap",
                "energy_residual",
                "blow_steps",
            )
        ),
    ),
    "strobes": (
        Variable("strobe_displacement", ("lamina", "strobe"), "m", f"displacement {_LAST}"),
        Variable("strobe_velocity", ("lamina", "strobe"), "m/s", f"velocity {_LAST}"),
    ),
    "harmonics": (
        Variable(
            "harmonic_amplitude",
            ("lamina", "harmonic"),
            "m",
            "amplitude of the harmonics of the displacement",
        ),
        Variable(
            "harmonic_phase",
            ("lamina", "harmonic"),
            "rad",
            "phase φ of the harmonics A sin(k ω t + φ), where the base moves as sin ω t",
        ),
    ),
    "node_distortion": (
        Variable(
            "node_distortion_factor", ("lamina", "node"), "1", "distortion factor d at the nodes"
        ),
        Variable("node_thd", ("lamina", "node"), "1", "total harmonic distortion at the nodes"),
    ),
    "energies": tuple(
        Variable(
            f"energy_{name}",
            (),
            "J",
            f"{name.replace('_', ' ')} energy "
            f"{'at the end of periods' if name in _STORED else 'per period'}, mean over the window",
        )
        for name in ENERGIES
    ),
    "scan": (
        Variable("scan_real", ("order", "scan_point"), "m/s", "velocity shape, real part"),
        Variable("scan_imag", ("order", "scan_point"), "m/s", "velocity shape, imaginary part"),
        Variable("scan_rms", (), "m/s", "root mean square of the velocity over times and points"),
        Variable(
            "scan_between", ("scan_point",), "m/s", "mean velocity amplitude between harmonics"
        ),
    ),
    "lyapunov": (
        Variable("lyapunov_exponent", (), "1/s", "largest Lyapunov exponent"),
        Variable(
            "lyapunov_error",
            (),
            "1/s",
            "its standard error, and what a larger distance of motions changes",
        ),
    ),
}
"""Variables of a sweep by the key of `Record` that asks for them, in the order of a row."""
VARIABLES: Mapping[str, Variable] = MappingProxyType(
    {
        row.name: row
        for row in (
            *(row for group in RECORDED.values() for row in group),
            Variable("outcome", (), "", "how the run of the point ended"),
            Variable("error", (), "", "why a point was not completed"),
            Variable("direction", ("direction",), "", "order of the points"),
            Variable("lamina", ("lamina",), "", "lamina"),
            Variable("strobe", ("strobe",), "1", "period, counted from the end"),
            Variable("harmonic", ("harmonic",), "1", "number of the harmonic"),
            Variable("x", ("node",), "m", "position along the laminae"),
            Variable("order", ("order",), "1", "multiple of the excitation's frequency"),
            Variable("scan_x", ("scan_point",), "m", "position of the points of a scan"),
            Variable("scan_z", ("scan_point",), "m", "their position across a plate"),
        )
    }
)
"""All variables of sweeps by name; words have no unit."""


OF_SENSOR: tuple[str, ...] = ("min", "max", "rms")
"""Measures that a sweep keeps of a sensor without being asked."""
SERIES = {
    "harmonics": ("harmonic", "amplitude of the harmonics of"),
    "harmonic_amplitude": ("harmonic", "amplitude of the harmonics of"),
    "harmonic_phase": ("harmonic", "phase φ of the harmonics A sin(k ω t + φ) of"),
    "strobe": ("strobe", "values at the end of the last periods of the window of"),
}
"""Numbers of a channel in a row, with their dimension and meaning; of sensors the first one."""


@dataclass(frozen=True)
class Quantity(Variable):
    """Numbers that a sweep keeps of each point: a variable of its dataset.

    Attributes:
        dims: dimensions beside those of the grid.
        shape: their sizes.
        scan: the points of the scan, if the sweep records one.
        channel: name of the channel, its measure or one of `SERIES`, and its unit; empty: none.
    """

    shape: tuple[int, ...]
    scan: ScanRecord | None = None
    channel: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of values per point."""
        return math.prod(self.shape)


def scanned(scan: ScanRecord, layout: Layout, case: Case | None) -> Points:
    """Return the points of a scan: of a plate those of [scan].

    Args:
        scan: section `record.scan` of the sweep file.
        layout: layout of the structure.
        case: the case of a plate; None: beams.
    """
    if case is not None and case.scan is not None:
        return scanned_places(case)
    assert scan.spacing is not None  # the sweep is checked
    return scan_positions(float(layout.x[-1]), scan.spacing, scan.first)


def channel_units(sweep: Sweep, layout: Layout) -> dict[str, str]:
    """Return the units of the channels that a sweep keeps, by their names.

    Args:
        sweep: the sweep.
        layout: layout of its first point.

    Raises:
        CaseError: the first point has no such channel.
    """
    names = sweep.file.record.channels
    if not names:
        return {}
    units = offered(layout, sweep.case(0))
    require_channels(names, units, "record.channels")
    are_different = len(set(names)) == len(names)
    require(are_different, "record.channels", f"different ones of {', '.join(units)}", names)
    return {name: units[name] for name in names}


def quantities(
    record: Record,
    layout: Layout,
    channels: Mapping[str, str] = MappingProxyType({}),
    case: Case | None = None,
) -> tuple[Quantity, ...]:
    """Return the numbers that a sweep keeps of each point, in the order of its row.

    Args:
        record: section `record` of the sweep file.
        layout: layout of the structure.
        channels: what `channel_units` returns.
        case: case of a plate, whose [scan] is recorded; None: beams.
    """
    n_scanned = 0
    if record.scan is not None:
        n_scanned = len(scanned(record.scan, layout, case))
    sizes = {
        "lamina": len(layout.parts),
        "strobe": record.strobes,
        "harmonic": record.harmonics,
        "node": layout.x.size,
        "order": len(ORDERS),
        "scan_point": n_scanned,
    }
    rows = [row for key, group in RECORDED.items() if getattr(record, key) for row in group]
    of_tables = [
        Quantity(
            row.name,
            row.dims,
            row.units,
            row.long_name,
            tuple(sizes[dim] for dim in row.dims),
            record.scan,
        )
        for row in rows
    ]
    of_sensors = OF_SENSOR
    of_channels = tuple(CHANNEL_MEASURES)
    if record.harmonics:
        of_sensors += ("harmonics",)
        of_channels += ("harmonic_amplitude", "harmonic_phase")
    if record.strobes:
        of_channels += ("strobe",)
    sensors = layout.sensors if record.summary else ()
    return (
        *of_tables,
        *(
            _channel_quantity(f"{SENSOR}{sensor.name}", sensor.unit, sensor.words, key, sizes)
            for sensor in sensors
            for key in of_sensors
        ),
        *(
            _channel_quantity(name, units, name, key, sizes)
            for name, units in channels.items()
            for key in of_channels
        ),
    )


def _channel_quantity(
    name: str, units: str, words: str, key: str, sizes: Mapping[str, int]
) -> Quantity:
    """Return a measure, or one of `SERIES`, of a channel as a quantity.

    Args:
        name: name of the channel.
        units: its unit.
        words: the channel in words.
        key: name of the measure or of one of `SERIES`.
        sizes: sizes of dimensions.
    """
    dims: tuple[str, ...] = ()
    if key in SERIES:
        dim, meaning = SERIES[key]
        dims = (dim,)
    else:
        meaning = CHANNEL_MEASURES[key].meaning
    unit = "rad" if key == "harmonic_phase" else units
    shape = tuple(sizes[dim] for dim in dims)
    return Quantity(
        f"{name}_{key}", dims, unit, f"{meaning} {words}", shape, None, (name, key, units)
    )


SETTLED = {"settled": 1.0, "not settled": 0.0, "irregular": -1.0}
"""Numbers of the verdicts in the dataset of a sweep."""


def row_of(
    wanted: tuple[Quantity, ...],
    case: Case,
    recorder: Recorder,
    structure: Structure,
    extra: Mapping[str, float],
    decay: float = 0.0,
) -> FloatArray:
    """Return the row of a point, the numbers that a sweep keeps of its run.

    Args:
        wanted: the quantities in the row.
        case: case of the point.
        recorder: recorder after the run.
        structure: structure that moved.
        extra: values that do not follow from the record, by name.
        decay: e-folds of the slowest mode of the structure in a period [-].

    Returns:
        One row, NaN for numbers without a meaning, shape (sum of sizes,).
    """
    names = {quantity.name for quantity in wanted}
    n_laminae = len(structure.layout.parts)
    values: dict[str, npt.ArrayLike | None] = dict(extra)
    if names & {"tip_min", "harmonic_amplitude"}:
        motion = probe_motion(recorder, structure)
    if "tip_min" in names:
        values |= diagnostics.summary_of(motion, case)
        settling = settling_summary(recorder, n_laminae, case, decay)
        if settling["settled"] is not None:
            values |= {name: value for name, value in settling.items() if name != "settling"}
            values["settled"] = SETTLED[settling["settled"]]
            values["transient"] = settling["settling"]["transient"]
        word = values.pop("periodicity_class")
        values["is_decided"] = math.nan if word is None else float(word != "undecided")
        values["blow_steps"] = blow_steps(case, structure)
    strobe = recorder.strobe[: recorder.n_closed, :, :n_laminae]
    values["strobe_displacement"], values["strobe_velocity"] = strobe.transpose(1, 2, 0)
    values["periods_computed"] = recorder.n_closed
    N = case.steps_per_period
    if "harmonic_amplitude" in names:
        periods = motion.whole_periods(N)
        values["harmonic_amplitude"] = harmonics.harmonic_amplitudes(periods, periods.shape[1] // N)
        values["harmonic_phase"] = harmonics.harmonic_phases(periods, periods.shape[1] // N)
    if "node_thd" in names:
        values |= _node_distortion(recorder, structure.layout)
    if any(quantity.channel for quantity in wanted):
        values |= _channel_values(wanted, recorder, structure, case)
    if "scan_real" in names and (scan := wanted[0].scan) is not None:
        values |= _scan(case, recorder, structure, scan)
    window = recorder.ledger[recorder.n_closed - len(recorder.window) : recorder.n_closed]
    means = dict(zip(LEDGER, window.mean(axis=0), strict=True))
    values |= {f"energy_{name}": means[name] for name in ENERGIES}
    return np.concatenate([_fitted(quantity, values.get(quantity.name)) for quantity in wanted])


def _channel_values(
    wanted: tuple[Quantity, ...], recorder: Recorder, structure: Structure, case: Case
) -> dict[str, npt.ArrayLike]:
    """Return the measures of channels; what this point has in another unit or not at all is NaN."""
    names = {quantity.channel[0] for quantity in wanted if quantity.channel}
    has_contacts = any(name.startswith("contact_") for name in names)
    histories = histories_of(recorder, structure, case, has_contacts=has_contacts)
    values: dict[str, npt.ArrayLike] = {}
    for quantity in wanted:
        name, key, units = quantity.channel or ("", "", "")
        history = histories.get(name)
        if history is None or history.units != units or not history.values.size:
            continue
        if key in CHANNEL_MEASURES:
            values[quantity.name] = CHANNEL_MEASURES[key].of(history.values)
        elif key == "strobe":
            last = np.arange(1 - len(recorder.window), 1)
            ends = (recorder.n_closed + last) * case.period
            values[quantity.name] = np.interp(ends, history.time, history.values)
        else:
            values[quantity.name] = _harmonics(history, case)[key == "harmonic_phase"]
    return values


def _harmonics(history: History, case: Case) -> tuple[FloatArray, FloatArray]:
    """Return amplitudes and phases of the harmonics of a channel over the window.

    Samples that do not fill whole periods are fitted by least squares.
    """
    value = history.values
    N = case.steps_per_period
    if value.size >= N and math.isclose(history.time[1] - history.time[0], case.time_step):
        periods = value[value.size % N :]
        n = periods.size // N
        return harmonics.harmonic_amplitudes(periods, n), harmonics.harmonic_phases(periods, n)
    n_orders = max(int(0.4 * value.size / max(case.n_window_periods, 1)), 1)  # below the stop band
    frequencies = (np.arange(1, n_orders + 1) / case.period).tolist()
    fitted = 1j * complex_amplitudes(value[:, None], history.time, frequencies)[:, 0]
    return np.abs(fitted), np.angle(fitted)


def probe_motion(recorder: Recorder, structure: Structure) -> diagnostics.ProbeMotion:
    """Return the motion of the reference probes that a recorder has kept.

    The first probes of the layout are the reference probes, one for each part.
    """
    layout = structure.layout
    gap0 = structure.operators.gap0
    n_laminae = len(layout.parts)
    pairs = layout.pairs_at_references()
    n_steps = sum(record.n_steps for record in recorder.window)
    is_hit = np.zeros((len(pairs), n_steps), dtype=np.bool_)
    impacts = recorder.impacts()
    steps = impacts.steps(recorder.refine)
    for row, pair in zip(is_hit, pairs, strict=True):
        row[steps[impacts.hit == pair]] = True
    return diagnostics.ProbeMotion(
        displacements_of(recorder, n_laminae),
        recorder.strobe[: recorder.n_closed, 0, :n_laminae].T,
        np.array([np.nan if pair is None else gap0[pair] for pair in pairs]),
        is_hit,
        impacts.hit.size,
    )


def _node_distortion(recorder: Recorder, layout: Layout) -> dict[str, npt.ArrayLike]:
    """Return d and THD at every node from the frames of the window."""
    frames = frames_of(recorder)
    u, _ = nodal(layout, np.array(frames.states)[:, 0], frames.base[:, 0])
    amplitudes = harmonics.harmonic_amplitudes(u.swapaxes(1, 2), len(recorder.window))
    return {
        "node_distortion_factor": harmonics.distortion_factor(amplitudes),
        "node_thd": harmonics.total_harmonic_distortion(amplitudes),
    }


def _scan(
    case: Case, recorder: Recorder, structure: Structure, scan: ScanRecord
) -> dict[str, npt.ArrayLike]:
    """Return the complex velocity shapes of the points of a scan; NaN for orders not sampled."""
    points = scanned(scan, structure.layout, case)
    times, _, v = scan_field(recorder, structure, surface_of(case, scan.lamina), points)
    x, z = positions_of(points)
    shapes = shapes_of(v, times, case.excitation.top_frequency, x, z=z)
    scan_values = np.full((len(ORDERS), x.size), np.nan, dtype=np.complex128)
    scan_values[[ORDERS.index(order) for order in shapes.orders]] = shapes.values
    rms = float(np.sqrt(np.mean(v**2)))
    return {
        "scan_real": scan_values.real, "scan_imag": scan_values.imag, "scan_rms": rms,
        "scan_between": shapes.noise,
    }  # fmt: skip


def _fitted(quantity: Quantity, value: npt.ArrayLike | None) -> FloatArray:
    """Return a value as part of a row: the last strobes, the first harmonics, NaN if missing."""
    row = np.full(quantity.shape, np.nan)
    if value is None:
        return row.ravel()
    array = np.asarray(value, dtype=np.float64)
    if quantity.dims[-1:] == ("strobe",):
        n = min(array.shape[-1], row.shape[-1])
        row[..., row.shape[-1] - n :] = array[..., array.shape[-1] - n :]
    elif quantity.dims[-1:] == ("harmonic",):
        n = min(array.shape[-1], row.shape[-1])
        row[..., :n] = array[..., :n]
    else:
        row[...] = array
    return row.ravel()


BLOCKS = 10
"""Number of blocks of successive periods whose means give the statistical error."""
STUDENT = float(stdtrit(BLOCKS - 1, ndtr(2.0))) / 2.0
"""Factor on an error from few blocks: two of it then contain as much as two known normal errors."""
WIDER = 2.0
"""Second distance of neighbouring motions, relative to the first."""
ROUGH = 1.5
"""Multiple of what the second distance changes: one difference tells its usual size roughly."""
FEW_STEPS = 9
"""Time steps in which the motion changes by the least second distance, were it harmonic."""
ALIGNING = 0.5
"""Share of the periods at the start that are not counted, because the second motion still turns
into the direction that decays most slowly. If two decay rates differ by 0.1/s, this takes some tens
of seconds."""


@dataclass(frozen=True)
class Exponent:
    """A Lyapunov exponent.

    Attributes:
        value: the exponent [1/s].
        error: standard error, of the mean and of what a larger distance changes [1/s]; two of it
            make a 95 % interval. NaN for fewer than `BLOCKS` periods.
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
    norm = _norm(one.motion, operators)
    wider = max(WIDER * perturbation, FEW_STEPS * 2.0 * np.pi / recorder.steps_per_period)
    step = np.zeros_like(one.motion)
    step[0] = direction
    length = _norm(step, operators)
    if not (perturbation * norm > 0.0 and length > 0.0):
        return UNKNOWN
    apart = [perturbation * norm, wider * norm]
    others = [State(one.motion + size / length * step, one.pair_state) for size in apart]
    growth = np.empty((periods, len(apart)))
    aligning = int(ALIGNING * periods)
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
            others[k] = State(one.motion + size / d * step, one.pair_state)
    near, far = (mean_growth(rates) for rates in growth[aligning:].T / period)
    return Exponent(near.value, math.hypot(STUDENT * near.error, ROUGH * (far.value - near.value)))


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

_OF_THE_POINT = ("lamina", "position", "surface")
"""Keys of the excitation that do affect the assembly: the point at which a force acts."""

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
        row: values in the order of `quantities`; None unless completed.
    """

    index: int
    outcome: str
    error: str
    row: FloatArray | None


@dataclass(frozen=True)
class ChunkResult:
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


@dataclass(frozen=True)
class Discretised:
    """Structure of a case, and what points with the same model share beside it.

    Attributes:
        structure: the discretised case.
        rate: rate at which its slowest mode dies out [1/s].
    """

    structure: Structure
    rate: float

    @cached_property
    def first_mode(self) -> Callable[[int], FloatArray]:
        """Function that returns the first mode of a part, by its number."""
        return cache(partial(first_mode, self.structure))


@dataclass
class PointRunner:
    """Runner of the points of one sweep, which keeps structures for them.

    Attributes:
        sweep: the sweep.
    """

    sweep: Sweep
    _known: dict[str, Discretised] = field(default_factory=dict)
    _last: tuple[dict[str, Value], Case, Discretised] | None = None
    _wanted: tuple[Layout, tuple[Quantity, ...]] | None = None

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

    @cached_property
    def first(self) -> Layout:
        """Layout of the first point, whose channels and units are those of the sweep."""
        return self.structure(self.sweep.case(0)).layout

    def structure(self, case: Case) -> Structure:
        """Return the discretised case, from memory if another case with the same model made it."""
        return self._discretised(case).structure

    def _quantities(self, layout: Layout) -> tuple[Quantity, ...]:
        """Return the numbers that the sweep keeps of a point; see `quantities`."""
        if self._wanted is None or self._wanted[0] is not layout:
            channels = channel_units(self.sweep, self.first)
            like_first = replace(layout, sensors=self.first.sensors)
            wanted = quantities(self.sweep.file.record, like_first, channels, self.sweep.base)
            self._wanted = layout, wanted
        return self._wanted[1]

    def _discretised(self, case: Case) -> Discretised:
        """Return the discretised case, and what points with the same model share beside it."""
        key = assembly_key(case)
        if key not in self._known:
            while len(self._known) >= KEPT_STRUCTURES:
                del self._known[next(iter(self._known))]
            # in closed form the matrices are the same to round-off, without dolfinx
            needs_dolfinx = self.sweep.file.operators != "closed-form"
            if needs_dolfinx or case.model.is_continuum:
                initialise_petsc_alone()
            structure = assemble(case, needs_dolfinx=needs_dolfinx)
            self._known[key] = Discretised(structure, decay_of(case, structure))
        return self._known[key]

    def _prepared(self, index: int) -> tuple[Case, Discretised]:
        """Return the case of a point and its model.

        Neighbours that differ in initial conditions alone share both.
        """
        values = self.sweep.overrides(index)
        case_values = {key: value for key, value in values.items() if not is_initial(key)}
        if self._last is None or self._last[0] != case_values:
            record = self.sweep.file.record
            case = self.sweep.case(index)
            if not (record.node_distortion or record.scan):
                output = case.output.model_copy(update={"fields_per_period": 0})
                case = case.model_copy(update={"output": output})
            known = self._last[2] if self._last and self._shares_model else self._discretised(case)
            self._last = case_values, case, known
        return self._last[1:]

    @cached_property
    def _shares_model(self) -> bool:
        """Whether no axis changes what is assembled, so that all points have one model."""
        base = self.sweep.base
        has_own = base.stop or base.impactor or base.has_stiffnesses
        if base.model.is_continuum or has_own or base.is_loaded:
            return False
        return not any(map(_may_assemble, self.sweep.overrides(0)))

    def _computed(self, index: int, carried: State | None) -> tuple[Point, State | None]:
        record = self.sweep.file.record
        case, known = self._prepared(index)
        structure, rate = known.structure, known.rate
        operators = structure.operators
        layout = structure.layout
        decay = rate * case.period
        if carried is None and self.sweep.file.start == "steady":
            carried = steady_motion(case, structure)
        elif carried is None:
            carried = initial_state(structure, self.sweep.initial(index), known.first_mode)
        engine = self.sweep.file.engine
        with session_of(case, operators, initial=carried, engine=engine) as opened:
            recorder = opened.recorder
            outcome = opened.run(enough=stop_when_settled(case, recorder, len(layout.parts), decay))
            if outcome != "completed":
                last = recorder.window[-1].n_steps
                step = (recorder.n_closed - 1) * recorder.steps_per_period + last
                where = f"t = {step * case.time_step:.6g} s (period {recorder.n_closed})"
                return Point(index, outcome, f"diverged at {where}", None), None
            extra = {"energy_residual": recorder.energy_residual()}
            if is_lost(extra["energy_residual"], case.time.integration):
                return Point(index, "diverged", OPEN, None), None
            state = opened.engine.state()
            if record.lyapunov:
                exponent = largest_exponent(
                    opened,
                    operators,
                    direction=np.sum(
                        [known.first_mode(i) for i in range(len(layout.parts))], axis=0
                    ),
                    period=case.period,
                    periods=record.lyapunov,
                    perturbation=record.perturbation,
                )
                extra |= {"lyapunov_exponent": exponent.value, "lyapunov_error": exponent.error}
        row = row_of(self._quantities(layout), case, recorder, structure, extra, decay)
        return Point(index, outcome, "", row), state


def _may_assemble(key: str) -> bool:
    """Return whether a key of an axis may affect the assembly of beams without stops."""
    section, _, name = key.partition(".")
    free = NOT_ASSEMBLED.get(section, is_initial(key))
    is_free = name in free if isinstance(free, set) else free
    return not is_free or name.endswith((*_OF_THE_POINT, "kind", "acts_on"))


def assembly_key(case: Case) -> str:
    """Return a text that is the same for two cases only if they have the same model.

    It contains the whole case except `NOT_ASSEMBLED`, so a new section or key is included by
    itself.
    """
    drive = [
        (one.acts_on, *(getattr(one, k, None) for k in _OF_THE_POINT))
        for one, *_ in places_of(case.excitation)
    ]
    dofs = case.contact.impulse if case.model.is_continuum else ""  # see model/solids/unknowns.py
    has_weights = case.stop or case.impactor or case.has_stiffnesses or case.is_loaded
    weights = case.spring if has_weights else ""  # of pairs, see model/contacts.py
    at_rest = (case.contact.law, case.time.scheme) if case.is_loaded else ""  # see model/loads.py
    return f"{case.model_dump_json(exclude=NOT_ASSEMBLED)} {drive} {dofs} {weights} {at_rest}"


def compute(packed: bytes, chunk: Chunk) -> ChunkResult:
    """Compute a chunk of points in a worker.

    Args:
        packed: the pickled sweep; each worker unpickles it once.
        chunk: the chunk.
    """
    begin = time.perf_counter()
    idle = begin - getattr(_thread, "end", begin)
    runner = _runner(packed)
    state = chunk.state
    points = []
    for index in chunk.indices:
        carried = state if chunk.track >= 0 else None
        point, after = runner.point(index, carried)
        points.append(point)
        if chunk.track >= 0 and after is not None:
            state = after  # after a point that failed, the last good state is used again
    _thread.end = time.perf_counter()
    return ChunkResult(chunk, tuple(points), state, _thread.end - begin, idle)


@lru_cache(maxsize=_KEPT_SWEEPS)
def _runner(packed: bytes) -> PointRunner:
    return PointRunner(pickle.loads(packed))

"""Judge a run: whether its motion has settled, how sure its numbers are, what may be wrong.

The motion that a recorder has kept is settled, not settled or irregular. `numerics/settling.py` has
the model and the thresholds; here are the strobes that it is given.

The numbers of an irregular motion are means over windows, with intervals. A motion without a period
has no extremes and no spectrum of its own: longer runs give larger extremes. Its means per period
are numbers that longer runs repeat within the interval.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.contact.laws import Scheme
from delam_fem.model.contacts import pairs_of_contacts
from delam_fem.model.discretise import assemble
from delam_fem.model.layout import Structure
from delam_fem.model.linear import slowest_decay
from delam_fem.model.mesh import NODE_TOLERANCE
from delam_fem.model.operators import DistributedOperators, Operators
from delam_fem.numerics.harmonics import (
    distortion_factor,
    harmonic_amplitudes,
    total_harmonic_distortion,
)
from delam_fem.numerics.settling import Settling, judge
from delam_fem.numerics.statistics import BLOCKS, block_means, interval
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.results import diagnostics
from delam_fem.results.schema import SENSOR
from delam_fem.simulation.recorder import EXCHANGED, LEDGER, Recorder
from delam_fem.simulation.signals import law_numbers
from delam_fem.system.mpi import slepc

if TYPE_CHECKING:
    import xarray as xr

EVERY = 20
"""Periods between two judgements of a run that goes on until it has settled."""
AGREEING = 2
"""Successive judgements that must agree before such a run ends."""
FEWEST_IRREGULAR = 100
"""Fewest judged periods before a run of irregular motion ends: ten for each of ten windows."""
LEAST_RANGE = 1e-6
"""Range of a probe relative to the largest one below which the probe counts as being at rest."""


def verdict_of(
    recorder: Recorder, n_parts: int, decay: float, n_periods: int | None = None
) -> Settling:
    """Return the verdict on a run of a periodic excitation.

    Args:
        recorder: recorder of the run, after at least one period.
        n_parts: number of parts; the first probes are the reference probes, one for each.
        decay: e-folds of the slowest mode of the structure in a period of the excitation [-].
        n_periods: number of first periods that are judged; None: all that are finished.
    """
    n = finished(recorder) if n_periods is None else n_periods
    return _judged(_strobes(recorder, n_parts, n), recorder, decay)[0]


def _judged(strobes: FloatArray, recorder: Recorder, decay: float) -> tuple[Settling, FloatArray]:
    """Return the verdict on strobes of the first periods, and their scatters."""
    _, n_parts, n = strobes.shape
    # a settled motion repeats with a margin, by all judged strobes; the last ones alone may not
    scatters = diagnostics.scatters(strobes[0], np.ones(n_parts))
    P = diagnostics.first_repeat(scatters)[0]
    is_linear = not touches(recorder)[n // 2 : n].any()
    return judge(strobes, P, decay, is_linear=is_linear), scatters


def _strobes(recorder: Recorder, n_parts: int, n: int) -> FloatArray:
    """Return the strobes of the first n periods over half the peak-to-peak amplitudes.

    Returns:
        Displacements and velocities of the reference probes, 0 of a probe at rest, shape (2,
        n_parts, n) [-].
    """
    strobes = recorder.strobe[:n, :, :n_parts].transpose(1, 2, 0)
    last = slice(max(0, n - len(recorder.window)), n)
    low, high = recorder.envelope[last, 0, :n_parts], recorder.envelope[last, 1, :n_parts]
    rows = [record.v[: record.n_steps + 1, :n_parts] for record in recorder.window]
    speeds = np.ascontiguousarray(np.concatenate(rows).T)  # extremes along rows are fast
    with np.errstate(all="ignore"):  # a motion that diverged is not settled
        moved = high.max(axis=0) - low.min(axis=0) if n else np.zeros(n_parts)
        half_ranges = np.array([moved, np.ptp(speeds, axis=1)]) / 2.0
        least = LEAST_RANGE * half_ranges.max(axis=1, keepdims=True)
        scales = np.where(half_ranges <= least, np.inf, half_ranges)  # NaN stays NaN: not settled
        return np.asarray(strobes / scales[..., None])


def finds_modes(operators: Operators | DistributedOperators) -> bool:
    """Return whether modes can be found: several ranks need SLEPc."""
    return isinstance(operators, Operators) or slepc() is not None


def decay_of(case: Case, structure: Structure) -> float:
    """Return the rate at which the slowest mode of a structure dies out [1/s].

    Solids have the damping of the beams of the same case, and frequencies close to theirs; the
    modes of the beams are found in no time and on any number of ranks. Of a plate they are its own,
    which several ranks find together (collective); without SLEPc they do not, and the rate is 0.
    """
    if case.is_plate and not finds_modes(structure.operators):
        return 0.0
    if case.model.is_continuum and not case.is_plate:
        structure = assemble(case.as_beams, needs_dolfinx=False)
    return slowest_decay(structure.operators, is_floating=case.is_floating)


def decay_of_operators(operators: Operators | DistributedOperators) -> float:
    """Return the rate at which the slowest mode dies out [1/s]; 0 if it cannot be found."""
    if not finds_modes(operators):
        return 0.0
    try:
        decay = slowest_decay(operators)
    except (np.linalg.LinAlgError, RuntimeError):  # nothing holds them, or no mass
        return 0.0
    return decay if np.isfinite(decay) else 0.0


def stop_when_settled(
    case: Case, recorder: Recorder, n_parts: int, decay: float
) -> Callable[[int], bool] | None:
    """Return a function that takes the number of finished periods: whether the run may end.

    Only with time.periods = "settled" may a run end early, once its motion is settled; with others
    there is nothing to ask, and None is returned. The function judges every `EVERY` periods from
    the strobes alone, so that a resumed run ends after the same period as one that was not
    interrupted.

    Args:
        case: the case.
        recorder: recorder of the run.
        n_parts: number of parts.
        decay: e-folds of the slowest mode of the structure in a period [-].
    """

    def is_steady(period: int) -> bool:
        if period % EVERY or period < AGREEING * EVERY:
            return False
        verdicts = [
            verdict_of(recorder, n_parts, decay, period - back * EVERY) for back in range(AGREEING)
        ]
        if verdicts[0].word == "irregular" and verdicts[0].periods_judged < FEWEST_IRREGULAR:
            return False
        return all(verdict.word == verdicts[0].word != "not settled" for verdict in verdicts)

    return is_steady if case.time.periods == "settled" else None


def finished(recorder: Recorder) -> int:
    """Return the number of periods that have been computed to their end."""
    return recorder.n_closed - int(recorder.window[-1].n_steps < recorder.steps_per_period)


def touches(recorder: Recorder) -> BoolArray:
    """Return in which periods anything touched, shape (n_closed,).

    A contact leaves impulses, a spring that is closed at the end of the period, or energy that a
    spring brought along when it was switched.
    """
    rows = recorder.ledger[: recorder.n_closed]
    columns = [LEDGER.index(name) for name in ("spring", "spring_released", "contact_damping_loss")]
    return np.asarray((recorder.impulse[: recorder.n_closed, 1] > 0.0) | rows[:, columns].any(1))


def settling_summary(recorder: Recorder, n_parts: int, case: Case, decay: float) -> dict[str, Any]:
    """Return the entries of a summary that say whether a run has settled, and what follows.

    Args:
        recorder: recorder of the run.
        n_parts: number of parts.
        case: case of the run.
        decay: e-folds of the slowest mode of the structure in a period [-].

    Returns:
        `settled`, None without a periodic excitation; `settling` with the numbers of `Settling`;
        `periodicity`, None unless settled, and what goes with it.
    """
    if not case.is_periodic:
        return {"settled": None, "settling": None}
    strobes = _strobes(recorder, n_parts, finished(recorder))
    verdict, scatters = _judged(strobes, recorder, decay)
    values = asdict(verdict)
    del values["word"], values["periodicity"]
    entries: dict[str, Any] = {
        "settled": verdict.word, "periodicity": verdict.periodicity, "settling": values,
    }  # fmt: skip
    if verdict.periodicity is None:
        word = verdict.word if verdict.word == "not settled" else "not periodic"
        return entries | {"strobe_scatter": None, "periodicity_class": word}
    return entries | {
        "strobe_scatter": float(scatters[verdict.periodicity - 1]),
        "periodicity_class": diagnostics.class_name(verdict.periodicity, is_decided=True),
    }


def limit_warning(case: Case, summary: Mapping[str, Any]) -> str | None:
    """Return a warning if a run that was to go on until it settles ended unsettled; else None."""
    if case.time.periods != "settled" or summary["settled"] != "not settled":
        return None
    needed = summary["settling"]["periods_needed"]
    further = "" if needed is None else f"; it may need {needed} further periods"
    return (
        f"not settled after {case.time.most_periods} periods, the limit time.most_periods{further}"
    )


NAMES = (
    "tip_min", "tip_max", "impacts_per_period", "tip_contacts_per_period", "distortion_factor",
    "thd",
)  # fmt: skip
"""Entries of the summary that fluctuate from period to period."""


def confidence_intervals(
    history: xr.Dataset, case: Case, summary: Mapping[str, Any]
) -> dict[str, dict[str, Any]] | None:
    """Return mean and 95 % interval of the numbers of an irregular motion.

    Extremes and impacts are known of every period: they are averaged over the periods that the
    verdict judged. Contacts at the probes and harmonics are known of the periods of the window.

    Args:
        history: dataset of the run.
        case: case of the run.
        summary: summary of the run, with the verdict.

    Returns:
        By name `mean` and `half_width` of each lamina or of the motion, and the number of
        `windows` and of `periods` in all of them; None unless the motion is irregular.
    """
    if summary["settled"] != "irregular":
        return None
    judged = slice(-summary["settling"]["periods_judged"], None)
    rows = {
        "tip_min": history["envelope_min"].to_numpy()[:, judged],
        "tip_max": history["envelope_max"].to_numpy()[:, judged],
        "impacts_per_period": history["impact_count"].to_numpy()[judged],
    }
    intervals = {
        name: _entry(block_means(values), values.shape[-1]) for name, values in rows.items()
    }
    intervals |= _of_window(history, case)
    return {name: intervals[name] for name in NAMES if name in intervals}


def _entry(means: FloatArray, periods: int) -> dict[str, Any]:
    """Return the entry of a number: its mean and interval from the means of blocks of periods."""
    middle, half_width = interval(means)
    windows = means.shape[-1]
    entry = {"mean": middle.tolist(), "half_width": half_width.tolist()}
    return entry | {"windows": windows, "periods": periods // windows * windows}


def _of_window(history: xr.Dataset, case: Case) -> dict[str, dict[str, Any]]:
    """Return means and intervals of the numbers that need every step of their periods."""
    N = case.steps_per_period
    motion = diagnostics.ProbeMotion.of(history)
    periods = motion.whole_periods(N)
    n = periods.shape[1] // N
    if n < 2:
        return {}
    blocks = min(n, BLOCKS)
    each = n // blocks
    cut = periods[:, (n - blocks * each) * N :].reshape(len(periods), blocks, each * N)
    amplitudes = harmonic_amplitudes(cut, each)
    intervals = {
        "distortion_factor": _entry(distortion_factor(amplitudes), n),
        "thd": _entry(total_harmonic_distortion(amplitudes), n),
    }
    if case.contact.law != "none":
        counts = contacts_by_period(motion, N)
        intervals["tip_contacts_per_period"] = _entry(block_means(counts), counts.size)
    return intervals


def contacts_by_period(motion: diagnostics.ProbeMotion, steps_per_period: int) -> FloatArray:
    """Return the number of contacts at the probes that begin in each period of the window.

    Args:
        motion: motion of the probes.
        steps_per_period: N.

    Returns:
        Shape (number of whole periods,).
    """
    closed = np.flatnonzero(motion.is_closed.any(axis=0))
    apart = diagnostics.GROUP_PERIODS * steps_per_period
    begins = closed[np.diff(closed, prepend=-np.inf) >= apart]
    n = motion.displacement.shape[1]
    first = n % steps_per_period
    periods = (begins[begins >= first] - first) // steps_per_period
    return np.bincount(periods, minlength=n // steps_per_period).astype(np.float64)


CLOSED = 1e-6
"""Largest residual of the energy ledger, relative to the energy exchanged, of a good run."""
ALTERNATING = 0.05
"""Share of the steps at which a signal may alternate before a warning says so."""
LOST = 1e-2
"""Residual at which the motion is not that of the equations any more."""
OPEN = "diverged: the energy balance does not close, so that this is not the motion of the case"
BLOW_STEPS = 10
"""Fewest steps n in a blow on a contact spring; the rebound has its energy within (π/n)², 10 %."""
RELEASED = 0.02
"""Share of the energy that switching springs may change before a warning says so."""
GRADED = 1e4
"""Largest ratio of element lengths; stiffnesses differ by its cube, of the 16 digits there are."""


def quality_warnings(case: Case, structure: Structure, residual: float) -> list[str]:
    """Return warnings of what may be wrong with the numbers of a run, with reasons; [] if none.

    Args:
        case: the case.
        structure: its discretisation.
        residual: residual of the energy ledger, relative to the energy exchanged [-].
    """
    reasons = [*unresolved_blows(case, structure), *_graded_mesh(structure)]
    if residual <= CLOSED:
        return reasons
    if not np.isfinite(residual):
        return [*reasons, open_balance(residual)]
    scheme = case.time.integration
    if scheme.changes_energy:
        numbers = ", ".join(f"time.{key} = {value:g}" for key, value in scheme.numbers.items())
        return [
            *reasons,
            f"the steps with {numbers} change the energy by themselves: the residual of the "
            f"ledger has it, up to {residual:.2g} of what is exchanged in a period; smaller steps "
            "change less",
        ]
    return [f"{open_balance(residual)}: {'; '.join(reasons or [_known(case, structure)])}"]


def alternating_warning(case: Case, history: xr.Dataset) -> str | None:
    """Return a warning if sensors alternate from step to step, which no motion does; else None."""
    shares = {
        sensor.name: float(history[f"{SENSOR}{sensor.name}"].attrs["alternating"])
        for sensor in case.sensor
    }
    rough = {name: share for name, share in shares.items() if share > ALTERNATING}
    if not rough:
        return None
    names = ", ".join(f"{name} in {100.0 * share:.0f} %" for name, share in rough.items())
    per_period = case.steps_per_period
    steps = f"time.steps_per_period = {per_period}"
    remedy = f"{4 * per_period}"
    if case.time.step is not None:
        steps = f"time.step = {case.time.step:g} s"
        remedy = f"{case.time.step / 4.0:.3g} s"
    if case.time.refine == 1:
        remedy += ", or time.refine, which divides the steps near contact"
    return (
        f"sensors alternate from step to step ({names} of the steps): {steps} does not resolve "
        f"what is excited there; try {remedy}"
    )


def range_warning(case: Case, history: xr.Dataset) -> str | None:
    """Return a warning if signals of sensors reach the ends of their ranges, else None."""
    shares = {}
    for sensor in case.sensor:
        if sensor.range is not None:
            step = 0.0 if sensor.bits is None else 2.0 * sensor.range / 2**sensor.bits
            size = np.abs(history[f"{SENSOR}{sensor.name}"].to_numpy())
            share = float(np.mean(size >= (sensor.range - step) * (1.0 - 1e-12)))
            unit = "" if sensor.unit == "1" else f" {sensor.unit}"
            shares[f"{sensor.name}: {sensor.range:g}{unit}"] = share
    over = {name: share for name, share in shares.items() if share > 0.0}
    if not over:
        return None
    names = ", ".join(f"{name} in {100.0 * share:.2g} %" for name, share in over.items())
    return (
        f"sensors reach the ends of their ranges ({names} of the samples), what is beyond is cut "
        "off; take a larger sensor.NAME.range, or a smaller drive"
    )


def open_balance(residual: float) -> str:
    """Return the sentence that the energy ledger does not close."""
    if not np.isfinite(residual):
        return "the energies of a period are not finite: this is no motion of the case"
    return (
        f"the energy balance of a period is open by {residual:.2g} of what is exchanged "
        f"(good: below {CLOSED:g})"
    )


def is_lost(residual: float, scheme: Scheme | None = None) -> bool:
    """Return whether a residual is so large that the run counts as diverged; NaN is.

    What the steps of a scheme change by themselves is in the residual, and is asked for.
    """
    changes_energy = scheme is not None and scheme.changes_energy
    return not (np.isfinite(residual) if changes_energy else residual < LOST)


def _known(case: Case, structure: Structure) -> str:
    """Return what is known of a balance that no warning explains: the scheme's share, the sizes."""
    scheme = case.time.scheme
    dt = case.time_step
    if np.isfinite(case.time.integration.courant):
        return (
            f"{scheme} balances energy only for small steps, given {dt:.3g} s; try more steps per "
            "period"
        )
    o = structure.operators
    return (
        f"the steps of {scheme} balance to round-off, so that these do not say why; known are "
        f"steps of {dt:.3g} s, time.refine = {case.time.refine}, {o.n_dofs} dofs and {o.n_pairs} "
        "contact pairs. Compare with the other --engine, time.refine = 1 and fewer elements, to "
        "see what opens it"
    )


class Blow(NamedTuple):
    """The shortest blow on contact springs of one kind.

    Attributes:
        key: the key that gives their stiffness, with its value.
        duration: half a period of the spring and what meets it [s].
        step: the smallest time step of the case [s].
    """

    key: str
    duration: float
    step: float

    @property
    def n_steps(self) -> float:
        """Number of steps in the blow."""
        return self.duration / self.step


def spring_blows(case: Case, structure: Structure) -> list[Blow]:
    """Return the shortest blow on each kind of contact springs; [] without springs.

    A mass m that meets a spring k leaves it after π √(m/k). m is what the pair meets at its place
    (`Operators.pair_mass`): a node, an impactor, a point. Springs at one place add up, as those of
    Hertz's contact do.
    """
    o = structure.operators
    if not o.n_pairs:
        return []
    has_springs = law_numbers(case, o).has_springs(o.n_pairs)
    if not has_springs.any():
        return []
    weights = np.ones(o.n_pairs) if o.pair_weights is None else o.pair_weights
    stiffness = case.spring[0] * np.where(has_springs, weights, 0.0)
    for stop in structure.layout.stops:
        places = np.unique(stop.places, return_inverse=True)[1]
        stiffness[stop.pairs] = np.bincount(places, stiffness[stop.pairs])[places]
    with np.errstate(divide="ignore", invalid="ignore"):  # a mass-less or a rigid side, no spring
        durations = np.where(stiffness > 0.0, np.pi * np.sqrt(o.pair_mass / stiffness), np.inf)
    step = case.time_step / case.time.refine
    blows = (
        Blow(key, float(durations[pairs].min(initial=np.inf)), step)
        for key, pairs in _spring_keys(case, structure).items()
    )
    return [blow for blow in blows if blow.duration < np.inf]


def blow_steps(case: Case, structure: Structure) -> float:
    """Return the fewest steps in a blow on a contact spring; NaN without springs."""
    return min((blow.n_steps for blow in spring_blows(case, structure)), default=np.nan)


def unresolved_blows(case: Case, structure: Structure) -> list[str]:
    """Return a text for each kind of contact springs whose blows have too few steps; [] if none.

    With n steps in a blow the spring begins up to v Δt too deep, where it has (π/n)² of the energy
    m v²/2 already.
    """
    texts = []
    for blow in spring_blows(case, structure):
        if blow.n_steps >= BLOW_STEPS:
            continue
        error = (np.pi / blow.n_steps) ** 2
        energy = f"may be wrong by {error:.0%}" if error < 1.0 else "is arbitrary"
        texts.append(
            f"{blow.key}: a blow on this spring lasts {blow.duration:.2g} s at the shortest, "
            f"{blow.n_steps:.2g} steps of {blow.step:.3g} s, so that its energy {energy}; "
            f"try steps of {blow.duration / BLOW_STEPS:.2g} s, {BLOW_STEPS / blow.n_steps:.3g} "
            "times as many, or a softer spring"
        )
    return texts


def _spring_keys(case: Case, structure: Structure) -> dict[str, IntArray]:
    """Return the pairs with springs by the key that gives their stiffness, with its value."""
    of_laminae = f"contact.penalty_stiffness = {case.contact.penalty_stiffness:g} N/m"
    numbers = {of_laminae: 0}
    number_of = np.zeros(structure.operators.n_pairs, dtype=np.int64)
    for key, table, pairs in pairs_of_contacts(structure.layout, case):
        radius = getattr(table, "radius", None)
        if radius is None and table.stiffness is None:
            continue
        said = (
            f"stiffness = {table.stiffness:g} N/m" if radius is None else f"radius = {radius:g} m"
        )
        number_of[pairs] = numbers.setdefault(f"{key}.{said}", len(numbers))
    texts = list(numbers)
    return {texts[k]: np.flatnonzero(number_of == k) for k in dict.fromkeys(number_of.tolist())}


def released_warning(recorder: Recorder) -> str | None:
    """Return a warning if springs that close and open between steps change the energy; else None.

    They begin and end within a step, which takes or adds energy. Its share is of all energy that is
    exchanged, or of the largest that is stored.
    """
    rows = np.abs(recorder.ledger[: recorder.n_closed])
    column = LEDGER.index("spring_released")
    released = float(rows[:, column].sum())
    exchanged = float(rows[:, EXCHANGED].sum()) - released
    stored = float(rows[:, : EXCHANGED.start].sum(axis=1).max(initial=0.0))
    size = max(exchanged, stored)
    if not released > RELEASED * size:  # NaN is told elsewhere
        return None
    return (
        f"contact springs that close and open within steps changed the energy by {released:.3g} J, "
        f"{100.0 * released / size:.2g} % of what is exchanged or stored; try more steps per "
        "period, time.refine or softer springs"
    )


def _graded_mesh(structure: Structure) -> list[str]:
    """Return a text if element lengths differ so much that digits are lost."""
    lengths = _lengths(structure)
    ratio = float(lengths.max() / lengths.min())
    if ratio <= GRADED:
        return []
    return [
        f"the lengths of the elements differ by a factor of {ratio:.2g}, their stiffnesses by its "
        f"cube, and digits are lost; try a factor below {GRADED:g}"
    ]


def _lengths(structure: Structure) -> FloatArray:
    """Return the distances of neighbouring points along x [m]; equal points count once."""
    x = np.unique(structure.layout.x)
    distances = np.diff(x)
    return np.asarray(distances[distances > NODE_TOLERANCE * x[-1]])

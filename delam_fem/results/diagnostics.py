"""Pure functions of a recorded motion: gaps, strikes, periodicity, energy, the summary.

Warnings say how much energy impacts have added to a run, and what helps. An impulse that acts
through another mass matrix than that of the time integration may do work on the motion instead of
taking from it; see docs/evidence/convergence.md.

Each lamina has one reference probe, at the node `tip_node` of the dataset. Functions that need
whole periods of the excitation use the last whole periods of the window, so that an interrupted run
has its diagnostics too. Nothing here draws or writes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from delam_fem.case.definition import Case
from delam_fem.case.sections import EDGE_TOLERANCE
from delam_fem.contact.laws import combination
from delam_fem.numerics.harmonics import (
    distortion_factor,
    harmonic_amplitudes,
    total_harmonic_distortion,
)
from delam_fem.numerics.settling import LONGEST, MARGIN, REPEATS
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.results.schema import CHANNEL_MEASURES, by_interface, event_interfaces
from delam_fem.simulation.recorder import EXCHANGED, LEDGER, Recorder

if TYPE_CHECKING:
    import xarray as xr


def between(gap_at_rest: FloatArray, u: FloatArray) -> FloatArray:
    """Return the gaps g0 + u of the upper lamina - u of the lower one.

    Args:
        gap_at_rest: shape (n_interfaces, …) [m]; its further axes fit those of `u`.
        u: displacements of the laminae from bottom to top, shape (n_interfaces + 1, …) [m].

    Returns:
        Gaps, NaN where a diverged motion is infinite, shape (n_interfaces, …) [m].
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(gap_at_rest + u[1:] - u[:-1])


def rest_positions(history: xr.Dataset) -> FloatArray:
    """Return the positions of the laminae at rest: the sum of the gaps below each of them.

    Returns:
        0 for the lowest lamina, shape (n_laminae, n_nodes) [m].
    """
    gap0 = by_interface(history["gap0"])
    return np.vstack([np.zeros(gap0.shape[1]), np.cumsum(gap0, axis=0)])


def gap_field(history: xr.Dataset) -> FloatArray:
    """Return the gaps of all frames and nodes, shape (n_interfaces, n_frames, n_nodes) [m].

    Beyond the end of the shorter of two laminae there is none, NaN.
    """
    gaps = between(by_interface(history["gap0"])[:, None], history["displacement"].to_numpy())
    if "end" in history:
        gaps[~is_opposite(history)[:, None].repeat(gaps.shape[1], axis=1)] = np.nan
    return gaps


def is_opposite(history: xr.Dataset) -> BoolArray:
    """Return which nodes both laminae of each interface have, shape (n_interfaces, n_nodes)."""
    x = history["x"].to_numpy()
    if "end" not in history:
        return np.ones((history.sizes["lamina"] - 1, x.size), np.bool_)
    ends = history["end"].to_numpy()
    shorter = np.minimum(ends[1:], ends[:-1])
    return np.asarray(x <= shorter[:, None] * (1.0 + EDGE_TOLERANCE))


def heat(history: xr.Dataset) -> tuple[FloatArray, FloatArray]:
    """Return the mean power that contact takes over the window, at each node [W].

    Returns:
        Power at the nodes of each interface, shape (n_interfaces, n_nodes), and at those of each
        lamina by its stops, shape (n_laminae, n_nodes). It is 0 in results of earlier versions.
    """
    of_stops = np.zeros((history.sizes["lamina"], history.sizes["node"]))
    if "stop_heat" in history:
        place = history["stop_lamina"].to_numpy(), history["stop_node"].to_numpy()
        np.add.at(of_stops, place, history["stop_heat"].to_numpy())
    known = history["heat"] if "heat" in history else 0.0 * history["gap0"]
    return by_interface(known), of_stops


def contact_line(history: xr.Dataset) -> FloatArray:
    """Return the largest x at which the laminae touch in each frame.

    Returns:
        Positions, NaN where there is no contact, shape (n_interfaces, n_frames) [m].
    """
    x = history["x"].to_numpy()
    touching = np.where(by_interface(history["contact_state"]) > 0, x, -np.inf)
    farthest = touching.max(axis=-1, initial=-np.inf)
    return np.where(np.isfinite(farthest), farthest, np.nan)


def of_laminae(
    values: npt.NDArray[Any], join: np.ufunc = np.maximum, beyond: float = 0
) -> npt.NDArray[Any]:
    """Return values of the laminae, each joined from the values of the lamina's interfaces.

    Args:
        values: values of the interfaces, such as contact states, shape (n_interfaces, …).
        join: how the values of the two interfaces of a lamina are joined: the larger one, the sum…
        beyond: value below the first lamina and above the last one.

    Returns:
        Values of the laminae from bottom to top, shape (n_interfaces + 1, …).
    """
    end = np.full((1, *values.shape[1:]), beyond, values.dtype)
    return np.asarray(join(np.concatenate([values, end]), np.concatenate([end, values])))


STEPS_BEFORE = 2
"""The velocities of a strike are read this number of steps before it, because waves from impacts
nearer the clamp reach the probe in the very last step."""


@dataclass(frozen=True)
class Strikes:
    """The strikes of two neighbours in the window of a run.

    A contact is a group of closures at the probes less than `GROUP_PERIODS` apart. A strike is the
    beginning of a contact. If a period has several, the strike is the beginning with the fastest
    approach.

    Attributes:
        step: step of each strike within the window, shape (n,).
        velocity: velocities of the lower and the upper probe before each strike, shape (2, n)
            [m/s].
    """

    step: IntArray
    velocity: FloatArray

    @property
    def mean(self) -> tuple[float, float]:
        """Mean velocities of both probes before a strike [m/s]; NaN if there are no strikes."""
        if not self.step.size:
            return float("nan"), float("nan")
        lower, upper = self.velocity.mean(axis=1)
        return float(lower), float(upper)

    @property
    def approach(self) -> float:
        """Mean speed of approach [m/s]; 0 if there are no strikes."""
        lower, upper = self.mean
        return lower - upper if self.step.size else 0.0


def of_interface(history: xr.Dataset, steps_per_period: int, interface: int) -> Strikes:
    """Return the strikes of the laminae `interface` and `interface` + 1, counted from 0."""
    v = history["tip_velocity"].to_numpy()
    begins = contact_begins(ProbeMotion.of(history).is_closed[interface], steps_per_period)
    begins = begins[begins >= STEPS_BEFORE]
    rate = v[interface + 1, begins - STEPS_BEFORE] - v[interface, begins - STEPS_BEFORE]
    period = begins // steps_per_period
    chosen = [
        int(begins[period == k][np.argmin(rate[period == k])]) for k in np.unique(period).tolist()
    ]
    steps = np.array(chosen, dtype=np.int64)
    return Strikes(steps, v[interface : interface + 2, steps - STEPS_BEFORE])


def contact_begins(closed: BoolArray, steps_per_period: int) -> IntArray:
    """Return the steps at which contacts begin.

    A contact that may have begun before the window is left out.

    Args:
        closed: whether the pair is closed at each step, shape (n_steps,).
        steps_per_period: N.
    """
    steps = np.flatnonzero(closed)
    apart = GROUP_PERIODS * steps_per_period
    since = np.diff(steps, prepend=-np.inf if steps.size and steps[0] > apart else 0)
    return np.asarray(steps[since >= apart], dtype=np.int64)


ROUND_OFF = 1e-9
"""Share of the energy exchanged in a run below which a gain does not count. What impacts take is no
scale: with e = 1 that is round-off itself."""
REMEDY = (
    'contact.impulse = "consistent" or time.mass = "lumped": with the consistent mass, lumped '
    "impulses can add energy"
)


def may_add_energy(case: Case) -> bool:
    """Return whether impulses act through another mass matrix than the time integration has."""
    contact = case.contact
    is_mixed = contact.impulse == "lumped" and case.time.mass == "consistent"
    return is_mixed and "impulse" in combination(contact.law, case.time.scheme).reads


def gain_of(recorder: Recorder) -> float:
    """Return the energy that single instants of impact have added in a run [J]."""
    return float(np.nansum(recorder.impulse[: recorder.n_closed, 2]))


def gain_warning(recorder: Recorder, *, may_add: bool) -> str | None:
    """Return a warning if the impacts of a run added energy; None if they did not.

    Where impulses act through another mass matrix, each instant that gains counts. The Moreau–Jean
    laws may push pairs that part already and gain by it at an instant; there whole periods count.

    Args:
        recorder: recorder of the run.
        may_add: whether impulses act through another mass matrix; see `may_add_energy`.
    """
    rows = recorder.ledger[: recorder.n_closed]
    periods = -rows[:, LEDGER.index("impact_loss")]
    least = ROUND_OFF * float(np.nansum(np.abs(rows[:, EXCHANGED])))
    gain = gain_of(recorder)
    taken = gain - float(np.nansum(periods))
    n_gaining = int((periods > least).sum())
    if not n_gaining and not (may_add and gain > least):
        return None
    share = f", {100.0 * gain / taken:.2g} % of what they took" if taken > least else ""
    periods_text = f"; in {n_gaining} periods they added more than they took" if n_gaining else ""
    remedy = REMEDY if may_add else "more steps per period"
    return f"impacts added {gain:.3g} J to the motion{share}{periods_text}; try {remedy}"


LARGEST_PERIODICITY = LONGEST
"""Motions with a longer period count as irregular."""
STROBES = 40
"""Number of last periods by which the periodicity is judged."""
PERIODIC_SCATTER = REPEATS
"""Largest rms difference of strobes in half peak-to-peak amplitudes; cycles of clapping scatter."""
_ROUND_OFF = 1e-6
"""Part of a step that is round-off in the time of an impact."""
PERIODIC_MARGIN = MARGIN
"""Factor on either side of `PERIODIC_SCATTER` within which the class of a motion is undecided."""
GROUP_PERIODS = 0.05
"""Closures at the probes less than so many periods apart are one contact."""


@dataclass(frozen=True)
class ProbeMotion:
    """The motion of the reference probes, one of each lamina, from bottom to top.

    Attributes:
        displacement: displacements at each step of the window, shape (n_laminae, n_steps) [m].
        strobe: displacements at the end of each period of the run, shape (n_laminae, n_periods)
            [m].
        gap_at_rest: gap of each interface at the probes, shape (n_interfaces,) [m]; NaN: the two
            are bonded there, or not opposite.
        is_hit: whether the pair at the probes is hit at the end of each step of the window, shape
            (n_interfaces, n_steps).
        n_impacts: impulses on pairs in the window.
    """

    displacement: FloatArray
    strobe: FloatArray
    gap_at_rest: FloatArray
    is_hit: BoolArray
    n_impacts: int

    @classmethod
    def of(cls, history: xr.Dataset) -> ProbeMotion:
        """Return the motion in the dataset of a run; without a case the probes have no gaps."""
        gap_at_rest = np.zeros(0)
        if "gap0" in history:
            gap_at_rest = by_interface(history["gap0"])[:, probe_node(history)]
        if "spring_share" in history:
            is_pair = by_interface(history["spring_share"])[:, probe_node(history)] > 0.0
            gap_at_rest = np.where(is_pair, gap_at_rest, np.nan)
        if "end" in history:  # the tips of laminae of unequal lengths are not opposite
            gap_at_rest = np.full_like(gap_at_rest, np.nan)
        return cls(
            history["tip_displacement"].to_numpy(),
            history["strobe_displacement"].to_numpy(),
            gap_at_rest,
            _hits(history, gap_at_rest.size),
            history.sizes["event"],
        )

    @property
    def gaps(self) -> FloatArray:
        """Gaps g0 + q_{j+1} - q_j at the probes, shape (n_interfaces, n_steps) [m]."""
        if not self.gap_at_rest.size:
            return np.zeros((0, self.displacement.shape[1]))
        return between(self.gap_at_rest[:, None], self.displacement)

    @property
    def gap(self) -> FloatArray:
        """Smallest gap of all interfaces at each step, NaN: none has one, shape (n_steps,) [m]."""
        has_gap = ~np.isnan(self.gap_at_rest)
        gaps = self.gaps[has_gap] if has_gap.any() else self.gaps
        return np.asarray(gaps.min(axis=0, initial=np.inf))

    @property
    def is_closed(self) -> BoolArray:
        """Whether the pairs at the probes are closed, shape (n_interfaces, n_steps).

        A pair is closed if its gap is not positive or if it is hit: a law that foresees the contact
        (Moreau-Jean) hits before the gap closes, a law without impacts (penalty) never hits.
        """
        return (self.gaps <= 0.0) | self.is_hit

    def whole_periods(self, steps_per_period: int) -> FloatArray:
        """Return the displacements of the last whole periods of the window."""
        return self.displacement[:, self.displacement.shape[1] % steps_per_period :]

    def harmonics(self, steps_per_period: int) -> FloatArray | None:
        """Return the harmonics over the whole periods of the window.

        Returns:
            A_1, A_2, …, shape (n_laminae, n_harmonics) [m]; None if there is no whole period or
            the motion is not finite.
        """
        periods = self.whole_periods(steps_per_period)
        if not periods.shape[1] or not np.isfinite(periods).all():
            return None
        return harmonic_amplitudes(periods, periods.shape[1] // steps_per_period)


def probe_node(history: xr.Dataset) -> int:
    """Return the number of the node at which the reference probes are.

    Of laminae of unequal lengths: at which the shortest one ends.
    """
    if "end" in history:
        return int(np.flatnonzero(is_opposite(history).all(axis=0))[-1])
    return int(history["tip_node"])


def probe_place(history: xr.Dataset) -> str:
    """Return where the reference probes are in words: "the tip", or the position along x."""
    if "tip_node" not in history:
        return "the probes"
    node = probe_node(history)
    x = history["x"].to_numpy()
    return "the tip" if node == x.size - 1 else f"x = {1e3 * x[node]:.4g} mm"


def is_at_probes(history: xr.Dataset) -> BoolArray:
    """Return whether each event hits the pair at the probes, shape (n_events,)."""
    between_laminae = event_interfaces(history) >= 0  # not at a stop
    return np.asarray(between_laminae & (history["event_node"].to_numpy() == probe_node(history)))


def probe_positions(history: xr.Dataset) -> FloatArray:
    """Return the positions y_i of the probes: q_i plus the gaps at rest below lamina i.

    Returns:
        Positions at each step of the window, shape (n_laminae, n_steps) [m].
    """
    at_rest = rest_positions(history)[:, probe_node(history)]
    return np.asarray(history["tip_displacement"].to_numpy() + at_rest[:, None])


def scatters(strobe: FloatArray, half_range: FloatArray) -> FloatArray:
    """Return by how much strobes P periods apart differ, for each P from 1 on.

    Args:
        strobe: displacements at the end of each period, shape (n_laminae, n_periods) [m].
        half_range: half peak-to-peak amplitudes, shape (n_laminae,) [m].

    Returns:
        The rms of s_k - s_{k-P} within the last `STROBES` periods in half peak-to-peak amplitudes,
        the largest of all laminae, shape (at most `LARGEST_PERIODICITY`,) [-]; empty if one is at
        rest or if there are fewer than 2 P periods.
    """
    last = strobe[:, -STROBES:]
    if not np.all(half_range > 0.0):
        return np.zeros(0)
    n = min(LARGEST_PERIODICITY, last.shape[1] // 2)
    changes = [last[:, P:] - last[:, :-P] for P in range(1, n + 1)]
    return np.array([(np.sqrt((change**2).mean(axis=1)) / half_range).max() for change in changes])


def periodicity(strobe: FloatArray, half_range: FloatArray) -> tuple[int | None, float | None]:
    """Return the smallest number of excitation periods after which the motion repeats.

    P qualifies when its scatter (see `scatters`) is below `PERIODIC_SCATTER`.

    Args:
        strobe: displacements at the end of each period, shape (n_laminae, n_periods) [m].
        half_range: half peak-to-peak amplitudes, shape (n_laminae,) [m].

    Returns:
        P and its scatter [-]; (None, None) if none of 1…`LARGEST_PERIODICITY` qualifies or if there
        are fewer than 2 P periods.
    """
    return first_repeat(scatters(strobe, half_range))


def first_repeat(sizes: FloatArray) -> tuple[int | None, float | None]:
    """Return P and its scatter from all scatters; see `periodicity`."""
    return _first_below(sizes, PERIODIC_SCATTER)


def _first_below(sizes: FloatArray, threshold: float) -> tuple[int | None, float | None]:
    """Return the first P whose scatter is below a threshold, and its scatter; None: none is."""
    for P, scatter in enumerate(sizes.tolist(), start=1):
        if scatter < threshold:
            return P, scatter
    return None, None


def is_decided(sizes: FloatArray) -> bool:
    """Return whether the periodicity is the same with thresholds apart by `PERIODIC_MARGIN`.

    The cycles of clapping differ. Near the threshold it depends on chance whether a motion counts
    as one of period 1, of a higher period or of none.

    Args:
        sizes: what `scatters` returns [-].
    """
    ends = (PERIODIC_SCATTER / PERIODIC_MARGIN, PERIODIC_SCATTER * PERIODIC_MARGIN)
    low, high = (_first_below(sizes, end)[0] for end in ends)
    return low == high


def class_name(periodicity: int | None, *, is_decided: bool) -> str:
    """Return the class of a motion in words: "period 2", "not periodic" or "undecided"."""
    if not is_decided:
        return "undecided"
    return "not periodic" if periodicity is None else f"period {periodicity}"


def count_contacts(is_closed: BoolArray, apart: float) -> int:
    """Count groups of closed steps; the window counts as one turn of a periodic motion.

    A group at the end of the window continues at its start.

    Args:
        is_closed: whether a pair is closed at each step, shape (n_steps,).
        apart: closed steps so many steps apart belong to different groups.

    Returns:
        Number of groups.
    """
    return max(int(is_closed.any()), group_begins(is_closed, apart).size)


def group_begins(is_closed: BoolArray, apart: float) -> IntArray:
    """Return the steps at which groups of closed steps begin, in the turn of `count_contacts`.

    A group that fills the turn has no beginning.
    """
    closed = np.flatnonzero(is_closed)
    since_last = np.diff(closed, prepend=closed[-1:] - is_closed.size)
    return np.asarray(closed[since_last >= apart], dtype=np.int64)


def tip_gap(history: xr.Dataset) -> FloatArray:
    """Return the smallest gap at the probes at each step of the window, shape (n_steps,) [m]."""
    return ProbeMotion.of(history).gap


def last_periods(history: xr.Dataset, case: Case, count: int | None = None) -> xr.Dataset:
    """Return the dataset with `time` cut to its last `count` periods, or to all whole ones.

    Args:
        history: dataset of a run.
        case: its case.
        count: number of periods; None: all whole periods of the window. If the excitation is not
            periodic, any number takes the whole window.

    Returns:
        The same dataset with fewer steps; without any step if the window is shorter than one
        period and `count` is None.
    """
    N = case.steps_per_period
    n = history.sizes["time"]
    last = n if not case.is_periodic else min(n, (count or 0) * N)
    n_kept = n // N * N if count is None else last
    return history.isel(time=slice(n - n_kept, n))


def phase_portrait(history: xr.Dataset, case: Case, count: int = 10) -> FloatArray:
    """Return displacement [m] and velocity [m/s] of the probes over the last `count` periods.

    Returns:
        Shape (n_laminae, 2, n_steps).
    """
    last = last_periods(history, case, count)
    q = last["tip_displacement"].to_numpy()
    v = last["tip_velocity"].to_numpy()
    return np.stack([q, v], axis=1)


def summary(history: xr.Dataset, case: Case) -> dict[str, Any]:
    """Return the numbers of summary.json that follow from the history; see `summary_of`."""
    return summary_of(ProbeMotion.of(history), case)


def summary_of(motion: ProbeMotion, case: Case) -> dict[str, Any]:
    """Return the numbers of summary.json that follow from the motion of the probes.

    Args:
        motion: motion of the probes in a run, however short.
        case: its case.

    Returns:
        Values by name [m, -]; None or NaN if a number has no meaning: harmonics and periodicity
        under a swept sine, contacts without a contact law or beside a single lamina.
    """
    q = motion.displacement
    N = case.steps_per_period
    n_periods = q.shape[1] / N
    amplitudes = motion.harmonics(N) if case.is_harmonic else None
    repeats = _periodicity_of(motion, N) if case.is_periodic else _NO_PERIODICITY
    contacts = None
    if motion.gap_at_rest.size and case.contact.law != "none":
        contacts = count_contacts(motion.is_closed.any(axis=0), GROUP_PERIODS * N) / n_periods
    return {
        **{
            f"tip_{name}": CHANNEL_MEASURES[name].of(q).tolist()
            for name in ("min", "max", "amplitude")
        },
        **repeats,
        "tip_contacts_per_period": contacts,
        "impacts_per_period": motion.n_impacts / n_periods,
        "distortion_factor": None if amplitudes is None else distortion_factor(amplitudes).tolist(),
        "thd": None if amplitudes is None else total_harmonic_distortion(amplitudes).tolist(),
        "minimum_tip_gap": float(motion.gap.min()),
    }


def _hits(history: xr.Dataset, n_interfaces: int) -> BoolArray:
    """Return whether the pairs at the probes are hit, shape (n_interfaces, n_steps)."""
    is_hit = np.zeros((n_interfaces, history.sizes["time"]), dtype=np.bool_)
    if not n_interfaces:
        return is_hit
    steps, is_inside = steps_of_events(history)
    chosen = is_inside & is_at_probes(history)
    is_hit[event_interfaces(history)[chosen], steps[chosen]] = True
    return is_hit


def steps_of_events(history: xr.Dataset) -> tuple[IntArray, BoolArray]:
    """Return the step of the window within which each event lies, and whether it is one.

    Steps count from 0; in a window of a single step no event has one. Both have the shape
    (n_events,).
    """
    time = history["time"].to_numpy()
    when = history["event_time"].to_numpy()
    if time.size < 2:
        return np.zeros(when.size, np.int64), np.zeros(when.size, np.bool_)
    after = (when - time[0]) / (time[1] - time[0])
    steps = np.ceil(after - _ROUND_OFF).astype(np.int64)
    return steps, (steps >= 0) & (steps < time.size)


_NO_PERIODICITY: dict[str, Any] = {
    "periodicity": None, "strobe_scatter": None, "periodicity_class": None, "strobe_scatters": None,
}  # fmt: skip


def _periodicity_of(motion: ProbeMotion, N: int) -> dict[str, Any]:
    """Return the summary's numbers on periodicity; an unfinished last period has no strobe."""
    q, strobe = motion.displacement, motion.strobe
    if q.shape[1] % N:
        strobe = strobe[:, :-1]
    if not (np.isfinite(strobe).all() and np.isfinite(q).all()):
        return _NO_PERIODICITY
    strobe_scatters = scatters(strobe, np.ptp(q, axis=1) / 2.0)
    if not strobe_scatters.size:
        return _NO_PERIODICITY
    is_sure = is_decided(strobe_scatters)
    P, scatter = first_repeat(strobe_scatters) if is_sure else (None, None)
    return {
        "periodicity": P,
        "strobe_scatter": scatter,
        "periodicity_class": class_name(P, is_decided=is_sure),
        "strobe_scatters": strobe_scatters.tolist(),
    }

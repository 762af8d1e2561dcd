"""Pure functions of a recorded motion: periodicity, contacts at the probes, the summary.

Each lamina has one reference probe, at the node `tip_node` of the dataset. Functions that need
whole periods of the excitation use the last whole periods of the window, so that an interrupted run
has its diagnostics too. Nothing here draws or writes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import BoolArray, FloatArray
from delam_fem.numerics.harmonics import (
    distortion_factor,
    harmonic_amplitudes,
    total_harmonic_distortion,
)
from delam_fem.numerics.settling import LONGEST, MARGIN, REPEATS
from delam_fem.results.gaps import between, rest_positions
from delam_fem.results.schema import by_interface, event_interfaces

if TYPE_CHECKING:  # the workers of a sweep use the arrays alone
    import xarray as xr


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
        displacement: at each step of the window, shape (n_laminae, n_steps) [m].
        strobe: at the end of each period of the run, shape (n_laminae, n_periods) [m].
        gap_at_rest: of each interface at the probes, shape (n_interfaces,) [m].
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
        """Return the motion that the dataset of a run holds."""
        gap_at_rest = by_interface(history["gap0"])[:, probe_node(history)]
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
        return between(self.gap_at_rest[:, None], self.displacement)

    @property
    def gap(self) -> FloatArray:
        """Smallest gap of all interfaces at each step, shape (n_steps,) [m]."""
        smallest: FloatArray = self.gaps.min(axis=0)
        return smallest

    @property
    def is_closed(self) -> BoolArray:
        """Whether the pairs at the probes are closed, shape (n_interfaces, n_steps).

        A pair is closed if its gap is not positive or if it is hit: a law that foresees the contact
        (Moreau-Jean) hits before the gap closes, a law without impacts (penalty) never hits.
        """
        return (self.gaps <= 0.0) | self.is_hit

    def whole_periods(self, steps_per_period: int) -> FloatArray:
        """Return the displacements of the last whole periods of the window."""
        n = self.displacement.shape[1]
        return self.displacement[:, n % steps_per_period :]


def probe_node(history: xr.Dataset) -> int:
    """Return the number of the node at which the reference probes are."""
    return int(history["tip_node"])


def probe_place(history: xr.Dataset) -> str:
    """Return where the reference probes are in words: "the tip", or the position along x."""
    node, x = probe_node(history), history["x"].to_numpy()
    return "the tip" if node == x.size - 1 else f"x = {1e3 * x[node]:.4g} mm"


def is_at_probes(history: xr.Dataset) -> BoolArray:
    """Return whether each event hits the pair at the probes, shape (n_events,)."""
    return np.asarray(history["event_node"].to_numpy() == probe_node(history))


def probe_positions(history: xr.Dataset) -> FloatArray:
    """Return the positions y_i of the probes: q_i plus the gaps at rest below lamina i.

    Returns:
        Positions at each step of the window, shape (n_laminae, n_steps) [m].
    """
    at_rest = rest_positions(history)[:, probe_node(history)]
    positions: FloatArray = history["tip_displacement"].to_numpy() + at_rest[:, None]
    return positions


def scatters(strobe: FloatArray, half_range: FloatArray) -> FloatArray:
    """Return by how much strobes P periods apart differ, for each P from 1 on.

    Args:
        strobe: displacements at the end of each period, shape (n_laminae, n_periods) [m].
        half_range: half peak-to-peak amplitudes, shape (n_laminae,) [m].

    Returns:
        The rms of s_k - s_{k-P} within the last `STROBES` periods in half peak-to-peak amplitudes,
        the largest of all laminae, shape (at most `LARGEST_PERIODICITY`,) [-]; empty if a tip is at
        rest or if there are fewer than 2 P periods.
    """
    last = strobe[:, -STROBES:]
    if not np.all(half_range > 0.0):
        return np.zeros(0)
    n = min(LARGEST_PERIODICITY, last.shape[1] // 2)
    changes = [last[:, P:] - last[:, :-P] for P in range(1, n + 1)]
    found: FloatArray = np.array(
        [(np.sqrt((change**2).mean(axis=1)) / half_range).max() for change in changes]
    )
    return found


def periodicity(
    strobe: FloatArray, half_range: FloatArray, *, threshold: float = PERIODIC_SCATTER
) -> tuple[int | None, float | None]:
    """Return the smallest number of excitation periods after which the motion repeats.

    P qualifies when its scatter (see `scatters`) is below the threshold.

    Args:
        strobe: displacements at the end of each period, shape (n_laminae, n_periods) [m].
        half_range: half peak-to-peak amplitudes, shape (n_laminae,) [m].
        threshold: largest scatter of a motion that repeats [-].

    Returns:
        P and its scatter [-]; (None, None) if none of 1…`LARGEST_PERIODICITY` qualifies or if there
        are fewer than 2 P periods.
    """
    for P, scatter in enumerate(scatters(strobe, half_range).tolist(), start=1):
        if scatter < threshold:
            return P, scatter
    return None, None


def is_decided(strobe: FloatArray, half_range: FloatArray) -> bool:
    """Return whether the periodicity is the same with thresholds apart by `PERIODIC_MARGIN`.

    The cycles of clapping differ. Near the threshold it depends on chance whether a motion counts
    as one of period 1, of a higher period or of none.
    """
    ends = (PERIODIC_SCATTER / PERIODIC_MARGIN, PERIODIC_SCATTER * PERIODIC_MARGIN)
    low, high = (periodicity(strobe, half_range, threshold=end)[0] for end in ends)
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
    closed = np.flatnonzero(is_closed)
    if not closed.size:
        return 0
    until_next = np.diff(closed, append=closed[0] + is_closed.size)
    return max(1, int(np.count_nonzero(until_next >= apart)))


def tip_gap(history: xr.Dataset) -> FloatArray:
    """Return the smallest gap at the probes at each step of the window, shape (n_steps,) [m]."""
    return ProbeMotion.of(history).gap


def tip_closed(history: xr.Dataset) -> BoolArray:
    """Return for each step of the window whether any pair at the probes is closed, (n_steps,).

    `ProbeMotion.is_closed` says when a pair is closed.
    """
    return np.asarray(ProbeMotion.of(history).is_closed.any(axis=0))


def last_periods(history: xr.Dataset, case: Case, count: int | None = None) -> xr.Dataset:
    """Return the dataset with `time` cut to its last `count` periods, or to all that it holds.

    Args:
        history: of a run.
        case: its case.
        count: number of periods, or the window if the excitation has none; None for the last whole
            periods of the window.

    Returns:
        The same dataset with fewer steps; without any step if the window is shorter than one
        period and `count` is None.
    """
    N = case.steps_per_period
    n = history.sizes["time"]
    last = n if not case.is_periodic else min(n, (count or 0) * N)
    kept = n // N * N if count is None else last
    return history.isel(time=slice(n - kept, n))


def phase_portrait(history: xr.Dataset, case: Case, count: int = 10) -> FloatArray:
    """Return displacement [m] and velocity [m/s] of the probes over the last `count` periods.

    Returns:
        Shape (n_laminae, 2, n_steps).
    """
    last = last_periods(history, case, count)
    q, v = last["tip_displacement"].to_numpy(), last["tip_velocity"].to_numpy()
    return np.stack([q, v], axis=1)


def summary(history: xr.Dataset, case: Case) -> dict[str, Any]:
    """Return the numbers of summary.json that follow from the history; see `summary_of`."""
    return summary_of(ProbeMotion.of(history), case)


def summary_of(motion: ProbeMotion, case: Case) -> dict[str, Any]:
    """Return the numbers of summary.json that follow from the motion of the probes.

    Args:
        motion: of a run, however short.
        case: its case.

    Returns:
        Values by name [m, -]; None or NaN if a number has no meaning: harmonics and periodicity
        under a swept sine, contacts without a contact law.
    """
    q, N = motion.displacement, case.steps_per_period
    n_periods = q.shape[1] / N
    is_harmonic = case.is_periodic
    amplitudes = _harmonics(motion.whole_periods(N), N) if is_harmonic else None
    repeats = _periodicity_of(motion, N) if is_harmonic else _NO_PERIODICITY
    contacts = None
    if case.contact.law != "none":
        is_closed = motion.is_closed.any(axis=0)
        contacts = count_contacts(is_closed, GROUP_PERIODS * N) / n_periods
    return {
        "tip_min": q.min(axis=1).tolist(),
        "tip_max": q.max(axis=1).tolist(),
        **repeats,
        "tip_contacts_per_period": contacts,
        "impacts_per_period": motion.n_impacts / n_periods,
        "distortion_factor": None if amplitudes is None else distortion_factor(amplitudes).tolist(),
        "thd": None if amplitudes is None else total_harmonic_distortion(amplitudes).tolist(),
        "minimum_tip_gap": float(motion.gap.min()),
    }


def window_harmonics(history: xr.Dataset, case: Case) -> FloatArray | None:
    """Return the harmonics of the probes over the whole periods of the window.

    Returns:
        A_1, A_2, …, shape (n_laminae, n_harmonics) [m]; None if there is no whole period or the
        motion is not finite.
    """
    N = case.steps_per_period
    return _harmonics(ProbeMotion.of(history).whole_periods(N), N)


def _hits(history: xr.Dataset, n_interfaces: int) -> BoolArray:
    """Return whether the pairs at the probes are hit, shape (n_interfaces, n_steps)."""
    time, at_probes = history["time"].to_numpy(), is_at_probes(history)
    is_hit = np.zeros((n_interfaces, time.size), dtype=np.bool_)
    when = history["event_time"].to_numpy()[at_probes]
    if when.size and time.size > 1:
        after = (when - time[0]) / (time[1] - time[0])
        steps = np.ceil(after - _ROUND_OFF).astype(np.int64)  # the step in which it happened
        is_inside = (steps >= 0) & (steps < time.size)
        is_hit[event_interfaces(history)[at_probes][is_inside], steps[is_inside]] = True
    return is_hit


def _harmonics(whole: FloatArray, steps_per_period: int) -> FloatArray | None:
    """Return the harmonics over whole periods; see `window_harmonics`."""
    n_periods = whole.shape[1] // steps_per_period
    if not n_periods or not np.isfinite(whole).all():
        return None
    return harmonic_amplitudes(whole, n_periods)


_NO_PERIODICITY: dict[str, Any] = {
    "periodicity": None, "strobe_scatter": None, "periodicity_class": None, "strobe_scatters": None,
}  # fmt: skip


def _periodicity_of(motion: ProbeMotion, N: int) -> dict[str, Any]:
    """Return the periodicity; a last period that was not finished has no strobe."""
    q, strobe = motion.displacement, motion.strobe
    if q.shape[1] % N:
        strobe = strobe[:, :-1]
    if not (np.isfinite(strobe).all() and np.isfinite(q).all()):
        return _NO_PERIODICITY
    half_range = np.ptp(q, axis=1) / 2.0
    found = scatters(strobe, half_range)
    if not found.size:
        return _NO_PERIODICITY
    P, scatter = periodicity(strobe, half_range)
    return {
        "periodicity": P,
        "strobe_scatter": scatter,
        "periodicity_class": class_name(P, is_decided=is_decided(strobe, half_range)),
        "strobe_scatters": found.tolist(),
    }

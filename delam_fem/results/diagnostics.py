"""Pure functions of a recorded motion: periodicity, tip contacts, contact line, the summary.

Everything that needs whole periods of the excitation uses the last whole periods of the window, so
that a run which was interrupted has its diagnostics too. Nothing here draws or writes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray
from delam_fem.numerics.harmonics import (
    distortion_factor,
    harmonic_amplitudes,
    total_harmonic_distortion,
)

if TYPE_CHECKING:  # the workers of a sweep use the arrays alone
    import xarray as xr


LARGEST_PERIODICITY = 8
"""Motions of a longer period are not told from irregular ones."""
STROBES = 40
"""Number of last periods by which the periodicity is judged."""
PERIODIC_SCATTER = 0.10
"""Largest rms difference of strobes in half peak-to-peak amplitudes; cycles of clapping scatter."""
GROUP_PERIODS = 0.05
"""Tip closures less than so many periods apart are one contact."""
TIP = -1
"""Index of the tip among the nodes."""


@dataclass(frozen=True)
class TipMotion:
    """What the summary of a run is made of.

    Attributes:
        displacement: of both tips at each step of the window, shape (2, n_steps) [m].
        strobe: of both tips at the end of each period of the run, shape (2, n_periods) [m].
        gap_at_rest: of the tip [m].
        hit_steps: steps of the window (0, 1, …) at whose end the tip is hit.
        n_impacts: impulses on pairs in the window.
    """

    displacement: FloatArray
    strobe: FloatArray
    gap_at_rest: float
    hit_steps: IntArray
    n_impacts: int

    @classmethod
    def of(cls, history: xr.Dataset) -> TipMotion:
        """Return the motion that a dataset holds; see results.py."""
        time = history["time"].to_numpy()
        at_tip = history["event_node"].to_numpy() == history.sizes["node"] - 1
        when = history["event_time"].to_numpy()[at_tip]
        steps = np.zeros(0, dtype=np.int64)
        if when.size and time.size > 1:
            steps = np.rint((when - time[0]) / (time[1] - time[0])).astype(np.int64)
        return cls(
            history["tip_displacement"].to_numpy(),
            history["strobe_displacement"].to_numpy(),
            float(history["gap0"][TIP]),
            steps[(steps >= 0) & (steps < time.size)],
            history.sizes["event"],
        )

    @property
    def gap(self) -> FloatArray:
        """g0(L) + q_2 - q_1 at each step, shape (n_steps,) [m]."""
        return _gap(self.gap_at_rest, self.displacement)

    @property
    def is_closed(self) -> BoolArray:
        """Whether the tip pair is closed at each step; see `tip_closed`."""
        is_closed = self.gap <= 0.0
        is_closed[self.hit_steps] = True
        return is_closed

    def whole_periods(self, steps_per_period: int) -> FloatArray:
        """Return the displacements of the last whole periods of the window."""
        n = self.displacement.shape[1]
        return self.displacement[:, n % steps_per_period :]


def periodicity(strobe: FloatArray, half_range: FloatArray) -> tuple[int | None, float | None]:
    """Return the smallest number of excitation periods after which the motion repeats.

    P qualifies when the rms of s_k - s_{k-P} within the last `STROBES` periods is below
    `PERIODIC_SCATTER` half peak-to-peak amplitudes for every tip.

    Args:
        strobe: tip displacements at the end of each period, shape (n_tips, n_periods) [m].
        half_range: half peak-to-peak amplitude of the tips, shape (n_tips,) [m].

    Returns:
        P and its relative scatter (of the worse tip) [-]; (None, None) where none of
        1…`LARGEST_PERIODICITY` qualifies or there are fewer than 2 P periods to judge by.
    """
    last = strobe[:, -STROBES:]
    if not np.all(half_range > 0.0):
        return None, None
    for P in range(1, min(LARGEST_PERIODICITY, last.shape[1] // 2) + 1):
        difference = last[:, P:] - last[:, :-P]
        scatter = np.sqrt((difference**2).mean(axis=1)) / half_range
        if np.all(scatter < PERIODIC_SCATTER):
            return P, float(scatter.max())
    return None, None


def count_contacts(is_closed: BoolArray, apart: float) -> int:
    """Count groups of closed steps, in a window that is taken as one turn of a periodic motion.

    A group that runs over the end of the window is thus the one that is going on at its start.

    Args:
        is_closed: whether the pair is closed at each step, shape (n_steps,).
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
    """Return the gap at the tip g0(L) + q_2 - q_1 at each step of the window, shape (n,) [m]."""
    return TipMotion.of(history).gap


def tip_closed(history: xr.Dataset) -> BoolArray:
    """Say for each step of the window whether the tip pair is closed.

    It is where the gap is not positive, and where the pair is hit: a law that foresees the contact
    (Moreau-Jean) hits before the gap closes, a law without impacts (penalty) has the gap alone.
    """
    return TipMotion.of(history).is_closed


def gap_field(history: xr.Dataset) -> FloatArray:
    """Return the gap g0 + u_2 - u_1 of all frames and nodes, shape (n_frames, n_nodes) [m]."""
    return _gap(history["gap0"].to_numpy(), history["displacement"].to_numpy())


def _gap(gap0: FloatArray | float, u: FloatArray) -> FloatArray:
    """Return the gap; NaN where a diverged motion is infinite."""
    with np.errstate(invalid="ignore"):
        gap: FloatArray = gap0 + u[1] - u[0]
    return gap


def contact_line(history: xr.Dataset) -> FloatArray:
    """Return how far from the clamp the laminae touch in each frame.

    Returns:
        Largest x in contact, shape (n_frames,) [m]; NaN where there is no contact.
    """
    x = history["x"].to_numpy()
    touching = np.where(history["contact_state"].to_numpy() > 0, x, -np.inf)
    farthest = touching.max(axis=1, initial=-np.inf)
    return np.where(np.isfinite(farthest), farthest, np.nan)


def last_periods(history: xr.Dataset, case: Case, count: int | None = None) -> xr.Dataset:
    """Return the dataset with `time` cut to its last `count` periods, or to all that it holds.

    Args:
        history: of a run.
        case: its case.
        count: number of periods; None for the last whole periods of the window.

    Returns:
        The same dataset with fewer steps; none where the window is shorter than one period and
        `count` is None.
    """
    N = case.time.steps_per_period
    n = history.sizes["time"]
    kept = n // N * N if count is None else min(n, count * N)
    return history.isel(time=slice(n - kept, n))


def phase_portrait(history: xr.Dataset, case: Case, count: int = 10) -> FloatArray:
    """Return displacement [m] and velocity [m/s] of the tips over the last `count` periods.

    Returns:
        Shape (2 laminae, 2, n).
    """
    last = last_periods(history, case, count)
    q, v = last["tip_displacement"].to_numpy(), last["tip_velocity"].to_numpy()
    return np.stack([q, v], axis=1)


def summary(history: xr.Dataset, case: Case) -> dict[str, Any]:
    """Return the numbers of summary.json that follow from the history; see `summary_of`."""
    return summary_of(TipMotion.of(history), case)


def summary_of(motion: TipMotion, case: Case) -> dict[str, Any]:
    """Return the numbers of summary.json that follow from the motion of the tips.

    Args:
        motion: of a run, however short.
        case: its case.

    Returns:
        Values by name [m, -]; None or NaN where a number has no meaning: harmonics and periodicity
        under a swept sine, contacts without a contact law.
    """
    q, N = motion.displacement, case.time.steps_per_period
    n_periods = q.shape[1] / N
    is_harmonic = case.excitation.kind == "harmonic"
    amplitudes = _harmonics(motion.whole_periods(N), N) if is_harmonic else None
    P, scatter = _periodicity_of(motion, N) if is_harmonic else (None, None)
    contacts = None
    if case.contact.law != "none":
        contacts = count_contacts(motion.is_closed, GROUP_PERIODS * N) / n_periods
    return {
        "tip_min": q.min(axis=1).tolist(),
        "tip_max": q.max(axis=1).tolist(),
        "periodicity": P,
        "strobe_scatter": scatter,
        "tip_contacts_per_period": contacts,
        "impacts_per_period": motion.n_impacts / n_periods,
        "distortion_factor": None if amplitudes is None else distortion_factor(amplitudes).tolist(),
        "thd": None if amplitudes is None else total_harmonic_distortion(amplitudes).tolist(),
        "minimum_tip_gap": float(motion.gap.min()),
    }


def window_harmonics(history: xr.Dataset, case: Case) -> FloatArray | None:
    """Return the harmonics of both tips over the whole periods of the window.

    Returns:
        A_1, A_2, …, shape (2, n_harmonics) [m]; None where there is no whole period or the
        motion is not finite.
    """
    N = case.time.steps_per_period
    return _harmonics(TipMotion.of(history).whole_periods(N), N)


def _harmonics(whole: FloatArray, steps_per_period: int) -> FloatArray | None:
    """Return the harmonics over whole periods; see `window_harmonics`."""
    n_periods = whole.shape[1] // steps_per_period
    if not n_periods or not np.isfinite(whole).all():
        return None
    return harmonic_amplitudes(whole, n_periods)


def _periodicity_of(motion: TipMotion, N: int) -> tuple[int | None, float | None]:
    """Return the periodicity; a last period that was not finished has no strobe."""
    q, strobe = motion.displacement, motion.strobe
    if q.shape[1] % N:
        strobe = strobe[:, :-1]
    if not (np.isfinite(strobe).all() and np.isfinite(q).all()):
        return None, None
    return periodicity(strobe, np.ptp(q, axis=1) / 2.0)

"""What the claims about motions are measured by: strikes, contact phases, roughness, kinds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray
from delam_fem.results import diagnostics

if TYPE_CHECKING:
    from delam_fem.results.dataset import Result


SMOOTH_HARMONICS = 20
"""What a velocity has above so many harmonics of the excitation counts as roughness."""
FREE_GAP = 1e-3
"""Tips farther apart than this are in free flight [m]."""
STEPS_BEFORE = 2
"""Steps before a strike at which its velocities are read: the waves of impacts further down reach
the tip in the very last one."""


@dataclass(frozen=True)
class Strikes:
    """The strongest tip strike of each period that has one.

    Attributes:
        step: of the window, shape (n,).
        velocity: of both tips before, shape (2, n) [m/s].
    """

    step: IntArray
    velocity: FloatArray

    @property
    def mean(self) -> tuple[float, float]:
        """Mean velocities of both tips before, NaN without strikes [m/s]."""
        if not self.step.size:
            return float("nan"), float("nan")
        thick, thin = self.velocity.mean(axis=1)
        return float(thick), float(thin)

    @property
    def approach(self) -> float:
        """Mean speed of approach, 0 without strikes [m/s]."""
        thick, thin = self.mean
        return thick - thin if self.step.size else 0.0


def strikes(result: Result) -> Strikes:
    """Return the strikes of a result: of each period the tip contact that begins the fastest."""
    history, N = result.history, result.case.time.steps_per_period
    v = history["tip_velocity"].to_numpy()
    closed = diagnostics.tip_closed(history)
    begins = contact_begins(closed, N)
    begins = begins[begins >= STEPS_BEFORE]
    rate = v[1, begins - STEPS_BEFORE] - v[0, begins - STEPS_BEFORE]
    period = begins // N
    chosen = [
        int(begins[period == k][np.argmin(rate[period == k])]) for k in np.unique(period).tolist()
    ]
    steps = np.array(chosen, dtype=np.int64)
    return Strikes(steps, v[:, steps - STEPS_BEFORE])


def contact_begins(closed: BoolArray, steps_per_period: int) -> IntArray:
    """Return the steps at which tip contacts begin; see `diagnostics.GROUP_PERIODS`."""
    steps = np.flatnonzero(closed)
    apart = diagnostics.GROUP_PERIODS * steps_per_period
    since = np.diff(steps, prepend=-np.inf if steps.size and steps[0] > apart else 0)
    return np.asarray(steps[since >= apart], dtype=np.int64)


def near_share(result: Result) -> float:
    """Return the share of the window in which the tips are less than `FREE_GAP` apart [-]."""
    return float((diagnostics.tip_gap(result.history) < FREE_GAP).mean())


def rough_part(values: FloatArray, n_periods: int, above: int = SMOOTH_HARMONICS) -> FloatArray:
    """Return what a signal of whole periods has above so many harmonics, same shape."""
    spectrum = np.fft.rfft(values, axis=-1)
    spectrum[..., : above * n_periods + 1] = 0.0
    return np.fft.irfft(spectrum, n=values.shape[-1], axis=-1)


def roughness(result: Result, *, free: bool, quantity: str = "tip_velocity") -> tuple[float, float]:
    """Return rms of the rough part over rms of the whole signal, of both tips.

    Args:
        result: its window has whole periods.
        free: over the steps at which the tips are more than `FREE_GAP` apart, or over the others.
        quantity: "tip_velocity" or "tip_displacement".
    """
    whole = diagnostics.last_periods(result.history, result.case)
    values = whole[quantity].to_numpy()
    rough = rough_part(values, values.shape[-1] // result.case.time.steps_per_period)
    chosen = (diagnostics.tip_gap(whole) > FREE_GAP) == free
    values = values - values.mean(axis=1, keepdims=True)
    scale = np.sqrt((values**2).mean(axis=1))
    part = np.sqrt((rough[:, chosen] ** 2).mean(axis=1)) if chosen.any() else np.zeros(2)
    thick, thin = part / scale
    return float(thick), float(thin)


def settling(strobe: FloatArray, half_range: FloatArray, periodicity: int, within: float) -> int:
    """Return after how many periods a motion from rest stays near its stationary cycle.

    Args:
        strobe: displacement of both tips at the end of each period, shape (2, n) [m].
        half_range: half peak-to-peak of both tips, shape (2,) [m].
        periodicity: of the stationary motion, P.
        within: distance that counts as near, in half ranges [-].

    Returns:
        Number of the last period at whose end a tip is farther from the mean of the last strobes
        of the same phase.
    """
    n = strobe.shape[1]
    last = 0
    for phase in range(periodicity):
        periods = np.arange(n - 1 - phase, -1, -periodicity)[::-1]
        same = strobe[:, periods]
        mean = same[:, -(diagnostics.STROBES // periodicity) :].mean(axis=1, keepdims=True)
        away = (np.abs(same - mean) > within * half_range[:, None]).any(axis=0)
        last = max(last, int(periods[away].max(initial=-1)) + 1)
    return last


def is_as_described(result: Result) -> bool:
    """Say whether a motion is of the kind that the paper describes for its frequency.

    1.25 Hz: period 1, no tip contact. 1.60 Hz: period 1, the thin lamina beats the thick one (at
    least one strike per period, the thin tip more than twice as fast). 3.25 Hz: period 1, one
    contact per period, opposite velocities. 3.65 Hz: period 2, one contact in two periods.
    """
    s, frequency = result.summary, result.case.period**-1
    contacts = float(s["tip_contacts_per_period"])
    thick, thin = strikes(result).mean
    if abs(frequency - 1.25) < 0.01:
        return bool(s["periodicity"] == 1 and contacts == 0.0 and s["minimum_tip_gap"] > 0.0)
    if abs(frequency - 1.60) < 0.01:
        return bool(s["periodicity"] == 1 and contacts >= 1.0 and abs(thin) > 2.0 * abs(thick))
    if abs(frequency - 3.25) < 0.01:
        return bool(s["periodicity"] == 1 and contacts == 1.0 and thick > 0.0 > thin)
    return bool(s["periodicity"] == 2 and contacts == 0.5)


def describe(result: Result) -> str:
    """Return the kind of a motion in a few words."""
    s = result.summary
    thick, thin = strikes(result).mean
    period = "not periodic" if s["periodicity"] is None else f"period {s['periodicity']}"
    struck = "" if np.isnan(thick) else f", {thick:+.2f} / {thin:+.2f} m/s"
    return f"{period}, {s['tip_contacts_per_period']:.2g} contacts/T{struck}"

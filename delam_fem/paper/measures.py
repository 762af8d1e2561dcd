"""Measure motions: amplitudes, roughness, length of transients, kinds in words."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.numerics.types import FloatArray
from delam_fem.paper.claims import Criterion, Numbers, yes
from delam_fem.paper.lab import is_as_described, strikes
from delam_fem.results import diagnostics
from delam_fem.results.figures.style import HISTORY_PERIODS

if TYPE_CHECKING:
    from delam_fem.results.folder import Result

SMOOTH_HARMONICS = 20
"""The part of a signal above this harmonic of the excitation counts as roughness."""
FREE_GAP = 1e-3
"""Tips farther apart than this are in free flight [m]."""
CLEARLY = 0.8
"""A roughness below this fraction of the other one counts as a distinct improvement."""
SERIES_STEP = 4
"""Distance in steps between the samples that are kept in the numbers of a figure."""


def rough_part(values: FloatArray, n_periods: int, above: int = SMOOTH_HARMONICS) -> FloatArray:
    """Return the part of a signal above a harmonic of the excitation, same shape as `values`.

    Args:
        values: signal over whole periods along the last axis.
        n_periods: number of periods in the signal.
        above: number of the highest harmonic that is removed.
    """
    spectrum = np.fft.rfft(values, axis=-1)
    spectrum[..., : above * n_periods + 1] = 0.0
    return np.fft.irfft(spectrum, n=values.shape[-1], axis=-1)


def roughness(result: Result, *, free: bool, quantity: str = "tip_velocity") -> tuple[float, float]:
    """Return, for both tips, the rms of the rough part over the rms of the whole signal [-].

    Args:
        result: a result whose window has whole periods.
        free: True: use the steps at which the tips are more than `FREE_GAP` apart; False: use the
            other steps.
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
    """Return the number of periods after which a motion from rest stays near its stationary cycle.

    Args:
        strobe: displacement of both tips at the end of each period, shape (2, n) [m].
        half_range: half peak-to-peak of both tips, shape (2,) [m].
        periodicity: P, the number of periods after which the stationary motion repeats.
        within: distance from the cycle that counts as near, in half ranges [-].

    Returns:
        Number of the last period at whose end a tip is farther than that from the mean of the last
        strobes of the same phase.
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


def describe(result: Result) -> str:
    """Return the kind of a motion in a few words."""
    s = result.summary
    thick, thin = strikes(result).mean
    period = s["periodicity_class"] or "not periodic"
    struck = "" if np.isnan(thick) else f", {thick:+.2f} / {thin:+.2f} m/s"
    return f"{period}, {s['tip_contacts_per_period']:.2g} contacts/T{struck}"


def ends(values: Iterable[str]) -> str:
    """Return the first and the last value in words: "1 … 3"."""
    first, *_, last = values
    return f"{first} … {last}"


def tip_positions(result: Result, count: int) -> tuple[FloatArray, FloatArray]:
    """Return the time and the positions of both tips over the last periods.

    Returns:
        t/T from the start of these periods, shape (n,) [-]; positions, shape (2, n) [mm].
    """
    last = diagnostics.last_periods(result.history, result.case, count)
    y = 1e3 * diagnostics.probe_positions(last)
    t = np.arange(1, y.shape[1] + 1) / result.case.time.steps_per_period
    return t, y


def motion_numbers(result: Result) -> Numbers:
    """Return the numbers that characterise a motion, and the positions of the tips at its end.

    Returns:
        The same numbers as in the summary of a run, and: kind, the motion in words;
        is_as_described, whether the motion is as the paper describes it for its frequency;
        strike_velocities, mean velocities of thick and thin tip before a strike [m/s]; near_share,
        the share of the time in which the tips are less than `FREE_GAP` apart [-]; t_over_T and
        position_mm, time and tip positions, every `SERIES_STEP` steps, shapes (n,) and (2, n).
    """
    t, y = tip_positions(result, HISTORY_PERIODS)
    names = (
        "periodicity", "periodicity_class", "strobe_scatters", "strobe_scatter",
        "tip_contacts_per_period", "impacts_per_period",
        "tip_min", "tip_max", "minimum_tip_gap", "distortion_factor", "thd", "energy_residual",
    )  # fmt: skip
    return Numbers(
        {name: result.summary[name] for name in names}
        | {
            "kind": describe(result),
            "is_as_described": is_as_described(result),
            "strike_velocities": strikes(result).mean,
            "near_share": float((diagnostics.tip_gap(result.history) < FREE_GAP).mean()),
            "t_over_T": t[::SERIES_STEP],
            "position_mm": np.round(y[:, ::SERIES_STEP], 4),
        }
    )


def has_period(motion: Numbers, periodicity: int) -> list[Criterion]:
    """Return what must be so for a motion to repeat after this number of periods, not earlier.

    The scatter of cycles counts as uncertain by the factor `diagnostics.PERIODIC_MARGIN`.
    """
    margin = diagnostics.PERIODIC_MARGIN
    found: list[Criterion] = []
    for P in (P for P in range(1, periodicity + 1) if periodicity % P == 0):
        (value,) = (motion.strobe_scatters or ())[P - 1 : P] or (math.nan,)
        found.append(
            Criterion(
                f"scatter {P} period{'s' if P > 1 else ''} apart", value,
                "<" if periodicity == P else ">", diagnostics.PERIODIC_SCATTER, "%",
                (value / margin, value * margin),
            )
        )  # fmt: skip
    return found


def described(motion: Numbers, periodicity: int) -> list[Criterion]:
    """Return what must be so for a motion of a period to be as the paper describes it."""
    return [yes("as described", motion.is_as_described), *has_period(motion, periodicity)]

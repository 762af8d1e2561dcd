"""The numbers of an irregular motion with intervals: means over windows, and how far to trust them.

A motion without a period has no extremes and no spectrum of its own: longer runs give larger
extremes. Its means per period are numbers that longer runs repeat within the interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.harmonics import (
    distortion_factor,
    harmonic_amplitudes,
    total_harmonic_distortion,
)
from delam_fem.numerics.intervals import BLOCKS, block_means, interval
from delam_fem.results import diagnostics

NAMES = (
    "tip_min", "tip_max", "impacts_per_period", "tip_contacts_per_period", "distortion_factor",
    "thd",
)  # fmt: skip
"""Entries of the summary that fluctuate from period to period."""


def of_run(
    history: xr.Dataset, case: Case, summary: Mapping[str, Any]
) -> dict[str, dict[str, Any]] | None:
    """Return mean and 95 % interval of the numbers of an irregular motion.

    Extremes and impacts are known of every period: they are averaged over the periods that the
    verdict judged. Contacts at the tips and harmonics are known of the periods of the window.

    Args:
        history: of the run.
        case: of the run.
        summary: with the verdict.

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
    found = {name: _entry(block_means(values), values.shape[-1]) for name, values in rows.items()}
    found |= _of_window(history, case)
    return {name: found[name] for name in NAMES if name in found}


def _entry(means: FloatArray, periods: int) -> dict[str, Any]:
    """Return mean and interval from the means of blocks of a number of periods in all."""
    middle, half_width = interval(means)
    windows = means.shape[-1]
    found = {"mean": middle.tolist(), "half_width": half_width.tolist()}
    return found | {"windows": windows, "periods": periods // windows * windows}


def _of_window(history: xr.Dataset, case: Case) -> dict[str, dict[str, Any]]:
    """Return means and intervals of the numbers that need every step of their periods."""
    N = case.steps_per_period
    motion = diagnostics.ProbeMotion.of(history)
    whole = motion.whole_periods(N)
    n = whole.shape[1] // N
    if n < 2:
        return {}
    blocks = min(n, BLOCKS)
    each = n // blocks
    cut = whole[:, (n - blocks * each) * N :].reshape(len(whole), blocks, each * N)
    amplitudes = harmonic_amplitudes(cut, each)
    found = {
        "distortion_factor": _entry(distortion_factor(amplitudes), n),
        "thd": _entry(total_harmonic_distortion(amplitudes), n),
    }
    if case.contact.law != "none":
        counts = contacts_by_period(motion, N)
        found["tip_contacts_per_period"] = _entry(block_means(counts), counts.size)
    return found


def contacts_by_period(motion: diagnostics.ProbeMotion, steps_per_period: int) -> FloatArray:
    """Return the number of contacts at the probes that begin in each period of the window.

    Args:
        motion: of the probes.
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
    counts: FloatArray = np.bincount(periods, minlength=n // steps_per_period).astype(np.float64)
    return counts

"""The experiment's 30-minute swept sine: its case, its envelope, and its peak frequency."""

from __future__ import annotations

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.files import preset
from delam_fem.case.motion.excitation import base_motion
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.folder import Result

BAND = (0.5, 4.0)
"""Lowest and highest frequency of the experiment [Hz]."""
SWEEP_SECONDS = 1800.0
TRANSIENT_LEFT = 0.01
"""The envelope of a swept sine begins when so much of the transient of its start is left [-]."""


def swept_case(spacing: str, ends: tuple[float, float], law: str, steps: int) -> Case:
    """Return the case of a 30-minute swept sine.

    Args:
        spacing: how the frequency grows: "linear" or "logarithmic".
        ends: first and last frequency [Hz].
        law: name of the contact law.
        steps: steps per period of the highest frequency.
    """
    return preset(
        "paper",
        {
            "excitation.kind": "sweep",
            "excitation.start_frequency": ends[0],
            "excitation.end_frequency": ends[1],
            "excitation.duration": SWEEP_SECONDS,
            "excitation.amplitude": 0.0025,
            "excitation.spacing": spacing,
            "contact.law": law,
            "time.steps_per_period": steps,
            "output.window_periods": 1,
            "output.fields_per_period": 0,
        },
    )


def swept_extremes(result: Result) -> tuple[FloatArray, FloatArray]:
    """Return the extremes of a swept sine, one pair per period of the highest frequency.

    Returns:
        Times, shape (n,) [s]; smallest and largest displacement of both tips, shape (2, 2, n) [m].
    """
    history = result.history
    extremes = np.stack([history[f"envelope_{end}"].to_numpy() for end in ("min", "max")])
    return (np.arange(extremes.shape[-1]) + 0.5) * result.case.period, extremes


def swept_envelope(result: Result) -> tuple[FloatArray, FloatArray]:
    """Return the frequency and half the range of both tips within each cycle of a swept sine.

    The run keeps extremes per period of its highest frequency. Those within one cycle of the
    current frequency are combined.

    Returns:
        Frequencies, shape (n,) [Hz]; half ranges, shape (2, n) [m]; NaN while more than
        `TRANSIENT_LEFT` of the transient of the start is left.
    """
    middle, (low, high) = swept_extremes(result)
    f = base_motion(result.case).instantaneous_frequency(middle)
    half = np.ceil(0.5 / (f * result.case.period)).astype(np.int64)
    ranges = [slice(max(k - w, 0), k + w + 1) for k, w in enumerate(half.tolist())]
    half_range = [0.5 * (high[:, r].max(axis=1) - low[:, r].min(axis=1)) for r in ranges]
    envelope = np.stack(half_range, axis=1)
    envelope[:, middle < transient_seconds(result.case)] = np.nan
    return f, envelope


def transient_seconds(case: Case) -> float:
    """Return the time in which free vibrations decay to `TRANSIENT_LEFT` [s]."""
    rates = [lam.damping_ratio * float(lam.angular_frequencies(1)[0]) for lam in case.lamina]
    return float(-np.log(TRANSIENT_LEFT) / min(rates))


def peak_frequency(result: Result, lamina: int) -> float:
    """Return the frequency of the base at which the amplitude of a tip is the largest [Hz].

    If the largest amplitude occurs at several times, return the mean of their frequencies.
    """
    f, amplitude = swept_envelope(result)
    top = np.flatnonzero(amplitude[lamina] >= np.nanmax(amplitude[lamina]) * (1.0 - 1e-9))
    return float(f[top].mean())

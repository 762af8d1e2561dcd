"""The experiment's 30-minute swept sine: the case, the record's envelope, where it peaks."""

from __future__ import annotations

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.excitation import base_motion
from delam_fem.case.files import preset
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.folder import Result

BAND = (0.5, 4.0)
"""Frequencies of the experiment [Hz]."""
SWEEP_SECONDS = 1800.0


def swept_case(spacing: str, ends: tuple[float, float], law: str, steps: int) -> Case:
    """Return the 30-minute swept sine."""
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
    """Return the record of a swept sine as its extremes, kept per period of the highest frequency.

    Returns:
        Instants, shape (n,) [s]; least and greatest displacement of both tips, shape (2, 2, n) [m].
    """
    history = result.history
    extremes = np.stack([history[f"envelope_{end}"].to_numpy() for end in ("min", "max")])
    return (np.arange(extremes.shape[-1]) + 0.5) * result.case.period, extremes


def swept_envelope(result: Result) -> tuple[FloatArray, FloatArray]:
    """Return frequency and half the range of both tips within each cycle of a swept sine.

    The run keeps extremes per period of its highest frequency; as many of these as a cycle lasts
    are put together.

    Returns:
        Frequencies, shape (n,) [Hz]; half ranges, shape (2, n) [m].
    """
    middle, (low, high) = swept_extremes(result)
    f = base_motion(result.case).instantaneous_frequency(middle)
    half = np.ceil(0.5 / (f * result.case.period)).astype(np.int64)
    ranges = [slice(max(k - w, 0), k + w + 1) for k, w in enumerate(half.tolist())]
    half_range = [0.5 * (high[:, r].max(axis=1) - low[:, r].min(axis=1)) for r in ranges]
    return f, np.stack(half_range, axis=1)


def peak_frequency(result: Result, lamina: int) -> float:
    """Return the frequency of the base when a tip's swing was the largest [Hz].

    The three largest neighbouring values are joined by a parabola over the index of the extremes.
    """
    f, amplitude = swept_envelope(result)
    top = np.flatnonzero(amplitude[lamina] >= amplitude[lamina].max() * (1.0 - 1e-9))
    return float(f[top].mean())

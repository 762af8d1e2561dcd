"""Find natural frequencies and damping from frequency responses, by sdypy-EMA (extra `ema`)."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import xarray as xr
from scipy.signal import find_peaks

from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray

ORDER = 20
"""Highest order of the polynomials; poles of its upper half are compared."""
NEAR = 0.05
"""Relative distance from a peak within which a pole belongs to it."""
LARGEST_DAMPING = 0.3
PROMINENCE = 0.05
"""Height of a peak above its surroundings, in decades of the summed amplitude squared."""
AGREEING, STABLE = 0.7, 0.003
"""Share of the orders that must have a pole, and its largest relative scatter of frequency."""


@dataclass(frozen=True)
class Pole:
    """A natural frequency with its damping.

    Attributes:
        frequency: natural frequency [Hz].
        damping: ratio of critical damping [-].
        frequency_scatter: standard deviation over the orders [Hz].
        damping_scatter: the same of the damping [-].
    """

    frequency: float
    damping: float
    frequency_scatter: float
    damping_scatter: float


def poles(data: xr.Dataset, lower: float, upper: float) -> list[Pole]:
    """Return the poles between two frequencies, by the least-squares complex frequency method.

    Each peak of the summed responses gets the median of the poles near it over the orders of the
    polynomial, if enough orders have one.

    Args:
        data: a measurement with `response(frequency, output)`.
        lower: least frequency [Hz].
        upper: largest frequency [Hz].

    Raises:
        CaseError: sdypy-EMA is not installed, there are no responses, or the range holds none.
    """
    try:
        ema: Any = import_module("sdypy.EMA")
    except ImportError:
        raise CaseError(
            'poles: need the package sdypy-EMA; install it by pip install "delam_fem[ema]"'
        ) from None
    if "response" not in data:
        raise CaseError("poles: expected frequency responses, found none; --excitation makes them")
    frequency: FloatArray = data["frequency"].to_numpy()
    if not 0.0 <= lower < upper or upper > frequency[-1] or upper - lower < 4 * frequency[1]:
        raise CaseError(
            f"poles: expected a range of frequencies from 0 to {frequency[-1]:.6g} Hz, given "
            f"{lower:g} to {upper:g}"
        )
    values = np.nan_to_num(data["response"].to_numpy().T)
    model = ema.Model(
        frf=values, freq=frequency, lower=lower, upper=upper, pol_order_high=ORDER,
        frf_form="receptance",
    )  # fmt: skip
    model.get_poles(method="lscf", show_progress=False)
    found: list[Pole] = []
    for peak in _peaks(frequency, values, lower, upper):
        if all(abs(pole.frequency - peak) > NEAR * peak for pole in found):
            found += filter(None, [_at_peak(model, peak)])
    return sorted(found, key=lambda pole: pole.frequency)


def _peaks(frequency: FloatArray, values: Any, lower: float, upper: float) -> FloatArray:
    """Return the frequencies at which the summed responses have peaks, the highest first."""
    size = (np.abs(values) ** 2).sum(axis=0)
    level = np.log10(np.maximum(size, 1e-300))
    found, _ = find_peaks(level, prominence=PROMINENCE)
    peaks: FloatArray = frequency[found[np.argsort(-size[found])]]
    return peaks[(peaks >= lower) & (peaks <= upper)]


def _at_peak(model: Any, peak: float) -> Pole | None:
    """Return the pole near a peak on which the orders agree; None: they do not."""
    near = []
    for frequencies, dampings in zip(
        model.pole_freq[ORDER // 2 :], model.pole_xi[ORDER // 2 :], strict=True
    ):
        f, d = np.asarray(frequencies), np.asarray(dampings)
        fits = (np.abs(f - peak) < NEAR * peak) & (d > 0.0) & (d < LARGEST_DAMPING)
        if fits.any():
            k = np.flatnonzero(fits)[np.argmin(np.abs(f[fits] - peak))]
            near.append((float(f[k]), float(d[k])))
    if len(near) < AGREEING * (len(model.pole_freq) - ORDER // 2):
        return None
    table = np.array(near)
    f, d = np.median(table, axis=0)
    scatter = 1.4826 * np.median(np.abs(table - [f, d]), axis=0)
    if scatter[0] > STABLE * f:
        return None
    return Pole(float(f), float(d), float(scatter[0]), float(scatter[1]))

"""`detect modulate`: healthy plates.

`embedded` without its delamination under five pairs of a probe and a pump of 0.1 m/s2, scanned at
39 points with 40 dB for four common periods.

`embedded` without its delamination under five pairs of a probe and a pump of 0.1 m/s2, scanned at
39 points with 40 dB for four common periods. Each pair has one limit, as the command has, and 200
records with noise of their own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.studies.detection.detect import intact, simulated
from delam_fem.studies.detection.indices import FALSE_CALLS, sideband_ratio
from delam_fem.studies.detection.modulation import modulation, pump_of
from delam_fem.studies.detection.study import Modulate, Scan

PAIRS = ((350.0, 60.0), (250.0, 40.0), (170.0, 50.0), (120.0, 50.0), (330.0, 70.0))
"""Probe and pump [Hz]."""
SEED = 20_000_003
"""Of the first record; the command takes others."""


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the row of the page."""
    pairs, truths = (PAIRS, 200) if is_long else (PAIRS[2:3], 40)
    calls = sum(called(probe, pump, truths) for probe, pump in pairs)
    promise = "healthy plate not called (sidebands)"
    n = truths * len(pairs)
    return [Row(promise, OWN, 1.0 - FALSE_CALLS, n - calls, n)]


def called(probe: float, pump: float, truths: int) -> int:
    """Return how many records of a healthy plate are called."""
    case = intact(df.preset("embedded", {"excitation.frequency": probe}))
    limits = modulation(case, Modulate(pump_frequency=pump, pump_amplitude=0.1, periods=4)).mark
    scan = Scan(periods=4)
    pure = simulated(case, scan, pump=pump_of(case, pump, 0.1))
    inside = np.isin(pure.x, limits.x)
    noise = pure.noise_of(scan)
    n_called = 0
    for k in range(truths):
        noisy_scan = pure.noisy(noise, SEED + k)
        ratio = sideband_ratio(noisy_scan.field[:, inside], noisy_scan.times, pump, probe)
        n_called += bool(np.any(ratio > limits.limits))
    return n_called

"""`detect tap`: calls of healthy plates.

The plate of `docs/examples/tap.py` without its delamination, with 20 elements, tapped at 19 points
with noise of 40, 30 and 20 dB below the largest force of each tap. Each level has one limit, as the
command has, and its records have noise of their own. Rigs with another stiffness are judged beside
the taps of the model.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.studies.detection.indices import FALSE_CALLS
from delam_fem.studies.detection.tap import index, lengths, limits, noisy, taps

LEVELS = (40.0, 30.0, 20.0)
"""Noise [dB]."""
RIGS = {OWN: 1.0, "EI + 5 %": 1.05, "EI − 5 %": 0.95}
"""Young's modulus of the plate over that of the model."""
SEED = 20_000_003
LAYER = {"length": 0.4, "width": 0.02, "material": "aluminium", "damping_ratio": 0.002}


def plate() -> df.Case:
    """Return the healthy plate with its hammer."""
    return df.Case(
        name="tap",
        lamina=[
            {"name": "lower", "thickness": 0.02} | LAYER,
            {"name": "upper", "thickness": 0.002} | LAYER,
        ],
        support={"start": "clamped", "end": "clamped"},
        impactor=[{"lamina": "upper", "mass": 0.05, "velocity": 0.05, "stiffness": 1e6}],
        mesh={"elements": 20},
        excitation={"kind": "harmonic", "frequency": 200.0, "amplitude": 0.0},
        contact={"law": "penalty", "penalty_stiffness": 1e6},
        time={"steps_per_period": 1000, "periods": 1},
    )


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    levels, truths = (LEVELS, 400) if is_long else (LEVELS[:1], 60)
    x = np.arange(0.02, 0.39, 0.02)
    times, model = taps(plate(), "upper", x)
    sound, promise = lengths(model, times), "healthy plate not called (taps)"
    found = []
    for rig, factor in RIGS.items() if is_long else [(OWN, 1.0)]:
        modulus = factor * plate().lamina[0].young_modulus
        keys = {f"lamina.{name}.young_modulus": modulus for name in ("lower", "upper")}
        force = taps(plate().with_overrides(keys), "upper", x)[1]
        calls = 0
        for k, level in enumerate(levels):
            limit = limits(model, times, level, np.random.default_rng(k))
            rng = np.random.default_rng(SEED + k)
            for _ in range(truths):
                values = index(lengths(noisy(force, level, rng), times), sound)
                calls += bool(np.any(values > limit))
        n = truths * len(levels)
        found.append(Row(promise, rig, 1.0 - FALSE_CALLS, n - calls, n, at_least=True))
    return found

"""`detect tap`: healthy plates.

The plate of `docs/examples/tap.py` without its delamination, tapped at 19 points with noise of 40,
30 and 20 dB below the largest force of each tap.

The plate of `docs/examples/tap.py` without its delamination, with 20 elements, tapped at 19 points
with noise of 40, 30 and 20 dB below the largest force of each tap. Each level has one limit, as the
command has, and its records have noise of their own. Other rigs are judged beside the taps of the
model. Where the noise differs from point to point, the command is told its rms over the points.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.studies.detection.indices import FALSE_CALLS
from delam_fem.studies.detection.tap import index, lengths, limits, noisy, taps
from delam_fem.studies.identification.unknowns import of_rig

LEVELS = (40.0, 30.0, 20.0)
"""Noise [dB]."""
NOISY = "noise differs from point to point (log-normal, σ 0.7)"
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
    sound = lengths(model, times)
    promise = "healthy plate not called (taps)"
    result = []
    for rig, keys in (rigs() if is_long else {OWN: {}}).items():
        force = taps(plate().with_overrides(keys), "upper", x)[1]
        calls = 0
        for k, level in enumerate(levels):
            limit = limits(model, times, level, np.random.default_rng(k))
            rng = np.random.default_rng(SEED + k)
            for _ in range(truths):
                size = np.exp(0.7 * (rig == NOISY) * rng.standard_normal(x.size))
                noise_level = level - 20.0 * np.log10(size / np.sqrt(np.mean(size**2)))
                values = index(lengths(noisy(force, noise_level, rng), times), sound)
                calls += bool(np.any(values > limit))
        n = truths * len(levels)
        result.append(Row(promise, rig, 1.0 - FALSE_CALLS, n - calls, n, at_least=True))
    return result


def rigs() -> dict[str, dict[str, float]]:
    """Return the keys of each rig."""
    lamina = plate().lamina[0]
    clamp = 2.0 * of_rig(plate())[-1].low  # k L/EI = 100

    def every(key: str, factor: float) -> dict[str, float]:
        return {
            f"lamina.{plate_lamina.name}.{key}": factor * getattr(lamina, key)
            for plate_lamina in plate().lamina
        }

    return {
        OWN: {},
        "EI + 5 %": every("young_modulus", 1.05),
        "EI − 5 %": every("young_modulus", 0.95),
        "soft clamps (k L/EI = 100)": {"support.rotational_stiffness": clamp},
        "damping × 2": every("damping_ratio", 2.0),
        "damping × ½": every("damping_ratio", 0.5),
        "40 elements, not 20": {"mesh.elements": 40},
        NOISY: {},
    }  # fmt: skip

"""`detect scan`: ends of a delamination.

Delaminations of `embedded` from the prior of `infer`, at 60 to 400 Hz, scanned every 10 mm with 40
dB. Those that are called count.

Delaminations of `embedded` from the prior of `infer`, each at a frequency drawn from 60 to 400 Hz,
scanned every 10 mm with 40 dB. Those that are called count. Where the noise differs from point to
point, that of each is estimated from 14 lines.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from calibration.infer import N_LINES, SHAKER, rigs, shaken
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.api import FloatArray, statistics
from delam_fem.studies.detection.detect import drive_responses, intact
from delam_fem.studies.detection.indices import CONFIDENCE, mark, repeated
from delam_fem.studies.detection.infer import prior_of
from delam_fem.studies.detection.population import Population, Specimen, population
from delam_fem.studies.signals.scan import Shapes, surface_of

NOISE_DB, REPETITIONS, TRUTHS = 40.0, 60, 250
NOISY = "noise differs from point to point (log-normal, σ 0.7)"


def scanned(
    rig: str, runs: Population, k: int, drive: dict[float, FloatArray], rng: np.random.Generator
) -> Shapes:
    """Return the shapes of one structure as a rig shows them, without those of the drive."""
    noise, lines = (
        (NOISE_DB + rng.normal(0.0, 6.0, runs.x.size), N_LINES)
        if rig == NOISY
        else (NOISE_DB, np.inf)
    )
    shapes = runs.shapes(k, noise, rng, lines)
    return (shaken(shapes, drive, rng) if rig == SHAKER else shapes).without_drive(drive)


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    case = df.preset("embedded")
    result = []
    intact_case = intact(case)
    surface = surface_of(case, None)
    *others, _ = rigs(case, TRUTHS)  # the last has the noise of `infer`
    every = rigs(case, TRUTHS) | {OWN: {}, NOISY: {}}
    for number, rig in enumerate((*others, NOISY)):
        n = TRUTHS if is_long else 6 * (rig in (OWN, SHAKER))
        if not n:
            continue
        rng = np.random.default_rng([9, number] if rig == OWN else [19, number])
        specimens = [
            Specimen(middle - 0.5 * length, middle + 0.5 * length, depth, "clamped", frequency)
            for (middle, length, depth), frequency in zip(
                statistics.uniform(prior_of(case), n, (200 if rig == OWN else 300) + number),
                rng.uniform(60.0, 400.0, n),
                strict=True,
            )
        ]
        rig_values = {key: values[:n] for key, values in every[rig].items()}
        runs = population(
            case, specimens, folder / f"rig-{number}", "serial", also=rig_values, resume=True
        )
        inside = np.zeros((0, 2), dtype=bool)
        widths = []
        for k in np.flatnonzero(np.isfinite(runs.rms)).tolist():
            drive = drive_responses(intact_case, surface, runs.x, specimens[k].frequency, (2.0,))
            shapes = scanned(rig, runs, k, drive, rng)
            if not mark("curvature", shapes).is_detected:
                continue
            again = repeated("curvature", shapes, shapes.noise, repetitions=REPETITIONS)
            bounds = np.array([again.start, again.end])
            truth = np.array([specimens[k].start, specimens[k].end])
            inside = np.vstack([inside, (bounds[:, 0] <= truth) & (truth <= bounds[:, 1])])
            widths.append(bounds[:, 1] - bounds[:, 0])
        middle = 1e3 * np.median(widths, axis=0)
        for j, name in enumerate(("start", "end")):
            note = f"{len(inside)} of {n} called; median width {middle[j]:.0f} mm"
            row = Row(
                f"bounds of the {name}", rig, CONFIDENCE, int(inside[:, j].sum()), len(inside)
            )
            result.append(Row(**vars(row) | {"note": note}))
    return result

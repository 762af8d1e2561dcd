"""`detect`: bounds of the ends of a delamination.

Delaminations of `embedded` from the prior of `infer`, each at a frequency drawn from 60 to 400 Hz,
scanned every 10 mm with 40 dB. Those that are called count.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from calibration.infer import rigs
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.results.scan import surface_of
from delam_fem.studies.detection.detect import drive_responses, intact
from delam_fem.studies.detection.indices import CONFIDENCE, mark, repeated
from delam_fem.studies.detection.infer import Prior
from delam_fem.studies.detection.population import Specimen, population

NOISE_DB, REPETITIONS = 40.0, 60


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    case, found = df.preset("embedded"), []
    whole, surface = intact(case), surface_of(case, None)
    every = rigs(case, 250) | {OWN: {}}
    for number, (rig, keys) in enumerate(every.items()):
        n = (250 if rig == OWN else 40) if is_long else (6 if rig == OWN else 0)
        if not n or (rig != OWN and not keys):  # noise and shaker are those of healthy plates
            continue
        rng = np.random.default_rng([9, number])
        specimens = [
            Specimen(middle - 0.5 * length, middle + 0.5 * length, depth, "clamped", frequency)
            for (middle, length, depth), frequency in zip(
                Prior.of(case).sample(n, 200 + number), rng.uniform(60.0, 400.0, n), strict=True
            )
        ]
        own = {key: values[:n] for key, values in keys.items()}
        runs = population(
            case, specimens, folder / f"rig-{number}", "serial", also=own, resume=True
        )
        inside, widths = np.zeros((0, 2), dtype=bool), []
        for k in filter(runs.is_there, range(n)):
            drive = drive_responses(whole, surface, runs.x, specimens[k].frequency, (2.0,))
            shapes = runs.shapes(k, NOISE_DB, rng).without_drive(drive)
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
            found.append(Row(**vars(row) | {"note": note}))
    return found

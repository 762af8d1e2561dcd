"""`detect excite`: recommended frequency.

Delaminations of `embedded` from the prior of `infer`. The command maps 100, 120 … 300 Hz with 40
dB; a scan at the frequency that it recommends is called or not.

Delaminations of `embedded` from the prior of `infer`. The command maps 100, 120 … 300 Hz with
40 dB; a scan at the frequency that it recommends, with noise of its own, is called or not. Where
nothing is recommended, a truth is undecided. The note has the index of these scans over the ratio
that the command prints, the smallest at the frequency and its two neighbours: the range of 90 % of
them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from calibration.ends import NOISE_DB, NOISY, scanned
from calibration.infer import rigs
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.api import FloatArray, statistics
from delam_fem.studies.detection.detect import drive_responses, intact
from delam_fem.studies.detection.excitation import SURE, ExcitationMap, excitation_map
from delam_fem.studies.detection.indices import mark
from delam_fem.studies.detection.infer import prior_of
from delam_fem.studies.detection.population import Specimen, population
from delam_fem.studies.signals.scan import surface_of

TRUTHS = 200
FREQUENCIES = np.linspace(100.0, 300.0, 11)
BETWEEN = "at another frequency, between the neighbours"


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    case = df.preset("embedded")
    truths = TRUTHS if is_long else 4
    *others, _ = rigs(case, truths)  # the last has the noise of `infer`
    rng = np.random.default_rng(61)
    delaminations = statistics.uniform(prior_of(case), truths, 500)
    maps = [mapped(one, folder / f"map-{k}") for k, one in enumerate(delaminations)]
    known = [k for k, map_ in enumerate(maps) if map_.recommended is not None]
    best = [maps[k].recommended for k in known]
    said = np.array([maps[k].worst[at] for k, at in zip(known, best, strict=True)])
    frequencies = FREQUENCIES[[number for _, number in best]]
    every = rigs(case, len(known)) | {OWN: {}}
    result = []
    for number, rig in enumerate((*others, NOISY, BETWEEN) if is_long else (OWN,)):
        step = (rig == BETWEEN) * np.diff(FREQUENCIES)[0]
        at = frequencies + step * rng.uniform(-1.0, 1.0, len(known))
        over = ratios(
            rig, delaminations[known], at, every.get(rig, {}), folder / f"rig-{number}", rng
        )
        low, high = np.quantile(over / said, [0.05, 0.95])
        result.append(
            Row("scan at the recommended frequency is called", rig, SURE, int((over > 1.0).sum()),
                truths, truths - len(known), at_least=True, note=f"{low:.2f} … {high:.2f} times")
        )  # fmt: skip
    return result


def mapped(one: FloatArray, folder: Path) -> ExcitationMap:
    """Return the map of a delamination."""
    middle, length, depth = one.tolist()
    case = df.preset("embedded")
    surface = surface_of(case, None)
    other = next(lamina.name for lamina in case.lamina if lamina.name != surface)
    total = sum(lamina.thickness for lamina in case.lamina)
    keys = {
        "delamination.1.start": middle - 0.5 * length, "delamination.1.end": middle + 0.5 * length,
        f"lamina.{surface}.thickness": depth, f"lamina.{other}.thickness": total - depth,
        "mesh.elements": 20,
    }  # fmt: skip
    return excitation_map(
        case.with_overrides(keys), FREQUENCIES, folder, "serial", noise_db=NOISE_DB, resume=True
    )


def ratios(
    rig: str, given: FloatArray, frequencies: FloatArray, also: dict[str, FloatArray],
    folder: Path, rng: np.random.Generator,
) -> FloatArray:  # fmt: skip
    """Return the largest index over its limit of a scan of each structure, shape (n,)."""
    case = df.preset("embedded")
    intact_case = intact(case)
    surface = surface_of(case, None)
    specimens = [
        Specimen(middle - 0.5 * length, middle + 0.5 * length, depth, "clamped", frequency)
        for (middle, length, depth), frequency in zip(given, frequencies, strict=True)
    ]
    runs = population(case, specimens, folder, "serial", also=also, resume=True)
    result = []
    for k, specimen in enumerate(specimens):
        drive = drive_responses(intact_case, surface, runs.x, specimen.frequency, (2.0,))
        shapes = scanned(rig, runs, k, drive, rng)
        result.append(float(mark("curvature", shapes).over_limits.max()))
    return np.array(result)

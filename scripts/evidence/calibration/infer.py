"""`detect infer`.

Scans of `embedded` with other delaminations at 92 and 250 Hz, 40 dB. Stiffness (± 10 %), damping (×
½ … × 2) and clamps of the table of structures are drawn, too.

Scans of `embedded` with other delaminations at 92 and 250 Hz, 40 dB, and a table of structures from
the prior, whose stiffness (± 10 %), damping (× ½ … × 2) and clamps (k L/EI from 50 to 5000) are
drawn, too. *As modelled*: truths are drawn as the table is. The note has the median width and that
of the prior, both of 90 %, and at how many truths the program says that the scans are like those of
no simulation.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.api import Case, FloatArray, statistics
from delam_fem.studies.detection import infer
from delam_fem.studies.detection.detect import drive_responses, intact
from delam_fem.studies.detection.population import Population, population
from delam_fem.studies.detection.study import Infer
from delam_fem.studies.identification.unknowns import drawn, of_rig
from delam_fem.studies.signals.scan import surface_of

NOISE_DB, LOUD_DB, N_LINES = 40.0, 30.5, 14
"""Noise of most scans, that of the noisy ones (3 %) [dB], lines from which it is estimated."""
LEVEL, TRUTHS = 0.9, 200
MESH = "40 elements, not 20"
NOISY = "noise 3 %, differs from point to point (log-normal, σ 0.7)"
SHAKER = "shaker with 1 % of second harmonic"


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    size = 1000 if is_long else 100
    case = df.preset("embedded")
    prior = infer.prior_of(case)
    parameters = statistics.uniform(prior, size, 7)
    table = computed(case, parameters, folder / "table", drawn(of_rig(case), case, size, 8))
    known = known_of(case, table, parameters, prior)
    wide = np.subtract(
        *np.quantile(infer.edges(statistics.uniform(prior, 9999, 1)), [0.95, 0.05], axis=0)
    )
    result = []
    for number, (rig, keys) in enumerate(rigs(case, TRUTHS).items()):
        n = TRUTHS if is_long else 4 * (rig in (OWN, SHAKER))
        if not n:
            continue
        true_parameters = statistics.uniform(prior, n, (100 if rig == OWN else 400) + number)
        also = {key: values[:n] for key, values in keys.items()}
        runs = computed(case, true_parameters, folder / f"rig-{number}", also)
        rng = np.random.default_rng([6 if rig == OWN else 16, number])
        complete = np.flatnonzero(np.isfinite(runs.rms.reshape(2, n)).all(axis=0)).tolist()
        noise = NOISE_DB
        lines = np.inf
        judge = known
        if rig == NOISY:  # the table has the noise that the first of the scans shows
            noise = LOUD_DB + rng.normal(0.0, 6.0, runs.x.size)
            lines = N_LINES
            sensors = tuple(
                infer.ScanNoise.of(
                    runs.shapes(i, noise, rng, lines), float(runs.rms[i]), sensor.drive
                )
                for i, sensor in zip((0, n), known.sensors, strict=True)
            )
            judge = infer.simulation_table(table, parameters, prior, sensors)
        judged = []
        for k in complete:
            scans = tuple(runs.shapes(i, noise, rng, lines) for i in (k, n + k))
            if rig == SHAKER:
                scans = tuple(
                    map(shaken, scans, [sensor.drive for sensor in judge.sensors], [rng, rng])
                )
            interval = infer.edge_posterior(judge.posterior(scans)).interval(LEVEL)
            judged.append((interval, judge.mismatch(scans) is not None))
        bounds = np.array([b for b, _ in judged])
        warned = sum(w for _, w in judged)
        true = infer.edges(true_parameters)[complete]
        for j, name in enumerate(infer.NAMES):
            low, high = bounds[:, j].T
            width = 1e3 * np.median(high - low)
            note = f"{width:.3g} of {1e3 * wide[j]:.3g} mm; {warned} named"
            hits = int(np.sum((true[:, j] >= low) & (true[:, j] <= high)))
            promise = f"{name}, 90 % interval"
            result.append(Row(promise, rig, LEVEL, hits, len(complete), warned=warned, note=note))
    return result


def rigs(case: Case, n: int) -> dict[str, dict[str, FloatArray]]:
    """Return the values of the keys that each rig has and the case has not."""
    modulus, ratio = case.lamina[0].young_modulus, case.lamina[0].damping_ratio
    clamp = of_rig(case)[-1].low * 2.0  # k L/EI = 100

    def every(key: str, value: float) -> dict[str, FloatArray]:
        return {f"lamina.{lamina.name}.{key}": np.full(n, value) for lamina in case.lamina}

    return {
        OWN: drawn(of_rig(case), case, n, 9),
        "EI + 5 %": every("young_modulus", 1.05 * modulus),
        "EI − 5 %": every("young_modulus", 0.95 * modulus),
        "soft clamps (k L/EI = 100)": {"support.rotational_stiffness": np.full(n, clamp)},
        "damping × 2": every("damping_ratio", 2.0 * ratio),
        "damping × ½": every("damping_ratio", 0.5 * ratio),
        MESH: {"mesh.elements": np.full(n, 40)},
        SHAKER: {},
        NOISY: {},
    }  # fmt: skip


def computed(
    case: Case, parameters: FloatArray, folder: Path, also: dict[str, FloatArray]
) -> Population:
    """Return the scans of structures at both frequencies."""
    specimens = infer.specimens_of(parameters, "clamped", Infer().frequency)
    both = {key: np.tile(values, 2) for key, values in also.items()}
    return population(case, specimens, folder, "serial", also=both, resume=True)


def known_of(
    case: Case, table: Population, parameters: FloatArray, prior: FloatArray
) -> infer.SimulationTable:
    """Return what a table says with the usual noise."""
    intact_case = intact(case)
    surface = surface_of(case, None)
    sensors = tuple(
        infer.ScanNoise(NOISE_DB, drive=drive_responses(intact_case, surface, table.x, f, (2.0,)))
        for f in Infer().frequency
    )
    return infer.simulation_table(table, parameters, prior, sensors)


def shaken(scan: infer.Shapes, drive: dict, rng: np.random.Generator) -> infer.Shapes:
    """Return a scan with what 1 % of second harmonic of the base acceleration adds to it."""
    omega = 2.0 * np.pi * scan.frequency
    base = 0.01 * 0.1 / (2.0 * omega) ** 2  # m, of 0.1 m/s2
    added = base * 2j * omega * np.exp(2j * np.pi * rng.uniform()) * drive[2.0]
    scan.values[scan.orders.index(2.0)] += added
    return scan

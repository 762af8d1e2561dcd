"""`identify keys`: clapping motions.

The rig and the four unknowns of [identification](../identification.md): `paper`, 10 elements, 300
steps per period, tips at 1.25 and 3.25 Hz with noise of 0.1 mm, 1,000 simulations.

The rig and the four unknowns of [identification](../identification.md): `paper`, 10 elements, 300
steps per period, tips at 1.25 and 3.25 Hz with noise of 0.1 mm, 1,000 simulations. The stiffness of
the thick lamina is drawn within ± 10 %, and what four times as many steps and twice as many
elements change is added in part.
*As modelled*: the simulations of the table, 200 after 200 left out of it. The note has the median
width, that of the prior (both of 90 %), and at how many truths the program says that the motions
are like those of no simulation. Damping is sought itself, from half to twice that of the preset.
Laminae that are apart have rigid clamps: `support.rotational_stiffness` is that of bonded beams.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from calibration.overlay import shaken
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.api import FloatArray, beams, statistics
from delam_fem.studies.identification import identify
from delam_fem.studies.identification.identify import Experiment, mismatch
from delam_fem.studies.identification.unknowns import Unknown, drawn, of_rig

CASE = {
    "time.mass": "lumped",
    "mesh.elements": 10,
    "time.steps_per_period": 300,
    "time.periods": 120,
}
UNKNOWNS = (
    Unknown("gap.exponent", 1.0, 3.0),
    Unknown("contact.restitution", 0.0, 0.8),
    Unknown("lamina.*.damping_ratio", 0.004, 0.016),
    Unknown("lamina.thin.bending_stiffness", 0.14, 0.18),
)
LEVEL = 0.9
TRUTHS = 200
TURN = 2.0 * np.pi
THICK = "lamina.thick.bending_stiffness"
STEPS = "time.steps_per_period"
EXACT = "the case itself"
RECORD = "the case itself, from records of the tips"
NOISY = "noise differs between tips (log-normal, σ 0.7)"
SHAKER = "shaker with 1 % of second harmonic"
RIGS: dict[str, dict[str, float]] = {
    EXACT: {},
    RECORD: {},
    "EI of the thick lamina + 5 %": {THICK: 1.05 * 1.51},
    "EI of the thick lamina − 5 %": {THICK: 0.95 * 1.51},
    "2,400 steps per period, towards the rigid limit": {STEPS: 2400},
    "20 elements, not 10": {"mesh.elements": 20},
    "40 elements, not 10": {"mesh.elements": 40},
    "EI of the thick lamina + 20 %, beyond the prior": {THICK: 1.2 * 1.51},
    NOISY: {},
    SHAKER: {},
}
"""Keys of each rig."""


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    size, repeated, left_out, most = (1000, 100, 200, 1000) if is_long else (120, 6, 20, 20)
    rig = df.preset("paper", CASE)
    experiment = Experiment(rig, (1.25, 3.25), UNKNOWNS, 1e-4, uncertain=of_rig(rig))
    parameters = statistics.uniform(experiment.bounds, size, 1)
    also = drawn(experiment.uncertain, experiment.case, size, 2)
    exact = experiment.simulate(parameters, folder / "table", also=also, executor="serial")
    more = {key: values[:repeated] for key, values in also.items()}
    more |= identify.refined_overrides(experiment.case, repeated)
    finer = experiment.simulate(
        parameters[:repeated], folder / "finer", also=more, executor="serial"
    )
    full_table = experiment.table(exact, parameters, 3, finer)
    part = np.arange(len(full_table.parameters)) // left_out  # 20 truths of a short form are enough
    partial_tables = [
        statistics.Simulations(
            full_table.parameters[part != k], full_table.statistics[part != k], full_table.bounds
        )
        for k in range(part[-1] + 1)
    ]
    own_tables = [partial_tables[k] for k in part[:most]]
    result = judged(
        OWN, experiment, own_tables, full_table.parameters[:most], full_table.statistics[:most]
    )
    for number, (rig, keys) in enumerate(RIGS.items() if is_long else ()):
        truths = statistics.uniform(experiment.bounds, TRUTHS, 100 + number)
        rng = np.random.default_rng([17, number])
        tables = [full_table] * TRUTHS
        if rig == RECORD:
            every = [recorded(experiment, truth, k) for k, truth in enumerate(truths)]
            observations = np.stack([values for values, _ in every])
            noise = tuple(np.median([noise for _, noise in every], axis=0).tolist())
            tables = [replace(experiment, noise=noise).table(exact, parameters, 3, finer)] * TRUTHS
        elif rig == SHAKER:
            motions = np.stack([distorted(experiment, truth, rng) for truth in truths])
            observations = observed(identify.noisy(motions, experiment.error, rng))
        else:
            more = {key: np.full(TRUTHS, value) for key, value in keys.items()}
            motions = experiment.simulate(
                truths, folder / f"rig-{number}", also=more, executor="serial"
            )
            sizes = np.ones((*motions.shape[:3], 1))
            if rig == NOISY:  # a table has the noise that its record shows
                sizes = np.exp(0.7 * rng.standard_normal(sizes.shape))
                noises = np.max(experiment.noise) * np.sqrt((sizes**2).mean(axis=(2, 3))).max(
                    axis=1
                )
                tables = [
                    replace(experiment, noise=noise).table(exact, parameters, 3, finer)
                    for noise in noises.tolist()
                ]
            observations = observed(identify.noisy(motions, experiment.error * sizes, rng))
        result += judged(rig, experiment, tables, truths, observations)
    return result


def observed(motions: beams.ComplexArray) -> FloatArray:
    """Return the statistics of motions, shape (n, n_statistics)."""
    return identify.invariant(motions).reshape(len(motions), -1)


def recorded(given: Experiment, truth: FloatArray, number: int) -> tuple[FloatArray, FloatArray]:
    """Return the statistics of records of the tips with noise, and the noise of each tip [m]."""
    rng = np.random.default_rng([18, number])
    motions = []
    noises = []
    for frequency in given.frequencies:
        time, tips = moved(given, truth, frequency, 0.0, 0.0)
        tips = tips + given.noise * rng.standard_normal(tips.shape)
        harmonics, noise = identify.of_history(0.07 + time, tips, frequency)
        motions.append(harmonics)
        noises.append(noise)
    return observed(np.stack(motions)[None])[0], np.max(noises, axis=0)


def distorted(given: Experiment, truth: FloatArray, rng: np.random.Generator) -> beams.ComplexArray:
    """Return the harmonics of motions under a base with a second harmonic of any phase [m]."""
    amplitudes = []
    for frequency in given.frequencies:
        time, tips = moved(given, truth, frequency, 0.01, rng.uniform(0.0, TURN))
        amplitudes.append(identify.of_history(time, tips, frequency)[0])
    return np.stack(amplitudes)


def moved(
    given: Experiment, truth: FloatArray, frequency: float, shaker: float, phase: float
) -> tuple[FloatArray, FloatArray]:
    """Return times, from any origin [s], and tips [m] of a case with values of the unknowns."""
    keys = {key: value for unknown, value in zip(given.unknowns, truth.tolist(), strict=True)
            for key in unknown.keys(given.case)}  # fmt: skip
    case = given.case.with_overrides(keys | {"excitation.frequency": frequency})
    tips = shaken(case, shaker, phase)
    return case.time_step * np.arange(tips.shape[1]), tips


def judged(
    rig: str,
    given: Experiment,
    tables: list[statistics.Simulations],
    truths: FloatArray,
    seen: FloatArray,
) -> list[Row]:
    """Return a row for each unknown."""
    complete = np.flatnonzero(np.isfinite(seen).all(axis=1))
    bounds = np.stack([tables[k].posterior(seen[k]).interval(LEVEL) for k in complete])
    warned = sum(mismatch(given, tables[k], seen[k]) is not None for k in complete)
    inside = (truths[complete] >= bounds[..., 0]) & (truths[complete] <= bounds[..., 1])
    widths = np.median(bounds[..., 1] - bounds[..., 0], axis=0)
    return [
        Row(
            f"{unknown.key}, 90 % interval", rig, LEVEL, int(inside[:, j].sum()), complete.size,
            warned=warned,
            note=f"{widths[j]:.2g} of {LEVEL * (unknown.high - unknown.low):.2g}; {warned} named",
        )
        for j, unknown in enumerate(given.unknowns)
    ]  # fmt: skip

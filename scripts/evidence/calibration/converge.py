"""`converge`: distance from the limit.

Two strips, drawn, under a harmonic base. The truth is the distance from a run with eight times as
many steps, or four times as many elements, as the finest of the study.

Two strips under a harmonic base, of a length, stiffness, damping, restitution and frequency
that are drawn for each truth. A study of 250 … 2000 steps per period (10 elements) or of 4 … 16
elements (1000 steps) gives each of its runs an interval for the distance of its tip extremes, or of
the numbers named with `--judge`, from the limit. The truth is the distance from a run that the
study does not have: with eight times as many steps, or four times as many elements, as its finest.
"Undecided": errors do not shrink within the study, so that no interval is given. What is left
beyond the finest run is a bound, so that 95 % are promised at least. Contact work and distortion
factors had intervals that contained 28 of 67 and 165 of 189 truths in steps: none is given.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.api import Case
from delam_fem.studies.convergence.analysis import Convergence
from delam_fem.studies.convergence.level import compute
from delam_fem.studies.convergence.refinement import RefinementStudy, method

TRUTHS = 100
PROMISE = 0.95
LAMINAE = ("thick", "thin")
LAW = "newton@moreau-jean"
KINDS = {
    "steps": ((10,), (250, 500, 1000, 2000), 16000),
    "elements": ((4, 6, 8, 12, 16), (1000,), 64),
}
"""Meshes and steps of a study, and the size of the run that it does not have."""
JUDGED = {
    "": (), " of amplitude": ("amplitude",), " of modal_impulse": ("modal_impulse",),
}  # fmt: skip
"""What is judged, in words and by name."""


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    truths = TRUTHS if is_long else 1
    result = []
    for number, by in enumerate(KINDS):
        rng = np.random.default_rng([11, number])
        trials = [_trial(by, rng) for _ in range(truths)]
        for words in JUDGED:
            ends = [end for trial in trials for end in trial[words]]
            known = [end for end in ends if math.isfinite(end[1])]
            inside = sum(bool(abs(truth - away) <= left) for away, left, truth in known)
            width = float(np.median([100.0 * left for _, left, _ in known])) if known else math.nan
            result.append(
                Row(f"distance{words} from the limit in {by}", OWN, PROMISE, inside, len(ends),
                    len(ends) - len(known), note=f"median ± {width:.2g} %", at_least=True)
            )  # fmt: skip
    return result


def drawn(rng: np.random.Generator) -> Case:
    """Return two strips that clap."""
    length = rng.uniform(0.4, 0.7)
    damping = float(np.exp(rng.uniform(*np.log([0.004, 0.02]))))
    values = {"length": length, "damping_ratio": damping}
    return df.preset(
        "default",
        {
            **{f"lamina.{name}.{key}": value for name in LAMINAE for key, value in values.items()},
            "lamina.thin.bending_stiffness": rng.uniform(0.1, 0.8),
            "contact.restitution": rng.uniform(0.0, 0.6),
            "excitation.frequency": rng.uniform(2.0, 6.0) * (0.685 / length) ** 2,
        },
    )


def _trial(by: str, rng: np.random.Generator) -> dict[str, list[tuple[float, float, float]]]:
    """Return distance, uncertainty and true distance of the judged runs of a study by what is."""
    meshes, steps, finer = KINDS[by]
    refinement = RefinementStudy(drawn(rng), (method(LAW),), meshes, steps, 30, 0)
    law = refinement.methods[0]
    mesh = meshes[0]
    if by == "steps":
        line = refinement.along_steps(law, mesh)
        truth = refinement.level(law, mesh, finer)
    else:
        line = refinement.along_meshes(law, steps[0])
        truth = refinement.level(law, finer, steps[0])
    results = {level.key: compute(level, "compiled") for level in (*line, truth)}
    judges = {
        words: Convergence(replace(refinement, judged=names), results)
        for words, names in JUDGED.items()
    }
    return {
        words: [
            (*judge.interval(level, line, by), judge.error(level, truth)) for level in line[:-2]
        ]
        for words, judge in judges.items()
    }

"""`run`: settled or not.

`default` with 10 elements, 400 steps per period and a soft contact, at 2.6 to 3.9 Hz. The verdict
after 300 periods is beside what the same run does from period 1500 to 3000.

The preset `default` with 10 elements, 400 steps per period and a soft contact (k = 100 N/m), which
clap in tori, periods 1 to 10 and without any period, at frequencies from 2.6 to 3.9 Hz. The verdict
is that after 300 periods; the truth is what the same run does from period 1500 to 3000: the
smallest P up to 8 about whose mean phases both tips stay within 7 % (rms), and about no multiple of
it within half of that. "Not settled" counts as undecided. Of an irregular motion the mean smallest
or largest displacement of one of the tips, by turns, is judged beside that of the same 1500
periods, whose own error is left out. The other rigs are laminae with other stiffness or damping,
and pairs on another mesh, at 200 other frequencies of this range.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from calibration.row import Row

import delam_fem as df
from delam_fem.api import FloatArray, assemble, decay_of, session_of, statistics, verdict_of

FIRST, LAST = 300, 3000
SOFT = {
    "contact.law": "penalty@newmark", "contact.penalty_stiffness": 100.0,
    "contact.penalty_damping": 0.05, "mesh.elements": 10, "time.refine": 1,
    "time.steps_per_period": 400, "output.fields_per_period": 0, "output.window_periods": 10,
    "time.periods": LAST,
}  # fmt: skip


def laminae(key: str, factor: float) -> dict[str, float]:
    """Return a key of both laminae, times a factor."""
    default_laminae = df.preset("default").lamina
    return {
        f"lamina.{lamina.name}.{key}": factor * getattr(lamina, key) for lamina in default_laminae
    }


RIG = "run ten times as long"
RIGS: dict[str, dict[str, float]] = {
    RIG: {},
    "EI + 5 %": laminae("bending_stiffness", 1.05),
    "EI − 5 %": laminae("bending_stiffness", 0.95),
    "damping × 2": laminae("damping_ratio", 2.0),
    "damping × ½": laminae("damping_ratio", 0.5),
    "20 elements, not 10": {"mesh.elements": 20},
}
LONG = {True: np.linspace(2.6, 3.9, 200).tolist(), False: np.linspace(2.603, 3.897, 200).tolist()}
"""Frequencies of the first rig, and of the others."""
SHORT = [2.7, 3.0, 3.25, 3.645]
STAYS, DOUBLED, MOST, MULTIPLES = 0.07, 0.014, 8, 4
"""Scatter of a period, scatter that needs no multiple, longest period, and multiples looked at."""
NOMINAL = 0.95


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return how often "settled" and "irregular" are right, and how often a mean is."""
    result = []
    for rig in RIGS if is_long else (RIG,):
        frequencies = LONG[rig == RIG] if is_long else SHORT
        verdicts = [verdict_and_truth(frequency, RIGS[rig]) for frequency in frequencies]
        for word in ("settled", "irregular"):
            hits = [P == true for said, P, true, _ in verdicts if said == word]
            waits = [
                (true is None) == (word == "irregular")
                for said, _, true, _ in verdicts
                if said == "not settled"
            ]
            truths = len(hits) + sum(waits)
            result.append(Row(f"`run`: {word}", rig, NOMINAL, sum(hits), truths, sum(waits)))
        means = [away[k % len(away)] for k, (said, _, _, away) in enumerate(verdicts)
                 if said == "irregular"]  # fmt: skip
        inside = sum(away <= 1.0 for away in means)
        result.append(Row("mean of an extreme, 95 % interval", rig, NOMINAL, inside, len(means)))
    return result


def verdict_and_truth(
    frequency: float, keys: dict[str, float]
) -> tuple[str, int | None, int | None, list[float]]:
    """Return what a run says, its period, the true one, and how far means are off.

    The means are those of the extremes of both tips, over half the widths of their intervals.
    """
    case = df.preset("default", {**SOFT, **keys, "excitation.frequency": frequency})
    structure = assemble(case, needs_dolfinx=False)
    with session_of(case, structure.operators, engine="compiled") as session:
        session.run()
        recorder = session.recorder
        decay = decay_of(case, structure) * case.period
        said = verdict_of(recorder, 2, decay, FIRST)
        extremes = recorder.envelope[:LAST, :, :2].reshape(LAST, 4).T
        middle, half = statistics.interval(
            statistics.block_means(extremes[:, FIRST - said.periods_judged : FIRST])
        )
        away = np.abs(extremes[:, LAST // 2 :].mean(axis=1) - middle) / half
        low, high = recorder.envelope[LAST // 2 :, 0, :2], recorder.envelope[LAST // 2 :, 1, :2]
        strobes = recorder.strobe[LAST // 2 : LAST, 0, :2]
    true = true_period(2.0 * strobes / (high.max(0) - low.min(0)))
    return said.word, said.periodicity, true, away.tolist()


def true_period(z: FloatArray) -> int | None:
    """Return the period of strobes of shape (n, 2) in half peak-to-peak amplitudes; None: none."""
    for P in range(1, MOST + 1):
        away = scatter(z, P)
        least = min(scatter(z, k * P) for k in range(2, MULTIPLES + 1))
        if away <= DOUBLED or (away <= STAYS and least > 0.5 * away):
            return P
    return None


def scatter(z: FloatArray, P: int) -> float:
    """Return the rms distance from P mean phases, of the tip that scatters more."""
    cut = z[: len(z) // P * P].reshape(-1, P, z.shape[1])
    return float(np.sqrt(((cut - cut.mean(axis=0)) ** 2).mean(axis=(0, 1)).max()))

"""`sweep`: Lyapunov exponent.

Oscillators with one stop, periodic and chaotic, 200 periods of 1000 steps; the truth is that of
4000 periods of exact flights. The sign is said if the exponent is more than two errors from 0.

Oscillators with one stop, x'' + x = cos ωt, x ≤ s, restitution e, drawn for each truth: periodic
motions and chaos. The program steps them with 1000 steps per period, and follows neighbouring
motions for 200 periods, as `record.lyapunov = 200` does. The truth is the growth of a difference
over 4000 periods of exact flights with the exact derivative of each impact, from the same state on.
The sign is said if the exponent is more than two errors from 0. Without what a larger distance
changes, 44 of 60 other truths lay within two errors. The other rigs have other oscillators, and
other steps or another distance of the motions than those of a usual sweep (`record.perturbation`).
With 0.3 %, 74 of 100 truths lay within two errors when the larger distance was twice that: both
motions hit in the same step. It is that of nine steps at least since; with three, 184 of 200 lay
within with 0.3 %, 175 with 1 %, and 174 with 500 steps per period. What the larger distance changes
counts one and a half times since 180 of these 200 lay within two errors with 500 steps; of 200
others 187 did before, and 191 do since.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from calibration.oscillator import forcing, journey, oscillator
from calibration.row import OWN, Row

from delam_fem.api import SCHEMES, Law, Span, session
from delam_fem.studies.sweeps.grid import Record
from delam_fem.studies.sweeps.point import Exponent, largest_exponent

RIGS = {
    OWN: (1000, Record().perturbation),
    "500 steps per period": (500, Record().perturbation),
    "4000 steps per period": (4000, Record().perturbation),
    "distance 1 %, not 3 %": (1000, 0.01),
    "distance 0.3 %": (1000, 0.003),
    "newton@moreau-jean": (1000, Record().perturbation),
}
"""Steps per period and distance of the motions."""
TRUTHS, SHORT = 200, 4
SETTLE, FOLLOW, LONG = 100, 200, 4000
BARS = 2.0
NOMINAL = 0.9545


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return how often the exponent lies within two errors, and its sign is right."""
    return [
        row
        for number, rig in enumerate(RIGS if is_long else (OWN,))
        for row in rows_of(rig, np.random.default_rng(37 if rig == OWN else 237 + number), is_long)
    ]


def rows_of(rig: str, rng: np.random.Generator, is_long: bool) -> list[Row]:
    """Return the rows of a rig."""
    drawn = (judged(rng, rig) for _ in itertools.count())
    # neither what stays on the stop nor what never meets it
    clapping = (pair for pair in drawn if math.isfinite(pair[1]) and pair[1] != 0.0)
    pairs = list(itertools.islice(clapping, TRUTHS if is_long else SHORT))
    known = [
        (exponent, exact) for exponent, exact in pairs if math.isfinite(exponent.value + exact)
    ]
    inside = sum(abs(exponent.value - exact) <= BARS * exponent.error for exponent, exact in known)
    sure = [
        (exponent, exact)
        for exponent, exact in known
        if abs(exponent.value) > BARS * exponent.error
    ]
    right = sum(exponent.value * exact > 0.0 for exponent, exact in sure)
    width = float(np.median([exponent.error for exponent, _ in known]))
    chaos = sum(exact > 0.0 for _, exact in known)
    return [
        Row(f"exponent ± {BARS:g} errors", rig, NOMINAL, inside, len(pairs),
            len(pairs) - len(known), at_least=True,
            note=f"median error {width:.2g} /s; {chaos} chaotic"),
        Row("its sign", rig, NOMINAL, right, len(pairs), len(pairs) - len(sure), at_least=True),
    ]  # fmt: skip


def judged(rng: np.random.Generator, rig: str) -> tuple[Exponent, float]:
    """Return what the program finds for an oscillator, and the exact exponent."""
    steps, perturbation = RIGS[rig]
    omega = rng.uniform(2.1, 3.3)
    s = rng.uniform(-0.1, 0.05)
    e = rng.uniform(0.5, 0.9)
    T = 2.0 * math.pi / omega
    operators = oscillator(s)
    table = forcing(omega, 0.0)(T / steps * np.arange(steps + 1))
    span = Span(T / steps, steps, SETTLE, limit=1e6)
    law = Law("newton", restitution=e)
    scheme = SCHEMES["moreau-jean" if "moreau-jean" in rig else "newmark"]
    with session(operators, law, scheme, lambda period: table, span, engine="compiled") as opened:
        opened.run()
        x, v = opened.engine.state().motion[:2, 0].tolist()
        exponent = largest_exponent(
            opened, operators, direction=np.ones(1), period=T, periods=FOLLOW,
            perturbation=perturbation,
        )  # fmt: skip
    start = journey(min(x, s - 1e-9), v, omega, s, e, SETTLE)[:2]
    return exponent, journey(*start, omega, s, e, LONG)[2] / (LONG * T)

"""`detect pod`: a90/95.

Hits drawn from known curves of detection, at eight lengths of 15 structures each. a90: the length
from which 90 % are detected. *As modelled*: the logit is linear in ln a.

Hits drawn from curves of detection that are known, at the eight lengths of the grid, 15 structures
each. The true a90 lies at 0.06 … 0.3 of the beam or near it. *As modelled*: the logit is linear in
ln a, as the regression has it. The other rigs have curves of another form; in the last they differ
by depth, and a90 is that of all depths together. Where the regression has no solution the truth is
undecided. Which structures are counted as hits is the matter of the tables on `detect`.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from calibration.row import OWN, Row
from scipy.optimize import brentq
from scipy.special import expit
from scipy.stats import norm

from delam_fem.api import FloatArray
from delam_fem.studies.detection.population import DEPTHS, LENGTHS, MIDDLES, logistic

NOMINAL = 0.95
LEVEL = 0.90
TRUTHS = (400, 12)
RIGS = (OWN, "probit in a", "three depths, a90 × ⅔ … 1½ apart")


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return how often the bound lies above the true length."""
    return [row_of(number, TRUTHS[not is_long]) for number in range(len(RIGS))]


def row_of(number: int, truths: int) -> Row:
    """Return the row of a rig."""
    rng = np.random.default_rng([43, number])
    lengths = np.repeat(LENGTHS, len(DEPTHS) * len(MIDDLES))
    each = np.tile(np.repeat(np.arange(len(DEPTHS)), len(MIDDLES)), len(LENGTHS))
    ratios = []
    for _ in range(truths):
        middle = np.exp(rng.uniform(*np.log([0.06, 0.3])))
        slope = rng.uniform(2.0, 8.0)
        share = partial(chances, a90=middle, slope=slope, number=number)
        true = brentq(lambda a, f=share: f(np.array([a])).mean() - LEVEL, 1e-3, 10.0)
        hit = rng.uniform(size=lengths.size) < share(lengths)[each, np.arange(lengths.size)]
        ratios.append(logistic(lengths, hit).length(LEVEL, NOMINAL) / true)
    known = np.array([ratio for ratio in ratios if np.isfinite(ratio)])
    return Row(
        "a90 ≤ a90/95", RIGS[number], NOMINAL, int((known >= 1.0).sum()), truths,
        truths - known.size, at_least=True, note=f"median a90/95 over a90: {np.median(known):.2f}",
    )  # fmt: skip


def chances(a: FloatArray, a90: float, slope: float, number: int) -> FloatArray:
    """Return the probability of detection of lengths at each depth, shape (n_depths, n)."""
    factors = np.array([2.0 / 3.0, 1.0, 1.5] if number == 2 else [1.0] * len(DEPTHS))[:, None]
    if number == 1:
        return norm.cdf(norm.ppf(LEVEL) + 0.4 * slope * (a / a90 * factors - 1.0))
    return expit(np.log(9.0) + slope * np.log(a / a90 * factors))

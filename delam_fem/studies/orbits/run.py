"""Find the periodic orbit of a case.

In Python:

    import delam_fem as df
    found = df.orbit(df.preset("paper", {"excitation.frequency": 3.5}))
    found.stability, found.numbers["multipliers"]
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.orbits.ensemble import Perturbations
from delam_fem.studies.orbits.family import FREQUENCY
from delam_fem.studies.orbits.kept import KeptCaseMap
from delam_fem.studies.orbits.models import Model, map_of, usual
from delam_fem.studies.orbits.protocol import PeriodMap
from delam_fem.studies.orbits.result import Orbit
from delam_fem.studies.orbits.search import (
    RESETTLE,
    SETTLE,
    coarse_orbit,
    exact_orbit,
    mean_of_motion,
    settled,
    settled_map,
)

MOST_PERIODS = 64
"""Largest period of an orbit, in periods of the drive."""


def orbit(
    case: Case,
    *,
    periods: int = 1,
    settle: int = SETTLE,
    perturbations: Perturbations | None = None,
    model: Model = "full",
    modes: int | None = None,
    refine: int | None = None,
    map_: PeriodMap | None = None,
    start: FloatArray | None = None,
    kept: Path | None = None,
) -> Orbit:
    """Find the orbit near where the motion of a case settles, and judge its stability.

    The mean of the settled motion is where the search starts, so that an unstable orbit in the
    middle of a motion that it has lost its stability to is found too.

    Args:
        case: the case; its drive must be periodic.
        periods: P, number of periods of the drive in one of the orbit.
        settle: periods that are computed first.
        perturbations: what the mean is taken over, and the size of kicks; None: what suits the
            model.
        model: "full", or "reduced" for a few modes of each part (docs/reduced.md).
        modes: modes of each part of a reduced model; None: 12.
        refine: its fine steps in a coarse one near contact; None: 64.
        map_: map of the case, with the parameter excitation.frequency, and `start` near its orbit;
            None: that of the model, whose periods begin where the tips are far apart.
        start: state to start from, see `protocol.Nature`; None: rest.
        kept: folder for what the map returns, from which the same search goes on; None: it is not
            kept.

    Raises:
        CaseError: the drive is not periodic, the motion diverges, or P is out of range.
    """
    if not 1 <= periods <= MOST_PERIODS:
        raise CaseError(f"period: expected 1 to {MOST_PERIODS} periods, given {periods}")
    began = time.process_time()
    parameter = 1.0 / case.period
    try:
        if map_ is None:
            own = map_of(case, FREQUENCY, model, modes=modes, refine=refine)
            if kept is not None:
                own = KeptCaseMap(own, kept)
            map_, start = settled_map(own, parameter, settle, start)
        first = np.zeros(map_.slow.basis.shape[0]) if start is None else start
        at_end = settled(map_, parameter, first, RESETTLE)
        guess, scatter, multiple = mean_of_motion(map_, parameter, at_end, periods)
        kicks = perturbations or usual(model)
        coarse = coarse_orbit(map_, parameter, guess, periods, kicks, multiple)
        exact, best = exact_orbit(map_, parameter, at_end, periods)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise CaseError(f"case {case.name}: no orbit is found: {error}") from None
    state = coarse.solved.state if exact is None else exact.root.state
    return Orbit(
        case,
        periods,
        coarse,
        exact,
        best.residual,
        scatter,
        map_.nature,
        map_.watched(state, parameter, periods),
        time.process_time() - began,
        getattr(map_, "evaluations", 0),
    )

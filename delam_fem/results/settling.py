"""Judge the motion that a recorder has kept: settled, not settled or irregular; when to stop.

`numerics/settling.py` has the model and the thresholds; here are the strobes that it is given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.sections import Mesh
from delam_fem.model.beams import closed_form
from delam_fem.model.beams.bonded import n_rigid
from delam_fem.model.layout import Structure
from delam_fem.model.vibration import slowest_decay
from delam_fem.numerics.arrays import BoolArray
from delam_fem.numerics.settling import Settling, judge
from delam_fem.results import diagnostics
from delam_fem.simulation.recorder import LEDGER, Recorder

EVERY = 20
"""Periods between two judgements of a run that goes on until it has settled."""
AGREEING = 2
"""Successive judgements that must agree before such a run ends."""
FEWEST_IRREGULAR = 100
"""Judged periods before a run ends whose motion is irregular: ten for each of ten windows."""
BEAM_CELLS = 100
"""Cells of the beams that stand for solids whose mesh is from a file."""
LEAST_RANGE = 1e-6
"""Range of a probe relative to the largest one below which the probe counts as being at rest."""


def verdict_of(
    recorder: Recorder, n_parts: int, decay: float, n_periods: int | None = None
) -> Settling:
    """Return the verdict on a run of a periodic excitation.

    Args:
        recorder: of the run, after at least one period.
        n_parts: number of parts; the first probes are the reference probes, one for each.
        decay: e-folds of the slowest mode of the structure in a period of the excitation [-].
        n_periods: number of first periods that are judged; None: all that are finished.
    """
    n = finished(recorder) if n_periods is None else n_periods
    given = recorder.strobe[:n, :, :n_parts].transpose(1, 2, 0)
    last = slice(max(0, n - len(recorder.window)), n)
    low, high = recorder.envelope[last, 0, :n_parts], recorder.envelope[last, 1, :n_parts]
    speeds = np.concatenate([r.v[: r.n_steps + 1, :n_parts] for r in recorder.window])
    with np.errstate(all="ignore"):  # a motion that diverged is not settled
        moved = high.max(axis=0) - low.min(axis=0) if n else np.zeros(n_parts)
        half_ranges = np.array([moved, np.ptp(speeds, axis=0)]) / 2.0
        least = LEAST_RANGE * half_ranges.max(axis=1, keepdims=True)
        seen = np.where(half_ranges <= least, np.inf, half_ranges)  # NaN stays NaN: not settled
        strobes = given / seen[..., None]
        P = diagnostics.periodicity(strobes[0], np.ones(n_parts))[0]
    is_linear = not touches(recorder)[n // 2 : n].any()
    return judge(strobes, P, decay, is_linear=is_linear)


def decay_of(case: Case, structure: Structure) -> float:
    """Return the rate at which the slowest mode of a structure dies out [1/s].

    Solids have the damping of the beams of the same case, and frequencies close to theirs; the
    modes of the beams are found in no time and on any number of ranks.
    """
    is_floating = not case.is_apart and n_rigid(case) > 0
    if case.model.is_continuum:
        mesh = case.mesh if case.mesh.file is None else Mesh(elements=BEAM_CELLS)
        structure = closed_form.assemble(case.model_copy(update={"mesh": mesh, "sensor": ()}))
    return slowest_decay(structure.operators, is_floating=is_floating)


def enough_of(case: Case, recorder: Recorder, n_parts: int, decay: float) -> Callable[[int], bool]:
    """Return the function of the number of finished periods that says whether a run may end."""
    if case.time.periods == "settled":
        return until_settled(recorder, n_parts, decay)
    return lambda period: False


def judge_of(
    case: Case, structure: Structure, recorder: Recorder
) -> tuple[float, Callable[[int], bool]]:
    """Return the decay of the slowest mode per period, and `enough_of` the run."""
    decay = decay_of(case, structure) * case.period
    return decay, enough_of(case, recorder, len(structure.layout.parts), decay)


def finished(recorder: Recorder) -> int:
    """Return the number of periods that have been computed to their end."""
    is_cut = recorder.window[-1].n_steps < recorder.steps_per_period
    return recorder.n_closed - int(is_cut)


def touches(recorder: Recorder) -> BoolArray:
    """Return in which periods anything touched, shape (n_closed,).

    A contact leaves impulses, a spring that is closed at the end of the period, or energy that a
    spring brought along when it was switched.
    """
    rows = recorder.ledger[: recorder.n_closed]
    columns = [LEDGER.index(name) for name in ("spring", "spring_released", "contact_damping_loss")]
    touched: BoolArray = (recorder.impulse[: recorder.n_closed, 1] > 0.0) | rows[:, columns].any(1)
    return touched


def until_settled(recorder: Recorder, n_parts: int, decay: float) -> Callable[[int], bool]:
    """Return the function of the number of finished periods that says whether a run may end.

    It judges every `EVERY` periods from the strobes alone, so that a resumed run ends after the
    same period as one that was not interrupted.
    """

    def is_steady(period: int) -> bool:
        if period % EVERY or period < AGREEING * EVERY:
            return False
        found = [
            verdict_of(recorder, n_parts, decay, period - back * EVERY) for back in range(AGREEING)
        ]
        if found[0].word == "irregular" and found[0].periods_judged < FEWEST_IRREGULAR:
            return False
        return all(own.word == found[0].word != "not settled" for own in found)

    return is_steady


def numbers(recorder: Recorder, n_parts: int, case: Case, decay: float) -> dict[str, Any]:
    """Return the entries of a summary that say whether a run has settled, and what follows.

    Args:
        recorder: of the run.
        n_parts: number of parts.
        case: of the run.
        decay: e-folds of the slowest mode of the structure in a period [-].

    Returns:
        `settled`, None without a periodic excitation; `settling` with the numbers of `Settling`;
        `periodicity`, None unless settled, and what goes with it.
    """
    if not case.is_periodic:
        return {"settled": None, "settling": None}
    found = verdict_of(recorder, n_parts, decay)
    values = asdict(found)
    del values["word"], values["periodicity"]
    entries: dict[str, Any] = {"settled": found.word, "periodicity": found.periodicity}
    entries["settling"] = values
    if found.periodicity is None:
        entries["strobe_scatter"] = None
        entries["periodicity_class"] = found.word if found.word == "not settled" else "not periodic"
    return entries


def limit_warning(case: Case, summary: Mapping[str, Any]) -> str | None:
    """Return a warning if a run that was to go on until it has settled ended without."""
    if case.time.periods != "settled" or summary["settled"] != "not settled":
        return None
    needed = summary["settling"]["periods_needed"]
    further = "" if needed is None else f"; it may need {needed} further periods"
    return (
        f"not settled after {case.time.most_periods} periods, the limit time.most_periods{further}"
    )

"""Siconos as an independent judge of newton@moreau-jean: the same matrices, another program.

Siconos has its own Moreau–Jean scheme, activation of contacts and complementarity solver. Matrices
and base motion are given to it as arrays, from the closed-form reference.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from delam_fem.api import Case, FloatArray, assemble, base_motion, preset, run

pytestmark = [
    pytest.mark.slow,
    pytest.mark.siconos,
    pytest.mark.skipif(
        importlib.util.find_spec("siconos") is None,
        reason="no Siconos (Debian 12: apt-get install python3-siconos; none in 13 and sid)",
    ),
]

SCRIPT = Path(__file__).with_name("siconos_laminae.py")
PERIODS = 20
FIRST_IMPACTS = 10
SAME_TIPS = 1e-6
"""m, over the first impacts. Measured 3e-16: both solve each step to round-off."""
SAME_STATISTICS = 1e-3
"""Relative to the range of the tip, over the last periods: round-off grows from impact to impact,
differently with another version of either program. Measured 5e-12: here even the tips themselves
stay together to 1e-13 m for 60 periods."""
SAME_COUNTS = 0.02
"""Relative; hits are many and light, and counts do not settle. Measured: equal."""


@dataclass(frozen=True)
class Pair:
    """Tip histories of both programs, shape (n_steps, 2), and hits per step, shape (n_steps,)."""

    ours: FloatArray
    ours_velocity: FloatArray
    siconos: FloatArray
    siconos_velocity: FloatArray
    hits: npt.NDArray[np.int64]
    siconos_hits: npt.NDArray[np.int64]
    case: Case


def by_siconos(case: Case, directory: Path) -> dict[str, FloatArray]:
    """Return what Siconos makes of a case."""
    o = assemble(case, needs_dolfinx=False).operators
    times = case.time_step * np.arange(case.time.steps_per_period * case.n_periods + 1)
    problem_file, result = directory / "problem.npz", directory / "result.npz"
    np.savez(
        problem_file,
        mass=o.mass.toarray(),
        damping=o.damping.toarray(),
        stiffness=o.stiffness.toarray(),
        gap_matrix=o.gap_matrix.toarray(),
        gap0=o.gap0,
        base=np.stack([o.base.stiffness, o.base.damping, o.base.mass]),
        base_states=base_motion(case.excitation).states(times),
        time_step=case.time_step,
        restitution=case.contact.restitution,
        probes=o.probes.toarray(),
    )
    # its own process: Siconos brings its own solvers and prints as it likes
    subprocess.run([sys.executable, SCRIPT, problem_file, result], check=True, capture_output=True)
    with np.load(result) as file:
        return dict(file)


@pytest.fixture(scope="module", params=[3.25, 3.65])
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Pair:
    periods = PERIODS if request.param == 3.25 else 6
    case = preset(
        "paper",
        {
            "excitation.frequency": request.param,
            "contact.law": "newton@moreau-jean",
            "time.periods": periods,
            "output.window_periods": periods,
            "output.fields_per_period": 0,
        },
    )
    history = run(case, structure=assemble(case, needs_dolfinx=False)).history
    theirs = by_siconos(case, tmp_path_factory.mktemp("siconos"))
    steps = np.rint(history.event_time.values / case.time_step).astype(int) - 1
    return Pair(
        history.tip_displacement.values.T,
        history.tip_velocity.values.T,
        theirs["u"],
        theirs["v"],
        np.bincount(steps, minlength=len(theirs["u"])),
        theirs["hits"].astype(np.int64),
        case,
    )


def first_steps(pair: Pair) -> int:
    """Return the number of steps until some steps after the first impacts."""
    return int(np.flatnonzero(pair.hits)[FIRST_IMPACTS - 1]) + 10


def test_tips_alike_over_the_first_impacts(pair: Pair) -> None:
    n = first_steps(pair)
    assert np.abs(pair.ours[:n] - pair.siconos[:n]).max() < SAME_TIPS
    speed = np.abs(pair.siconos_velocity[:n]).max()
    assert np.abs(pair.ours_velocity[:n] - pair.siconos_velocity[:n]).max() < 1e-6 * speed
    assert np.abs(pair.siconos[:n]).max() > 1e-3, "the laminae move"


def test_same_pairs_are_hit_at_first(pair: Pair) -> None:
    n = first_steps(pair)
    assert np.array_equal(pair.hits[:n], pair.siconos_hits[:n])


def test_same_statistics(pair: Pair) -> None:
    n = pair.case.time.steps_per_period
    last = slice(-min(10, pair.case.n_periods // 2) * n, None)
    ours, siconos = pair.ours[last], pair.siconos[last]
    size = np.ptp(siconos, axis=0)
    for statistic in (np.min, np.max, np.mean, np.std):
        difference = statistic(ours, axis=0) - statistic(siconos, axis=0)
        assert np.abs(difference / size).max() < SAME_STATISTICS, statistic.__name__
    for phase in range(0, n, n // 4):  # several strobes: one alone may lie at a turning point
        strobes = np.abs(ours[phase::n].mean(axis=0) - siconos[phase::n].mean(axis=0))
        assert (strobes / size).max() < SAME_STATISTICS
    smallest_gap = np.diff(siconos, axis=1).min() - np.diff(ours, axis=1).min()
    assert abs(smallest_gap) < SAME_STATISTICS * size.max()
    assert pair.hits.sum() == pytest.approx(pair.siconos_hits.sum(), rel=SAME_COUNTS)
    assert pair.hits.sum() > 100

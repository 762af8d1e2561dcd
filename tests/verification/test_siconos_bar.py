"""The impacting bar of Siconos, by Siconos and by this package on the same matrices.

The parameters are those of its example ImpactingBar (V. Acary): a steel bar of 100 dofs with
consistent mass, 1 cm of diameter in its words, falls by 0.05 mm with 0.1 m/s on the ground, e = 0.
The example takes elements of length L/100 with 100 nodes, so that its bar is 0.99 m long.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from problems import Bar, Law, Motions, simulate

from delam_fem.api import FloatArray, Operators

pytestmark = [
    pytest.mark.siconos,
    pytest.mark.skipif(
        importlib.util.find_spec("siconos") is None,
        reason="no Siconos (Debian 12: apt-get install python3-siconos; none in 13 and sid)",
    ),
]

SCRIPT = Path(__file__).with_name("siconos_laminae.py")
N_DOFS = 100
BAR = Bar(210e9, area=3.14e-4, density=7800.0, length=0.99, gap=5e-5, speed=0.1)
TIME_STEP, N_STEPS = 2e-6, 750
SAME = 1e-11
"""Of displacements relative to the fall, of velocities to the speed and of impulses to the mean
impulse of a step. Both programs solve each step to round-off. Measured: at most 4e-13."""


@dataclass(frozen=True)
class Both:
    """The histories of both programs.

    Attributes:
        ours: this package's.
        impulses: its impulse in each step, shape (n_steps,) [N s].
        theirs: arrays of Siconos: u, v, hits, impulses.
        operators: the matrices.
        theta: of the scheme.
    """

    ours: Motions
    impulses: FloatArray
    theirs: dict[str, FloatArray]
    operators: Operators
    theta: float


def by_siconos(o: Operators, theta: float, directory: Path) -> dict[str, FloatArray]:
    """Return what Siconos makes of the bar."""
    problem_file, result = directory / "problem.npz", directory / "result.npz"
    np.savez(
        problem_file,
        mass=o.mass.toarray(),
        damping=o.damping.toarray(),
        stiffness=o.stiffness.toarray(),
        gap_matrix=o.gap_matrix.toarray(),
        gap0=o.gap0,
        base=np.zeros((3, N_DOFS)),
        base_states=np.zeros((N_STEPS + 1, 3)),
        time_step=TIME_STEP,
        restitution=0.0,
        theta=theta,
        start=np.array(BAR.flying(N_DOFS - 1)),
        probes=np.eye(N_DOFS),
    )
    subprocess.run([sys.executable, SCRIPT, problem_file, result], check=True, capture_output=True)
    with np.load(result) as file:
        return dict(file)


@pytest.fixture(
    scope="module",
    params=[(True, 0.5), (True, 1.0), (False, 0.5)],
    ids=["consistent", "consistent, theta 1", "lumped"],
)
def both(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Both:
    consistent, theta = request.param
    operators = BAR.operators(N_DOFS - 1, consistent=consistent)
    ours = simulate(
        operators,
        Law("newton@moreau-jean", 0.0, theta=theta),
        BAR.flying(N_DOFS - 1),
        time_step=TIME_STEP,
        n_steps=N_STEPS,
    )
    steps = np.rint(ours.impact_time / TIME_STEP).astype(int) - 1
    impulses = np.bincount(steps, ours.impulse, minlength=N_STEPS)
    theirs = by_siconos(operators, theta, tmp_path_factory.mktemp("siconos"))
    return Both(ours, impulses, theirs, operators, theta)


def test_same_motion_of_all_nodes(both: Both) -> None:
    assert np.abs(both.ours.u[1:] - both.theirs["u"]).max() < SAME * BAR.gap
    assert np.abs(both.ours.v[1:] - both.theirs["v"]).max() < SAME * BAR.speed


def test_same_impulses(both: Both) -> None:
    typical = BAR.contact_force * TIME_STEP
    assert np.abs(both.impulses - both.theirs["impulses"]).max() < SAME * typical
    assert np.array_equal(both.impulses > 0.0, both.theirs["hits"] > 0)


def test_both_are_the_bar_of_the_exact_solution(both: Both) -> None:
    """The pulse of force, and the momentum of the rebound; theta = 1 damps its fronts away."""
    weight = float(both.operators.lumped_mass.sum())
    missing = 1.0 - both.theirs["impulses"].sum() / (2.0 * weight * BAR.speed)
    assert 0.0 < missing < (0.015 if both.theta == 0.5 else 0.07)
    touching = TIME_STEP * (np.flatnonzero(both.theirs["hits"]) + 1)
    assert touching[0] == pytest.approx(BAR.contact_start, abs=2.0 * TIME_STEP)
    assert np.ptp(touching) == pytest.approx(BAR.contact_duration, rel=0.01)

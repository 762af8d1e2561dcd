"""Steps refined near contact: the motion of uniform small steps, in both engines, at less cost.

Between impacts a ball moves exactly whatever the step, so that its refined run is the uniform run
with the fine step. Laminae differ by what the coarse step makes of the motion without contact.
"""

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from problems import Law, Motions, ball, gravity, simulate

from delam_fem.api import (
    SCHEMES,
    BaseCoupling,
    Case,
    EngineName,
    Operators,
    Recorder,
    State,
    assemble,
    preset,
    session_of,
    solve,
)
from delam_fem.contact import laws
from delam_fem.engines.session import ENGINES
from delam_fem.simulation.recorder import EFFORT, HIT
from delam_fem.simulation.refinement import Refinement

CLOSED = 1e-9
"""Relative residual of the ledger."""
NEAR_UNIFORM = 0.005
"""Largest difference of the tip extremes from uniform small steps, relative to the thin tip's half
range; seen: 0.001."""
G = 8.0


def drop(law: Law, n_steps: int) -> Motions:
    """Drop a ball that lands off the grids of coarse and fine steps, and bounces with e = 1/2."""
    return simulate(
        ball(1.0),
        law,
        (np.array([0.5 * G * 0.3137**2]), np.zeros(1)),
        time_step=0.95 / n_steps,
        n_steps=n_steps,
        motion=gravity(G),
    )


@pytest.mark.parametrize("name", ["newton", "newton@central-difference", "newton@moreau-jean"])
@pytest.mark.parametrize("refine", [2, 7, 12])
def test_a_ball_bounces_as_with_uniform_fine_steps(name: str, refine: int) -> None:
    fine = drop(Law(name, 0.5), 60 * refine)
    result = drop(Law(name, 0.5, refine=refine), 60)
    assert fine.impact_time.size >= 3
    np.testing.assert_allclose(result.impact_time, fine.impact_time, rtol=1e-12)
    np.testing.assert_allclose(result.rate_pre, fine.rate_pre, rtol=1e-10)
    np.testing.assert_allclose(result.u, fine.u[::refine], rtol=0.0, atol=1e-12)
    assert result.energy_residual < CLOSED


def case_of(law: str, **keys: Any) -> Case:
    few = {"mesh.elements": 6, "time.periods": 3, "time.steps_per_period": 400, "time.refine": 12}
    window = {"output.window_periods": 3, "output.fields_per_period": 20}
    if law == "newton@central-difference":
        few |= {"mesh.elements": 4, "time.steps_per_period": 4000, "damping.rayleigh": "mass"}
    chosen = {"contact.law": law, "contact.impulse": "consistent", **few, **window, **keys}
    return preset("paper", chosen)


def compute(case: Case, engine: EngineName) -> Recorder:
    with session_of(case, assemble(case, needs_dolfinx=False).operators, engine=engine) as opened:
        assert opened.run() == "completed"
        return opened.recorder


def test_the_ledger_closes_under_a_base_that_does_not_repeat() -> None:
    swept = {
        "excitation.kind": "sweep", "excitation.start_frequency": 3.0, "excitation.duration": 1.0,
        "excitation.end_frequency": 3.6, "excitation.amplitude": 0.0025,
    }  # fmt: skip
    for engine in ("petsc", "compiled"):
        recorder = compute(case_of("newton@moreau-jean", **swept), engine)
        assert recorder.effort[:, EFFORT.index("fine")].sum() > 0
        assert recorder.energy_residual() < CLOSED


def test_laminae_move_as_with_uniform_small_steps() -> None:
    keys = {"mesh.elements": 10, "time.periods": 3, "output.fields_per_period": 0}
    fine = compute(
        case_of("newton@moreau-jean", **keys, **{"time.steps_per_period": 16000, "time.refine": 1}),
        "compiled",
    )
    recorder = compute(
        case_of("newton@moreau-jean", **keys, **{"time.steps_per_period": 1000, "time.refine": 16}),
        "compiled",
    )
    half = 0.5 * np.ptp(fine.envelope[-1, :, 1])
    assert np.abs(recorder.envelope - fine.envelope).max() < NEAR_UNIFORM * half
    assert recorder.effort[:, :3].sum() < 0.15 * fine.effort[:, :3].sum()
    assert recorder.effort[:, EFFORT.index("unforeseen")].sum() == 0
    plain = compute(case_of("newton@moreau-jean", **keys, **{"time.refine": 1}), "compiled")
    assert np.abs(plain.envelope - fine.envelope).max() > 2.0 * NEAR_UNIFORM * half


def test_a_contact_that_a_coarse_step_cannot_see_is_counted() -> None:
    """One mass leaves its stop slowly, so that steps are divided; the other swings once in a step.

    With ωΔt = 6 the coarse step makes -0.8 u of u, so that the swing down to the stop is not seen.
    """
    omega, gap0 = 6.0, np.array([0.0, 1.3])
    operators = Operators(
        mass=sp.identity(2, format="csr"),
        damping=sp.csr_matrix((2, 2)),
        stiffness=sp.diags([0.0, omega**2]).tocsr(),
        base=BaseCoupling.none(2),
        gap_matrix=sp.identity(2, format="csr"),
        gap0=gap0,
    )
    start = State(np.array([[0.0, 1.5], [1e-3, 0.0], [0.0, 0.0]]), np.zeros(2, dtype=np.bool_))
    for engine in ENGINES:
        solution = solve(
            operators, laws.Law("newton"), SCHEMES["moreau-jean"], time_step=1.0,
            steps_per_period=1, periods=1, refinement=Refinement(64), initial=start, engine=engine,
        )  # fmt: skip
        assert solution.recorder.effort[0, 3:].tolist() == [1, 1]
        assert solution.impacts.pair[0] == 1


def test_frames_show_what_was_hit_within_their_step() -> None:
    keys = {"output.fields_per_period": 400, "contact.restitution": 0.5}
    recorder = compute(
        case_of("newton@moreau-jean", **keys, **{"contact.threshold_velocity": 0}), "petsc"
    )
    for record in recorder.window:
        jumps = record.jumps.columns()
        steps = np.repeat(-(-jumps.ticks // 12), jumps.sizes)
        expected = np.zeros((400, 6), dtype=np.int8)
        expected[steps - 1, jumps.hit] = HIT
        np.testing.assert_array_equal(np.array(record.contact) > 0, expected > 0)

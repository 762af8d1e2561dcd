"""The time loop of the reference: energy, restart, events, what it refuses."""

import numpy as np
import pytest

from delam_fem.api import Case, CaseError, assemble, preset
from delam_fem.reference.loop import Standing, simulate_reference

ENERGY = 1e-10  # average acceleration conserves exactly; 200 steps of round-off on stiff modes
SMALL = {"mesh.elements": 4, "time.steps_per_period": 200}
FREE = {
    **SMALL,
    "contact.law": "none",
    "excitation.amplitude": 0.0,
    "lamina.thick.damping_ratio": 0.0,
    "lamina.thin.damping_ratio": 0.0,
}


def case_with(overrides: dict[str, object]) -> Case:
    return preset("paper", overrides)


def test_free_motion_conserves_energy() -> None:
    case = case_with(FREE)
    ops = assemble(case, needs_dolfinx=False).operators
    rng = np.random.default_rng(3)
    start = Standing(0, 1e-3 * rng.standard_normal(16), rng.standard_normal(16), np.zeros(4, bool))
    end = simulate_reference(ops, case, periods=1, initial=start).final

    def energy(state: Standing) -> float:
        u, v = state.displacement, state.velocity
        return float(v @ ops.mass @ v + u @ ops.stiffness @ u) / 2

    assert energy(end) == pytest.approx(energy(start), rel=ENERGY)
    assert np.abs(end.displacement - start.displacement).max() > 1e-4  # it has moved


def test_springs_store_and_return_energy() -> None:
    # All pairs rest on their springs and stay closed, so the law has nothing to do.
    case = case_with({**FREE, "contact.law": "newton-penalty", "contact.penalty_stiffness": 5e3})
    ops = assemble(case, needs_dolfinx=False).operators
    closed = np.zeros(16)
    closed[0:8:2] = 1.5 * ops.gap0  # g0 = tip (x/L)^2, so is the shape of lamina 1
    closed[1:8:2] = 2.0 * closed[0:8:2] / (0.685 / 4 * np.arange(1, 5))
    start = Standing(0, closed, np.zeros(16), np.ones(4, bool))
    one = case.with_overrides({"excitation.frequency": 4000.0})  # 0.25 ms in 200 steps
    end = simulate_reference(ops, one, periods=1, initial=start).final

    def energy(state: Standing) -> tuple[float, float]:
        u, v = state.displacement, state.velocity
        gap = ops.gap_matrix @ u + ops.gap0
        return float(v @ ops.mass @ v + u @ ops.stiffness @ u) / 2, 2.5e3 * float(gap @ gap)

    assert end.permanent.all()
    assert sum(energy(end)) == pytest.approx(sum(energy(start)), rel=ENERGY)
    assert energy(end)[1] < 0.9 * energy(start)[1]  # the springs have given something


@pytest.mark.parametrize("impulse", ["lumped", "consistent"])
def test_restart_repeats_the_run(impulse: str) -> None:
    case = case_with({**SMALL, "contact.impulse": impulse})
    model = assemble(case, needs_dolfinx=False).operators
    complete_run = simulate_reference(model, case, periods=3)
    first = simulate_reference(model, case, periods=1)
    resumed = simulate_reference(model, case, periods=2, initial=first.final)
    both = np.hstack([first.displacement, resumed.displacement])
    # The start solves for the acceleration that the step before had, to round-off; impacts amplify.
    np.testing.assert_allclose(both, complete_run.displacement, atol=1e-9)
    np.testing.assert_array_equal(np.hstack([first.times, resumed.times]), complete_run.times)
    assert [e.pair for e in first.events + resumed.events] == [e.pair for e in complete_run.events]
    assert len(first.events) > 0


def test_times_are_ends_of_steps_and_events_fall_on_them() -> None:
    case = case_with(SMALL)
    run = simulate_reference(assemble(case, needs_dolfinx=False).operators, case, periods=2)
    np.testing.assert_allclose(run.times, np.arange(1, 401) * case.time_step, rtol=1e-14)
    assert run.displacement.shape == run.velocity.shape == (2, 400)
    assert {e.time for e in run.events} <= set(run.times.tolist())
    assert all(e.velocity_before < 0.0 <= e.impulse for e in run.events)
    assert run.final.step == 400


def test_recorded_velocity_is_the_one_after_the_impact() -> None:
    case = case_with({**SMALL, "excitation.frequency": 3.25, "contact.law": "newton"})
    run = simulate_reference(assemble(case, needs_dolfinx=False).operators, case, periods=4)
    tips = [e for e in run.events if e.pair == 3]
    assert tips
    for event in tips:
        i = int(np.searchsorted(run.times, event.time))
        rate = run.velocity[1, i] - run.velocity[0, i]
        assert rate == pytest.approx(-0.1 * event.velocity_before, rel=1e-9)


@pytest.mark.parametrize("law", ["penalty"])
def test_laws_that_it_does_not_have_are_refused(law: str) -> None:
    case = case_with({**SMALL, "contact.law": law})
    with pytest.raises(
        CaseError, match=f"the reference has none, newton, newton.*'{law.partition('@')[0]}'"
    ):
        simulate_reference(assemble(case, needs_dolfinx=False).operators, case, periods=1)


def test_central_difference_is_refused() -> None:
    case = case_with({**SMALL, "time.scheme": "central-difference"})
    with pytest.raises(CaseError, match=r"time\.scheme: the reference has newmark"):
        simulate_reference(assemble(case, needs_dolfinx=False).operators, case, periods=1)

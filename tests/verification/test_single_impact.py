"""The energy of impacts: one pair that is hit loses (1 - e²) U̇²/(2 W), W = (H M⁻¹ Hᵀ)_kk.

Where mass and impulses go together (consistent with consistent, lumped with lumped) that is exact,
whatever else moves.
"""

from dataclasses import replace

import numpy as np
import pytest
from problems import Law, simulate

from delam_fem.api import SCHEMES, FloatArray, Impulse, LawContext, Operators, assemble, preset, run
from delam_fem.contact import laws
from delam_fem.engines.petsc.newmark import Newmark

ROUND_OFF = 1e-12
"""Relative to the kinetic energy."""
EVENT_ROUND_OFF = 1e-9
"""Relative to the loss of an event, some of which are millions of times lighter than others."""
SHORT = 1e-9
"""Time step so short that nothing but the impact happens [s]."""


def laminae(mass: str, elements: int = 5) -> Operators:
    """Return the two laminae without damping, all pairs far apart."""
    case = preset("paper", {"time.mass": mass, "mesh.elements": elements})
    o = assemble(case, needs_dolfinx=False).operators
    return replace(o, damping=0.0 * o.damping, gap0=np.ones(o.n_pairs))


def compliance(o: Operators) -> FloatArray:
    """Return H M⁻¹ Hᵀ by dense matrices, shape (n_pairs, n_pairs) [1/kg]."""
    H = o.gap_matrix.toarray()
    return np.asarray(H @ np.linalg.solve(o.mass.toarray(), H.T))


@pytest.mark.parametrize("impulse", ["consistent", "lumped"])
@pytest.mark.parametrize("e", [0.0, 0.1, 0.7, 1.0])
@pytest.mark.parametrize("pair", [0, 2, 4])
def test_energy_of_a_single_impact(impulse: Impulse, e: float, pair: int) -> None:
    o = laminae(mass=impulse)
    W = compliance(o)[pair, pair]
    gap0 = o.gap0.copy()
    gap0[pair] = 0.0
    o = replace(o, gap0=gap0)
    rng = np.random.default_rng(pair)
    v = rng.normal(size=o.n_dofs)
    v -= o.gap_matrix[pair].toarray().ravel() * (abs(o.gap_matrix[pair] @ v) + 0.5)  # approaching
    stepper = Newmark(o, SHORT, coupled_impulses=impulse == "consistent")
    setting = LawContext(o.n_pairs, stepper.compliance)
    law = laws.Law("newton", e, impulse).supervisor(SCHEMES["newmark"], setting)
    stepper.begin(np.zeros((2, 3)))
    stepper.restore(np.array([0.0 * v, v, 0.0 * v]))
    stepper.advance()
    before, rate = stepper.energies(), stepper.rate_free()[pair]
    decision = law.examine(stepper)
    assert decision is not None
    assert decision.hit.tolist() == [pair]
    told, _ = stepper.jump(decision)
    after = stepper.energies()
    loss = 0.5 * (1.0 - e**2) * rate**2 / W
    assert rate < -0.4
    assert told == pytest.approx(-loss, abs=ROUND_OFF * before.kinetic)
    assert after.kinetic - before.kinetic == pytest.approx(-loss, abs=ROUND_OFF * before.kinetic)
    assert after.strain == before.strain
    assert stepper.rate_free()[pair] == pytest.approx(-e * rate, abs=1e-9)
    stepper.destroy()


def test_lumped_impulse_on_a_consistent_mass_does_not_lose_that() -> None:
    """The literal scheme: the pair gets its speed, the energy of the others changes as it likes."""
    o = laminae(mass="consistent")
    gap0 = o.gap0.copy()
    gap0[2] = 0.0
    o = replace(o, gap0=gap0)
    changes = []
    for seed in range(20):
        v = np.random.default_rng(seed).normal(scale=5.0, size=o.n_dofs)
        v[[4, 14]] = 1.0, -1.0  # u of node 3 of both laminae
        stepper = Newmark(o, SHORT)
        setting = LawContext(o.n_pairs, stepper.compliance)
        law = laws.Law("newton", 0.1, "lumped").supervisor(SCHEMES["newmark"], setting)
        stepper.begin(np.zeros((2, 3)))
        stepper.restore(np.array([0.0 * v, v, 0.0 * v]))
        stepper.advance()
        decision = law.examine(stepper)
        assert decision is not None
        before = stepper.energies().kinetic
        told, _ = stepper.jump(decision)
        assert told == pytest.approx(stepper.energies().kinetic - before, rel=1e-9)
        changes.append(told)
        stepper.destroy()
    assert max(changes) > 0.0 > min(changes)


@pytest.mark.parametrize("impulse", ["consistent", "lumped"])
@pytest.mark.parametrize("e", [0.1, 0.5])
def test_energy_of_single_impacts_in_a_run(impulse: str, e: float) -> None:
    settings = {"contact.law": "newton", "contact.impulse": impulse, "time.mass": impulse}
    settings |= {"contact.restitution": e, "time.periods": 2, "output.window_periods": 2}
    case = preset("paper", {**settings, "output.fields_per_period": 0})
    model = assemble(case, needs_dolfinx=False)
    history = run(case, structure=model).history
    times, counts = np.unique(history.event_time.values, return_counts=True)
    alone = np.isin(history.event_time.values, times[counts == 1])
    assert alone.sum() > 20
    W = compliance(model.operators).diagonal()[history.event_node.values[alone] - 1]
    loss = 0.5 * (1.0 - e**2) * history.event_velocity_before.values[alone] ** 2 / W
    scale = EVENT_ROUND_OFF * loss.max()
    assert -history.event_energy.values[alone] == pytest.approx(loss, rel=1e-6, abs=scale)


def test_moreau_tends_to_the_same_loss() -> None:
    """Its impact takes a step, in which the compliance is that of M + Δt²K/4: order 2 in Δt.

    No other force acts, hence the rate without impulse is the one before.
    """
    e, pair = 0.3, 2
    o = laminae(mass="consistent", elements=3)
    W = compliance(o)[pair, pair]
    gap0 = o.gap0.copy()
    gap0[pair] = 0.0
    o = replace(o, gap0=gap0)
    v = np.zeros(o.n_dofs)
    v[4], v[10] = 1.0, -1.0  # u of node 3 of both laminae
    errors = []
    for dt in (1e-6, 5e-7, 2.5e-7):
        initial = (0.0 * v, v)
        motions = simulate(o, Law("newton@moreau-jean", e), initial, time_step=dt, n_steps=1)
        assert motions.impact_pair.tolist() == [pair]
        assert motions.rate_pre[0] == pytest.approx(-2.0)
        assert motions.energy_residual < ROUND_OFF
        errors.append(abs(motions.impact_energy[0] / (-0.5 * (1.0 - e**2) * 4.0 / W) - 1.0))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(2.0, abs=0.2)
    assert errors[-1] < 1e-3

"""The energy ledger: it closes, impacts lose energy where they should, the base's work is right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest
import scipy.sparse as sp
from problems import Law, Motions, simulate
from scipy.sparse.linalg import spsolve
from support import covering

from delam_fem import HarmonicMotion
from delam_fem.api import (
    LEDGER,
    SCHEMES,
    BaseCoupling,
    Case,
    FloatArray,
    Operators,
    Result,
    Scheme,
    assemble,
    base_motion,
    preset,
    run,
    solve,
)
from delam_fem.contact import laws as contact

Engine = Literal["petsc", "compiled"]

CLOSED = 1e-9
"""Residual of a period over the energy exchanged in it. Measured: 4e-12 with 20 elements; round-off
grows with the condition of K, as the fourth power of the number of elements."""
ROUND_OFF = 1e-9
"""Energy that an impact may gain by round-off, relative to the largest loss."""
FREQUENCIES = (1.25, 1.60, 3.25, 3.65)
PARTING_GAIN = 0.1
"""What pushing pairs that part already may gain with moreau, in parts of the losses.
Measured: 0.006 to 0.03 over 20 periods, 0.065 with mass damping over 60."""
BASE_WORK_ORDER = 0.05
"""Window around 2. Measured: 2.00 with and without contact."""
BASE_WORK = 1e-6
"""Relative, with 4000 steps in the period. Measured: 4e-7."""


def compute(settings: dict[str, object], periods: int, engine: Engine = "petsc") -> Result:
    """Run the preset with changes, on the matrices in closed form."""
    window = {"time.periods": periods, "output.window_periods": periods}
    case = preset("paper", {**window, "output.fields_per_period": 0, **settings})
    return run(case, engine, structure=assemble(case, needs_dolfinx=False))


@dataclass(frozen=True)
class Instants:
    """Impacts by instants: energy change of all pairs hit, and the largest gap rate before."""

    energy: FloatArray
    largest_rate: FloatArray

    @classmethod
    def of(cls, result: Result) -> Instants:
        events = result.history
        times, which = np.unique(events.event_time.values, return_inverse=True)
        rates = np.full(times.size, -np.inf)
        np.maximum.at(rates, which, events.event_velocity_before.values)
        return cls(np.bincount(which, events.event_energy.values), rates)

    @property
    def gain(self) -> float:
        return float(self.energy[self.energy > 0.0].sum())

    @property
    def loss(self) -> float:
        return -float(self.energy[self.energy < 0.0].sum())


LAWS: list[dict[str, object]] = [
    {"contact.law": "none"},
    {"contact.law": "newton", "contact.impulse": "lumped"},
    {"contact.law": "newton", "contact.impulse": "consistent"},
    {"contact.law": "newton-penalty", "contact.impulse": "lumped"},
    {"contact.law": "newton-penalty", "contact.impulse": "consistent"},
    {"contact.law": "penalty"},
    {"contact.law": "penalty", "contact.penalty_stiffness": 1e4, "contact.penalty_damping": 0.5},
    {"contact.law": "newton@moreau-jean"},
    {"contact.law": "newton@moreau-jean", "contact.restitution": 0.5},
    {"contact.law": "newton@moreau-jean", "time.refine": 8},
]


def named(value: object) -> str:
    """Return a value of a parameter as a name of its test shows it."""
    return "-".join(str(v) for v in value.values()) if isinstance(value, dict) else str(value)


@pytest.mark.parametrize(
    ("frequency", "law", "mass"), covering(FREQUENCIES, LAWS, ["consistent", "lumped"]), ids=named
)
def test_ledger_closes(frequency: float, law: dict[str, object], mass: str) -> None:
    settings = {"excitation.frequency": frequency, "time.mass": mass, **law}
    result = compute(settings, periods=3)
    assert result.summary["outcome"] == "completed"
    assert result.summary["energy_residual"] < CLOSED
    history = result.history
    assert history.energy_base_work.values.max() > 1e-6
    assert history.energy_damping_loss.values.min() > 0.0
    if law["contact.law"] not in ("none", "penalty"):
        assert history.sizes["event"] > 50
        impacts = Instants.of(result)
        assert history.energy_impact_loss.sum() == pytest.approx(
            impacts.loss - impacts.gain, rel=1e-9
        )
    if "contact.penalty_damping" in law:
        assert history.energy_contact_damping_loss.values.max() > 0.0


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_ledger_closes_under_a_swept_sine(mass: str, engine: Engine) -> None:
    """The base ends a period at another speed than it began: its own mass gains energy."""
    settings: dict[str, object] = {
        "excitation.kind": "sweep", "excitation.start_frequency": 2.0,
        "excitation.end_frequency": 5.0, "excitation.duration": 2.0,
        "time.steps_per_period": 300, "time.mass": mass, "mesh.elements": 6,
    }  # fmt: skip
    result = compute(settings, periods=3, engine=engine)
    base = result.history["base_displacement"].values
    speeds = np.diff(base)[np.arange(0, base.size - 1, 299)]
    assert np.ptp(speeds) > 0.2 * np.abs(np.diff(base)).max()
    assert result.summary["energy_residual"] < CLOSED


DISSIPATIVE: list[dict[str, object]] = [
    {"contact.law": "newton", "contact.impulse": "consistent", "time.mass": "consistent"},
    {"contact.law": "newton-penalty", "contact.impulse": "consistent", "time.mass": "consistent"},
    {"contact.law": "newton", "contact.impulse": "lumped", "time.mass": "lumped"},
    {"contact.law": "newton-penalty", "contact.impulse": "lumped", "time.mass": "lumped"},
]
MESHES = [20, 50, 80, 160]
DAMPINGS = ["two-mode", "stiffness", "mass"]


@pytest.mark.parametrize(
    ("law", "damping", "elements"), covering(DISSIPATIVE, DAMPINGS, MESHES), ids=named
)
def test_no_impact_gains_energy(law: dict[str, object], damping: str, elements: int) -> None:
    settings = {"mesh.elements": elements, "damping.rayleigh": damping}
    impacts = Instants.of(compute({**settings, **law}, 4, "compiled"))
    assert impacts.energy.size > 30
    assert impacts.energy.max() <= ROUND_OFF * -impacts.energy.min()


@pytest.mark.parametrize(
    ("elements", "damping"),
    [
        pytest.param(n, damping, marks=() if (i + k) % 3 == 0 or n == 160 else pytest.mark.nightly)
        for i, n in enumerate(MESHES)
        for k, damping in enumerate(DAMPINGS)
    ],
)
def test_moreau_gains_only_from_pairs_that_part_already(damping: str, elements: int) -> None:
    """An impulse does the work p (U̇⁺ + U̇⁻)/2 = p (1 - e) U̇⁻/2 on its pair.

    That is a loss for a pair that approaches. The scheme also pushes a pair whose predicted gap is
    closed although it parts (U̇⁻ > 0), where it would turn round within the step, and gains by it.
    """
    settings = {
        "mesh.elements": elements,
        "damping.rayleigh": damping,
        "contact.law": "newton@moreau-jean",
    }
    impacts = Instants.of(compute(settings, 4, "compiled"))
    approaching = impacts.largest_rate <= 0.0
    assert approaching.sum() > 30
    assert impacts.energy[approaching].max() <= ROUND_OFF * impacts.loss
    assert impacts.gain < PARTING_GAIN * impacts.loss


@pytest.mark.parametrize(
    ("elements", "damping"), [(20, "mass"), (50, "stiffness"), (80, "two-mode")]
)
def test_literal_scheme_gains_energy(elements: int, damping: str) -> None:
    """Consistent mass with lumped impulses: single impacts gain more than any loses."""
    settings: dict[str, object] = {
        "mesh.elements": elements,
        "damping.rayleigh": damping,
        "contact.law": "newton",
        "contact.impulse": "lumped",
    }
    literal = Instants.of(compute(settings, 60, "compiled"))
    assert literal.energy.max() > 2.0 * -literal.energy.min()
    assert literal.gain > 0.3 * literal.loss


def test_literal_scheme_blows_up_and_says_what_helps() -> None:
    settings = {"damping.rayleigh": "mass", "contact.impulse": "lumped"}
    result = compute(settings, 300, "compiled")
    assert result.summary["outcome"] == "diverged"
    assert 'contact.impulse = "consistent"' in result.summary["message"]
    settings["contact.impulse"] = "consistent"
    assert compute(settings, 100, "compiled").summary["outcome"] == "completed"


def reaction_work(o: Operators, motions: Motions, base: FloatArray, law: Law) -> float:
    """Return the integral of the support reaction times the base velocity [J].

    R = m_b·a + c_b·v + k_b·u + M_aa q'' + C_aa q' + K_aa q with a from the equation of motion,
    by the trapezoidal rule between impacts; at an impact the support feels m_b·Δv at once.
    """
    n, steps = o.n_dofs, len(motions.frames)
    dt = motions.time[1]
    after = np.concatenate([np.zeros((1, 2, n)), motions.frames])
    jumps = np.zeros((steps + 1, n))
    M, H = sp.csc_matrix(o.mass), sp.csc_matrix(o.gap_matrix)
    for time, pair, p in zip(
        motions.impact_time, motions.impact_pair, motions.impulse, strict=True
    ):
        jumps[round(time / dt)] += p * spsolve(M, H[pair].toarray().ravel())
    before = after.copy()
    before[:, 1] -= jumps
    couple = o.base

    def reaction(states: FloatArray) -> FloatArray:
        u, v = states[:, 0], states[:, 1]
        gap, rate = u @ H.T + o.gap0, v @ H.T
        spring = law.spring[0] * gap + law.spring[1] * rate
        contact = -np.where(gap <= 0.0, spring, 0.0) if law.name == "penalty" else 0.0 * gap
        load = -base @ np.array([couple.stiffness, couple.damping, couple.mass])
        force = load - u @ o.stiffness.T - v @ o.damping.T + contact @ H
        a = spsolve(M, force.T).T
        corner_force = base @ np.array([couple.corner[2], couple.corner[1], couple.corner[0]])
        return np.asarray(
            a @ couple.mass + v @ couple.damping + u @ couple.stiffness + corner_force
        )

    power_before, power_after = (reaction(states) * base[:, 1] for states in (before, after))
    smooth = 0.5 * dt * float((power_after[:-1] + power_before[1:]).sum())
    return smooth + float((jumps @ couple.mass) @ base[:, 1])


def base_work_error(case: Case, law: Law, steps: int) -> tuple[float, float]:
    """Return the work of the base in a period: the ledger's less the reaction's, the latter."""
    o = assemble(case, needs_dolfinx=False).operators
    motion = base_motion(case.excitation)
    motions = simulate(
        o,
        law,
        (np.zeros(o.n_dofs), np.zeros(o.n_dofs)),
        time_step=case.period / steps,
        n_steps=steps,
        motion=motion.states,
        keep_frames=True,
    )
    if law.name == "newton":
        assert motions.impulse.size > 5
    elif law.spring[0]:
        assert (motions.frames[:, 0] @ o.gap_matrix.T + o.gap0 < 0.0).any()
    expected = reaction_work(o, motions, motion.states(motions.time), law)
    return motions.ledger[0, LEDGER.index("base_work")] - expected, expected


NO_CONTACT = Law("penalty", spring=(0.0, 0.0))


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
@pytest.mark.parametrize(
    "law",
    [NO_CONTACT, Law("penalty", spring=(100.0, 0.05)), Law("newton", 0.1)],
    ids=["none", "penalty", "newton"],
)
def test_base_work_is_that_of_the_support_reaction(law: Law, mass: str) -> None:
    """The ledger adds up differences of state; it tends to the integral of R q' in order 2."""
    case = preset("paper", {"mesh.elements": 3, "time.mass": mass, "gap.tip": 0.002})
    errors = []
    for steps in (500, 1000, 2000, 4000):
        error, work = base_work_error(case, law, steps)
        errors.append(abs(error) / abs(work))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(2.0, abs=BASE_WORK_ORDER)
    assert errors[-1] < BASE_WORK


OWN_RESIDUALS = {
    "β = 1/4, γ = 1/2": (Scheme("newmark"), None, 0.0),
    "θ = 1/2": (Scheme("moreau-jean"), None, 0.0),
    "central difference": (SCHEMES["central-difference"], 2.0, 8e-8),
    "β = 1/6, γ = 1/2": (Scheme("newmark", beta=1 / 6), 2.0, 2.7e-8),
    "γ = 0.6": (Scheme("newmark", beta=0.3025, gamma=0.6), 1.0, 1.0e-4),
    "θ = 0.6": (Scheme("moreau-jean", theta=0.6), 1.0, 1.8e-4),
    "θ = 1": (Scheme("moreau-jean", theta=1.0), 1.0, 8.7e-4),
}
"""Schemes with the order of the ledger's residual in Δt, and the residual with 400 steps."""


@pytest.mark.parametrize("name", OWN_RESIDUALS)
@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_the_residual_of_each_scheme(name: str, engine: Engine) -> None:
    """An oscillator with D = 0.05 and a stop at 0, ω = 2.2, e = 0.5, over 20 periods."""
    scheme, order, size = OWN_RESIDUALS[name]
    one, none = sp.identity(1, format="csr"), np.zeros(1)
    o = Operators(
        one, 0.1 * one, one, BaseCoupling(none, np.array([-0.1]), -np.ones(1), (0.0, 0.1, 1.0)),
        -one, none, probes=one,
    )  # fmt: skip
    solutions = [
        solve(
            o, contact.Law("newton", restitution=0.5), scheme, HarmonicMotion(1.0, 1.1 / np.pi),
            steps_per_period=n, periods=20, engine=engine,
        )
        for n in (400, 1600)
    ]  # fmt: skip
    residuals = [solution.recorder.energy_residual() for solution in solutions]
    assert solutions[0].impacts.pair.size > 20
    if order is None:
        assert max(residuals) < 1e-14
        return
    assert residuals[0] == pytest.approx(size, rel=0.05)
    assert np.log(residuals[0] / residuals[1]) / np.log(4.0) == pytest.approx(order, abs=0.05)


HOT: dict[str, dict[str, object]] = {
    "newton": {"contact.law": "newton@moreau-jean"},
    "damped, divided steps": {
        "contact.law": "penalty", "contact.penalty_stiffness": 1e4, "contact.penalty_damping": 0.5,
        "time.refine": 8,
    },
}  # fmt: skip


@pytest.mark.parametrize("law", HOT)
@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_heat_over_x_is_what_the_ledger_says_contact_takes(law: str, engine: Engine) -> None:
    """Divided steps are undone and made again; what they took must count once."""
    settings = {"mesh.elements": 8, "time.steps_per_period": 400, "output.window_periods": 2}
    history = compute({**settings, **HOT[law]}, periods=3, engine=engine).history
    lost = (history.energy_impact_loss + history.energy_contact_damping_loss).values[-2:].sum()
    assert lost > 1e-4
    seconds = history.sizes["time"] * (history.time.values[1] - history.time.values[0])
    assert float(history.heat.sum()) * seconds == pytest.approx(lost, rel=1e-12)
    assert (history.heat.values > 0.0).sum() >= 2  # not at one place
    if law == "newton":
        hit = history.event_node.values
        before, impulse = history.event_velocity_before.values, history.event_impulse.values
        work = -0.5 * impulse * (1.0 - 0.1) * before
        expected = np.bincount(hit, work, history.sizes["node"]) / seconds
        np.testing.assert_allclose(history.heat.values, expected, atol=1e-9 * expected.max())


def test_heat_of_stops_is_apart_from_that_between_laminae() -> None:
    """An elastic stop with a damper under a tip takes all that is lost in contact."""
    case = preset("paper", {
        "mesh.elements": 6, "time.periods": 2, "time.steps_per_period": 400, "gap.tip": 0.1,
        "contact.law": "penalty", "contact.penalty_stiffness": 1e4, "contact.penalty_damping": 0.5,
        "stop": [{"lamina": "thick", "position": 0.685, "side": "both", "gap": 0.002, "on": "base",
                  "stiffness": 2e4, "damping": 1.0}],
    })  # fmt: skip
    history = run(case, "compiled").history
    lost = float(history.energy_contact_damping_loss.sum())
    assert lost > 1e-5
    assert not history.heat.values.any()
    assert float(history.stop_heat.sum()) * 2 * case.period == pytest.approx(lost, rel=1e-12)

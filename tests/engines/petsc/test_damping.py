"""Rayleigh damping without products with K: the same motion and the same loss as with them."""

from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plates import plate

import delam_fem as df
from delam_fem import Decision
from delam_fem.api import Case, Operators, assemble, preset
from delam_fem.engines.petsc.theta import MoreauJean

DT = 2e-4
ROUND_OFF = 1e-8
"""Relative, of positions and losses after 30 steps with stiff modes, and of plates that clap."""
LEDGER = 1e-9
"""Energy that the ledger does not explain, in parts of the largest: round-off."""


def problem() -> Operators:
    case = preset("paper", {"mesh.elements": 6})
    structure = assemble(case, needs_dolfinx=False)
    o = structure.operators
    alpha, beta = np.zeros((2, o.n_dofs))
    for i, part in enumerate(structure.layout.parts):
        alpha[part.own_dofs], beta[part.own_dofs] = case.rayleigh(i)
    C = alpha[:, None] * o.mass.toarray() + beta[:, None] * o.stiffness.toarray()
    assert np.allclose(C, o.damping.toarray(), rtol=1e-12, atol=1e-12 * np.abs(C).max())
    return replace(o, rayleigh=(alpha, beta))


@pytest.mark.parametrize("theta", [0.5, 0.8])
def test_motion_and_loss_are_those_of_products_with_the_damping(theta: float) -> None:
    o = problem()
    t = DT * np.arange(31)
    base_states = 0.0025 * np.array([np.sin(20 * t), 20 * np.cos(20 * t), -400 * np.sin(20 * t)]).T
    hit, impulses = np.array([1, 4]), np.array([2e-4, 1e-4])
    ends = []
    for operators in (o, replace(o, rayleigh=None)):
        stepper = MoreauJean(operators, 2 * DT, DT, theta=theta)
        stepper.begin(base_states)
        stepper.finish_step()
        for step in range(30):
            if step == 12:  # a step that is undone leaves nothing behind
                stepper.keep()
                stepper.advance()
                stepper.undo()
                stepper.begin_step(base_states[12], base_states[13])
            stepper.use(0 if step in (5, 20) else 1)
            stepper.advance()
            if step in (12, 25):
                stepper.jump(Decision(hit, impulses, np.zeros(2), np.zeros(2)))
            stepper.finish_step()
            if step == 12:
                stepper.begin(base_states[13:])
                stepper.finish_step()
        ends.append((stepper.state()[:2], stepper.dissipated))
        stepper.destroy()
    (state, loss), (expected, expected_loss) = ends
    assert loss == pytest.approx(expected_loss, rel=ROUND_OFF)
    for values, row in zip(state, expected, strict=True):
        assert np.abs(values - row).max() <= ROUND_OFF * np.abs(row).max()


PATCH = {"between": ["lower", "upper"], "start": 0.06, "end": 0.12, "across": [-0.03, 0.01]}


def clapping(law: str, impulse: str, refine: int, damper: float | None = None) -> Case:
    """Return a plate on springs at one edge, whose matrices are wide.

    Args:
        law: with its scheme.
        impulse: "lumped" or "consistent".
        refine: parts of a step near contact.
        damper: damping of that edge [N s/m], with which C is no longer Rayleigh damping.
    """
    edge: dict[str, object] = {"kind": "spring", "stiffness": 1e5}
    contact: dict[str, object] = {"law": law}
    if law.startswith("newton"):
        contact |= {"restitution": 0.3, "impulse": impulse}
    if "penalty" in law:
        contact |= {"penalty_stiffness": 1e5}
    if law == "penalty":
        contact |= {"penalty_damping": 0.5}
    return plate(
        {"start": "clamped", "end": edge | ({} if damper is None else {"damping": damper})}, 6, 6,
        thicknesses=(0.0014, 0.0006), delamination=[PATCH], contact=contact,
        excitation={
            "kind": "force", "lamina": "lower", "position": 0.03, "amplitude": 5.0,
            "frequency": 300.0,
        },
        time={"steps_per_period": 100, "periods": 2, "refine": refine},
        output={"window_periods": 2, "fields_per_period": 0},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "impulse", "refine"),
    [
        ("newton@moreau-jean", "consistent", 1),
        ("newton@moreau-jean", "consistent", 4),
        ("newton@newmark", "consistent", 1),
        ("newton@newmark", "lumped", 4),
        ("newton-penalty@newmark", "lumped", 1),
        ("newton-penalty@newmark", "consistent", 4),
        ("penalty@newmark", "consistent", 1),
    ],
)
def test_a_plate_claps_as_one_with_a_damper_that_does_nothing(
    law: str, impulse: str, refine: int
) -> None:
    """With the damper C is not Rayleigh damping, and each step makes all products."""
    result = df.run(clapping(law, impulse, refine), engine="petsc")
    other_case = clapping(law, impulse, refine, damper=1e-12)
    structure = assemble(other_case)
    assert structure.operators.rayleigh is None
    other = df.run(other_case, structure=structure, engine="petsc")
    assert result.history.sizes["event"] > 0 or law.startswith("penalty")
    for name in ("tip_displacement", "tip_velocity", "energy_damping_loss", "energy_kinetic"):
        values, expected = (r.history[name].to_numpy() for r in (result, other))
        assert np.abs(values - expected).max() <= ROUND_OFF * np.abs(expected).max(), name
    assert result.summary["energy_residual"] < LEDGER


@pytest.mark.slow
@pytest.mark.parametrize("law", ["newton@moreau-jean", "newton-penalty@newmark"])
def test_a_plate_that_goes_on_from_a_file_has_the_same_bits(law: str, tmp_path: Path) -> None:
    case = clapping(law, "consistent", 4)
    unbroken = df.run(case, engine="petsc")
    assert unbroken.history.sizes["event"] > 0

    def interrupt(done: int, _: int) -> None:
        if done == 1:
            signal.raise_signal(signal.SIGINT)

    cut = df.run(case, engine="petsc", directory=tmp_path, progress=interrupt)
    assert cut.summary["outcome"] == "interrupted"
    again = df.run(case, engine="petsc", directory=tmp_path, resume=True)
    assert again.history.equals(unbroken.history)
    assert np.array_equal(again.state.motion, unbroken.state.motion)

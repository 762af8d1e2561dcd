"""Rayleigh damping by one product with K: the same motion and the same loss as with C."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delam_fem import Decision
from delam_fem.api import Operators, assemble, preset
from delam_fem.engines.petsc.theta import MoreauJean

DT = 2e-4
ROUND_OFF = 1e-8
"""Relative, of positions and losses after 30 steps with stiff modes."""


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

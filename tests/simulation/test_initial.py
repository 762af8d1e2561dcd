"""Initial states in the first mode of each lamina."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.api import assemble, first_mode, initial_state, preset
from delam_fem.numerics.beams import cantilever_mode

N = 8
STRUCTURE = assemble(preset("paper", {"mesh.elements": N}), needs_dolfinx=False)
MESH_ERROR = 1e-4
"""Of the mode at the nodes. Measured: 2e-7."""


@pytest.mark.parametrize("number", [0, 1])
def test_the_first_mode_is_that_of_the_cantilever_and_of_one_lamina_alone(number: int) -> None:
    mode = first_mode(STRUCTURE, number)
    dofs = STRUCTURE.layout.parts[number].own_dofs
    exact = cantilever_mode(1, np.arange(1, N + 1) / N)
    assert mode[dofs[::2]] == pytest.approx(exact, abs=MESH_ERROR)
    assert mode[dofs[-2]] == pytest.approx(1.0, abs=1e-14)
    assert not np.delete(mode, dofs).any()
    o = STRUCTURE.operators
    residual = o.stiffness @ mode - (mode @ o.stiffness @ mode) / (mode @ o.mass @ mode) * (
        o.mass @ mode
    )
    assert np.abs(residual).max() < 1e-9 * np.abs(o.stiffness @ mode).max()


def test_given_tips_move_as_given_and_all_others_rest() -> None:
    state = initial_state(STRUCTURE, {"thick.displacement": 0.01, "thin.velocity": -0.5})
    assert state is not None
    u, v, a = state.motion
    assert u == pytest.approx(0.01 * first_mode(STRUCTURE, 0), abs=1e-16)
    assert v == pytest.approx(-0.5 * first_mode(STRUCTURE, 1), abs=1e-16)
    assert not a.any()
    assert state.resting.tolist() == [False] * N


def test_nothing_given_is_no_state() -> None:
    assert initial_state(STRUCTURE, {"thick.displacement": 0.0, "thin.velocity": 0.0}) is None

"""The law "recovery" keeps the floors of all pairs, also of open ones that others push down."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from delam_fem.contact.laws import Law
from delam_fem.engines.choose import EngineName
from delam_fem.engines.session import solve
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics.schemes import SCHEMES
from delam_fem.simulation.loop import State

STEP = 1e-3
"""Time step [s]."""
W = np.array([[1.0, -0.9, -0.2], [-0.9, 1.0, 0.1], [-0.2, 0.1, 1.0]])
"""H M⁻¹ Hᵀ: an impulse on the first pair closes the two others, as a lever would [1/kg]."""
ROUND_OFF = 1e-12


def levers(gap0: list[float]) -> Operators:
    """Return three masses above a floor whose mass matrix couples them, u their heights."""
    zero = sp.csr_matrix((3, 3))
    return Operators(
        mass=sp.csr_matrix(np.linalg.inv(W)),
        damping=zero,
        stiffness=zero,
        base=BaseCoupling.none(3),
        gap_matrix=sp.identity(3, format="csr"),
        gap0=np.array(gap0),
        probes=sp.identity(3, format="csr"),
    )


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_open_pairs_that_an_impulse_closes_receive_one_too(engine: EngineName) -> None:
    """The first pair is closed and comes with 1 m/s; the second is open and at rest.

    The impulse that stops the first one alone gives the second -0.9 m/s, which would close its gap
    of 2 µm within the step: it may lose it all, -2e-3 m/s. The third, far away, is not touched.
    """
    state = State(np.array([[0.0] * 3, [-1.0, 0.0, 0.0], [0.0] * 3]), np.zeros(3, dtype=bool))
    found = solve(
        levers([0.0, 2e-6, 1.0]),
        Law("recovery", restitution=0.0),
        SCHEMES["moreau-jean"],
        time_step=STEP,
        steps_per_period=1,
        periods=1,
        initial=state,
        engine=engine,
    )
    impulses = np.linalg.solve(W[:2, :2], [1.0, -2e-3])
    assert found.impacts.pair.tolist() == [0, 1]
    assert found.impacts.impulse == pytest.approx(impulses, rel=ROUND_OFF)
    after = found.velocity[-1]
    assert after[:2] == pytest.approx([0.0, -2e-3], abs=ROUND_OFF)
    assert after[2] == pytest.approx(W[2, :2] @ impulses, rel=ROUND_OFF)

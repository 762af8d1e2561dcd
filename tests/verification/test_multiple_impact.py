"""Newton's law at several contacts at once: with `newmark` one law, with `moreau-jean` another.

Three equal carts on a line; the second and the third touch, the first hits the second with 1 m/s.
Between two steps only pairs that approach are hit: a sequence of single impacts, as in Newton's
cradle. Within a step every closed pair obeys Moreau's law, 0 ≤ p ⊥ U̇⁺ + e U̇⁻ ≥ 0, at once.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import delam_fem as df
from delam_fem.api import EngineName, solve
from delam_fem.contact.laws import SchemeName

OUTCOMES = {
    ("newmark", 1.0): (0.0, 0.0, 1.0),
    ("central-difference", 1.0): (0.0, 0.0, 1.0),
    ("moreau-jean", 1.0): (-1 / 3, 2 / 3, 2 / 3),
    # 1 hits 2, 2 hits 3, 1 hits 2 again: (1/4, 3/4, 0), (1/4, 3/16, 9/16), (13/64, 15/64, 9/16)
    ("newmark", 0.5): (13 / 64, 15 / 64, 9 / 16),
    ("central-difference", 0.5): (13 / 64, 15 / 64, 9 / 16),
    ("moreau-jean", 0.5): (0.0, 0.5, 0.5),
}
"""Velocities afterwards [m/s] by scheme and e, by hand."""
ROUND_OFF = 1e-12


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize("time_step", [1e-2, 1e-4])
@pytest.mark.parametrize(("scheme", "e"), OUTCOMES)
def test_three_carts(scheme: SchemeName, e: float, time_step: float, engine: EngineName) -> None:
    """No step is too small for the laws to differ: this is no error of the time integration."""
    unit, zero = sp.identity(3, format="csr"), np.zeros(3)
    gaps = sp.csr_matrix([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    carts = df.Operators(
        unit, 0.0 * unit, 0.0 * unit, df.BaseCoupling(zero, zero, zero), gaps,
        np.array([0.1, 0.0]), probes=unit,
    )  # fmt: skip
    start = np.zeros((3, 3))
    start[1, 0] = 1.0
    solution = solve(
        carts, df.Law("newton", restitution=e), df.SCHEMES[scheme], time_step=time_step,
        steps_per_period=round(0.2 / time_step), periods=1, engine=engine,
        initial=df.State(start, np.zeros(2, np.bool_)),
    )  # fmt: skip
    assert solution.velocity[-1] == pytest.approx(OUTCOMES[scheme, e], abs=ROUND_OFF)
    assert solution.velocity[-1].sum() == pytest.approx(1.0, abs=ROUND_OFF)

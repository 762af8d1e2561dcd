"""Initial conditions in the first mode of each lamina."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.sparse.linalg import splu

from delam_fem.case.definition import Case
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.loop import State

_ITERATIONS = 12
"""Of the inverse iteration; each divides what is left of mode 2 by (ω2/ω1)² = 39."""


def first_mode(operators: Operators, lamina: int) -> FloatArray:
    """Return the first mode of one lamina, the other one straight.

    Inverse iteration v <- K⁻¹ M v.

    Args:
        operators: of two laminae, the free dofs of lamina 1 before those of lamina 2.
        lamina: index, 0 or 1.

    Returns:
        u and φ of all free dofs, 1 at the tip, shape (n,) [-, 1/m].
    """
    half = operators.n_dofs // 2
    own = slice(lamina * half, (lamina + 1) * half)
    K, M = operators.stiffness[own, own], operators.mass[own, own]
    solve = splu(K.tocsc()).solve
    shape = np.ones(half)
    for _ in range(_ITERATIONS):
        shape = solve(M @ shape)
        shape /= shape[-2]  # the tip's displacement
    mode = np.zeros(operators.n_dofs)
    mode[own] = shape
    return mode


def initial_state(case: Case, operators: Operators, given: Mapping[str, float]) -> State | None:
    """Return the state of given tip displacements and velocities in the first modes.

    Args:
        case: gives the names of the laminae.
        operators: of the case.
        given: tip displacement [m] and velocity [m/s] by `LAMINA.displacement`, `….velocity`.

    Returns:
        The state; None, which is rest, where nothing is given.
    """
    if not any(given.values()):
        return None
    motion = np.zeros((3, operators.n_dofs))
    for i, lamina in enumerate(case.lamina):
        mode = first_mode(operators, i)
        motion[0] += given.get(f"{lamina.name}.displacement", 0.0) * mode
        motion[1] += given.get(f"{lamina.name}.velocity", 0.0) * mode
    return State(motion, np.zeros(operators.n_pairs, dtype=np.bool_))

"""Compute initial states in the first mode of each lamina."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.sparse.linalg import splu

from delam_fem.model.layout import Structure
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.loop import State

_ITERATIONS = 12
"""Number of inverse iterations; each divides the share of mode 2 by (ω2/ω1)² = 39."""


def first_mode(structure: Structure, number: int) -> FloatArray:
    """Return the first mode of one part, while all other parts stay straight.

    The mode follows from the inverse iteration v <- K⁻¹ M v.

    Args:
        structure: the discretised structure.
        number: number of the part; the probe with the same number scales the mode.

    Returns:
        Mode in all free dofs, 1 at the probe, shape (n,) [-, 1/m].
    """
    operators = structure.operators
    own = structure.layout.own_dofs(number)
    K, M = (matrix[own][:, own] for matrix in (operators.stiffness, operators.mass))
    probe = operators.probes[number, own]
    solve = splu(K.tocsc()).solve
    shape = np.ones(own.size)
    for _ in range(_ITERATIONS):
        shape = solve(M @ shape)
        shape /= (probe @ shape)[0]
    mode = np.zeros(operators.n_dofs)
    mode[own] = shape
    return mode


def initial_state(
    structure: Structure,
    given: Mapping[str, float],
    mode_of: Callable[[int], FloatArray] | None = None,
) -> State | None:
    """Return the state in which each lamina has a given tip motion in its first mode.

    Args:
        structure: the discretised structure; its parts have the names of the laminae.
        given: tip displacements [m] by `LAMINA.displacement`, tip velocities [m/s] by
            `LAMINA.velocity`.
        mode_of: function that gives the first mode of a part by its number, where it is known
            already; default: it is computed.

    Returns:
        The state; None (at rest) if all given numbers are 0.
    """
    if not any(given.values()):
        return None
    motion = np.zeros((3, structure.operators.n_dofs))
    for number, part in enumerate(structure.layout.parts):
        mode = mode_of(number) if mode_of is not None else first_mode(structure, number)
        motion[0] += given.get(f"{part.name}.displacement", 0.0) * mode
        motion[1] += given.get(f"{part.name}.velocity", 0.0) * mode
    return State(motion, np.zeros(structure.operators.n_pairs, dtype=np.bool_))

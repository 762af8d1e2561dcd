"""Matrices of PETSc in the place of SciPy's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import delam_fem as df
from delam_fem.api import BaseCoupling

PETSc = pytest.importorskip("petsc4py.PETSc")
MASS, STIFFNESS, SPEED = 2.0, 800.0, 0.3
"""A mass on a spring that begins with a speed: u = v/w sin(wt), w = 20 rad/s."""


def petsc(value: float) -> Any:
    """Return a 1 x 1 matrix of PETSc."""
    matrix = PETSc.Mat().createAIJ([1, 1], comm=PETSc.COMM_SELF)
    matrix.setUp()
    matrix.setValue(0, 0, value)
    matrix.assemble()
    return matrix


def test_operators_take_matrices_of_petsc() -> None:
    zero = np.zeros(1)
    operators = df.Operators(
        mass=petsc(MASS), damping=petsc(0.0), stiffness=petsc(STIFFNESS),
        base=BaseCoupling(zero, zero, zero), gap_matrix=sp.csr_matrix((0, 1)), gap0=np.zeros(0),
        probes=sp.csr_matrix([[1.0]]), start=np.array([[0.0], [SPEED]]),
    )  # fmt: skip
    assert sp.issparse(operators.mass)
    w = (STIFFNESS / MASS) ** 0.5
    period = 2.0 * np.pi / w
    result = df.run(operators, "compiled", law="none", scheme="newmark",
                    time_step=period / 1000, steps_per_period=1000, periods=1,
                    window_periods=1)  # fmt: skip
    u = result.history["probe_displacement"].to_numpy()[0]
    assert u.max() == pytest.approx(SPEED / w, rel=1e-4)

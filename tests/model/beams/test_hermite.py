"""The Hermite interpolant on P1 × P1, on reversed and graded cells, in serial and in parallel."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from mpi_pool import Crew

from delam_fem.model.beams.forms import BENDING_DEGREE, MASS_DEGREE, Hermite

ROUND_OFF = 1e-13
"""Relative: sums of a few dozen products."""

X = np.array([0.0, 0.13, 0.21, 0.58, 1.0])
REVERSED = np.array([[0, 1], [2, 1], [2, 3], [4, 3]])


def forms(line: Hermite) -> tuple[object, object]:
    pair, test = ufl.TrialFunction(line.space), ufl.TestFunction(line.space)
    dx = ufl.dx(metadata={"quadrature_degree": MASS_DEGREE})
    dx2 = ufl.dx(metadata={"quadrature_degree": BENDING_DEGREE})
    mass = line.value(pair) * line.value(test) * dx
    return mass, line.curvature(pair) * line.curvature(test) * dx2


def cubic(x: np.ndarray) -> np.ndarray:
    """Nodal (u, phi) of u = 1 - 2 x + 3 x² - 4 x³."""
    return np.column_stack([1 - 2 * x + 3 * x**2 - 4 * x**3, -2 + 6 * x - 12 * x**2]).ravel()


def test_cubic_is_represented_exactly_on_reversed_and_graded_cells() -> None:
    line = Hermite.on_line(MPI.COMM_SELF, X, REVERSED)
    M, K = (line.assemble(form) for form in forms(line))
    w = cubic(X)
    u = np.polynomial.Polynomial([1, -2, 3, -4])
    square, bent = (u**2).integ()(1.0), (u.deriv(2) ** 2).integ()(1.0)
    assert w @ M @ w == pytest.approx(square, rel=ROUND_OFF)
    assert w @ K @ w == pytest.approx(bent, rel=ROUND_OFF)


def test_bending_energy_of_a_rigid_motion_is_zero() -> None:
    line = Hermite.on_line(MPI.COMM_SELF, X, REVERSED)
    _, K = (line.assemble(form) for form in forms(line))
    rigid = np.column_stack([2.0 + 3.0 * X, np.full_like(X, 3.0)]).ravel()
    assert np.abs(K @ rigid).max() < ROUND_OFF * abs(K).max()


def test_direction_of_cells_does_not_matter() -> None:
    forward = np.sort(REVERSED, axis=1)
    one, two = (Hermite.on_line(MPI.COMM_SELF, X, cells) for cells in (REVERSED, forward))
    for a, b in zip(forms(one), forms(two), strict=True):
        A, B = one.assemble(a), two.assemble(b)
        assert abs(A - B).max() < ROUND_OFF * abs(B).max()


def test_coefficient_knows_cell_and_place() -> None:
    line = Hermite.on_line(MPI.COMM_SELF, X, REVERSED)
    pair, test = ufl.TrialFunction(line.space), ufl.TestFunction(line.space)
    weight = line.coefficient(lambda cells, x: np.where(cells == 2, x**2, 0.0))
    dx = ufl.dx(metadata={"quadrature_degree": MASS_DEGREE})
    M = line.assemble(weight * line.value(pair) * line.value(test) * dx)
    ones = np.tile([1.0, 0.0], len(X))
    assert ones @ M @ ones == pytest.approx((X[3] ** 3 - X[2] ** 3) / 3, rel=ROUND_OFF)


PARALLEL = """
from delam_fem.system.mpi import MPI
from delam_fem.model.beams import forms
from delam_fem.case.files import preset
case = preset("paper")
one = forms.assemble(case, comm=MPI.COMM_SELF).operators
all_ = forms.assemble(case, comm=comm).operators
for name in ("mass", "damping", "stiffness"):
    a, b = getattr(one, name), getattr(all_, name)
    assert abs(a - b).max() <= 1e-14 * abs(a).max(), name
assert comm.size == 2
"""


@pytest.mark.mpi
def test_two_ranks_assemble_what_one_does(crew: Crew) -> None:
    crew.run(2, PARALLEL)

"""Options of PETSc with the package's prefixes are honoured or refused; nothing ignores them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
import scipy.sparse as sp
from project import ROOT

import delam_fem as df
from delam_fem.api import MPI, Solution, assemble, preset, solve
from delam_fem.engines.petsc import linear_algebra
from delam_fem.model.operators import matrix, with_near_null

from petsc4py import PETSc  # isort: skip  # the door to MPI comes first

N = 30
CHAIN = sp.diags([-1.0, 2.001, -1.0], [-1, 0, 1], shape=(N, N), format="csr")
LOAD = np.cos(np.arange(N))


@pytest.fixture(autouse=True)
def options() -> Iterator[PETSc.Options]:
    yield PETSc.Options()
    for name in PETSc.Options().getAll():
        if name.startswith(("moreau_", "newmark_")):
            PETSc.Options().delValue(name)


def solution(scale: float = -0.5) -> np.ndarray:
    factor = linear_algebra.PetscFactor(matrix(CHAIN.copy(), MPI.COMM_SELF), "moreau_", scale)
    x = PETSc.Vec().createSeq(N)
    factor.solve(linear_algebra.vector_in(LOAD.copy()), x)
    factor.destroy()
    return np.asarray(x.array)


def test_a_destroyed_factor_leaves_no_matrix_behind() -> None:
    petsc_matrix = matrix(CHAIN.copy(), MPI.COMM_SELF)
    factor = linear_algebra.PetscFactor(petsc_matrix, "moreau_")
    assert not petsc_matrix  # a factor is enough: in 3D its matrix is as large
    factored_matrix = factor.solve.__self__
    assert isinstance(factored_matrix, PETSc.Mat) and factored_matrix
    factor.destroy()
    assert not factored_matrix  # a sweep of many points would keep 24 kB of each


@pytest.mark.parametrize("kind", ["beam", "plane-stress"])
def test_small_factors_solve_as_dense_ones_do(kind: str) -> None:
    """PETSc's Cholesky factors of blocks of 2 × 2 pass for beams and are wrong for solids."""
    case = preset("paper", {"model.kind": kind, "model.poisson": 0.3, "mesh.elements": 8})
    o, reach = assemble(case).operators, 5e-6
    rows = sp.csr_matrix(o.mass + reach * o.damping + reach**2 * o.stiffness)
    load, x = np.cos(np.arange(o.n_dofs)), np.zeros(o.n_dofs)
    expected = np.linalg.solve(rows.toarray(), load)
    factor = linear_algebra.PetscFactor(matrix(rows, MPI.COMM_SELF), "moreau_")
    factor.solve(linear_algebra.vector_in(load), linear_algebra.vector_in(x))
    factor.destroy()
    np.testing.assert_allclose(x, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


def test_gradients_go_on_to_what_the_ledger_asks_for(options: PETSc.Options) -> None:
    options.insertString("-moreau_pc_type jacobi")
    rows = sp.diags([-1.0, 2.1, -1.0], [-1, 0, 1], shape=(1000, 1000), format="csr")
    factor = linear_algebra.PetscFactor(matrix(rows.copy(), MPI.COMM_SELF), "moreau_")
    load, x = np.ones(1000), PETSc.Vec().createSeq(1000)
    factor.solve(linear_algebra.vector_in(load), x)
    factor.destroy()
    assert np.linalg.norm(rows @ x.array - load) < 1e-13 * np.linalg.norm(load)


@pytest.mark.parametrize(
    "text",
    [
        "-moreau_ksp_type cg",
        "-moreau_pc_type jacobi",
        "-moreau_pc_type gamg -moreau_mg_levels_ksp_max_it 3",
        "-moreau_ksp_type gmres -moreau_pc_type sor -moreau_ksp_rtol 1e-12",
        "-moreau_pc_factor_mat_solver_type mumps",
    ],
)
def test_a_solver_of_options_solves(text: str, options: PETSc.Options) -> None:
    options.insertString(text)
    expected = np.linalg.solve(-0.5 * CHAIN.toarray(), LOAD)
    assert solution() == pytest.approx(expected, rel=1e-7, abs=1e-7)


def test_options_reach_the_solver_that_is_called(options: PETSc.Options) -> None:
    options.insertString("-moreau_pc_type jacobi -moreau_ksp_max_it 2")
    with pytest.raises(df.CaseError, match=r"-moreau_pc_type.*no solution after 2 iterations"):
        solution()


@pytest.mark.parametrize(
    ("text", "given"),
    [
        ("-moreau_ksp_type preonly -moreau_pc_type jacobi", "a residual of"),
        ("-moreau_ksp_type bogus", "PETSc's error 86"),
    ],
)
def test_what_does_not_solve_is_refused(text: str, given: str, options: PETSc.Options) -> None:
    options.insertString(text)
    with pytest.raises(df.CaseError, match=given):
        solution()


def test_options_of_one_prefix_leave_the_others_alone(options: PETSc.Options) -> None:
    options.insertString("-newmark_mass_ksp_type cg")
    factor = linear_algebra.PetscFactor(matrix(CHAIN.copy(), MPI.COMM_SELF), "newmark_")
    assert factor.solve.__self__.__class__ is PETSc.Mat  # the factor itself, without a KSP
    factor.destroy()


def drop(engine: str) -> Solution:
    """Let a ball fall for ten steps."""
    one = sp.csr_matrix([[1.0]])
    ball = df.Operators(
        one, 0 * one, 0 * one, df.BaseCoupling.none(1), one, np.ones(1), np.ones(1), probes=one
    )
    return solve(
        ball, "newton", "moreau-jean", time_step=1e-3, steps_per_period=10, periods=1, engine=engine
    )


@pytest.mark.parametrize("text", ["-moreau_no_such 3", "-newmark_pc_type lu", "-moreau_ksp_rtol 1"])
@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_options_that_nobody_reads_are_named(
    text: str, engine: str, options: PETSc.Options
) -> None:
    options.insertString(text)
    with pytest.raises(df.CaseError, match=f"PETSC_OPTIONS: {text.split()[0]}: expected"):
        drop(engine)


@pytest.mark.parametrize("engine", ["petsc", pytest.param("compiled", marks=pytest.mark.nightly)])
def test_the_command_refuses_in_one_line(engine: str, tmp_path: object) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "delam_fem", "run", "paper", "--engine", engine, "-o",
         f"{tmp_path}/run", "--set", "time.periods=1"],
        env={**os.environ, "PETSC_OPTIONS": "-moreau_no_such 3"},
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "-moreau_no_such" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize("kind", ["plane-stress", "solid"])
@pytest.mark.parametrize("impulse", ["lumped", "consistent"])  # displacements, and columns
def test_a_turn_about_a_pin_is_a_rigid_motion(kind: str, impulse: str) -> None:
    ends = {"support.start": "pinned", "support.end": "free", "contact.impulse": impulse}
    case = preset("embedded", {"model.kind": kind, "mesh.elements": 10, **ends})
    o = assemble(case).operators
    dim = {"plane-stress": 2, "solid": 3}[kind]
    assert o.near_null is not None and o.near_null.shape == (o.n_dofs, 3 * dim - 3)
    middle = 0.5 * sum(lamina.thickness for lamina in case.lamina)
    turn = o.near_null[:, dim] + middle * o.near_null[:, 0]
    about_another = np.abs(o.stiffness @ o.near_null[:, dim]).max()
    assert float(np.abs(o.stiffness @ turn).max()) < 1e-6 * float(about_another)


def test_a_near_null_space_reaches_the_matrix_of_the_solver() -> None:
    K = with_near_null(matrix(CHAIN, MPI.COMM_SELF), np.ones((N, 2)))
    (constant,) = K.getNearNullSpace().getVecs()  # the second shape is the first once more
    assert constant.array_r == pytest.approx(np.full(N, N**-0.5))

"""Operators from a user's forms of UFL and matrices of PETSc: supports, gaps, names, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import MPI, solve
from delam_fem.model import _dolfinx
from delam_fem.model.operators import spread

import dolfinx  # isort: skip  # the door to it comes first
import ufl  # isort: skip

N = 4
TIP = {"tip": ([1.0], (1.0,))}


@pytest.fixture(scope="module")
def bar() -> tuple[object, object, list[object]]:
    """Return forms of M and K of a bar of four cells, and its clamp at x = 0."""
    mesh = dolfinx.mesh.create_interval(MPI.COMM_SELF, N, [0.0, 1.0])
    V = getattr(dolfinx.fem, "functionspace", dolfinx.fem.FunctionSpace)(mesh, ("Lagrange", 1))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    clamped_dofs = dolfinx.fem.locate_dofs_geometrical(V, lambda x: x[0] < 1e-9)
    clamp = dolfinx.fem.dirichletbc(np.float64(1.0), clamped_dofs, V)
    return 6.0 * u * v * ufl.dx, u.dx(0) * v.dx(0) * ufl.dx, [clamp]


def of(bar: tuple[object, object, list[object]], **changed: object) -> df.Operators:
    mass, stiffness, base = bar
    settings = {"base": base, "gap": df.Gap([[0.875], [1.0]], (-2.0,), [0.1, 0.2]), "probes": TIP}
    made = df.Operators.from_forms(mass, stiffness, (0.5, 0.25), **(settings | changed))
    assert isinstance(made, df.Operators)
    return made


def along(o: df.Operators) -> np.ndarray:
    """Return the free dofs from the clamp to the tip."""
    chain = [int(np.flatnonzero(o.base.stiffness)[0])]
    while len(chain) < o.n_dofs:
        near = set(o.stiffness[chain[-1]].indices) - set(chain)
        chain.append(int(near.pop()))
    return np.array(chain)


def test_matrices_base_and_gaps_are_those_by_hand(bar: tuple[object, object, list[object]]) -> None:
    o = of(bar)
    x = along(o)
    h = 1.0 / N
    K = (np.diag([2.0] * 3 + [1.0]) - np.eye(N, k=1) - np.eye(N, k=-1)) / h
    M = (np.diag([4.0] * 3 + [2.0]) + np.eye(N, k=1) + np.eye(N, k=-1)) * h
    np.testing.assert_allclose(o.stiffness.toarray()[np.ix_(x, x)], K, atol=1e-12)
    np.testing.assert_allclose(o.mass.toarray()[np.ix_(x, x)], M, atol=1e-12)
    np.testing.assert_allclose(o.damping.toarray()[np.ix_(x, x)], 0.5 * M + 0.25 * K, atol=1e-12)
    np.testing.assert_allclose(o.base.mass[x], [h, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(o.base.stiffness[x], [-1.0 / h, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(o.base.corner, (2 * h, h + 0.25 / h, 1 / h))
    np.testing.assert_allclose(
        o.gap_matrix.toarray()[:, x], [[0, 0, -1.0, -1.0], [0, 0, 0, -2.0]], atol=1e-12
    )
    assert o.gap0.tolist() == [0.1, 0.2] and o.names == ("tip",)
    np.testing.assert_allclose(o.probes.toarray()[:, x], [[0, 0, 0, 1.0]], atol=1e-12)


def test_points_opposite_move_the_other_way(bar: tuple[object, object, list[object]]) -> None:
    o = of(bar, gap=df.Gap([[1.0]], (1.0,), 0.3, opposite=[[0.5]]))
    np.testing.assert_allclose(o.gap_matrix.toarray()[:, along(o)], [[0, -1, 0, 1]], atol=1e-12)


@pytest.mark.parametrize(
    ("point", "text"),
    [([1.001], r"a point of .*|point: expected one in the mesh, given \[1.001"), ([0.1], "carry")],
)
def test_points_that_cannot_touch_are_refused(
    point: list[float], text: str, bar: tuple[object, object, list[object]]
) -> None:
    with pytest.raises(df.CaseError, match=text):
        of(bar, gap=df.Gap([point], (1.0,), 0.1))


def test_damping_may_be_a_form_and_rows_be_given(bar: tuple[object, object, list[object]]) -> None:
    mass, stiffness, base = bar
    rows = np.zeros((1, N + 1))
    rows[0, np.argmax(_dolfinx.rows_at(
        mass.arguments()[0].ufl_function_space(), np.array([[1.0]]), (1.0,)  # type: ignore[attr-defined]
    ).toarray())] = 1.0  # fmt: skip
    o = df.Operators.from_forms(mass, stiffness, stiffness, base=base, gap=(rows, [0.1]))
    assert isinstance(o, df.Operators) and o.rayleigh is None
    assert abs(o.damping - o.stiffness).max() < 1e-12
    assert o.gap_matrix.toarray()[0, along(o)].tolist() == [0, 0, 0, 1]


def test_matrices_of_petsc_keep_what_is_known_of_them(
    bar: tuple[object, object, list[object]],
) -> None:
    o = of(bar)
    shapes = np.column_stack([np.ones(N), np.arange(N)])
    distributed = spread(o.__class__(o.mass, o.damping, o.stiffness, o.base, o.gap_matrix, o.gap0,
                               near_null=shapes), MPI.COMM_SELF)  # fmt: skip
    again = df.Operators.from_petsc(
        distributed.mass, distributed.damping, distributed.stiffness, gap=(o.gap_matrix, o.gap0)
    )
    assert isinstance(again, df.Operators)
    assert abs(again.mass - o.mass).max() == 0.0 and abs(again.damping - o.damping).max() == 0.0
    assert again.near_null is not None
    assert np.linalg.matrix_rank(np.column_stack([again.near_null, shapes])) == 2
    with pytest.raises(df.CaseError, match="base: "):
        df.Operators.from_petsc(
            distributed.mass,
            distributed.damping,
            distributed.stiffness,
            gap=(o.gap_matrix, o.gap0),
            base=np.zeros(1),
        )


def test_the_result_has_names_units_and_a_page(
    bar: tuple[object, object, list[object]], tmp_path: object
) -> None:
    drive = df.HarmonicMotion(0.5, 0.2)
    how = {"law": "newton", "scheme": "moreau-jean", "steps_per_period": 200, "periods": 3}
    run = df.run(of(bar), drive=drive, name="A bar", **how)
    tip = run.history["probe_displacement"].sel(probe="tip")
    assert tip.attrs["units"] == "m" and float(tip.max()) < 0.11 and run.history.sizes["event"]
    assert run.summary["energy_residual"] < 1e-9
    written = {path.name for path in run.save(f"{tmp_path}/run")}
    assert {"result.nc", "summary.json", "probe_histories.png", "report.html"} <= written


def test_shared_operators_are_solved_by_the_engine_that_shares(
    bar: tuple[object, object, list[object]],
) -> None:
    shared = spread(of(bar), MPI.COMM_SELF)
    options = {"time_step": 0.01, "steps_per_period": 10, "periods": 1}
    assert solve(shared, "newton", "moreau-jean", **options).outcome == "completed"
    with pytest.raises(df.CaseError, match="given DistributedOperators"):
        solve(shared, "newton", "moreau-jean", engine="compiled", **options)

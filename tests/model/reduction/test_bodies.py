"""The bodies of a structure: found, factorised, with modes and static shapes; floating ones too."""

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

from delam_fem.api import BaseCoupling, Operators, assemble, preset
from delam_fem.model import factors
from delam_fem.model.component_modes import bodies


def chain(n: int, *, is_held: bool) -> Operators:
    """Return n equal masses 2 kg, joined by springs 5 N/m, the first one held by another."""
    K = 5.0 * (sp.diags([2.0, -1.0, -1.0], [0, 1, -1], (n, n))).tolil()
    K[n - 1, n - 1] = 5.0
    K[0, 0] = 10.0 if is_held else 5.0
    M, K = 2.0 * sp.identity(n, format="csr"), sp.csr_matrix(K)
    H = sp.csr_matrix(np.eye(n)[[n - 1]])
    return Operators(M, 0.1 * M, K, BaseCoupling.none(n), H, np.zeros(1))


@pytest.mark.parametrize("n", [40, 500])  # dense, and by ARPACK
def test_modes_are_those_of_a_chain(n: int) -> None:
    (body,) = bodies(chain(n, is_held=True))
    squares, modes = body.modes(5)
    angles = (2.0 * np.arange(1, 6) - 1.0) * np.pi / (2.0 * (2 * n + 1))
    np.testing.assert_allclose(squares, 4.0 * 2.5 * np.sin(angles) ** 2, rtol=1e-8)
    np.testing.assert_allclose(modes.T @ body.mass @ modes, np.eye(5), atol=1e-9)


def test_static_shapes_are_the_rest_of_the_flexibility() -> None:
    o = chain(12, is_held=True)
    (body,) = bodies(o)
    squares, modes = body.modes(3)
    load = sp.csc_matrix(np.eye(12)[:, [7]])
    total, residual = body.static(load, modes)
    flexibility = np.linalg.inv(o.stiffness.toarray())
    np.testing.assert_allclose(total, [flexibility[7, 7]], rtol=1e-10)
    of_modes = (modes / squares) @ modes.T
    np.testing.assert_allclose(residual, ((flexibility - of_modes) @ load.toarray()), atol=1e-12)


@pytest.mark.parametrize("n", [12, 500])
def test_a_floating_body_moves_as_a_whole_and_gives_way_elastically(n: int) -> None:
    o = chain(n, is_held=False)
    with pytest.raises(ValueError, match="a body is not held"):
        bodies(o)
    omega = 2.0 * np.sqrt(2.5) * np.sin(np.pi / (2 * n))
    (body,) = bodies(o, 0.5 * omega**2)
    squares, modes = body.modes(4)
    assert squares[0] < 1e-9 * squares[1]
    assert np.sqrt(squares[1]) == pytest.approx(omega, rel=1e-6)
    load = sp.csc_matrix(np.eye(n)[:, [0]])
    _, residual = body.static(load, modes)
    exact, vectors = eigh(o.stiffness.toarray(), o.mass.toarray())
    expected = (vectors[:, 4:] / exact[4:]) @ (vectors[:, 4:].T @ load.toarray())
    np.testing.assert_allclose(residual, expected, atol=2e-5 * np.abs(expected).max())


def test_laminae_that_are_apart_are_bodies_of_their_own() -> None:
    apart = bodies(assemble(preset("default", {"mesh.elements": 5}), needs_dolfinx=False).operators)
    assert [body.dofs.size for body in apart] == [10, 10]
    assert (
        len(
            bodies(
                assemble(preset("embedded", {"mesh.elements": 20}), needs_dolfinx=False).operators
            )
        )
        == 1
    )


def test_petsc_solves_as_superlu_does(monkeypatch: pytest.MonkeyPatch) -> None:
    o = chain(30, is_held=True)
    loads = np.random.default_rng(1).normal(size=(30, 3))
    expected = bodies(o)[0].solve(loads)
    monkeypatch.setattr(factors, "LARGE", 1)
    np.testing.assert_allclose(bodies(o)[0].solve(loads), expected, rtol=1e-11)

"""The reduced structure: readings, damping and probes are those of the full one."""

import numpy as np
import pytest

from delam_fem.api import assemble, preset
from delam_fem.model import layout
from delam_fem.model.component_modes import basis_of, projected


@pytest.mark.parametrize("name", ["default", "embedded"])
def test_the_points_of_the_parts_read_what_they_read_before(name: str) -> None:
    full = assemble(preset(name, {"mesh.elements": 20}), needs_dolfinx=False)
    basis = basis_of(full.operators, 5)
    reduced = projected(full, basis)
    rng = np.random.default_rng(2)
    q, base = rng.normal(size=(3, basis.squares.size)), rng.normal(size=3)
    u = q @ basis.vectors.T
    np.testing.assert_allclose(
        layout.nodal(reduced.layout, q, base), layout.nodal(full.layout, u, base), atol=1e-10
    )
    np.testing.assert_allclose(reduced.operators.probes @ q.T, full.operators.probes @ u.T)
    np.testing.assert_allclose(reduced.operators.gap_matrix @ q.T, full.operators.gap_matrix @ u.T)
    owners = {"default": {0, 1}, "embedded": {-1}}[name]
    assert set(reduced.layout.reading.part.tolist()) == owners


def test_damping_is_diagonal_where_it_is_rayleigh_s_in_each_body() -> None:
    case = preset("default", {"mesh.elements": 10, "lamina.thin.damping_ratio": 0.03})
    full = assemble(case, needs_dolfinx=False)
    reduced = projected(full, basis_of(full.operators, 4))
    C, squares = reduced.operators.damping.toarray(), reduced.operators.stiffness.diagonal()
    part = reduced.layout.reading.part
    for i in range(2):
        alpha, beta = case.rayleigh(i)
        of_part = part == i
        np.testing.assert_allclose(
            C.diagonal()[of_part], alpha + beta * squares[of_part], rtol=1e-6
        )
    assert not (C - np.diag(C.diagonal())).any()


def test_other_damping_stays_full() -> None:
    from dataclasses import replace

    import scipy.sparse as sp

    full = assemble(preset("default", {"mesh.elements": 5}), needs_dolfinx=False)
    n = full.operators.n_dofs
    dashpot = sp.csr_matrix(([1.0], ([4], [4])), shape=(n, n))
    o = replace(full.operators, damping=sp.csr_matrix(full.operators.damping + dashpot))
    basis = basis_of(o, 3)
    C = projected(replace(full, operators=o), basis).operators.damping.toarray()
    v = np.random.default_rng(1).normal(size=basis.squares.size)
    u = basis.vectors @ v
    assert v @ C @ v == pytest.approx(u @ o.damping @ u, rel=1e-9)
    assert (C - np.diag(C.diagonal())).any()

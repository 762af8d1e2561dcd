"""Factors and lowest eigenpairs, against the exact frequencies of chains; on ranks, too."""

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from mpi_pool import Crew

from delam_fem.api import lowest
from delam_fem.model.factors import LARGE

FREE = 5.0, 2.0
"""Stiffness of the springs of a chain [N/m], and its masses [kg]."""


def test_a_large_floating_chain_has_its_frequencies() -> None:
    n = LARGE + 1000  # a dense matrix would have 3.5 GB
    K = sp.diags([2.0, -1.0, -1.0], [0, 1, -1], (n, n), format="lil")
    K[0, 0] = K[n - 1, n - 1] = 1.0
    k, m = FREE
    frequencies, shapes = lowest(sp.csr_matrix(k * K), m * sp.identity(n, format="csr"), 4,
                                 is_floating=True)  # fmt: skip
    exact = 2.0 * np.sqrt(k / m) * np.sin(np.arange(4) * np.pi / (2 * n)) / (2.0 * np.pi)
    assert np.abs(frequencies[0]) < 1e-3 * exact[1]
    np.testing.assert_allclose(frequencies[1:], exact[1:], rtol=1e-5)
    bent = np.cos(np.pi * (np.arange(n) + 0.5) / n)  # the first elastic mode
    likeness = abs(bent @ shapes[:, 1]) / np.linalg.norm(bent) / np.linalg.norm(shapes[:, 1])
    assert likeness == pytest.approx(1.0, abs=1e-6)


CHAIN = """
import numpy as np
import pytest
import scipy.sparse as sp
from delam_fem.model import factors
from delam_fem.model.operators import matrix

slepc = factors.sharing.slepc
n, k, m = 300, 5.0, 2.0
K = k * sp.diags([2.0, -1.0, -1.0], [0, 1, -1], (n, n), format="csr")  # both ends are held
M = m * sp.identity(n, format="csr")
angles = np.arange(1, 8) * np.pi / (2 * (n + 1))
exact = 4.0 * k / m * np.sin(angles) ** 2
own = slice(n * comm.rank // comm.size, n * (comm.rank + 1) // comm.size)


def spread(whole):
    return matrix(whole[own], comm)


def gathered(share):
    return np.concatenate(comm.allgather(share))


for shift in (0.0, 0.01):
    factor = factors.factored(spread(K), spread(M), shift)
    loads = np.random.default_rng(3).normal(size=(n, 2))
    for b in (loads, loads[:, 0], loads[:, :0]):
        assert np.allclose((K + shift * M) @ gathered(factor.solve(b[own])), b, atol=1e-9)
    for count in (3, 7):  # more from the same factors
        squares, shapes = factor.lowest(count)
        shapes = gathered(shapes)
        assert np.allclose(squares, exact[:count], rtol=1e-9)
        assert np.allclose(K @ shapes, (M @ shapes) * squares, atol=1e-9)
factors.sharing.slepc = lambda: None  # where it is not installed
try:
    factor = factors.factored(spread(K), spread(M), 0.01)
finally:
    factors.sharing.slepc = slepc
assert np.allclose((K + 0.01 * M) @ gathered(factor.solve(loads[own])), loads, atol=1e-9)
with pytest.raises(ValueError, match="not held"):
    factors.factored(spread(sp.csr_matrix(sp.diags([1.0] * (n - 1) + [0.0]))))
"""


@pytest.mark.mpi
def test_ranks_share_factors_and_eigenpairs(crew: Crew) -> None:
    crew.run(2, CHAIN)


MATRICES = """
import numpy as np
import scipy.sparse as sp
from delam_fem.model import operators as spread
from delam_fem.model.linear import closed_by, n_rigid, normalised, tied

rng = np.random.default_rng(5)
n, k = 31, 7
A = sp.random(n, n, 0.3, random_state=1, format="csr") + 10.0 * sp.identity(n, format="csr")
A = sp.csr_matrix(A + A.T)
S = tied(sp.random(4, n, 0.3, random_state=2, format="csr"), A)
X = rng.normal(size=(n, k))
ends = [0, 9, 9, n] if comm.size == 3 else [0, 12, n]  # a rank may have no dofs
own = slice(ends[comm.rank], ends[comm.rank + 1])
columns = [0, 4, 20, S.shape[1]] if comm.size == 3 else [0, 20, S.shape[1]]
n_columns = columns[comm.rank + 1] - columns[comm.rank]
M = spread.matrix(A[own], comm)
basis = spread.matrix(S[own], comm, n_columns)


def gathered(share):
    return np.concatenate(comm.allgather(share))


assert np.allclose(gathered(spread.times(M, X[own])), A @ X)
assert np.allclose(gathered(spread.times(M, X[own, 0])), A @ X[:, 0])
assert np.allclose(spread.summed(M, X[own].T @ X[own]), X.T @ X)
assert np.allclose(gathered(spread.diagonal(M)), A.diagonal())
assert abs(sp.vstack(comm.allgather(spread.own_rows(M))) - A).max() < 1e-12
W = rng.normal(size=(S.shape[1], 2))
local = slice(columns[comm.rank], columns[comm.rank + 1])
assert np.allclose(gathered(spread.times(basis, W[local])), S @ W)
closed = sp.vstack(comm.allgather(spread.own_rows(closed_by(basis, M))))
assert np.allclose(closed.toarray(), (S.T @ A @ S).toarray())
chosen = np.arange(own.start, own.stop)[::3]
every = gathered(chosen)
some = sp.vstack(comm.allgather(spread.own_rows(spread.restricted(M, chosen - own.start))))
assert np.allclose(some.toarray(), A[every][:, every].toarray())
shapes = gathered(normalised(X[own], M))
assert np.allclose(np.einsum("ij,ij->j", shapes, A @ shapes), 1.0)
assert (shapes[np.abs(shapes).argmax(axis=0), np.arange(k)] > 0.0).all()
for ends_held in (0, 1):
    K = sp.diags([2.0, -1.0, -1.0], [0, 1, -1], (n, n), format="lil")
    if not ends_held:
        K[0, 0] = K[n - 1, n - 1] = 1.0
    assert n_rigid(spread.matrix(sp.csr_matrix(K)[own], comm)) == 1 - ends_held
"""


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_matrices_on_ranks_are_those_of_one(ranks: int, crew: Crew) -> None:
    crew.run(ranks, MATRICES)


WORK = """
def failing(where, comm):
    if comm.rank in where:
        raise ValueError(f"rank {comm.rank}")
    return comm.rank + comm.size
"""
ORDERS = """
import sys
sys.path.insert(0, arguments[0])
import pytest
from work_of_ranks import failing
from delam_fem.model.sharing import shared, together


def orders():
    assert together(failing, []) == comm.size  # what the first rank gets
    for where in ([0], [1], [0, 1]):  # an error of any rank is told once, and the others go on
        with pytest.raises(ValueError, match=f"rank {where[0]}"):
            together(failing, where)
    return together(failing, [])


assert shared(comm, orders) == (comm.size if comm.rank == 0 else None)
"""


@pytest.mark.mpi
def test_the_first_rank_orders_and_tells_errors(crew: Crew, tmp_path: Path) -> None:
    (tmp_path / "work_of_ranks.py").write_text(WORK)
    crew.run(2, ORDERS, tmp_path)

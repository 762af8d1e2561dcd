"""Factors and lowest eigenpairs, against the exact frequencies of chains; on ranks, too."""

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
import scipy.sparse as sp
from delam_fem.model import factors
from delam_fem.model.sharing import shared

factors.LARGE = 1
n, k, m = 300, 5.0, 2.0
K = k * sp.diags([2.0, -1.0, -1.0], [0, 1, -1], (n, n), format="csr")  # both ends are held
M = m * sp.identity(n, format="csr")
angles = np.arange(1, 8) * np.pi / (2 * (n + 1))
exact = 4.0 * k / m * np.sin(angles) ** 2


def work():
    for shift in (0.0, 0.01):
        factor = factors.factored(K, M, shift)
        loads = np.random.default_rng(3).normal(size=(n, 2))
        for b in (loads, loads[:, 0]):
            assert np.allclose((K + shift * M) @ factor.solve(b), b, atol=1e-9)
        for count in (3, 7):  # more from the same factors
            squares, shapes = factor.lowest(count)
            assert np.allclose(squares, exact[:count], rtol=1e-9)
            assert np.allclose(K @ shapes, (M @ shapes) * squares, atol=1e-9)
    try:
        factors.factored(sp.csr_matrix(sp.diags([1.0] * (n - 1) + [0.0])))
    except ValueError:
        return "done"


assert shared(comm, work) == ("done" if comm.rank == 0 else None)
"""


@pytest.mark.mpi
@pytest.mark.parametrize("has_slepc", [True, False])
def test_ranks_share_factors_and_eigenpairs(has_slepc: bool, crew: Crew) -> None:
    without = "import delam_fem.model.sharing as s\ns.slepc = lambda: None\n"
    crew.run(2, CHAIN if has_slepc else without + CHAIN)

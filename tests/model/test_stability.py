"""The stability limit of the central difference scheme."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

from delam_fem.api import BaseCoupling, CaseError, Operators, largest_stable_time_step
from delam_fem.model.linear import require_stable


def chain(n: int = 4) -> Operators:
    """Return n masses of 2 kg on springs of 50 N/m between two walls; the last may touch one."""
    K = 50.0 * sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(n, n), format="csr")
    return Operators(
        mass=2.0 * sp.identity(n, format="csr"),
        damping=sp.csr_matrix((n, n)),
        stiffness=K,
        base=BaseCoupling.none(n),
        gap_matrix=sp.csr_matrix(([-1.0], ([0], [n - 1])), shape=(1, n)),
        gap0=np.ones(1),
    )


def test_limit_of_a_chain_is_exact() -> None:
    """ω_k = 2 sqrt(k/m) sin(k π / 2 (n + 1)), and the limit is 2/ω_n."""
    highest = 2.0 * np.sqrt(50.0 / 2.0) * np.sin(4.0 * np.pi / 10.0)
    assert largest_stable_time_step(chain()) == pytest.approx(2.0 / highest, rel=1e-12)


def test_a_closed_spring_shortens_the_limit() -> None:
    K = chain().stiffness.toarray()
    K[-1, -1] += 300.0
    highest = np.sqrt(np.linalg.eigvalsh(K / 2.0).max())
    assert largest_stable_time_step(chain(), 300.0) == pytest.approx(2.0 / highest, rel=1e-12)


def test_the_weight_of_a_pair_multiplies_its_spring() -> None:
    weighted = dataclasses.replace(chain(), pair_weights=np.array([3.0]))
    assert largest_stable_time_step(weighted, 100.0) == largest_stable_time_step(chain(), 300.0)


@pytest.mark.parametrize(("factor", "times"), [(1.001, 2), (2.5, 3)])
def test_too_long_a_step_is_refused_with_what_helps(factor: float, times: int) -> None:
    limit = largest_stable_time_step(chain(), 300.0)
    require_stable(chain(), 0.999 * limit, 300.0)
    with pytest.raises(CaseError, match=f"at most {limit:.4g} s, .* at least {times} times"):
        require_stable(chain(), factor * limit, 300.0)
    require_stable(chain(), 1.001 * limit)  # without the spring a longer step is stable

"""The stability limit of the central difference scheme, checked before a run."""

from __future__ import annotations

import math

import scipy.linalg
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from delam_fem.case.toml import CaseError
from delam_fem.model.operators import Operators

DENSE = 20
"""Largest number of dofs for dense eigenvalues, which also serve a single mass."""


def largest_stable_time_step(operators: Operators, spring_stiffness: float = 0.0) -> float:
    """Return Δt = 2/ω_max of M and K, with every contact spring closed in K [s].

    It is infinite for masses without any stiffness.
    """
    o = operators
    H = o.gap_matrix
    K, M = sp.csc_matrix(o.stiffness + spring_stiffness * (H.T @ H)), sp.csc_matrix(o.mass)
    if not K.count_nonzero():
        return math.inf
    if o.n_dofs <= DENSE:
        square = scipy.linalg.eigh(K.toarray(), M.toarray(), eigvals_only=True)[-1]
    else:
        square = eigsh(K, k=1, M=M, which="LM", return_eigenvectors=False)[0]
    return 2.0 / math.sqrt(float(square))


def require_stable(operators: Operators, time_step: float, spring_stiffness: float = 0.0) -> None:
    """Raise a CaseError if the central difference would be unstable.

    Raises:
        CaseError: the time step exceeds the largest stable one; the message names both.
    """
    limit = largest_stable_time_step(operators, spring_stiffness)
    if time_step > limit:
        factor = math.ceil(time_step / limit)
        raise CaseError(
            f"time.steps_per_period: central difference needs a time step of at most {limit:.4g} "
            f"s, given {time_step:.4g} s: use at least {factor} times as many steps per period, "
            'or time.scheme = "newmark"'
        )

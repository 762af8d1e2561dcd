"""The stability limit of the central difference scheme, checked before a run."""

from __future__ import annotations

import math

import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from delam_fem.case.toml import CaseError
from delam_fem.model.operators import Operators


def largest_stable_time_step(operators: Operators, spring_stiffness: float = 0.0) -> float:
    """Return Δt = 2/ω_max of M and K, with every contact spring closed in K [s]."""
    o = operators
    H = o.gap_matrix
    K = sp.csc_matrix(o.stiffness + spring_stiffness * (H.T @ H))
    square = eigsh(K, k=1, M=sp.csc_matrix(o.mass), which="LM", return_eigenvectors=False)[0]
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

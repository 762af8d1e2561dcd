"""Run the trial methods for contact of docs/evidence/convergence.md, each by its name."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from trials import schemes as ts, steps

from delam_fem.api import (
    BaseCoupling,
    Case,
    FloatArray,
    Operators,
    Session,
    motion_of,
    scheme_of,
    session,
    span_of,
)

RESTITUTION = 0.1
"""Coefficient of restitution."""
PERIOD_OF_SPRING = 20
"""Steps per vibration of a pair on a spring whose stiffness is scaled with the time step."""
FIRST_STEPS = 1000
"""Steps per period at which a threshold γ scaled with Δt equals that of the case."""

Runner: TypeAlias = Callable[[Case, Operators], FloatArray]
"""Function of a case and its operators that returns the extremes of both tips in each period [m].

The extremes have the shape (n_periods, 2, 2).
"""


LIMIT = "newton@moreau-jean"
"""Method whose run with very small steps stands for the rigid limit."""


def by_engine(method: str, theta: float, case: Case, operators: Operators) -> FloatArray:
    """Run a method of the package (LAW@SCHEME); only Moreau–Jean reads θ."""
    with _session(case, operators, method, theta) as opened:
        opened.run()
        return np.asarray(opened.recorder.envelope)


def _session(
    case: Case, operators: Operators, method: str, theta: float = 0.5
) -> AbstractContextManager[Session]:
    """Open a session of a case with another method."""
    other = case.with_overrides({"contact.law": method})
    scheme = replace(scheme_of(other), theta=theta)
    return session(operators, other.contact_law, scheme, motion_of(case), span_of(case))


def by_modes(method: str, modes: int, case: Case, operators: Operators) -> FloatArray:
    """Run a method in the lowest modes of each lamina instead of the nodal dofs."""
    return by_engine(method, 0.5, case, modal(operators, modes))


def by_scaled_springs(case: Case, operators: Operators) -> FloatArray:
    """Run newton-penalty with k scaled by the mass of a pair over Δt², and γ scaled by Δt."""
    h = case.lamina[0].length / operators.n_pairs
    reduced = 1.0 / sum(1.0 / (h * lamina.mass_per_length) for lamina in case.lamina)
    stiffness = reduced * (2 * np.pi / (PERIOD_OF_SPRING * case.time_step)) ** 2
    gamma = case.contact.threshold_velocity * FIRST_STEPS / case.time.steps_per_period
    keys = {"contact.penalty_stiffness": stiffness, "contact.threshold_velocity": gamma}
    return by_engine("newton-penalty@newmark", 0.5, case.with_overrides(keys), operators)


def modal(o: Operators, modes: int) -> Operators:
    """Return the operators in the lowest modes of each lamina."""
    n = o.n_dofs // 2
    parts = []
    for lamina in (slice(0, n), slice(n, 2 * n)):
        K, M = (A.toarray()[lamina, lamina] for A in (o.stiffness, o.mass))
        parts.append(scipy.linalg.eigh(K, M)[1][:, :modes])
    Phi = scipy.linalg.block_diag(*parts)
    M, C, K = (sp.csr_matrix(Phi.T @ (A @ Phi)) for A in (o.mass, o.damping, o.stiffness))
    b = o.base
    base = BaseCoupling(Phi.T @ b.mass, Phi.T @ b.damping, Phi.T @ b.stiffness, b.corner)
    H = sp.csr_matrix(o.gap_matrix @ Phi)
    return Operators(M, C, K, base, H, o.gap0, probes=sp.csr_matrix(o.probes @ Phi))


def densely(
    step: object,
    make: Callable[..., ts.Matrices],
    arguments: tuple[object, ...],
    case: Case,
    operators: Operators,
) -> FloatArray:
    """Run a scheme of `schemes.py` on dense matrices."""
    matrices = make(ts.Problem.of(operators), case.time_step, *arguments)
    bases = motion_of(case)(0).copy()
    extremes = steps.envelopes(step, matrices, bases, case.n_periods, operators.probes.indices)
    return np.asarray(extremes)


def runners() -> dict[str, Runner]:
    """Return all trial methods by name; the first two are methods of the package."""
    result: dict[str, Runner] = {
        name: partial(by_engine, name, 0.5) for name in (LIMIT, "newton@newmark")
    }
    for theta in (0.52, 0.6, 1.0):
        result[f"{LIMIT}, θ = {theta:g}"] = partial(by_engine, LIMIT, theta)
    result["newton-penalty@newmark, k by m/Δt², γ by Δt"] = by_scaled_springs
    for n in (5, 10):
        result[f"{LIMIT}, {n} modes of each lamina"] = partial(by_modes, LIMIT, n)
    result["exact linear motion, impulses at the end"] = partial(
        densely, steps.exact_step, ts.exact_matrices, (RESTITUTION, False)
    )
    result["exact linear motion, impulses spread over the step"] = partial(
        densely, steps.exact_step, ts.exact_matrices, (RESTITUTION, True)
    )
    for radius in (0.9, 0.5):
        result[f"non-smooth generalised-α, ρ∞ = {radius:g}"] = partial(
            densely, steps.alpha_step, ts.alpha_matrices, (RESTITUTION, radius)
        )
    for is_stabilised, name in ((False, "implicit"), (True, "implicit and stabilised")):
        result[f"Newmark, contact forces {name}"] = partial(
            densely, steps.implicit_step, ts.implicit_matrices, (is_stabilised,)
        )
    for constraint, name in (
        (ts.CLOSED, f"{LIMIT}, contact at U <= 0"),
        (ts.END, "gaps closed by the end of the step (Stewart, Trinkle), e = 0"),
        (ts.BOUNDED, "penetration recovered without work"),
        (ts.RECOVERY, "penetration recovered at once"),
    ):
        result[name] = partial(
            densely, steps.theta_step, ts.theta_matrices, (constraint, RESTITUTION)
        )
    return result

"""Run the ways to step through contact that docs/convergence.md compares, each by its name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.engines.compiled.engine import Compiled, law_of
from delam_fem.engines.compiled.system import Scheme
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.loop import set_initial, simulate
from delam_fem.simulation.recorder import N_BASE
from delam_fem.simulation.setup import motion_of, recorder_of
from delam_fem.studies.convergence import trial_schemes as ts
from delam_fem.studies.convergence import trial_steps as steps

RESTITUTION = 0.1
"""Coefficient of restitution."""
PERIOD_OF_SPRING = 20
"""Steps in which a pair on a spring, scaled with the step, vibrates once."""
FIRST_STEPS = 1000
"""Steps per period at which the threshold γ that is scaled with Δt is that of the case."""

Runner: TypeAlias = Callable[[Case, Operators], FloatArray]
"""From a case and its operators to the extremes of each period, shape (n_periods, 2, 2)."""


def by_engine(law: str, theta: float | None, case: Case, operators: Operators) -> FloatArray:
    """Run a law of the package in compiled code: Moreau–Jean with θ, or Newmark if θ is None."""
    dt = case.time_step
    scheme = Scheme.newmark(dt) if theta is None else Scheme.moreau_jean(dt, theta)
    engine = Compiled(operators, scheme, law_of(case.with_overrides({"contact.law": law})))
    recorder, motion = recorder_of(case, operators), motion_of(case)
    set_initial(engine, None, motion(0)[0])
    simulate(engine, recorder, motion)
    return recorder.envelope


def by_modes(law: str, modes: int, case: Case, operators: Operators) -> FloatArray:
    """Run in the lowest modes of each lamina instead of the displacements of the nodes."""
    reduced, observed = modal(operators, modes)
    found = np.full((case.n_periods, 2, 2), np.nan)
    engine = Compiled(
        reduced,
        Scheme.moreau_jean(case.time_step),
        law_of(case.with_overrides({"contact.law": law})),
    )
    recorder, motion = recorder_of(case, reduced), motion_of(case)

    def collect(done: int) -> bool:  # the tips are sums of modes, which no recorder observes
        tips = recorder.window[-1].u[:, N_BASE:] @ observed.T
        found[done - 1] = tips.min(axis=0), tips.max(axis=0)
        return False

    set_initial(engine, None, motion(0)[0])
    simulate(engine, recorder, motion, stop=collect)
    return found


def by_scaled_springs(case: Case, operators: Operators) -> FloatArray:
    """Run newton-penalty with a spring scaled by the mass of a pair and Δt, and γ by Δt."""
    h = case.lamina[0].length / operators.n_pairs
    reduced = 1.0 / sum(1.0 / (h * lamina.mass_per_length) for lamina in case.lamina)
    stiffness = reduced * (2 * np.pi / (PERIOD_OF_SPRING * case.time_step)) ** 2
    gamma = case.contact.threshold_velocity * FIRST_STEPS / case.time.steps_per_period
    keys = {"contact.penalty_stiffness": stiffness, "contact.threshold_velocity": gamma}
    return by_engine("newton-penalty", None, case.with_overrides(keys), operators)


def modal(o: Operators, modes: int) -> tuple[Operators, FloatArray]:
    """Return a problem in its lowest modes, and the tips as sums of modes, shape (2, 2 modes)."""
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
    every = np.arange(2 * modes)
    return Operators(M, C, K, M.diagonal(), base, H, o.gap0, every), Phi[o.observed]


def densely(
    step: object,
    make: Callable[..., ts.Matrices],
    arguments: tuple[object, ...],
    case: Case,
    operators: Operators,
) -> FloatArray:
    """Run a scheme of `trial_schemes.py` on dense matrices."""
    matrices = make(ts.Problem.of(operators), case.time_step, *arguments)
    bases = motion_of(case)(0).copy()
    found = steps.envelopes(step, matrices, bases, case.n_periods, operators.observed)
    return np.asarray(found)


def runners() -> dict[str, Runner]:
    """Return all ways to step through contact by name; the first two are the package's."""
    found: dict[str, Runner] = {
        "moreau-recovery": partial(by_engine, "moreau-recovery", 0.5),
        "moreau": partial(by_engine, "moreau", 0.5),
        "newton": partial(by_engine, "newton", None),
    }
    for theta in (0.52, 0.6, 1.0):
        found[f"moreau, θ = {theta:g}"] = partial(by_engine, "moreau", theta)
    found["newton-penalty, k by m/Δt², γ by Δt"] = by_scaled_springs
    for n in (5, 10):
        for law in ("moreau", "moreau-recovery"):
            found[f"{law}, {n} modes of each lamina"] = partial(by_modes, law, n)
    found["exact linear motion, impulses at the end"] = partial(
        densely, steps.exact_step, ts.exact_matrices, (RESTITUTION, False)
    )
    found["exact linear motion, impulses spread over the step"] = partial(
        densely, steps.exact_step, ts.exact_matrices, (RESTITUTION, True)
    )
    for radius in (0.9, 0.5):
        found[f"non-smooth generalised-α, ρ∞ = {radius:g}"] = partial(
            densely, steps.alpha_step, ts.alpha_matrices, (RESTITUTION, radius)
        )
    for is_stabilised, name in ((False, "implicit"), (True, "implicit and stabilised")):
        found[f"Newmark, contact forces {name}"] = partial(
            densely, steps.implicit_step, ts.implicit_matrices, (is_stabilised,)
        )
    for constraint, name in (
        (ts.CLOSED, "moreau, contact at U <= 0"),
        (ts.END, "gaps closed by the end of the step (Stewart, Trinkle), e = 0"),
        (ts.RECOVERY, "recovery without the bound on work"),
    ):
        found[name] = partial(
            densely, steps.theta_step, ts.theta_matrices, (constraint, RESTITUTION)
        )
    return found

"""From a case to the engine that computes it: which stepper and supervisor, with what numbers."""

from __future__ import annotations

from mpi4py import MPI
from petsc4py import PETSc

from delam_fem.case.definition import Case
from delam_fem.contact.decision import (
    Impacts,
    NoContact,
    PenaltySprings,
    Supervisor,
)
from delam_fem.contact.recovery import MoreauImpacts, MoreauRecovery
from delam_fem.engines.petsc.newmark import Newmark
from delam_fem.engines.petsc.theta import MoreauJean
from delam_fem.model import stability
from delam_fem.model.operators import Operators
from delam_fem.simulation.loop import StepByStep


def petsc_engine(case: Case, operators: Operators, comm: MPI.Intracomm) -> StepByStep:
    """Return the engine that takes each step in PETSc and then asks a supervisor.

    Args:
        case: law, scheme and their numbers.
        operators: the semi-discrete problem.
        comm: communicator that shares the work.

    Raises:
        CaseError: the time step is beyond the stability limit of the scheme.
    """
    if case.contact.law.startswith("moreau"):
        return _moreau(case, operators, PETSc.Comm(comm))
    stepper = _newmark(case, operators, PETSc.Comm(comm))
    return StepByStep(stepper, _supervisor(case, stepper))


def spring_of(case: Case) -> tuple[float, float]:
    """Return stiffness [N/m] and damping [N s/m] of the contact springs of a law, 0 without."""
    contact = case.contact
    return {
        "newton-penalty": (contact.penalty_stiffness, 0.0),
        "penalty": (contact.penalty_stiffness, contact.penalty_damping),
    }.get(contact.law, (0.0, 0.0))


def _newmark(case: Case, operators: Operators, comm: PETSc.Comm) -> Newmark:
    spring, beta = spring_of(case), 0.25
    if case.time.scheme == "central-difference":
        stability.require_stable(operators, case.time_step, spring[0])
        beta = 0.0
    return Newmark(
        operators,
        case.time_step,
        beta=beta,
        coupled_impulses=case.contact.impulse == "consistent",
        spring=spring,
        comm=comm,
    )


def _supervisor(case: Case, stepper: Newmark) -> Supervisor:
    contact, n = case.contact, stepper.operators.n_pairs
    if contact.law == "none":
        return NoContact(n)
    if contact.law == "penalty":
        return PenaltySprings(n)
    return Impacts(
        stepper.compliance,
        n_pairs=n,
        restitution=contact.restitution,
        coupled=contact.impulse == "consistent",
        threshold_velocity=contact.threshold_velocity if contact.law != "newton" else None,
    )


def _moreau(case: Case, operators: Operators, comm: PETSc.Comm) -> StepByStep:
    contact = case.contact
    n, e, resting = operators.n_pairs, contact.restitution, contact.threshold_velocity
    if contact.law == "moreau":
        stepper = MoreauJean(operators, case.time_step, comm=comm)
        law = MoreauImpacts(stepper.compliance, n_pairs=n, restitution=e, resting_velocity=resting)
        return StepByStep(stepper, law)
    stepper = MoreauJean(operators, case.time_step, anticipates=True, comm=comm)
    recovery = MoreauRecovery(
        stepper.compliance,
        n_pairs=n,
        restitution=e,
        time_step=case.time_step,
        resting_velocity=resting,
    )
    return StepByStep(stepper, recovery)

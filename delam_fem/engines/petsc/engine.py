"""The engine that computes each step in PETSc and then asks a contact law."""

from __future__ import annotations

from collections.abc import Sequence

from delam_fem.contact.decision import Setting
from delam_fem.contact.laws import ContactLaw
from delam_fem.engines.petsc.newmark import Newmark
from delam_fem.engines.petsc.theta import MoreauJean
from delam_fem.model.distributed import DistributedOperators
from delam_fem.model.operators import Operators
from delam_fem.mpi import MPI
from delam_fem.numerics.schemes import Scheme
from delam_fem.simulation.loop import StepByStep
from delam_fem.simulation.refined import RefinedSteps
from delam_fem.simulation.refinement import NOT_REFINED, Refinement


def petsc_engine(
    operators: Operators | DistributedOperators,
    law: ContactLaw,
    scheme: Scheme,
    time_step: float,
    refinement: Refinement = NOT_REFINED,
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> StepByStep:
    """Return the engine that computes single steps in PETSc.

    Args:
        operators: the semi-discrete problem; `Operators` are spread over the ranks.
        law: the contact law: one of the table, or a law of your own.
        scheme: the time integration.
        time_step: Δt [s].
        refinement: how steps near contact are divided.
        comm: communicator that shares the work of `Operators`; others have their own.

    Raises:
        ValueError: the law does not go with the scheme.
    """
    sizes = [time_step / n for n in refinement.divisions]
    stepper = _stepper(operators, law, scheme, sizes, comm)
    supervisor = law.supervisor(scheme, Setting(operators.n_pairs, stepper.compliance))
    if refinement.factor == 1:
        return StepByStep(stepper, supervisor)
    return RefinedSteps(stepper, supervisor, refinement, time_step)


def _stepper(
    operators: Operators | DistributedOperators,
    law: ContactLaw,
    scheme: Scheme,
    time_steps: Sequence[float],
    comm: MPI.Intracomm,
) -> Newmark | MoreauJean:
    """Return the stepper of a scheme, set up for a law."""
    if scheme.has_impulses_within:
        return MoreauJean(operators, *time_steps, theta=scheme.theta, comm=comm)
    return Newmark(
        operators,
        *time_steps,
        beta=scheme.beta,
        gamma=scheme.gamma,
        coupled_impulses=law.is_coupled,
        spring=law.spring,
        comm=comm,
    )

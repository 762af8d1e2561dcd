"""The engine that computes each step in PETSc and then asks a contact law."""

from __future__ import annotations

from petsc4py import PETSc

from delam_fem.contact.decision import Setting
from delam_fem.contact.laws import ContactLaw
from delam_fem.engines.petsc.newmark import Newmark
from delam_fem.engines.petsc.theta import MoreauJean
from delam_fem.model.operators import Operators
from delam_fem.mpi import MPI
from delam_fem.numerics.schemes import Scheme
from delam_fem.simulation.loop import StepByStep


def petsc_engine(
    operators: Operators,
    law: ContactLaw,
    scheme: Scheme,
    time_step: float,
    comm: MPI.Intracomm = MPI.COMM_SELF,
) -> StepByStep:
    """Return the engine that computes single steps in PETSc.

    Args:
        operators: the semi-discrete problem.
        law: the contact law: one of the table, or a law of your own.
        scheme: the time integration.
        time_step: Δt [s].
        comm: communicator that shares the work.

    Raises:
        ValueError: the law does not go with the scheme.
    """
    stepper = _stepper(operators, law, scheme, time_step, PETSc.Comm(comm))
    setting = Setting(operators.n_pairs, stepper.compliance, time_step)
    return StepByStep(stepper, law.supervisor(scheme, setting))


def _stepper(
    operators: Operators, law: ContactLaw, scheme: Scheme, time_step: float, comm: PETSc.Comm
) -> Newmark | MoreauJean:
    """Return the stepper of a scheme, set up for a law."""
    if scheme.has_impulses_within:
        return MoreauJean(
            operators,
            time_step,
            theta=scheme.theta,
            anticipates=law.anticipates,
            comm=comm,
        )
    return Newmark(
        operators,
        time_step,
        beta=scheme.beta,
        gamma=scheme.gamma,
        coupled_impulses=law.is_coupled,
        spring=law.spring,
        comm=comm,
    )

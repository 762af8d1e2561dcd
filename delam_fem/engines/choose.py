"""Choose the engine, the contact law and the scheme of a case by their names.

An engine is imported only when it is chosen, so that a worker that needs one engine starts fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, get_args

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.contact.laws import ContactLaw, Law, combination
from delam_fem.model.operators import Operators
from delam_fem.model.stability import require_stable
from delam_fem.numerics.schemes import SCHEMES, Scheme
from delam_fem.simulation.loop import Engine
from delam_fem.simulation.refinement import NOT_REFINED, Refinement

if TYPE_CHECKING:
    from delam_fem.mpi import MPI

EngineName = Literal["petsc", "compiled"]
ENGINES: tuple[EngineName, ...] = get_args(EngineName)


def engine_of(
    operators: Operators,
    law: ContactLaw,
    scheme: Scheme,
    time_step: float,
    *,
    refinement: Refinement = NOT_REFINED,
    name: EngineName = "compiled",
    comm: MPI.Intracomm | None = None,
) -> Engine:
    """Return the engine that computes the time steps of a problem.

    Args:
        operators: the semi-discrete problem.
        law: the contact law.
        scheme: the time integration.
        time_step: Δt [s].
        refinement: how steps near contact are divided; nothing is divided without contact.
        name: "petsc" computes single steps and accepts every law; "compiled" computes whole
            periods.
        comm: communicator that shares the work of "petsc"; None: this process alone.

    Raises:
        CaseError: there is no such engine, the law does not go with the scheme or the engine, or
            the time step exceeds the stability limit.
    """
    if name not in ENGINES:
        raise CaseError(f"engine: expected {' or '.join(map(repr, ENGINES))}, given {name!r}")
    if law.name == "none":
        refinement = NOT_REFINED
    if scheme.is_explicit:
        require_stable(operators, time_step, law.spring[0])
    try:
        if isinstance(law, Law):
            combination(law.name, scheme.name)
        if name == "compiled":
            from delam_fem.engines.compiled.engine import compiled_engine

            return compiled_engine(operators, law, scheme, time_step, refinement)
        comm = comm or initialise_petsc_alone()  # before anything imports PETSc
        from delam_fem.engines.petsc.engine import petsc_engine

        return petsc_engine(operators, law, scheme, time_step, refinement, comm)
    except ValueError as error:
        raise CaseError(f"contact law: {error}") from None


def law_of(case: Case) -> Law:
    """Return the contact law of a case."""
    given = case.contact
    return Law(
        given.law,
        restitution=given.restitution,
        impulse=given.impulse,
        penalty_stiffness=given.penalty_stiffness,
        penalty_damping=given.penalty_damping,
        threshold_velocity=given.threshold_velocity,
    )


def scheme_of(case: Case) -> Scheme:
    """Return the time integration of a case."""
    return SCHEMES[case.time.scheme]


def initialise_petsc_alone() -> MPI.Intracomm:
    """Initialise PETSc for this process alone, and return its communicator.

    By default PETSc initialises with all ranks together. The worker of a sweep would then wait for
    the other ranks forever.
    """
    from delam_fem.mpi import MPI, start_petsc

    start_petsc(MPI.COMM_SELF)
    return MPI.COMM_SELF

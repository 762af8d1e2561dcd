"""Choose the discretisation of a case: beams, solids, or a reduced model.

Each one is imported only when it is chosen: only some need dolfinx.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from delam_fem.case.definition import Case
from delam_fem.model.layout import Structure

if TYPE_CHECKING:
    from delam_fem.mpi import MPI


def assemble(
    case: Case, *, comm: MPI.Intracomm | None = None, needs_dolfinx: bool = True
) -> Structure:
    """Return the operators and the layout of a case.

    Args:
        case: the case; `model.kind` says what its laminae are computed as.
        comm: communicator that shares the work; None: this process alone. Of beams and reduced
            models every rank gets the whole result, of solids its own share.
        needs_dolfinx: whether beams are assembled from weak forms in dolfinx; False: from closed
            forms, which equal them to round-off.

    Raises:
        CaseError: the case cannot be discretised.
    """
    if case.model.is_continuum:
        from delam_fem.model.solids import assembly
        from delam_fem.mpi import MPI

        return assembly.assemble(case, comm=MPI.COMM_SELF if comm is None else comm)
    if case.model.kind == "reduced":
        from delam_fem.model.reduction import file

        return file.load(case)
    if not needs_dolfinx:
        from delam_fem.model.beams import closed_form

        return closed_form.assemble(case)
    from delam_fem.model.beams import bending
    from delam_fem.mpi import MPI

    return bending.assemble(case, comm=MPI.COMM_SELF if comm is None else comm)

"""Choose the discretisation of a case: beams, solids, or modes.

Each of them is imported only when it is chosen, because only some need dolfinx.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

from delam_fem.case.definition import Case
from delam_fem.case.sections import ModelKind
from delam_fem.model.layout import Structure
from delam_fem.system.errors import CaseError, require

if TYPE_CHECKING:
    from delam_fem.system.mpi import MPI

INSTALL = "apt-get install python3-dolfinx, or conda install -c conda-forge fenics-dolfinx"
"""How a user gets dolfinx, and PETSc and MPI with it."""
_log = logging.getLogger(__name__)


def has_dolfinx() -> bool:
    """Return whether dolfinx is installed, without importing it."""
    return find_spec("dolfinx") is not None


def require_bending(case: Case, study: str) -> None:
    """Refuse bars and points, which a study does not know.

    Raises:
        CaseError: the case has some.
    """
    if case.is_axial:
        raise CaseError(f"lamina: {study}: expected beams, given bars or points")


def require_held(case: Case, study: str) -> None:
    """Refuse what moves without any stiffness, which a study does not know.

    Raises:
        CaseError: something does.
    """
    if case.is_floating:
        raise CaseError(f"{study}: expected a structure, points and impactors that are all held")


def require_plain(case: Case, study: str) -> None:
    """Refuse bars, points, stops, impactors or inner supports, which a study does not know.

    Raises:
        CaseError: the case has some.
    """
    require_bending(case, study)
    inside = {
        "stop": case.stop,
        "impactor": case.impactor,
        "support": (*case.support.inside, *case.support.at_points),
    }
    for key, entries in inside.items():
        require(not entries, f"{key}: {study}", "none inside the span", len(entries))


def require_mass(case: Case, study: str, reason: str) -> None:
    """Refuse a case with massless contact points, which a study cannot follow.

    Raises:
        CaseError: its contact points have no mass.
    """
    if case.is_massless:
        raise CaseError(
            f'time.mass: {study}: expected "consistent" or "lumped", given "massless": {reason}'
        )


def require_kind(case: Case, study: str, kinds: Sequence[ModelKind], reason: str) -> None:
    """Refuse a case whose kind of model a study cannot follow.

    Args:
        case: the case.
        study: name of the study in the message.
        kinds: kinds of model that it takes.
        reason: why it takes no others.

    Raises:
        CaseError: the study takes other kinds only.
    """
    if case.model.kind not in kinds:
        expected = " or ".join(f'"{kind}"' for kind in kinds)
        raise CaseError(
            f'model.kind: {study}: expected {expected}, given "{case.model.kind}": {reason}'
        )


def assemble(
    case: Case,
    *,
    comm: MPI.Intracomm | None = None,
    needs_dolfinx: bool = True,
    needs_damping: bool = True,
) -> Structure:
    """Return the operators and the layout of a case.

    Args:
        case: the case; `model.kind` says what its laminae are computed as.
        comm: communicator that shares the work; None: this process alone. Of beams and reduced
            models every rank gets the whole result, of solids its own share.
        needs_dolfinx: whether beams are assembled from weak forms in dolfinx; False: from closed
            forms, which equal them to round-off.
        needs_damping: whether anything reads C. False: that of solids, which is as large as K, is
            left 0.

    Raises:
        CaseError: the case cannot be discretised.
    """
    if case.model.is_continuum:
        if not has_dolfinx():
            raise CaseError(
                f'model.kind: expected "beam" or "modes", as dolfinx is not installed; given '
                f'"{case.model.kind}": {INSTALL}'
            )
        from delam_fem.model.solids import assembly
        from delam_fem.system.mpi import MPI

        comm = MPI.COMM_SELF if comm is None else comm
        return assembly.assemble(case, comm=comm, needs_damping=needs_damping)
    if case.model.file is not None:
        from delam_fem.model import reduction_file

        return reduction_file.load(case)
    # the massless engine takes modes of beams in closed form
    needs_dolfinx &= not (case.is_massless or case.is_axial)
    if needs_dolfinx and not has_dolfinx():
        _log.warning("dolfinx is not installed: beams come from closed forms; %s", INSTALL)
    if not (needs_dolfinx and has_dolfinx()):
        from delam_fem.model.beams import closed_form

        return closed_form.assemble(case)
    from delam_fem.model.beams import forms
    from delam_fem.system.mpi import MPI

    return forms.assemble(case, comm=MPI.COMM_SELF if comm is None else comm)

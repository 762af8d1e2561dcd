"""Options of PETSc with the prefixes of the package: which are given, and that they are read.

This module imports neither MPI nor PETSc: the compiled engine, which reads no options, asks too.
"""

from __future__ import annotations

import ctypes
import os
import sys

from delam_fem.system.errors import CaseError

PREFIXES = ("moreau_", "newmark_mass_", "newmark_")
"""One prefix for each kind of factor; an option belongs to the first one that it starts with."""


def given_options(prefix: str | None = None) -> list[str]:
    """Return the options of PETSc with a prefix of the package, also before PETSc is loaded.

    Args:
        prefix: one of `PREFIXES`; None: all.
    """
    PETSc = sys.modules.get("petsc4py.PETSc")
    words = os.environ.get("PETSC_OPTIONS", "").split()
    names = [w[1:] for w in words if w[:1] == "-"] if PETSc is None else PETSc.Options().getAll()
    wanted = PREFIXES if prefix is None else (prefix,)
    return [n for n in names if next(filter(n.startswith, PREFIXES), None) in wanted]


def require_options_used() -> None:
    """Refuse options of PETSc with a prefix of the package that nothing has read so far.

    Raises:
        CaseError: there are some.
    """
    PETSc = sys.modules.get("petsc4py.PETSc")

    def is_used(name: str) -> bool:
        if PETSc is None or PETSc.__file__ is None:
            return False
        used = ctypes.c_int(0)
        library = ctypes.CDLL(PETSc.__file__)  # petsc4py does not offer this function
        library.PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
        return bool(used.value)

    unused = [f"-{name}" for name in given_options() if not is_used(name)]
    if unused:
        raise CaseError(
            f"PETSC_OPTIONS: {', '.join(unused)}: expected options that the solvers of this run "
            "read (docs/continuum.md has their prefixes); given, but read by none"
        )

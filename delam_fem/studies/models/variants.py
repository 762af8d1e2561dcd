"""The models of a case that are compared: beams, plane stress, solids, and one reduced to modes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.engines.choose import EngineName
from delam_fem.model import discretise
from delam_fem.model.layout import Structure

Name = Literal["beam", "plane-stress", "solid", "reduced"]
NAMES: tuple[Name, ...] = get_args(Name)


@dataclass(frozen=True)
class Variant:
    """One model of a case.

    Attributes:
        name: name of the model.
        case: the case with this model.
        structure: the discretised case.
        engine: the engine that computes its steps.
        seconds: processor time of the assembly, or of the reduction [s].
    """

    name: str
    case: Case
    structure: Structure
    engine: EngineName
    seconds: float


def variants(case: Case, names: Sequence[str], modes: int) -> list[Variant]:
    """Return the models of a case in the order of their names.

    Args:
        case: the case; its own `model` gives Poisson's ratio, degree, layers and strips.
        names: of `NAMES`; "reduced" reduces the model that is named before it.
        modes: number of modes of each body of a reduced model.

    Raises:
        CaseError: there is no such model, none to reduce, or one cannot be made.
    """
    if unknown := [name for name in names if name not in NAMES]:
        raise CaseError(f"models: expected some of {', '.join(NAMES)}, given {unknown[0]!r}")
    found: list[Variant] = []
    for name in names:
        begin = time.process_time()
        if name == "reduced":
            if not found:
                raise CaseError(
                    "models: expected a model before reduced, the one that it reduces, for example "
                    "plane-stress,reduced"
                )
            from delam_fem.model.reduction.of_case import reduced_case

            whole = found[-1]
            structure = reduced_case(whole.case, modes, full=whole.structure).structure
            own, label = whole.case, f"{whole.name}, {modes} modes"
        else:
            own, label = with_model(case, name), name
            structure = discretise.assemble(own, needs_dolfinx=False)
        engine: EngineName = "compiled" if name in ("beam", "reduced") else "petsc"
        seconds = time.process_time() - begin
        found.append(Variant(label, own, structure, engine, seconds))
    return found


def with_model(case: Case, kind: str) -> Case:
    """Return the case with another kind of model, whose mesh is made from `mesh.elements`."""
    if case.mesh.file is not None and kind != case.model.kind:
        raise CaseError(
            f"models: mesh.file is a mesh of kind {case.model.kind!r}; give mesh.elements for "
            f"{kind!r}, given {Path(case.mesh.file).name}"
        )
    return case.with_overrides({"model.kind": kind, "model.file": None})

"""The models of a case whose orbits can be sought, and what the coarse search takes on each."""

from __future__ import annotations

from typing import Literal, get_args

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.studies.orbits.ensemble import USUAL, Perturbations
from delam_fem.studies.orbits.family import CaseFamily
from delam_fem.studies.orbits.protocol import CaseMap

Model = Literal["full", "reduced"]
"""All finite elements of the case, or a few modes of each part (`model.reduced`)."""

SMOOTH = Perturbations(copies=16, size=1e-3, kick=0.03)
"""What suits a reduced model, whose map has no jumps: few and small perturbations."""


def map_of(
    case: Case,
    key: str,
    model: Model = "full",
    *,
    modes: int | None = None,
    refine: int | None = None,
) -> CaseMap:
    """Return the map of a model of a case from one period to the next.

    Args:
        case: the case; its drive must be periodic.
        key: the parameter.
        model: "full" or "reduced".
        modes: modes of each part of a reduced model; None: that of `studies.reduced.motion`.
        refine: its fine steps in a coarse one near contact; None: likewise.

    Raises:
        CaseError: there is no such model, or the case has none.
    """
    given = {k: v for k, v in (("modes", modes), ("refine", refine)) if v is not None}
    check(model)
    if model == "full":
        for name, value in given.items():
            raise CaseError(f"{name}: expected with model 'reduced' only, given {value}")
        return CaseFamily(case, key).map()
    for name, value in given.items():
        if value < 1:
            raise CaseError(f"{name}: expected at least 1, given {value}")
    from delam_fem.studies.reduced.strobe import ReducedMap

    return ReducedMap(case, key, **given)


def usual(model: Model) -> Perturbations:
    """Return the perturbations that suit the map of a model."""
    check(model)
    return USUAL if model == "full" else SMOOTH


def check(model: str) -> None:
    """Refuse a model that is not known.

    Raises:
        CaseError: there is no such model.
    """
    if model not in get_args(Model):
        raise CaseError(f"model: expected {' or '.join(get_args(Model))}, given {model!r}")

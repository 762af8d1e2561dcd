"""Options of the natural modes; nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from delam_fem.api import Flag, Options, Study

if TYPE_CHECKING:
    from delam_fem.studies.modes.frequencies import NaturalModes, StructureModes


@dataclass(frozen=True, kw_only=True)
class Modes(Options):
    """List natural frequencies; laminae that are apart are compared with the exact cantilever.

    Attributes:
        number: modes per lamina or structure.
        delaminations: laminae pass through one another, or are kept together.
    """

    common = ()
    number: Annotated[int, Flag(("-n", "--number"), "N")] = 6
    delaminations: Literal["free", "closed"] = "free"


MODES: Study[Modes, NaturalModes | StructureModes] = Study(
    Modes,
    "delam_fem.studies.modes.frequencies:compute",
    "Compute",
    "modes",
    takes_impactors=True,
    shares_factors=True,
)

"""The options and the words of the study; nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from delam_fem.api import Flag, Options, Study

if TYPE_CHECKING:
    from deflection.compute import Deflection


@dataclass(frozen=True, kw_only=True)
class UnderForce(Options):
    """Show how far each lamina bends under a steady force at its end.

    Attributes:
        force: force at the end of each lamina [N].
    """

    common = ()
    force: Annotated[float, Flag(metavar="N")] = 1.0


DEFLECTION: Study[UnderForce, Deflection] = Study(
    UnderForce, "deflection.compute:compute", "Compute", "deflection"
)

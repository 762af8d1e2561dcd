"""Options of the comparison with other models; nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from delam_fem.plugins.options import Flag, Options
from delam_fem.plugins.study import Study

if TYPE_CHECKING:
    from delam_fem.reference.compare import Comparison
    from delam_fem.studies.models import ModelComparison


@dataclass(frozen=True, kw_only=True)
class Compare(Options):
    """Compare a case with an independent reference, or as beams, solids and reduced to modes.

    Attributes:
        models: models that are compared, as beam,plane-stress,solid,modes; the last reduces the
            one before it. Without this option: compare with the reference.
        channel: with --models: channel that is compared, as a1; repeatable (default: all
            displacements).
        at: with --models: frequencies [Hz]; repeatable.
        impacts: compare with the reference up to this impact.
        periods: periods of each run (default: 3, with --models 20).
        modes: modes of a reduced model.
    """

    common = ()
    models: Annotated[tuple[str, ...] | None, Flag(metavar="NAMES", is_joined=True)] = None
    channel: Annotated[tuple[str, ...], Flag(metavar="NAME")] = ()
    at: Annotated[tuple[float, ...], Flag(least=0)] = ()
    impacts: Annotated[int, Flag(metavar="N")] = 20
    periods: Annotated[int | None, Flag(metavar="N")] = None
    modes: Annotated[int, Flag(metavar="N", least=1)] = 20


COMPARE: Study[Compare, Comparison | ModelComparison] = Study(
    Compare, "delam_fem.reference.compare:compute", "Judge", "compare", shares_factors=True
)

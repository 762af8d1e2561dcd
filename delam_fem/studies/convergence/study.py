"""Options of the refinement study; nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from delam_fem.api import Flag, Options, Study

if TYPE_CHECKING:
    from delam_fem.studies.convergence.analysis import Convergence


@dataclass(frozen=True, kw_only=True)
class Converge(Options):
    """Refine a case, and show to which limit, how fast and at what cost each method converges.

    Attributes:
        direction: what to refine; points: contact points inside the elements; both: every mesh
            with every number of steps.
        laws: contact laws with their schemes, e.g. newton@moreau-jean, maybe with /lumped or
            /consistent (default: five of them; beside elastic stops penalty).
        elements: elements per lamina (default: 5,10,…,160).
        meshes: mesh files instead of elements, coarse first.
        points: contact points per element (default: 1,2,4,8).
        steps: steps per period (default: 250,500,…,16000).
        periods: periods in the statistics.
        limit_steps: steps per period of the rigid limit; 0, or with elastic stops: no limit.
        engine: engine that computes the steps.
        judged: numbers that the verdict is about: tip_min, tip_max, amplitude (of the drive's
            frequency), modal_impulse; others are not judged (default: tip_min,tip_max).
        of: channel that the verdict is about, as tip_thin_velocity, base, "contact_stop 1", or the
            name of a sensor: its min, max and rms; NAME:MEASURE judges one of min, max, amplitude,
            rms, mean.
    """

    common = ("workers", "resume", "overwrite", "dry_run", "yes")
    direction: Annotated[Literal["elements", "points", "steps", "both"], Flag(("--in",))] = "steps"
    laws: Annotated[tuple[str, ...] | None, Flag(metavar="LAW,…", is_joined=True)] = None
    elements: Annotated[tuple[int, ...] | None, Flag((), "N,…", 1, is_joined=True)] = None
    meshes: Annotated[tuple[Path, ...] | None, Flag(metavar="FILE,…", is_joined=True)] = None
    points: Annotated[tuple[int, ...] | None, Flag((), "P,…", 1, is_joined=True)] = None
    steps: Annotated[tuple[int, ...] | None, Flag((), "N,…", 1, is_joined=True)] = None
    periods: Annotated[int, Flag(least=1)] = 60
    limit_steps: Annotated[int, Flag(least=0)] = 64000
    engine: Literal["petsc", "compiled"] = "compiled"
    judged: Annotated[tuple[str, ...] | None, Flag(("--judge",), "NAME,…", is_joined=True)] = None
    of: Annotated[tuple[str, ...] | None, Flag(("--of",), "NAME")] = None


HOME = "delam_fem.studies.convergence.run"
CONVERGE: Study[Converge, Convergence] = Study(
    Converge, f"{HOME}:refine", "Judge", "converge", cost=f"{HOME}:cost", remove=f"{HOME}:remove"
)

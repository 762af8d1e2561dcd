"""Options of the studies of periodic orbits; nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from delam_fem.api import Flag, Options, Study

if TYPE_CHECKING:
    from delam_fem.studies.orbits.follow import Branches
    from delam_fem.studies.orbits.run import PeriodicOrbit


@dataclass(frozen=True, kw_only=True)
class OfOrbits(Options):
    """How orbits are sought.

    Attributes:
        period: periods of the drive in one of the orbit.
        kick: size of kicks, relative to the state (default: 0.02; massless contact points: 0.03).
        seed: seed of the fixed perturbations.
        channel: channel that is shown, as a1 or "contact_stop 1"; repeatable (default: the
            displacements of the reference probes).
    """

    period: Annotated[int, Flag(metavar="P")] = 1
    kick: Annotated[float | None, Flag(metavar="X", least=1e-6, most=0.5)] = None
    seed: Annotated[int, Flag(metavar="N")] = 0
    channel: Annotated[tuple[str, ...], Flag(metavar="NAME")] = ()


@dataclass(frozen=True, kw_only=True)
class Orbit(OfOrbits):
    """Find the periodic orbit of a case and judge its stability; write DIR/orbit.json.

    Attributes:
        settle: periods computed before the search starts.
    """

    settle: Annotated[int, Flag(metavar="N", least=0)] = 300


@dataclass(frozen=True, kw_only=True)
class Follow(OfOrbits):
    """Follow the orbits of a case over a key; write DIR/branch.nc and its diagram.

    Attributes:
        start: value where to start, as 9.5 or "9.5 Hz".
        stop: other end of the range.
        key: key of the case to vary.
        doublings: how often branches of twice the period are followed.
        step: first steps, relative to state and range.
        over: result of a sweep over the key, drawn behind: its folder.
    """

    start: Annotated[str, Flag(("--from",), "X")]
    stop: Annotated[str, Flag(("--to",), "X")]
    key: Annotated[str, Flag(metavar="KEY", is_argument=True)] = "excitation.frequency"
    doublings: Annotated[int, Flag(least=0)] = 1
    step: Annotated[float, Flag(least=1e-4, most=0.5)] = 0.04
    over: Annotated[Path | None, Flag(metavar="SWEEP")] = None


HOME = "delam_fem.studies.orbits"
ORBIT: Study[Orbit, PeriodicOrbit] = Study(
    Orbit,
    f"{HOME}.run:compute",
    "Compute",
    "orbit find",
    folder="orbit",
    takes_impactors=True,
    has_checkpoints=True,
)
FOLLOW: Study[Follow, Branches] = Study(
    Follow,
    f"{HOME}.follow:compute",
    "Compute",
    "orbit follow",
    folder="branch",
    takes_impactors=True,
)

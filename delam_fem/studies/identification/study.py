"""Options of the studies that identify parameters; nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from delam_fem.api import Flag, Options, Study

if TYPE_CHECKING:
    from delam_fem.studies.identification.fit import ResponseFit
    from delam_fem.studies.identification.identify import Identification
    from delam_fem.studies.identification.natural import Followed
    from delam_fem.studies.identification.resonance import Found

RIG = Flag(metavar="KEY=LOW:HIGH")


@dataclass(frozen=True, kw_only=True)
class Resonance(Options):
    """Identify frequency, damping and EI of each lamina from the swept sine of a case.

    Attributes:
        measured: reference probes in a swept sine; by default the case simulates it.
        noise: standard deviation of a sample [m].
        seed: seed of the noise.
    """

    measured: Annotated[Path | None, Flag(metavar="FILE")] = None
    noise: Annotated[float, Flag(least=0)] = 0.0
    seed: Annotated[int, Flag(least=0)] = 1


@dataclass(frozen=True, kw_only=True)
class Identify(Options):
    """Identify keys of a case from frequency responses or clapping motions.

    Attributes:
        unknown: a key that is sought; repeatable.
        frequency: frequency of a motion [Hz]; repeatable; none for frequency responses.
        level: amplitude of the drive of each motion, in the unit of the case's own (m, m/s2, N);
            repeatable (default: that of the case).
        channel: a channel that is measured, of the record of a run; the
            first one gives the phase; repeatable (default: the displacements of all laminae).
        measured: what measure response has written, of any number of records without contact; or
            channels of a motion, one file per frequency, which by default the case simulates.
        band: lowest and highest frequency of responses, LOW,HIGH [Hz] (default: what is driven).
        noise: standard deviation of a sample, of all channels or repeated for each (SI).
        uncertain: in what the rig may differ from the case; 0.9x:1.1x are multiples of the case's
            own value; repeatable (default: stiffness ± 10 %, damping 0.5x:2x, clamps that yield).
        simulations: number of simulations.
        calibrate: number of simulations that check the intervals.
        seed: seed of the noise and of the prior.
    """

    common = ("workers", "resume", "overwrite", "dry_run", "yes")
    unknown: Annotated[tuple[str, ...], RIG]
    frequency: tuple[float, ...] = ()
    level: Annotated[tuple[float, ...], Flag(least=0)] = ()
    channel: Annotated[tuple[str, ...] | None, Flag(metavar="NAME")] = None
    measured: Annotated[tuple[Path, ...] | None, Flag(metavar="FILE")] = None
    band: Annotated[tuple[float, ...] | None, Flag(metavar="LOW,HIGH", is_joined=True)] = None
    noise: Annotated[tuple[float, ...], Flag(least=0)] = (1e-4,)
    uncertain: Annotated[tuple[str, ...] | None, RIG] = None
    simulations: Annotated[int, Flag(least=100)] = 2000
    calibrate: Annotated[int, Flag(least=0)] = 100
    seed: Annotated[int, Flag(least=0)] = 1


@dataclass(frozen=True, kw_only=True)
class Natural(Options):
    """Identify keys of a case over time from one of its natural frequencies.

    Attributes:
        measured: what measure response --free has written.
        unknown: a key that is sought; repeatable.
        mode: number of the mode.
        uncertain: in what the rig may differ from the case, as for identify keys; repeatable.
        simulations: number of cases from the prior.
        seed: seed of the prior and of the noise.
    """

    common = ()
    measured: Annotated[Path, Flag(metavar="FILE")]
    unknown: Annotated[tuple[str, ...], RIG]
    mode: Annotated[int, Flag(least=1)] = 1
    uncertain: Annotated[tuple[str, ...] | None, RIG] = None
    simulations: Annotated[int, Flag(least=50)] = 300
    seed: Annotated[int, Flag(least=0)] = 1


HOME = "delam_fem.studies.identification"
RESONANCE: Study[Resonance, Found] = Study(
    Resonance, f"{HOME}.resonance:identified", "Data", "identify resonance", has_checkpoints=True
)
IDENTIFY: Study[Identify, Identification | ResponseFit] = Study(
    Identify,
    f"{HOME}.identify:compute",
    "Data",
    "identify keys",
    folder="identification",
    cost=f"{HOME}.identify:cost",
    remove=f"{HOME}.identify:remove",
)
NATURAL: Study[Natural, Followed] = Study(
    Natural, f"{HOME}.natural:compute", "Data", "identify natural"
)

"""The paper's experiments on lateral impact (section 2.3), with the studies that its figures need.

`rolling` lets a strip fall on the ground along which it lies, `tip_block` lets its tip fall on a
block. `rolling_study` repeats the first with other laws, releases, meshes and steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from delam_fem import ground
from delam_fem.ground_run import GroundLaw
from delam_fem.rolling import Rolling, rolling
from delam_fem.tip_block import TipBlock
from delam_fem.tip_fall import tip_block

__all__ = ["LAWS", "RollingStudy", "Rung", "TipBlock", "rolling", "rolling_study", "tip_block"]

LAWS = {
    "moreau": GroundLaw("moreau", 0.1),
    "moreau-recovery": GroundLaw("moreau-recovery", 0.1),
    "newton-penalty": GroundLaw("newton-penalty", 0.1, stiffness=1e5),
}
"""The laws compared, with the paper's e = 0.1 and γ. Its springs of 100 N/m are for laminae 10 to
100 times as soft as the strip, which gets 1e5 N/m per node."""
LIFTS: tuple[ground.Lift, ...] = ("tip force", "uniform load", "first mode")
DAMPING_RATIOS = (0.0, 0.002)
"""D of modes 1 and 2: none at all, and about that of a clamped steel strip."""
LONG = 0.040
"""Duration of the runs that show a rebound: it ends at about 38 ms [s]."""


@dataclass(frozen=True)
class Rung:
    """Where the energy goes in one run of a ladder.

    Attributes:
        law: name of the law.
        damping_ratio: D [-].
        elements: n.
        time_step: Δt [s].
        impacts, damping, left: shares of the energy after 25 ms, half a period [-].
        outcome: "completed" or "diverged".
    """

    law: str
    damping_ratio: float
    elements: int
    time_step: float
    impacts: float
    damping: float
    left: float
    outcome: str


@dataclass(frozen=True)
class RollingStudy:
    """The first experiment and its variations.

    Attributes:
        by_law: released from a tip force, for each of `LAWS`.
        by_lift: law moreau, for each of `LIFTS`.
        ladder: meshes and time steps.
    """

    by_law: Mapping[str, Rolling]
    by_lift: Mapping[ground.Lift, Rolling]
    ladder: tuple[Rung, ...]

    def rungs(self, law: str, damping_ratio: float, elements: int) -> list[Rung]:
        """Return the completed rungs of a law, damping and mesh, by falling time step."""
        return [
            rung
            for rung in sorted(self.ladder, key=lambda rung: -rung.time_step)
            if (rung.law, rung.damping_ratio, rung.elements) == (law, damping_ratio, elements)
            and rung.outcome == "completed"
        ]

    def numbers(self) -> dict[str, Any]:
        """Return what the figure quotes."""
        return {
            "by_law": {name: run.numbers() for name, run in self.by_law.items()},
            "by_lift": {name: run.numbers() for name, run in self.by_lift.items()},
            "ladder": [vars(rung) for rung in self.ladder],
        }


def rolling_study(*, fast: bool = False) -> RollingStudy:
    """Compute the first experiment with other laws, releases, meshes and time steps.

    Args:
        fast: with a shorter ladder.
    """
    elements, steps = (
        ((20, 80), (1e-5, 2.5e-6)) if fast else ((20, 40, 80), (1e-5, 2.5e-6, 6.25e-7))
    )
    by_law = {name: rolling(law=law, duration=LONG) for name, law in LAWS.items()}
    others = {lift: rolling(lift=lift, duration=LONG) for lift in LIFTS[1:]}
    ladder = tuple(
        rung(name, damping_ratio, n, time_step)
        for name in LAWS
        for damping_ratio in DAMPING_RATIOS
        for n in elements
        for time_step in steps
    )
    return RollingStudy(by_law, {LIFTS[0]: by_law["moreau"], **others}, ladder)


def rung(law: str, damping_ratio: float, elements: int, time_step: float) -> Rung:
    """Return where the energy goes with a law of `LAWS`, released from a tip force.

    Args:
        law: its name.
        damping_ratio: D [-].
        elements: n.
        time_step: Δt [s].
    """
    lamina = ground.steel_strip(damping_ratio=damping_ratio)
    run = rolling(lamina, LAWS[law], n_elements=elements, time_step=time_step)
    shares = run.shares(float(run.energy.time[-1]))
    return Rung(
        law=law,
        damping_ratio=damping_ratio,
        elements=elements,
        time_step=time_step,
        impacts=shares["impacts"],
        damping=shares["damping"],
        left=shares["left"],
        outcome=run.outcome,
    )

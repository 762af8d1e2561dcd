"""The paper's experiments on lateral impact (section 2.3), with the studies that its figures need.

`rolling` lets a strip fall on the ground on which it lies. `tip_block` lets its tip fall on a
block. `rolling_study` repeats the first with other strips, heights, laws, meshes and time steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from delam_fem.model.beams import ground
from delam_fem.paper.lateral.ground_run import GroundLaw
from delam_fem.paper.lateral.rolling import Rolling, rolling, thin_strip
from delam_fem.paper.lateral.tip_block import TipBlock
from delam_fem.paper.lateral.tip_fall import tip_block

__all__ = ["LAWS", "RollingStudy", "StripRung", "TipBlock", "rolling", "rolling_study", "tip_block"]

LAWS = {
    "newton@moreau-jean": GroundLaw("newton", 0.1, scheme="moreau-jean"),
    "newton-penalty@newmark": GroundLaw("newton-penalty", 0.1, stiffness=100.0),
}
"""The laws that are compared, with the paper's e = 0.1, γ and spring stiffness (the thin strip is
as soft as the paper's laminae)."""
HEIGHTS = (0.014, 0.02, 0.03, 0.04, 0.05, 0.07, 0.085, 0.1, 0.15)
"""Tip heights of the thin strip, which sags by 34 mm under its weight [m]."""
DAMPING_RATIOS = (0.0, 0.002)
"""D of modes 1 and 2: no damping, and about the damping of a clamped steel strip."""
LONG = 0.8
"""Duration of the runs that show a rebound, in periods; the rebound ends at about 0.76."""


@dataclass(frozen=True)
class StripRung:
    """The energy shares of one run of a ladder.

    Attributes:
        law: name of the law.
        damping_ratio: D [-].
        elements: n.
        steps_per_period: time steps per lowest period [-].
        impacts, damping, left: shares of the energy after half a period [-].
        outcome: "completed" or "diverged".
    """

    law: str
    damping_ratio: float
    elements: int
    steps_per_period: int
    impacts: float
    damping: float
    left: float
    outcome: str


@dataclass(frozen=True)
class RollingStudy:
    """The first experiment and its variations; a force at the tip lifts every strip.

    Attributes:
        by_law: the thin strip, by the name of the law in `LAWS`.
        stiff: the strip of the second experiment with newton@moreau-jean.
        by_height: the thin strip by height of its tip [m], on a coarser mesh.
        ladder: the thin strip on other meshes and with other time steps.
    """

    by_law: Mapping[str, Rolling]
    stiff: Rolling
    by_height: Mapping[float, Rolling]
    ladder: tuple[StripRung, ...]

    def rungs(self, law: str, damping_ratio: float, elements: int) -> list[StripRung]:
        """Return the completed runs of a law, a damping and a mesh, by increasing steps."""
        return [
            rung
            for rung in sorted(self.ladder, key=lambda rung: rung.steps_per_period)
            if (rung.law, rung.damping_ratio, rung.elements) == (law, damping_ratio, elements)
            and rung.outcome == "completed"
        ]

    def numbers(self) -> dict[str, Any]:
        """Return the numbers that the figure quotes."""
        return {
            "by_law": {name: run.numbers() for name, run in self.by_law.items()},
            "stiff": self.stiff.numbers(),
            "by_height_mm": {f"{1e3 * h:g}": run.numbers() for h, run in self.by_height.items()},
            "ladder": [vars(rung) for rung in self.ladder],
        }


def rolling_study(*, fast: bool = False) -> RollingStudy:
    """Compute the first experiment with other strips, heights, laws, meshes and time steps.

    Args:
        fast: whether to compute a shorter ladder.
    """
    elements, steps = (
        ((20, 80), (5_000, 20_000)) if fast else ((20, 40, 80), (5_000, 20_000, 80_000))
    )
    stiff = ground.steel_strip(damping_ratio=max(DAMPING_RATIOS))
    return RollingStudy(
        by_law={name: rolling(law=law, periods=LONG) for name, law in LAWS.items()},
        stiff=rolling(stiff, periods=LONG),
        by_height={
            height: rolling(height=height, n_elements=40, steps_per_period=10_000)
            for height in HEIGHTS
        },
        ladder=tuple(
            rung(name, damping_ratio, n, n_steps)
            for name in LAWS
            for damping_ratio in DAMPING_RATIOS
            for n in elements
            for n_steps in steps
        ),
    )


def rung(law: str, damping_ratio: float, elements: int, steps_per_period: int) -> StripRung:
    """Compute the energy shares of the thin strip with a law of `LAWS`.

    Args:
        law: name of the law.
        damping_ratio: D [-].
        elements: n.
        steps_per_period: time steps per lowest period [-].
    """
    run = rolling(
        thin_strip(damping_ratio),
        LAWS[law],
        n_elements=elements,
        steps_per_period=steps_per_period,
    )
    shares = run.shares(float(run.energy.time[-1]))
    return StripRung(
        law=law,
        damping_ratio=damping_ratio,
        elements=elements,
        steps_per_period=steps_per_period,
        impacts=shares["impacts"],
        damping=shares["damping"],
        left=shares["left"],
        outcome=run.outcome,
    )

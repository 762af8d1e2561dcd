"""The one-step schemes of time integration, as numbers.

Newmark's scheme solves for the acceleration at the end of a step and asks the contact law there.
The Moreau–Jean scheme solves for the velocity, and impulses belong to the step in which they act.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

SchemeName = Literal["newmark", "central-difference", "moreau-jean"]


@dataclass(frozen=True)
class Scheme:
    """A scheme with its numbers.

    Attributes:
        name: as in case files.
        beta: Newmark's β (the paper's α_N); unused by Moreau–Jean.
        gamma: Newmark's γ (the paper's β_N); unused by Moreau–Jean.
        theta: θ of Moreau–Jean, from 1/2 (no numerical damping) to 1; unused by Newmark.
    """

    name: SchemeName = "newmark"
    beta: float = 0.25
    gamma: float = 0.5
    theta: float = 0.5

    @property
    def has_impulses_within(self) -> bool:
        """Whether impulses act within the step, not between two steps."""
        return self.name == "moreau-jean"

    @property
    def is_explicit(self) -> bool:
        """Whether the time step has a stability limit."""
        return self.name != "moreau-jean" and self.beta == 0.0


SCHEMES: Mapping[str, Scheme] = MappingProxyType(
    {
        "newmark": Scheme("newmark"),
        "central-difference": Scheme("central-difference", beta=0.0),
        "moreau-jean": Scheme("moreau-jean"),
    }
)
"""The schemes of case files: average acceleration, β = 0, and θ = 1/2."""

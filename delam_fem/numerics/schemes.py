"""Define the schemes of time integration by their parameters.

All are one-step schemes. Newmark's scheme solves for the acceleration at the end of a step and
calls the contact law there. The Moreau–Jean scheme solves for the velocity at the end of a step
together with the impulses that act within the step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

from delam_fem.system.errors import require, require_number

SchemeName = Literal["newmark", "central-difference", "moreau-jean"]


@dataclass(frozen=True)
class Scheme:
    """A scheme of time integration with its parameters.

    Attributes:
        name: name in case files.
        beta: Newmark's β (the paper's α_N); Moreau–Jean does not use it.
        gamma: Newmark's γ (the paper's β_N); Moreau–Jean does not use it.
        theta: θ of Moreau–Jean, from 1/2 (no numerical damping) to 1; Newmark does not use it.
    """

    name: SchemeName = "newmark"
    beta: float = 0.25
    gamma: float = 0.5
    theta: float = 0.5

    def __post_init__(self) -> None:
        """Refuse an unknown name, and parameters out of range, with a CaseError."""
        names = get_args(SchemeName)
        require(self.name in names, "scheme", f"one of {', '.join(names)}", self.name)
        require_number("beta", self.beta)
        require_number("gamma", self.gamma)
        require_number("theta", self.theta, least=0.5, most=1.0)

    @property
    def has_impulses_within(self) -> bool:
        """Whether impulses act within a step instead of between two steps."""
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
"""Schemes by their names in case files: average acceleration (β = 1/4), β = 0, and θ = 1/2."""

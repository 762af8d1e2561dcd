"""Define the contact laws, and the schemes that go with each.

All schemes of time integration are one-step schemes. Newmark's scheme solves for the acceleration
at the end of a step and calls the contact law there. The Moreau–Jean scheme solves for the velocity
at the end of a step together with the impulses that act within the step.

What steppers show to a law, and what it answers, is in `decisions.py`.

A new law needs a row in `LAWS`, a row in `COMBINATIONS` for each scheme, and, if none of the kinds
of decisions fits, one more in `rules.py`, which both engines call; docs/architecture.md has the
list.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, Protocol, get_args

import numpy as np

from delam_fem.contact.decisions import (
    DAMPING,
    IMPACTS,
    IS_ELASTIC,
    MOREAU,
    N_OF_PAIR,
    NONE,
    PENALTY,
    RESTITUTION,
    THRESHOLD,
    LawContext,
    LawNumbers,
    PairNumbers,
    Supervisor,
)
from delam_fem.system.errors import require, require_number

ELASTIC_WITHIN = (
    'expected an elastic contact only with time.scheme = "newmark" or "central-difference": the '
    'impulses of "moreau-jean" act within a step, and its equation has no contact springs; take '
    'contact.law = "newton@newmark", or a rigid contact'
)
"""Why a contact with a stiffness of its own does not go with the Moreau–Jean scheme."""

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
        require_number("gamma", self.gamma, least=0.5)  # below, every motion grows
        require_number("theta", self.theta, least=0.5, most=1.0)

    @property
    def numbers(self) -> Mapping[str, float]:
        """The parameters of the case file that the scheme reads, by their keys in `[time]`."""
        if self.has_impulses_within:
            return {"theta": self.theta}
        return {"beta": self.beta, "gamma": self.gamma} if self.name == "newmark" else {}

    @property
    def changes_energy(self) -> bool:
        """Whether stable steps change the energy by themselves.

        θ or γ above 1/2 take energy (numerical damping). With γ = 1/2 and β above 1/4 it comes
        back: what stays constant without damping is the energy with (β - 1/4) Δt² aᵀ M a / 2.

        Source: T. J. R. Hughes, The Finite Element Method (1987), section 9.2.
        """
        if self.has_impulses_within:
            return self.theta > 0.5
        return self.gamma > 0.5 or self.beta > 0.5 * self.gamma

    @property
    def has_impulses_within(self) -> bool:
        """Whether impulses act within a step instead of between two steps."""
        return self.name == "moreau-jean"

    @property
    def courant(self) -> float:
        """The largest stable ω Δt without damping, 1/√(γ/2 - β); infinite if every step is stable.

        Source: T. J. R. Hughes, The Finite Element Method (1987), section 9.1.
        """
        room = 0.5 * self.gamma - self.beta
        return 1.0 / math.sqrt(room) if room > 0.0 and not self.has_impulses_within else math.inf


SCHEMES: Mapping[str, Scheme] = MappingProxyType(
    {
        "newmark": Scheme("newmark"),
        "central-difference": Scheme("central-difference", beta=0.0),
        "moreau-jean": Scheme("moreau-jean"),
    }
)
"""Schemes by their names in case files: average acceleration (β = 1/4), β = 0, and θ = 1/2."""


LawName = Literal["none", "newton", "newton-penalty", "penalty"]
Impulse = Literal["lumped", "consistent"]


class ContactLaw(Protocol):
    """The interface that an engine needs of a contact law: `Law`, or a class of your own.

    The PETSc engine accepts any law. The compiled engine accepts only the laws of the table.
    """

    @property
    def name(self) -> str:
        """The law's name in messages."""

    @property
    def spring(self) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N s/m] of a resting pair's spring; (0, 0): no spring."""

    @property
    def is_coupled(self) -> bool:
        """Whether impulses act through the mass matrix of the scheme, not through nodal masses."""

    def supervisor(self, scheme: Scheme, setting: LawContext) -> Supervisor:
        """Set the law up for a problem.

        Raises:
            ValueError: the law does not go with the scheme.
        """


@dataclass(frozen=True)
class Law:
    """A contact law of the table with its parameters; a law ignores parameters it does not need.

    A parameter that no law can have is refused with a CaseError.

    Attributes:
        name: the law's name in case files.
        restitution: e [-].
        impulse: "lumped": impulses act on the hit nodes alone; "consistent": through the mass
            matrix.
        penalty_stiffness: k_con of a pair's spring [N/m].
        penalty_damping: c of a pair's spring [N s/m].
        threshold_velocity: γ [m/s]. Newmark: pairs that leave slower than γ get a spring.
            Moreau–Jean: pairs that approach slower than γ are reported as resting.
    """

    name: LawName
    restitution: float = 0.0
    impulse: Impulse = "consistent"
    penalty_stiffness: float = 0.0
    penalty_damping: float = 0.0
    threshold_velocity: float = 0.0

    def __post_init__(self) -> None:
        """Refuse an unknown name, and parameters out of range."""
        require(self.name in LAWS, "law", f"one of {', '.join(LAWS)}", self.name)
        kinds = get_args(Impulse)
        require(self.impulse in kinds, "impulse", f"one of {', '.join(kinds)}", self.impulse)
        require_number("restitution", self.restitution, most=1.0)
        for key in ("penalty_stiffness", "penalty_damping", "threshold_velocity"):
            require_number(key, getattr(self, key))

    @property
    def spring(self) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N s/m] of a resting pair's spring; (0, 0): no spring."""
        reads = LAWS[self.name].spring
        stiffness = self.penalty_stiffness if "penalty_stiffness" in reads else 0.0
        damping = self.penalty_damping if "penalty_damping" in reads else 0.0
        return stiffness, damping

    @property
    def is_coupled(self) -> bool:
        """Whether impulses act through the mass matrix of the scheme, not through nodal masses."""
        return self.impulse == "consistent"

    def supervisor(self, scheme: Scheme, setting: LawContext) -> Supervisor:
        """Set the law up for a problem.

        Raises:
            ValueError: the law does not go with the scheme.
        """
        # imported here, so that reading a case needs no compiler
        from delam_fem.contact.rules import Rules

        return Rules(self.numbers(scheme, setting.pair_numbers), setting)

    def numbers(self, scheme: Scheme, pair_numbers: PairNumbers | None = None) -> LawNumbers:
        """Return the numbers of the law with a scheme that decisions and springs need.

        Args:
            scheme: the scheme.
            pair_numbers: numbers that pairs have of their own; None: all follow the law.

        Raises:
            ValueError: the law, or an elastic pair, does not go with the scheme.
        """
        row = combination(self.name, scheme.name)
        is_coupled = self.is_coupled or row.kind == MOREAU
        slow = self.threshold_velocity if "threshold_velocity" in row.reads else -math.inf
        stiffness, damping = self.spring
        # whole numbers would be compiled for once more
        law = LawNumbers(
            row.kind,
            is_coupled,
            float(self.restitution),
            float(stiffness),
            float(damping),
            float(slow),
        )
        if pair_numbers is None or row.kind == NONE or not pair_numbers.is_elastic.size:
            return law
        return self._with_pairs(law, pair_numbers)

    def _with_pairs(self, law: LawNumbers, pair_numbers: PairNumbers) -> LawNumbers:
        """Return the numbers of a law with those of its pairs, where they are not all alike."""
        is_elastic = pair_numbers.is_elastic | (law.kind == PENALTY)
        if law.kind == MOREAU and is_elastic.any():
            raise ValueError(ELASTIC_WITHIN)
        if is_elastic.all():
            law = law._replace(kind=PENALTY)
        if is_elastic.any():
            law = law._replace(stiffness=float(self.penalty_stiffness))
        relaxation = pair_numbers.relaxation
        own_damping = law.stiffness * np.where(np.isnan(relaxation), 0.0, relaxation)
        table = np.zeros((is_elastic.size, N_OF_PAIR))
        table[:, IS_ELASTIC] = is_elastic
        is_own = ~is_elastic & ~np.isnan(pair_numbers.restitution)
        table[:, RESTITUTION] = np.where(is_own, pair_numbers.restitution, law.restitution)
        table[:, DAMPING] = np.where(
            is_elastic, np.where(np.isnan(relaxation), self.penalty_damping, own_damping), 0.0
        )
        is_own = ~is_elastic & ~np.isnan(pair_numbers.threshold) & (law.threshold > -math.inf)
        table[:, THRESHOLD] = np.where(is_own, pair_numbers.threshold, law.threshold)
        if (table == table[0]).all():
            _, restitution, damping, threshold = table[0].tolist()
            return law._replace(restitution=restitution, damping=damping, threshold=threshold)
        return law._replace(differ=True, of_pairs=table.ravel())


@dataclass(frozen=True)
class LawRow:
    """The properties of a law that do not depend on the case.

    Attributes:
        meaning: what happens at a closed pair.
        spring: names of the `Law` attributes that its contact springs use.
    """

    meaning: str
    spring: tuple[str, ...] = ()


LAWS: Mapping[str, LawRow] = MappingProxyType(
    {
        "none": LawRow("nothing: the laminae pass through one another"),
        "newton": LawRow("Newton's impact law: the pair leaves with -e times its gap rate"),
        "newton-penalty": LawRow(
            "Newton's impact law, and a spring while a pair that left slowly stays closed",
            ("penalty_stiffness",),
        ),
        "penalty": LawRow(
            "a spring and a damper while the gap is closed",
            ("penalty_stiffness", "penalty_damping"),
        ),
    }
)
"""The laws by their names in case files."""


@dataclass(frozen=True)
class Combination:
    """A law together with a scheme.

    Attributes:
        kind: kind of its decisions: NONE, IMPACTS, PENALTY or MOREAU (`rules.py`).
        reads: keys of the section `[contact]` that have an effect.
    """

    kind: int
    reads: tuple[str, ...] = ()


_NONE = Combination(NONE)
_NEWTON = Combination(IMPACTS, ("restitution", "impulse"))
_STEP_NEWTON = Combination(MOREAU, ("restitution", "threshold_velocity"))
_NEWTON_PENALTY = Combination(
    IMPACTS, ("restitution", "impulse", "penalty_stiffness", "threshold_velocity")
)
_PENALTY = Combination(PENALTY, ("penalty_stiffness", "penalty_damping"))

COMBINATIONS: Mapping[tuple[str, str], Combination] = MappingProxyType(
    {
        ("none", "newmark"): _NONE,
        ("none", "central-difference"): _NONE,
        ("none", "moreau-jean"): _NONE,
        ("newton", "newmark"): _NEWTON,
        ("newton", "central-difference"): _NEWTON,
        ("newton", "moreau-jean"): _STEP_NEWTON,
        ("newton-penalty", "newmark"): _NEWTON_PENALTY,
        ("newton-penalty", "central-difference"): _NEWTON_PENALTY,
        ("penalty", "newmark"): _PENALTY,
        ("penalty", "central-difference"): _PENALTY,
    }
)
"""All pairs (law, scheme) that go together."""


def combination(law: str, scheme: str) -> Combination:
    """Return the combination of a law and a scheme.

    Raises:
        ValueError: the law does not go with the scheme; the message names schemes that fit.
    """
    if (law, scheme) not in COMBINATIONS:
        fitting = [name for name in SCHEMES if (law, name) in COMBINATIONS]
        words = " or ".join(f'"{name}"' for name in fitting)
        raise ValueError(
            f'the law "{law}" goes with the scheme {words}, given "{scheme}"; for example '
            f"{combined_name(law, fitting[0])}"
        )
    return COMBINATIONS[law, scheme]


def combined_name(law: str, scheme: str) -> str:
    """Return the name of a law with a scheme in tables and sweeps, such as `newton@moreau-jean`."""
    return f"{law}@{scheme}"

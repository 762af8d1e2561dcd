"""Keys of a case whose values are not known: those that are sought, and those that only disturb."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.model.beams.network import network
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError

EVERY = "lamina.*."
"""Start of a key that stands for the same key of all laminae."""
STIFFNESS = (0.9, 1.1)
"""Multiples of the stiffness of the laminae that a rig may have."""
DAMPING = (0.5, 2.0)
"""Multiples of the damping ratio that a rig may have."""
CLAMP = (50.0, 5000.0)
"""Rotational stiffness of clamps that a rig may have, times L/EI."""


@dataclass(frozen=True)
class Unknown:
    """A key whose value is not known.

    Attributes:
        key: key of the case; `lamina.*.KEY` is KEY of all laminae.
        low: lowest value.
        high: highest value.
        is_relative: whether these are multiples of the values that the case has.
    """

    key: str
    low: float
    high: float
    is_relative: bool = False

    @classmethod
    def parse(cls, text: str) -> Unknown:
        """Return the unknown of a text such as "gap.exponent=1:3" or "lamina.thin.width=0.9x:1.1x".

        Raises:
            CaseError: the text has another form, or its values do not rise.
        """
        key, _, bounds = text.partition("=")
        parts = bounds.split(":")
        is_relative = all(part.endswith("x") for part in parts)
        try:
            low, high = (float(part.removesuffix("x") if is_relative else part) for part in parts)
        except ValueError:
            low = high = math.nan
        if not key or not low < high:
            raise CaseError(f"unknown: expected KEY=LOW:HIGH with LOW below HIGH, given {text!r}")
        return cls(key, low, high, is_relative)

    def keys(self, case: Case) -> tuple[str, ...]:
        """Return the keys of the case that have the value."""
        if not self.key.startswith(EVERY):
            return (self.key,)
        last = self.key.removeprefix(EVERY)
        return tuple(f"lamina.{lamina.name}.{last}" for lamina in case.lamina)


def require_values(unknowns: Sequence[Unknown]) -> None:
    """Refuse multiples of the values of a case, which only what is uncertain may have."""
    for own in unknowns:
        if own.is_relative:
            raise CaseError(
                f"unknown: {own.key}: expected values of the key, given multiples of its own; "
                "only --uncertain takes them"
            )


def value_of(case: Case, key: str) -> float:
    """Return a number of a case by its key; NaN if it has none."""
    found: object = case
    for part in key.split("."):
        if isinstance(found, tuple):
            found = next(entry for entry in found if entry.name == part)
        else:
            found = getattr(found, part, None)
    return float(found) if isinstance(found, int | float) else math.nan


def drawn(unknowns: Sequence[Unknown], case: Case, n: int, seed: int) -> dict[str, FloatArray]:
    """Return n values of each key, equally likely on a logarithmic scale.

    Raises:
        CaseError: a lowest value is not above 0.
    """
    rng, found = np.random.default_rng(seed), {}
    for own in unknowns:
        if not own.low > 0.0:
            raise CaseError(f"uncertain: {own.key}: expected values above 0, given {own.low:g}")
        values = own.low * (own.high / own.low) ** rng.uniform(size=n)
        for key in own.keys(case):
            found[key] = values * (value_of(case, key) if own.is_relative else 1.0)
    return found


def of_rig(case: Case) -> tuple[Unknown, ...]:
    """Return in what a rig usually differs from its case: stiffness, damping, clamps that yield."""
    given = any(lamina.bending_stiffness is not None for lamina in case.lamina)
    modulus = "bending_stiffness" if given else "young_modulus"
    found = [
        Unknown(f"{EVERY}{modulus}", *STIFFNESS, is_relative=True),
        Unknown(f"{EVERY}damping_ratio", *DAMPING, is_relative=True),
    ]
    if not case.is_apart and "clamped" in (case.support.start, case.support.end):
        whole = network(case, np.array([0.0, case.length])).section(tuple(range(len(case.lamina))))
        low, high = (factor * whole[0] / case.length for factor in CLAMP)
        found.append(Unknown("support.rotational_stiffness", low, high))
    return tuple(found)

"""Say which keys of a case are sought, and in which a rig may differ from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delam_fem.api import Case, CaseError, FloatArray, network, require

EVERY = "lamina.*."
"""Start of a key that stands for the same key of all laminae."""
STIFFNESS = (0.9, 1.1)
"""Multiples of the stiffness of the laminae that a rig may have."""
DAMPING = (0.5, 2.0)
"""Multiples of the damping ratio that a rig may have."""
CLAMP = (50.0, 5000.0)
"""Rotational stiffness that the clamps of a rig may have, in units of EI/L."""


@dataclass(frozen=True)
class Unknown:
    """A key whose value is not known, with its range.

    Attributes:
        key: key of the case; `lamina.*.KEY` is KEY of all laminae.
        low: lowest value.
        high: highest value.
        is_relative: whether low and high are multiples of the value that the case has.
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
        require(bool(key) and low < high, "unknown", "KEY=LOW:HIGH with LOW below HIGH", text)
        return cls(key, low, high, is_relative)

    def keys(self, case: Case) -> tuple[str, ...]:
        """Return the keys of a case that have this value, one or one for each lamina."""
        if not self.key.startswith(EVERY):
            return (self.key,)
        return tuple(self.key.replace("*", lamina.name, 1) for lamina in case.lamina)


def require_values(unknowns: Sequence[Unknown]) -> None:
    """Raise a CaseError if a sought key is given by multiples of the value of the case."""
    for unknown in unknowns:
        if unknown.is_relative:
            raise CaseError(
                f"unknown: {unknown.key}: expected values of the key, given multiples of its own; "
                "only --uncertain takes them"
            )


def value_of(case: Case, key: str) -> float:
    """Return the number of a case at a key; NaN where there is none."""
    value: object = case
    for part in key.split("."):
        if isinstance(value, tuple):
            numbered = enumerate(value, start=1)
            value = next(
                (e for n, e in numbered if part in (str(n), getattr(e, "name", None))), None
            )
        else:
            value = getattr(value, part, None)
    return float(value) if isinstance(value, int | float) else math.nan


def drawn(unknowns: Sequence[Unknown], case: Case, n: int, seed: int) -> dict[str, FloatArray]:
    """Return n values of each key, equally likely on a logarithmic scale.

    Raises:
        CaseError: a lowest value is not above 0.
    """
    rng = np.random.default_rng(seed)
    samples = {}
    for unknown in unknowns:
        if not unknown.low > 0.0:
            raise CaseError(
                f"uncertain: {unknown.key}: expected values above 0, given {unknown.low:g}"
            )
        values = unknown.low * (unknown.high / unknown.low) ** rng.uniform(size=n)
        for key in unknown.keys(case):
            samples[key] = values * (value_of(case, key) if unknown.is_relative else 1.0)
    return samples


def uncertain_keys(case: Case, given: Sequence[str] | None) -> tuple[Unknown, ...]:
    """Return the keys in which a rig may differ from its case: the given ones, or `of_rig`."""
    return of_rig(case) if given is None else tuple(map(Unknown.parse, given))


def of_rig(case: Case) -> tuple[Unknown, ...]:
    """Return the keys in which a rig usually differs from its case: stiffness, damping, clamps."""
    has_stiffness = any(lamina.bending_stiffness is not None for lamina in case.lamina)
    modulus = "bending_stiffness" if has_stiffness else "young_modulus"
    unknowns = [
        Unknown(f"{EVERY}{modulus}", *STIFFNESS, is_relative=True),
        Unknown(f"{EVERY}damping_ratio", *DAMPING, is_relative=True),
    ]
    is_clamped = "clamped" in (case.support.kind("start"), case.support.kind("end"))
    if not case.is_apart and is_clamped:
        section = network(case, np.array([0.0, case.length])).section(
            tuple(range(len(case.lamina)))
        )
        low, high = (factor * section[0] / case.length for factor in CLAMP)
        unknowns.append(Unknown("support.rotational_stiffness", low, high))
    return tuple(unknowns)

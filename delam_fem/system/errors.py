"""The error that tells a user what is wrong with the input."""

from __future__ import annotations

import math


class CaseError(ValueError):
    """Report bad input; the message names the key, what was expected and what was given."""


def reason_of(error: Exception) -> str:
    """Return the first line of a foreign error, shortened; its type if it has no text."""
    return str(error).splitlines()[0][:80] if str(error) else type(error).__name__


def require(is_met: bool, key: str, expected: str, given: object) -> None:
    """Raise a CaseError that names key, expected and given unless a condition is met."""
    if not is_met:
        raise CaseError(f"{key}: expected {expected}, given {given!r}")


def require_number(key: str, given: float, *, least: float = 0.0, most: float = math.inf) -> None:
    """Raise a CaseError unless a number is finite, at least `least` and at most `most`."""
    to = f" to {most:g}" if most < math.inf else " or more"
    require(
        math.isfinite(given) and least <= given <= most, key, f"a number from {least:g}{to}", given
    )

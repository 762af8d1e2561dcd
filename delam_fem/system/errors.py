"""The error that tells a user what is wrong with the input."""

from __future__ import annotations

import math
import re
from pathlib import Path


class CaseError(ValueError):
    """Report bad input; the message names the key, what was expected and what was given."""


_ADDRESS = re.compile(r"(?<![\w/])/[\w.+-]++(?:/[\w.+-]++)++")
"""The address of a file."""


def reason_of(error: Exception, path: Path | None = None) -> str:
    """Return the first line of a foreign error, shortened; its type if it has no text.

    Args:
        error: the error.
        path: the file that is read, whose address, and that of others, is left out; None: all of
            the text is told.
    """
    text = str(error)
    if path is not None:
        text = text.replace(str(path.resolve()), "the file").replace(str(path), "the file")
        text = _ADDRESS.sub("a file", text)
    return text.splitlines()[0][:80] if text.strip() else type(error).__name__


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

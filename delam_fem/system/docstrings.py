"""Read docstrings: the first line says what a class is, the rows of `Attributes` its fields."""

from __future__ import annotations

import inspect
import re

_ROW = re.compile(r"^ {4}(\w+): (.*(?:\n {5,}.*)*)", re.MULTILINE)
"""A row of `Attributes` in a docstring: name, and meaning with its further lines."""


def summary(described: type) -> str:
    """Return the first line of the docstring of a class."""
    return " ".join((inspect.getdoc(described) or "").partition("\n")[0].split())


def meanings(described: type) -> dict[str, str]:
    """Return the rows of `Attributes` in the docstrings of a class and of those it extends."""
    found: dict[str, str] = {}
    for base in reversed(described.__mro__):
        _, _, rows = (inspect.cleandoc(base.__doc__ or "")).partition("\nAttributes:\n")
        found |= {name: " ".join(text.split()) for name, text in _ROW.findall(rows)}
    return found

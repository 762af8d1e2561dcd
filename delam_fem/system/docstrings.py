"""Read docstrings: the first line says what a class is, the rows of `Attributes` its fields.

Where Python has stripped them (`python -OO`, `PYTHONOPTIMIZE=2`), they are read from the sources.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
from textwrap import dedent

_ROW = re.compile(r"^ {4}(\w+): (.*(?:\n {5,}.*)*)", re.MULTILINE)
"""A row of `Attributes` in a docstring: name, and meaning with its further lines."""


def docstring(described: type) -> str:
    """Return the docstring of a class without indentation; "" if it has none."""
    if sys.flags.optimize < 2 or described.__module__ == "builtins":
        return inspect.cleandoc(described.__doc__ or "")
    (definition,) = ast.parse(dedent(inspect.getsource(described))).body
    return (ast.get_docstring(definition) or "") if isinstance(definition, ast.ClassDef) else ""


def summary(described: type) -> str:
    """Return the first line of the docstring of a class."""
    return " ".join(docstring(described).partition("\n")[0].split())


def meanings(described: type) -> dict[str, str]:
    """Return the rows of `Attributes` in the docstrings of a class and of those it extends."""
    texts: dict[str, str] = {}
    for base in reversed(described.__mro__):
        _, _, rows = docstring(base).partition("\nAttributes:\n")
        texts |= {name: " ".join(text.split()) for name, text in _ROW.findall(rows)}
    return texts

"""The options of all commands, as scripts of users name them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from inspect import Parameter, signature
from typing import Any, get_type_hints

import pytest

from delam_fem.cli.app import commands

pytestmark = pytest.mark.usefixtures("elsewhere")


def options_of(name: str, command: Callable[..., None]) -> Iterator[str]:
    """Yield the options of a command: names, limits, default."""
    hints = get_type_hints(command, include_extras=True)
    for argument, parameter in signature(command).parameters.items():
        about: Any = (
            hints[argument].__metadata__[0] if hasattr(hints[argument], "__metadata__") else None
        )
        details = {"default": parameter.default} if parameter.default is not Parameter.empty else {}
        for detail in ("param_decls", "min", "max", "metavar"):
            details[detail] = getattr(about, detail, None)
        words = [f"{key} {value}" for key, value in details.items() if value not in (None, ())]
        yield f"{name} {argument}: {', '.join(words)}"


def test_options_are_the_stored_ones(stored: Callable[[str], None]) -> None:
    functions = dict(item for group in commands().values() for item in group.items())
    stored(
        "\n".join(line for name in sorted(functions) for line in options_of(name, functions[name]))
    )

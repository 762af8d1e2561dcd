"""What commands take, and what they say of cases, beside what is stored."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, get_type_hints

import golden
import pytest
from kit import SWEEP, invoke

from delam_fem.cli.app import GROUPS

pytestmark = pytest.mark.usefixtures("elsewhere")


def options_of(name: str, command: Callable[..., None]) -> Iterator[str]:
    """Yield the options of a command: names, limits, default, meaning."""
    hints = get_type_hints(command, include_extras=True)
    for own, parameter in signature(command).parameters.items():
        about: Any = hints[own].__metadata__[0] if hasattr(hints[own], "__metadata__") else None
        told = {"default": parameter.default} if parameter.default is not Parameter.empty else {}
        for what in ("param_decls", "min", "max", "metavar", "help"):
            told[what] = getattr(about, what, None)
        words = [f"{what} {value}" for what, value in told.items() if value not in (None, ())]
        yield f"{name} {own}: {', '.join(words)}"


def test_options_are_the_stored_ones(stored: Callable[..., None]) -> None:
    commands = {name: own for group in GROUPS.values() for name, own in group.items()}
    stored("\n".join(line for one in commands.items() for line in options_of(*one)))


@pytest.mark.parametrize("name", ["paper", "default", "embedded", "sweep.toml"])
def test_a_check_says_what_is_stored(name: str, stored: Callable[..., None]) -> None:
    Path("sweep.toml").write_text(SWEEP, "utf-8")
    stored(golden.spoken(invoke("check", name).output))


def test_a_reduction_says_what_is_stored(stored: Callable[..., None]) -> None:
    few = ("--set", "mesh.elements=6", "--set", "contact.impulse=consistent", "--modes", "4")
    stored(golden.spoken(invoke("reduce", "paper", *few, "-o", "out").output))

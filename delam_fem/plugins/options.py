"""Options of the studies, for Python and for the command line; nothing heavy is imported here.

A class holds the options of one command. Its docstring is the help of the command, and the rows of
`Attributes` are the help of the options.
"""

from __future__ import annotations

import math
import types
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_args, get_origin, get_type_hints

from delam_fem.system.errors import CaseError

O = TypeVar("O", bound="Options")  # noqa: E741


@dataclass(frozen=True)
class Flag:
    """How the command line spells an option, and which values it takes.

    Attributes:
        names: such as "-n" and "--number"; none: the name of the field with dashes.
        metavar: what stands for the value; None: the unit of the field, or its type.
        least, most: bounds of a number.
        is_joined: whether several values stand in one text with commas between them; otherwise
            the option is repeated.
        is_argument: whether the value stands behind the case, without a name.
        kind: type of a value, read from the field: float, int, str, Path or a `Literal`.
        is_several: whether the field takes several values.
    """

    names: tuple[str, ...] = ()
    metavar: str | None = None
    least: float = -math.inf
    most: float = math.inf
    is_joined: bool = False
    is_argument: bool = False
    kind: Any = str
    is_several: bool = False

    def checked(self, name: str, value: Any) -> Any:
        """Check a value of an option and return it in the type of its field, also from a text.

        Raises:
            CaseError: the value is not allowed.
        """
        if self.is_several:
            parts = value.split(",") if isinstance(value, str) else value
            return tuple(replace(self, is_several=False).checked(name, part) for part in parts)
        if isinstance(value, str | Path) and self.kind in (int, float, str, Path):
            with suppress(ValueError):
                value = self.kind(str(value).strip())
        expected = f"one of {', '.join(map(str, get_args(self.kind)))}"
        choices = get_args(self.kind)
        fits = value in choices or not choices
        if self.kind in (int, float):
            fits = isinstance(value, int if self.kind is int else int | float)
            fits = fits and self.least <= value <= self.most
            expected = f"a {'whole ' * (self.kind is int)}number"
            if math.isfinite(self.least):
                upper = f" and at most {self.most:g}" if math.isfinite(self.most) else ""
                expected += f" of at least {self.least:g}{upper}"
        if not fits:
            between = " (several: with commas between them)" if self.is_joined else ""
            raise CaseError(f"{name}: expected {expected}{between}, given {value!r}")
        return value


@dataclass(frozen=True, kw_only=True)
class Options:
    """Choices of a user, checked when they are made."""

    common: ClassVar[tuple[str, ...]] = ("resume", "overwrite")
    """Options that a command has besides its own; without any, it writes over earlier results."""

    def __post_init__(self) -> None:
        """Check each value that is given."""
        for name, flag in flags_of(type(self)).items():
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, flag.checked(name, value))

    @property
    def inputs(self) -> list[Path]:
        """Files of the user that are read."""
        files: Any = getattr(self, "measured", None) or ()
        positions: Path | None = getattr(self, "positions", None)
        measured = [files] if isinstance(files, Path) else list(files)
        return measured if positions is None else [*measured, positions]

    def part(self, kind: type[O]) -> O:
        """Return the options that belong to a class which this one extends."""
        return kind(**{field.name: getattr(self, field.name) for field in fields(kind)})


def flags_of(kind: type[Options]) -> dict[str, Flag]:
    """Return how each option of a class is spelt and what it takes."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: _flag(hints[field.name]) for field in fields(kind)}


def _flag(hint: Any) -> Flag:
    """Return the flag of a field with a type, which may be optional."""
    flag: Flag
    kind, flag = get_args(hint) if get_origin(hint) is Annotated else (hint, Flag())
    if isinstance(kind, types.UnionType):
        kind = get_args(kind)[0]
    if get_origin(kind) is tuple:
        return replace(flag, kind=get_args(kind)[0], is_several=True)
    return replace(flag, kind=kind)

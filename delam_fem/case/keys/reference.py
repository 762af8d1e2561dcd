"""List every key of a case file with its type, unit, default and meaning, read from the models.

The models of `sections.py` and its neighbours are the only source: types and defaults are those of
their fields, units and meanings those of the `Attributes` in their docstrings. Commented case files
and pages of documentation are written from this list.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic_core import PydanticUndefined

from delam_fem.case.definition import Case
from delam_fem.case.fields import Expected, Section

_ROW = re.compile(r"^ {4}(\w+): (.*(?:\n {5,}.*)*)", re.MULTILINE)
"""A row of `Attributes` in a docstring: name, and meaning with its further lines."""
_UNIT = re.compile(r"\[([^\]]+)\]")
_PLAIN = {str: "text", float: "a number", int: "a whole number", bool: "true or false"}


@dataclass(frozen=True)
class Key:
    """One key of a table.

    Attributes:
        name: the key.
        type: what it takes, in words: "a positive number".
        choices: the words that it takes; () if it takes others.
        unit: "m", "kg/m3", …; "-" of a pure number; "" of what is no number.
        is_required: whether it must be given.
        default: its value where it is not given; None: none.
        meaning: what it is, with its unit in brackets as in "length of a lamina [m]".
    """

    name: str
    type: str
    choices: tuple[str, ...]
    unit: str
    is_required: bool
    default: Any
    meaning: str


@dataclass(frozen=True)
class Table:
    """A table of a case file with its keys.

    Attributes:
        name: "gap" for `[gap]`; "" for the keys before the first table.
        kind: value of the key `kind` of an excitation; "" of other tables.
        is_array: whether it is written `[[name]]` and may be repeated.
        is_required: whether a case must have it.
        meaning: what it is, in a sentence.
        keys: its keys in the order of the model.
        model: the model that checks it.
    """

    name: str
    kind: str
    is_array: bool
    is_required: bool
    meaning: str
    keys: tuple[Key, ...]
    model: type[Section]

    @property
    def heading(self) -> str:
        """The heading in a case file: `[gap]`, `[[lamina]]`; "" for the first keys."""
        return f"[[{self.name}]]" if self.is_array else f"[{self.name}]" if self.name else ""


def tables() -> tuple[Table, ...]:
    """Return all tables of a case file in their order; the first has the keys before any table."""
    fields = Case.model_fields
    below = {name: tuple(_models(field.annotation)) for name, field in fields.items()}
    plain = [name for name, models in below.items() if not models]
    found = [_table(Case, "", plain, is_required=True)]
    for name, models in below.items():
        found += [
            _table(
                model,
                name,
                sorted([*model.model_fields, *model.also_written], key=lambda key: key != "kind"),
                is_array=_is_array(fields[name].annotation),
                is_required=fields[name].is_required(),
            )
            for model in models
        ]
    return tuple(found)


def _table(
    model: type[Section],
    name: str,
    keys: list[str],
    *,
    is_required: bool,
    is_array: bool = False,
) -> Table:
    """Return a table with some keys of its model."""
    kind = model.model_fields.get("kind")
    own = tuple(_key(model, key, _meanings(model)) for key in keys)
    meaning = " ".join((inspect.getdoc(model) or "").partition("\n")[0].split())
    return Table(
        name, "" if kind is None else kind.default, is_array, is_required, meaning, own, model
    )


def _key(model: type[Section], name: str, meanings: dict[str, str]) -> Key:
    """Return a key of a model; one that is only written is a positive number."""
    meaning = meanings.get(name, "")
    found = _UNIT.search(meaning)
    if name not in model.model_fields:
        return Key(name, "a positive number", (), found[1] if found else "-", False, None, meaning)
    field = model.model_fields[name]
    annotation: Any = field.annotation
    words = next((m.words for m in field.metadata if isinstance(m, Expected)), "")
    is_required = field.is_required() or name == "kind"  # the kind says which table it is
    default = None if is_required or field.default is PydanticUndefined else field.default
    unit = (found[1] if found else "-") if _is_number(annotation) else ""
    choices = tuple(_choices(annotation))
    type_ = words or _type(annotation, choices)
    return Key(name, type_, choices, unit, is_required, default, meaning)


def _meanings(model: type[Section]) -> dict[str, str]:
    """Return the rows of `Attributes` in the docstrings of a model and of those it extends."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        _, _, rows = (inspect.cleandoc(base.__doc__ or "")).partition("\nAttributes:\n")
        found |= {name: " ".join(text.split()) for name, text in _ROW.findall(rows)}
    return found


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield the members of a union, of an array and of what is annotated; otherwise the type."""
    origin = get_origin(annotation)
    if origin is Annotated:
        yield from _parts(get_args(annotation)[0])
    elif origin in (Union, UnionType, tuple):
        for part in get_args(annotation):
            if part not in (type(None), Ellipsis):
                yield from _parts(part)
    else:
        yield annotation


def _models(annotation: Any) -> Iterator[type[Section]]:
    """Yield the models of tables in the type of a field."""
    for part in _parts(annotation):
        if isinstance(part, type) and issubclass(part, Section):
            yield part


def _is_array(annotation: Any) -> bool:
    """Return whether the type of a field is an array of tables."""
    origin = get_origin(annotation)
    return origin is tuple or (origin is Annotated and _is_array(get_args(annotation)[0]))


def _is_number(annotation: Any) -> bool:
    """Return whether a key takes numbers."""
    return any(part in (int, float) for part in _parts(annotation))


def _choices(annotation: Any) -> Iterator[str]:
    """Yield the words of a `Literal` in the type of a field."""
    for part in _parts(annotation):
        if get_origin(part) is Literal:
            yield from map(str, get_args(part))


def _type(annotation: Any, choices: tuple[str, ...]) -> str:
    """Return in words what a key takes."""
    if choices:
        *first, last = (f'"{choice}"' for choice in choices)
        return f"{', '.join(first)} or {last}" if first else last
    for part in (annotation, *get_args(annotation)):
        for note in getattr(part, "__metadata__", ()):
            if isinstance(note, Expected):
                return note.words
    return next((_PLAIN[part] for part in _parts(annotation) if part in _PLAIN), "a value")

"""The list of all keys and the commented templates, beside what is stored."""

from __future__ import annotations

from collections.abc import Callable

from delam_fem.case.keys import KINDS, case_text, tables


def test_all_keys_are_the_stored_ones(stored: Callable[..., None]) -> None:
    told = []
    for own in tables():
        told.append(f"{own.heading} {own.kind!r} {own.is_array} {own.meaning}")
        told += [
            f"  {key.name}: {key.type} {key.choices} {key.unit!r} {key.is_required} "
            f"{key.default!r} {key.has_unit}: {key.meaning}"
            for key in own.keys
        ]
    stored("\n".join(told))


def test_templates_are_the_stored_ones(stored: Callable[..., None]) -> None:
    """The first in full, of the others what is unlike it."""
    first, *others = (case_text(kind, "mine").splitlines() for kind in KINDS)
    stored("\n".join(first), f"-{KINDS[0]}")
    assert max(map(len, first)) <= 100
    for kind, lines in zip(KINDS[1:], others, strict=True):
        own = [line for line in lines if line not in first]
        stored(
            "\n".join([*own, "without", *(line for line in first if line not in lines)]), f"-{kind}"
        )

"""The list of all keys and the commented templates, as others read them."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from delam_fem.api import tables
from delam_fem.case.keys import KINDS, case_text


def test_all_keys_are_the_stored_ones(stored: Callable[[str], None]) -> None:
    lines = []
    for table in tables():
        lines.append(f"{table.heading} {table.kind!r} {table.is_array}")
        lines += [
            f"  {key.name}: {key.type} {key.choices} {key.unit!r} {key.is_required} {key.has_unit}"
            for key in table.keys
        ]
    stored("\n".join(lines))


def test_the_template_has_the_stored_lines(stored: Callable[[str], None]) -> None:
    """Tables and keys with their values; what the comments say is not stored."""
    lines = case_text(KINDS[0], "mine").splitlines()
    stored("\n".join(filter(None, map(without_comment, lines))))


@pytest.mark.parametrize("kind", KINDS)
def test_lines_of_templates_fit_a_screen(kind: str) -> None:
    assert max(map(len, case_text(kind, "mine").splitlines())) <= 100


def without_comment(line: str) -> str:
    """Return the heading of a table, or a key and its value, also where # stands before it."""
    match = re.match(r"(# )?(\[+\w[\w.]*\]+|\w+ =[^#]*)", line)
    return match.group().rstrip() if match else ""

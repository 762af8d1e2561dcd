"""The commented templates, as others read them."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from delam_fem.case.keys import KINDS, case_text


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

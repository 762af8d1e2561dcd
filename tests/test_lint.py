"""Variables are named for what they hold, and a line makes one statement: no rule of ruff."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from project import ROOT

PRONOUNS = {"own", "found", "given", "whole", "kept", "rest", "seen", "shown", "held"}
PROGRAMS = ("delam_fem", "scripts")
ALL_SOURCES = (*PROGRAMS, "tests", "docs/examples", "meshes")
MEMBERS = {
    "Memory.kept", "Memory.seen", "System.rest", "Unknowns.own", "Unknowns.held",
    "ObstacleMark.rest", "Ribbons.rest",
}  # fmt: skip
"""Members of classes that have such a name still."""


def pronouns(tree: ast.AST) -> Iterator[str]:
    """Yield the variables whose name is a pronoun or a participle; members with their class."""
    members = {
        id(statement.target): f"{node.name}.{statement.target.id}"
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        for statement in node.body
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in PRONOUNS:
            yield members.get(id(node), f"{node.id} in line {node.lineno}")


def kind(value: ast.expr) -> object:
    """Return what values have in common that may be assigned in one line; None: nothing."""
    match value:
        case ast.Constant(value=constant):
            return "number" if isinstance(constant, int | float) else type(constant)
        case ast.UnaryOp(operand=ast.Constant()):
            return "number"
        case ast.Attribute(value=owner) | ast.Subscript(value=owner):
            return type(value), ast.unparse(owner)
    return None


def reads(value: ast.expr, target: ast.expr) -> bool:
    """Return whether a value may read what a target is, so that the two belong to one statement."""
    names = {node.id for node in ast.walk(value) if isinstance(node, ast.Name)}
    names |= {node.attr for node in ast.walk(value) if isinstance(node, ast.Attribute)}
    if isinstance(target, ast.Name):
        return target.id in names
    is_called = any(isinstance(node, ast.Call) for node in ast.walk(value))
    written = {node.attr for node in ast.walk(target) if isinstance(node, ast.Attribute)}
    written |= {node.id for node in ast.walk(target) if isinstance(node, ast.Name)}
    return is_called or bool(written & names)


def is_unrelated(targets: Sequence[ast.expr], values: Sequence[ast.expr]) -> bool:
    """Return whether assignments in one line have nothing to do with one another."""
    kinds = {kind(value) for value in values}
    is_same = len(kinds) == 1 and None not in kinds
    later = [(i, j) for j in range(len(targets)) for i in range(j)]
    is_woven = any(
        reads(values[j], targets[i])
        or (not isinstance(targets[j], ast.Name) and reads(targets[j], targets[i]))
        for i, j in later
    )
    is_nested = any(isinstance(node, ast.Tuple | ast.List | ast.Starred) for node in targets)
    return not (is_same or is_woven or is_nested)


def joined(tree: ast.AST) -> Iterator[int]:
    """Yield the lines that join unrelated assignments."""
    for node in ast.walk(tree):
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=ast.Tuple(elts=values)):
                if len(targets) == len(values) and is_unrelated(targets, values):
                    yield node.lineno


def offenders(find: object, folders: Sequence[str]) -> list[str]:
    """Return the places that a search finds in all sources of some folders."""
    assert callable(find)
    return [
        f"{path.relative_to(ROOT)}: {offence}"
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        for offence in find(ast.parse(path.read_text(encoding="utf-8")))
    ]


def test_variables_are_nouns() -> None:
    names = [
        place for place in offenders(pronouns, ALL_SOURCES) if place.split(": ")[1] not in MEMBERS
    ]
    assert names == []


def test_unrelated_assignments_have_lines_of_their_own() -> None:
    assert offenders(joined, PROGRAMS) == []


@pytest.mark.parametrize(
    ("line", "is_joined"),
    [
        ("a, b = f(x), y + 1", True),
        ("a, b = b, a", False),
        ("x, y = 0.0, -1.0", False),
        ("a, b = case.law, case.mesh", False),
        ("a, b = pair", False),
        ("law, case.mesh = g(x), h(law)", False),
        ("a, name = 0.0, 'text'", True),
    ],
)
def test_what_belongs_together(line: str, is_joined: bool) -> None:
    assert bool(list(joined(ast.parse(line)))) == is_joined


def test_a_class_name_stands_for_one_thing() -> None:
    places: dict[str, list[str]] = {}
    for path in (ROOT / "delam_fem").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_pronouns_are_seen(tmp_path: Path) -> None:
    source = "own = 1\nfor found in x:\n    pass\n[kept for kept in y]\nrows = 2\n"
    assert len(list(pronouns(ast.parse(source)))) == 3

"""Move imports of the simulator's modules to its seam, `delam_fem.api`.

    .venv/bin/python scripts/to_seam.py delam_fem/studies delam_fem/paper scripts tests
    .venv/bin/ruff check --select I --fix . && .venv/bin/ruff format .

A name of the seam is imported from there. Names of a module that the seam has as a whole
(`style`, `html`, `settling`, …) are written as its attributes, unless the file uses the name of
the module for something else. Whatever is not in the seam stays as it is.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from delam_fem import api

PACKAGE = "delam_fem"
SEAM = f"{PACKAGE}.api"


class Edit(NamedTuple):
    """Bytes of a source that are replaced."""

    start: int
    end: int
    text: str


def homes() -> tuple[dict[str, str], dict[str, str]]:
    """Return full names in the seam, and those of whole modules, each with its name there."""
    names: dict[str, str] = {}
    modules: dict[str, str] = {}
    for name in dir(api):
        full = f"{PACKAGE}.{api.home_of(name)}.{name}"
        is_module = type(getattr(api, name)).__name__ == "module"
        (modules if is_module else names)[full] = name
    return names, modules


def rewritten(source: str, *, uses_modules: bool) -> str:
    """Return a source with its imports from the seam.

    Args:
        source: text of a module.
        uses_modules: whether names of whole modules become attributes.
    """
    names, modules = homes()
    tree = ast.parse(source)
    encoded = source.encode()
    starts = [0]
    for line in encoded.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = starts[node.lineno - 1] + node.col_offset
        return start, starts[node.end_lineno - 1] + node.end_col_offset

    bound = set(bound_names(tree))
    prefixed: dict[str, str] = {}
    edits: list[Edit] = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not node.module or node.level:
            continue
        if not node.module.startswith(f"{PACKAGE}.") or node.module == SEAM:
            continue
        stays: list[str] = []
        moves: set[str] = set()
        module = modules.get(node.module) if uses_modules else None
        for alias in node.names:
            full = f"{node.module}.{alias.name}"
            local = alias.asname or alias.name
            text = alias.name + (f" as {alias.asname}" if alias.asname else "")
            if full in names or full in modules:
                moves.add(text)
            elif module and module not in bound and local not in bound:
                moves.add(module)
                prefixed[local] = f"{module}.{alias.name}"
            else:
                stays.append(text)
        if not moves:
            continue
        indent = " " * node.col_offset
        lines = [f"from {SEAM} import {', '.join(sorted(moves))}"]
        if stays:
            lines.append(f"from {node.module} import {', '.join(stays)}")
        edits.append(Edit(*place(node), f"\n{indent}".join(lines)))
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and node.id in prefixed:
            edits.append(Edit(*place(node), prefixed[node.id]))
    for edit in sorted(edits, reverse=True):
        encoded = encoded[: edit.start] + edit.text.encode() + encoded[edit.end :]
    return encoded.decode()


def bound_names(tree: ast.Module) -> Iterator[str]:
    """Yield the names that a module binds, imports from the package excepted."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(ctx=ast.Store() | ast.Del()):
                yield node.id
            case ast.arg():
                yield node.arg
            case ast.FunctionDef() | ast.ClassDef():
                yield node.name
            case ast.ImportFrom(module=str(module)) if module.startswith(PACKAGE):
                pass
            case ast.Import() | ast.ImportFrom():
                yield from (alias.asname or alias.name for alias in node.names)


def main(folders: list[str]) -> None:
    """Rewrite the files of some folders."""
    for folder in folders:
        for path in sorted(Path(folder).rglob("*.py")):
            before = path.read_text(encoding="utf-8")
            after = rewritten(before, uses_modules=not folder.startswith("tests"))
            if after != before:
                path.write_text(after, encoding="utf-8")
                sys.stdout.write(f"{path}\n")


if __name__ == "__main__":
    main(sys.argv[1:])

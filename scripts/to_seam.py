"""Move imports of the simulator's modules to its seam, `delam_fem.api`.

    .venv/bin/python scripts/to_seam.py delam_fem/studies delam_fem/paper scripts tests
    .venv/bin/ruff check --select I,F401 --fix . && .venv/bin/ruff format .

A name of the seam is imported from there. Outside the package, what `delam_fem` itself offers is
imported from `delam_fem`. Names of a module that the seam has as a whole
(`style`, `html`, `settling`, …) are written as its attributes, unless the file uses the name of
the module for something else. Calls through a module of what a name of the seam stands for
(`STANDS_FOR`) become calls of that. Whatever is not in the seam stays as it is.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import delam_fem
from delam_fem import api

PACKAGE = "delam_fem"
SEAM = f"{PACKAGE}.api"
STANDS_FOR = {
    f"{PACKAGE}.model.beams.closed_form.assemble": ("assemble", "needs_dolfinx=False"),
    f"{PACKAGE}.model.discretise.assemble": ("assemble", ""),
}
"""What calls with one argument become: a name of the seam, and what its calls have besides."""


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


def rewritten(source: str, *, uses_modules: bool, is_outside: bool) -> str:
    """Return a source with its imports from the seam.

    Args:
        source: text of a module.
        uses_modules: whether names of whole modules become attributes.
        is_outside: whether the module is none of the package, and may import from `delam_fem`.
    """
    names, modules = homes()
    public = {
        f"{PACKAGE}.{home}.{name}": name
        for name, home in delam_fem._HOMES.items()
        if is_outside and f"{PACKAGE}.{home}.{name}" not in names
    }
    tree = ast.parse(source)
    place = places(source)
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
        of_package: set[str] = set()
        module = modules.get(node.module) if uses_modules else None
        for alias in node.names:
            full = f"{node.module}.{alias.name}"
            local = alias.asname or alias.name
            text = alias.name + (f" as {alias.asname}" if alias.asname else "")
            if full in names or full in modules:
                moves.add(text)
            elif full in public:
                of_package.add(text)
            elif module and module not in bound and local not in bound:
                moves.add(module)
                prefixed[local] = f"{module}.{alias.name}"
            else:
                stays.append(text)
        if not moves and not of_package:
            continue
        indent = " " * node.col_offset
        lines = []
        if of_package:
            lines.append(f"from {PACKAGE} import {', '.join(sorted(of_package))}")
        if moves:
            lines.append(f"from {SEAM} import {', '.join(sorted(moves))}")
        if stays:
            lines.append(f"from {node.module} import {', '.join(stays)}")
        edits.append(Edit(*place(node), f"\n{indent}".join(lines)))
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and node.id in prefixed:
            edits.append(Edit(*place(node), prefixed[node.id]))
    return edited(source, edits)


def with_calls_of_the_seam(source: str) -> str:
    """Return a source that calls names of the seam in place of functions of other modules.

    A file that uses such a name for something else keeps its calls.
    """
    tree = ast.parse(source)
    place = places(source)
    bound = set(bound_names(tree))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module != SEAM:
            bound |= {alias.asname or alias.name for alias in node.names}
    edits: list[Edit] = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not node.module or node.level:
            continue
        for alias in node.names:
            module = f"{node.module}.{alias.name}"
            for function, (name, argument) in STANDS_FOR.items():
                if not function.startswith(f"{module}.") or name in bound:
                    continue
                written = f"{alias.asname or alias.name}.{function.removeprefix(f'{module}.')}"
                calls = [
                    call
                    for call in ast.walk(tree)
                    if isinstance(call, ast.Call)
                    and ast.unparse(call.func) == written
                    and len(call.args) == 1
                    and not call.keywords
                ]
                for call in calls:
                    edits.append(Edit(*place(call.func), name))
                    if argument:
                        end = place(call)[1] - 1
                        edits.append(Edit(end, end, f", {argument}"))
                if calls:
                    start = place(node)[0]
                    indent = " " * node.col_offset
                    edits.append(Edit(start, start, f"from {SEAM} import {name}\n{indent}"))
    return edited(source, edits)


def places(source: str) -> Callable[[ast.expr | ast.stmt], tuple[int, int]]:
    """Return the function that gives the first byte of a node and that behind it."""
    starts = [0]
    for line in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = starts[node.lineno - 1] + node.col_offset
        return start, starts[node.end_lineno - 1] + node.end_col_offset

    return place


def edited(source: str, edits: Iterable[Edit]) -> str:
    """Return a source with edits that do not overlap."""
    encoded = source.encode()
    for edit in sorted(set(edits), reverse=True):
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
            after = with_calls_of_the_seam(before)
            after = rewritten(
                after,
                uses_modules=not folder.startswith("tests"),
                is_outside=not folder.startswith(PACKAGE),
            )
            if after != before:
                path.write_text(after, encoding="utf-8")
                sys.stdout.write(f"{path}\n")


if __name__ == "__main__":
    main(sys.argv[1:])

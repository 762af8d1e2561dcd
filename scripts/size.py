"""Count modules, lines of code and statements of the package, folder by folder.

    .venv/bin/python scripts/size.py            # a table
    .venv/bin/python scripts/size.py --write    # the statements become limits (tests/size.toml)

Docstrings, comments and blank lines do not count.
"""

from __future__ import annotations

import argparse
import ast
import io
import tokenize
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIMITS = ROOT / "tests" / "size.toml"
HEAD = """# The most statements (without docstrings) of each folder of the package. A change lowers
# them, or raises them and says in its message what a user gets for it. Written by
# "scripts/size.py --write".
[statements]
"""
SILENT = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENDMARKER,
}  # fmt: skip


@dataclass
class Size:
    """Counts of a folder."""

    modules: int = 0
    lines: int = 0
    statements: int = 0


def sizes(package: Path = ROOT / "delam_fem") -> dict[str, Size]:
    """Return the sizes of the folders of a package, and of its modules at the top."""
    found: dict[str, Size] = defaultdict(Size)
    for path in sorted(package.rglob("*.py")):
        size = found[path.relative_to(package).parts[0].removesuffix(".py")]
        text = path.read_text(encoding="utf-8")
        nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.stmt)]
        docstrings = [node for node in nodes if is_text(node)]
        size.modules += 1
        size.statements += len(nodes) - len(docstrings)
        spoken = {
            line
            for token in tokenize.generate_tokens(io.StringIO(text).readline)
            if token.type not in SILENT
            for line in range(token.start[0], token.end[0] + 1)
        }
        for node in docstrings:
            spoken -= set(range(node.lineno, (node.end_lineno or 0) + 1))
        size.lines += len(spoken)
    return dict(found)


def is_text(node: ast.stmt) -> bool:
    """Say whether a statement is a text alone."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def main(arguments: list[str] | None = None) -> None:
    """Print the table, or write the limits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write tests/size.toml")
    found = sizes()
    if parser.parse_args(arguments).write:
        rows = [f"{name} = {size.statements}" for name, size in found.items()]
        LIMITS.write_text(HEAD + "\n".join(rows) + "\n", encoding="utf-8")
    counts = [(size.modules, size.lines, size.statements) for size in found.values()]
    table = [*zip(found, counts, strict=True), ("all", tuple(map(sum, zip(*counts, strict=True))))]
    print(f"{'':12} {'modules':>10} {'lines':>10} {'statements':>10}")
    for name, row in table:
        print(f"{name:12}", *(f"{count:10}" for count in row))


if __name__ == "__main__":
    main()

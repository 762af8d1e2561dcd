"""Make harmless changes of the package, and count how many the tests survive.

    nice -n 10 .venv/bin/python scripts/evidence/benign.py [--sample 10] [--seed 0] [--list]

A harmless change is what nobody outside a module sees: another name of a private function, another
place of a private function, another wording of a message, another colour, another order of the
terms of a sum, another seed of random numbers, one more attribute in a file. This program makes
each in a copy of the checkout, runs the tests of the file or folder that mirrors the module, and
takes the change back. A change survives if no test fails that passes without it. Tests that fail
on one hold what nobody should depend on.
"""

from __future__ import annotations

import argparse
import ast
import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = "delam_fem"
PER_KIND = 7
"""Changes of each kind in the set, each in another module: 7 kinds make about 40."""
SECONDS = 240
"""Time after which the tests of a change are broken off; the change then counts for nothing."""
OPTIONS = ("-q", "-x", "-p", "no:cacheprovider", "-m", "not slow and not nightly")
COLOUR = re.compile(r'"#[0-9a-f]{6}"')
SEED = re.compile(r"default_rng\((\d+)\)")


@dataclass(frozen=True)
class Change:
    """A harmless change of one module.

    Attributes:
        kind: what is changed.
        path: the module, relative to the checkout.
        what: the change in a few words.
        text: the module after the change.
    """

    kind: str
    path: Path
    what: str
    text: str


def private_functions(tree: ast.Module) -> list[ast.FunctionDef]:
    """Return the functions of a module whose names begin with one underscore."""
    return [
        node
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and re.match(r"_[a-z]", node.name)
    ]


def renamed(source: str) -> Iterator[tuple[str, str]]:
    """Yield a module with another name of a private function."""
    for function in private_functions(ast.parse(source)):
        if f".{function.name}" in source:  # an attribute has the same name
            continue
        name = f"{function.name}_of_this_module"
        yield f"{function.name} → {name}", re.sub(rf"\b{function.name}\b", name, source)


def moved(source: str) -> Iterator[tuple[str, str]]:
    """Yield a module with a private function at its end."""
    lines = source.splitlines(keepends=True)
    for function in private_functions(ast.parse(source)):
        if function.decorator_list:
            continue
        text = lines[function.lineno - 1 : function.end_lineno]
        others = lines[: function.lineno - 1] + lines[function.end_lineno :]
        yield f"{function.name} stands last", "".join([*others, "\n\n", *text])


def reworded(source: str) -> Iterator[tuple[str, str]]:
    """Yield a module with another wording of a message: "required" in place of "expected"."""
    for place in re.finditer(r"\bexpected (?=a|one|the)", source):
        line = source.count("\n", 0, place.start()) + 1
        changed = f"{source[: place.start()]}required: {source[place.end() :]}"
        yield f"another word in line {line}", changed


def recoloured(source: str) -> Iterator[tuple[str, str]]:
    """Yield a module with another colour."""
    for place in COLOUR.finditer(source):
        changed = f'"#{int(place[0][2:-1], 16) ^ 0x0A0B0C:06x}"'
        yield f"{place[0]} → {changed}", source[: place.start()] + changed + source[place.end() :]


def reordered(source: str) -> Iterator[tuple[str, str]]:
    """Yield a module with another order of the terms of a sum of products in one line."""
    for node in ast.walk(ast.parse(source)):
        is_sum = isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add)
        if not is_sum or node.lineno != node.end_lineno:
            continue
        if not all(
            isinstance(part, ast.BinOp)
            and isinstance(part.op, ast.Mult)
            and not isinstance(part.left, ast.List)
            for part in (node.left, node.right)
        ):
            continue
        before = ast.get_source_segment(source, node)
        terms = [ast.get_source_segment(source, part) for part in (node.right, node.left)]
        if before is None or None in terms or source.count(before) != 1:
            continue
        changed = " + ".join(str(term) for term in terms)
        yield f"{before} → {changed}", source.replace(before, changed)


def reseeded(source: str) -> Iterator[tuple[str, str]]:
    """Yield a module with another seed of random numbers."""
    for place in SEED.finditer(source):
        changed = f"default_rng({int(place[1]) + 1})"
        yield f"{place[0]} → {changed}", source[: place.start()] + changed + source[place.end() :]


def with_one_more(source: str) -> Iterator[tuple[str, str]]:
    """Yield a module that writes one more entry into a file or dataset."""
    for place in re.finditer(r"\.attrs = \{", source):
        changed = f'{source[: place.end()]}"remark": "harmless", {source[place.end() :]}'
        yield "one more attribute of a dataset", changed
    for place in re.finditer(r"write_json\(([^,\n]+), (\w+)\)", source):
        changed = f'write_json({place[1]}, {{**{place[2]}, "remark": "harmless"}})'
        yield "one more entry in a file", source[: place.start()] + changed + source[place.end() :]


KINDS: dict[str, Callable[[str], Iterator[tuple[str, str]]]] = {
    "name": renamed,
    "place": moved,
    "wording": reworded,
    "colour": recoloured,
    "order of a sum": reordered,
    "seed": reseeded,
    "one more entry": with_one_more,
}


def changes(seed: int) -> list[Change]:
    """Return the set of changes, of each kind at most `PER_KIND`, in as many modules."""
    drawn = random.Random(seed)
    result = []
    for kind, make in KINDS.items():
        paths = sorted((ROOT / PACKAGE).rglob("*.py"))
        drawn.shuffle(paths)
        count = 0
        for path in paths:
            options = list(make(path.read_text(encoding="utf-8")))
            if options and count < PER_KIND:
                what, text = drawn.choice(options)
                result.append(Change(kind, path.relative_to(ROOT), what, text))
                count += 1
    return result


def tests_of(path: Path) -> list[str]:
    """Return the tests of a module: of its name, or else the folder that mirrors its own."""
    folder = ROOT / "tests" / path.parent.relative_to(PACKAGE)
    while not folder.is_dir():
        folder = folder.parent
    named = sorted(folder.rglob(f"test_{path.stem}.py"))
    if not named and folder == ROOT / "tests":
        return ["tests/test_pipeline.py", "tests/test_imports.py"]
    return [str(place.relative_to(ROOT)) for place in named or [folder]]


def outcome(tree: Path, tests: list[str]) -> str:
    """Return "survived", the first test that failed, or "time is up"."""
    command = [sys.executable, "-m", "pytest", *OPTIONS, *tests]
    try:
        run = subprocess.run(
            command, cwd=tree, capture_output=True, text=True, check=False, timeout=SECONDS
        )
    except subprocess.TimeoutExpired:
        return "time is up"
    if run.returncode == 0:
        return "survived"
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", run.stdout, re.MULTILINE)
    return failed[1] if failed else f"pytest ended with {run.returncode}"


def main() -> None:
    """Make the changes that are asked for, run the tests of each, and print the count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sample", type=int, help="how many of the changes; all if not given")
    parser.add_argument("--seed", type=int, default=0, help="seed by which they are drawn")
    parser.add_argument("--list", action="store_true", help="print the changes alone")
    options = parser.parse_args()
    drawn = changes(options.seed)
    if options.sample:
        drawn = random.Random(options.seed).sample(drawn, options.sample)
    survived = judged = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        if not options.list:
            archive = subprocess.run(
                ["git", "-C", str(ROOT), "archive", "HEAD"], capture_output=True, check=True
            )
            subprocess.run(["tar", "x", "-C", folder], input=archive.stdout, check=True)
        for change in drawn:
            words = f"{change.kind}: {change.path}: {change.what}"
            if options.list:
                sys.stdout.write(f"{words}\n")
                continue
            place = tree / change.path
            tests = tests_of(change.path)
            before = place.read_text(encoding="utf-8")
            place.write_text(change.text, encoding="utf-8")
            result = outcome(tree, tests)
            place.write_text(before, encoding="utf-8")
            if result not in {"survived", "time is up"} and outcome(tree, tests) == result:
                result = f"fails without the change, too ({result})"
            else:
                judged += result != "time is up"
                survived += result == "survived"
            sys.stdout.write(f"{words}: {result}\n")
            sys.stdout.flush()
    if not options.list:
        sys.stdout.write(f"{survived} of {judged} harmless changes survived\n")


if __name__ == "__main__":
    main()

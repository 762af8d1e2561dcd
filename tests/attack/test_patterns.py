"""No small file hangs: every pattern of the package, and every reader of texts, takes linear time.

A pattern is met in the sources, with the method that is called; what it is fed is long and made
of what it looks for. Lengths grow, so that a pattern of n² or n³ fails before it hangs.
"""

from __future__ import annotations

import ast
import importlib
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from project import ROOT

from delam_fem import read_measured
from delam_fem.api import CaseError, read_toml
from delam_fem.case.gap import read_gap_table
from delam_fem.case.toml import parse_override, parsed
from delam_fem.studies.signals.channels import assignment, length_of, part_of
from delam_fem.studies.sweeps.schedule import parse_shard

LENGTHS = (300, 2_000, 100_000)
"""Lengths of the texts; 100 kB is the last."""
SECONDS = 1.0
"""Processor time that a text may take."""
METHODS = {"match", "search", "fullmatch", "sub", "split", "findall", "finditer"}
UNITS = (
    " ", "\t", "\n", "a", "é", "1", "_", ".", "-", ",", ";", "=", "#", "[", "]", "(", ")", "@",
    ":", "/", '"', "'", "a ", " a", "1 ", "a.", "a .", "1.", "a_", "_a", "a[", "[a", "[]", "()",
    "a(", "a[ ", "@1", "a@", ":@", "@1/", "1e", "e1", "1,", ", ", "a,", "a=", "m2", "a-", "\r\n",
    "    -1", "    -1 ", "\n    -1", "col1", "1-of-", "real", " re", "[a]", "{", "}", "{}", "\\",
)  # fmt: skip
"""What the texts repeat."""
STARTS = ("", "a [")
ENDS = ("", "\0x")


def texts(n: int) -> Iterator[str]:
    """Yield hostile texts of n characters."""
    for unit in UNITS:
        body = unit * (n // len(unit))
        for start in STARTS:
            for end in ENDS:
                yield start + body + end


def patterns() -> Iterator[tuple[str, re.Pattern[str] | re.Pattern[bytes], str]]:
    """Yield the place, the pattern and the method of every call of the package."""
    for path in sorted((ROOT / "delam_fem").rglob("*.py")):
        source = path.read_text("utf-8")
        if not re.search(r"^\s*import re$", source, re.M):
            continue
        tree = ast.parse(source)
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        compiled = {
            target.id
            for node in tree.body
            if isinstance(node, ast.Assign) and "re.compile" in ast.unparse(node.value)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            owner, method = ast.unparse(node.func.value), node.func.attr
            place = f"{name}:{node.lineno}"
            if method in METHODS and owner in compiled:
                yield place, getattr(importlib.import_module(name), owner), method
            elif method in METHODS and owner == "re" and isinstance(node.args[0], ast.Constant):
                yield place, re.compile(node.args[0].value), method


FOUND = list(patterns())


def call(pattern: re.Pattern[str] | re.Pattern[bytes], method: str, text: str) -> object:
    """Call a method of a pattern as the package does."""
    argument = text.encode() if isinstance(pattern.pattern, bytes) else text
    function = getattr(pattern, method)
    if method == "sub":
        return function("", argument)
    matches = function(argument)
    return list(matches) if method == "finditer" else matches


def require_fast(function: Callable[[str], object], every: Callable[[int], Iterator[str]]) -> float:
    """Feed a function with longer and longer texts; return the longest processor time [s]."""
    longest = 0.0
    for n in LENGTHS:
        for text in every(n):
            start = time.process_time()
            function(text)
            taken = time.process_time() - start
            assert taken < SECONDS, (
                f"{taken:.1f} s for {n} characters {text[:12]!r} … {text[-3:]!r}"
            )
            longest = max(longest, taken)
    return longest


def test_all_patterns_are_found() -> None:
    assert len(FOUND) > 25
    assert {"search", "fullmatch", "match", "split", "sub"} <= {method for *_, method in FOUND}


@pytest.mark.parametrize("k", range(len(FOUND)), ids=[f"{p}-{m}" for p, _, m in FOUND])
def test_a_pattern_is_linear(k: int) -> None:
    _, pattern, method = FOUND[k]
    require_fast(lambda text: call(pattern, method, text), texts)


def refused(function: Callable[[str], object]) -> Callable[[str], object]:
    """Return a function that may refuse its text."""

    def called(text: str) -> None:
        try:
            function(text)
        except CaseError as error:
            assert len(str(error)) < 1000

    return called


TEXTS: dict[str, Callable[[str], object]] = {
    "toml": lambda text: _toml(text),
    "comment": lambda text: _toml("a = 1 # " + text.replace("\n", " ")),
    "set": lambda text: parse_override(f"time.periods={text}"),
    "key": lambda text: parse_override(f"{text}=1"),
    "channel": lambda text: assignment(text, "--channel a"),
    "position": lambda text: length_of(text, "--channel a"),
    "part": part_of,
    "shard": parse_shard,
}  # fmt: skip
FILES = ("gap.csv", "comment.csv", "table.csv", "rows.csv", "case.toml", "set.uff", "raw.uff")


def _toml(text: str) -> None:
    """Parse a text as TOML, which it may not be."""
    try:
        parsed(text, "case")
    except ValueError as error:
        assert not isinstance(error, RecursionError)


@pytest.mark.slow
@pytest.mark.parametrize("name", TEXTS)
def test_a_text_of_the_command_line_takes_no_time(name: str) -> None:
    require_fast(refused(TEXTS[name]), texts)


def of_file(path: Path) -> Callable[[str], object]:
    """Return a function that writes a text into a file of some kind, and reads it."""

    def read(text: str) -> None:
        line = text.replace("\n", " ").replace("\r", " ")
        head = {
            "gap.csv": f"{line}\n0, 0\n0.685, 0.01\n",
            "comment.csv": f"# x [m], {line}\n0, 0\n0.685, 0.01\n",
            "table.csv": f"time [s], {line}\n0, 0\n0.1, 0.01\n0.2, 0\n",
            "rows.csv": f"time [s], a [m]\n0, 0\n0.1, {line}\n0.2, 0\n",
            "case.toml": f"name = {text}",
            "set.uff": f"    -1\n    58\n{text}\n    -1\n",
            "raw.uff": f"    -1\n    58b     1     2\n{text}\n    -1\n",
        }
        path.write_text(head[path.name], "utf-8")
        if path.name == "case.toml":
            read_toml(path)
        elif path.name in ("gap.csv", "comment.csv"):
            read_gap_table(path, 0.685)
        else:
            read_measured(path)

    return read


def few(n: int) -> Iterator[str]:
    """Yield fewer texts of n characters, for readers whose libraries take longer to start."""
    for unit in UNITS:
        yield unit * (n // len(unit))
        yield "a" + unit * (n // len(unit)) + "!"


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_a_text_in_a_file_takes_no_time(tmp_path: Path, name: str) -> None:
    require_fast(refused(of_file(tmp_path / name)), few)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("H real", ("H", "real")),
        ("H_1.imag", ("H_1", "imag")),
        ("tip - Phase", ("tip", "phase")),
        ("real", ("real", "whole")),
        ("_re", ("_re", "whole")),
        ("a b coh", ("a b", "coherence")),
        ("surreal", ("surreal", "whole")),
    ],
)
def test_parts_of_responses(text: str, expected: tuple[str, str]) -> None:
    assert part_of(text) == expected


def test_a_long_cell_in_quotes_is_no_defect(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text('time [s],"' + 140_000 * "a" + ' [m]"\n0,1\n1,2\n')
    assert read_measured(path).sizes["time"] == 2

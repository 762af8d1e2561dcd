"""Stored texts are few, and each belongs to a test."""

import subprocess
import sys

import golden
from project import ROOT

MOST = 40
"""Only formats that others read, and the words of figures, are stored."""


def test_stored_texts_are_few_and_used() -> None:
    files = set(golden.FOLDER.rglob("*.txt"))
    assert len(files) <= MOST
    modules = sorted({f"tests/{path.parent.relative_to(golden.FOLDER)}.py" for path in files})
    words = ["-m", "pytest", "--collect-only", "-q", "-m", "stored", "-p", "no:cacheprovider"]
    output = subprocess.run(
        [sys.executable, *words, *modules], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    tests = {line.removeprefix("tests/") for line in output.splitlines() if "::" in line}
    assert {golden.place(test) for test in tests} == files


def test_nothing_else_is_among_the_stored_texts() -> None:
    assert [
        path for path in golden.FOLDER.rglob("*") if path.is_file() and path.suffix != ".txt"
    ] == []

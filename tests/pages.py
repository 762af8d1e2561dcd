"""Pages of Markdown whose blocks are run as they stand.

A comment in the line before a block says more about it:
`<!-- not run in tests: REASON -->`, `<!-- nightly -->` (it takes long), `<!-- file: NAME -->` (it
is the content of a file), `<!-- output -->` (it is printed by the block before it; "…" stands for
anything, and numbers agree to `CLOSE`).
"""

from __future__ import annotations

import io
import math
import re
import runpy
import shlex
import subprocess
import sys
import warnings
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import NamedTuple

from typer.testing import CliRunner

from delam_fem.cli.app import app

BLOCK = re.compile(
    r"(?:^<!-- (?P<note>not run in tests: \S.*|nightly|file: \S+|output) -->\n+)?"
    r"^```(?P<language>\w+)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
LONGEST = 600  # s
CLOSE = 0.02
"""Largest relative difference of a number from the one that a page shows: other machines round
otherwise, and clapping amplifies it."""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


class Block(NamedTuple):
    """A code block with what its comment says."""

    name: str
    language: str
    code: str
    note: str

    @property
    def reason(self) -> str | None:
        """Why it is not run, if it is not."""
        return self.note.partition("not run in tests: ")[2] or None

    @property
    def file(self) -> str | None:
        """The name of the file whose content it is."""
        return self.note.partition("file: ")[2] or None


def blocks(text: str) -> list[Block]:
    return [
        Block(
            f"line{text.count(chr(10), 0, match.start('code'))}",
            match["language"],
            match["code"],
            match["note"] or "",
        )
        for match in BLOCK.finditer(text)
    ]


def commands(code: str) -> list[list[str]]:
    """Return the words of each command of a bash block."""
    lines = code.replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def run(script: Path, folder: Path) -> str:
    """Run a script in a folder, in a process of its own if it starts some; return its output."""
    if "__main__" not in script.read_text(encoding="utf-8"):
        printed = io.StringIO()
        with chdir(folder), redirect_stdout(printed), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            runpy.run_path(str(script), run_name="__main__")
        return printed.getvalue()
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=LONGEST,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def call(words: list[str], folder: Path) -> str:
    """Call the command in a folder and return what it prints."""
    with chdir(folder):
        done = CliRunner().invoke(app, words, env={"COLUMNS": "120"})
    assert done.exit_code == 0, done.output
    return done.output


def run_block(block: Block, folder: Path) -> str:
    """Run a block in a folder and return what it prints."""
    if block.language == "python":
        script = folder / "block.py"
        script.write_text(block.code, encoding="utf-8")
        return run(script, folder)
    printed = ""
    for program, *words in commands(block.code):
        name = Path(program).name
        assert name in ("delam-fem", "python"), program
        printed += run(folder / words[0], folder) if name == "python" else call(words, folder)
    return printed


def agrees(shown: str, printed: str) -> bool:
    """Return whether a line of a page is the printed one, with numbers that are close."""
    texts = [[part.split() for part in NUMBER.split(line)] for line in (shown, printed)]
    numbers = [[float(n) for n in NUMBER.findall(line)] for line in (shown, printed)]
    return texts[0] == texts[1] and all(
        math.isclose(a, b, rel_tol=CLOSE) for a, b in zip(*numbers, strict=True)
    )


def missing(shown: str, printed: str) -> list[str]:
    """Return the lines of a page that were not printed, in any order; "…" stands for anything."""
    lines = printed.splitlines()
    return [
        line
        for line in shown.splitlines()
        if line.strip() not in ("", "…") and not any(agrees(line, other) for other in lines)
    ]

"""Hostile inputs: every one is accepted or refused by a message, and nothing is left behind.

The short form attempts every twelfth input; `-m nightly` attempts all, and prints the counts of
docs/evidence/attacks.md with `-s`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from attack.hostile import KINDS, SEED
from project import ROOT
from support import invoke

LIMIT = 3600.0
"""Time after which a process counts as hanging; it computes hundreds of inputs [s]."""
SHARE = 12
"""The short form attempts one of so many inputs of a kind."""
COMPUTING = ("sweep-result", "result", "run")
"""Kinds that compute; the short form leaves them to the tests of their modules."""
MESSAGE_LINES = 10

COMMANDS: dict[str, list[str]] = {
    "depth": ["run", "paper", "--set", "mesh.elements=" + "[" * 5000],
    "digits": ["run", "paper", "--set", "time.periods=" + "1" * 5000],
    "levels": ["run", "paper", "--set", ".".join("a" * 5000) + "=1"],
    "frequency": ["run", "paper", "--set", "excitation.frequency=1e-200"],
    "length": ["run", "paper", "--set", "lamina.thick.length=1e-160"],
    "periods": ["run", "paper", "--set", "time.periods=1000000000"],
    "elements": ["run", "paper", "--set", "mesh.elements=10000000"],
    "window": ["run", "paper", "--set", "time.periods=100000", "--set",
               "output.window_periods=100000"],
    "passwords as a mesh": ["run", "paper", "--set", "mesh.file=/etc/passwd"],
    "passwords as a gap": ["run", "paper", "--set", "gap.file=/etc/passwd"],
    "passwords as a case": ["run", "/etc/passwd"],
    "device": ["run", "/dev/zero"],
    "device as a gap": ["run", "paper", "--set", "gap.file=/dev/zero"],
    "endless mesh": ["run", "paper", "--set", "mesh.file=endless.mdpa"],
    "long name": ["run", "a" * 5000],
    "many points": ["sweep", "many.toml"],
    "damaged result": ["show", "diagram", "response", "damaged.nc"],
    "modes": ["modes", "paper", "--set", "gap.file=/etc/passwd"],
}  # fmt: skip
"""Arguments of commands that must be refused; the folder `out` must not appear."""
CRASHES = ("depth", "digits", "levels", "device", "damaged result")
"""Those that may end a process or a library."""
SHORT_COMMANDS = ("depth", "periods", "passwords as a gap", "many points")

MANY = """base = "paper"
[[axis]]
key = "excitation.frequency"
start = 1.0
stop = 4.0
count = 10000
[[axis]]
key = "contact.restitution"
start = 0.0
stop = 1.0
count = 10000
"""


def attacked(*kinds: str, share: int = 1) -> list[dict[str, object]]:
    """Attempt inputs of kinds in a process of their own; a crash fails the test."""
    program = ROOT / "tests" / "attack" / "hostile.py"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(program), str(share), *kinds],
        env={**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    assert done.returncode == 0, f"status {done.returncode}\n{done.stderr[-2000:]}"
    return [json.loads(line) for line in done.stdout.splitlines()[-len(kinds) :]]


@pytest.mark.slow
def test_some_hostile_inputs() -> None:
    kinds = [kind for kind in KINDS if kind not in COMPUTING]
    reports = attacked(*kinds, share=SHARE)
    assert [one["defects"] for one in reports] == [[]] * len(kinds)
    assert sum(one["refused"] for one in reports) > 50  # type: ignore[misc]


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_all_hostile_inputs(kind: str) -> None:
    (report,) = attacked(kind)
    print(f"\n{kind}: {report['accepted']} accepted, {report['refused']} refused")
    assert report["defects"] == []


def test_the_long_form_is_long() -> None:
    assert sum(count for _, count in KINDS.values()) >= 2000
    assert SEED == 20261121  # the counts in docs/evidence/attacks.md belong to it


def refused(name: str, folder: Path) -> None:
    """Call a command that must be refused, and look at what it says and leaves."""
    (folder / "many.toml").write_text(MANY)
    (folder / "damaged.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + b"\0" * 500)
    (folder / "endless.mdpa").write_text("Begin Nodes\n")
    before = sorted(folder.iterdir())
    line = [*COMMANDS[name], "-o", "out"]
    status, errors = of_process(line, folder) if name in CRASHES else of_runner(line)
    assert status == 2, errors
    assert "Traceback" not in errors and "root:" not in errors
    assert 1 <= len(errors.splitlines()) <= MESSAGE_LINES
    assert max(map(len, errors.splitlines())) < 1100
    assert sorted(folder.iterdir()) == before


def of_process(line: list[str], folder: Path) -> tuple[int, str]:
    """Call the command in a process of its own; return its status and what it says."""
    done = subprocess.run(
        [sys.executable, "-m", "delam_fem", *line],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    return done.returncode, done.stderr


def of_runner(line: list[str]) -> tuple[int, str]:
    """Call the command in this process."""
    done = invoke(*line)
    return done.exit_code, done.output


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORT_COMMANDS)
def test_some_commands_are_refused(tmp_path: Path, name: str, elsewhere: None) -> None:
    refused(name, tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted(set(COMMANDS) - set(SHORT_COMMANDS)))
def test_other_commands_are_refused(tmp_path: Path, name: str, elsewhere: None) -> None:
    refused(name, tmp_path)

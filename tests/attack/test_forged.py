"""Damaged and forged files of ours are refused by a message, or give the numbers that they hold."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from attack.forged import KINDS, SEED
from project import ROOT

LIMIT = 3600.0
"""Time after which a process counts as hanging [s]."""
SHARE = 50
"""The short form attempts one of so many files of a kind."""
MOST_BYTES = 1_000_000_000
"""Memory that a process may take."""


def attacked(*kinds: str, share: int = 1) -> list[dict[str, object]]:
    """Attempt files of kinds in a process of their own; a crash fails the test."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "attack.forged", str(share), *kinds],
        env={**os.environ, "PYTHONPATH": f"{ROOT / 'tests'}:{ROOT}", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    assert done.returncode == 0, f"status {done.returncode}\n{done.stderr[-2000:]}"
    return [json.loads(line) for line in done.stdout.splitlines()[-len(kinds) :]]


@pytest.mark.slow
def test_some_forged_files() -> None:
    reports = attacked(*KINDS, share=SHARE)
    assert [one["defects"] for one in reports] == [[]] * len(KINDS)
    assert all(int(str(one["memory"])) < MOST_BYTES for one in reports)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_all_forged_files(kind: str) -> None:
    (report,) = attacked(kind)
    print(f"\n{kind}: {report['accepted']} accepted, {report['refused']} refused")
    assert report["defects"] == []
    assert int(str(report["memory"])) < MOST_BYTES


def test_the_long_form_is_long() -> None:
    assert sum(count for _, count in KINDS.values()) >= 2000
    assert SEED == 20261127  # the counts in docs/evidence/attacks.md belong to it

"""Kills at random moments: runs, sweeps and ladders lose nothing that was on the disk.

Each trial starts a command, kills it at a random moment, goes on with `--resume`, kills that again,
and so on until a command ends by itself. The moments have a fixed seed; what they hit depends on
the machine.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from attack.processes import (
    CASE,
    LIMIT,
    command,
    ended,
    periods_kept,
    require_none_left,
    require_whole_files,
    start,
    sweep_text,
    wait_for,
)

import delam_fem as df

SEED = 12
KILLS = {"run": 60, "sweep": 24, "converge": 20}
"""Numbers of kills in the long form."""

LADDER = (
    "--laws",
    "newton@moreau-jean",
    "--steps",
    "100,200,400",
    "--periods",
    "6",
    "--limit-steps",
    "0",
)
LADDER_KEYS = {"mesh.elements": 4, "time.periods": 8, "output.window_periods": 4}


@dataclass
class Attack:
    """A command that is killed again and again.

    Attributes:
        line: the command.
        folder: its results.
        progress: function that counts what is on the disk.
        rng: gives the moments.
        stages: what the folder held when the kills came.
    """

    line: list[str]
    folder: Path
    progress: Callable[[Path], int]
    rng: np.random.Generator
    stages: dict[str, int] = field(default_factory=dict)

    def run(self, most: int, duration: float) -> float:
        """Kill the command up to `most` times, then let it end; return how long that took [s].

        Args:
            most: number of kills.
            duration: time that the command takes without kills [s].
        """
        kept = 0
        for _ in range(most):
            process = start([*self.line, *self._going_on()])
            try:
                process.wait(timeout=float(self.rng.uniform(0.25, 1.05)) * duration)
            except subprocess.TimeoutExpired:
                os.kill(process.pid, signal.SIGKILL)
            _, errors = process.communicate(timeout=LIMIT)
            require_none_left(process.pid)
            require_whole_files(self.folder)
            if process.returncode != -signal.SIGKILL:
                assert process.returncode == 0, errors
                return duration
            self._note()
            now = self.progress(self.folder)
            assert now >= kept, f"{kept} on the disk before, {now} now"
            kept = now
        begin = time.monotonic()
        status, errors = ended([*self.line, *self._going_on()])
        assert status == 0, errors
        return max(time.monotonic() - begin, 0.5 * duration)

    def _going_on(self) -> list[str]:
        """Return --resume if there is anything to go on with."""
        return ["--resume"] if self.progress(self.folder) else []

    def _note(self) -> None:
        """Count the stage that a kill has hit."""
        names = {path.name for path in self.folder.rglob("*")} if self.folder.exists() else set()
        stage = "before anything was kept"
        for name in ("checkpoint.npz", "sweep.journal", "convergence.json"):
            stage = "while computing" if name in names else stage
        final = {
            "case.toml",
            "result.nc",
            "figures",
            "fields",
            "report.html",
            "tables.md",
            ".delam_fem-sweep.nc",
        }
        if (final & names and "sweep.toml" not in names) or ".delam_fem-sweep.nc" in names:
            stage = "while the results were written"
        self.stages[stage] = self.stages.get(stage, 0) + 1


def run_progress(folder: Path) -> int:
    """Return the number of periods on the disk; a complete result has all."""
    kept = periods_kept(folder)
    return CASE["time.periods"] if not kept and (folder / "result.nc").exists() else kept


def sweep_progress(folder: Path) -> int:
    """Return 1 if the folder has a journal or a result."""
    return int(any((folder / name).exists() for name in ("sweep.journal", "sweep.nc")))


def ladder_progress(folder: Path) -> int:
    """Return the number of rungs on the disk, and 1 for the file."""
    path = folder / "convergence.json"
    return 1 + len(json.loads(path.read_text())["rungs"]) if path.exists() else 0


def results(folder: Path) -> object:
    """Return what must be equal bit by bit."""
    for name in ("result.nc", "sweep.nc"):
        if (folder / name).exists():
            return xr.load_dataset(folder / name, engine="h5netcdf").drop_attrs()
    rungs = json.loads((folder / "convergence.json").read_text())["rungs"]
    for rung in rungs:
        for name in [name for name in rung if "seconds" in name or "cost" in name]:
            del rung[name]
    return sorted(json.dumps(rung, sort_keys=True) for rung in rungs)


def attack(kind: str, most: int, tmp_path: Path) -> dict[str, int]:
    """Kill a command `most` times in several trials; return the stages that were hit."""
    (tmp_path / "s.toml").write_text(sweep_text(periods=20, count=100))
    first, progress, keys = {
        "run": (("run", "paper", "--checkpoint-seconds=0"), run_progress, CASE),
        "sweep": (("sweep", tmp_path / "s.toml", "-j", 2), sweep_progress, {}),
        "converge": (("converge", "paper", "-j", 2, *LADDER), ladder_progress, LADDER_KEYS),
    }[kind]
    begin = time.monotonic()
    status, errors = ended(command(*first, "-q", "-o", tmp_path / "whole", keys=keys))
    assert status == 0, errors
    duration, expected = time.monotonic() - begin, results(tmp_path / "whole")
    rng, left, stages, trial = np.random.default_rng(SEED), most, {}, 0
    while left > 0:
        folder = tmp_path / f"trial-{trial}"
        line = command(*first, "-q", "-o", folder, keys=keys)
        one = Attack(line, folder, progress, rng)
        one.run(min(left, 8), duration)
        found = results(folder)
        assert found == expected if isinstance(found, list) else found.identical(expected)
        assert not list(folder.glob("*checkpoint*")) and not list(folder.glob("sweep.journal*"))
        left, trial = left - sum(one.stages.values()), trial + 1
        assert trial <= most + 8  # the duration was measured too long
        for stage, count in one.stages.items():
            stages[stage] = stages.get(stage, 0) + count
    return stages


@pytest.mark.slow
def test_a_kill_while_computing_and_one_while_writing(tmp_path: Path) -> None:
    folder, case = tmp_path / "run", df.preset("paper", CASE)
    line = command("run", "paper", "--checkpoint-seconds=0", "-q", "-o", folder, keys=CASE)
    for name, options in (("checkpoint.npz", ()), ("result.nc", ("--resume",))):
        process = start([*line, *options])
        wait_for(folder / name, process)
        process.kill()
        process.communicate()
        require_whole_files(folder)
        assert periods_kept(folder) > 0
    resumed = df.run(case, directory=folder, resume=True)
    whole = df.run(case)
    assert resumed.summary["steps"] == whole.summary["steps"]
    xr.testing.assert_equal(resumed.history, whole.history)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KILLS)
def test_many_kills_lose_nothing(kind: str, tmp_path: Path) -> None:
    stages = attack(kind, KILLS[kind], tmp_path)
    print(f"{kind}: kills {stages}")  # `pytest -m nightly -s` shows what the kills hit
    assert sum(stages.values()) == KILLS[kind]

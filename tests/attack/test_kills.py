"""Kills at random moments: whatever goes on loses nothing that was on the disk.

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
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from attack.processes import (
    CASE,
    LIMIT,
    command,
    ended,
    history,
    periods_kept,
    require_none_left,
    require_whole_files,
    start,
    sweep_text,
    wait_for,
)

import delam_fem as df

SEED = 12
KILLS = {
    "run": 40, "extend": 16, "sweep": 20, "shard": 12, "converge": 16, "scan": 10, "modulate": 10,
    "tap": 8, "excite": 10, "keys": 10, "resonance": 8, "orbit": 8, "follow": 12,
}  # fmt: skip
"""Numbers of kills in the long form."""

REFINEMENT = (
    "--laws",
    "newton@moreau-jean",
    "--steps",
    "100,200,400",
    "--periods",
    "6",
    "--limit-steps",
    "0",
)
REFINEMENT_KEYS = {"mesh.elements": 4, "time.periods": 8, "output.window_periods": 4}


SPAN = 20
"""Periods of an extension."""
BONDED = {"mesh.elements": 20, "time.steps_per_period": 100, "time.periods": 40}
BLOW = {
    **BONDED, "contact.law": "penalty", "contact.penalty_stiffness": 1e5, "time.scheme": "newmark",
    "time.periods": 2,
}  # fmt: skip
FEW = {"mesh.elements": 3, "time.steps_per_period": 60, "time.periods": 20}
SWEPT = {
    "mesh.elements": 6, "excitation.kind": "sweep", "excitation.start_frequency": 2,
    "excitation.end_frequency": 6, "excitation.duration": 60, "time.steps_per_period": 50,
}  # fmt: skip


def resumed(folder: Path) -> list[str]:
    """Return --resume if a folder has anything to go on with."""
    return ["--resume"] if seen(folder) else []


def replaced(folder: Path) -> list[str]:
    """Return --overwrite if a folder has anything."""
    return ["--overwrite"] if seen(folder) else []


def run_resumed(folder: Path) -> list[str]:
    """Return --resume if a folder has a checkpoint or a result of a run."""
    return ["--resume"] if run_progress(folder) else []


def extended(folder: Path) -> list[str]:
    """Return how an extension begins, or goes on once its checkpoint is there."""
    if (folder / "checkpoint.npz").exists() or n_periods(folder) > CASE["time.periods"]:
        return [f"--set=time.periods={CASE['time.periods'] + SPAN}", "--resume"]
    return ["--extend", str(SPAN)]


def n_periods(folder: Path) -> int:
    """Return the number of periods in the result of a run."""
    return int(history(folder).sizes["period"])


def seen(folder: Path) -> int:
    """Return 1 if a folder has anything but temporary files."""
    return int(folder.exists() and any(not path.name.startswith(".") for path in folder.iterdir()))


@dataclass(frozen=True)
class Victim:
    """A command that is killed.

    Attributes:
        words: its words; FOLDER is a folder with the files of the test.
        keys: overrides of its case.
        go_on: function of the folder that returns the options with which the command goes on.
        progress: function that counts what is on the disk; it never falls.
        before: words of the command that prepares the folder.
        after: words of the commands that finish it.
    """

    words: tuple[object, ...]
    keys: dict[str, Any]
    go_on: Callable[[Path], list[str]] = resumed
    progress: Callable[[Path], int] = seen
    before: tuple[object, ...] = ()
    after: tuple[tuple[object, ...], ...] = ()


def victims() -> dict[str, Victim]:
    """Return all commands that are killed, by name."""
    run, sweep = ("run", "paper", "--checkpoint-seconds=0"), ("sweep", "FOLDER/s.toml")
    long = {**CASE, "time.periods": CASE["time.periods"] + SPAN}
    return {
        "run": Victim(run, CASE, run_resumed, run_progress),
        "extend": Victim(run, CASE, extended, n_periods, run),
        "sweep": Victim((*sweep, "-j", 2), {}, resumed, sweep_progress),
        "shard": Victim(
            (*sweep, "--shard", "1/2", "-j", 1), {}, resumed, sweep_progress,
            after=((*sweep, "--shard", "2/2", "-j", 1), (*sweep, "--merge")),
        ),
        "converge": Victim(
            ("converge", "paper", "-j", 2, *REFINEMENT),
            REFINEMENT_KEYS, resumed, refinement_progress,
        ),
        "scan": Victim(("detect", "scan", "embedded"), BONDED),
        "modulate": Victim(
            ("detect", "modulate", "embedded", "--pump-frequency", 49, "--pump-amplitude", 0.1,
             "--periods", 1), BONDED,
        ),
        "tap": Victim(("detect", "tap", "FOLDER/blow.toml", "--spacing", 0.05), {}, replaced),
        "excite": Victim(
            ("detect", "excite", "embedded", "-n", 4, "--to", 100, "-j", 1), BONDED
        ),
        "keys": Victim(
            ("identify", "keys", "paper", "--unknown", "gap.exponent=1:3", "--frequency", 3.25,
             "--simulations", 100, "-j", 1), FEW,
        ),
        "resonance": Victim(("identify", "resonance", "paper"), SWEPT),
        "orbit": Victim(
            ("orbit", "find", "paper", "--settle", 20), {**FEW, "contact.law": "none"}
        ),
        "follow": Victim(
            ("orbit", "follow", "paper", "--from", 3.7, "--to", 3.9, "--step", 0.2),
            {**FEW, "contact.law": "none"},
        ),
        "longer": Victim(run, long),
    }  # fmt: skip


@dataclass
class Attack:
    """A command that is killed again and again.

    Attributes:
        victim: the command.
        line: its words as a process gets them.
        folder: its results.
        rng: gives the moments.
        stages: what the folder held when the kills came.
    """

    victim: Victim
    line: list[str]
    folder: Path
    rng: np.random.Generator
    stages: dict[str, int] = field(default_factory=dict)

    def run(self, most: int, duration: float) -> float:
        """Kill the command up to `most` times, then let it end.

        Args:
            most: number of kills.
            duration: time that the command takes without kills [s].

        Returns:
            The time that it takes now, on a machine whose load changes [s].
        """
        n_before = 0
        for _ in range(most):
            begin = time.monotonic()
            process = start([*self.line, *self.victim.go_on(self.folder)])
            try:
                process.wait(timeout=float(self.rng.uniform(0.25, 1.05)) * duration)
            except subprocess.TimeoutExpired:
                os.kill(process.pid, signal.SIGKILL)
            _, errors = process.communicate(timeout=LIMIT)
            require_none_left(process.pid)
            require_whole_files(self.folder)
            if process.returncode != -signal.SIGKILL:
                assert process.returncode == 0, errors
                return min(duration, time.monotonic() - begin)
            self._note()
            now = self.victim.progress(self.folder)
            assert now >= n_before, f"{n_before} on the disk before, {now} now"
            n_before = now
        status, errors = ended([*self.line, *self.victim.go_on(self.folder)])
        assert status == 0, errors
        return duration

    def _note(self) -> None:
        """Count the stage that a kill has hit."""
        names = {path.name for path in self.folder.rglob("*")} if self.folder.exists() else set()
        progress_names = {
            "checkpoint.npz", "sweep.journal", "convergence.json", "points", "simulations",
            "checkpoints",
        }  # fmt: skip
        stage = "while computing" if progress_names & names else "before anything was kept"
        if {"unfinished.txt", ".delam_fem-sweep.nc"} & names:
            stage = "while the results were written"
        self.stages[stage] = self.stages.get(stage, 0) + 1


def run_progress(folder: Path) -> int:
    """Return the number of periods on the disk; a complete result has all."""
    n_stored = periods_kept(folder)
    return CASE["time.periods"] if not n_stored and (folder / "result.nc").exists() else n_stored


def sweep_progress(folder: Path) -> int:
    """Return 1 if the folder has a journal or a result."""
    return int(any((folder / name).exists() for name in ("sweep.journal", "sweep.nc")))


def refinement_progress(folder: Path) -> int:
    """Return the number of levels on the disk, and 1 for the file."""
    path = folder / "convergence.json"
    return 1 + len(json.loads(path.read_text())["rungs"]) if path.exists() else 0


def results(folder: Path) -> dict[str, str]:
    """Return what must be equal bit by bit, as texts by the names of files."""
    contents = {}
    for path in sorted(folder.rglob("*")):
        if path.name in ("result.nc", "sweep.nc", "branch.nc"):
            data = xr.load_dataset(path, engine="h5netcdf").drop_attrs()
            columns = {str(name): data[name].to_numpy() for name in data.variables}
            contents[str(path.relative_to(folder))] = str(
                {name: column.tolist() if column.dtype.kind == "O" else column.tobytes()
                 for name, column in columns.items()}
            )  # fmt: skip
        elif path.suffix == ".json" and path.name not in ("summary.json", "sweep.json"):
            content = json.loads(path.read_text())
            if "rungs" in content:  # in the order in which they were finished
                content["rungs"].sort(key=lambda level: str(level["key"]))
            contents[str(path.relative_to(folder))] = json.dumps(lasting(content), sort_keys=True)
    return contents


def lasting(value: Any) -> Any:
    """Return what JSON says without times and counts of computing."""
    if isinstance(value, dict):
        return {
            key: lasting(entry)
            for key, entry in value.items()
            if not any(word in key for word in ("second", "cost", "checksum", "evaluations"))
            and key not in ORIGIN
        }
    return [lasting(entry) for entry in value] if isinstance(value, list) else value


ORIGIN = ("created", "command", "host", "processor", "revision", "blas")


def files_of(folder: Path) -> list[Path]:
    """Write the files that the commands read, and return them."""
    (folder / "s.toml").write_text(sweep_text(periods=20, count=100))
    blow = {"lamina": "upper", "position": 0.2, "mass": 0.01, "gap": 1e-4, "velocity": 0.5,
            "stiffness": 1e5, "side": "above"}  # fmt: skip
    sections = tomllib.loads(df.preset("embedded", BLOW).to_toml())
    (folder / "blow.toml").write_text(df.Case(**sections, impactor=[blow]).to_toml())
    return [folder / "s.toml", folder / "blow.toml"]


def attack(kind: str, most: int, tmp_path: Path) -> dict[str, int]:
    """Kill a command `most` times in several trials; return the stages that were hit."""
    files_of(tmp_path)
    victim = victims()[kind]

    def line(words: Iterable[object], folder: Path, keys: dict[str, Any]) -> list[str]:
        placed = (str(word).replace("FOLDER", str(tmp_path)) for word in words)
        return command(*placed, "-q", "-o", folder, keys=keys)

    def finish(folder: Path) -> None:
        for words in victim.after:
            status, errors = ended(line(words, folder, victim.keys))
            assert status == 0, errors

    reference = victims()["longer"] if kind == "extend" else victim
    begin = time.monotonic()
    status, errors = ended(line(reference.words, tmp_path / "whole", reference.keys))
    assert status == 0, errors
    duration = time.monotonic() - begin
    finish(tmp_path / "whole")
    expected = results(tmp_path / "whole")
    rng, left, stages, trial = np.random.default_rng(SEED), most, dict[str, int](), 0
    while left > 0:
        folder = tmp_path / f"trial-{trial}"
        if victim.before:
            status, errors = ended(line(victim.before, folder, victim.keys))
            assert status == 0, errors
        one = Attack(victim, line(victim.words, folder, victim.keys), folder, rng)
        duration = one.run(min(left, 8), duration)
        finish(folder)
        assert results(folder) == expected
        names = {path.name for path in folder.iterdir()}
        assert not names & {"checkpoint.npz", "sweep.journal", "checkpoints", "unfinished.txt"}
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
    complete_run = df.run(case)
    assert resumed.summary["steps"] == complete_run.summary["steps"]
    xr.testing.assert_equal(resumed.history, complete_run.history)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KILLS)
def test_many_kills_lose_nothing(kind: str, tmp_path: Path) -> None:
    stages = attack(kind, KILLS[kind], tmp_path)
    print(f"{kind}: kills {stages}")  # `pytest -m nightly -s` shows what the kills hit
    assert sum(stages.values()) == KILLS[kind]

"""Real processes of the command: start them, end them, and look at what they leave."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import xarray as xr
from project import ROOT

LIMIT = 600.0
"""Time after which a process counts as hanging [s]."""

CASE = {
    "mesh.elements": 6,
    "time.steps_per_period": 100,
    "time.periods": 60,
    "output.window_periods": 6,
    "output.fields_per_period": 2,
    "contact.impulse": "consistent",
}
"""A run whose steps take about as long as the rest of the command."""

WHOLE = {
    "checkpoint.npz": lambda path: [np.load(path)[name] for name in np.load(path).files],
    ".nc": lambda path: xr.load_dataset(path, engine="h5netcdf"),
    ".json": lambda path: json.loads(path.read_text()),
    ".toml": lambda path: tomllib.loads(path.read_text()),
    ".png": lambda path: path.read_bytes().endswith(b"IEND\xaeB`\x82") or 1 / 0,
    ".html": lambda path: path.read_text().rstrip().endswith("</html>") or 1 / 0,
    ".vtu": lambda path: path.read_bytes().rstrip().endswith(b"</VTKFile>") or 1 / 0,
    ".pvd": lambda path: path.read_text().rstrip().endswith("</VTKFile>") or 1 / 0,
}
"""Functions that fail if a file is not whole, by its name or suffix."""


def sweep_text(*, periods: int, count: int) -> str:
    """Return the file of a sweep over the frequency with single steps that take a while."""
    return f"""
name = "s"
base = "paper"
engine = "petsc"
[set]
"mesh.elements" = 3
"time.steps_per_period" = 40
"time.periods" = {periods}
"output.window_periods" = 4
"output.fields_per_period" = 0
[[axis]]
key = "excitation.frequency"
start = 3.0
stop = 4.0
count = {count}
"""


MPIRUN = ("mpirun", "--allow-run-as-root", "--oversubscribe", "-n", "2")


def command(*arguments: object, keys: dict[str, object] | None = None) -> list[str]:
    """Return the command line of `delam-fem` with overrides."""
    sets = [f"--set={key}={value}" for key, value in (keys or {}).items()]
    return [sys.executable, "-m", "delam_fem", *map(str, arguments), *sets]


def environment(**more: str) -> dict[str, str]:
    """Return the environment of a process of its own, which imports this checkout."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", **more}


def start(line: list[str], **options: object) -> subprocess.Popen[str]:
    """Start a process in a session of its own."""
    settings = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.Popen(  # type: ignore[call-overload, no-any-return]
        line, text=True, env=environment(), start_new_session=True, **settings
    )


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Wait for a process; return its status and what it wrote to stderr."""
    try:
        _, errors = process.communicate(timeout=LIMIT)
    finally:
        if process.poll() is None:  # it hangs
            os.killpg(process.pid, signal.SIGKILL)
    return process.returncode, errors or ""


def ended(line: list[str], **options: object) -> tuple[int, str]:
    """Run a command to its end; return its status and what it wrote to stderr."""
    return finish(start(line, **options))


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    """Wait until a file exists; fail if the process ends before."""
    end = time.monotonic() + LIMIT
    while not path.exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, f"no {path}"
        time.sleep(0.01)


def left_processes(session: int) -> list[int]:
    """Return the processes that are left in a session."""
    pids = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            pids.append(int(path.parent.name))
    return pids


def require_none_left(session: int, seconds: float = 20.0) -> None:
    """Fail if processes of a session live on; end them."""
    end = time.monotonic() + seconds
    while left_processes(session) and time.monotonic() < end:
        time.sleep(0.05)
    left = left_processes(session)
    for number in left:
        os.kill(number, signal.SIGKILL)
    assert not left


def require_whole_files(directory: Path) -> None:
    """Fail if a file under a final name is half-written."""
    for path in directory.rglob("*"):
        if path.is_file() and not any(part.startswith(".delam_fem-") for part in path.parts):
            check = WHOLE.get(path.name) or WHOLE.get(path.suffix)
            if check is not None:
                try:
                    check(path)
                except Exception as error:
                    raise AssertionError(f"{path.name} is not whole: {error!r}") from error


def periods_kept(directory: Path) -> int:
    """Return the number of periods in the checkpoint of a folder; 0 without one."""
    path = directory / "checkpoint.npz"
    if not path.exists():
        return 0
    with np.load(path) as data:
        return int(data["n_closed"])


def history(directory: Path) -> xr.Dataset:
    """Return the result of a run."""
    return xr.load_dataset(directory / "result.nc", engine="h5netcdf")

"""A run that is ended, starved or not listened to keeps what it has: with real processes."""

from __future__ import annotations

import errno
import os
import pty
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from _pytest.mark import ParameterSet
from attack.processes import (
    CASE,
    LIMIT,
    MPIRUN,
    command,
    ended,
    environment,
    finish,
    history,
    periods_kept,
    require_whole_files,
    start,
    wait_for,
)

import delam_fem as df
from delam_fem.system.files import claimed

POLITE = ("HUP", "INT", "TERM")
"""Signals that end a run after its period, with all results so far."""
DEADLY = ("QUIT", "ILL", "ABRT", "FPE", "KILL", "USR1", "SEGV", "USR2", "ALRM")
"""Signals that end the process at once."""
CLOSED = (">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-", ">/dev/full", "2>/dev/full")
TERMINAL = """
import fcntl, os, signal, sys, termios
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # tests that nohup started would ignore it
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""
"""Program that makes its stdin the controlling terminal of a command."""
LONG = CASE | {"time.periods": 5000}
FEW = {"time.periods": 3, "time.steps_per_period": 20, "output.window_periods": 1}
FIELDLESS = {"output.fields_per_period": 0}


def nightly(*values: object) -> ParameterSet:
    """Return values of a parametrised test that belong to its long form."""
    return pytest.param(*values, marks=pytest.mark.nightly)


def run_line(directory: Path, *options: str, keys: dict[str, object] = CASE) -> list[str]:
    """Return the command of a run that saves a checkpoint after each period."""
    return command("run", "paper", "-o", directory, "--checkpoint-seconds=0", *options, keys=keys)


def require_resumable(directory: Path, tmp_path: Path, keys: dict[str, object]) -> None:
    """Fail if the periods in the checkpoint are not those of an uninterrupted run."""
    k = periods_kept(directory)
    assert k > 0
    case = df.preset("paper", keys)
    result = df.run(case, directory=directory, resume=True, progress=_stop_at_once)
    assert result.history.sizes["period"] > k
    other = df.run(df.preset("paper", keys | {"time.periods": k}))
    strobes = result.history.strobe_displacement[:, :k]
    assert strobes.equals(other.history.strobe_displacement)


def _stop_at_once(done: int, total: int) -> None:
    signal.raise_signal(signal.SIGINT)


@pytest.mark.nightly
@pytest.mark.parametrize("name", POLITE)
def test_polite_signals_end_a_run_that_goes_on(name: str, tmp_path: Path) -> None:
    keys = LONG | FIELDLESS
    process = start(run_line(tmp_path / "run", "-q", keys=keys))
    wait_for(tmp_path / "run" / "checkpoint.npz", process)
    process.send_signal(getattr(signal, f"SIG{name}"))
    status, errors = finish(process)
    assert status == 130, errors
    assert errors.splitlines()[-1].endswith("--resume goes on from there")
    assert "PETSC" not in errors
    assert history(tmp_path / "run").attrs["outcome"] == "interrupted"
    require_whole_files(tmp_path / "run")
    require_resumable(tmp_path / "run", tmp_path, keys)


@pytest.mark.nightly
@pytest.mark.parametrize("name", DEADLY)
def test_deadly_signals_leave_the_checkpoint(name: str, tmp_path: Path) -> None:
    keys = LONG | FIELDLESS
    process = start(run_line(tmp_path / "run", "-q", keys=keys))
    wait_for(tmp_path / "run" / "checkpoint.npz", process)
    process.send_signal(getattr(signal, f"SIG{name}"))
    status, errors = finish(process)
    assert status == -getattr(signal, f"SIG{name}")
    assert "PETSC ERROR" not in errors
    require_whole_files(tmp_path / "run")
    require_resumable(tmp_path / "run", tmp_path, keys)


@pytest.mark.nightly
def test_a_pipe_signal_does_not_end_a_run(tmp_path: Path) -> None:
    process = start(run_line(tmp_path / "run", "-q"))
    wait_for(tmp_path / "run" / "checkpoint.npz", process)
    process.send_signal(signal.SIGPIPE)
    assert finish(process) == (0, "")
    assert history(tmp_path / "run").attrs["outcome"] == "completed"


@pytest.mark.nightly
def test_nohup_keeps_a_run_alive(tmp_path: Path) -> None:
    process = start(["nohup", *run_line(tmp_path / "run", "-q")], stdin=subprocess.DEVNULL)
    wait_for(tmp_path / "run" / "checkpoint.npz", process)
    process.send_signal(signal.SIGHUP)
    assert finish(process)[0] == 0


@pytest.mark.nightly
def test_nobody_reads_the_output(tmp_path: Path) -> None:
    """`run … 2>&1 | head -1`: the reader goes away after the first line."""
    ends = os.pipe()
    line = run_line(tmp_path / "run", keys=CASE | FIELDLESS)
    process = start(line, stdout=ends[1], stderr=ends[1])
    os.close(ends[1])
    assert os.read(ends[0], 1)
    os.close(ends[0])
    assert process.wait(timeout=LIMIT) == 0
    assert history(tmp_path / "run").attrs["outcome"] == "completed"
    assert not (tmp_path / "run" / "checkpoint.npz").exists()


@pytest.mark.nightly
@pytest.mark.parametrize(
    "closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-", ">/dev/full", "2>/dev/full"]
)
def test_closed_and_full_streams(closed: str, tmp_path: Path) -> None:
    line = " ".join(run_line(tmp_path / "run", keys=CASE | FIELDLESS))
    done = subprocess.run(["sh", "-c", f"exec {line} {closed}"], env=environment(), timeout=LIMIT)
    assert done.returncode == 0
    require_whole_files(tmp_path / "run")
    assert history(tmp_path / "run").attrs["outcome"] == "completed"


@pytest.mark.slow
def test_the_terminal_is_closed(tmp_path: Path) -> None:
    """The kernel sends SIGHUP, and every later write fails."""
    controller, terminal = pty.openpty()
    line = [sys.executable, "-c", TERMINAL, *run_line(tmp_path / "run", keys=LONG | FIELDLESS)]
    process = start(line, stdin=terminal, stdout=terminal, stderr=terminal)
    os.close(terminal)
    wait_for(tmp_path / "run" / "checkpoint.npz", process)
    os.close(controller)
    assert process.wait(timeout=LIMIT) == 130
    require_whole_files(tmp_path / "run")
    require_resumable(tmp_path / "run", tmp_path, LONG | FIELDLESS)


def listening(process: int) -> list[str]:
    """Return the addresses on which a process listens."""
    owned = set()
    for path in Path(f"/proc/{process}/fd").iterdir():
        try:
            owned.add(os.readlink(path))
        except OSError as error:
            if error.errno != errno.ENOENT:
                raise
    addresses = []
    for name in ("tcp", "tcp6", "udp", "udp6"):
        rows = Path(f"/proc/net/{name}").read_text().splitlines()[1:]
        addresses += [row.split()[1] for row in rows if f"socket:[{row.split()[9]}]" in owned]
    return addresses


@pytest.mark.slow
def test_a_run_holds_its_folder_and_opens_no_socket(tmp_path: Path) -> None:
    line = run_line(tmp_path / "run", "--overwrite", keys=LONG | FIELDLESS)
    first = start(line)
    wait_for(tmp_path / "run" / "checkpoint.npz", first)
    try:
        assert listening(first.pid) == []
        status, errors = ended(line)
        assert (status, len(errors.splitlines())) == (2, 1)
        assert "another process is writing there" in errors
    finally:
        first.kill()
        first.communicate()
    with claimed(tmp_path / "run", may_hold_results=True):  # the lock has ended with the process
        assert periods_kept(tmp_path / "run") > 0


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({}, 0),
        pytest.param({"mesh.elements": -1}, 2, marks=pytest.mark.nightly),
        pytest.param(
            {"excitation.amplitude": 50.0, "time.periods": 40}, 1, marks=pytest.mark.nightly
        ),
    ],
)
def test_two_ranks_end(keys: dict[str, object], expected: int, tmp_path: Path) -> None:
    mpirun = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", "2"]
    begin = time.monotonic()
    status, errors = ended(
        [
            *mpirun,
            *run_line(tmp_path / "run", "-q", "--no-figures", keys=CASE | FIELDLESS | FEW | keys),
        ]
    )
    assert status == expected, errors
    assert time.monotonic() - begin < LIMIT
    assert (tmp_path / "run" / "summary.json").exists() == (expected != 2)
    assert not (tmp_path / "run" / "checkpoint.npz").exists()


@pytest.mark.mpi
@pytest.mark.nightly
def test_an_error_on_one_rank_ends_all(tmp_path: Path) -> None:
    script = tmp_path / "one.py"
    script.write_text(
        "from delam_fem.cli import run\n"
        "from delam_fem.cli.app import app\n"
        "def failing(*given): raise OSError(28, 'No space left on device', 'x.nc')\n"
        "run._saved = failing\n"
        f"app({run_line(tmp_path / 'run', '-q', keys=CASE | FEW)[3:]!r})\n"
    )
    status, errors = ended([*MPIRUN, sys.executable, str(script)])
    assert status == 1
    assert "delam-fem: x.nc: No space left on device" in errors
    assert periods_kept(tmp_path / "run") == FEW["time.periods"]


WITHIN = """
from delam_fem.system.mpi import MPI
from delam_fem.engines.petsc.theta import MoreauJean

computed, steps = MoreauJean.advance, []


def advance(stepper):
    steps.append(None)
    if len(steps) > 150 and MPI.COMM_WORLD.rank == 1:
        raise RuntimeError("rank one is lost")
    return computed(stepper)


MoreauJean.advance = advance
"""
"""A step fails on one of two ranks while the other goes on and waits for it."""
KEYS = {"mesh.elements": 6, "time.periods": 2}


@pytest.mark.mpi
@pytest.mark.parametrize("way", [nightly("command"), "script"])
def test_an_error_within_a_step_of_one_rank_ends_all(way: str, tmp_path: Path) -> None:
    command = ["delam-fem", "run", "default", "-q", "-o", str(tmp_path / "run")]
    command += [f"--set={key}={value}" for key, value in KEYS.items()]
    ways = {
        "command": f"import sys\nfrom delam_fem.cli.app import app\nsys.argv = {command!r}\napp()",
        "script": f"import delam_fem as df\ndf.run(df.preset('default', {KEYS!r}), "
        "comm=MPI.COMM_WORLD)",
    }
    script = tmp_path / "one.py"
    script.write_text(f"{WITHIN}\n{ways[way]}\n")
    status, errors = ended([*MPIRUN, sys.executable, str(script)])
    assert status == 1
    assert "RuntimeError: rank one is lost" in errors


TWICE = """
import delam_fem as df
from delam_fem.system.mpi import MPI, start_petsc

start_petsc()
keys = {"model.kind": "plane-stress", "mesh.elements": 4, "time.periods": 1}
case = df.preset("paper", keys | {"time.steps_per_period": 50, "output.window_periods": 1})
for comm in (MPI.COMM_WORLD.Split(MPI.COMM_WORLD.rank // 2), MPI.COMM_WORLD):
    df.run(case, comm=comm)
"""


@pytest.mark.mpi
@pytest.mark.nightly
def test_runs_on_two_communicators_end(tmp_path: Path) -> None:
    script = tmp_path / "twice.py"
    script.write_text(TWICE)
    status, errors = ended([*MPIRUN[:-1], "3", sys.executable, str(script)])
    assert status == 0, errors

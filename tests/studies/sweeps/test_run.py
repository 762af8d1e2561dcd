"""Sweeps from end to end, on small cases: what is computed, kept, resumed and survived."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

import delam_fem as df
from delam_fem import Sweep, run_sweep
from delam_fem.api import CaseError, assemble
from delam_fem.studies.executors import Serial
from delam_fem.studies.sweeps import schedule
from delam_fem.studies.sweeps.dataset import open_result
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.journal import MARK, Journal, framed, payloads, unpacked

FRAME = len(framed(b""))
"""Bytes of a record before its content."""
SMALL = {
    "mesh.elements": 3,
    "time.steps_per_period": 40,
    "time.periods": 8,
    "output.window_periods": 4,
    "output.fields_per_period": 20,
}
FREQUENCY = {"key": "excitation.frequency", "start": 3.0, "stop": 4.0, "count": 4}
UNSTABLE = {"key": "time.scheme", "values": ["newmark", "central-difference"]}
"""Forty steps a period are too few for the central difference: its points fail."""
FILES = [".delam_fem.txt", "case.toml", "sweep.json", "sweep.nc", "sweep.toml"]
ATTEMPTS = 5
WAIT = 600.0
"""Longest time that a process may take to show what is waited for [s]."""


def small(*axes: dict[str, object], **keys: object) -> Sweep:
    data = {"name": "s", "base": "paper", "engine": "petsc", "set": SMALL, **keys}
    return sweep_of({**data, "axis": list(axes or (FREQUENCY,))})


def same(a: xr.Dataset, b: xr.Dataset) -> bool:
    """Say whether all variables and coordinates are equal bit by bit."""
    return bool(a.drop_attrs().identical(b.drop_attrs()))


def test_a_point_is_the_run_of_its_case(tmp_path: Path) -> None:
    record = {"strobes": 5, "harmonics": 3, "energies": True, "node_distortion": True}
    made = small(record=record)
    data = run_sweep(made, tmp_path, "serial")
    case = made.case(2)
    result = df.run(case, "petsc", structure=assemble(case, needs_dolfinx=False))
    point, history = data.isel(frequency=2), result.history
    for name in ("tip_min", "tip_max", "thd", "minimum_tip_gap", "impacts_per_period"):
        assert np.array_equal(point[name], result.summary[name]), name
    assert np.array_equal(point.strobe_displacement, history.strobe_displacement[:, -5:])
    assert np.array_equal(point.strobe_velocity, history.strobe_velocity[:, -5:])
    assert float(point.energy_base_work) == float(history.energy_base_work[-4:].mean())
    assert np.array_equal(point.x, history.x)
    # the harmonics below half the number of frames carry nearly all of the distortion
    assert point.node_thd[:, -1].to_numpy() == pytest.approx(result.summary["thd"], rel=0.05)
    assert np.isnan(point.node_thd[:, 0]).sum() == 0
    assert float(point.harmonic_amplitude[0, 0]) > float(point.harmonic_amplitude[0, 1])


def test_the_dataset_describes_itself(tmp_path: Path) -> None:
    data = run_sweep(small(FREQUENCY, UNSTABLE), tmp_path, "serial")
    assert data.tip_amplitude.dims == ("frequency", "scheme", "lamina")
    assert data.frequency.attrs == {
        "units": "Hz",
        "long_name": "excitation frequency",
        "key": "excitation.frequency",
    }
    assert [name for name in data.data_vars if "long_name" not in data[name].attrs] == []
    numeric = [name for name in data.data_vars if data[name].dtype.kind == "f"]
    assert [name for name in numeric if "units" not in data[name].attrs] == []
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES
    again = df.load_sweep(tmp_path / "sweep.toml")
    assert again.identity == small(FREQUENCY, UNSTABLE).identity


def test_points_that_fail_are_recorded_and_the_rest_goes_on(tmp_path: Path) -> None:
    data = run_sweep(small(FREQUENCY, UNSTABLE), tmp_path, "serial")
    assert data.attrs["n_completed"] == data.attrs["n_failed"] == 4
    failed = data.sel(scheme="central-difference")
    assert (failed.outcome == "failed").all()
    assert all("the scheme needs a time step" in str(e) for e in failed.error.values)
    assert np.isnan(failed.tip_min).all()
    good = data.sel(scheme="newmark")
    assert (good.outcome == "completed").all() and (good.error == "").all()
    assert np.isfinite(good.tip_min).all()


def test_a_point_that_diverges_is_told_with_its_time(tmp_path: Path) -> None:
    # a base that moves by metres leaves the bound of ten lengths
    amplitude = {"key": "excitation.amplitude", "values": [0.0025, 100.0]}
    data = run_sweep(small(amplitude), tmp_path, "serial")
    assert data.outcome.values.tolist() == ["completed", "diverged"]
    assert str(data.error.values[1]).startswith("diverged at t = ")
    assert data.attrs["n_diverged"] == 1


def test_continuation_carries_the_state(tmp_path: Path) -> None:
    made = small(order="both")
    data = run_sweep(made, tmp_path, "serial")
    assert data.direction.values.tolist() == ["up", "down"]
    for direction, order in (("up", (0, 1, 2, 3)), ("down", (7, 6, 5, 4))):
        state = None
        for index in order:
            case = made.case(index)
            model = assemble(case, needs_dolfinx=False)
            result = df.run(case, "petsc", structure=model, initial=state)
            state = result.state
            point = data.sel(direction=direction).isel(frequency=index % 4)
            assert np.array_equal(point.tip_max, result.summary["tip_max"])


def test_the_last_good_state_goes_on_past_a_point_that_fails(tmp_path: Path) -> None:
    steps = {"key": "time.steps_per_period", "values": [40, 41, 42], "name": "steps"}
    scheme = {"key": "time.scheme", "values": ["newmark", "central-difference", "newmark"]}
    data = run_sweep(small(steps, scheme, combine="zip", order="up"), tmp_path / "a", "serial")
    assert data.outcome.values.tolist() == ["completed", "failed", "completed"]
    two = {"key": "time.steps_per_period", "values": [40, 42], "name": "steps"}
    without = run_sweep(small(two, order="up"), tmp_path / "b", "serial")
    assert np.array_equal(data.tip_max[[0, 2]], without.tip_max)


def test_initial_conditions_are_an_axis(tmp_path: Path) -> None:
    thick = {"key": "initial.thick.displacement", "values": [0.0, 0.02]}
    set_ = {**SMALL, "contact.law": "none", "excitation.amplitude": 0.0}
    data = run_sweep(small(thick, set=set_), tmp_path, "serial")
    assert data.tip_max.values[0].tolist() == [0.0, 0.0]
    moved = data.isel(thick_displacement=1)
    assert 0.01 < float(moved.tip_amplitude[0]) < 0.02
    assert float(moved.tip_amplitude[1]) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("order", [pytest.param("independent", marks=pytest.mark.nightly), "both"])
def test_workers_give_what_one_process_gives(tmp_path: Path, order: str) -> None:
    made = small({**FREQUENCY, "count": 12}, order=order)
    one = run_sweep(made, tmp_path / "1", "serial")
    two = run_sweep(made, tmp_path / "2", "process", workers=2)
    assert same(one, two)
    assert two.attrs["workers"] == 2


def test_any_executor_will_do(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as executor:
        dataset = run_sweep(small(), tmp_path / "1", executor)
    assert dataset.attrs["workers"] == 1
    assert same(dataset, run_sweep(small(), tmp_path / "2", Serial()))


def test_a_dask_client_is_an_executor(tmp_path: Path) -> None:
    distributed = pytest.importorskip(
        "distributed", reason="Dask is optional: pip install delam_fem[dask]"
    )
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        dataset = run_sweep(small(), tmp_path / "1", client.get_executor())
    assert same(dataset, run_sweep(small(), tmp_path / "2", "serial"))


def test_progress_counts_points(tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    run_sweep(small(), tmp_path, "serial", progress=lambda *now: calls.append(now))
    assert calls[0] == (0, 4) and calls[-1] == (4, 4)
    assert calls == sorted(calls)


def test_a_finished_sweep_is_read_and_another_is_not_taken_for_it(tmp_path: Path) -> None:
    run_sweep(small(), tmp_path, "serial").close()
    before = (tmp_path / "sweep.nc").stat().st_mtime_ns
    run_sweep(small(), tmp_path, "serial", resume=True).close()
    assert (tmp_path / "sweep.nc").stat().st_mtime_ns == before
    with pytest.raises(CaseError, match=r"belongs to another .*record.strobes"):
        run_sweep(small(record={"strobes": 1}), tmp_path, "serial", resume=True)


@pytest.mark.parametrize(("key", "is_same"), [('motion = "lateral"\n', True), ("width", False)])
def test_a_sweep_goes_on_if_its_case_lacks_a_default(
    key: str, is_same: bool, tmp_path: Path
) -> None:
    made = small()
    identity = made.identity.replace(json.dumps(key)[1:-1], "" if is_same else "length")
    assert identity != made.identity
    interrupted(made, tmp_path)
    part = next((tmp_path / "sweep.journal").glob("*.points"))
    about = json.loads(part.read_bytes()[FRAME:].split(MARK)[0])
    assert about["identity"] == made.identity
    first = framed(json.dumps(about).encode())
    changed = framed(json.dumps({**about, "identity": identity}).encode())
    assert part.read_bytes().startswith(first)
    part.write_bytes(changed + part.read_bytes()[len(first) :])
    counts: list[int] = []
    with nullcontext() if is_same else pytest.raises(CaseError, match="belongs to another"):
        run_sweep(
            made, tmp_path, "serial", resume=True, progress=lambda done, _: counts.append(done)
        )
    assert not is_same or counts[0] > 0
    if is_same:  # and so the whole result
        with h5py.File(tmp_path / "sweep.nc", "a") as file:
            file.attrs["identity"] = identity
        before = (tmp_path / "sweep.nc").stat().st_mtime_ns
        run_sweep(made, tmp_path, "serial", resume=True).close()
        assert (tmp_path / "sweep.nc").stat().st_mtime_ns == before


def interrupted(made: Sweep, directory: Path) -> None:
    """Leave the journal of a sweep that was stopped after its first points."""

    class Enough(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done:
            raise Enough

    with pytest.raises(Enough):
        run_sweep(made, directory, "serial", progress=stop)


def test_an_unfinished_sweep_is_not_lost_by_mistake(tmp_path: Path) -> None:
    interrupted(small(), tmp_path)
    with pytest.raises(CaseError, match=r"holds \d points of an unfinished sweep; .* --resume"):
        run_sweep(small(), tmp_path, "serial")
    with pytest.raises(CaseError, match=r"belongs to another .*record.strobes: .* 1 here"):
        run_sweep(small(record={"strobes": 1}), tmp_path, "serial", resume=True)
    resumed = run_sweep(small(), tmp_path, "serial", resume=True)
    assert same(resumed, run_sweep(small(), tmp_path / "whole", "serial"))


@pytest.mark.parametrize("after", [0, 1, 4])
def test_a_sweep_whose_folder_is_deleted_says_so_and_stops(
    after: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, counts = tmp_path / "out", list[int]()

    def delete(done: int, total: int) -> None:
        counts.append(done)
        if done >= after:
            shutil.rmtree(folder, ignore_errors=True)

    monkeypatch.setattr(schedule, "CHUNK_SECONDS", 0.0)  # one point each, however fast they are
    values = np.linspace(3.0, 4.0, 40).tolist()
    made = small({"key": "excitation.frequency", "values": values}, order="up")
    with pytest.raises(FileNotFoundError, match="was deleted while the sweep was computed"):
        run_sweep(made, folder, "serial", progress=delete)
    assert counts[-1] < 40
    assert not folder.exists()


def test_a_track_goes_on_with_all_that_its_state_has(tmp_path: Path) -> None:
    """The compiled engine has unknowns of its own, and energies count from the first point on."""
    amplitude = {"key": "excitation.amplitude", "values": [1e-4, 2e-4, 3e-4, 4e-4]}
    short = SMALL | {"mesh.elements": 10, "time.steps_per_period": 100}
    made = small(amplitude, base="embedded", order="up", engine="compiled", set=short)
    interrupted(made, tmp_path)
    with Journal(tmp_path / "sweep.journal", made.identity, resume=True) as journal:
        with journal.merged() as merged:
            n_done, state = merged.reached(made.tracks[0], 0)
    assert 0 < n_done < 4 and state is not None and state.internal is not None
    resumed = run_sweep(made, tmp_path, "serial", resume=True)
    assert same(resumed, run_sweep(made, tmp_path / "whole", "serial"))


def test_a_journal_has_one_writer(tmp_path: Path) -> None:
    path = tmp_path / "sweep.journal"
    with Journal(path, "one", resume=False):
        with pytest.raises(CaseError, match="is another process computing this sweep"):
            Journal(path, "one", resume=True, patience=0.0)
    Journal(path, "one", resume=True).close()


def test_a_file_that_is_no_journal_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sweep.journal"
    path.write_text("the journal of an older version was a file")
    with pytest.raises(CaseError, match="expected the journal of a sweep, a folder"):
        Journal(path, "one", resume=True)


SWEEP_TOML = """
base = "paper"
engine = "petsc"
order = "{order}"
[set]
mesh.elements = 3
time.steps_per_period = 40
time.periods = {periods}
output.fields_per_period = 20
[[axis]]
key = "excitation.frequency"
start = 3.0
stop = 4.0
count = 30
[[axis]]
key = "time.scheme"
values = ["newmark", "central-difference"]
"""


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "delam_fem", "sweep", *(str(a) for a in arguments)]


def count_in_journal(path: Path) -> int:
    """Return the points in a journal that another process may be writing."""
    parts = [part.read_bytes() for part in path.glob("*.points")]
    chunks = (unpacked(part, start) for part in parts for start, _ in list(payloads(part))[1:])
    return sum(chunk.indices.size for chunk in chunks)


def started(file: Path, directory: Path) -> subprocess.Popen[bytes]:
    """Start a sweep in a process of its own and return when some points are in its journal, or all.

    On a busy machine the sweep may end before anybody has looked.
    """
    process = subprocess.Popen(
        command(file, "-o", directory, "-j", 2, "-q"),
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    end = time.monotonic() + WAIT
    while count_in_journal(directory / "sweep.journal") < 4 and process.poll() is None:
        assert time.monotonic() < end
        time.sleep(0.02)
    return process


def stopped(file: Path, directory: Path, number: int) -> tuple[int, str]:
    """Start a sweep and stop it among its points by a signal; return its status and message."""
    for _ in range(ATTEMPTS):
        process = started(file, directory)
        workers = children(process.pid) if process.poll() is None else []
        process.send_signal(number)
        _, message = process.communicate(timeout=WAIT)
        assert ended(workers), "workers outlived the sweep"
        if process.returncode:
            return process.returncode, message.decode()
        shutil.rmtree(directory)  # it was faster
    raise AssertionError("the sweep ended before it could be stopped")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "number", "status"),
    [
        pytest.param("independent", signal.SIGKILL, -9, marks=pytest.mark.nightly),
        pytest.param("both", signal.SIGKILL, -9, marks=pytest.mark.nightly),
        ("up", signal.SIGINT, 130),
    ],
)
def test_a_stopped_sweep_goes_on_to_the_same_dataset(
    tmp_path: Path, order: str, number: int, status: int
) -> None:
    file = tmp_path / "frequencies.toml"
    file.write_text(SWEEP_TOML.format(order=order, periods=150))
    exit_status, message = stopped(file, tmp_path / "stopped", number)
    assert exit_status == status
    if number == signal.SIGINT:
        assert "--resume goes on" in message
    sweep = df.load_sweep(file)
    resumed = run_sweep(sweep, tmp_path / "stopped", "serial", resume=True)
    assert same(resumed, run_sweep(sweep, tmp_path / "whole", "serial"))
    assert sorted(path.name for path in (tmp_path / "stopped").iterdir()) == FILES


def children(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    path = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(child) for child in path.read_text().split()]


def ended(pids: list[int]) -> bool:
    """Wait until processes have ended; a zombie has."""
    end = time.monotonic() + WAIT
    while time.monotonic() < end:
        if not any(is_alive(pid) for pid in pids):
            return True
        time.sleep(0.05)
    return False


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("n_ranks", [pytest.param(2, marks=pytest.mark.nightly), 3])
def test_ranks_of_mpi_give_what_one_process_gives(tmp_path: Path, n_ranks: int) -> None:
    file = tmp_path / "frequencies.toml"
    file.write_text(SWEEP_TOML.format(order="independent", periods=4))
    _, *arguments = command(file, "-o", tmp_path / "ranks")
    mpiexec = ["mpiexec", "--allow-run-as-root", "--oversubscribe", "-n", str(n_ranks)]
    run = [*mpiexec, sys.executable, "-m", "mpi4py.futures", *arguments]
    # without the variables that an MPI in this process has put into its environment unseen
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(run, timeout=2 * WAIT, capture_output=True, text=True, env=environment)
    assert done.returncode == 1, done.stderr  # 30 points need shorter steps
    ranks = open_result(tmp_path / "ranks" / "sweep.nc")
    assert ranks.attrs["n_failed"] == 30
    assert ranks.attrs["workers"] == n_ranks - 1
    assert same(ranks, run_sweep(df.load_sweep(file), tmp_path / "one", "serial"))


@pytest.mark.parametrize("n_points", [120, pytest.param(1500, marks=pytest.mark.nightly)])
def test_many_points_make_few_files_and_no_memory(tmp_path: Path, n_points: int) -> None:
    amplitude = {"key": "excitation.amplitude", "start": 1e-3, "stop": 2e-3, "count": n_points}
    tiny = {"mesh.elements": 2, "time.steps_per_period": 4, "time.periods": 1}
    made = small(amplitude, set=SMALL | tiny | {"output.fields_per_period": 0})
    files: set[str] = set()
    memory: list[int] = []

    def look(done: int, total: int) -> None:
        files.update(path.name for path in tmp_path.iterdir())
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        memory.append(pages * os.sysconf("SC_PAGE_SIZE"))

    data = run_sweep(made, tmp_path, "serial", progress=look)
    assert data.attrs["n_completed"] == n_points
    assert len(files) <= 4  # case, sweep, journal and list
    assert memory[-1] - memory[len(memory) // 4] < 10e6  # of three quarters of the points

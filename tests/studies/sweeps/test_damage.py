"""Damaged journals and results: a message, or the damaged points anew; never a wrong number."""

import errno
import fcntl
import os
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from delam_fem import run_sweep
from delam_fem.api import CaseError, State
from delam_fem.studies.sweeps.dataset import open_result
from delam_fem.studies.sweeps.journal import Journal
from delam_fem.studies.sweeps.point import Chunk, ChunkResult, Point

ROW = np.arange(3.0)
STATE = State(np.ones((3, 2)), np.array([True]))


def journal_with(path: Path, n_chunks: int, identity: str = "sweep") -> Path:
    """Write a journal with chunks of two points of a track; return its part file."""
    with Journal(path, identity, resume=False) as journal:
        for k in range(n_chunks):
            points = tuple(Point(i, "completed", "", ROW + i) for i in (2 * k, 2 * k + 1))
            state = State(STATE.motion * (2 * k + 2), STATE.resting, (0.5, 0.25), STATE.motion[0])
            journal.add([ChunkResult(Chunk(0, (2 * k, 2 * k + 1)), points, state, 1.0, 0.0)])
    (part,) = path.glob("*.points")
    return part


def flipped(path: Path, value: float) -> None:
    """Change a bit of the first number with a value."""
    content = bytearray(path.read_bytes())
    content[content.index(np.array([value]).tobytes())] ^= 1
    path.write_bytes(content)


def test_a_damaged_chunk_is_computed_anew(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    part = journal_with(tmp_path / "sweep.journal", 4)
    flipped(part, 5.0)  # in the rows of the points 3, 4 and 5; the first is that of 3
    with Journal(tmp_path / "sweep.journal", "sweep", resume=True) as journal:
        with journal.merged() as merged:
            assert merged.numbers.tolist() == [0, 1, 4, 5, 6, 7]
            block = merged.block(1, 6, 3)
            assert block.numbers.tolist() == [1, 4, 5]
            assert block.rows.tolist() == [[1, 2, 3], [4, 5, 6], [5, 6, 7]]
            n_done, state = merged.reached(np.arange(9), 0)
    assert n_done == 2 and state is not None
    assert (state.motion == 2.0).all() and state.losses == (0.5, 0.25)
    assert state.internal is not None and (state.internal == 1.0).all()
    assert "damaged bytes; the points in them are computed anew" in caplog.text


@pytest.mark.parametrize("cut", [0.001, 0.1, 0.5, 0.9])
def test_a_torn_end_is_ignored(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, cut: float
) -> None:
    part = journal_with(tmp_path / "sweep.journal", 200)
    content = part.read_bytes()
    part.write_bytes(content[: int(cut * len(content))])
    with Journal(tmp_path / "sweep.journal", "sweep", resume=True) as journal:
        with journal.merged() as merged:
            n = merged.numbers.size
            assert abs(n - cut * 400) < 6 and merged.numbers.tolist() == list(range(n))
    assert not caplog.text


def test_chunks_without_their_first_record_belong_to_no_sweep(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    part = journal_with(tmp_path / "sweep.journal", 3)
    content = part.read_bytes()
    part.write_bytes(content.replace(b'"identity"', b'"idemtity"'))
    with Journal(tmp_path / "sweep.journal", "sweep", resume=True) as journal:
        with journal.merged() as merged:
            assert merged.numbers.size == 0
    assert "damaged bytes" in caplog.text


def test_other_versions_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "sweep.journal"
    with monkeypatch.context() as old:
        old.setattr("delam_fem.studies.sweeps.journal.versions", lambda: {"delam_fem": "0.0.1"})
        journal_with(path, 1)
    with Journal(path, "sweep", resume=True) as journal, journal.merged() as merged:
        assert merged.numbers.size == 2
    assert "was begun with delam_fem 0.0.1; its points are kept" in caplog.text


def test_the_part_of_another_sweep_is_refused(tmp_path: Path) -> None:
    journal_with(tmp_path / "sweep.journal", 1, "another")
    with pytest.raises(CaseError, match="belongs to another"):
        Journal(tmp_path / "sweep.journal", "sweep", resume=True)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of a small sweep."""
    from delam_fem.studies.sweeps.grid import sweep_of

    small = {"mesh.elements": 2, "time.steps_per_period": 40, "time.periods": 4}
    small["output.fields_per_period"] = 0
    axis = {"key": "excitation.frequency", "values": [3.0, 3.5]}
    sweep = sweep_of({"name": "s", "base": "paper", "set": small, "axis": [axis]})
    folder = tmp_path_factory.mktemp("sweep")
    run_sweep(sweep, folder, "serial").close()
    return folder / "sweep.nc"


def test_a_changed_value_is_noticed(result: Path, tmp_path: Path) -> None:
    content = bytearray(result.read_bytes())
    with xr.open_dataset(result, engine="h5netcdf") as data:
        place = content.index(data["strobe_displacement"].to_numpy().tobytes())
    content[place + 3] ^= 1
    path = tmp_path / "sweep.nc"
    path.write_bytes(content)
    with pytest.raises(CaseError, match="damaged or another one"):
        open_result(path, is_loaded=True)


@pytest.mark.parametrize("content", [b"", b"no dataset", None])
def test_another_file_is_refused(result: Path, tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "sweep.nc"
    complete_bytes = result.read_bytes()
    path.write_bytes(complete_bytes[: len(complete_bytes) // 2] if content is None else content)
    with pytest.raises(CaseError, match="expected the result of a sweep"):
        open_result(path)


def test_the_dataset_of_another_program_is_refused(tmp_path: Path) -> None:
    xr.Dataset({"t": ("x", [1.0])}).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    with pytest.raises(CaseError, match="expected the result of a sweep"):
        open_result(tmp_path / "a.nc")


def test_a_file_system_without_locks_takes_a_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(handle: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)
    part = journal_with(tmp_path / "sweep.journal", 1)
    assert part.name.startswith("1-of-1.")

"""Damaged journals and results: a message, or the damaged points anew; never a wrong number."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from delam_fem.case.toml import CaseError
from delam_fem.simulation.loop import State
from delam_fem.studies.sweeps.journal import Journal
from delam_fem.studies.sweeps.point import Chunk, Done, Point
from delam_fem.studies.sweeps.reading import open_result
from delam_fem.studies.sweeps.run import run_sweep
from delam_fem.studies.sweeps.waiting import Waiting

ROW = np.arange(3.0)
STATE = State(np.ones((3, 2)), np.array([True]))


def journal_with(path: Path, n_points: int) -> None:
    """Write a journal with points and the state of a track."""
    with Journal(path, "sweep", resume=False) as journal:
        points = tuple(Point(k, "completed", "", ROW + k) for k in range(n_points))
        journal.add([Done(Chunk(0, tuple(range(n_points))), points, STATE, 1.0, 0.0)])


def change(path: Path, statement: str) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute(statement)
    connection.close()


def test_a_damaged_point_is_computed_anew(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "sweep.journal"
    journal_with(path, 4)
    change(path, "UPDATE point SET row = zeroblob(24) WHERE number = 2")
    with Journal(path, "sweep", resume=True) as journal:
        assert list(journal.numbers()) == [0, 1, 3]
        assert [p.row.tolist() for p in journal.points(1, 4)] == [[1, 2, 3], [3, 4, 5]]
    assert "1 damaged points are computed anew" in caplog.text


def test_a_damaged_state_is_not_gone_on_from(tmp_path: Path) -> None:
    path = tmp_path / "sweep.journal"
    journal_with(path, 2)
    change(path, "UPDATE track SET resting = zeroblob(1)")
    with pytest.raises(CaseError, match="damaged or another one"):
        Journal(path, "sweep", resume=True)


def test_other_versions_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "sweep.journal"
    journal_with(path, 2)
    change(path, "UPDATE about SET versions = 'delam_fem 0.0.1'")
    with Journal(path, "sweep", resume=True) as journal:
        assert journal.n_points == 2
    assert "was begun with delam_fem 0.0.1; its points are kept" in caplog.text


@pytest.mark.parametrize("cut", [0.1, 0.5, 0.9])
def test_a_truncated_journal_is_refused(tmp_path: Path, cut: float) -> None:
    path = tmp_path / "sweep.journal"
    journal_with(path, 400)
    content = path.read_bytes()
    path.write_bytes(content[: int(cut * len(content))])
    with pytest.raises(CaseError, match="damaged or another one"):
        Journal(path, "sweep", resume=True)


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
    whole = result.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content is None else content)
    with pytest.raises(CaseError, match="expected the result of a sweep"):
        open_result(path)


def test_the_dataset_of_another_program_is_refused(tmp_path: Path) -> None:
    xr.Dataset({"t": ("x", [1.0])}).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    with pytest.raises(CaseError, match="expected the result of a sweep"):
        open_result(tmp_path / "a.nc")


def test_waiting_points_are_ranges() -> None:
    waiting = Waiting.all_but([0, 1, 5], 100_000_000)
    assert len(waiting) == 100_000_000 - 3
    assert waiting.take(5) == (2, 3, 4, 6, 7)
    waiting.put_back((6, 7))
    assert (len(waiting), waiting.take(3)) == (100_000_000 - 6, (6, 7, 8))
    rest = Waiting([np.array([4, 2]), range(7, 8)])
    assert (rest.take(9), len(rest), rest.take(1)) == ((4, 2, 7), 0, ())

"""What belongs to somebody else stays as it is: links, folders and files with the names of ours."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from support import invoke
from synthetic import small_case, synthetic_history

from delam_fem.api import CaseError, atomic, remove_kept, save_case, write_dataset, write_json
from delam_fem.results.diagnostics import summary
from delam_fem.results.export import export
from delam_fem.simulation.checkpoint import of_study
from delam_fem.system.files import OUTPUTS, PREFIX, claimed


def told(*line: str) -> str:
    """Call a command that must be refused; return what it says."""
    done = invoke(*line)
    assert done.exit_code == 2, done.output
    return str(done.output)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Return the folder of a run."""
    case = small_case()
    history = synthetic_history(case)
    folder = tmp_path / "run"
    save_case(case, folder)
    write_dataset(history, folder / "result.nc")
    write_json(folder / "summary.json", summary(history, case))
    return folder


@pytest.mark.parametrize("name", ["figures", "fields", "checkpoints", "points"])
def test_a_link_in_an_output_folder_is_not_followed(tmp_path: Path, name: str) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "fields_00.vtu").write_text("mine")
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / name).symlink_to(other)
    with pytest.raises(CaseError, match=f"{name} is a link"):
        with claimed(folder, may_hold_results=True):
            raise AssertionError
    assert (other / "fields_00.vtu").read_text() == "mine"


def test_show_page_does_not_follow_links(run: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (run / "figures").symlink_to(other)
    assert told("show", "page", str(run)).count("figures")
    assert not list(other.iterdir())


def test_a_loop_of_links_in_an_output_folder_is_told(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(CaseError, match="not empty"):
        with claimed(tmp_path):
            raise AssertionError
    with claimed(tmp_path, inputs=[tmp_path / "a"], may_hold_results=True):
        pass


@pytest.mark.parametrize("name", ["checkpoints", "points"])
def test_a_folder_of_the_user_is_not_removed(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    folder.mkdir()
    (folder / "mine.npz").write_bytes(b"mine")
    with pytest.raises(CaseError, match=name):
        remove_kept(folder)
    assert (folder / "mine.npz").read_bytes() == b"mine"


def test_what_a_user_put_among_checkpoints_stays(tmp_path: Path) -> None:
    with of_study(tmp_path, "question", resume=False) as folder:
        (folder / "state.npz").touch()
        (folder / "notes.txt").write_text("mine")
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]
    with pytest.raises(CaseError, match=r"notes\.txt"):
        remove_kept(folder)


@pytest.mark.parametrize("to", ["csv", "mat", "uff"])
def test_an_export_replaces_nothing_unasked(run: Path, tmp_path: Path, to: str) -> None:
    path = tmp_path / f"tips.{to}"
    path.write_text("mine")
    line = ["show", "export", str(run), "--to", to, "-o", str(path)]
    assert "--overwrite" in told(*line)
    assert path.read_text() == "mine"
    assert invoke(*line, "--overwrite").exit_code == 0
    assert path.read_bytes() != b"mine"


def test_a_file_beside_an_export_counts(run: Path, tmp_path: Path) -> None:
    (tmp_path / "tips-periods.csv").write_text("mine")
    line = ["show", "export", str(run), "--to", "csv", "-o", str(tmp_path / "tips.csv")]
    assert "tips-periods.csv" in told(*line)
    assert not (tmp_path / "tips.csv").exists()


def test_operators_replace_nothing_unasked(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    path.write_text("mine")
    line = ["show", "operators", "paper", "--set", "mesh.elements=3", "-o", str(path)]
    assert "--overwrite" in told(*line)
    assert path.read_text() == "mine"
    assert invoke(*line, "--overwrite").exit_code == 0


def test_many_write_one_file_at_once(tmp_path: Path) -> None:
    case = small_case()
    history = synthetic_history(case)
    path = tmp_path / "a.csv"
    errors: list[BaseException] = []

    def write() -> None:
        try:
            export(history, case, "csv", path)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=write) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert not list(tmp_path.glob(f"{PREFIX}*"))
    lines = path.read_text().splitlines()
    assert len(lines) == 1 + history.sizes["time"]


def test_two_blocks_of_one_process_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with atomic(path) as first, atomic(path) as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first"  # its block ends last


def test_names_of_outputs_are_listed_for_users() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reliability.md").read_text("utf-8")
    missing = [name for name in OUTPUTS if f"`{name}`" not in page]
    assert missing == []


@pytest.mark.slow
def test_an_argument_that_is_not_utf8_is_taken(tmp_path: Path) -> None:
    keys = ("mesh.elements=2", "time.periods=1", "output.window_periods=1")
    options = [word for key in keys for word in ("--set", key)]
    target = os.path.join(os.fsencode(tmp_path), b"o\xe9")
    line = [sys.executable, "-m", "delam_fem", "run", "paper", *options, "--no-figures", "-o"]
    done = subprocess.run([*line, target], capture_output=True, timeout=300, cwd=tmp_path)
    assert done.returncode == 0 and b"Traceback" not in done.stderr, done.stderr[-500:]
    assert os.path.isfile(os.path.join(target, b"result.nc"))

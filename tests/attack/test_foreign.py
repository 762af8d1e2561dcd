"""What belongs to somebody else stays as it is: links, folders and files with the names of ours."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from attack.processes import command, ended, finish, start
from attack.test_kills import KILLS, files_of, victims
from support import invoke
from synthetic import small_case, synthetic_history

from delam_fem.api import (
    CaseError,
    atomic,
    discard,
    listed,
    remove_kept,
    save_case,
    write_arrays,
    write_dataset,
    write_json,
    write_text,
)
from delam_fem.results.diagnostics import summary
from delam_fem.results.export import export
from delam_fem.results.figures.run import remove_figures
from delam_fem.simulation.checkpoint import of_study
from delam_fem.system.files import claimed
from delam_fem.system.written import LIST, MADE_OF_RESULT, OUTPUTS, PREFIX, drop_made_of_result


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


def written_in(folder: Path) -> set[str]:
    """Return the names on the list of a folder."""
    lines = (folder / LIST).read_text("utf-8").splitlines()
    return {line for line in lines if not line.startswith("#")}


def files_in(folder: Path) -> set[str]:
    """Return the names of all files in a folder but that of the list."""
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    return {name for name in names if ".bp/" not in name} - {LIST}


SHORT = ("--set=mesh.elements=3", "--set=time.periods=2", "--set=output.window_periods=2")


@pytest.mark.slow
def test_a_run_lists_what_it_writes_and_replaces_no_more(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    line = ["run", "paper", *SHORT, "-q", "-o", str(folder)]
    assert invoke(*line).exit_code == 0
    assert files_in(folder) <= written_in(folder)
    assert invoke("show", "export", str(folder), "--to", "csv").exit_code == 0
    (folder / "export" / "mine.csv").write_text("mine")
    (folder / "figures" / "mine.png").write_text("mine")
    assert files_in(folder) - written_in(folder) == {"export/mine.csv", "figures/mine.png"}
    again = invoke(*line, "--no-figures", "--overwrite")
    assert again.exit_code == 0, again.output
    assert {"case.toml", "result.nc", "summary.json", "state.npz", "export/mine.csv"} < files_in(
        folder
    )
    left = {name for name in files_in(folder) if name.split("/")[0] in ("export", "figures")}
    assert left == {"export/mine.csv", "figures/mine.png"}
    assert not (folder / "report.html").exists()
    assert "export" in again.output  # which is older than the result


@pytest.mark.nightly
@pytest.mark.parametrize("kind", sorted({*KILLS} - {"shard", "extend"}))
def test_each_command_lists_what_it_writes_and_replaces_it(kind: str, tmp_path: Path) -> None:
    inputs, folder = files_of(tmp_path), tmp_path / "out"
    victim = victims()[kind]
    words = [str(word).replace("FOLDER", str(tmp_path)) for word in victim.words]
    line = command(*words, "-q", "-o", folder, keys=victim.keys)
    assert ended(line)[0] == 0
    before = {path: path.stat().st_ino for path in folder.rglob("*") if path.is_file()}
    unlisted = {
        name for name in files_in(folder) - written_in(folder) if not name.startswith("points/")
    }
    nested = {name for name in unlisted if (folder / name).with_name(LIST).exists()}
    assert {Path(name).name for name in nested} <= {LIST, *OUTPUTS}
    assert unlisted - nested == set()
    status, errors = ended([*line, "--overwrite"])
    assert status == 0, errors
    assert {path for path in folder.rglob("*") if path.is_file()} == before.keys()
    data = [path for path in before if path.suffix == ".nc" and path.parent == folder]
    assert all(path.stat().st_ino != before[path] for path in data)
    assert all(path.exists() for path in inputs)


@pytest.mark.parametrize("name", ["report.html", "tables.md", "case.toml", "fields/a.vtu"])
def test_a_file_of_the_user_is_not_replaced(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine")
    with pytest.raises(CaseError, match=name.split("/")[0]):
        with claimed(tmp_path, may_hold_results=True, is_replacing=True):
            raise AssertionError
    assert path.read_text() == "mine"


def test_a_file_that_comes_between_is_not_replaced(tmp_path: Path) -> None:
    with claimed(tmp_path):
        write_text(tmp_path / "result.nc", "ours")
        (tmp_path / "figures").mkdir()
        (tmp_path / "figures" / "spectra.png").write_text("mine")
        with pytest.raises(CaseError, match=r"figures/spectra\.png"):
            write_text(tmp_path / "figures" / "spectra.png", "ours")
        remove_figures(tmp_path / "figures")
    assert (tmp_path / "figures" / "spectra.png").read_text() == "mine"
    assert written_in(tmp_path) == {"result.nc"}


def test_results_of_earlier_versions_are_replaced(tmp_path: Path) -> None:
    for name in ("result.nc", "report.html"):
        (tmp_path / name).write_text("ours, before there were lists")
    with claimed(tmp_path, may_hold_results=True, is_replacing=True):
        write_text(tmp_path / "result.nc", "new")
    assert files_in(tmp_path) == written_in(tmp_path) == {"result.nc"}


def test_what_is_replaced_goes_at_the_end_also_after_a_kill(tmp_path: Path) -> None:
    table = tmp_path / "tables.md"
    for name in ("branch.nc", "tables.md", "notes.txt"):
        with listed(tmp_path):
            write_text(tmp_path / name, "old")
    with (
        pytest.raises(KeyboardInterrupt),
        claimed(tmp_path, may_hold_results=True, is_replacing=True),
    ):
        write_text(tmp_path / "branch.nc", "new")
        raise KeyboardInterrupt
    assert files_in(tmp_path) == {"branch.nc", "tables.md", "notes.txt"}
    with claimed(tmp_path, may_hold_results=True):
        pass  # nothing is complete yet
    assert table.exists()
    with claimed(tmp_path, may_hold_results=True):
        write_text(tmp_path / "orbit.json", "new")
    assert files_in(tmp_path) == {"branch.nc", "orbit.json", "notes.txt"}  # no name of an output


def test_a_sweep_in_the_folder_of_a_study_has_its_own_list(tmp_path: Path) -> None:
    inner = tmp_path / "simulations" / "3-Hz"
    for folder in (tmp_path, inner):
        with listed(folder):
            write_text(folder / "sweep.nc", "ours")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "sweep.json").write_text("mine")
    earlier = tmp_path / "finer"
    earlier.mkdir()
    (earlier / "sweep.nc").write_text("ours, before there were lists")
    with claimed(tmp_path, may_hold_results=True):
        write_text(inner / "sweep.json", "ours")
        for folder in (inner, earlier, tmp_path / "other"):
            discard(folder / "sweep.nc")
            discard(folder / "sweep.json")
    assert files_in(tmp_path) - {f"simulations/3-Hz/{LIST}"} == {"sweep.nc", "other/sweep.json"}
    assert written_in(tmp_path) == {"sweep.nc"}


def test_a_list_that_a_full_disk_has_cut_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with listed(tmp_path):
        write_text(tmp_path / "case.toml", "ours")
    with monkeypatch.context() as patch, listed(tmp_path):
        patch.setattr(os, "write", lambda handle, data: os.pwrite(handle, data[:4], 0))
        with pytest.raises(OSError, match="No space"):
            write_text(tmp_path / "result.nc", "ours")
    assert not (tmp_path / "result.nc").exists()
    with listed(tmp_path):
        write_text(tmp_path / "summary.json", "ours")
    assert {"case.toml", "summary.json"} <= written_in(tmp_path)


def test_what_is_made_of_a_result_goes_with_it(tmp_path: Path) -> None:
    files = {name if "." in name else f"{name}/a.csv" for name in MADE_OF_RESULT}
    for name in files:
        with listed(tmp_path):
            write_text(tmp_path / name, "old")
    (tmp_path / "solid.gif").unlink()
    (tmp_path / "notes.txt").touch()
    drop_made_of_result(tmp_path)
    assert files_in(tmp_path) == {"notes.txt"}
    assert written_in(tmp_path) == set()
    write_text(tmp_path / "plane.png", "mine")
    with pytest.raises(CaseError, match=r"plane\.png"), listed(tmp_path):
        write_text(tmp_path / "plane.png", "ours")
    assert (tmp_path / "plane.png").read_text() == "mine"


def test_nothing_goes_where_nothing_was_written(tmp_path: Path) -> None:
    with claimed(tmp_path):
        write_text(tmp_path / "orbit.json", "old")
    with claimed(tmp_path, may_hold_results=True, is_replacing=True):
        pass
    assert (tmp_path / "orbit.json").read_text() == "old"


def test_the_list_is_no_way_to_other_files(tmp_path: Path) -> None:
    other, folder = tmp_path / "other", tmp_path / "out"
    other.write_text("mine")
    folder.mkdir()
    (folder / "result.nc").touch()
    (folder / LIST).write_text("../other\nexport/../../other\nresult.nc\n")
    with claimed(folder, may_hold_results=True, is_replacing=True):
        write_text(folder / "result.nc", "new")
        drop_made_of_result(folder)
    assert other.read_text() == "mine"
    (folder / LIST).unlink()
    (folder / LIST).symlink_to(other)
    with pytest.raises(CaseError, match="is a link"), claimed(folder, may_hold_results=True):
        raise AssertionError
    assert other.read_text() == "mine"


def test_an_archive_of_the_user_among_points_stays(tmp_path: Path) -> None:
    folder = tmp_path / "points"
    folder.mkdir()
    (folder / "identity.json").write_text("{}")
    write_arrays(folder / "ours.npz", {"a": 1.0})
    (folder / "damaged.npz").write_bytes(b"PK ours, damaged")
    np.savez(folder / "mine.npz", a=1.0)
    remove_kept(folder)
    assert [path.name for path in folder.iterdir()] == ["mine.npz"]


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


@pytest.mark.nightly
def test_many_processes_write_one_file_at_once(run: Path) -> None:
    """45 exports to one file: all end well, and the file is that of one of them."""
    line = command("show", "export", run, "--to", "csv", "-q")
    processes = [start(line) for _ in range(45)]
    ends = [finish(process) for process in processes]
    assert ends == [(0, "")] * 45
    (path,) = (run / "export").glob("paper.csv")
    at_once = path.read_bytes()
    path.unlink()
    assert ended(line) == (0, "")
    assert path.read_bytes() == at_once
    assert not list((run / "export").glob(f"{PREFIX}*"))


def test_two_blocks_of_one_process_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with atomic(path) as first, atomic(path) as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first"  # its block ends last


def test_names_of_outputs_are_listed_for_users() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reliability.md").read_text("utf-8")
    missing = [name for name in (*OUTPUTS, *MADE_OF_RESULT, LIST) if f"`{name}`" not in page]
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

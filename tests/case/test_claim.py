"""A folder belongs to one process, and holds the results of one run."""

import subprocess
import sys
from pathlib import Path

import pytest

from delam_fem.api import Case, CaseError, load_case, preset, save_case
from delam_fem.system.files import claimed

HOLDING = """
import sys, pathlib
from delam_fem.system.files import claimed
with claimed(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_new_folder_is_made_and_kept_if_something_was_written(tmp_path: Path) -> None:
    with claimed(tmp_path / "a" / "b") as folder:
        (folder / "result.nc").touch()
    assert (tmp_path / "a" / "b" / "result.nc").exists()


def test_bad_input_leaves_no_new_folder_and_an_old_one(tmp_path: Path) -> None:
    (tmp_path / "old").mkdir()
    for name in ("new/below", "old"):
        with pytest.raises(CaseError, match="bad"), claimed(tmp_path / name):
            raise CaseError("bad")
    assert {path.name for path in tmp_path.iterdir()} == {"old"}


def test_a_folder_with_anything_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(CaseError, match=r"is not empty \(notes.txt\).*--resume.*--overwrite"):
        with claimed(tmp_path):
            pass
    with claimed(tmp_path, may_hold_results=True):
        pass
    with claimed(tmp_path, inputs=[tmp_path / "notes.txt"]):
        pass


def test_hidden_and_half_written_files_are_nothing(tmp_path: Path) -> None:
    (tmp_path / ".directory").touch()
    (tmp_path / ".delam_fem-checkpoint.npz").touch()
    with claimed(tmp_path):
        pass


@pytest.mark.parametrize("name", ["result.nc", "case.toml", "figures/gap.csv"])
def test_an_input_called_like_an_output_is_spared(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.touch()
    with pytest.raises(CaseError, match="the results would replace"):
        with claimed(tmp_path, inputs=[path], may_hold_results=True):
            pass


def test_a_second_process_is_refused_until_the_first_ends(tmp_path: Path) -> None:
    line = [sys.executable, "-c", HOLDING, str(tmp_path)]
    first = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert first.stdout is not None
    assert first.stdout.readline() == "held\n"
    with pytest.raises(CaseError, match="another process is writing there"):
        with claimed(tmp_path, may_hold_results=True):
            pass
    first.kill()
    first.communicate()
    with claimed(tmp_path):
        pass


def test_a_copied_gap_file_gets_a_name_that_no_output_has(tmp_path: Path) -> None:
    table = tmp_path / "in" / "result.nc"
    table.parent.mkdir()
    table.write_text("0,0\n0.3,0.004\n0.685,0.012\n")
    data = {"gap.file": str(table)}
    case: Case = preset("paper", data)
    path = save_case(case, tmp_path / "out")
    assert {p.name for p in path.parent.iterdir()} == {"case.toml", "gap-result.nc"}
    assert load_case(path).gap.file == tmp_path / "out" / "gap-result.nc"

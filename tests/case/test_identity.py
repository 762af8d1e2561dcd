"""What is kept is known by its case, the content of its files and the question, not by names."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import (
    Case,
    CaseError,
    belong,
    identity,
    load_case,
    preset,
    require_same,
    save_case,
)
from delam_fem.case.identity import differences, digest, located
from delam_fem.system.files import PREFIX

TABLE = "x [m],gap [m]\n0,0\n0.3,0.004\n0.685,0.012\n"


def with_table(folder: Path, text: str = TABLE, name: str = "gap.csv") -> Case:
    """Return a case whose gap is a table in a folder."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    return preset("paper", {"gap.file": str(folder / name)})


def test_a_moved_and_renamed_case_is_the_same(tmp_path: Path) -> None:
    case = with_table(tmp_path / "a")
    saved = load_case(save_case(case, tmp_path / "run"))
    shutil.move(tmp_path / "run", tmp_path / "moved")
    moved = load_case(tmp_path / "moved" / "case.toml")
    renamed = with_table(tmp_path / "b", name="other name.txt")
    for other in (saved, moved, renamed):
        if other is not saved:  # its table has gone elsewhere
            assert identity(other) == identity(case)
        assert str(tmp_path) not in identity(case)
    with pytest.raises(CaseError, match=r"gap\.file: .*gap\.csv cannot be read"):
        identity(saved)


def test_another_content_of_any_file_is_told_by_its_key(tmp_path: Path) -> None:
    case = with_table(tmp_path)
    before = identity(case)
    (tmp_path / "gap.csv").write_text(TABLE.replace("0.012", "0.002"))
    assert differences(before, identity(case)) == ["gap.file: the file has another content"]
    with pytest.raises(CaseError, match=r"the folder .*gap\.file: the file has another content"):
        require_same(before, identity(case), "the folder")
    assert digest(before) != digest(identity(case))


def test_numbers_of_xdmf_belong_to_its_mesh(tmp_path: Path) -> None:
    (tmp_path / "m.xdmf").write_text("<Xdmf/>")
    (tmp_path / "m.h5").write_bytes(b"numbers")
    case = preset("paper", {"mesh.file": str(tmp_path / "m.xdmf")})
    before = identity(case)
    (tmp_path / "m.h5").write_bytes(b"others")
    assert differences(before, identity(case)) == ["mesh.file: the file has another content"]


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({"excitation.frequency": 4.75}, "excitation.frequency: 3.25 there, 4.75 here"),
        ({"lamina.thin.width": 0.05}, "lamina.thin.width: 0.04 there, 0.05 here"),
        ({"gap.exponent": None, "gap.shape": "mode"}, "gap.shape"),
    ],
)
def test_another_value_is_told_by_its_key(keys: dict[str, object], told: str) -> None:
    case = preset("paper")
    texts = differences(identity(case), identity(case.with_overrides(keys)))
    assert any(text.startswith(told) for text in texts)
    assert {text.partition(":")[0] for text in texts} <= {*keys, "gap.exponent"}


def test_a_question_is_a_part_of_it(tmp_path: Path) -> None:
    case, path = preset("paper"), tmp_path / "measured.csv"
    path.write_text("1")
    before = identity(case, engine="petsc", files=[path], start=np.zeros(2))
    assert (
        differences(before, identity(case, engine="petsc", files=[path], start=np.zeros(2))) == []
    )
    assert differences(before, identity(case, engine="compiled", files=[path], start=np.zeros(2)))
    assert differences(before, identity(case, engine="petsc", files=[path], start=np.ones(2)))
    path.write_text("2")
    other = identity(case, engine="petsc", files=[path], start=np.zeros(2))
    assert [text.partition(":")[0] for text in differences(before, other)] == ["files"]
    assert differences(before, identity(case), of_case=True) == []
    assert differences(before, other, without=("files",)) == []


@pytest.mark.parametrize(
    ("key", "is_same"),
    [('motion = "lateral"\n', True), ("refine = 64\n", False), ("length = 0.685\n", False)],
)
def test_a_key_that_is_lacking_has_its_default(key: str, is_same: bool) -> None:
    """It has come with a later version."""
    asked = identity(preset("default"))
    content = json.loads(asked)
    assert key in content["case"]
    stored = json.dumps(content | {"case": content["case"].replace(key, "")})
    assert (differences(stored, asked) == []) == is_same


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"case": "", "question": {}}', "\x00", '"a"'])
def test_what_does_not_say_of_what_it_is_is_refused(text: str) -> None:
    with pytest.raises(CaseError, match="belongs to another"):
        require_same(text, identity(preset("paper")), "x")


def test_a_folder_says_of_what_it_is(tmp_path: Path) -> None:
    one, two = identity(preset("paper")), identity(preset("default"))
    belong(tmp_path, one)
    belong(tmp_path, one)
    with pytest.raises(CaseError, match="name:"):
        belong(tmp_path, two)
    (tmp_path / "killed").mkdir()  # while it wrote what it is
    (tmp_path / "killed" / f"{PREFIX}identity.json").touch()
    belong(tmp_path / "killed", one)
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "0.npz").touch()
    with pytest.raises(CaseError, match="does not say"):
        belong(tmp_path / "old", one)


def test_files_are_found_by_content(tmp_path: Path) -> None:
    case = with_table(tmp_path / "a")
    stored, near = identity(case), with_table(tmp_path / "b")
    assert located(stored, near, case).files == near.files
    (tmp_path / "b" / "gap.csv").write_text(TABLE.replace("0.012", "0.002"))
    assert located(stored, near, case) == case
    (tmp_path / "a" / "gap.csv").unlink()
    with pytest.raises(CaseError, match=r"gap\.file: .*put it back"):
        located(stored, near, case)


def test_a_case_with_the_length_of_its_table_is_read_back(tmp_path: Path) -> None:
    """The preset has a number of periods, which such a run does not read."""
    rows = "".join(f"{0.5 * k},{k % 2}\n" for k in range(7))
    (tmp_path / "drive.csv").write_text(f"time [s],acceleration [m/s2]\n{rows}")
    drive = {"kind": "table", "file": str(tmp_path / "drive.csv"), "acts_on": "base"}
    keys = {f"excitation.{key}": value for key, value in drive.items()}
    case = preset("paper", {**keys, "time.step": 0.005})
    again = Case.from_toml(case.to_toml())
    assert (again.n_periods, again.time_step) == (case.n_periods, case.time_step)
    assert differences(identity(case), identity(again)) == []

"""docs/architecture.md is true: its table of folders, and the files and names that it points to."""

from __future__ import annotations

import re

import pytest
from project import ROOT
from test_imports import ALLOWED

PACKAGE = ROOT / "delam_fem"
TEXT = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| `(\w+)` \| .+ \| (.+) \|$", TEXT.split("## To add")[0], re.MULTILINE)
FILES = sorted(set(re.findall(r"`((?:\w+/)*\w+\.py)`", TEXT)))
FOLDERS = [name for name in ALLOWED if not name.startswith("__")]


def test_all_folders_have_a_row() -> None:
    assert sorted(name for name, _ in ROWS) == sorted(FOLDERS)


@pytest.mark.parametrize(("folder", "cell"), ROWS)
def test_a_row_says_what_the_folder_may_import(folder: str, cell: str) -> None:
    names = set(re.findall(r"`(\w+)`", cell))
    if cell.startswith("all of the above"):
        above = [name for name, _ in ROWS]
        names = set(above[: above.index(folder)]) - names
    assert names == ALLOWED[folder] - {folder}


@pytest.mark.parametrize("name", FILES)
def test_files_that_it_names_exist(name: str) -> None:
    assert (ROOT / name).is_file() or any(PACKAGE.rglob(name))


def test_names_in_code_exist() -> None:
    sources = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    names = set(re.findall(r"`(_?[A-Z][A-Za-z_]+|_?[a-z]+_[a-z_]+)`", TEXT)) - {"README"}
    assert {name for name in names if not re.search(rf"\b{name}\b", sources)} == set()

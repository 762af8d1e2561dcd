"""docs/architecture.md is true: its table of folders, and the files and names that it points to."""

from __future__ import annotations

import re
import sys

from project import ROOT
from test_imports import ALLOWED

PACKAGE = ROOT / "delam_fem"
TEXT = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| `(\w+)` \| .+ \| (.+) \|$", TEXT.split("## To add")[0], re.MULTILINE)
FILES = sorted(set(re.findall(r"`((?:\w+/)*\w+\.py)`", TEXT)))
FOLDERS = [name for name in ALLOWED if not name.startswith("__")]


def test_all_folders_have_a_row() -> None:
    assert sorted(name for name, _ in ROWS) == sorted(FOLDERS)


def test_rows_say_what_their_folders_may_import() -> None:
    order = [name for name, _ in ROWS]
    said = {}
    for folder, cell in ROWS:
        names = set(re.findall(r"`(\w+)`", cell))
        if cell.startswith("all of the above"):
            names = set(order[: order.index(folder)]) - names
        said[folder] = names
    assert said == {folder: ALLOWED[folder] - {folder} for folder in order}


def test_files_that_it_names_exist() -> None:
    assert [
        name for name in FILES if not (ROOT / name).is_file() and not any(PACKAGE.rglob(name))
    ] == []


def test_names_in_code_exist() -> None:
    sources = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    names = set(re.findall(r"`(_?[A-Z][A-Za-z_]+|_?[a-z]+_[a-z_]+)`", TEXT)) - {"README"}
    assert names - set(re.findall(r"\w+", sources)) == set()


def test_what_is_looked_up_is_defined_in_the_file_that_is_named() -> None:
    rows = re.findall(r"^\| [^|]+ \| `([\w/]+\.py)` \| `(\w+)` \|$", TEXT, re.MULTILINE)
    assert len(rows) > 27
    for file, name in rows:
        source = (PACKAGE / file).read_text(encoding="utf-8")
        assert re.search(rf"^(?:    )?(?:def |class )?{name}\b", source, re.MULTILINE), (file, name)


def test_names_of_what_to_add_are_in_the_files_of_their_rows() -> None:
    for row in re.findall(r"^\| .*$", TEXT.split("## To add")[1].split("\n## ")[0], re.MULTILINE):
        near = [(ROOT / name, PACKAGE / name) for name in FILES if f"`{name}`" in row]
        files = [path for pair in near for path in pair if path.is_file()]
        words = set(re.findall(r"\w+", "".join(path.read_text("utf-8") for path in files)))
        assert set(re.findall(r"`(_?[A-Za-z]\w+)`", row)) <= words, row


def test_docstrings_point_to_names_that_are_there() -> None:
    """`rules.CLOSED`: what stands before the point is known, and a module has that member."""
    words: dict[str, set[str]] = {name: set() for name in sys.stdlib_module_names}
    pointers = set()
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        code = re.sub(r"`[^`]*`", "", text)
        for name in re.findall(r"\b([a-z_]\w*)(?=\.\w|\s*[:=])", code):
            words.setdefault(name, set())
        for name in {path.stem, *path.relative_to(PACKAGE).parts[:-1]}:
            words.setdefault(name, set()).update(re.findall(r"\w+", code))
        pairs = re.findall(r"`([a-z_]+)\.(?:\w+\.)*([A-Za-z]\w+)`", text)
        pointers |= {(path.name, *pair) for pair in pairs}
    assert len(pointers) > 50
    assert {
        (file, first, last)
        for file, first, last in pointers - {("html.py", "page", "js")}
        if last not in {"cfg", "json", "py", "toml"}
        and (first not in words or (words[first] and last not in words[first]))
    } == set()


def test_the_glossary_is_short() -> None:
    rows = re.findall(r"^\| (?!word )[^|]+ \|", TEXT.split("## Glossary")[1], re.MULTILINE)
    words = [word for row in rows for word in row.strip("| ").split(",")]
    assert 20 < len(rows) <= 40 and len(set(words)) == len(words)


def test_files_that_texts_name_exist() -> None:
    """A path below one of the folders, in the package, in scripts and in documents."""
    path = re.compile(
        r"\b(?:tests|scripts|docs|delam_fem|meshes)/[\w./-]+\.(?:py|md|toml|csv|sh)\b"
    )
    texts = [*PACKAGE.rglob("*.py"), *(ROOT / "scripts").rglob("*.py"), *ROOT.glob("*.md")]
    texts += [page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts]
    named = {
        (str(text.relative_to(ROOT)), name)
        for text in texts
        for name in path.findall(text.read_text(encoding="utf-8"))
    }
    assert len(named) > 100
    assert {(text, name) for text, name in named if not (ROOT / name).is_file()} == set()

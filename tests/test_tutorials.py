"""The tutorials do as they stand what they say, block after block, in a folder of their own."""

from __future__ import annotations

from pathlib import Path

import pytest
from pages import Block, agrees, blocks, missing, run_block
from project import ROOT

PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))

LONG = {"fitted_model", "measured", "plate", "solids"}
"""Pages that take fifteen seconds and more and run in their whole form alone."""


def executed(page: Path, folder: Path, *, whole: bool) -> int:
    """Run the blocks of a page and compare what it shows; return the number of blocks run."""
    (folder / "meshes").symlink_to(ROOT / "meshes")
    (folder / "docs").symlink_to(ROOT / "docs")
    printed, n_run = None, 0
    for block in blocks(page.read_text(encoding="utf-8")):
        if block.file:
            (folder / block.file).write_text(block.code, encoding="utf-8")
        elif block.note == "output":
            assert printed is None or not missing(block.code, printed), (block.name, printed)
        elif block.language in ("bash", "python") and not block.reason:
            is_run = whole or block.note != "nightly"
            printed = run_block(block, folder) if is_run else None
            n_run += is_run
    return n_run


@pytest.mark.slow
@pytest.mark.once
@pytest.mark.parametrize(
    "page", [page for page in PAGES if page.stem not in LONG], ids=lambda page: page.stem
)
def test_tutorial_runs_in_short(page: Path, tmp_path: Path) -> None:
    assert executed(page, tmp_path, whole=False) > 0


@pytest.mark.nightly
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_whole_tutorial_runs(page: Path, tmp_path: Path) -> None:
    assert executed(page, tmp_path, whole=True) > 0


def test_a_page_that_shows_something_else_is_noticed() -> None:
    assert agrees("tip  1.00 and 2", "tip 1.01 and 2")
    assert not agrees("tip 1.00 and 2", "tip 1.10 and 2")
    assert not agrees("tip 1.00", "root 1.00")
    assert not agrees("tip -1.00", "tip 1.00")
    assert missing("a 1\n…\nb 2\n", "b 2\nc\n") == ["a 1"]


def test_what_a_comment_says_of_a_block_is_read() -> None:
    text = "<!-- file: a.toml -->\n```toml\nx\n```\n\n<!-- output -->\n\n```text\ny\n```\n"
    assert blocks(text) == [
        Block("line2", "toml", "x\n", "file: a.toml"),
        Block("line8", "text", "y\n", "output"),
    ]
    assert [block.file for block in blocks(text)] == ["a.toml", None]

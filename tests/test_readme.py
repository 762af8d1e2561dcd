"""The README's code blocks work as they stand.

Python blocks and lines with delam-fem are run. The scripts of the set-up, which do the same for the
whole project, are only looked up. A block that takes too long has a reason in the line before it:
`<!-- not run in tests: REASON -->`.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from pages import Block, blocks, call, commands, run_block

from delam_fem.cli import app

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MOST_WORDS = 450
"""Of README; all else is in docs."""
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    ROOT / "meshes" / "README.md",
]
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)(?:#([\w-]+))?\)")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a folder that has what a checkout has, but keeps the runs to itself."""
    for name in ("meshes", "docs", "scripts"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


RUN = [
    block
    for block in blocks(README)
    if block.reason is None and block.language in ("python", "bash")
]


@pytest.mark.parametrize(
    "block", [b for b in RUN if b.language == "python"], ids=lambda block: block.name
)
def test_python_block_runs(block: Block, checkout: Path) -> None:
    run_block(block, checkout)


@pytest.mark.parametrize(
    "block", [b for b in RUN if b.language == "bash"], ids=lambda block: block.name
)
def test_bash_block_runs(block: Block, checkout: Path) -> None:
    for words in commands(block.code):
        if words[0].startswith("scripts/"):
            assert os.access(ROOT / words[0], os.X_OK), words
            continue
        assert Path(words[0]).name == "delam-fem", words
        call(words[1:], checkout)


def test_readme_is_short_and_shows_pictures() -> None:
    assert len(README.split()) <= MOST_WORDS
    assert "](docs/figures/paper_fig04.gif)" in README
    assert README.index("scripts/test.sh") < README.index("## ")


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", text.lower()).replace(" ", "-") for text in headings}


def test_links_of_the_documentation_lead_somewhere() -> None:
    lost = []
    for page in PAGES:
        for target, anchor in LINK.findall(page.read_text(encoding="utf-8")):
            place = page.parent / target
            if not place.exists() or (anchor and anchor not in anchors(place)):
                lost.append(f"{page.relative_to(ROOT)}: {target}#{anchor}")
    assert lost == []


def test_readme_has_blocks_of_both_kinds_that_run() -> None:
    assert {block.language for block in RUN} == {"python", "bash"}


def test_blocks_and_reasons_are_found() -> None:
    text = "\n```bash\na b  # c\nd \\\n  e\n```\n\n<!-- not run in tests: hours -->\n\n"
    first, second, third = blocks(text + "```python\nx\n```\n```toml\ny\n```\n")
    assert third.language == "toml"
    assert commands(first.code) == [["a", "b"], ["d", "e"]]
    assert first.reason is None
    assert (second.code, second.reason) == ("x\n", "hours")


def test_commands_that_are_named_anywhere_have_the_names_of_today() -> None:
    today = {name for group in app.commands().values() for name in group}
    first = {name.split()[0] for name in today}
    places = [*PAGES, ROOT / "CHANGELOG.md", *(ROOT / "delam_fem").rglob("*.py")]
    lost = []
    for place in places:
        text = re.sub(r'["\s]+', " ", place.read_text(encoding="utf-8"))
        for one, two in re.findall(r"delam-fem ([a-z]+)(?: ([a-z]+)\b)?", text):
            is_family = one in first and one not in today
            if not (one in today or (is_family and (not two or f"{one} {two}" in today))):
                lost.append(f"{place.relative_to(ROOT)}: {one} {two}")
    assert lost == []

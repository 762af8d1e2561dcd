"""Write docs/paper.md and a sentence of README.md from the numbers of `delam-fem paper`.

Run these commands in this order:

    .venv/bin/delam-fem paper -o runs/paper
    .venv/bin/python scripts/evidence/paper_docs.py runs/paper
"""

from __future__ import annotations

import argparse
import csv
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from delam_fem.api import atomic, write_text
from delam_fem.paper.claims import HEADING, Claim
from delam_fem.paper.reproduce import (
    FIGURES,
    PAPER,
    Entry,
    claims_of,
    entries,
    file_stem,
    heading,
    pictures,
    tally,
)

ROOT = Path(__file__).parents[2]
ABOUT = (
    "The paper's text is available, its figures are not: each figure here shows what the "
    "computation gives. A verdict is undecided where the uncertainty of the numbers contains "
    "the bound. Bounds on words such as significantly are ours. Unless a row says "
    "otherwise, computations are with the preset paper."
)
BAR = "\\|"
"""A bar within a cell of a table."""
TABLE = Path("evidence", "tables", "paper.csv")
"""All claims, below docs."""
README_MARKS = ("<!-- paper claims: begin -->", "<!-- paper claims: end -->")
"""Marks in README.md; a sentence that counts the claims stands between them."""


def main(arguments: list[str] | None = None) -> None:
    """Write the documents and print their paths."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory", type=Path, help="folder that `delam-fem paper` has written")
    parser.add_argument("--root", type=Path, default=ROOT, help="folder of README.md and docs")
    options = parser.parse_args(arguments)
    figures = entries(options.directory, [file_stem(name) for name in FIGURES])
    missing = [name for name in FIGURES if name not in {figure["name"] for figure in figures}]
    if missing:
        parser.error(
            f"{options.directory}: no figure {', '.join(missing)}; run delam-fem paper first"
        )
    for path in write_docs(options.directory, options.root, figures):
        print(path)


def write_docs(directory: Path, root: Path, figures: Sequence[Entry]) -> list[Path]:
    """Write docs/paper.md and a sentence of README.md, and copy the pictures for the docs.

    Args:
        directory: folder of the figures.
        root: folder of the project.
        figures: figures from `entries`.

    Raises:
        ValueError: README.md lacks the marks.
        OSError: a file cannot be written.
    """
    claims = claims_of(figures)
    lines = [
        "# The paper, figure by figure", "",
        f"{PAPER}.", "", ABOUT, "",
        "`scripts/evidence/paper_docs.py` writes this page from the numbers of `delam-fem paper`.",
        "", f"{tally(claims)} [All of them]({TABLE}) have places and margins; these do not "
        "hold, or are undecided:",
        "", markdown_table(claims),
    ]  # fmt: skip
    paths = [write_table(root / "docs" / TABLE, claims)]
    figures_folder = root / "docs" / "figures"
    figures_folder.mkdir(parents=True, exist_ok=True)
    for figure in figures:
        lines += [f"## {heading(figure)}", "", first_sentence(figure["caption"]), ""]
        for name in pictures(figure):
            paths.append(figures_folder / f"paper_{name}")
            with atomic(paths[-1]) as temporary:
                shutil.copyfile(directory / name, temporary)
            lines += [f"![{figure['title']}](figures/{paths[-1].name})", ""]
    readme = root / "README.md"
    sentence = f"Of I. Müller's paper {tally(claims)}"
    text = between(readme.read_text("utf-8"), README_MARKS, sentence)
    page = write_text(root / "docs" / "paper.md", "\n".join(lines).rstrip() + "\n")
    return [page, write_text(readme, text), *paths]


def first_sentence(text: str) -> str:
    """Return the first sentence of a text."""
    return text.split(". ")[0].removesuffix(".") + "."


def between(text: str, marks: tuple[str, str], content: str) -> str:
    """Return a text in which the part between two marks is replaced.

    Raises:
        ValueError: the text does not contain both marks once and in this order.
    """
    begin, end = marks
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise ValueError(f"README.md: expected {begin} and then {end}, once each; add these marks")
    head, tail = text.split(begin)
    return f"{head}{begin}\n{content}\n{end}{tail.split(end)[1]}"


def markdown_table(claims: Iterable[Claim]) -> str:
    """Return the claims that do not hold as a Markdown table, without places and margins."""
    rows = [HEADING, *(claim.row for claim in claims if claim.verdict != "holds")]
    columns = [i for i, name in enumerate(HEADING) if name not in ("where", "margin")]
    lines = [f"| {' | '.join(row[i].replace('|', BAR) for i in columns)} |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(columns), *lines[1:]]) + "\n"


def write_table(path: Path, claims: Iterable[Claim]) -> Path:
    """Write all claims to a file of comma-separated values."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerows([HEADING, *(claim.row for claim in claims)])
    return path


if __name__ == "__main__":
    main()

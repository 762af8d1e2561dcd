"""Write docs/paper.md and the table of README.md from the numbers of `delam-fem paper`.

Run these commands in this order:

    .venv/bin/delam-fem paper -o runs/paper
    .venv/bin/python scripts/paper_docs.py runs/paper
"""

from __future__ import annotations

import argparse
from pathlib import Path

from delam_fem.paper.reproduce import FIGURES, entries, file_stem, write_docs

ROOT = Path(__file__).parents[1]


def main(arguments: list[str] | None = None) -> None:
    """Write the documents and print their paths."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory", type=Path, help="folder that `delam-fem paper` has written")
    parser.add_argument("--root", type=Path, default=ROOT, help="folder of README.md and docs")
    given = parser.parse_args(arguments)
    figures = entries(given.directory, [file_stem(name) for name in FIGURES])
    missing = [name for name in FIGURES if name not in {figure["name"] for figure in figures}]
    if missing:
        parser.error(
            f"{given.directory}: no figure {', '.join(missing)}; run delam-fem paper first"
        )
    for path in write_docs(given.directory, given.root, figures):
        print(path)


if __name__ == "__main__":
    main()

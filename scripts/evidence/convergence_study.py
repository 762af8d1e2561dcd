"""Compute the studies for docs/evidence/convergence.md and update its tables and figures.

    .venv/bin/python scripts/evidence/convergence_study.py [--folder runs/convergence] [--workers 2]

The folder keeps finished levels, which are not computed again; `--only` computes some studies
and leaves the document as it is. The script replaces each table of the
document between the lines `<!-- table NAME -->` and `<!-- end -->`, or writes it to the file that
the document names.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from refinements.document import document, fill
from refinements.study import refinements
from rich.console import Console

from delam_fem.api import style
from delam_fem.cli.console import progress
from delam_fem.studies.convergence.run import run_refinement

ROOT = Path(__file__).parents[2]
DOCUMENT = ROOT / "docs" / "evidence" / "convergence.md"
FIGURES = ROOT / "docs" / "figures"


def main(arguments: list[str] | None = None) -> int:
    """Compute missing levels, write figures and document, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=ROOT / "runs" / "convergence")
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--only", nargs="*", default=[""], help="studies whose names begin so")
    options = parser.parse_args(arguments)
    console = Console(stderr=True)
    convergences = {}
    chosen = {
        name: refinement
        for name, refinement in refinements().items()
        if name.startswith(tuple(options.only))
    }
    for name, refinement in chosen.items():
        console.print(f"study {name}: {len(refinement.levels())} levels")
        with progress(console) as report:
            convergences[name] = run_refinement(
                refinement,
                options.folder / name,
                workers=options.workers,
                resume=True,
                progress=report,
            )
        if not convergences[name].is_complete:
            return 130
    if len(chosen) < len(refinements()):
        return 0
    content = document(convergences)
    FIGURES.mkdir(parents=True, exist_ok=True)
    with style.styled():
        for name, draw in content.figures.items():
            draw().savefig(FIGURES / f"convergence_{name}.png")
    text = fill(DOCUMENT.read_text("utf-8"), content.tables, DOCUMENT.parent)
    DOCUMENT.write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

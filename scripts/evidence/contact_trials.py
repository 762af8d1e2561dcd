"""Compare trial methods for contact by their errors against the rigid limit.

    .venv/bin/python scripts/evidence/contact_trials.py [--periods 160] [--workers 2] [--redraw]

The script replaces the table between `<!-- table trials -->` and `<!-- end -->` in
docs/evidence/convergence.md and writes the figure of the comparison.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ladders.document import fill
from trials.compare import (
    LIMIT_STEPS,
    STEPS,
    errors_in,
    errors_of,
    figure,
    measure,
    table,
)

from delam_fem.api import style

ROOT = Path(__file__).parents[2]
DOCUMENT = ROOT / "docs" / "evidence" / "convergence.md"
FIGURE = ROOT / "docs" / "figures" / "convergence_trials.png"


def main(arguments: list[str] | None = None) -> int:
    """Compute and print the comparison, update the document, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--periods", type=int, default=160)
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument(
        "--redraw", action="store_true", help="draw the figure from the table; compute nothing"
    )
    given = parser.parse_args(arguments)
    if given.redraw:
        with style.styled():
            figure(errors_in(DOCUMENT.read_text("utf-8"))).savefig(FIGURE)
        return 0
    found, limit = measure(STEPS, LIMIT_STEPS, given.periods, given.workers)
    shown = table(found, limit)
    sys.stdout.write(shown.markdown() + "\n")
    with style.styled():
        figure(errors_of(found, limit)).savefig(FIGURE)
    DOCUMENT.write_text(fill(DOCUMENT.read_text("utf-8"), {"trials": shown}), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

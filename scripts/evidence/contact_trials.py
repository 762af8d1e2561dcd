"""Compare trial methods for contact by their errors against the rigid limit.

    .venv/bin/python scripts/evidence/contact_trials.py [--periods 160] [--workers 2] [--redraw]

The script writes the table that docs/evidence/convergence.md links to, and the figure of the
comparison.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from refinements.document import write_csv
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
TABLE = ROOT / "docs" / "evidence" / "tables" / "trials.csv"
FIGURE = ROOT / "docs" / "figures" / "convergence_trials.png"


def main(arguments: list[str] | None = None) -> int:
    """Compute and print the comparison, update the document, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--periods", type=int, default=160)
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument(
        "--redraw", action="store_true", help="draw the figure from the table; compute nothing"
    )
    options = parser.parse_args(arguments)
    if options.redraw:
        with style.styled():
            figure(errors_in(TABLE)).savefig(FIGURE)
        return 0
    trials, limit = measure(STEPS, LIMIT_STEPS, options.periods, options.workers)
    trial_table = table(trials, limit)
    sys.stdout.write(trial_table.markdown() + "\n")
    with style.styled():
        figure(errors_of(trials, limit)).savefig(FIGURE)
    write_csv(TABLE, trial_table)
    return 0


if __name__ == "__main__":
    sys.exit(main())

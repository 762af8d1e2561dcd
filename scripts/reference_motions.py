"""Compute the four reference motions and compare them with the paper's descriptions.

    .venv/bin/python scripts/reference_motions.py [--preset paper] [--periods 300] [--engine petsc]

The exit status is 1 if a motion is of another kind than in the paper.
"""

from __future__ import annotations

import argparse
import sys

from rich.console import Console
from rich.table import Table

import delam_fem as df
from delam_fem.paper.motion_table import HEADINGS, motion_rows


def main(arguments: list[str] | None = None) -> int:
    """Print the table; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--preset", default="paper", choices=df.PRESETS)
    parser.add_argument("--periods", type=int, default=300)
    parser.add_argument("--engine", default="petsc", choices=("petsc", "compiled"))
    given = parser.parse_args(arguments)
    rows, all_hold = motion_rows(given.preset, given.periods, given.engine)
    table = Table(*HEADINGS, title=f"preset {given.preset}, {given.periods} periods")
    for cells in rows:
        table.add_row(*cells)
    Console(width=200).print(table)
    return 0 if all_hold else 1


if __name__ == "__main__":
    sys.exit(main())

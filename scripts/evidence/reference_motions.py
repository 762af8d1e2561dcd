"""Compute the four reference motions and compare them with the paper's descriptions.

    .venv/bin/python scripts/evidence/reference_motions.py [--preset paper] [--periods 300]
        [--engine petsc]

The exit status is 1 if a motion is of another kind than in the paper.
"""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table

import delam_fem as df
from delam_fem.api import preset
from delam_fem.paper.runs import MOTIONS, PaperMotion, contacts, strikes

if TYPE_CHECKING:
    from delam_fem.api import EngineName, Result

HEADINGS = (
    "f [Hz]", "paper", "contacts per period", "strike: thick / thin [m/s]", "period (paper)",
    "period (scatter)", "y1 [mm]", "y2 [mm]", "least tip gap [mm]", "energy residual", "s",
    "as paper",
)  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Print the table; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--preset", default="paper", choices=df.PRESETS)
    parser.add_argument("--periods", type=int, default=300)
    parser.add_argument("--engine", default="petsc", choices=("petsc", "compiled"))
    options = parser.parse_args(arguments)
    rows, all_hold = motion_rows(options.preset, options.periods, options.engine)
    table = Table(*HEADINGS, title=f"preset {options.preset}, {options.periods} periods")
    for cells in rows:
        table.add_row(*cells)
    Console(width=200).print(table)
    return 0 if all_hold else 1


def motion_rows(base: str, periods: int, engine: EngineName) -> tuple[list[tuple[str, ...]], bool]:
    """Compute the four motions with a preset and compare them with the paper.

    Args:
        base: name of the preset.
        periods: periods of each run.
        engine: name of the engine that computes the steps.

    Returns:
        A row below `HEADINGS` for each motion, and whether all motions are as the paper describes.
    """
    results = [compute(base, m.frequency, engine, {"time.periods": periods}) for m in MOTIONS]
    rows = [row(motion, result) for motion, result in zip(MOTIONS, results, strict=True)]
    return rows, all(m.is_shown_by(r) for m, r in zip(MOTIONS, results, strict=True))


def compute(base: str, frequency: float, engine: EngineName, overrides: dict[str, Any]) -> Result:
    """Run a preset at a frequency [Hz] without keeping fields."""
    from delam_fem.api import run

    keys = {"excitation.frequency": frequency, "output.fields_per_period": 0}
    return run(preset(base, keys | overrides), engine)


def row(motion: PaperMotion, result: Result) -> tuple[str, ...]:
    """Return the table cells of a motion, in the order of `HEADINGS`."""
    s = result.summary
    thick, thin = strikes(result).mean
    low, high = (1e3 * np.array(s[name]) for name in ("tip_min", "tip_max"))
    scatter = s["strobe_scatter"]
    return (
        f"{motion.frequency:.2f}",
        motion.text,
        f"{contacts(result):.2f}",
        "–" if np.isnan(thick) else f"{thick:+.2f} / {thin:+.2f}",
        f"{motion.periodicity}",
        (s["periodicity_class"] or "–").removeprefix("period ")
        + ("" if scatter is None else f" ({100 * scatter:.2g} %)"),
        f"{low[0]:.1f} … {high[0]:.1f}",
        f"{low[1]:.1f} … {high[1]:.1f}",
        f"{1e3 * s['minimum_tip_gap']:.2f}",
        f"{s['energy_residual']:.0e}",
        f"{s['wall_seconds']:.1f}",
        "yes" if motion.is_shown_by(result) else "NO",
    )


if __name__ == "__main__":
    sys.exit(main())

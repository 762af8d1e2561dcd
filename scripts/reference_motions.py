"""Compute the four reference motions and lay them beside what the paper describes.

    .venv/bin/python scripts/reference_motions.py [--preset paper] [--periods 300] [--engine petsc]

Exit status 1 where a motion is of another kind.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import delam_fem as df
from delam_fem.results.dataset import Result

CONTACT_GAP = 0.05
"""Closures less than so many periods apart are one contact."""


@dataclass(frozen=True)
class Motion:
    """What the paper says about one frequency, and how a result shows it."""

    frequency: float
    text: str
    periodicity: int
    holds: Callable[[Result], bool]


def strike_velocities(result: Result) -> tuple[float, float]:
    """Return the mean tip velocities (thick, thin) two steps before the strikes [m/s].

    A strike is the first closure of a tip contact of which the approach is the fastest in its
    period; impacts further down reach the tip as waves in the very last step.
    """
    history, period = result.history, result.case.period
    at_tip = history.event_node.values == history.sizes["node"] - 1
    times, speeds = (
        history[name].values[at_tip] for name in ("event_time", "event_velocity_before")
    )
    opens = np.diff(times, prepend=-np.inf) > CONTACT_GAP * period
    times, speeds = times[opens], speeds[opens]
    number = np.floor(times / period + 1e-9)
    fastest = [
        np.flatnonzero(number == k)[np.argmin(speeds[number == k])] for k in np.unique(number)
    ]
    steps = np.searchsorted(history.time.values, times[fastest], side="right") - 3
    steps = steps[steps >= 0]
    if not steps.size:
        return float("nan"), float("nan")
    thick, thin = history.tip_velocity.values[:, steps].mean(axis=1)
    return float(thick), float(thin)


def _contacts(result: Result) -> float:
    return float(result.summary["tip_contacts_per_period"] or 0.0)  # None: law "none"


def _no_tip_contact(result: Result) -> bool:
    return _contacts(result) == 0.0 and result.summary["minimum_tip_gap"] > 0.0


def _thin_beats_thick(result: Result) -> bool:
    thick, thin = strike_velocities(result)
    return _contacts(result) >= 1.0 and abs(thin) > 2.0 * abs(thick)


def _thick_beats_thin(result: Result) -> bool:
    thick, thin = strike_velocities(result)
    return _contacts(result) == 1.0 and thick > 0.0 > thin


def _one_in_two(result: Result) -> bool:
    return _contacts(result) == 0.5


MOTIONS = (
    Motion(1.25, "no tip contact, weak contact near the clamp", 1, _no_tip_contact),
    Motion(1.60, "the thin lamina beats the thick one", 1, _thin_beats_thick),
    Motion(3.25, "the thick beats the thin, opposite velocities", 1, _thick_beats_thin),
    Motion(3.65, "one contact in two periods", 2, _one_in_two),
)


def compute(preset: str, frequency: float, **settings: Any) -> Result:
    """Run a preset at one frequency without fields."""
    engine = settings.pop("engine", "petsc")
    keys = {"excitation.frequency": frequency, "output.fields_per_period": 0}
    return df.run(df.preset(preset, keys | settings), engine=engine)


def row(motion: Motion, result: Result) -> tuple[list[str], bool]:
    """Return the cells of a motion and whether it is of the kind that the paper describes."""
    s = result.summary
    holds = motion.holds(result) and s["periodicity"] == motion.periodicity
    thick, thin = strike_velocities(result)
    low, high = (1e3 * np.array(s[name]) for name in ("tip_min", "tip_max"))
    scatter = s["strobe_scatter"]
    cells = [
        f"{motion.frequency:.2f}",
        motion.text,
        f"{_contacts(result):.2f}",
        "–" if np.isnan(thick) else f"{thick:+.2f} / {thin:+.2f}",
        f"{motion.periodicity}",
        f"{s['periodicity'] or '–'}" + ("" if scatter is None else f" ({100 * scatter:.2g} %)"),
        f"{low[0]:.1f} … {high[0]:.1f}",
        f"{low[1]:.1f} … {high[1]:.1f}",
        f"{1e3 * s['minimum_tip_gap']:.2f}",
        f"{s['energy_residual']:.0e}",
        f"{s['wall_seconds']:.1f}",
        "yes" if holds else "NO",
    ]
    return cells, holds


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
    given = parser.parse_args(arguments)
    table = Table(*HEADINGS, title=f"preset {given.preset}, {given.periods} periods")
    all_hold = True
    for motion in MOTIONS:
        settings = {"time.periods": given.periods, "engine": given.engine}
        cells, holds = row(motion, compute(given.preset, motion.frequency, **settings))
        table.add_row(*cells)
        all_hold &= holds
    Console(width=200).print(table)
    return 0 if all_hold else 1


if __name__ == "__main__":
    sys.exit(main())

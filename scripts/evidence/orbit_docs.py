"""Draw the branches of a preset over its brute-force diagram, for docs/evidence/orbits.md.

    .venv/bin/python scripts/evidence/orbit_docs.py paper [--folder runs/orbits] [-o docs]

It follows the branches from 3.3 to 4.0 Hz, sweeps the frequency both ways (each point goes on from
the one before), draws figures/orbits_PRESET.png and prints the events, which
docs/evidence/orbits.md quotes.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import delam_fem as df
from delam_fem.api import style
from delam_fem.studies.orbits.follow import branch_diagram
from delam_fem.studies.orbits.maps import FREQUENCY
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.run import run_sweep

DOCS = Path(__file__).parents[2] / "docs"


def main(arguments: list[str] | None = None) -> int:
    """Follow, sweep, draw and print; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("preset", choices=("paper", "default"))
    parser.add_argument("--range", type=float, nargs=2, default=(3.3, 4.0), metavar="HZ")
    parser.add_argument("--count", type=int, default=141, help="frequencies of the sweep")
    parser.add_argument("--periods", type=int, default=300, help="at each frequency")
    parser.add_argument("--strobes", type=int, default=40, help="the last of them")
    parser.add_argument("--folder", type=Path, help="keeps both, and goes on with what is there")
    parser.add_argument("-o", "--output", type=Path, default=DOCS)
    options = parser.parse_args(arguments)
    low, high = options.range
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)) / options.preset
        began = time.process_time()
        branches = df.follow(
            df.preset(options.preset), FREQUENCY, low, high, folder / "branches", resume=True
        )
        spent = time.process_time() - began
        swept = run_sweep(
            sweep_of({
                "name": "brute-force", "base": options.preset, "order": "both",
                "set": {"time.periods": options.periods}, "record": {"strobes": options.strobes},
                "axis": [{"key": FREQUENCY, "start": low, "stop": high, "count": options.count}],
            }),
            folder / "sweep", "serial", resume=True, is_confirmed=True,
        )  # fmt: skip
        with swept, style.styled():
            (options.output / "figures").mkdir(parents=True, exist_ok=True)
            figure = branch_diagram(branches, swept)
            figure.savefig(options.output / "figures" / f"orbits_{options.preset}.png")
    sys.stdout.write(f"{branches.sizes['point']} points, {spent:.0f} s of processor time\n")
    for k in range(branches.sizes["event"]):
        at, first, last = (
            float(branches[f"event_{name}"][k]) for name in ("parameter", "low", "high")
        )
        branch = 1 + int(branches["branch"][int(branches["event_point"][k])])
        kind = branches["event_kind"][k].item()
        sys.stdout.write(f"| {branch} | {kind} | {at:.4f} | {first:.4f} to {last:.4f} |\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

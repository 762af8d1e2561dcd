"""Measure what reduced models tend to, and how smooth their maps are; draw both.

    .venv/bin/python scripts/reduced_study.py [--redraw]

It writes docs/reduced.json and docs/figures/reduced.png. docs/reduced.md quotes the numbers.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import delam_fem as df
from delam_fem.results.figures.style import styled
from delam_fem.studies.orbits.family import FREQUENCY, CaseFamily
from delam_fem.studies.reduced.limits import as_rows, figure, kick_growth, limit_of
from delam_fem.studies.reduced.strobe import ReducedMap

DOCS = Path(__file__).parents[1] / "docs"
RESONANT = 3.25
ELEMENTS = {
    "stiffness": {20: -19.73, 40: -18.79, 80: -17.99, 160: -17.65, 320: -17.5},
    "two-mode": {20: -22.80, 40: -21.51, 80: -20.42, 160: -19.43, 320: -18.9},
}
"""Limits of finite elements with so many contact points [mm]: docs/convergence.md."""
SIZES = tuple(10.0**-k for k in range(1, 11))


def main(arguments: list[str] | None = None) -> int:
    """Measure, write, draw; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--modes", default="8,12,20,30")
    parser.add_argument("--points", default="20,40,80")
    parser.add_argument("--refine", type=int, default=256)
    parser.add_argument("--settle", type=int, default=150)
    parser.add_argument("--periods", type=int, default=40)
    parser.add_argument("-o", "--output", type=Path, default=DOCS)
    parser.add_argument("--redraw", action="store_true", help="compute nothing")
    given = parser.parse_args(arguments)
    path = given.output / "reduced.json"
    if not given.redraw:
        path.write_text(json.dumps(measured(given), indent=1) + "\n", "utf-8")
    found = json.loads(path.read_text("utf-8"))
    (given.output / "figures").mkdir(exist_ok=True)
    with styled():
        drawn = figure(found["limits"], ELEMENTS, found["growth"], SIZES)
        drawn.savefig(given.output / "figures" / "reduced.png")
    return 0


def measured(given: argparse.Namespace) -> dict[str, object]:
    """Return limits by damping model, and the growth of kicks by map."""
    modes, points = ([int(n) for n in text.split(",")] for text in (given.modes, given.points))
    limits = {}
    for damping in ELEMENTS:
        rows = []
        for n in points:
            case = df.preset("default", {"mesh.elements": n, "damping.rayleigh": damping})
            for m in modes:
                if m > n:  # the modes of so coarse a mesh mean nothing
                    continue
                rows.append(limit_of(case, m, given.refine, given.settle, given.periods))
                sys.stdout.write(f"{damping}: {rows[-1]}\n")
        limits[damping] = as_rows(rows)
    case = df.preset("default", {"mesh.elements": min(points)})
    growth = {}
    for name, strobe in (
        ("finite elements, r = 64", CaseFamily(case, FREQUENCY).map()),
        (
            f"{modes[0]} modes, r = {given.refine}",
            ReducedMap(case, modes=modes[0], refine=given.refine),
        ),
    ):
        state = 0.0 * strobe.slow.basis[:, :1].T
        for _ in range(given.settle):
            state = strobe.after(state, RESONANT)
        growth[name] = kick_growth(strobe, state[0], RESONANT, SIZES)
    return {"limits": limits, "growth": growth}


if __name__ == "__main__":
    sys.exit(main())

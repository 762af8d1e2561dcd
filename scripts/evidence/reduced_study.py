"""Measure what reduced models tend to, and how smooth their maps are; draw both.

    .venv/bin/python scripts/evidence/reduced_study.py [--redraw]

It writes reduced.json and figures/reduced.png in docs/evidence, whose massless.md quotes the
numbers.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import delam_fem as df
from delam_fem.api import Case, FloatArray, style
from delam_fem.studies.orbits.maps import FREQUENCY, CaseFamily, ModalMap, PeriodMap

DOCS = Path(__file__).parents[2] / "docs" / "evidence"
RESONANT = 3.25
ELEMENTS = {
    "stiffness": {20: -19.73, 40: -18.79, 80: -17.99, 160: -17.65, 320: -17.5},
    "two-mode": {20: -22.80, 40: -21.51, 80: -20.42, 160: -19.43, 320: -18.9},
}
"""Limits of finite elements with so many contact points [mm]: docs/evidence/convergence.md."""
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
    options = parser.parse_args(arguments)
    path = options.output / "reduced.json"
    if not options.redraw:
        path.write_text(json.dumps(measured(options), indent=1) + "\n", "utf-8")
    results = json.loads(path.read_text("utf-8"))
    (options.output / "figures").mkdir(exist_ok=True)
    with style.styled():
        drawn = figure(results["limits"], ELEMENTS, results["growth"], SIZES)
        drawn.savefig(options.output / "figures" / "reduced.png")
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
            ModalMap(massless(case, modes[0], given.refine)),
        ),
    ):
        state = 0.0 * strobe.slow.basis[:, :1].T
        for _ in range(given.settle):
            state = strobe.after(state, RESONANT)
        growth[name] = kick_growth(strobe, state[0], RESONANT, SIZES)
    return {"limits": limits, "growth": growth}


Limits = Sequence[Mapping[str, float]]
"""Rows of `asdict(Limit)`, as JSON holds them."""


@dataclass(frozen=True)
class Limit:
    """Means over the last periods of a reduced case.

    Attributes:
        modes: number of modes of each part.
        points: number of contact points.
        refine: number of fine steps in a coarse one.
        y1_min, y1_max, y2_min, y2_max: means of the extremes of both tips within a period [mm].
        scatter: standard deviation of y1_min from period to period [mm].
        closing: loss at instants of closing, share of the work of the drive [-].
        steps: steps per period.
        microseconds: of processor time per step.
    """

    modes: int
    points: int
    refine: int
    y1_min: float
    y1_max: float
    y2_min: float
    y2_max: float
    scatter: float
    closing: float
    steps: float
    microseconds: float


def massless(case: Case, modes: int | None, refine: int) -> Case:
    """Return a case in modes, or of beams, with contact points that have no mass."""
    model: dict[str, object] = {"time.mass": "massless"}
    if modes is not None:
        model |= {"model.kind": "modes", "model.modes": modes}
    rigid = {"contact.law": "newton", "contact.restitution": 0.0, "time.refine": refine}
    return case.with_overrides(model | rigid)


def limit_of(
    case: Case, modes: int | None, refine: int, settle: int = 150, periods: int = 60
) -> Limit:
    """Return the means of a case with two laminae, after a number of periods from rest.

    Without a number of modes it is computed as beams.
    """
    problem = ModalMap(massless(case, modes, refine)).at(RESONANT)
    state = np.zeros(problem.periods.reduced.n_state)
    for _ in range(1 + settle):
        state = problem.periods.advance(state, problem.drive)
    extremes = []
    exchanged = np.zeros(4)
    steps = 0
    begin = time.thread_time()
    computed = [problem.periods.record(state, problem.drive)]
    while len(computed) < periods:
        computed.append(problem.periods.record(computed[-1].end, problem.drive))
    seconds = time.thread_time() - begin
    for period in computed:
        tips = 1e3 * problem.displacements(period)
        extremes.append([tips[:, 0].min(), tips[:, 0].max(), tips[:, 1].min(), tips[:, 1].max()])
        exchanged += period.exchanged
        steps += int(period.effort.sum())
    means, (work, *_, closing) = np.mean(extremes, axis=0), exchanged.tolist()
    return Limit(
        modes=problem.periods.reduced.n_modes // problem.periods.reduced.n_parts,
        points=problem.periods.reduced.n_pairs,
        refine=refine,
        **dict(zip(("y1_min", "y1_max", "y2_min", "y2_max"), means.tolist(), strict=True)),
        scatter=float(np.std(np.array(extremes)[:, 0])),
        closing=closing / work,
        steps=steps / periods,
        microseconds=1e6 * seconds / steps,
    )


def kick_growth(
    strobe: PeriodMap, state: FloatArray, parameter: float, sizes: Sequence[float]
) -> list[float]:
    """Return by how much one period makes two-sided kicks of the first slow coordinate grow.

    Args:
        strobe: the map.
        state: a state on its attractor.
        parameter: of the map.
        sizes: sizes of kicks, relative to the slow coordinates of the state.
    """
    slow = strobe.slow
    scale = float(np.linalg.norm(slow.of(state)))
    growth = []
    for size in sizes:
        kick = size * scale * slow.basis[:, 0]
        ends = slow.of(strobe.after(np.stack([state + kick, state - kick]), parameter))
        growth.append(float(np.linalg.norm(ends[0] - ends[1])) / (2.0 * size * scale))
    return growth


def figure(
    limits: Mapping[str, Limits],
    elements: Mapping[str, Mapping[int, float]],
    growth: Mapping[str, Sequence[float]],
    sizes: Sequence[float],
) -> Figure:
    """Return the picture of the limits over the contact points, and of kicks over their size.

    Args:
        limits: rows of `Limit` by damping model.
        elements: limits of y1_min of finite elements by damping model and contact points [mm].
        growth: growth of kicks by name of the map.
        sizes: sizes of the kicks.
    """
    canvas = Figure(figsize=(style.WIDTH, 3.9), layout="constrained")
    panels = canvas.subplots(1, len(limits) + 1)
    for axes, (damping, rows) in zip(panels, limits.items(), strict=False):
        _draw_limits(axes, rows, elements[damping])
        axes.set_title(f"{damping} damping", loc="left")
    canvas.legend(*panels[0].get_legend_handles_labels(), loc="outside lower left", ncols=6)
    kicks: Axes = panels[-1]
    for name, values in growth.items():
        kicks.loglog(sizes, values, "o-", ms=4, label=name)
    kicks.set_xlabel("kick, relative to the state")
    kicks.set_ylabel("growth in one period")
    kicks.set_title("smoothness", loc="left")
    kicks.legend(loc="lower center", bbox_to_anchor=(0.5, 1.08))
    return canvas


def _draw_limits(axes: Axes, rows: Limits, elements: Mapping[int, float]) -> None:
    """Draw y1 over the number of contact points, a line for each number of modes."""
    counts = sorted({int(row["modes"]) for row in rows})
    for colour, modes in zip(style.LAMINA_COLOURS, counts, strict=False):
        mode_rows = sorted((r for r in rows if r["modes"] == modes), key=lambda row: row["points"])
        axes.semilogx(
            [row["points"] for row in mode_rows],
            [row["y1_min"] for row in mode_rows],
            "o-",
            ms=4,
            color=colour,
            label=f"{modes} modes",
        )
    axes.semilogx(*zip(*sorted(elements.items()), strict=True), "k--", label="finite elements")
    points = sorted({int(row["points"]) for row in rows} | set(elements))
    axes.set_xticks(points, [str(n) for n in points])
    axes.minorticks_off()
    axes.set_xlabel("contact points")
    axes.set_ylabel("smallest y1 [mm]")


def as_rows(limits: Sequence[Limit]) -> list[dict[str, float]]:
    """Return limits as JSON holds them."""
    return [asdict(limit) for limit in limits]


if __name__ == "__main__":
    sys.exit(main())

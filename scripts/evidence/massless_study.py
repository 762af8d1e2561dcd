"""Measure beams whose nodes have no mass: orders, limits, noise and cost beside restitution.

    .venv/bin/python scripts/evidence/massless_study.py [--points 20,40] [--refine 256] [-o DOCS]

It replaces the tables `massless …` of docs/evidence/massless.md.
"""

from __future__ import annotations

import argparse
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
from reduced_study import ELEMENTS, RESONANT, Limit, limit_of
from refinements.document import fill

import delam_fem as df
from delam_fem.api import Case, assemble, lowest
from delam_fem.studies.convergence.analysis import Table

DOCS = Path(__file__).parents[2] / "docs" / "evidence"
BEAMS: dict[str, object] = {"time.mass": "massless", "contact.restitution": 0.0}
MODES: dict[str, object] = BEAMS | {"model.kind": "modes", "model.modes": 12}


def main(arguments: list[str] | None = None) -> int:
    """Measure, write the tables; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", default="20,40,80,160")
    parser.add_argument("--refine", default="16,64,256,1024")
    parser.add_argument("--settle", type=int, default=100)
    parser.add_argument("--periods", type=int, default=20)
    parser.add_argument("-o", "--output", type=Path, default=DOCS)
    options = parser.parse_args(arguments)
    points, refine = (
        [int(n) for n in text.split(",")] for text in (options.points, options.refine)
    )
    page = options.output / "massless.md"
    span = (options.settle, options.periods)
    tables = {
        "massless frequencies": frequencies(points),
        "massless steps": steps(points[0], refine, *span),
        "massless limits": limits(points, refine[-2:], *span),
        "massless noise": noise(points[:2], refine[-2], *span),
    }
    page.write_text(fill(page.read_text("utf-8"), tables, page.parent), "utf-8")
    return 0


def frequencies(points: list[int]) -> Table:
    """Return the relative errors of three frequencies of the thick lamina, and their orders."""
    rows = []
    before = np.full(3, np.nan)
    for n in points:
        case = df.preset("default", {"mesh.elements": n} | BEAMS)
        dofs = np.arange(2 * n)
        o = assemble(case, needs_dolfinx=False).operators
        numerical, _ = lowest(o.stiffness[dofs][:, dofs], o.mass[dofs][:, dofs], 3)
        exact = case.lamina[0].angular_frequencies(3) / (2.0 * np.pi)
        errors = np.abs(numerical / exact - 1.0)
        orders = np.log2(before / errors) / np.log2(n / rows[-1][0]) if rows else before
        before = errors
        rows.append((n, *errors, *orders))
    heading = ("elements", "f1", "f2", "f3", "order", "order", "order")
    text_rows = [
        (str(n), *(f"{x:.1e}" for x in r[:3]), *("" if np.isnan(x) else f"{x:.1f}" for x in r[3:]))
        for n, *r in rows
    ]
    return Table("frequencies", heading, tuple(text_rows))


def steps(n: int, refine: list[int], settle: int, periods: int) -> Table:
    """Return what finer steps do on one mesh, stiffness damping."""
    case = df.preset("default", {"mesh.elements": n, "damping.rayleigh": "stiffness"})
    results = [limit_of(case, None, r, settle, periods) for r in (1, *refine)]
    orders = [""] + [
        f"{np.log(a.closing / b.closing) / np.log(b.refine / a.refine):.2f}"
        for a, b in pairwise(results)
    ]
    rows = [(*_limit(limit), order) for limit, order in zip(results, orders, strict=True)]
    return Table("steps", (*HEADING, "order of the closing loss"), tuple(rows))


def limits(points: list[int], refine: list[int], settle: int, periods: int) -> Table:
    """Return limits over the mesh with both models of damping, beside finite elements."""
    rows = []
    for damping, elements in ELEMENTS.items():
        for n in points:
            case = df.preset("default", {"mesh.elements": n, "damping.rayleigh": damping})
            for r in refine:
                limit = limit_of(case, None, r, settle, periods)
                sys.stdout.write(f"{damping}: {limit}\n")
                rows.append((damping, str(n), *_limit(limit), f"{elements.get(n, np.nan):.2f}"))
    return Table("limits", ("damping", "points", *HEADING, "finite elements"), tuple(rows))


HEADING = ("r", "y1 [mm]", "± from period to period", "closing loss [%]", "steps", "µs/step")


def _limit(own: Limit) -> tuple[str, ...]:
    """Return a limit as cells of `HEADING`."""
    return (
        str(own.refine), f"{own.y1_min:.2f}", f"{own.scatter:.4f}", f"{100.0 * own.closing:.2f}",
        f"{own.steps:.0f}", f"{own.microseconds:.1f}",
    )  # fmt: skip


def noise(points: list[int], refine: int, settle: int, periods: int) -> Table:
    """Return how rough contact is: restitution, twelve modes, and nodes without mass."""
    methods: dict[str, dict[str, object]] = {
        f"moreau-jean, e = {e:g}": {"contact.restitution": e} for e in (0.0, 0.1, 0.5, 0.9, 1.0)
    }
    methods |= {"massless, 12 modes": MODES, "massless, beams": BEAMS}
    rows = []
    for n in points:
        for name, keys in methods.items():
            case = df.preset(
                "default",
                {
                    "mesh.elements": n, "damping.rayleigh": "stiffness", "time.refine": refine,
                    "excitation.frequency": RESONANT, "output.fields_per_period": 0,
                    "time.periods": settle + periods, "output.window_periods": periods,
                }
                | keys,
            )  # fmt: skip
            begin = time.thread_time()
            data = df.run(case).history
            seconds = (time.thread_time() - begin) / (settle + periods)
            y1 = 1e3 * data["envelope_min"][0, -periods:].to_numpy()
            scatter, roughness, many = roughness_of(data, case, periods)
            rows.append(
                (
                    str(n), name, f"{y1.mean():.2f}", f"{y1.std():.3f}", f"{many:.0f}",
                    f"{100.0 * scatter:.1f}", f"{roughness:.1f}", f"{1e3 * seconds:.1f}",
                )
            )  # fmt: skip
            sys.stdout.write(f"{rows[-1]}\n")
    heading = (
        "points", "contact", "y1 [mm]", "±", "impulses", "scatter of the force [%]", "roughness",
        "ms/period",
    )  # fmt: skip
    return Table("noise", heading, tuple(rows))


def roughness_of(data: object, case: Case, periods: int) -> tuple[float, float, float]:
    """Return how rough the sum of all contact forces is, in means over time steps.

    Returns:
        Its standard deviation from period to period over its root mean square; its total variation
        over that of a single rise and fall to its largest value; impulses per period.
    """
    n = case.steps_per_period
    times, impulses = (data[f"event_{key}"].to_numpy() for key in ("time", "impulse"))  # type: ignore[index]
    first = round(float(data["time"][0]) / case.time_step) - 1  # type: ignore[index]
    place = np.clip(np.ceil(times / case.time_step - 1e-6).astype(int) - 1 - first, 0, None)
    force = np.bincount(place, impulses, periods * n)[: periods * n].reshape(periods, n)
    mean = force.mean(axis=0)
    scatter = float(np.sqrt(((force - mean) ** 2).mean() / (force**2).mean()))
    changes = np.abs(np.diff(force, axis=1)).sum(axis=1) / (2.0 * force.max(axis=1))
    return scatter, float(changes.mean()), times.size / periods


if __name__ == "__main__":
    sys.exit(main())

"""Make the tables of docs/convergence.md from the computed ladders of `study.py`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from delam_fem.numerics.extrapolation import Limit
from delam_fem.studies.convergence.analysis import Convergence
from delam_fem.studies.convergence.ladder import Rung
from delam_fem.studies.convergence.statistics import WORK, extrema
from delam_fem.studies.convergence.study import (
    DAMPINGS,
    FEW,
    FREQUENCIES,
    LAWS,
    LITERAL,
    MESHES,
    REFINED,
    RESTITUTIONS,
)
from delam_fem.studies.convergence.tables import Table, limit_text, number

DEFAULT_STEPS = (1000, 2000, 4000)
"""Steps per period of practical runs, at which the laws are compared."""
EXTREMA = extrema(2)
"""The document is about two laminae."""
Y1 = EXTREMA[0]


def document_tables(found: dict[str, Convergence]) -> dict[str, Table]:
    """Return all tables of the document by name; `found` has the computed ladders by name."""
    tables = {
        "what converges": what_converges(found),
        "motions": motions(found),
        "motion errors": motion_errors(found),
        "restitutions": restitutions(found),
        "literal": literal(found),
        "default": default_errors(found),
    }
    for damping in DAMPINGS:
        tables[f"errors {damping}"] = errors(found, damping)
        tables[f"meshes {damping}"] = meshes(found, damping)
    return tables


def mm(found: Convergence, rung: Rung, digits: int = 2) -> str:
    """Return the smallest y1 of a rung [mm] as text, or why the rung was not completed."""
    result = found.results[rung.key]
    value = Y1.factor * found.value(rung, Y1.name)
    return number(value, f".{digits}f") if result.outcome == "completed" else result.error


def limit_row(found: Convergence, rungs: Sequence[Rung], others: Sequence[Rung]) -> list[str]:
    """Return extremes and contact work of the last rung as text, with estimated errors.

    The estimated error is the largest of three numbers. These are the change by the last
    refinement, twice the standard error, and the difference from the last rung of `others` (another
    law).
    """
    last, before = rungs[-1], rungs[-2]
    cells = []
    for q in (*EXTREMA, WORK):
        value = found.value(last, q.name)
        changes = [abs(value - found.value(rung, q.name)) for rung in (before, *others[-1:])]
        error = max(*changes, 2.0 * found.standard_error(last, q.name))
        cells.append(limit_text(Limit(np.zeros(0), value, error, ""), q))
    return cells


def what_converges(all_found: dict[str, Convergence]) -> Table:
    """Return the smallest y1 of every law over steps per period."""
    found = all_found["laws"]
    rows = []
    for entry in found.ladder.methods:
        rungs = found.ladder.along_steps(entry, 20)
        rows.append((entry.name, *(mm(found, rung) for rung in rungs)))
    return Table("", ("law", *(f"N = {n}" for n in FEW)), tuple(rows))


def errors(all_found: dict[str, Convergence], damping: str) -> Table:
    """Return errors against the limit, and costs, of every law over steps per period."""
    found = all_found[damping]
    heading = ["N"]
    for entry in LAWS:
        heading += [f"{entry.name} [%]", "µs/step"]
    rows = []
    for steps in found.ladder.steps:
        row = [str(steps)]
        for entry in LAWS:
            rung = found.ladder.rung(entry, 20, steps)
            cost = found.results[rung.key].microseconds_per_step
            row += [number(100.0 * found.error(rung), ".1f"), number(cost, ".2f")]
        rows.append(tuple(row))
    return Table("", tuple(heading), tuple(rows))


def meshes(all_found: dict[str, Convergence], damping: str) -> Table:
    """Return the rigid limit of each mesh."""
    found = all_found[damping]
    ladder, rigid, refined = found.ladder, LAWS[2], LAWS[3]
    rows = []
    for mesh in MESHES:
        rungs = [ladder.rung(rigid, mesh, ladder.steps[-1]), ladder.limit_of(mesh)]
        others = [ladder.rung(refined, mesh, ladder.steps[-1])]
        rows.append((str(mesh), *limit_row(found, rungs, others)))
    return Table("", ("elements", *(q.heading for q in (*EXTREMA, WORK))), tuple(rows))


def motions(all_found: dict[str, Convergence]) -> Table:
    """Return the rigid limits of the four motions."""
    rows = []
    for f in FREQUENCIES:
        found = all_found[f"{f:.2f} Hz"]
        rigid, refined = found.ladder.methods[0], found.ladder.methods[-1]
        rungs, others = (found.ladder.along_steps(law, 20) for law in (rigid, refined))
        rows.append((f"{f:.2f}", *limit_row(found, rungs, others)))
    return Table("", ("f [Hz]", *(q.heading for q in (*EXTREMA, WORK))), tuple(rows))


def motion_errors(all_found: dict[str, Convergence]) -> Table:
    """Return the errors of two laws at few steps for the four motions."""
    chosen = [(law, n) for law in ("newton@moreau-jean e = 0.1", REFINED) for n in DEFAULT_STEPS]
    rows = []
    for f in FREQUENCIES:
        found = all_found[f"{f:.2f} Hz"]
        methods = {entry.name: entry for entry in found.ladder.methods}
        rungs = [found.ladder.rung(methods[name], 20, steps) for name, steps in chosen]
        rows.append((f"{f:.2f}", *(number(100.0 * found.error(rung), ".1f") for rung in rungs)))
    heading = (f"{name.split()[0]}, N = {steps} [%]" for name, steps in chosen)
    return Table("", ("f [Hz]", *heading), tuple(rows))


def restitutions(all_found: dict[str, Convergence]) -> Table:
    """Return the smallest y1 over steps for three coefficients of restitution."""
    rows = []
    for name, where in [("restitution", "3.25, stiffness")] + [
        (f"{f:.2f} Hz", f"{f:.2f}, two-mode") for f in FREQUENCIES
    ]:
        found = all_found[name]
        for entry in found.ladder.methods[: len(RESTITUTIONS)]:
            rungs = [found.ladder.rung(entry, 20, steps) for steps in FEW]
            rows.append((where, entry.name.split(" = ")[1], *(mm(found, r) for r in rungs)))
    return Table("", ("f [Hz], damping", "e", *(f"N = {n}" for n in FEW)), tuple(rows))


def literal(all_found: dict[str, Convergence]) -> Table:
    """Return the energy that impacts of the literal scheme add, or when its motion diverges."""
    rows = []
    for damping in ("mass", *DAMPINGS):
        found = all_found[f"literal {damping}"]
        for entry in LITERAL:
            for steps in found.ladder.steps:
                rungs = found.ladder.along_meshes(entry, steps)
                cells = [_literal_cell(found, rung) for rung in rungs]
                rows.append((damping, entry.name.split("/")[0], str(steps), *cells))
    return Table("", ("damping", "law", "N", *(f"{n} elements" for n in MESHES)), tuple(rows))


def _literal_cell(found: Convergence, rung: Rung) -> str:
    result = found.results[rung.key]
    if result.outcome != "completed":
        return f"**{result.error}**"
    gain, work = (found.value(rung, name) for name in ("impact_gain", WORK.name))
    text = f"{100.0 * gain / (work + gain):.2g} %"
    return f"**{text}, net gain**" if work < 0.0 else text


def default_errors(all_found: dict[str, Convergence]) -> Table:
    """Return the errors of two laws with few steps per period on all meshes."""
    rows = []
    for damping in DAMPINGS:
        found = all_found[damping]
        for entry in LAWS[2:]:
            for steps in DEFAULT_STEPS:
                rungs = found.ladder.along_meshes(entry, steps)
                cells = (number(100.0 * found.error(rung), ".1f") for rung in rungs)
                rows.append((damping, entry.name, str(steps), *cells))
    return Table("", ("damping", "law", "N", *(f"{n} elements [%]" for n in MESHES)), tuple(rows))

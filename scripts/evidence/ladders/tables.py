"""Make the tables of docs/evidence/convergence.md from the computed ladders of `study.py`."""

from __future__ import annotations

from ladders.study import (
    DAMPINGS,
    DEFAULT,
    DEFAULT_STEPS,
    FEW,
    FINEST,
    FREQUENCIES,
    LITERAL,
    MESHES,
    PLAIN,
    POINTS,
    REFINED,
    REFINEMENTS,
    RESTITUTIONS,
)

from delam_fem.api import Table, number
from delam_fem.studies.convergence.analysis import Convergence, limit_text
from delam_fem.studies.convergence.ladder import Method, PointMesh, Rung
from delam_fem.studies.convergence.rung import WORK, extrema

EXTREMA = extrema(2)
"""The document is about two laminae."""
Y1 = EXTREMA[0]
Found = dict[str, Convergence]
"""The computed ladders by name."""


def document_tables(found: Found) -> dict[str, Table]:
    """Return all tables of the document by name."""
    tables = {
        "what converges": what_converges(found),
        "refined": refined(found),
        "motions": motions(found),
        "restitutions": restitutions(found),
        "limits": limits(found),
        "literal": literal(found),
    }
    for damping in DAMPINGS:
        tables[f"errors {damping}"] = errors(found[f"errors {damping}"])
    return tables


def mm(found: Convergence, rung: Rung, digits: int = 2) -> str:
    """Return the smallest y1 of a rung [mm] as text, or why the rung was not completed."""
    result = found.results[rung.key]
    value = Y1.factor * found.value(rung, Y1.name)
    return number(value, f".{digits}f") if result.outcome == "completed" else result.error


def per_cent(found: Convergence, rung: Rung) -> str:
    """Return the error of a rung against the rigid limit of its mesh [%] as text."""
    return number(100.0 * found.error(rung), ".1f")


def what_converges(all_found: Found) -> Table:
    """Return the smallest y1 of every law over steps per period."""
    study = all_found["laws"]
    rows = []
    for entry in study.ladder.methods:
        rungs = study.ladder.along_steps(entry, 20)
        rows.append((entry.name, *(mm(study, rung) for rung in rungs)))
    return Table("", ("law", *(f"N = {n}" for n in FEW)), tuple(rows))


def refined(all_found: Found) -> Table:
    """Return y1 and steps per period with refined steps beside y1 with uniform small steps."""
    heading = ["r"]
    columns = [["1", *map(str, REFINEMENTS)]]
    for damping in DAMPINGS:
        names = (f"errors {damping}", f"petsc {damping}", f"uniform {damping}")
        compiled, petsc, uniform = (all_found[name] for name in names)
        methods = (PLAIN, *(REFINED[r] for r in REFINEMENTS))
        rungs = [compiled.ladder.rung(m, 20, DEFAULT_STEPS) for m in methods]
        others = [petsc.ladder.rung(m, 20, DEFAULT_STEPS) for m in methods]
        heading += [f"{damping}: y1 [mm]", "PETSc", "uniform steps T/(1000 r)", "steps per period"]
        columns.append([mm(compiled, rung) for rung in rungs])
        columns.append([mm(petsc, rung) for rung in others])
        columns.append([mm(uniform, rung) for rung in uniform.ladder.along_steps(PLAIN, 20)])
        columns.append([number(compiled.value(rung, "steps"), ".0f") for rung in rungs])
    return Table("", tuple(heading), tuple(zip(*columns, strict=True)))


def errors(found: Convergence) -> Table:
    """Return errors against the limit, and costs, of every method over steps per period."""
    heading = ["N"]
    for entry in found.ladder.methods:
        heading += [f"{entry.name} [%]", "ms"]
    rows = []
    for steps in found.ladder.steps:
        row = [str(steps)]
        for entry in found.ladder.methods:
            rung = found.ladder.rung(entry, 20, steps)
            row += [per_cent(found, rung), number(1e3 * found.cost(rung), ".2f")]
        rows.append(tuple(row))
    return Table("", tuple(heading), tuple(rows))


def motions(all_found: Found) -> Table:
    """Return the rigid limits of the four motions, and what the default makes of them."""
    rows = []
    for damping in DAMPINGS:
        for f in FREQUENCIES:
            study = all_found[f"{f:.2f} Hz {damping}"]
            last = study.ladder.limit_of(20)
            extremes = [number(q.factor * study.value(last, q.name), ".2f") for q in EXTREMA]
            rows.append((damping, f"{f:.2f}", *extremes, *_of_default(study)))
    heading = ("damping", "f [Hz]", *(q.heading for q in EXTREMA), *DEFAULT_HEADING)
    return Table("", heading, tuple(rows))


DEFAULT_HEADING = ("plain T/1000 [%]", "plain T/4000 [%]", "default [%]", "its steps", "its cost")


def _of_default(found: Convergence) -> list[str]:
    """Return errors of plain steps and of the default; its steps; its cost over that of T/4000."""
    few, many = (found.ladder.rung(PLAIN, 20, n) for n in (DEFAULT_STEPS, 4000))
    default_rung = found.ladder.rung(DEFAULT, 20, DEFAULT_STEPS)
    cells = [per_cent(found, rung) for rung in (few, many, default_rung)]
    cost = found.cost(default_rung) / found.cost(many)
    return [*cells, number(found.value(default_rung, "steps"), ".0f"), number(cost, ".1f")]


def restitutions(all_found: Found) -> Table:
    """Return what the coefficient of restitution changes: limit, error of the default."""
    rows = []
    for damping in DAMPINGS:
        for e in RESTITUTIONS:
            study = all_found[f"e = {e:g} {damping}"]
            limit = mm(study, study.ladder.limit_of(20))
            rows.append((damping, f"{e:g}", limit, *_of_default(study)))
    return Table("", ("damping", "e", "y1 at T/256000 [mm]", *DEFAULT_HEADING), tuple(rows))


def limits(all_found: Found) -> Table:
    """Return the limit in time of each mesh, and the extrapolated limit in the contact points."""
    rows = []
    for damping in DAMPINGS:
        for name in POINTS:
            study = all_found[f"{name} {damping}"]
            for mesh in study.ladder.meshes:
                rungs = [study.ladder.rung(REFINED[r], mesh, 1000) for r in FINEST[name]]
                elements, per_element = _sizes(mesh)
                points = str(elements * per_element)
                rows.append((damping, str(elements), points, *_with_change(study, rungs)))
            rows.append((damping, name, "→ ∞", *_limit_row(study, REFINED[FINEST[name][-1]])))
    heading = ("damping", "elements", "points", *(q.heading for q in (*EXTREMA, WORK)), "steps")
    return Table("", heading, tuple(rows))


def _sizes(mesh: object) -> tuple[int, int]:
    """Return the number of elements, and of contact points per element."""
    if isinstance(mesh, PointMesh):
        assert isinstance(mesh.mesh, int)
        return mesh.mesh, mesh.per_element
    assert isinstance(mesh, int)
    return mesh, 1


def _with_change(found: Convergence, rungs: list[Rung]) -> list[str]:
    """Return the values of the last rung ± the change by the last refinement; and its steps."""
    before, last = rungs
    cells = []
    for q in (*EXTREMA, WORK):
        value, old = (q.factor * found.value(rung, q.name) for rung in (last, before))
        change = max(abs(value - old), 2.0 * q.factor * found.standard_error(last, q.name))
        cells.append(f"{number(value, '.4g')} ± {number(change, '.2g')}")
    return [*cells, number(found.value(last, "steps"), ".0f")]


def _limit_row(found: Convergence, method: Method) -> list[str]:
    """Return the extrapolated limits over the meshes, or why there is none."""
    rungs = [found.ladder.rung(method, mesh, 1000) for mesh in found.ladder.meshes]
    by = found.ladder.refines
    cells = [limit_text(found.limit(rungs, q.name, by=by), q) for q in (*EXTREMA, WORK)]
    return [*cells, ""]


def literal(all_found: Found) -> Table:
    """Return the energy that impacts of the literal scheme add, or when its motion diverges."""
    rows = []
    for damping in ("mass", *DAMPINGS):
        study = all_found[f"literal {damping}"]
        for entry in LITERAL:
            for steps in study.ladder.steps:
                rungs = study.ladder.along_meshes(entry, steps)
                cells = [_literal_cell(study, rung) for rung in rungs]
                rows.append((damping, entry.name.split("/")[0], str(steps), *cells))
    return Table("", ("damping", "law", "N", *(f"{n} elements" for n in MESHES)), tuple(rows))


def _literal_cell(found: Convergence, rung: Rung) -> str:
    result = found.results[rung.key]
    if result.outcome != "completed":
        return f"**{result.error}**"
    gain, work = (found.value(rung, name) for name in ("impact_gain", WORK.name))
    text = f"{100.0 * gain / (work + gain):.2g} %"
    return f"**{text}, net gain**" if work < 0.0 else text

"""Make the tables of docs/evidence/convergence.md from the computed studies."""

from __future__ import annotations

from refinements.study import (
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
from delam_fem.studies.convergence.level import WORK, extrema
from delam_fem.studies.convergence.refinement import Level, Method, PointMesh

EXTREMA = extrema(2)
"""The document is about two laminae."""
Y1 = EXTREMA[0]
Found = dict[str, Convergence]
"""The computed refinement studies by name."""


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


def mm(found: Convergence, level: Level, digits: int = 2) -> str:
    """Return the smallest y1 of a level [mm] as text, or why the level was not completed."""
    result = found.results[level.key]
    value = Y1.factor * found.value(level, Y1.name)
    return number(value, f".{digits}f") if result.outcome == "completed" else result.error


def per_cent(found: Convergence, level: Level) -> str:
    """Return the error of a level against the rigid limit of its mesh [%] as text."""
    return number(100.0 * found.error(level), ".1f")


def what_converges(all_found: Found) -> Table:
    """Return the smallest y1 of every law over steps per period."""
    study = all_found["laws"]
    rows = []
    for entry in study.refinement.methods:
        levels = study.refinement.along_steps(entry, 20)
        rows.append((entry.name, *(mm(study, level) for level in levels)))
    return Table("", ("law", *(f"N = {n}" for n in FEW)), tuple(rows))


def refined(all_found: Found) -> Table:
    """Return y1 and steps per period with refined steps beside y1 with uniform small steps."""
    heading = ["r"]
    columns = [["1", *map(str, REFINEMENTS)]]
    for damping in DAMPINGS:
        names = (f"errors {damping}", f"petsc {damping}", f"uniform {damping}")
        compiled, petsc, uniform = (all_found[name] for name in names)
        methods = (PLAIN, *(REFINED[r] for r in REFINEMENTS))
        levels = [compiled.refinement.level(m, 20, DEFAULT_STEPS) for m in methods]
        others = [petsc.refinement.level(m, 20, DEFAULT_STEPS) for m in methods]
        heading += [f"{damping}: y1 [mm]", "PETSc", "uniform steps T/(1000 r)", "steps per period"]
        columns.append([mm(compiled, level) for level in levels])
        columns.append([mm(petsc, level) for level in others])
        columns.append([mm(uniform, level) for level in uniform.refinement.along_steps(PLAIN, 20)])
        columns.append([number(compiled.value(level, "steps"), ".0f") for level in levels])
    return Table("", tuple(heading), tuple(zip(*columns, strict=True)))


def errors(found: Convergence) -> Table:
    """Return errors against the limit, and costs, of every method over steps per period."""
    heading = ["N"]
    for entry in found.refinement.methods:
        heading += [f"{entry.name} [%]", "ms"]
    rows = []
    for steps in found.refinement.steps:
        row = [str(steps)]
        for entry in found.refinement.methods:
            level = found.refinement.level(entry, 20, steps)
            row += [per_cent(found, level), number(1e3 * found.cost(level), ".2f")]
        rows.append(tuple(row))
    return Table("", tuple(heading), tuple(rows))


def motions(all_found: Found) -> Table:
    """Return the rigid limits of the four motions, and what the default makes of them."""
    rows = []
    for damping in DAMPINGS:
        for f in FREQUENCIES:
            study = all_found[f"{f:.2f} Hz {damping}"]
            last = study.refinement.limit_of(20)
            extremes = [number(q.factor * study.value(last, q.name), ".2f") for q in EXTREMA]
            rows.append((damping, f"{f:.2f}", *extremes, *_of_default(study)))
    heading = ("damping", "f [Hz]", *(q.heading for q in EXTREMA), *DEFAULT_HEADING)
    return Table("", heading, tuple(rows))


DEFAULT_HEADING = ("plain T/1000 [%]", "plain T/4000 [%]", "default [%]", "its steps", "its cost")


def _of_default(found: Convergence) -> list[str]:
    """Return errors of plain steps and of the default; its steps; its cost over that of T/4000."""
    few, many = (found.refinement.level(PLAIN, 20, n) for n in (DEFAULT_STEPS, 4000))
    default_level = found.refinement.level(DEFAULT, 20, DEFAULT_STEPS)
    cells = [per_cent(found, level) for level in (few, many, default_level)]
    cost = found.cost(default_level) / found.cost(many)
    return [*cells, number(found.value(default_level, "steps"), ".0f"), number(cost, ".1f")]


def restitutions(all_found: Found) -> Table:
    """Return what the coefficient of restitution changes: limit, error of the default."""
    rows = []
    for damping in DAMPINGS:
        for e in RESTITUTIONS:
            study = all_found[f"e = {e:g} {damping}"]
            limit = mm(study, study.refinement.limit_of(20))
            rows.append((damping, f"{e:g}", limit, *_of_default(study)))
    return Table("", ("damping", "e", "y1 at T/256000 [mm]", *DEFAULT_HEADING), tuple(rows))


def limits(all_found: Found) -> Table:
    """Return the limit in time of each mesh, and the extrapolated limit in the contact points."""
    rows = []
    for damping in DAMPINGS:
        for name in POINTS:
            study = all_found[f"{name} {damping}"]
            for mesh in study.refinement.meshes:
                levels = [study.refinement.level(REFINED[r], mesh, 1000) for r in FINEST[name]]
                elements, per_element = _sizes(mesh)
                points = str(elements * per_element)
                rows.append((damping, str(elements), points, *_with_change(study, levels)))
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


def _with_change(found: Convergence, levels: list[Level]) -> list[str]:
    """Return the values of the last level ± the change by the last refinement; and its steps."""
    before, last = levels
    cells = []
    for q in (*EXTREMA, WORK):
        value, old = (q.factor * found.value(level, q.name) for level in (last, before))
        change = max(abs(value - old), 2.0 * q.factor * found.standard_error(last, q.name))
        cells.append(f"{number(value, '.4g')} ± {number(change, '.2g')}")
    return [*cells, number(found.value(last, "steps"), ".0f")]


def _limit_row(found: Convergence, method: Method) -> list[str]:
    """Return the extrapolated limits over the meshes, or why there is none."""
    levels = [found.refinement.level(method, mesh, 1000) for mesh in found.refinement.meshes]
    by = found.refinement.refines
    cells = [limit_text(found.limit(levels, q.name, by=by), q) for q in (*EXTREMA, WORK)]
    return [*cells, ""]


def literal(all_found: Found) -> Table:
    """Return the energy that impacts of the literal scheme add, or when its motion diverges."""
    rows = []
    for damping in ("mass", *DAMPINGS):
        study = all_found[f"literal {damping}"]
        for entry in LITERAL:
            for steps in study.refinement.steps:
                levels = study.refinement.along_meshes(entry, steps)
                cells = [_literal_cell(study, level) for level in levels]
                rows.append((damping, entry.name.split("/")[0], str(steps), *cells))
    return Table("", ("damping", "law", "N", *(f"{n} elements" for n in MESHES)), tuple(rows))


def _literal_cell(found: Convergence, level: Level) -> str:
    result = found.results[level.key]
    if result.outcome != "completed":
        return f"**{result.error}**"
    gain, work = (found.value(level, name) for name in ("impact_gain", WORK.name))
    text = f"{100.0 * gain / (work + gain):.2g} %"
    return f"**{text}, net gain**" if work < 0.0 else text

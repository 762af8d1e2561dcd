"""Say in a line how far a case is from its limit; make short tables, all methods side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from delam_fem.studies.convergence.analysis import Convergence
from delam_fem.studies.convergence.ladder import FREE, Ladder, MeshChoice, Method, Rung
from delam_fem.studies.convergence.statistics import WORK
from delam_fem.studies.convergence.tables import NOTHING, Direction, Table, cost, lines, number


def verdict(found: Convergence) -> str:
    """Say how far the case itself is from the limit: "20 elements: 1.5 % from the limit …".

    The case is the rung with its own method, mesh and steps; what the ladder has not is replaced by
    its first method, finest mesh or smallest steps. Steps are judged against the smallest steps
    of newton@moreau-jean, meshes against the limit that is extrapolated over them.
    """
    ladder = found.ladder
    if not ladder.methods:
        return "No method with contact was asked for."
    own, case = ladder.methods[0], ladder.case
    for method in ladder.methods:
        if case.with_overrides(dict(method.overrides)) == case:
            own = method
    at = case.time.steps_per_period
    steps = at if at in ladder.steps else ladder.steps[-1]
    mesh = _own_mesh(ladder, own, steps)
    said = []
    if len(ladder.steps) > 1 or len(ladder.meshes) == 1:
        said.append(_distance(found, ladder.along_steps(own, mesh), "steps", steps, mesh))
    if len(ladder.meshes) > 1:
        said.append(_distance(found, ladder.along_meshes(own, steps), ladder.refines, steps, mesh))
    return " ".join([*said, *_elastic(found, mesh)])


def _elastic(found: Convergence, mesh: MeshChoice) -> Iterator[str]:
    """Say of e = 1 that the finest steps are no limit, with the number of their impulses."""
    ladder = found.ladder
    if ladder.case.contact.restitution == 1.0 and ladder.has_limit:
        count = number(found.value(ladder.limit_of(mesh), "impacts"), ".0f")
        yield (
            f"With e = 1 no step of this size shows a limit: contact takes nothing, so that pairs "
            f"that stay near one another are hit again and again, and the impulses per period "
            f"({count} at T/{ladder.limit_steps}) grow with 1/Δt. Compare other --limit-steps to "
            "see how far the extremes still move."
        )


def _own_mesh(ladder: Ladder, method: Method, steps: int) -> MeshChoice:
    """Return the mesh of the case, or the finest one of the ladder."""
    for mesh in ladder.meshes:
        made = ladder.rung(method, mesh, steps).case
        per_element = ladder.case.contact.points_per_element
        if made.mesh == ladder.case.mesh and made.contact.points_per_element == per_element:
            return mesh
    return ladder.meshes[-1]


def _distance(
    found: Convergence, rungs: Sequence[Rung], direction: Direction, steps: int, mesh: MeshChoice
) -> str:
    """Say how far one of the rungs of a line is from their limit."""
    (rung,) = (rung for rung in rungs if (rung.steps, rung.mesh) == (steps, mesh))
    by_steps = f"{rung.steps} steps per period"
    size, where = {
        "steps": (by_steps, rung.mesh_text),
        "elements": (rung.mesh_text, by_steps),
        "points": (f"{rung.points} contact points", by_steps),
    }[direction]
    by_rung = direction == "steps" and found.ladder.has_limit
    error = found.error(rung) if by_rung else found.error_along(rung, rungs, direction)
    place = f"({rung.method}, {where})."
    if math.isfinite(error):
        finest = f"T/{found.ladder.limit_steps} of newton@moreau-jean on this mesh"
        limit = finest if by_rung else "the limit"
        return f"{size}: {100.0 * error:.2g} % from {limit} {place}"
    step = found.error(rung, rungs[-1])
    if rung is rungs[-1] or not math.isfinite(step):
        return f"{size}: no limit can be told {place}"
    finest = getattr(rungs[-1], direction)
    return f"{size}: no limit can be told, {100.0 * step:.2g} % from {finest} {direction} {place}"


def overview(found: Convergence) -> Iterator[Table]:
    """Yield the short tables: errors, y1 and contact work of all methods side by side."""
    ladder = found.ladder
    for direction, where, rungs in _shown(ladder, FREE):
        yield _brief_free_table(found, rungs, direction, where)
    for direction, where, rungs in _shown(ladder, ladder.methods[0]) if ladder.methods else ():
        if ladder.has_limit:
            text = f"error of the tip extremes against the rigid limit of the mesh [%], {where}"
            yield _side_by_side(
                found, rungs, direction, text, lambda rung: 100.0 * found.error(rung)
            )
        for q in (found.extrema[0], WORK):
            yield _side_by_side(
                found,
                rungs,
                direction,
                f"{q.heading}, {where}",
                lambda rung, q=q: q.factor * found.value(rung, q.name),  # type: ignore[misc]
            )


def _shown(ladder: Ladder, method: Method) -> Iterator[tuple[Direction, str, list[Rung]]]:
    """Yield the lines of a method, over meshes only those with the smallest steps."""
    for direction, where, rungs in lines(ladder, (method,)):
        if direction == "steps" or rungs[0].steps == ladder.steps[-1]:
            yield direction, where, rungs


def _brief_free_table(
    found: Convergence, rungs: list[Rung], direction: Direction, where: str
) -> Table:
    """Return the largest errors of all laminae without contact."""
    rows = []
    for rung in rungs:
        errors = abs(found.free_errors(rung)).reshape(-1, 2).max(axis=0)
        cells = (number(error, ".1e") for error in errors)
        rows.append((str(getattr(rung, direction)), *cells, cost(found, rung)))
    heading = (direction, "frequency", "amplitude", "µs/step")
    return Table(f"relative errors without contact, {where}", heading, tuple(rows))


def _side_by_side(
    found: Convergence,
    line: list[Rung],
    direction: Direction,
    title: str,
    value: Callable[[Rung], float],
) -> Table:
    """Return a table of one number, with a row for each rung and a column for each method."""
    ladder = found.ladder
    rows = []
    for place in line:
        row = [str(getattr(place, direction))]
        for method in ladder.methods:
            rung = ladder.rung(method, place.mesh, place.steps)
            result = found.results.get(rung.key)
            is_there = result is not None and result.outcome == "completed"
            said = NOTHING if result is None else result.outcome
            row.append(number(value(rung), ".2f") if is_there else said)
        rows.append(tuple(row))
    return Table(title, (direction, *(method.name for method in ladder.methods)), tuple(rows))

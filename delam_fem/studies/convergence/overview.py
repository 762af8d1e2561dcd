"""Make short tables of a ladder for a terminal, with all methods side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from delam_fem.studies.convergence.analysis import Convergence
from delam_fem.studies.convergence.ladder import FREE, Ladder, Method, Rung
from delam_fem.studies.convergence.statistics import WORK
from delam_fem.studies.convergence.tables import NOTHING, Direction, Table, cost, lines, number


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

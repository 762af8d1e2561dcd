"""Say in a line which run is near the limit; make short tables, all methods side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from delam_fem.studies.convergence.analysis import Convergence
from delam_fem.studies.convergence.ladder import FREE, RIGID, Ladder, Method, Rung
from delam_fem.studies.convergence.statistics import WORK
from delam_fem.studies.convergence.tables import NOTHING, Direction, Table, cost, lines, number

GOAL = 0.01
"""Distance from the limit that the verdict asks for, in half peak-to-peak displacements."""


def verdict(found: Convergence) -> str:
    """Say which run is within `GOAL` of the limit and cheapest, or that none is, and why.

    A run is judged in each direction that the ladder refines, beside two finer runs or more: in
    steps on its own mesh, in meshes with the smallest steps; see `Convergence.interval`.
    """
    ladder = found.ladder
    judged = [
        (rung, *_judged(found, method, rung))
        for method in ladder.methods
        for mesh in ladder.meshes
        for rung in ladder.along_steps(method, mesh)
    ]
    known = [own for own in judged if not math.isnan(own[1] + own[2])]
    goal = f"{100.0 * GOAL:.2g} % of the limit of the tip extremes"
    if not known:
        return (
            f"No run is known to be within {goal}: none that was completed has two finer ones "
            "beside it in every direction that was refined."
        )
    best = min(known, key=lambda own: (own[1] + own[2], own[1]))
    good = [own for own in known if own[1] + own[2] <= GOAL]
    chosen, away, left = min(good, key=lambda own: found.cost(own[0])) if good else best
    away, left = 100.0 * away, 100.0 * left
    run = f"{chosen.method}, {chosen.mesh_text}, {chosen.steps} steps per period"
    cost = f"{1e3 * found.cost(chosen):.3g} ms of processor time per period"
    if good:
        kept = (
            "" if len(_directions(ladder)) == 2 else f"; only {_directions(ladder)[0]} were refined"
        )
        return f"Within {goal}, and cheapest: {run} ({cost}), {away:.2g} ± {left:.2g} %{kept}."
    reason = f"the nearest that is judged, {run} ({cost}), is {away:.2g} ± {left:.2g} % away"
    if math.isinf(left):
        reason = f"errors do not shrink from rung to rung; {run}, is {away:.2g} % from the finest"
    if ladder.case.contact.restitution == 1.0 and ladder.has_limit:
        count = number(found.value(ladder.limit_of(chosen.mesh), "impacts"), ".0f")
        reason += (
            f"; with e = 1 contact takes nothing, so that pairs near one another are hit again and "
            f"again, and the impulses per period ({count} at T/{ladder.limit_steps}) grow with 1/Δt"
        )
    return f"No run is known to be within {goal}: {reason}."


def _directions(ladder: Ladder) -> list[Direction]:
    """Return what a ladder refines: "steps", and "elements" or "points"."""
    found: list[Direction] = ["steps"] if len(ladder.steps) > 1 else []
    return [*found, ladder.refines] if len(ladder.meshes) > 1 else found or ["steps"]


def _line(found: Convergence, method: Method, rung: Rung, direction: Direction) -> list[Rung]:
    """Return the rungs that refine a rung in a direction, with the rigid limit if it is one."""
    ladder = found.ladder
    if direction != "steps":
        return ladder.along_meshes(method, rung.steps)
    rungs = ladder.along_steps(method, rung.mesh)
    goes_on = ladder.limit_steps > rungs[-1].steps and dict(method.overrides) == RIGID
    return [*rungs, ladder.limit_of(rung.mesh)] if goes_on else rungs


def _judged(found: Convergence, method: Method, rung: Rung) -> tuple[float, float]:
    """Return the distance of a rung from the limit, and its uncertainty, over all directions."""
    away = left = 0.0
    for direction in _directions(found.ladder):
        own = rung
        if direction != "steps":
            own = found.ladder.rung(method, rung.mesh, found.ladder.steps[-1])
        part = found.interval(own, _line(found, method, own, direction), direction)
        away, left = away + part[0], left + part[1]
    return away, left


def overview(found: Convergence) -> Iterator[Table]:
    """Yield the short tables: errors, y1 and contact work of all methods side by side."""
    ladder = found.ladder
    for direction, where, rungs in _shown(ladder, FREE):
        yield _brief_free_table(found, rungs, direction, where)
    for direction, where, rungs in _shown(ladder, ladder.methods[0]) if ladder.methods else ():
        finest = f"the finest {direction} of each method"
        if direction == "steps" and ladder.has_limit:
            finest = "the rigid limit of the mesh"
        text = f"distance of the tip extremes from {finest} ± what is left beyond [%], {where}"
        yield _side_by_side(
            found,
            rungs,
            direction,
            text,
            lambda rung, method, by=direction: _percent(found, rung, method, by),  # type: ignore[misc]
        )
        for q in (found.extrema[0], WORK):
            yield _side_by_side(
                found,
                rungs,
                direction,
                f"{q.heading}, {where}",
                lambda rung, _, q=q: number(q.factor * found.value(rung, q.name), ".2f"),  # type: ignore[misc]
            )


def _percent(found: Convergence, rung: Rung, method: Method, direction: Direction) -> str:
    """Return the interval of a rung as text [%]; only the distance where no more is known."""
    line = _line(found, method, rung, direction)
    away, left = (100.0 * part for part in found.interval(rung, line, direction))
    text = number(away, ".2f")
    return f"{text} ± {left:.2g}" if math.isfinite(left) else text


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
    value: Callable[[Rung, Method], str],
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
            row.append(value(rung, method) if is_there else said)
        rows.append(tuple(row))
    return Table(title, (direction, *(method.name for method in ladder.methods)), tuple(rows))

"""Tables of a ladder, for a terminal and as Markdown."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from delam_fem.numerics.extrapolation import Limit, orders_of_errors
from delam_fem.studies.convergence.ladder import FREE, LIMIT, Ladder, Rung, Scheme
from delam_fem.studies.convergence.run import Convergence
from delam_fem.studies.convergence.statistics import (
    AMPLITUDES,
    CONVERGING,
    EXTREMA,
    GENERAL,
    WORK,
    Quantity,
)

Direction = Literal["steps", "elements"]
NOTHING = "–"
_FREE_NAMES = ("f1 of 1", "amplitude 1", "f1 of 2", "amplitude 2")


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        title: above it.
        heading: of the columns.
        rows: of as many entries.
    """

    title: str
    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """Return it as Markdown, its title in bold."""
        lines = [self.heading, tuple("---" for _ in self.heading), *self.rows]
        body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        return f"**{self.title}**\n\n{body}\n"


def tables(found: Convergence) -> Iterator[Table]:
    """Yield all tables of a ladder: without contact, every line of rungs, what they tend to."""
    for direction, where, rungs in lines(found.ladder, (FREE,)):
        yield free_table(found, rungs, direction, where)
    for direction, where, rungs in lines(found.ladder, found.ladder.schemes):
        title = f"{rungs[0].scheme}, {where}"
        yield contact_table(found, rungs, direction, title, (*EXTREMA, *GENERAL))
        yield contact_table(found, rungs, direction, f"{title}: harmonics", AMPLITUDES)
    if found.ladder.limit_steps:
        rungs = found.ladder.along_meshes(LIMIT, found.ladder.limit_steps)
        title = f"rigid limit of each mesh: moreau with {found.ladder.limit_steps} steps per period"
        yield contact_table(found, rungs, "elements", title, (*EXTREMA, *GENERAL))
        yield contact_table(found, rungs, "elements", f"{title}: harmonics", AMPLITUDES)
    yield from limit_tables(found)


def lines(ladder: Ladder, schemes: Sequence[Scheme]) -> Iterator[tuple[Direction, str, list[Rung]]]:
    """Yield the rungs of each scheme that refine in one direction, with where they stand."""
    for scheme in schemes:
        if len(ladder.steps) > 1 or len(ladder.meshes) == 1:
            for mesh in ladder.meshes:
                rungs = ladder.along_steps(scheme, mesh)
                yield "steps", f"{rungs[0].elements} elements", rungs
        if len(ladder.meshes) > 1:
            for steps in ladder.steps:
                yield (
                    "elements",
                    f"{steps} steps per period",
                    ladder.along_meshes(scheme, steps),
                )


def free_table(found: Convergence, rungs: list[Rung], direction: Direction, where: str) -> Table:
    """Return errors of frequencies and amplitudes without contact, with orders."""
    sizes = [1.0 / getattr(rung, direction) for rung in rungs]
    errors = [found.free_errors(rung) for rung in rungs]
    orders = [orders_of_errors(sizes, [e[j] for e in errors]) for j in range(len(_FREE_NAMES))]
    heading: list[str] = [direction]
    for name in _FREE_NAMES:
        heading += [name, "order"]
    rows = []
    for k, rung in enumerate(rungs):
        row = [str(getattr(rung, direction))]
        for j in range(len(_FREE_NAMES)):
            row += [number(errors[k][j], "+.1e"), number(orders[j][k - 1], ".2f") if k else ""]
        rows.append((*row, cost(found, rung)))
    return Table(
        f"without contact, {where}: relative errors against the exact cantilever",
        (*heading, "µs/step"),
        tuple(rows),
    )


def _brief_free_table(
    found: Convergence, rungs: list[Rung], direction: Direction, where: str
) -> Table:
    """Return the larger errors of both laminae without contact."""
    rows = []
    for rung in rungs:
        errors = abs(found.free_errors(rung)).reshape(2, 2).max(axis=0)
        cells = (number(error, ".1e") for error in errors)
        rows.append((str(getattr(rung, direction)), *cells, cost(found, rung)))
    heading = (direction, "frequency", "amplitude", "µs/step")
    return Table(f"relative errors without contact, {where}", heading, tuple(rows))


def contact_table(
    found: Convergence,
    rungs: list[Rung],
    direction: Direction,
    title: str,
    quantities: Sequence[Quantity],
) -> Table:
    """Return the statistics of a line of rungs with error and cost."""
    heading = (
        direction,
        *(q.heading for q in quantities),
        "P",
        "error [%]",
        "µs/step",
        "ms/period",
    )
    rows = []
    for rung in rungs:
        result = found.results.get(rung.key)
        if result is None or result.outcome != "completed":
            said = "not computed" if result is None else result.error
            rows.append((str(getattr(rung, direction)), said, *[""] * (len(heading) - 2)))
            continue
        period = found.value(rung, "periodicity")
        rows.append(
            (
                str(getattr(rung, direction)),
                *(mean_and_scatter(found, rung, q) for q in quantities),
                f"{period:.0f}" if period else NOTHING,
                number(100.0 * found.error(rung), ".1f"),
                cost(found, rung),
                number(1e3 * found.cost(rung), ".2f"),
            )
        )
    return Table(title, heading, tuple(rows))


def overview(found: Convergence) -> Iterator[Table]:
    """Yield what a terminal shows: errors, contact work and limits of all schemes side by side."""
    ladder = found.ladder
    refined = list(lines(ladder, (FREE,)))
    last_steps = ladder.steps[-1]
    for direction, where, rungs in refined:
        if direction == "elements" and rungs[0].steps != last_steps:
            continue
        yield _brief_free_table(found, rungs, direction, where)
        if ladder.limit_steps:
            text = f"error of the tip extremes against the rigid limit of the mesh [%], {where}"
            yield _side_by_side(
                found, rungs, direction, text, lambda rung: 100.0 * found.error(rung)
            )
        for q in (EXTREMA[0], WORK):
            yield _side_by_side(
                found,
                rungs,
                direction,
                f"{q.heading}, {where}",
                lambda rung, q=q: q.factor * found.value(rung, q.name),  # type: ignore[misc]
            )


def _side_by_side(
    found: Convergence,
    line: list[Rung],
    direction: Direction,
    title: str,
    value: Callable[[Rung], float],
) -> Table:
    """Return one number of every scheme along a line of sizes."""
    ladder = found.ladder
    rows = []
    for place in line:
        row = [str(getattr(place, direction))]
        for scheme in ladder.schemes:
            rung = ladder.rung(scheme, place.mesh, place.steps)
            result = found.results.get(rung.key)
            is_there = result is not None and result.outcome == "completed"
            said = NOTHING if result is None else result.outcome
            row.append(number(value(rung), ".2f") if is_there else said)
        rows.append(tuple(row))
    return Table(title, (direction, *(scheme.name for scheme in ladder.schemes)), tuple(rows))


def limit_tables(found: Convergence) -> Iterator[Table]:
    """Yield what every scheme tends to, as far as it can be told."""
    ladder = found.ladder
    for direction, where, rungs in lines(ladder, ladder.schemes):
        if len(rungs) > 2:
            yield limit_table(found, rungs, direction, f"{rungs[0].scheme}, {where}")
    if ladder.limit_steps and len(ladder.meshes) > 2:
        rungs = ladder.along_meshes(LIMIT, ladder.limit_steps)
        yield limit_table(found, rungs, "elements", "rigid limit over meshes")


def limit_table(found: Convergence, rungs: list[Rung], direction: Direction, title: str) -> Table:
    """Return observed orders and limits of a line of rungs."""
    rows = []
    for q in CONVERGING:
        told = found.limit(rungs, q.name, by=direction)
        last = number(q.factor * found.value(rungs[-1], q.name), ".4g")
        orders = ", ".join(number(p, ".2f") for p in told.orders)
        rows.append((q.heading, last, orders or NOTHING, limit_text(told, q), told.reason))
    heading = ("quantity", "finest", "observed orders", "limit", "how")
    return Table(f"{title}: what it tends to in {direction}", heading, tuple(rows))


def limit_text(told: Limit, q: Quantity) -> str:
    """Return a limit with its uncertainty."""
    if math.isnan(told.value):
        return NOTHING
    return f"{q.factor * told.value:.4g} ± {q.factor * told.uncertainty:.2g}"


def mean_and_scatter(found: Convergence, rung: Rung, q: Quantity) -> str:
    """Return a statistic as text."""
    value, scatter = (
        q.factor * x for x in (found.value(rung, q.name), found.scatter(rung, q.name))
    )
    return f"{value:.3f} ± {scatter:.2g}" if scatter else f"{value:.3f}"


def cost(found: Convergence, rung: Rung) -> str:
    """Return the processor time of a step as text."""
    result = found.results.get(rung.key)
    return NOTHING if result is None else number(result.microseconds_per_step, ".2f")


def number(value: float, form: str) -> str:
    """Return a number as text, a dash for what is none."""
    return format(value, form) if math.isfinite(value) else NOTHING

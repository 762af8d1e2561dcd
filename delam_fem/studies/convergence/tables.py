"""Make the complete tables of a ladder; `overview.py` makes short tables for a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from delam_fem.numerics.extrapolation import Limit, orders_of_errors
from delam_fem.studies.convergence.analysis import Convergence
from delam_fem.studies.convergence.ladder import FREE, LIMIT, Ladder, Method, Rung
from delam_fem.studies.convergence.statistics import (
    Statistic,
    amplitudes,
    converging,
    general,
)

Direction = Literal["steps", "elements", "points"]
NOTHING = "–"
NO_LIMIT = "The ladder has no limit (0 steps): errors against the rigid limit are left out."


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes:
        title: title above the table.
        heading: headings of the columns.
        rows: rows with one entry per column.
    """

    title: str
    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """Return the table as Markdown, with its title in bold."""
        lines = [self.heading, tuple("---" for _ in self.heading), *self.rows]
        body = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        return f"**{self.title}**\n\n{body}\n"


def page(found: Convergence, verdict: str) -> str:
    """Return all tables of a ladder as a page of Markdown, below a verdict."""
    parts = [f"# Convergence of case {found.ladder.case.name}\n", f"{verdict}\n"]
    if not found.ladder.has_limit:
        parts.append(f"{NO_LIMIT}\n")
    return "\n".join([*parts, *(table.markdown() for table in tables(found))])


def tables(found: Convergence) -> Iterator[Table]:
    """Yield all tables of a ladder: without contact, then every line of rungs, then the limits."""
    for direction, where, rungs in lines(found.ladder, (FREE,)):
        yield free_table(found, rungs, direction, where)
    shown = (*found.extrema, *general(found.n_laminae))
    of_harmonics = amplitudes(found.n_laminae)
    for direction, where, rungs in lines(found.ladder, found.ladder.methods):
        title = f"{rungs[0].method}, {where}"
        yield contact_table(found, rungs, direction, title, shown)
        yield contact_table(found, rungs, direction, f"{title}: harmonics", of_harmonics)
    if found.ladder.has_limit:
        rungs = found.ladder.along_meshes(LIMIT, found.ladder.limit_steps)
        steps = f"{found.ladder.limit_steps} steps per period"
        title = f"rigid limit of each mesh: newton@moreau-jean with {steps}"
        by = found.ladder.refines
        yield contact_table(found, rungs, by, title, shown)
        yield contact_table(found, rungs, by, f"{title}: harmonics", of_harmonics)
    yield from limit_tables(found)


def lines(ladder: Ladder, methods: Sequence[Method]) -> Iterator[tuple[Direction, str, list[Rung]]]:
    """Yield each line of rungs: the direction of refinement, what stays fixed, and the rungs."""
    for method in methods:
        meshes = ladder.meshes_of(method)
        if len(ladder.steps) > 1 or len(meshes) == 1:
            for mesh in meshes:
                rungs = ladder.along_steps(method, mesh)
                yield "steps", rungs[0].mesh_text, rungs
        if len(meshes) > 1:
            for steps in ladder.steps:
                yield (
                    "elements" if method == FREE else ladder.refines,
                    f"{steps} steps per period",
                    ladder.along_meshes(method, steps),
                )


def free_table(found: Convergence, rungs: list[Rung], direction: Direction, where: str) -> Table:
    """Return the table of errors and orders of frequencies and amplitudes without contact."""
    sizes = [1.0 / getattr(rung, direction) for rung in rungs]
    errors = [found.free_errors(rung) for rung in rungs]
    numbers = range(1, found.n_laminae + 1)
    names = [name for i in numbers for name in (f"f1 of {i}", f"amplitude {i}")]
    orders = [orders_of_errors(sizes, [e[j] for e in errors]) for j in range(len(names))]
    heading: list[str] = [direction]
    for name in names:
        heading += [name, "order"]
    exact = "the exact cantilever" if found.ladder.case.is_apart else "the stack of a fine mesh"
    rows = []
    for k, rung in enumerate(rungs):
        row = [str(getattr(rung, direction))]
        for j in range(len(names)):
            row += [number(errors[k][j], "+.1e"), number(orders[j][k - 1], ".2f") if k else ""]
        rows.append((*row, cost(found, rung)))
    return Table(
        f"without contact, {where}: relative errors against {exact}",
        (*heading, "µs/step"),
        tuple(rows),
    )


def contact_table(
    found: Convergence,
    rungs: list[Rung],
    direction: Direction,
    title: str,
    quantities: Sequence[Statistic],
) -> Table:
    """Return the table of statistics, errors (if the ladder has a limit) and costs of rungs."""
    has_limit = found.ladder.has_limit
    error = ["error [%]"] if has_limit else []
    heading = (direction, *(q.heading for q in quantities), "P", *error, "µs/step", "ms/period")
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
                *([number(100.0 * found.error(rung), ".1f")] if has_limit else []),
                cost(found, rung),
                number(1e3 * found.cost(rung), ".2f"),
            )
        )
    return Table(title, heading, tuple(rows))


def limit_tables(found: Convergence) -> Iterator[Table]:
    """Yield tables of extrapolated limits, for each line of at least three rungs."""
    ladder = found.ladder
    for direction, where, rungs in lines(ladder, ladder.methods):
        if len(rungs) > 2:
            yield limit_table(found, rungs, direction, f"{rungs[0].method}, {where}")
    if ladder.has_limit and len(ladder.meshes) > 2:
        rungs = ladder.along_meshes(LIMIT, ladder.limit_steps)
        yield limit_table(found, rungs, ladder.refines, "rigid limit over meshes")


def limit_table(found: Convergence, rungs: list[Rung], direction: Direction, title: str) -> Table:
    """Return the table of observed orders and extrapolated limits of a line of rungs."""
    rows = []
    for q in converging(found.n_laminae):
        told = found.limit(rungs, q.name, by=direction)
        last = number(q.factor * found.value(rungs[-1], q.name), ".4g")
        orders = ", ".join(number(p, ".2f") for p in told.orders)
        rows.append((q.heading, last, orders or NOTHING, limit_text(told, q), told.reason))
    heading = ("quantity", "finest", "observed orders", "limit", "how")
    return Table(f"{title}: what it tends to in {direction}", heading, tuple(rows))


def limit_text(told: Limit, q: Statistic) -> str:
    """Return a limit with its uncertainty as text."""
    if math.isnan(told.value):
        return NOTHING
    return f"{q.factor * told.value:.4g} ± {q.factor * told.uncertainty:.2g}"


def mean_and_scatter(found: Convergence, rung: Rung, q: Statistic) -> str:
    """Return the mean and the scatter of a statistic as text."""
    value, scatter = (
        q.factor * x for x in (found.value(rung, q.name), found.scatter(rung, q.name))
    )
    return f"{value:.3f} ± {scatter:.2g}" if scatter else f"{value:.3f}"


def cost(found: Convergence, rung: Rung) -> str:
    """Return the processor time of a step as text [µs]."""
    result = found.results.get(rung.key)
    return NOTHING if result is None else number(result.microseconds_per_step, ".2f")


def number(value: float, form: str) -> str:
    """Return a number as text; a dash if it is not finite."""
    return format(value, form) if math.isfinite(value) else NOTHING

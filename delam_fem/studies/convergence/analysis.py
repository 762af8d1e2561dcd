"""Analyse a ladder: errors, limits and costs, in tables, figures and a verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import cycle, pairwise
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from delam_fem.api import (
    Case,
    CaseError,
    Finding,
    FloatArray,
    Report,
    Table,
    number,
    statistics,
    style,
)
from delam_fem.studies.convergence.ladder import (
    FREE,
    LIMIT,
    RIGID,
    Ladder,
    Method,
    Rung,
    channel_of,
)
from delam_fem.studies.convergence.rung import (
    WORK,
    RungResult,
    Statistic,
    amplitudes,
    channel_units,
    converging,
    extrema,
    general,
    may_be_judged,
    of_channel,
)
from delam_fem.studies.linear import first_frequencies, linear_amplitudes

NOISE = 2.0
"""Standard errors of the means that the uncertainty of a distance contains."""


@dataclass(frozen=True)
class Convergence(Finding):
    """A ladder with the results of its finished rungs.

    Attributes:
        ladder: the ladder.
        results: results by the key of the rung.
    """

    ladder: Ladder
    results: dict[str, RungResult]

    def __post_init__(self) -> None:
        """Check the names of the numbers that are judged.

        Raises:
            CaseError: a name is not one of `may_be_judged`, or not a channel of every method.
        """
        known = [q.name for q in may_be_judged(self.n_laminae)]
        for name in self.ladder.judged:
            if not any(_is_of(one, name) for one in known):
                raise CaseError(
                    f"judge: expected some of {', '.join(known)}, or one without its numbers for "
                    f"all of a kind (of no others are intervals known to hold), given {name!r}"
                )
        for text in self.ladder.of:
            name, _ = channel_of(text)
            for method, units in self._units.items():
                if name not in units:
                    raise CaseError(
                        f"of: expected some of {', '.join(units)}, which {method} records at each "
                        f"step, given {text!r}"
                    )
            if len(units_of_name := {units[name] for units in self._units.values()}) > 1:
                raise CaseError(
                    f"of: expected a channel with one unit, given {text!r} in "
                    f"{', '.join(sorted(units_of_name))} by different laws; choose laws, or add a "
                    'sensor of the quantity "contact force"'
                )

    @cached_property
    def _units(self) -> dict[str, dict[str, str]]:
        """Units of the channels that each method offers, by its name."""
        ladder = self.ladder
        methods = [*ladder.methods, *([LIMIT] if ladder.has_limit else [])]
        rungs = [ladder.rung(method, ladder.meshes[0], ladder.steps[0]) for method in methods]
        return {rung.method: channel_units(rung.case) for rung in rungs}

    @cached_property
    def channels(self) -> tuple[Statistic, ...]:
        """Measures of channels that are judged."""
        units = next(iter(self._units.values()), {}) if self.ladder.of else {}
        return tuple(
            of_channel(name, measure, units[name])
            for name, measures in map(channel_of, self.ladder.of)
            for measure in measures
        )

    @property
    def n_laminae(self) -> int:
        """Number of laminae."""
        return len(self.ladder.case.lamina)

    @property
    def extrema(self) -> tuple[Statistic, ...]:
        """Extremes of all laminae, from bottom to top."""
        return extrema(self.n_laminae)

    @cached_property
    def judged(self) -> tuple[Statistic, ...]:
        """Numbers whose distance from the limit is judged."""
        names = self.ladder.judged
        if not (names or self.ladder.of):
            return self.extrema
        every = may_be_judged(self.n_laminae)
        of_tips = tuple(q for q in every if any(_is_of(q.name, name) for name in names))
        return (*of_tips, *self.channels)

    @property
    def what(self) -> str:
        """Names of the numbers that are judged."""
        if self.judged == self.extrema:
            return "tip extremes"
        return ", ".join(q.symbol for q in self.judged)

    @property
    def is_complete(self) -> bool:
        """Whether every rung has a result, with any outcome."""
        return all(rung.key in self.results for rung in self.ladder.rungs())

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        case = self.ladder.case
        rungs = self.ladder.rungs()
        left = sum(rung.key not in self.results for rung in rungs)
        there = f"{len(self.results)} of {len(rungs)} runs are there."
        return Report(
            name="convergence",
            numbers=None,
            files=["convergence.json", "tables.md"],
            case=case,
            is_sweep=True,
            title=f"Convergence of {case.name}",
            tables=list(overview(self)),
            sentences=[verdict(self), there],
            remarks=[
                *([] if self.ladder.has_limit else [NO_LIMIT]),
                *([NOT_CALIBRATED] if self.ladder.of else []),
            ],
            pictures={
                f"figures/{name}": (partial(draw, self), name.replace("_", " ").capitalize())
                for name, draw in pictures(self).items()
            },
            left=f"with {left} rungs left" if left else "",
        )

    def value(self, rung: Rung, name: str) -> float:
        """Return the mean of a statistic; NaN if the rung has none."""
        return self.entry(rung, name)[0]

    def standard_error(self, rung: Rung, name: str) -> float:
        """Return the standard error of the mean of a statistic."""
        blocks = self.value(rung, "blocks")
        return self.entry(rung, name)[1] / math.sqrt(blocks) if blocks > 0.0 else math.nan

    def limit(self, rungs: Sequence[Rung], name: str, *, by: str = "steps") -> statistics.Limit:
        """Extrapolate a statistic along rungs that refine `by` "steps", "elements" or "points"."""
        sizes = [1.0 / getattr(rung, by) for rung in rungs]
        values = [self.value(rung, name) for rung in rungs]
        errors = [self.standard_error(rung, name) for rung in rungs]
        return statistics.limit(sizes, values, errors)

    def error(self, rung: Rung, reference: Rung | None = None) -> float:
        """Return the distance of the numbers that are judged from the rigid limit.

        Args:
            rung: a rung with contact.
            reference: rung that stands for the limit; by default the limit of the same mesh.

        Returns:
            The largest difference of all; lengths in half peak-to-peak displacements of their
            lamina in the limit, levels of channels in the amplitude of the channel there, other
            numbers in their own size there [-]. NaN if either is missing or if the ladder has no
            limit.
        """
        if reference is None:
            if not self.ladder.has_limit:
                return math.nan
            reference = self.ladder.limit_of(rung.mesh)
        exact, size = self._scale(reference)
        values = np.array([self.value(rung, q.name) for q in self.judged])
        return float(np.abs((values - exact) / size).max())

    def interval(self, rung: Rung, rungs: Sequence[Rung], by: str) -> tuple[float, float]:
        """Return the distance of a rung from the limit, and the uncertainty of this distance [-].

        The distance is `error`: from the rigid limit in steps, otherwise from the finest rung. The
        uncertainty is what the finest rung is away from the limit of its own line, by the power of
        the size that the last three rungs show, of order 1 at most; and `NOISE` standard errors of
        the means.

        Args:
            rung: a rung with contact.
            rungs: rungs that refine `by` "steps", "elements" or "points", from coarse to fine.
            by: what they refine.

        Returns:
            Both. The uncertainty is NaN without two finer rungs, infinite if errors do not shrink.
        """
        finest = rungs[-1]
        is_limit = by == "steps" and self.ladder.has_limit
        away = self.error(rung, None if is_limit else finest)
        if rung not in rungs[:-2]:
            return away, math.nan
        first, second = (self.error(a, b) for a, b in pairwise(rungs[-3:]))
        noise = NOISE * (self._noise(rung, finest) + self._noise(finest, finest))
        a, b, c = (1.0 / getattr(one, by) for one in rungs[-3:])
        # the second difference if errors were proportional to the size
        at_first_order = first * (b - c) / (a - b)
        if second <= max(noise, at_first_order):  # a small difference may be chance
            return away, max(second, at_first_order) / (b / c - 1.0) + noise
        order = statistics.observed_orders([a, b, c], [first + second, second, 0.0])[0]
        is_shrinking = order >= statistics.LOWEST_ORDER
        left = second / ((b / c) ** order - 1.0) if is_shrinking else math.inf
        return away, left + noise

    def _noise(self, rung: Rung, reference: Rung) -> float:
        """Return the largest standard error of judged numbers of a rung, in units of `_scale`."""
        errors = np.array([self.standard_error(rung, q.name) for q in self.judged])
        return float((errors / self._scale(reference)[1]).max())

    def _scale(self, reference: Rung) -> tuple[FloatArray, FloatArray]:
        """Return the judged numbers of a rung, and the units of their distances; see `error`."""
        exact = np.array([self.value(reference, q.name) for q in self.judged])
        low_high = np.array([self.value(reference, q.name) for q in self.extrema]).reshape(-1, 2)
        half = np.diff(low_high).ravel() / 2.0
        size = [
            half[q.lamina - 1]
            if q.lamina
            else abs(self.value(reference, q.scale) if q.scale else value) or math.nan
            for q, value in zip(self.judged, exact.tolist(), strict=True)
        ]
        return exact, np.array(size)

    def free_errors(self, rung: Rung) -> FloatArray:
        """Return the relative errors of a rung without contact; see `exact_free_motion`.

        Returns:
            Errors of the frequency and the amplitude of each lamina against the exact ones,
            lamina by lamina, shape (2 n_laminae,) [-]; NaN if the rung is missing. What has no
            exact solution is compared with the finest mesh.
        """
        finest = self.ladder.rung(FREE, self.ladder.meshes_of(FREE)[-1], rung.steps)
        frequencies, amplitudes = exact_free_motion(finest.case)
        return np.array(
            [
                self.value(rung, f"{name}_{i + 1}") / exact[i] - 1.0
                for i in range(self.n_laminae)
                for name, exact in (("frequency", frequencies), ("amplitude", amplitudes))
            ]
        )

    def cost(self, rung: Rung) -> float:
        """Return the processor time of a period [s]; NaN if the rung has no result."""
        result = self.results.get(rung.key)
        return math.nan if result is None else 1e-6 * result.microseconds_per_step * rung.steps

    def entry(self, rung: Rung, name: str) -> tuple[float, float]:
        """Return mean and scatter between blocks of a statistic; NaN if the rung has none."""
        result = self.results.get(rung.key)
        missing = (math.nan, math.nan)
        return missing if result is None else result.statistics.get(name, missing)


def _is_of(name: str, given: str) -> bool:
    """Return whether a name is a given one, alone or with numbers of laminae and harmonics."""
    return name == given or (name.startswith(f"{given}_") and not name[len(given) + 1].isalpha())


def exact_free_motion(case: Case) -> tuple[list[float], list[float]]:
    """Return first frequencies [Hz] and tip amplitudes [m] of all laminae without contact."""
    amplitudes = linear_amplitudes(case, np.array([1.0 / case.period]))[:, 0]
    return [omega / (2.0 * math.pi) for omega in first_frequencies(case)], amplitudes.tolist()


Direction = Literal["steps", "elements", "points"]
NOTHING = "–"
NOT_CALIBRATED = (
    "Intervals are known to hold for the numbers of --judge; of channels they are estimated in the "
    "same way."
)
NO_LIMIT = "The ladder has no rigid limit: errors against it are left out."


def page(found: Convergence, verdict: str) -> str:
    """Return a verdict and all tables of a ladder as a page of Markdown."""
    parts = [f"# Convergence of case {found.ladder.case.name}\n", f"{verdict}\n"]
    if not found.ladder.has_limit:
        parts.append(f"{NO_LIMIT}\n")
    return "\n".join([*parts, *(table.markdown() for table in tables(found))])


def tables(found: Convergence) -> Iterator[Table]:
    """Yield all tables of a ladder: without contact, then every line of rungs, then the limits."""
    for direction, where, rungs in lines(found.ladder, (FREE,)):
        yield free_table(found, rungs, direction, where)
    quantities = (*found.extrema, *general(found.n_laminae))
    of_harmonics = amplitudes(found.n_laminae)
    steps = f"{found.ladder.limit_steps} steps per period"
    of_limit = f"rigid limit of each mesh: newton@moreau-jean with {steps}"
    for direction, where, rungs in _with_limit(found.ladder, of_limit):
        yield contact_table(found, rungs, direction, where, quantities)
        yield contact_table(found, rungs, direction, f"{where}: harmonics", of_harmonics)
        if found.channels:
            yield contact_table(found, rungs, direction, f"{where}: channels", found.channels)
    for direction, where, rungs in _with_limit(found.ladder, "rigid limit over meshes"):
        if len(rungs) > 2:
            yield limit_table(found, rungs, direction, where)


def _with_limit(ladder: Ladder, of_limit: str) -> Iterator[tuple[Direction, str, list[Rung]]]:
    """Yield the lines of all methods with their titles, then that of the rigid limit with its."""
    for direction, where, rungs in lines(ladder, ladder.methods):
        yield direction, f"{rungs[0].method}, {where}", rungs
    if ladder.has_limit:
        yield ladder.refines, of_limit, ladder.along_meshes(LIMIT, ladder.limit_steps)


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
    orders = [statistics.orders_of_errors(sizes, [e[j] for e in errors]) for j in range(len(names))]
    heading: list[str] = [direction]
    for name in names:
        heading += [name, "order"]
    case = found.ladder.case
    is_exact = case.is_apart and not case.model.is_continuum
    exact = "the exact cantilever" if is_exact else "the same on a fine mesh"
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


def limit_table(found: Convergence, rungs: list[Rung], direction: Direction, title: str) -> Table:
    """Return the table of observed orders and extrapolated limits of a line of rungs."""
    rows = []
    for q in (*converging(found.n_laminae), *found.channels):
        told = found.limit(rungs, q.name, by=direction)
        last = number(q.factor * found.value(rungs[-1], q.name), ".4g")
        orders = ", ".join(number(p, ".2f") for p in told.orders)
        rows.append((q.heading, last, orders or NOTHING, limit_text(told, q), told.reason))
    heading = ("quantity", "finest", "observed orders", "limit", "how")
    return Table(f"{title}: what it tends to in {direction}", heading, tuple(rows))


def limit_text(told: statistics.Limit, q: Statistic) -> str:
    """Return a limit with its uncertainty as text."""
    if math.isnan(told.value):
        return NOTHING
    return f"{q.factor * told.value:.4g} ± {q.factor * told.uncertainty:.2g}"


def mean_and_scatter(found: Convergence, rung: Rung, q: Statistic) -> str:
    """Return the mean and the scatter of a statistic as text."""
    value, scatter = (q.factor * x for x in found.entry(rung, q.name))
    text = f"{value:{q.form or '.3f'}}"
    return f"{text} ± {scatter:.2g}" if scatter else text


def cost(found: Convergence, rung: Rung) -> str:
    """Return the processor time of a step as text [µs]."""
    result = found.results.get(rung.key)
    return NOTHING if result is None else number(result.microseconds_per_step, ".2f")


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
    known = [entry for entry in judged if not math.isnan(entry[1] + entry[2])]
    goal = f"{100.0 * GOAL:.2g} % of the limit of the {found.what}"
    if not known:
        return (
            f"No run is known to be within {goal}: none that was completed has two finer ones "
            "beside it in every direction that was refined."
        )
    best = min(known, key=lambda own: (own[1] + own[2], own[1]))
    good = [entry for entry in known if entry[1] + entry[2] <= GOAL]
    chosen, away, left = min(good, key=lambda own: found.cost(own[0])) if good else best
    away = 100.0 * away
    left = 100.0 * left
    run = f"{chosen.method}, {chosen.mesh_text}, {chosen.steps} steps per period"
    cost = f"{1e3 * found.cost(chosen):.3g} ms of processor time per period"
    if good:
        remark = (
            "" if len(_directions(ladder)) == 2 else f"; only {_directions(ladder)[0]} were refined"
        )
        return f"Within {goal}, and cheapest: {run} ({cost}), {away:.2g} ± {left:.2g} %{remark}."
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
    directions: list[Direction] = ["steps"] if len(ladder.steps) > 1 else []
    return [*directions, ladder.refines] if len(ladder.meshes) > 1 else directions or ["steps"]


def _line(found: Convergence, method: Method, rung: Rung, direction: Direction) -> list[Rung]:
    """Return the line of rungs through a rung; in steps it may end with the rigid limit."""
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
        line_rung = rung
        if direction != "steps":
            line_rung = found.ladder.rung(method, rung.mesh, found.ladder.steps[-1])
        part = found.interval(line_rung, _line(found, method, line_rung, direction), direction)
        away = away + part[0]
        left = left + part[1]
    return away, left


def overview(found: Convergence) -> Iterator[Table]:
    """Yield short tables of all methods side by side: errors, judged numbers, contact work."""
    ladder = found.ladder
    judged = found.extrema[:1] if found.judged == found.extrema else found.judged
    for direction, where, rungs in _shown(ladder, FREE):
        yield _brief_free_table(found, rungs, direction, where)
    for direction, where, rungs in _shown(ladder, ladder.methods[0]) if ladder.methods else ():
        finest = f"the finest {direction} of each method"
        if direction == "steps" and ladder.has_limit:
            finest = "the rigid limit of the mesh"
        text = f"distance of the {found.what} from {finest} ± what is left beyond [%], {where}"
        yield _side_by_side(
            found,
            rungs,
            direction,
            text,
            lambda rung, method, by=direction: _percent(found, rung, method, by),  # type: ignore[misc]
        )
        for q in dict.fromkeys((*judged, WORK)):
            yield _side_by_side(
                found,
                rungs,
                direction,
                f"{q.heading}, {where}",
                lambda rung, _, q=q: number(q.factor * found.value(rung, q.name), q.form or ".2f"),  # type: ignore[misc]
            )


def _percent(found: Convergence, rung: Rung, method: Method, direction: Direction) -> str:
    """Return distance and uncertainty of a rung as text [%]; the latter only where it is finite."""
    line = _line(found, method, rung, direction)
    away, left = (100.0 * part for part in found.interval(rung, line, direction))
    text = number(away, ".2f")
    return f"{text} ± {left:.2g}" if math.isfinite(left) else text


def _shown(ladder: Ladder, method: Method) -> Iterator[tuple[Direction, str, list[Rung]]]:
    """Yield the lines of rungs of a method; over meshes, those with the smallest steps only."""
    for direction, where, rungs in lines(ladder, (method,)):
        if direction == "steps" or rungs[0].steps == ladder.steps[-1]:
            yield direction, where, rungs


def _brief_free_table(
    found: Convergence, rungs: list[Rung], direction: Direction, where: str
) -> Table:
    """Return the table of the largest errors of all laminae without contact."""
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


Value = Callable[[Rung], float]

STYLES = (
    (style.BLUE, "o"), (style.VERMILLION, "s"), (style.GREEN, "^"), (style.ORANGE, "v"),
    (style.PURPLE, "D"), (style.SKY, "P"), (style.BLACK, "X"),
)  # fmt: skip
"""Colours and markers of the methods, in their order."""
PANELS = 3
"""Largest number of panels side by side."""
LONG_RANGE = 100.0
"""Ratio of the ends of an axis beyond which only powers of ten have ticks."""
BARS = 2.0
"""Half the length of error bars, in standard errors of the mean."""
FREE_FLOOR = 1e-13
"""Errors without contact below this value are round-off and are not drawn."""


def pictures(found: Convergence) -> dict[str, Callable[[Convergence], Figure]]:
    """Return the functions that draw the figures of a ladder, by name.

    A ladder without a limit has no figures of errors against the limit.
    """
    ladder = found.ladder
    makers: dict[str, Callable[[Convergence], Figure]] = {}
    if len(ladder.steps) > 1:
        makers["free_steps"] = partial(free_over, direction="steps")
    if len(ladder.meshes_of(FREE)) > 1:
        makers["free_elements"] = partial(free_over, direction="elements")
    if ladder.methods and len(ladder.steps) > 1:
        makers["work_over_steps"] = work_over_steps
    if ladder.methods and ladder.has_limit:
        makers["error_over_cost"] = error_over_cost
        if len(ladder.steps) > 1:
            makers["error_over_steps"] = error_over_steps
        if len(ladder.meshes) > 1:
            makers[f"limit_over_{ladder.refines}"] = limit_over_meshes
    return makers


def error_over_steps(found: Convergence) -> Figure:
    """Draw the error against the rigid limit of each mesh over steps per period."""
    label = "steps per period"
    text = f"error of the {found.what} [%]"
    return _panels(found, lambda r: r.steps, lambda r: 100.0 * found.error(r), label, text)


def error_over_cost(found: Convergence) -> Figure:
    """Draw the error against the rigid limit of each mesh over the processor time of a period."""
    label = "processor time per period [µs]"
    text = f"error of the {found.what} [%]"
    return _panels(
        found, lambda r: 1e6 * found.cost(r), lambda r: 100.0 * found.error(r), label, text
    )


def work_over_steps(found: Convergence) -> Figure:
    """Draw the contact work per period over steps per period, with the rigid limit dashed."""

    def work(rung: Rung) -> float:
        return WORK.factor * found.value(rung, WORK.name)

    label, text = "steps per period", "contact work per period [mJ]"
    return _panels(found, lambda r: r.steps, work, label, text, has_limit=found.ladder.has_limit)


def limit_over_meshes(found: Convergence) -> Figure:
    """Draw the rigid limit over what meshes refine: extremes of the tips and contact work.

    In a ladder without a limit, the last method with the smallest steps stands for it.
    """
    ladder = found.ladder
    method, steps = (
        (LIMIT, ladder.limit_steps) if ladder.has_limit else (ladder.methods[-1], ladder.steps[-1])
    )
    rungs = ladder.along_meshes(method, steps)
    n = [rung.points for rung in rungs]
    name = {"elements": "elements per lamina", "points": "contact points per lamina"}
    figure = Figure(figsize=(style.WIDTH, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    colours = style.lamina_colours(found.n_laminae)
    for k, q in enumerate(found.extrema):
        line_style = "o-" if q.name.startswith("tip_max") else "s--"
        _with_bars(
            left, found, rungs, q, fmt=line_style, color=colours[k // 2], label=f"|{q.symbol}|"
        )
    left.set(ylabel="rigid limit of the mesh [mm]")
    left.set_ylim(0.0, None)
    style.legend_above(left)
    _with_bars(right, found, rungs, WORK, fmt="o-", color=style.BLACK)
    right.set_yscale("log")
    right.set_ylabel("contact work per period [mJ]")
    _plain_numbers(right.yaxis)
    for axes in (left, right):
        axes.set_xscale("log")
        _plain(axes, n)
        axes.set_xlabel(name[found.ladder.refines])
    name_of_limit = "newton@moreau-jean" if ladder.has_limit else method.name
    text = f"{name_of_limit}, {steps} steps per period, bars: ±{BARS:g} standard errors"
    figure.suptitle(f"{_title(found)}\n{text}")
    return figure


def _with_bars(
    axes: Axes, found: Convergence, rungs: Sequence[Rung], shown: Statistic, **line_style: Any
) -> None:
    """Draw the size of a statistic over the contact points, with bars of `BARS` standard errors."""
    n = [rung.points for rung in rungs]
    values = [abs(shown.factor * found.value(rung, shown.name)) for rung in rungs]
    errors = [BARS * shown.factor * found.standard_error(rung, shown.name) for rung in rungs]
    axes.errorbar(n, values, yerr=errors, capsize=4.0, **line_style)


def _panels(
    found: Convergence,
    abscissa: Value,
    ordinate: Value,
    xlabel: str,
    ylabel: str,
    *,
    has_limit: bool = False,
) -> Figure:
    """Draw one line for each method, in one panel for each mesh, and maybe the limit, dashed."""
    meshes = found.ladder.meshes
    figure, grid = style.side_by_side(len(meshes), 3.5, PANELS, above=1.4, sharex=True, sharey=True)
    for axes, mesh in zip(grid, meshes, strict=True):
        for method, (colour, marker) in zip(found.ladder.methods, cycle(STYLES), strict=False):
            rungs = found.ladder.along_steps(method, mesh)
            points = np.array([(abscissa(rung), ordinate(rung)) for rung in rungs])
            drawn = points[np.isfinite(points).all(axis=1) & (points > 0.0).all(axis=1)]
            axes.loglog(*drawn.T, marker=marker, color=colour, label=method.name, markersize=5)
        if has_limit and (level := ordinate(found.ladder.limit_of(mesh))) > 0.0:
            axes.axhline(level, color=style.BASE_COLOUR, linestyle="--", linewidth=1.0)
        axes.set_title(rungs[0].mesh_text, loc="left")
    for axes in grid[::PANELS]:
        axes.set_ylabel(ylabel)
    for axes in figure.axes:
        _plain_numbers(axes.xaxis)
        _plain_numbers(axes.yaxis)
    style.label_x(figure.axes, xlabel)
    style.legend_outside(figure, grid[0], 4, "outside lower center")
    figure.suptitle(_title(found))
    return figure


def free_over(found: Convergence, direction: Literal["steps", "elements"]) -> Figure:
    """Draw the errors without contact, and a line with the slope of their order.

    Over steps per period they are those of the finest mesh, over elements those with the smallest
    steps.
    """
    ladder = found.ladder
    if direction == "steps":
        rungs = ladder.along_steps(FREE, ladder.meshes_of(FREE)[-1])
        label = "steps per period"
        slope = -2.0
        other = "elements"
    else:
        rungs = ladder.along_meshes(FREE, ladder.steps[-1])
        label = "elements per lamina"
        slope = -4.0
        other = "steps"
    figure, (axes,) = style.stacked(1, 4.6)
    n = np.array([getattr(rung, direction) for rung in rungs], dtype=float)
    errors = np.abs([found.free_errors(rung) for rung in rungs])
    errors[~(errors > FREE_FLOOR)] = np.nan
    colours = style.lamina_colours(found.n_laminae)
    for i, lamina in enumerate(found.ladder.case.lamina):
        for j, (name, line_style) in enumerate((("frequency", "o-"), ("amplitude", "s--"))):
            axes.loglog(
                n,
                errors[:, 2 * i + j],
                line_style,
                color=colours[i],
                label=f"{name}, {lamina.name}",
            )
    if np.isfinite(errors[0]).any():
        start = 0.4 * np.nanmin(errors[0])
        axes.loglog(
            n, start * (n / n[0]) ** slope, ":", color=style.BLACK, label=f"order {-slope:g}"
        )
    if np.isfinite(errors).any():
        axes.set_ylim(bottom=max(0.3 * float(np.nanmin(errors)), FREE_FLOOR))
    axes.set(xlabel=label, ylabel="relative error")
    _plain(axes, n.astype(int).tolist())
    axes.legend()
    figure.suptitle(f"{_title(found)} without contact, {getattr(rungs[0], other)} {other}")
    return figure


def _plain(axes: Axes, ticks: Sequence[int]) -> None:
    """Put the ticks of a logarithmic x axis at the given numbers only."""
    axes.set_xticks(list(ticks), [str(tick) for tick in ticks])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.minorticks_off()


def _plain_numbers(axis: Axis) -> None:
    """Label the ticks of a logarithmic axis 0.1, 0.2, 0.5, 1, … instead of powers of ten."""
    low, high = axis.get_view_interval()
    subs = (1.0, 2.0, 5.0) if high < LONG_RANGE * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _title(found: Convergence) -> str:
    case = found.ladder.case
    damping = f"{case.damping.rayleigh} damping, {case.time.mass} mass"
    return f"{case.name}: {1.0 / case.period:g} Hz, {damping}"

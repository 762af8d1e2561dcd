"""Analyse a refinement study: errors, limits and costs, in tables, figures and a verdict."""

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
    BLOW_STEPS,
    Case,
    CaseError,
    Finding,
    FloatArray,
    Report,
    Table,
    assemble,
    number,
    offered,
    require_channels,
    statistics,
    style,
)
from delam_fem.studies.convergence.level import (
    WORK,
    LevelResult,
    Statistic,
    amplitudes,
    converging,
    extrema,
    general,
    may_be_judged,
    of_channel,
)
from delam_fem.studies.convergence.refinement import (
    FREE,
    LIMIT,
    RIGID,
    Level,
    Method,
    RefinementStudy,
    channel_of,
)
from delam_fem.studies.linear import first_frequencies, linear_amplitudes

NOISE = 2.0
"""Standard errors of the means that the uncertainty of a distance contains."""


@dataclass(frozen=True)
class Convergence(Finding):
    """A study with the results of its finished levels.

    Attributes:
        study: the study.
        results: results by the key of the level.
    """

    refinement: RefinementStudy
    results: dict[str, LevelResult]

    def __post_init__(self) -> None:
        """Check the names of the numbers that are judged.

        Raises:
            CaseError: a name is not one of `may_be_judged`, or not a channel of every method.
        """
        known = [q.name for q in may_be_judged(self.n_laminae)]
        for name in self.refinement.judged:
            if not any(_is_of(one, name) for one in known):
                raise CaseError(
                    f"judge: expected some of {', '.join(known)}, or one without its numbers for "
                    f"all of a kind (of no others are intervals known to hold), given {name!r}"
                )
        for text in self.refinement.of:
            name, _ = channel_of(text)
            for method, units in self._units.items():
                require_channels([name], units, "of", f", which {method} records at each step")
            if len(units_of_name := {units[name] for units in self._units.values()}) > 1:
                raise CaseError(
                    f"of: expected a channel with one unit, given {text!r} in "
                    f"{', '.join(sorted(units_of_name))} by different laws; choose laws, or add a "
                    'sensor of the quantity "contact force"'
                )

    @cached_property
    def _units(self) -> dict[str, dict[str, str]]:
        """Units of the channels that each method offers, by its name."""
        refinement = self.refinement
        methods = [*refinement.methods, *([LIMIT] if refinement.has_limit else [])]
        levels = [
            refinement.level(method, refinement.meshes[0], refinement.steps[0])
            for method in methods
        ]
        layouts = [assemble(level.case, needs_dolfinx=False).layout for level in levels]
        return {
            level.method: offered(layout, level.case, only_stepped=True)
            for level, layout in zip(levels, layouts, strict=True)
        }

    @cached_property
    def channels(self) -> tuple[Statistic, ...]:
        """Measures of channels that are judged."""
        units = next(iter(self._units.values()), {}) if self.refinement.of else {}
        return tuple(
            of_channel(name, measure, units[name])
            for name, measures in map(channel_of, self.refinement.of)
            for measure in measures
        )

    @property
    def n_laminae(self) -> int:
        """Number of laminae."""
        return len(self.refinement.case.lamina)

    @property
    def extrema(self) -> tuple[Statistic, ...]:
        """Extremes of all laminae, from bottom to top."""
        return extrema(self.n_laminae)

    @cached_property
    def judged(self) -> tuple[Statistic, ...]:
        """Numbers whose distance from the limit is judged."""
        names = self.refinement.judged
        if not (names or self.refinement.of):
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
        """Whether every level has a result, with any outcome."""
        return all(level.key in self.results for level in self.refinement.levels())

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        case = self.refinement.case
        levels = self.refinement.levels()
        left = sum(level.key not in self.results for level in levels)
        there = f"{len(self.results)} of {len(levels)} runs are there."
        return Report(
            name="convergence",
            numbers=None,
            files=["convergence.json", "tables.md"],
            case=case,
            is_sweep=True,
            title=f"Convergence of {case.name}",
            tables=list(overview(self)),
            sentences=[verdict(self), there],
            remarks=remarks(self),
            pictures={
                f"figures/{name}": (partial(draw, self), name.replace("_", " ").capitalize())
                for name, draw in pictures(self).items()
            },
            left=f"with {left} levels left" if left else "",
        )

    def value(self, level: Level, name: str) -> float:
        """Return the mean of a statistic; NaN if the level has none."""
        return self.entry(level, name)[0]

    def standard_error(self, level: Level, name: str) -> float:
        """Return the standard error of the mean of a statistic."""
        blocks = self.value(level, "blocks")
        return self.entry(level, name)[1] / math.sqrt(blocks) if blocks > 0.0 else math.nan

    def limit(self, levels: Sequence[Level], name: str, *, by: str = "steps") -> statistics.Limit:
        """Extrapolate a statistic along levels that refine `by` "steps", "elements" or "points"."""
        sizes = [1.0 / getattr(level, by) for level in levels]
        values = [self.value(level, name) for level in levels]
        errors = [self.standard_error(level, name) for level in levels]
        return statistics.limit(sizes, values, errors)

    def error(self, level: Level, reference: Level | None = None) -> float:
        """Return the distance of the numbers that are judged from the rigid limit.

        Args:
            level: a level with contact.
            reference: level that stands for the limit; by default the limit of the same mesh.

        Returns:
            The largest difference of all; lengths in half peak-to-peak displacements of their
            lamina in the limit, levels of channels in the amplitude of the channel there, other
            numbers in their own size there [-]. NaN if either is missing or if the study has no
            limit.
        """
        if reference is None:
            if not self.refinement.has_limit:
                return math.nan
            reference = self.refinement.limit_of(level.mesh)
        exact, size = self._scale(reference)
        values = np.array([self.value(level, q.name) for q in self.judged])
        return float(np.abs((values - exact) / size).max())

    def interval(self, level: Level, levels: Sequence[Level], by: str) -> tuple[float, float]:
        """Return the distance of a level from the limit, and the uncertainty of this distance [-].

        The distance is `error`: from the rigid limit in steps, otherwise from the finest level. The
        uncertainty is what the finest level is away from the limit of its own line, by the power of
        the size that the last three levels show, of order 1 at most; and `NOISE` standard errors of
        the means.

        Args:
            level: a level with contact.
            levels: levels that refine `by` "steps", "elements" or "points", from coarse to fine.
            by: what they refine.

        Returns:
            Both. The uncertainty is NaN without two finer levels, infinite if errors do not shrink.
        """
        finest = levels[-1]
        is_limit = by == "steps" and self.refinement.has_limit
        away = self.error(level, None if is_limit else finest)
        if level not in levels[:-2]:
            return away, math.nan
        noise = self.noise(level, finest)
        return away, self.beyond(levels, by, noise)[0] + noise

    def beyond(self, levels: Sequence[Level], by: str, noise: float) -> tuple[float, float]:
        """Return how far the finest of three levels or more is from the limit, and the order.

        Args:
            levels: levels that refine `by` "steps", "elements" or "points", from coarse to fine.
            by: what they refine.
            noise: what `noise` returns.

        Returns:
            Both [-], see `interval`. The distance is infinite if errors do not shrink.
        """
        _, size = self._scale(levels[-1])  # one unit for both differences
        values = [
            np.array([self.value(level, q.name) for q in self.judged]) for level in levels[-3:]
        ]
        first, second = (float(np.abs((x - y) / size).max()) for x, y in pairwise(values))
        a, b, c = (1.0 / getattr(one, by) for one in levels[-3:])
        # the second difference if errors were proportional to the size
        at_first_order = first * (b - c) / (a - b)
        if second <= max(noise, at_first_order):  # a small difference may be chance
            return max(second, at_first_order) / (b / c - 1.0), 1.0
        order = statistics.observed_orders([a, b, c], [first + second, second, 0.0])[0]
        is_shrinking = order >= statistics.LOWEST_ORDER
        return second / ((b / c) ** order - 1.0) if is_shrinking else math.inf, order

    def noise(self, level: Level, finest: Level) -> float:
        """Return what the scatter of periods makes uncertain in a distance from the finest level.

        It is `NOISE` standard errors of the means, in the units of `error`.
        """
        return NOISE * (self._noise(level, finest) + self._noise(finest, finest))

    def _noise(self, level: Level, reference: Level) -> float:
        """Return the largest standard error of judged numbers of a level, in units of `_scale`."""
        errors = np.array([self.standard_error(level, q.name) for q in self.judged])
        return float((errors / self._scale(reference)[1]).max())

    def _scale(self, reference: Level) -> tuple[FloatArray, FloatArray]:
        """Return the judged numbers of a level, and the units of their distances; see `error`."""
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

    def free_errors(self, level: Level) -> FloatArray:
        """Return the relative errors of a level without contact; see `exact_free_motion`.

        Returns:
            Errors of the frequency and the amplitude of each lamina against the exact ones,
            lamina by lamina, shape (2 n_laminae,) [-]; NaN if the level is missing. What has no
            exact solution is compared with the finest mesh.
        """
        finest = self.refinement.level(FREE, self.refinement.meshes_of(FREE)[-1], level.steps)
        frequencies, amplitudes = exact_free_motion(finest.case)
        return np.array(
            [
                self.value(level, f"{name}_{i + 1}") / exact[i] - 1.0
                for i in range(self.n_laminae)
                for name, exact in (("frequency", frequencies), ("amplitude", amplitudes))
            ]
        )

    def cost(self, level: Level) -> float:
        """Return the processor time of a period [s]; NaN if the level has no result."""
        result = self.results.get(level.key)
        return math.nan if result is None else 1e-6 * result.microseconds_per_step * level.steps

    def entry(self, level: Level, name: str) -> tuple[float, float]:
        """Return mean and scatter between blocks of a statistic; NaN if the level has none."""
        result = self.results.get(level.key)
        missing = (math.nan, math.nan)
        return missing if result is None else result.statistics.get(name, missing)


def _is_of(name: str, given: str) -> bool:
    """Return whether a name is a given one, alone or with numbers of laminae and harmonics."""
    return name == given or (name.startswith(f"{given}_") and not name[len(given) + 1].isalpha())


def exact_free_motion(case: Case) -> tuple[list[float], list[float]]:
    """Return first frequencies [Hz] and amplitudes [m] of all laminae without contact."""
    amplitudes = linear_amplitudes(case, np.array([1.0 / case.period]))[:, 0]
    return [omega / (2.0 * math.pi) for omega in first_frequencies(case)], amplitudes.tolist()


Direction = Literal["steps", "elements", "points"]
NOTHING = "–"
NOT_CALIBRATED = (
    "Intervals are known to hold for the numbers of --judge; of channels they are estimated in the "
    "same way."
)
NO_LIMIT = "The study has no rigid limit: errors against it are left out."


def remarks(found: Convergence) -> list[str]:
    """Return what a reader of the numbers must know."""
    return [
        *(text for text in [blow_warning(found)] if text),
        *([] if found.refinement.has_limit else [NO_LIMIT]),
        *([NOT_CALIBRATED] if found.refinement.of else []),
    ]


def blow_warning(found: Convergence) -> str | None:
    """Return a warning if blows on contact springs have too few steps at a level; else None."""
    levels = {level.key: level for level in found.refinement.levels()}
    counts = {key: found.value(level, "blow_steps") for key, level in levels.items()}
    few = {key: count for key, count in counts.items() if count < BLOW_STEPS}
    if not few:
        return None
    worst = min(few, key=few.__getitem__)
    level = levels[worst]
    return (
        f"At {len(few)} of {len(found.results)} levels a blow on a contact spring has fewer than "
        f"{BLOW_STEPS} steps, {few[worst]:.2g} at the fewest ({level.method}, {level.mesh_text}, "
        f"{level.steps} steps per period), so that its energy is wrong there."
    )


def page(found: Convergence, verdict: str) -> str:
    """Return a verdict and all tables of a study as a page of Markdown."""
    title = f"# Convergence of case {found.refinement.case.name}"
    lines = [f"{line}\n" for line in (title, verdict, *remarks(found))]
    return "\n".join([*lines, *(table.markdown() for table in tables(found))])


def tables(found: Convergence) -> Iterator[Table]:
    """Yield all tables of a study: without contact, then every line of levels, then the limits."""
    for direction, where, levels in lines(found.refinement, (FREE,)):
        yield free_table(found, levels, direction, where)
    quantities = (*found.extrema, *general(found.n_laminae))
    of_harmonics = amplitudes(found.n_laminae)
    steps = f"{found.refinement.limit_steps} steps per period"
    of_limit = f"rigid limit of each mesh: newton@moreau-jean with {steps}"
    for direction, where, levels in _with_limit(found.refinement, of_limit):
        yield contact_table(found, levels, direction, where, quantities)
        yield contact_table(found, levels, direction, f"{where}: harmonics", of_harmonics)
        if found.channels:
            yield contact_table(found, levels, direction, f"{where}: channels", found.channels)
    for direction, where, levels in _with_limit(found.refinement, "rigid limit over meshes"):
        if len(levels) > 2:
            yield limit_table(found, levels, direction, where)


def _with_limit(
    refinement: RefinementStudy, of_limit: str
) -> Iterator[tuple[Direction, str, list[Level]]]:
    """Yield the lines of all methods with their titles, then that of the rigid limit with its."""
    for direction, where, levels in lines(refinement, refinement.methods):
        yield direction, f"{levels[0].method}, {where}", levels
    if refinement.has_limit:
        yield refinement.refines, of_limit, refinement.along_meshes(LIMIT, refinement.limit_steps)


def lines(
    refinement: RefinementStudy, methods: Sequence[Method]
) -> Iterator[tuple[Direction, str, list[Level]]]:
    """Yield each line of levels: the direction of refinement, what stays fixed, and the levels."""
    for method in methods:
        meshes = refinement.meshes_of(method)
        if len(refinement.steps) > 1 or len(meshes) == 1:
            for mesh in meshes:
                levels = refinement.along_steps(method, mesh)
                yield "steps", levels[0].mesh_text, levels
        if len(meshes) > 1:
            for steps in refinement.steps:
                yield (
                    "elements" if method == FREE else refinement.refines,
                    f"{steps} steps per period",
                    refinement.along_meshes(method, steps),
                )


def free_table(found: Convergence, levels: list[Level], direction: Direction, where: str) -> Table:
    """Return the table of errors and orders of frequencies and amplitudes without contact."""
    sizes = [1.0 / getattr(level, direction) for level in levels]
    errors = [found.free_errors(level) for level in levels]
    numbers = range(1, found.n_laminae + 1)
    names = [name for i in numbers for name in (f"f1 of {i}", f"amplitude {i}")]
    orders = [statistics.orders_of_errors(sizes, [e[j] for e in errors]) for j in range(len(names))]
    heading: list[str] = [direction]
    for name in names:
        heading += [name, "order"]
    case = found.refinement.case
    is_exact = case.has_exact_laminae and not case.model.is_continuum
    exact = "the exact cantilever" if is_exact else "the same on a fine mesh"
    rows = []
    for k, level in enumerate(levels):
        row = [str(getattr(level, direction))]
        for j in range(len(names)):
            row += [number(errors[k][j], "+.1e"), number(orders[j][k - 1], ".2f") if k else ""]
        rows.append((*row, cost(found, level)))
    return Table(
        f"without contact, {where}: relative errors against {exact}",
        (*heading, "µs/step"),
        tuple(rows),
    )


def contact_table(
    found: Convergence,
    levels: list[Level],
    direction: Direction,
    title: str,
    quantities: Sequence[Statistic],
) -> Table:
    """Return the table of statistics, errors (if the study has a limit) and costs of levels."""
    has_limit = found.refinement.has_limit
    error = ["error [%]"] if has_limit else []
    has_springs = any(math.isfinite(found.value(level, "blow_steps")) for level in levels)
    blow = ["steps in a blow"] if has_springs else []
    ends = ("P", *blow, *error, "µs/step", "ms/period")
    heading = (direction, *(q.heading for q in quantities), *ends)
    rows = []
    for level in levels:
        result = found.results.get(level.key)
        if result is None or result.outcome != "completed":
            said = "not computed" if result is None else result.error
            rows.append((str(getattr(level, direction)), said, *[""] * (len(heading) - 2)))
            continue
        period = found.value(level, "periodicity")
        rows.append(
            (
                str(getattr(level, direction)),
                *(mean_and_scatter(found, level, q) for q in quantities),
                f"{period:.0f}" if period else NOTHING,
                *(number(found.value(level, "blow_steps"), ".3g") for _ in blow),
                *([number(100.0 * found.error(level), ".1f")] if has_limit else []),
                cost(found, level),
                number(1e3 * found.cost(level), ".2f"),
            )
        )
    return Table(title, heading, tuple(rows))


def limit_table(found: Convergence, levels: list[Level], direction: Direction, title: str) -> Table:
    """Return the table of observed orders and extrapolated limits of a line of levels."""
    rows = []
    for q in (*converging(found.n_laminae), *found.channels):
        told = found.limit(levels, q.name, by=direction)
        last = number(q.factor * found.value(levels[-1], q.name), ".4g")
        orders = ", ".join(number(p, ".2f") for p in told.orders)
        rows.append((q.heading, last, orders or NOTHING, limit_text(told, q), told.reason))
    heading = ("quantity", "finest", "observed orders", "limit", "how")
    return Table(f"{title}: what it tends to in {direction}", heading, tuple(rows))


def limit_text(told: statistics.Limit, q: Statistic) -> str:
    """Return a limit with its uncertainty as text."""
    if math.isnan(told.value):
        return NOTHING
    return f"{q.factor * told.value:.4g} ± {q.factor * told.uncertainty:.2g}"


def mean_and_scatter(found: Convergence, level: Level, q: Statistic) -> str:
    """Return the mean and the scatter of a statistic as text."""
    value, scatter = (q.factor * x for x in found.entry(level, q.name))
    text = f"{value:{q.form or '.3f'}}"
    return f"{text} ± {scatter:.2g}" if scatter else text


def cost(found: Convergence, level: Level) -> str:
    """Return the processor time of a step as text [µs]."""
    result = found.results.get(level.key)
    return NOTHING if result is None else number(result.microseconds_per_step, ".2f")


GOAL = 0.01
"""Distance from the limit that the verdict asks for, in half peak-to-peak displacements."""


def verdict(found: Convergence) -> str:
    """Say which run is within `GOAL` of the limit and cheapest, or that none is, and why.

    A run is judged in each direction that the study refines, beside two finer runs or more: in
    steps on its own mesh, in meshes with the smallest steps; see `Convergence.interval`.
    """
    refinement = found.refinement
    judged = [
        (level, *_judged(found, method, level))
        for method in refinement.methods
        for mesh in refinement.meshes
        for level in refinement.along_steps(method, mesh)
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
            ""
            if len(_directions(refinement)) == 2
            else f"; only {_directions(refinement)[0]} were refined"
        )
        return f"Within {goal}, and cheapest: {run} ({cost}), {away:.2g} ± {left:.2g} %{remark}."
    reason = f"the nearest that is judged, {run} ({cost}), is {away:.2g} ± {left:.2g} % away"
    if math.isinf(left):
        reason = f"errors do not shrink from level to level; {run}, is {away:.2g} % from the finest"
    if refinement.case.contact.restitution == 1.0 and refinement.has_limit:
        count = number(found.value(refinement.limit_of(chosen.mesh), "impacts"), ".0f")
        reason += (
            f"; with e = 1 contact takes nothing, so that pairs near one another are hit again and "
            f"again, and the impulses per period ({count} at T/{refinement.limit_steps}) grow with "
            "1/Δt"
        )
    return f"No run is known to be within {goal}: {reason}{_outlook(found, chosen)}."


def _outlook(found: Convergence, chosen: Level) -> str:
    """Return what would bring a run within `GOAL`; empty where that is not known.

    Steps are those at which the error of the finest level falls below `GOAL` with its order.
    """
    (method,) = (one for one in found.refinement.methods if one.name == chosen.method)
    levels = _line(found, method, chosen, "steps")
    if len(levels) < 3 or _directions(found.refinement) != ["steps"]:
        return ""
    finest = levels[-1]
    noise = found.noise(chosen, finest)
    if noise > GOAL / 2.0:
        share = f"{100.0 * noise:.2g} %"
        remedy = ": take more --periods" * (finest.periods == found.refinement.periods)
        return f"; {share} of that are the scatter of {finest.periods} periods{remedy}"
    left, order = found.beyond(levels, "steps", noise)
    if not (math.isfinite(left) and left > 0.0):
        return ""
    doublings = max(math.ceil(math.log2(left / GOAL) / order), 0)
    steps = finest.steps * 2**doublings
    return (
        f"; errors shrink with order {order:.1f}, so that about {steps} steps per period are "
        "enough, which two finer runs beside it would show"
    )


def _directions(refinement: RefinementStudy) -> list[Direction]:
    """Return what a study refines: "steps", and "elements" or "points"."""
    directions: list[Direction] = ["steps"] if len(refinement.steps) > 1 else []
    return (
        [*directions, refinement.refines] if len(refinement.meshes) > 1 else directions or ["steps"]
    )


def _line(found: Convergence, method: Method, level: Level, direction: Direction) -> list[Level]:
    """Return the line of levels through a level; in steps it may end with the rigid limit."""
    refinement = found.refinement
    if direction != "steps":
        return refinement.along_meshes(method, level.steps)
    levels = refinement.along_steps(method, level.mesh)
    goes_on = refinement.limit_steps > levels[-1].steps and dict(method.overrides) == RIGID
    return [*levels, refinement.limit_of(level.mesh)] if goes_on else levels


def _judged(found: Convergence, method: Method, level: Level) -> tuple[float, float]:
    """Return the distance of a level from the limit, and its uncertainty, over all directions."""
    away = left = 0.0
    for direction in _directions(found.refinement):
        line_level = level
        if direction != "steps":
            line_level = found.refinement.level(method, level.mesh, found.refinement.steps[-1])
        part = found.interval(line_level, _line(found, method, line_level, direction), direction)
        away = away + part[0]
        left = left + part[1]
    return away, left


def overview(found: Convergence) -> Iterator[Table]:
    """Yield short tables of all methods side by side: errors, judged numbers, contact work."""
    refinement = found.refinement
    judged = found.extrema[:1] if found.judged == found.extrema else found.judged
    for direction, where, levels in _shown(refinement, FREE):
        yield _brief_free_table(found, levels, direction, where)
    for direction, where, levels in (
        _shown(refinement, refinement.methods[0]) if refinement.methods else ()
    ):
        finest = f"the finest {direction} of each method"
        if direction == "steps" and refinement.has_limit:
            finest = "the rigid limit of the mesh"
        text = f"distance of the {found.what} from {finest} ± what is left beyond [%], {where}"
        yield _side_by_side(
            found,
            levels,
            direction,
            text,
            lambda level, method, by=direction: _percent(found, level, method, by),  # type: ignore[misc]
        )
        for q in dict.fromkeys((*judged, WORK)):
            yield _side_by_side(
                found,
                levels,
                direction,
                f"{q.heading}, {where}",
                lambda level, _, q=q: number(
                    q.factor * found.value(level, q.name), q.form or ".2f"
                ),  # type: ignore[misc]
            )


def _percent(found: Convergence, level: Level, method: Method, direction: Direction) -> str:
    """Return distance and uncertainty of a level as text [%]; the latter where it is finite."""
    line = _line(found, method, level, direction)
    away, left = (100.0 * part for part in found.interval(level, line, direction))
    text = number(away, ".2f")
    return f"{text} ± {left:.2g}" if math.isfinite(left) else text


def _shown(
    refinement: RefinementStudy, method: Method
) -> Iterator[tuple[Direction, str, list[Level]]]:
    """Yield the lines of levels of a method; over meshes, those with the smallest steps only."""
    for direction, where, levels in lines(refinement, (method,)):
        if direction == "steps" or levels[0].steps == refinement.steps[-1]:
            yield direction, where, levels


def _brief_free_table(
    found: Convergence, levels: list[Level], direction: Direction, where: str
) -> Table:
    """Return the table of the largest errors of all laminae without contact."""
    rows = []
    for level in levels:
        errors = abs(found.free_errors(level)).reshape(-1, 2).max(axis=0)
        cells = (number(error, ".1e") for error in errors)
        rows.append((str(getattr(level, direction)), *cells, cost(found, level)))
    heading = (direction, "frequency", "amplitude", "µs/step")
    return Table(f"relative errors without contact, {where}", heading, tuple(rows))


def _side_by_side(
    found: Convergence,
    line: list[Level],
    direction: Direction,
    title: str,
    value: Callable[[Level, Method], str],
) -> Table:
    """Return a table of one number, with a row for each level and a column for each method."""
    refinement = found.refinement
    rows = []
    for place in line:
        row = [str(getattr(place, direction))]
        for method in refinement.methods:
            level = refinement.level(method, place.mesh, place.steps)
            result = found.results.get(level.key)
            is_there = result is not None and result.outcome == "completed"
            said = NOTHING if result is None else result.outcome
            row.append(value(level, method) if is_there else said)
        rows.append(tuple(row))
    return Table(title, (direction, *(method.name for method in refinement.methods)), tuple(rows))


Value = Callable[[Level], float]

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
    """Return the functions that draw the figures of a study, by name.

    A study without a limit has no figures of errors against the limit.
    """
    refinement = found.refinement
    makers: dict[str, Callable[[Convergence], Figure]] = {}
    if len(refinement.steps) > 1:
        makers["free_steps"] = partial(free_over, direction="steps")
    if len(refinement.meshes_of(FREE)) > 1:
        makers["free_elements"] = partial(free_over, direction="elements")
    if refinement.methods and len(refinement.steps) > 1:
        makers["work_over_steps"] = work_over_steps
    if refinement.methods and refinement.has_limit:
        makers["error_over_cost"] = error_over_cost
        if len(refinement.steps) > 1:
            makers["error_over_steps"] = error_over_steps
        if len(refinement.meshes) > 1:
            makers[f"limit_over_{refinement.refines}"] = limit_over_meshes
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

    def work(level: Level) -> float:
        return WORK.factor * found.value(level, WORK.name)

    label, text = "steps per period", "contact work per period [mJ]"
    return _panels(
        found, lambda r: r.steps, work, label, text, has_limit=found.refinement.has_limit
    )


def limit_over_meshes(found: Convergence) -> Figure:
    """Draw the rigid limit over what meshes refine: extremes and contact work.

    In a study without a limit, the last method with the smallest steps stands for it.
    """
    refinement = found.refinement
    method, steps = (
        (LIMIT, refinement.limit_steps)
        if refinement.has_limit
        else (refinement.methods[-1], refinement.steps[-1])
    )
    levels = refinement.along_meshes(method, steps)
    n = [level.points for level in levels]
    name = {"elements": "elements per lamina", "points": "contact points per lamina"}
    figure = Figure(figsize=(style.WIDTH, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    colours = style.lamina_colours(found.n_laminae)
    for k, q in enumerate(found.extrema):
        line_style = "o-" if q.name.startswith("tip_max") else "s--"
        _with_bars(
            left, found, levels, q, fmt=line_style, color=colours[k // 2], label=f"|{q.symbol}|"
        )
    left.set(ylabel="rigid limit of the mesh [mm]")
    left.set_ylim(0.0, None)
    style.legend_above(left)
    _with_bars(right, found, levels, WORK, fmt="o-", color=style.BLACK)
    right.set_yscale("log")
    right.set_ylabel("contact work per period [mJ]")
    _plain_numbers(right.yaxis)
    for axes in (left, right):
        axes.set_xscale("log")
        _plain(axes, n)
        axes.set_xlabel(name[found.refinement.refines])
    name_of_limit = "newton@moreau-jean" if refinement.has_limit else method.name
    text = f"{name_of_limit}, {steps} steps per period, bars: ±{BARS:g} standard errors"
    figure.suptitle(f"{_title(found)}\n{text}")
    return figure


def _with_bars(
    axes: Axes, found: Convergence, levels: Sequence[Level], shown: Statistic, **line_style: Any
) -> None:
    """Draw the size of a statistic over the contact points, with bars of `BARS` standard errors."""
    n = [level.points for level in levels]
    values = [abs(shown.factor * found.value(level, shown.name)) for level in levels]
    errors = [BARS * shown.factor * found.standard_error(level, shown.name) for level in levels]
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
    meshes = found.refinement.meshes
    figure, grid = style.side_by_side(len(meshes), 3.5, PANELS, above=1.4, sharex=True, sharey=True)
    for axes, mesh in zip(grid, meshes, strict=True):
        for method, (colour, marker) in zip(found.refinement.methods, cycle(STYLES), strict=False):
            levels = found.refinement.along_steps(method, mesh)
            points = np.array([(abscissa(level), ordinate(level)) for level in levels])
            drawn = points[np.isfinite(points).all(axis=1) & (points > 0.0).all(axis=1)]
            axes.loglog(*drawn.T, marker=marker, color=colour, label=method.name, markersize=5)
        if has_limit and (level := ordinate(found.refinement.limit_of(mesh))) > 0.0:
            axes.axhline(level, color=style.BASE_COLOUR, linestyle="--", linewidth=1.0)
        axes.set_title(levels[0].mesh_text, loc="left")
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
    refinement = found.refinement
    if direction == "steps":
        levels = refinement.along_steps(FREE, refinement.meshes_of(FREE)[-1])
        label = "steps per period"
        slope = -2.0
        other = "elements"
    else:
        levels = refinement.along_meshes(FREE, refinement.steps[-1])
        label = "elements per lamina"
        slope = -4.0
        other = "steps"
    figure, (axes,) = style.stacked(1, 4.6)
    n = np.array([getattr(level, direction) for level in levels], dtype=float)
    errors = np.abs([found.free_errors(level) for level in levels])
    errors[~(errors > FREE_FLOOR)] = np.nan
    colours = style.lamina_colours(found.n_laminae)
    for i, lamina in enumerate(found.refinement.case.lamina):
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
    figure.suptitle(f"{_title(found)} without contact, {getattr(levels[0], other)} {other}")
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
    case = found.refinement.case
    damping = f"{case.damping.rayleigh} damping, {case.time.mass} mass"
    return f"{case.name}: {1.0 / case.period:g} Hz, {damping}"

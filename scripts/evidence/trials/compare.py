"""Compare trial methods for contact by their errors against the rigid limit."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from trials.runners import LIMIT, RESTITUTION, runners

from delam_fem.api import Case, FloatArray, Table, assemble, number, preset, style

STEPS = (1000, 4000, 16000)
LIMIT_STEPS = 256_000
MEAN_PERIODS = 60
"""Number of last periods over which extremes are averaged."""
METHOD_COLOURS = (
    style.BLUE,
    style.VERMILLION,
    style.GREEN,
    style.ORANGE,
    style.PURPLE,
    style.SKY,
    style.BLACK,
)
PER_PANEL = len(METHOD_COLOURS)
"""Largest number of methods in one panel of the figure; so no colour is used twice there."""

Errors: TypeAlias = dict[str, dict[int, float]]
"""Errors [%] by the name of the method and steps per period."""


@dataclass(frozen=True)
class Found:
    """Results of a method: mean extremes of both tips by steps per period.

    Attributes:
        extremes: smallest and largest tip displacements by steps per period, each of shape (2, 2)
            [m]; NaN if the motion diverged.
    """

    extremes: dict[int, FloatArray]

    def error(self, steps: int, limit: FloatArray) -> float:
        """Return the largest difference from the limit over half its peak-to-peak values [-]."""
        half = 0.5 * (limit[1] - limit[0])
        return float((np.abs(self.extremes[steps] - limit) / half).max())


def case_of(steps: int, periods: int) -> Case:
    """Return the case of the comparison: 3.25 Hz, 20 elements, stiffness damping."""
    sizes = {"time.refine": 1, "time.steps_per_period": steps, "time.periods": periods}
    physics = {"damping.rayleigh": "stiffness", "contact.restitution": RESTITUTION}
    return preset("default", {**sizes, **physics})


def compute(name: str, steps: int, periods: int) -> FloatArray:
    """Run a trial method; return the mean extremes of both tips, shape (2, 2) [m]."""
    case = case_of(steps, periods)
    with np.errstate(all="ignore"):
        rows = runners()[name](case, assemble(case, needs_dolfinx=False).operators)
        return np.asarray(rows[-min(MEAN_PERIODS, periods // 2) :].mean(axis=0))


def table(found: dict[str, Found], limit: FloatArray) -> Table:
    """Return the table of the smallest y1 and the error of every method."""
    steps = list(next(iter(found.values())).extremes)
    heading = ["way", *(f"y1, N = {n} [mm]" for n in steps), *(f"error, {n} [%]" for n in steps)]
    rows = []
    for name, one in found.items():
        y1 = (number(1e3 * one.extremes[n][0, 0], ".2f") for n in steps)
        errors = (number(100.0 * one.error(n, limit), ".1f") for n in steps)
        rows.append((name, *y1, *errors))
    return Table("", tuple(heading), tuple(rows))


def errors_of(found: dict[str, Found], limit: FloatArray) -> Errors:
    """Return the error of every method against the limit [%], by name and steps per period."""
    return {
        name: {n: 100.0 * one.error(n, limit) for n in one.extremes} for name, one in found.items()
    }


def errors_in(path: Path) -> Errors:
    """Return the errors [%] in the file of the trials, which has the columns of `table`."""
    with path.open(encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    steps = {k: int(cell.split()[1]) for k, cell in enumerate(heading) if cell.startswith("error,")}
    return {row[0]: {n: float(row[k]) for k, n in steps.items()} for row in rows}


def figure(errors: Errors) -> Figure:
    """Draw the error of every method over steps per period, `PER_PANEL` methods in each panel.

    Each method has its own colour and marker within its panel; all other methods are grey there.
    """
    names = list(errors)
    groups = [names[k : k + PER_PANEL] for k in range(0, len(names), PER_PANEL)]
    result = Figure(figsize=(style.WIDTH, 3.4 * len(groups)), layout="constrained")
    panels = result.subplots(len(groups), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for panel, group in zip(panels, groups, strict=True):
        for name in names:
            if name not in group:
                panel.loglog(*_curve(errors[name]), color=style.GAP_COLOUR, linewidth=0.8, zorder=1)
        for name, colour, marker in zip(group, METHOD_COLOURS, "os^vDPX", strict=False):
            panel.loglog(*_curve(errors[name]), color=colour, marker=marker, label=name)
        panel.set_ylabel("error of the extremes [%]")
        panel.set_xticks(list(errors[names[0]]))
        panel.xaxis.set_major_formatter(lambda value, _: f"{value:.0f}")
        panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        panel.xaxis.set_minor_locator(NullLocator())
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    style.label_x(panels, "steps per period [–]")
    result.suptitle("3.25 Hz, 20 elements, stiffness damping, e = 0.1; grey: the other panels")
    return result


def _curve(by_steps: dict[int, float]) -> tuple[list[int], list[float]]:
    """Return steps and errors of one method."""
    return list(by_steps), list(by_steps.values())


def measure(
    steps: Sequence[int], limit_steps: int, periods: int, workers: int | None
) -> tuple[dict[str, Found], FloatArray]:
    """Run all trial methods in worker processes.

    Args:
        steps: numbers of steps per period.
        limit_steps: steps per period of the run that stands for the rigid limit.
        periods: number of periods of each run.
        workers: number of processes; None: one per core.

    Returns:
        Results of every method by name; mean extremes of the limit, shape (2, 2) [m].
    """
    wanted = [(LIMIT, limit_steps), *((name, n) for name in runners() for n in reversed(steps))]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {key: pool.submit(compute, *key, periods) for key in wanted}
        results = {key: future.result() for key, future in futures.items()}
    measured = {name: Found({n: results[name, n] for n in steps}) for name in runners()}
    return measured, results[LIMIT, limit_steps]

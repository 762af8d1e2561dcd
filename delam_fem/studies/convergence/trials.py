"""Compare trial methods for contact by their errors against the rigid limit."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.case.files import preset
from delam_fem.model import closed_form
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.figures.style import WIDTH
from delam_fem.studies.convergence.tables import Table, number
from delam_fem.studies.convergence.trial_runners import LIMIT, RESTITUTION, runners

STEPS = (1000, 4000, 16000)
LIMIT_STEPS = 256_000
MEAN_PERIODS = 60
"""Number of last periods over which extremes are averaged."""


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
    sizes = {"time.steps_per_period": steps, "time.periods": periods}
    physics = {"damping.rayleigh": "stiffness", "contact.restitution": RESTITUTION}
    return preset("default", {**sizes, **physics})


def compute(name: str, steps: int, periods: int) -> FloatArray:
    """Run a trial method; return the mean extremes of both tips, shape (2, 2) [m]."""
    case = case_of(steps, periods)
    with np.errstate(all="ignore"):
        rows = runners()[name](case, closed_form.assemble(case).operators)
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


def figure(found: dict[str, Found], limit: FloatArray) -> Figure:
    """Draw the error of every method over steps per period."""
    result = Figure(figsize=(WIDTH, 5.2), layout="constrained")
    axes = result.add_subplot(
        xscale="log",
        yscale="log",
        xlabel="steps per period [–]",
        ylabel="error of the extremes [%]",
    )
    colours = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
    for i, (name, one) in enumerate(found.items()):
        errors = [100.0 * one.error(n, limit) for n in one.extremes]
        line = ("-", "--", ":")[i // len(colours)]
        colour, marker = colours[i % len(colours)], "os^v"[i // len(colours)]
        width = 3.0 if i == 0 else 1.3
        axes.plot(list(one.extremes), errors, line + marker, color=colour, lw=width, label=name)
    axes.set_xticks(list(next(iter(found.values())).extremes))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:.0f}")
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    result.legend(loc="outside right center", fontsize=7)
    result.suptitle("3.25 Hz, 20 elements, stiffness damping, e = 0.1", fontsize=10)
    return result


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
    found = {name: Found({n: results[name, n] for n in steps}) for name in runners()}
    return found, results[LIMIT, limit_steps]

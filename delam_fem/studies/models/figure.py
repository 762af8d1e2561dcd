"""The picture of a comparison of models: the tips from rest, and where the laminae strike."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.results.figures.style import BLACK, BLUE, GREEN, ORANGE, VERMILLION, WIDTH, styled
from delam_fem.studies.models.measures import Measured

COLOURS = (BLACK, VERMILLION, BLUE, GREEN, ORANGE)
SHOWN_PERIODS = 4
"""Periods of the histories that are shown, from rest."""


def draw(case: Case, models: Sequence[Measured]) -> Figure:
    """Return one row per frequency: tip histories of all models, impulses along the laminae."""
    n = len(models[0].motions)
    with styled():
        figure = Figure(figsize=(WIDTH, 2.6 * n + 0.6), layout="constrained")
        rows = figure.subplots(n, 2, squeeze=False, width_ratios=(2, 1))
        for k, (histories, along) in enumerate(rows):
            for own, colour in zip(models, COLOURS * len(models), strict=False):
                motion = own.motions[k]
                turns = motion.time * motion.frequency
                shown = turns <= SHOWN_PERIODS
                for number, tip in enumerate(motion.tips):
                    label = own.name if number == 0 else None
                    style = ("-", "--", ":", "-.")[number % 4]
                    histories.plot(
                        turns[shown], 1e3 * tip[shown], style, color=colour, lw=1.0, label=label
                    )
                along.plot(motion.x, 1e3 * motion.impulse, color=colour, lw=1.0)
                if motion.strike * motion.frequency <= SHOWN_PERIODS:
                    histories.axvline(motion.strike * motion.frequency, color=colour, lw=0.5)
            frequency = models[0].motions[k].frequency
            histories.set(ylabel="tip [mm]", title=f"{frequency:g} Hz; thin line: first strike")
            along.set(ylabel="impulse [mN s/m per period]", title="second half of the run")
        rows[-1][0].set_xlabel("periods")
        rows[-1][1].set_xlabel("x [m]")
        handles, labels = rows[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        names = ", ".join(f"{lamina.name}" for lamina in case.lamina)
        figure.suptitle(f"{case.name}: {names} (full, dashed, …) by model")
    return figure

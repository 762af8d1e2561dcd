"""Draw the sideband ratio along the beam, with and without the delaminations."""

from __future__ import annotations

from matplotlib.figure import Figure

from delam_fem.results.figures.style import BLUE, GAP_COLOUR, GREEN, VERMILLION, WIDTH
from delam_fem.studies.detection.modulation import Modulation


def modulation_figure(found: Modulation) -> Figure:
    """Draw the ratio of each point, that of the intact structure, and its limit."""
    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    axes = figure.subplots()
    for own in found.case.delamination:
        axes.axvspan(own.start, own.end, color=GAP_COLOUR, alpha=0.25, lw=0.0, label="delamination")
    axes.semilogy(found.x, found.ratio, "o-", color=VERMILLION, ms=3, label="with it")
    axes.semilogy(found.x, found.intact_ratio, "o-", color=BLUE, ms=3, label="without it")
    axes.semilogy(found.x, found.limits, "--", color=GREEN, label="limit of noise")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("sideband ratio [-]")
    probe = found.case.excitation.top_frequency
    axes.set_title(f"{found.case.name}, {probe:g} Hz ± {found.pump:g} Hz", loc="left")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    return figure

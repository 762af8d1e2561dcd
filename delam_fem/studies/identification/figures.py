"""Draw what an identification found: the posterior of the unknowns, a fitted resonance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.figures.style import BLUE, GREEN, VERMILLION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delam_fem.numerics.statistics import Posterior
    from delam_fem.studies.identification.resonance import Resonance
    from delam_fem.studies.unknown import Unknown

BINS = 24
"""Number of bars of a histogram."""
TAIL = 0.005
"""Share of the samples beyond either end of an axis."""
PANEL = 2.2
"""Size of a panel [in]."""


def posterior_figure(
    posterior: Posterior, unknowns: tuple[Unknown, ...], truth: list[float] | None
) -> Figure:
    """Draw the histogram of each unknown and the scatter of each pair.

    Args:
        posterior: the sample.
        unknowns: in the order of the columns.
        truth: values of a synthetic measurement; None: not known.
    """
    import matplotlib.pyplot as plt
    from matplotlib.ticker import MaxNLocator

    n = len(unknowns)
    low, high = _ranges(posterior, truth)
    figure, axes = plt.subplots(n, n, figsize=(PANEL * n, PANEL * n), squeeze=False)
    for i, row in enumerate(unknowns):
        for j, column in enumerate(unknowns):
            panel = axes[i, j]
            if j > i:
                figure.delaxes(panel)
                continue
            panel.set_xlim(low[j], high[j])
            values = posterior.samples[:, j]
            if i == j:
                edges = np.linspace(low[j], high[j], BINS + 1)
                panel.hist(values, edges, weights=posterior.weights, color=BLUE, alpha=0.7)
                for end in posterior.interval(0.9)[j]:
                    panel.axvline(end, color=BLUE, linestyle=":")
                panel.set_yticks([])
            else:
                sizes = 12.0 * posterior.weights / posterior.weights.max()
                panel.scatter(values, posterior.samples[:, i], s=sizes, color=BLUE, alpha=0.5)
                panel.set_ylim(low[i], high[i])
                if truth is not None:
                    panel.axhline(truth[i], color=VERMILLION, linewidth=0.8)
            if truth is not None:
                panel.axvline(truth[j], color=VERMILLION, linewidth=0.8)
            panel.set_xlabel(_short(column))
            panel.xaxis.set_major_locator(MaxNLocator(3))
            if j == 0 and i > 0:
                panel.set_ylabel(_short(row))
    figure.suptitle(_posterior_title(truth))
    figure.tight_layout()
    return figure


def _ranges(posterior: Posterior, truth: list[float] | None) -> tuple[FloatArray, FloatArray]:
    """Return the ends of the axes: nearly all samples, and the truth."""
    low, high = posterior.quantile(TAIL), posterior.quantile(1.0 - TAIL)
    if truth is not None:
        low, high = np.minimum(low, truth), np.maximum(high, truth)
    margin = 0.1 * (high - low)
    return low - margin, high + margin


def _short(unknown: Unknown) -> str:
    """Return the key of an unknown in the words of its last part."""
    return unknown.key.rsplit(".", 1)[-1].replace("_", " ")


def _posterior_title(truth: list[float] | None) -> str:
    text = "posterior; dotted: central 90 %"
    return text if truth is None else f"{text}; red: the truth"


def resonance_figure(found: Resonance) -> Figure:
    """Draw measured amplitudes, the fit, the peak and the natural frequency."""
    import matplotlib.pyplot as plt

    figure, panel = plt.subplots(figsize=(7.0, 4.0))
    shown = found.amplitudes
    panel.plot(shown.frequency, shown.amplitude, ".", color=BLUE, ms=2.5, label="measured")
    panel.plot(shown.frequency, shown.fitted, color=VERMILLION, label="fit")
    panel.axvline(found.peak, color=BLUE, linestyle=":", label=f"peak {found.peak:.4f} Hz")
    panel.axvline(found.frequency, color=GREEN, label=f"natural frequency {found.frequency:.4f} Hz")
    panel.set_xlabel("frequency of the base  [Hz]")
    panel.set_ylabel("amplitude over that of the base  [–]")
    panel.legend()
    figure.tight_layout()
    return figure

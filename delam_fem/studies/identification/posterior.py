"""Say and draw what a posterior of unknowns means."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from delam_fem.api import Case, FloatArray, Table, statistics, style
from delam_fem.studies.identification.unknowns import Unknown
from delam_fem.studies.sweeps.grid import unit_of

HEADING = ("key", "median", "90 % interval", "prior", "identified", "truth", "covered")
SEPARATED = 0.5
"""Two unknowns with a larger correlation than this are hardly separated."""


BINS = 24
"""Number of bars of a histogram."""
TAIL = 0.005
"""Share of the samples beyond either end of an axis."""
PANEL = 2.2
"""Size of a panel [in]."""


def posterior_figure(
    posterior: statistics.Posterior, labels: Sequence[str], truth: list[float] | None
) -> Figure:
    """Draw the histogram of each unknown and the scatter of each pair.

    Args:
        posterior: the sample.
        labels: unknowns in the order of the columns, in words with their units.
        truth: their values in a synthetic measurement; None: not known.
    """
    n = len(labels)
    # axes that hold nearly all samples and the truth
    low = posterior.quantile(TAIL)
    high = posterior.quantile(1.0 - TAIL)
    if truth is not None:
        low = np.minimum(low, truth)
        high = np.maximum(high, truth)
    margin = 0.08 * (high - low)  # no end of the samples is an edge of a bar
    low = low - margin
    high = high + margin
    figure = Figure(figsize=(PANEL * n, PANEL * n))
    axes = figure.subplots(n, n, squeeze=False)
    for i, row in enumerate(labels):
        for j, column in enumerate(labels):
            panel = axes[i, j]
            if j > i:
                figure.delaxes(panel)
                continue
            panel.set_xlim(low[j], high[j])
            values = posterior.samples[:, j]
            if i == j:
                edges = np.linspace(low[j], high[j], BINS + 1)
                panel.hist(values, edges, weights=posterior.weights, color=style.BLUE, alpha=0.7)
                for end in posterior.interval(0.9)[j]:
                    panel.axvline(end, color=style.BLUE, linestyle=":")
                panel.set_yticks([])
            else:
                sizes = 12.0 * posterior.weights / posterior.weights.max()
                panel.scatter(values, posterior.samples[:, i], s=sizes, color=style.BLUE, alpha=0.5)
                panel.set_ylim(low[i], high[i])
                if truth is not None:
                    panel.axhline(truth[i], color=style.VERMILLION, linewidth=0.8)
            if truth is not None:
                panel.axvline(truth[j], color=style.VERMILLION, linewidth=0.8)
            panel.set_xlabel(column)
            panel.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
            if j == 0 and i > 0:
                panel.set_ylabel(row)
    red = "" if truth is None else "; red: the truth"
    figure.suptitle(f"posterior; dotted: central 90 %{red}")
    figure.tight_layout()
    return figure


def label_of(unknown: Unknown, case: Case) -> str:
    """Return the last part of the key of an unknown in words, with its unit."""
    unit = unit_of(unknown.keys(case)[0], case)
    words = unknown.key.rsplit(".", 1)[-1].replace("_", " ")
    return f"{words}\n[{'–' if unit == '1' else unit}]"


class Description(NamedTuple):
    """A posterior in numbers and words.

    Attributes:
        entries: numbers of each unknown, by its key.
        table: the same as text.
        sentence: what is separated and identified.
        figure: draws the posterior.
    """

    entries: dict[str, dict[str, Any]]
    table: Table
    sentence: str
    figure: Callable[[], Figure]


def prior_of(unknowns: Sequence[Unknown]) -> FloatArray:
    """Return the central 90 % interval of each unknown before a measurement, (n_unknowns, 2)."""
    low, high = np.array([(unknown.low, unknown.high) for unknown in unknowns]).T
    return np.stack([low + 0.05 * (high - low), high - 0.05 * (high - low)], axis=1)


def described(
    case: Case,
    unknowns: Sequence[Unknown],
    posterior: statistics.Posterior,
    truth: list[float] | None = None,
    coverage: FloatArray | None = None,
) -> Description:
    """Return a posterior in numbers and words.

    Args:
        case: the case whose keys are sought.
        unknowns: the keys.
        posterior: their posterior.
        truth: their values in a synthetic measurement; None: not known.
        coverage: share of 90 % intervals that contain the truth, by unknown; None: not counted.
    """
    middle = posterior.quantile(0.5)
    interval = posterior.interval(0.9)
    correlation = posterior.correlation()
    is_identified = posterior.is_identified(prior_of(unknowns))
    entries: dict[str, dict[str, Any]] = {}
    rows = []
    for k, unknown in enumerate(unknowns):
        entries[unknown.key] = {
            "median": middle[k],
            "interval_90": interval[k],
            "prior": [unknown.low, unknown.high],
            "identified": bool(is_identified[k]),
            "truth": None if truth is None else truth[k],
            "coverage_of_90": None if coverage is None else coverage[k],
        }
        covered = "" if coverage is None else f"{100.0 * coverage[k]:.0f} %"
        known = "" if truth is None else f"{truth[k]:.4g}"
        span = f"{interval[k, 0]:.4g} … {interval[k, 1]:.4g}"
        prior = f"{unknown.low:g} … {unknown.high:g}"
        word = "yes" if is_identified[k] else "no"
        rows.append((unknown.key, f"{middle[k]:.4g}", span, prior, word, known, covered))
    pairs = [
        f"{unknowns[j].key} and {unknowns[i].key} (correlation {correlation[i, j]:+.2f})"
        for i in range(len(unknowns))
        for j in range(i)
        if abs(correlation[i, j]) > SEPARATED
    ]
    sentences = [f"These motions hardly separate {'; '.join(pairs)}."] if pairs else []
    if lost := [unknowns[k].key for k in np.flatnonzero(~is_identified)]:
        sentences.append(
            f"These motions do not identify {', '.join(lost)}: the 90 % interval is more than "
            f"{statistics.IDENTIFIED:g} times as wide as that of the prior."
        )
    labels = [label_of(unknown, case) for unknown in unknowns]
    return Description(
        entries,
        Table(f"identification of {case.name}", HEADING, rows),
        " ".join(sentences) or "These motions separate the unknowns.",
        partial(posterior_figure, posterior, labels, truth),
    )

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
PANEL = 2.4
"""Size of a panel [in]."""
DOTS = 1000
"""Most samples in a scatter."""


def posterior_figure(
    posterior: statistics.Posterior,
    labels: Sequence[tuple[str, str]],
    truth: list[float] | None,
) -> Figure:
    """Draw the histogram of each unknown and the scatter of each pair.

    Args:
        posterior: the sample.
        labels: words and unit of each unknown, in the order of the columns.
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
    # ticks have few digits: values are in thousands, thousandths and so on of their unit
    size = np.maximum(np.abs(low), np.abs(high))
    decades = np.log10(np.where(size > 0.0, size, 1.0))
    powers = 3 * np.floor((decades + 1.0) / 3.0).astype(np.int64)  # 0.1 to 100 are shown
    scale = 10.0**powers
    texts = [
        f"{words}\n[{f'1e{power} ' if power else ''}{unit}]".replace(" –]", "]")
        for (words, unit), power in zip(labels, powers.tolist(), strict=True)
    ]
    low = low / scale
    high = high / scale
    samples = posterior.samples / scale
    ends = posterior.interval(0.9) / scale[:, None]
    true_values = None if truth is None else (np.array(truth) / scale).tolist()
    some = slice(None, None, -(-len(samples) // DOTS))
    figure = Figure(figsize=(PANEL * n, PANEL * n))
    axes = figure.subplots(n, n, squeeze=False)
    for i, row in enumerate(texts):
        for j, column in enumerate(texts):
            panel = axes[i, j]
            if j > i:
                figure.delaxes(panel)
                continue
            panel.set_xlim(low[j], high[j])
            values = samples[:, j]
            if i == j:
                edges = np.linspace(low[j], high[j], BINS + 1)
                panel.hist(values, edges, weights=posterior.weights, color=style.BLUE, alpha=0.7)
                for end in ends[j]:
                    panel.axvline(end, color=style.BLUE, linestyle=":")
                panel.set_yticks([])
            else:
                sizes = 8.0 * posterior.weights[some] / posterior.weights.max()
                panel.scatter(values[some], samples[some, i], s=sizes, color=style.BLUE, alpha=0.4)
                panel.set_ylim(low[i], high[i])
                panel.yaxis.set_major_locator(MaxNLocator(3, prune="both"))
                if true_values is not None:
                    panel.axhline(true_values[i], color=style.VERMILLION, linewidth=0.8)
            if true_values is not None:
                panel.axvline(true_values[j], color=style.VERMILLION, linewidth=0.8)
            panel.set_xlabel(column)
            panel.xaxis.set_major_locator(MaxNLocator(2, prune="both"))
            panel.tick_params(labelsize=8)
            panel.ticklabel_format(useOffset=False, style="plain")
            if j == 0 and i > 0:
                panel.set_ylabel(row)
    red = "" if truth is None else "; red: the truth"
    figure.suptitle(f"posterior; dotted: central 90 %{red}")
    figure.tight_layout()
    return figure


def labels_of(unknowns: Sequence[Unknown], case: Case) -> list[tuple[str, str]]:
    """Return words and unit of each unknown: as many last parts of its key as tell it apart."""
    keys = [unknown.key.replace("_", " ").split(".") for unknown in unknowns]
    labels = []
    for key, unknown in zip(keys, unknowns, strict=True):
        n = 3 if key[-1].isdecimal() else 1  # an entry of a table
        while n < len(key) and sum(other[-n:] == key[-n:] for other in keys) > 1:
            n += 1
        unit = unit_of(unknown.keys(case)[0], case)
        labels.append((" ".join(key[-n:]), "–" if unit == "1" else unit))
    return labels


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
    sentences = [f"The measurement hardly separates {'; '.join(pairs)}."] if pairs else []
    if lost := [unknowns[k].key for k in np.flatnonzero(~is_identified)]:
        sentences.append(
            f"The measurement does not identify {', '.join(lost)}: the 90 % interval is more than "
            f"{statistics.IDENTIFIED:g} times as wide as that of the prior."
        )
    labels = labels_of(unknowns, case)
    return Description(
        entries,
        Table(f"identification of {case.name}", HEADING, rows),
        " ".join(sentences) or "The measurement separates the unknowns.",
        partial(posterior_figure, posterior, labels, truth),
    )

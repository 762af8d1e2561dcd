"""Draw the map of excitations: where along the beam and at which frequency the index is large."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLUE,
    GREEN,
    VERMILLION,
    WIDTH,
    label_x,
    legend_outside,
)
from delam_fem.studies.detection.excitation import ExcitationMap

TOP = 100.0
"""Index over its limit at which the colours end."""


def excitation_figure(found: ExcitationMap) -> Figure:
    """Draw the index over frequency and place, and contrast, visibility and calls below."""
    best = found.recommended
    row = best[0] if best is not None else int(found.visibility.max(axis=1).argmax())
    figure = Figure(figsize=(WIDTH, 8.0), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    _map(panels[0], found, row, figure)
    _lines(panels[1], found, row)
    label_x(panels, "frequency of the excitation [Hz]")
    ratio = found.ratios[row]
    more = f", g₀/A = {ratio:g}" if np.isfinite(ratio) else ""
    figure.suptitle(f"{found.case.name}, {found.noise_db:g} dB{more}", x=0.01, ha="left")
    return figure


def ratio_figure(found: ExcitationMap) -> Figure:
    """Draw the visibility over frequency and g₀/A."""
    figure = Figure(figsize=(WIDTH, 4.0), layout="constrained")
    axes = figure.subplots()
    values = np.clip(found.visibility, 1.0, TOP)
    rows = np.arange(found.ratios.size)
    picture = axes.pcolormesh(
        found.frequencies, rows, values, norm=LogNorm(1.0, TOP), shading="nearest"
    )
    axes.set_yticks(rows, [f"{ratio:g}" for ratio in found.ratios])
    axes.set(xlabel="frequency of the excitation [Hz]", ylabel="g₀/A")
    axes.grid(visible=False)
    figure.colorbar(picture, ax=axes, label="largest index over its limit of noise")
    return figure


def _map(axes: Axes, found: ExcitationMap, row: int, figure: Figure) -> None:
    """Draw the index over frequency and place."""
    values = np.clip(found.index[row].T, 1.0, TOP)
    picture = axes.pcolormesh(
        found.frequencies, found.x, values, norm=LogNorm(1.0, TOP), shading="nearest"
    )
    for own in found.case.delamination:
        for edge in (own.start, own.end):
            axes.axhline(edge, color="white", linestyle="--", linewidth=1.0)
    axes.set(ylabel="x [m]")
    axes.grid(visible=False)
    figure.colorbar(picture, ax=axes, label="2f-curvature over its limit of noise")


def _lines(axes: Axes, found: ExcitationMap, row: int) -> None:
    """Draw contrast, visibility and calls over frequency, and what is avoided."""
    f = found.frequencies
    half = 0.5 * (f[1] - f[0]) if f.size > 1 else 0.0
    for number, avoided in enumerate(f[found.is_avoided]):
        axes.axvspan(
            avoided - half, avoided + half, color=BASE_COLOUR, alpha=0.3, linewidth=0.0,
            label=None if number else "avoid",
        )  # fmt: skip
    axes.plot(f, found.visibility[row], color=BLUE, marker=".", label="index over limit")
    axes.plot(f, found.contrast[row], color=GREEN, marker=".", label="contrast")
    calls = np.maximum(found.calls[row], 1e-2)  # on a logarithmic axis
    axes.plot(f, calls, color=VERMILLION, marker=".", label="rate of calls")
    if found.recommended is not None:
        axes.axvline(f[found.recommended[1]], color="black", linestyle=":", label="recommended")
    axes.set(yscale="log", ylabel="[–]", xlim=(f[0], f[-1]))
    figure = axes.figure
    assert isinstance(figure, Figure)
    legend_outside(figure, axes, ncols=5, loc="outside lower center")

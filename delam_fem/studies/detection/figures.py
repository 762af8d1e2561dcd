"""Draw what studies of detection found."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLUE,
    GAP_COLOUR,
    GREEN,
    VERMILLION,
    WIDTH,
    label_x,
    legend_outside,
)
from delam_fem.studies.detection.detect import Detection
from delam_fem.studies.detection.excitation import ExcitationMap
from delam_fem.studies.detection.indices import SHARE, Mark
from delam_fem.studies.detection.modulation import Modulation

_TITLES = {
    "curvature": "2f-curvature  |V₂″|",
    "V2": "|V₂|",
    "V3": "|V₃|",
    "V1/2": "|V½|",
    "distortion": "distortion d",
    "thd": "THD",
}


def detection_figure(found: Detection) -> Figure:
    """Draw the index that calls, with and without the delamination, and the marked interval."""
    figure = Figure(figsize=(WIDTH, 6.0), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axes, own, text in (
        (panels[0], found.mark, "measured" if found.is_measured else "with the delamination"),
        (panels[1], found.intact_marks[found.index], "the same structure without delamination"),
    ):
        _spans(axes, found)
        _index(axes, own)
        called = f"called, {own.start:.4g} to {own.end:.4g} m" if own.is_detected else "not called"
        axes.set_title(f"{text}: {called}", loc="left")
        axes.set_ylabel(_TITLES[found.index])
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    label_x(panels, "x [m]")
    again = found.repeated
    if np.isfinite(again.start).all():
        for bounds in (again.start, again.end):
            panels[0].axvspan(*bounds, ymin=0.94, color=VERMILLION, alpha=0.6)
    figure.suptitle(f"{found.case.name}, {found.shapes.frequency:g} Hz", x=0.01, ha="left")
    return figure


def indices_figure(found: Detection) -> Figure:
    """Draw all indices with their limits."""
    marks = list(found.marks.values())
    rows = -(-len(marks) // 2)
    figure = Figure(figsize=(WIDTH, 0.6 + 2.3 * rows), layout="constrained")
    panels = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
    for axes in panels[len(marks) :]:
        axes.remove()
    for axes, own in zip(panels, marks, strict=False):
        _spans(axes, found)
        _index(axes, own)
        contrast = found.contrast(own.name)
        more = f", contrast {contrast:.1f}" if np.isfinite(contrast) else ""
        axes.set_title(_TITLES[own.name] + more, loc="left")
    label_x(panels[: len(marks)], "x [m]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=5, frameon=False)
    return figure


def shapes_figure(found: Detection) -> Figure:
    """Draw real and imaginary part of the shapes at f and 2f."""
    figure = Figure(figsize=(WIDTH, 5.0), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    unit = "m/s" if found.scan.quantity == "velocity" else "m"
    for axes, order in zip(panels, (1.0, 2.0), strict=True):
        _spans(axes, found)
        V = found.shapes.order(order)
        V = V * np.exp(-1j * np.angle(V[np.abs(V).argmax()]))
        axes.plot(found.shapes.x, V.real, color=BLUE, marker=".", label="in phase")
        axes.plot(found.shapes.x, V.imag, color=GREEN, marker=".", label="out of phase")
        axes.set_ylabel(f"V at {order * found.shapes.frequency:g} Hz [{unit}]")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    label_x(panels, "x [m]")
    return figure


def _spans(axes: Axes, found: Detection) -> None:
    """Shade the delaminations of the case."""
    for number, (start, end) in enumerate(found.spans):
        axes.axvspan(start, end, color=GAP_COLOUR, label=None if number else "delamination")


def _index(axes: Axes, own: Mark) -> None:
    """Draw an index with its limit and its marks."""
    x, values, marked = own.index.x, own.index.values, own.is_marked
    axes.plot(x, values, color=BLUE, marker=".", label="index")
    axes.plot(x[marked], values[marked], "o", color=VERMILLION, label="marked")
    axes.plot(x, own.index.limits, color=BASE_COLOUR, linestyle="--", label="limit of noise")
    axes.axhline(
        SHARE * values.max(), color=BASE_COLOUR, linestyle=":", label="30 % of the largest"
    )
    top = np.median(own.index.limits)
    if values.max() > 20.0 * top > 0.0 or own.index.limits.max() > 3.0 * values.max():
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0)


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

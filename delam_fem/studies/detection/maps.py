"""Maps of what was found on a plate: indices, shapes and the marked region."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.api import Case, FloatArray, Picture, style
from delam_fem.studies.detection.indices import Mark
from delam_fem.studies.detection.region import Region, area_of

if TYPE_CHECKING:
    from delam_fem.studies.detection.detect import Detection


def patches_of(case: Case) -> Region:
    """Return the delaminations of a plate in its plan."""
    return Region(tuple(patch.outline(case.half_width) for patch in case.delamination))


def middle_of(region: Region) -> tuple[float, float]:
    """Return x and z of the middle of the extent of the largest piece of a region [m]."""
    corners = max(region.outlines, key=area_of)
    x, z = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    return float(x), float(z)


def plate_pictures(found: Detection) -> dict[str, Picture]:
    """Return the pictures of a plate with their captions."""
    return {
        "figures/detection": (
            lambda: detection_map(found),
            "The index that calls, over what a marked point exceeds: its limit of noise, and 30 % "
            "of its largest value. Red: the marked region. White, dashed: the delaminations of the "
            "case.",
        ),
        "figures/indices": (
            lambda: index_maps(found),
            "All indices over what a marked point exceeds. The limit is what noise alone exceeds "
            "anywhere in 1 of 100 plates.",
        ),
        "figures/shapes": (
            lambda: shape_maps(found),
            "Magnitudes of the shapes at the excitation and at twice its frequency.",
        ),
    }


def detection_map(found: Detection) -> Figure:
    """Draw the index that calls, with and without the delaminations, and the marked region."""
    figure, panels = style.side_by_side(2, 3.6, above=0.6)
    for axes, index_mark, text in (
        (panels[0], found.mark, "measured" if found.is_measured else "with the delamination"),
        (panels[1], found.intact_marks[found.index], "without it"),
    ):
        draw_mark(figure, axes, index_mark, found)
        called = "called" if index_mark.is_detected else "not called"
        if index_mark.is_detected:
            called += f", {1e4 * index_mark.region.area:.3g} cm²"
        axes.set_title(f"{text}: {called}", loc="left")
    figure.suptitle(
        f"{found.case.name}, {found.shapes.frequency:g} Hz, index {found.index}", x=0.01, ha="left"
    )
    return figure


def index_maps(found: Detection) -> Figure:
    """Draw all indices over what a marked point exceeds."""
    figure, panels = style.side_by_side(len(found.marks), 2.6, above=0.6)
    for axes, (name, index_mark) in zip(panels, found.marks.items(), strict=True):
        draw_mark(figure, axes, index_mark, found)
        axes.set_title(name, loc="left")
    return figure


def shape_maps(found: Detection) -> Figure:
    """Draw |V1| and |V2| side by side."""
    figure, panels = style.side_by_side(2, 3.6, above=0.6)
    unit = "m/s" if found.scan.quantity == "velocity" else "m"
    shapes = found.shapes
    assert shapes.z is not None
    for axes, order, name in zip(panels, (1.0, 2.0), ("|V₁|", "|V₂|"), strict=True):
        _map(figure, axes, shapes.x, shapes.z, np.abs(shapes.order(order)), unit)
        draw_outlines(axes, found.patches)
        axes.set_title(f"{name} at {order * shapes.frequency:g} Hz", loc="left")
    return figure


def draw_mark(figure: Figure, axes: Axes, index_mark: Mark, found: Detection) -> None:
    """Draw an index over what a marked point exceeds, its region and the delaminations."""
    assert index_mark.z is not None
    ratio = index_mark.values / index_mark.levels
    _map(figure, axes, index_mark.x, index_mark.z, ratio, "index over its level [-]")
    draw_outlines(axes, found.patches)
    for outline in index_mark.region.outlines:
        axes.plot(*_closed(outline).T, color=style.VERMILLION, lw=1.8)


def _map(
    figure: Figure, axes: Axes, x: FloatArray, z: FloatArray, values: FloatArray, label: str
) -> None:
    """Draw values at points of a plate as colours."""
    colours = axes.tripcolor(x, z, values, shading="gouraud", cmap="viridis", vmin=0.0)
    figure.colorbar(colours, ax=axes, label=label, shrink=0.8)
    axes.set(xlabel="x [m]", ylabel="z [m]", aspect="equal")


def draw_outlines(axes: Axes, patches: Region) -> None:
    """Draw the outlines of delaminations."""
    for outline in patches.outlines:
        axes.plot(*_closed(outline).T, color="white", ls="--", lw=1.2)


def _closed(outline: FloatArray) -> FloatArray:
    """Return an outline whose last corner is its first one."""
    return np.concatenate([outline, outline[:1]])

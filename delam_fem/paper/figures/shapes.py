"""Fig. 4 of the paper: deflection shapes over one period, as pictures and as a film."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import BoolArray, FloatArray, IntArray
from delam_fem.paper.claims import NOT_IN_JSON, Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import RESONANT, Laboratory, motion_case
from delam_fem.results import diagnostics
from delam_fem.results.diagnostics import gap_field, rest_positions
from delam_fem.results.figures.style import BLACK, GAP_COLOUR, GREEN, WIDTH, lamina_colours

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from delam_fem.results.folder import Result

PHASES = (-0.2, -0.05, -0.01, 0.0, 0.01, 0.05, 0.2, 0.5)
"""Times of the shapes that are shown, in periods after the strike of the tips."""
FILM_FRAMES = 50
FILM_RATE = 12
"""Frames per second of the film."""
FILM_DPI = 100
CLOSED = 1e-4
"""Pairs nearer than this count as touching in the shapes [m]."""


def detailed_case(lab: Laboratory, frequency: float = RESONANT) -> Case:
    """Return the case of method 3.2 that keeps every pair's state at every step of two periods."""
    keys = {"output.fields_per_period": 1000, "output.window_periods": 2}
    return motion_case(frequency, lab.plan, "3.2", keys)


@dataclass(frozen=True)
class Shapes(Numbers):
    """The shapes of both laminae in one period, and the contact time of each pair.

    Attributes:
        x_m: positions of the pairs, shape (n_pairs,).
        share_closed, share_near: share of the time in which each pair is closed, and nearer than
            `CLOSED`, shape (n_pairs,) [-].
        periods_after_strike: times of the shapes that are shown.
        position_mm: positions of both laminae at these times, shape (2, n_shown, n_nodes).
        names: names of the laminae.
        x: positions of the nodes along the laminae, shape (n_nodes,) [mm].
        position: positions of both laminae over the period, shape (2, n_frames, n_nodes) [mm].
        shown: numbers of the frames that are shown.
    """

    x_m: FloatArray
    share_closed: FloatArray
    share_near: FloatArray
    periods_after_strike: tuple[float, ...]
    position_mm: FloatArray
    names: tuple[str, str] = field(metadata=NOT_IN_JSON)
    x: FloatArray = field(metadata=NOT_IN_JSON)
    position: FloatArray = field(metadata=NOT_IN_JSON)
    shown: IntArray = field(metadata=NOT_IN_JSON)


def measure(lab: Laboratory) -> Shapes:
    """Compute the motion at 3.25 Hz and take shapes from its last period.

    The time of the strike is that of the smallest gap of the tips.
    """
    (result,) = lab.motions([detailed_case(lab)])
    last = _last_period(result)
    n, x = last.sizes["frame"], last["x"].to_numpy()
    position = positions(last)
    strike = int(np.argmin(gap_field(last)[0, :, diagnostics.probe_node(last)]))
    shown = (strike + np.rint(np.array(PHASES) * n).astype(np.int64)) % n
    closed, near = contact_shares(result)
    thick, thin = result.case.lamina
    return Shapes(
        x_m=x[1:],
        share_closed=closed,
        share_near=near,
        periods_after_strike=PHASES,
        position_mm=np.round(position[:, shown], 4),
        names=(thick.name, thin.name),
        x=1e3 * x,
        position=position,
        shown=shown,
    )


def positions(frames: xr.Dataset) -> FloatArray:
    """Return u_1 = q_1 and u_2 = g0 + q_2 of all nodes, shape (2, n_frames, n_nodes) [mm]."""
    y: FloatArray = 1e3 * (frames["displacement"].to_numpy() + rest_positions(frames)[:, None])
    return y


def contact_shares(result: Result) -> tuple[FloatArray, FloatArray]:
    """Return the shares of time in which pairs are closed, and nearer than `CLOSED`, (n,) [-]."""
    gap = gap_field(result.history)[0, :, 1:]
    held = result.history["contact_state"].to_numpy()[:, 1:] > 0
    return ((gap <= 0.0) | held).mean(axis=0), (gap < CLOSED).mean(axis=0)


def _last_period(result: Result) -> xr.Dataset:
    """Return the frames of the last period only."""
    n = result.case.output.fields_per_period
    frames = result.history.sizes["frame"]
    return result.history.isel(frame=slice(frames - n, frames))


def draw(numbers: Shapes) -> Figure:
    """Draw both laminae at several times of one period, and the contact time of each pair."""
    from matplotlib.figure import Figure

    x, position = numbers.x, numbers.position
    figure = Figure(figsize=(WIDTH, 7.4), layout="constrained")
    columns = len(PHASES) // 2
    panels = figure.subplots(2, columns + 1, width_ratios=[1.0] * columns + [1.3])
    limits = position.min() - 3.0, position.max() + 3.0
    instants = zip(panels[:, :-1].ravel(), numbers.shown.tolist(), PHASES, strict=True)
    for panel, frame, phase in instants:
        _draw_shape(panel, x, position[:, frame])
        panel.set_title(f"strike {phase:+g} T".replace("-", "−") if phase else "strike", loc="left")
        panel.set(xlim=limits, ylim=(0.0, 1.03 * x[-1]))
        panel.set_xlabel("position [mm]")
    for panel in panels[:, 0]:
        panel.set_ylabel("x [mm]")
    for panel in panels[:, 1:-1].flat:
        panel.set_yticklabels([])
    for panel, share, text in (
        (panels[0, -1], numbers.share_closed, "pair closed"),
        (panels[1, -1], numbers.share_near, "gap < 0.1 mm"),
    ):
        panel.barh(x[1:], 100.0 * share, height=0.7 * x[1], color=GREEN)
        panel.set_title(text, loc="left")
        panel.set(xlabel="share of the period [%]", ylim=(0.0, 1.03 * x[-1]))
        panel.set_yticklabels([])
    _legend(figure, numbers.names)
    return figure


def _draw_shape(axes: Axes, x: FloatArray, position: FloatArray) -> None:
    """Draw both laminae at one time."""
    axes.fill_betweenx(x, position[0], position[1], color=GAP_COLOUR)
    for i, colour in enumerate(lamina_colours(2)):
        axes.plot(position[i], x, color=colour, linewidth=2.2 - 0.8 * i)
    touching = _touching(position)
    axes.plot(position.mean(axis=0)[1:][touching], x[1:][touching], "o", color=BLACK, markersize=4)


def _legend(figure: Figure, names: tuple[str, str]) -> None:
    """Draw a legend of the laminae above all panels."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, linewidth=2.2 - 0.8 * i, label=names[i])
        for i, colour in enumerate(lamina_colours(2))
    ]
    dots = Line2D([], [], color=BLACK, marker="o", markersize=4, linestyle="none")
    dots.set_label(f"nearer than {1e3 * CLOSED:g} mm")
    figure.legend(handles=[*handles, dots], loc="outside upper left", ncols=3, frameon=False)


def _touching(position: FloatArray) -> BoolArray:
    """Return which pairs touch at one time, shape (n_pairs,)."""
    touching: BoolArray = position[1, 1:] - position[0, 1:] < 1e3 * CLOSED
    return touching


def film(numbers: Shapes, path: Path) -> None:
    """Write the motion over one period as a GIF."""
    from matplotlib.animation import PillowWriter
    from matplotlib.figure import Figure

    x, every = numbers.x, max(numbers.position.shape[1] // FILM_FRAMES, 1)
    position = numbers.position[:, ::every]
    figure = Figure(figsize=(4.2, 5.4))
    axes = figure.add_axes((0.17, 0.11, 0.79, 0.82))
    axes.set(xlim=(position.min() - 3.0, position.max() + 3.0), ylim=(0.0, 1.03 * x[-1]))
    axes.set(xlabel="position [mm]", ylabel="x [mm]")
    lines = [
        axes.plot([], [], color=colour, linewidth=2.2 - 0.8 * i)[0]
        for i, colour in enumerate(lamina_colours(2))
    ]
    (dots,) = axes.plot([], [], "o", color=BLACK, markersize=4)
    text = axes.set_title("", loc="left")
    n = position.shape[1]
    writer = PillowWriter(fps=FILM_RATE)
    with writer.saving(figure, str(path), FILM_DPI):
        for frame in range(n):
            now = position[:, frame]
            for line, shape in zip(lines, now, strict=True):
                line.set_data(shape, x)
            touching = _touching(now)
            dots.set_data(now.mean(axis=0)[1:][touching], x[1:][touching])
            text.set_text(f"{RESONANT} Hz, t/T = {frame / n:.2f}")
            writer.grab_frame()


def judge(numbers: Shapes) -> tuple[Claim, ...]:
    """Judge whether the contact time differs between pairs."""
    closed, near = numbers.share_closed, numbers.share_near
    touched = closed[closed > 0.0]
    return (
        Claim(
            "4", "the contact duration is not constant along the beam", "sec. 2.2",
            f"{touched.size} of {closed.size} pairs touch in a period, for "
            f"{100 * touched.min():.1f} to {100 * touched.max():.1f} % of it; within 0.1 mm: "
            f"{100 * near.min():.1f} to {100 * near.max():.1f} %",
            *judged(Criterion("longest over shortest", touched.max() / touched.min(), ">", 2.0)),
        ),
    )  # fmt: skip


SHAPES = Piece(
    "4",
    "Deflection shapes",
    f"Method 3.2 at {RESONANT} Hz, instants of one period about the strike of the tips, thick "
    "lamina straight at rest (black: nearer than 0.1 mm). The paper shows measured shapes, "
    "which are not available; compared is the sentence on the duration of contact.",
    measure,
    draw,
    judge,
    film,
)

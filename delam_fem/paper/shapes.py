"""The system of the paper, its deflected shapes and its contact algorithm (Figs. 1, 4 and 11)."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from delam_fem.api import Case, FloatArray, InitialGap, Lamina, diagnostics, initial_gap, style
from delam_fem.paper.claims import Criterion, Numbers, Piece, Statement
from delam_fem.paper.runs import RESONANT, Laboratory, motion_case

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

    from delam_fem.api import Result

EXPONENTS = (1.0, 1.5, 2.0, 2.5, 3.0)
"""Exponents p of possible gap shapes g0(L) (x/L)^p; the paper does not give the shape."""
SHOWN_POINTS = 200
NEAR = 0.05
"""Two stiffnesses or mass ratios count as equal if they differ by less than this."""


def measure(lab: Laboratory) -> Numbers:
    """Return the properties of the paper's case; no motion is computed.

    Returns:
        case: the case as TOML; mass_ratio: m1/m2 [-]; natural_frequencies_hz: the first four of
        both laminae; stiffness_over_EbH3_12: given EI over that of the section, of both laminae
        [-]; x_m: positions along the laminae; gap_m: gap at these positions, by the exponent of its
        shape; drawn_case: the case itself.
    """
    case = motion_case(RESONANT, lab.plan)
    thick, thin = case.lamina
    assert case.gap is not None  # the paper's case has one
    x = np.linspace(0.0, thick.length, 21)
    return Numbers(
        {
            "case": case.to_toml(),
            "mass_ratio": thick.mass_per_length / thin.mass_per_length,
            "natural_frequencies_hz": [
                (lam.angular_frequencies(4) / (2.0 * math.pi)).tolist() for lam in case.lamina
            ],
            "stiffness_over_EbH3_12": [
                lam.flexural_rigidity / (lam.mean("young_modulus") * lam.second_moment)
                for lam in case.lamina
            ],
            "x_m": x,
            "gap_m": {
                f"{p:g}": initial_gap(InitialGap(tip=case.gap.tip, exponent=p), x, thick.length)
                for p in EXPONENTS
            },
        },
        drawn_case=case,
    )


def draw(numbers: Numbers) -> Figure:
    """Draw the laminae at rest, their gap, the base and the sensors, and list their properties."""
    case = numbers.drawn_case
    figure = style.canvas(5.2)
    left, right = figure.subplots(1, 2, width_ratios=[3, 4])
    _draw_laminae(left, case)
    right.axis("off")
    rows = [[name, *map(text, case.lamina)] for name, text in PROPERTIES]
    table = right.table(
        cellText=[*rows, ["contact pairs", f"{case.mesh.elements}", ""]],
        colLabels=["", *(lamina.name for lamina in case.lamina)], cellLoc="left",
        colWidths=[0.5, 0.28, 0.22], edges="horizontal", loc="center",
    )  # fmt: skip
    table.auto_set_font_size(False)
    table.set_fontsize(10.0)
    table.scale(1.0, 1.6)
    for column, colour in enumerate(style.lamina_colours(2), start=1):
        table[0, column].get_text().set_color(colour)
    figure.suptitle(f"{case.name}: the system at rest (horizontal scale stretched)")
    return figure


def _draw_laminae(axes: Axes, case: Case) -> None:
    """Draw both laminae upright on their base."""
    assert case.gap is not None  # the paper's case has one
    L = case.lamina[0].length
    tip = 1e3 * float(case.gap.tip or 0.0)
    x = np.linspace(0.0, L, SHOWN_POINTS)
    gaps = [1e3 * initial_gap(InitialGap(tip=case.gap.tip, exponent=p), x, L) for p in EXPONENTS]
    gap = 1e3 * initial_gap(case.gap, x, L)
    axes.fill_betweenx(1e3 * x, gaps[-1], gaps[0], color=style.GAP_COLOUR, label="p = 1 … 3")
    shapes = (np.zeros_like(x), gap)
    for lamina, shape, colour in zip(case.lamina, shapes, style.lamina_colours(2), strict=True):
        width = 2.5 * lamina.mean("thickness") / 1e-3
        label = f"{lamina.name}, {1e3 * lamina.mean('thickness'):g} mm"
        axes.plot(shape, 1e3 * x, color=colour, linewidth=width, label=label)
    height = 1e3 * L
    axes.annotate(
        "", (0.0, 0.97 * height), (tip, 0.97 * height),
        arrowprops={"arrowstyle": "<->", "color": style.BLACK, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    axes.text(0.5 * tip, 0.985 * height, f"{tip:g} mm", ha="center", va="bottom")
    for position, name in ((0.0, "$y_1$"), (tip, "$y_2$")):
        axes.plot([position], [height], "s", color=style.GREEN, markersize=7, zorder=4)
        axes.text(position, 1.035 * height, name, ha="center", va="bottom", color=style.GREEN)
    axes.plot([], [], "s", color=style.GREEN, label="position and velocity sensors")
    axes.fill_between([-5.0, tip + 5.0], -0.07 * height, 0.0, color=style.BASE_COLOUR)
    axes.annotate(
        "", (tip / 2 - 5.0, -0.11 * height), (tip / 2 + 5.0, -0.11 * height),
        arrowprops={"arrowstyle": "<->", "color": style.BLACK},
    )  # fmt: skip
    axes.text(
        tip / 2, -0.13 * height, f"base: A sin(2πft), {case.excitation.size}",
        ha="center", va="top",
    )  # fmt: skip
    axes.set(
        xlabel="position [mm]", xlim=(-9.0, tip + 9.0),
        ylabel="x [mm]", ylim=(-0.22 * height, 1.32 * height), yticks=np.arange(0.0, height, 100.0),
    )  # fmt: skip
    axes.legend(loc="upper center", fontsize=8, ncols=2)
    axes.grid(False)


PROPERTIES: tuple[tuple[str, Callable[[Lamina], str]], ...] = (
    ("length [mm]", lambda own: f"{1e3 * own.length:g}"),
    (
        "section [mm × mm]",
        lambda own: f"{1e3 * own.mean('thickness'):g} × {1e3 * own.mean('width'):g}",
    ),
    ("density [kg/m³]", lambda own: f"{own.mean('density'):g}"),
    ("E [10¹⁰ N/m²]", lambda own: f"{own.mean('young_modulus') / 1e10:g}"),
    ("EI used [N m²]", lambda own: f"{own.flexural_rigidity:g}"),
    ("E b h³/12 [N m²]", lambda own: f"{own.mean('young_modulus') * own.second_moment:.4f}"),
    ("mass per length [kg/m]", lambda own: f"{own.mass_per_length:.4f}"),
    ("damping ratio D", lambda own: f"{own.damping_ratio:g}"),
    ("f₁ exact [Hz]", lambda own: f"{own.angular_frequencies(2)[0] / (2.0 * math.pi):.4f}"),
    ("f₂ exact [Hz]", lambda own: f"{own.angular_frequencies(2)[1] / (2.0 * math.pi):.3f}"),
)
"""Rows of the table of properties: the name, and the text for a lamina."""


SYSTEM = Piece(
    "1",
    "The system",
    "Drawn from the case. The paper prints the gap at the tip alone: the shapes of the single "
    "laminae are unknown and do not matter, the shape of the gap does; the band shows the gaps "
    f"12 mm (x/L)^p with p = {EXPONENTS[0]:g} … {EXPONENTS[-1]:g}, the line p = "
    "{0.drawn_case.gap.exponent:g}, all counted from a straight thick lamina.",
    measure,
    draw,
    (
        Statement(
            "the ratio of masses is approximately m1/m2 = 1/2", "sec. 2.3",
            lambda n: f"ρ₁A₁/ρ₂A₂ = {n.mass_ratio:.3f}: the thick lamina is the heavier one "
            "(0.515 = m2/m1)",
            lambda n: [Criterion("away from 1/2 by", abs(n.mass_ratio - 0.5), "<", NEAR)],
        ),
        Statement(
            "E and the sections give EI = 1.51 and 0.16 N m²", "sec. 2.1, 3.1",
            lambda n: "EI given / (E b h³/12) − 1 = {:+.1f} % and {:+.1f} %; the given EI are used"
            .format(*(100 * (ratio - 1.0) for ratio in n.stiffness_over_EbH3_12)),
            lambda n: [
                Criterion(
                    "largest deviation",
                    max(abs(ratio - 1.0) for ratio in n.stiffness_over_EbH3_12), "<", NEAR, "%",
                )
            ],
        ),
    ),
)  # fmt: skip


def detailed_case(lab: Laboratory, frequency: float = RESONANT) -> Case:
    """Return the case of method 3.2 that keeps every pair's state at every step of two periods."""
    keys = {"output.fields_per_period": 1000, "output.window_periods": 2}
    return motion_case(frequency, lab.plan, "3.2", keys)


# -- Fig. 4: shapes ---------------------------------------------------------------------------

PHASES = (-0.2, -0.05, -0.01, 0.0, 0.01, 0.05, 0.2, 0.5)
"""Times of the shapes that are shown, in periods after the strike of the tips."""
FILM_FRAMES = 50
FILM_RATE = 12
"""Frames per second of the film."""
FILM_DPI = 100
CLOSED = 1e-4
"""Pairs nearer than this count as touching in the shapes [m]."""


def measure_shapes(lab: Laboratory) -> Numbers:
    """Compute the motion at 3.25 Hz and take shapes from its last period.

    The time of the strike is that of the smallest gap of the tips.

    Returns:
        x_m: positions of the pairs, shape (n_pairs,); share_closed, share_near: share of the time
        in which each pair is closed, and nearer than `CLOSED`, shape (n_pairs,) [-];
        periods_after_strike: times of the shapes that are shown; position_mm: positions of both
        laminae at these times, shape (2, n_shown, n_nodes); names: names of the laminae; x:
        positions of the nodes along the laminae, shape (n_nodes,) [mm]; position: positions of both
        laminae over the period, y_1 = q_1 and y_2 = g0 + q_2, shape (2, n_frames, n_nodes) [mm];
        shown: numbers of the frames that are shown.
    """
    (result,) = lab.motions([detailed_case(lab)])
    n = result.case.output.fields_per_period
    x = result.history["x"].to_numpy()
    last = result.history.isel(frame=slice(-n, None))
    position = 1e3 * (last["displacement"].to_numpy() + diagnostics.rest_positions(last)[:, None])
    strike = int(np.argmin(diagnostics.gap_field(last)[0, :, diagnostics.probe_node(last)]))
    samples = (strike + np.rint(np.array(PHASES) * n).astype(np.int64)) % n
    gap = diagnostics.gap_field(result.history)[0, :, 1:]
    has_contact = result.history["contact_state"].to_numpy()[:, 1:] > 0
    return Numbers(
        {
            "x_m": x[1:],
            "share_closed": ((gap <= 0.0) | has_contact).mean(axis=0),
            "share_near": (gap < CLOSED).mean(axis=0),
            "periods_after_strike": PHASES,
            "position_mm": np.round(position[:, samples], 4),
        },
        names=[lamina.name for lamina in result.case.lamina],
        x=1e3 * x,
        position=position,
        shown=samples,
    )


def draw_shapes(numbers: Numbers) -> Figure:
    """Draw both laminae at several times of one period, and the contact time of each pair."""
    x = numbers.x
    position = numbers.position
    figure = style.canvas(7.4)
    columns = len(PHASES) // 2
    panels = figure.subplots(2, columns + 1, width_ratios=[1.0] * columns + [1.3])
    limits = position.min() - 3.0, position.max() + 3.0
    instants = zip(panels[:, :-1].ravel(), numbers.shown.tolist(), PHASES, strict=True)
    for panel, frame, phase in instants:
        panel.fill_betweenx(x, *position[:, frame], color=style.GAP_COLOUR)
        _move(_curves(panel, numbers.names), x, position[:, frame])
        panel.set(
            title=f"strike {phase:+g} T".replace("-", "−") if phase else "strike",
            xlabel="position [mm]", xlim=limits, ylim=(0.0, 1.03 * x[-1]),
        )  # fmt: skip
    for panel in panels[:, 0]:
        panel.set_ylabel("x [mm]")
    for panel in panels[:, 1:-1].flat:
        panel.set_yticklabels([])
    for panel, share, text in (
        (panels[0, -1], numbers.share_closed, "pair closed"),
        (panels[1, -1], numbers.share_near, "gap < 0.1 mm"),
    ):
        panel.barh(x[1:], 100.0 * share, height=0.7 * x[1], color=style.GREEN)
        panel.set(
            title=text, xlabel="share of the period [%]", ylim=(0.0, 1.03 * x[-1]), yticklabels=[]
        )
    lines = _curves(panels[0, 0], numbers.names)  # without points: for the legend alone
    lines[-1].set_label(f"nearer than {1e3 * CLOSED:g} mm")
    figure.legend(handles=lines, loc="outside upper left", ncols=3, frameon=False)
    return figure


def _curves(axes: Axes, names: list[str]) -> list[Line2D]:
    """Return lines of both laminae and dots where they touch, still without points."""
    lines = [
        axes.plot([], [], color=colour, linewidth=2.2 - 0.8 * i, label=names[i])[0]
        for i, colour in enumerate(style.lamina_colours(2))
    ]
    return lines + axes.plot([], [], "o", color=style.BLACK, markersize=4)


def _move(lines: list[Line2D], x: FloatArray, position: FloatArray) -> None:
    """Give the lines of `_curves` the points of one time."""
    for line, shape in zip(lines[:2], position, strict=True):
        line.set_data(shape, x)
    touching = position[1, 1:] - position[0, 1:] < 1e3 * CLOSED
    lines[-1].set_data(position.mean(axis=0)[1:][touching], x[1:][touching])


def film(numbers: Numbers, path: Path) -> None:
    """Write the motion over one period as a GIF."""
    from matplotlib.animation import PillowWriter
    from matplotlib.figure import Figure

    x = numbers.x
    every = max(numbers.position.shape[1] // FILM_FRAMES, 1)
    position = numbers.position[:, ::every]
    figure = Figure(figsize=(4.2, 5.4))
    axes = figure.add_axes((0.17, 0.11, 0.79, 0.82))
    axes.set(
        xlabel="position [mm]", xlim=(position.min() - 3.0, position.max() + 3.0),
        ylabel="x [mm]", ylim=(0.0, 1.03 * x[-1]),
    )  # fmt: skip
    lines = _curves(axes, numbers.names)
    text = axes.set_title("")
    n = position.shape[1]
    writer = PillowWriter(fps=FILM_RATE)
    with writer.saving(figure, str(path), FILM_DPI):
        for frame in range(n):
            _move(lines, x, position[:, frame])
            text.set_text(f"{RESONANT} Hz, t/T = {frame / n:.2f}")
            writer.grab_frame()


def _touched(numbers: Numbers) -> FloatArray:
    """Return the shares of time of the pairs that touch at all [-]."""
    closed: FloatArray = numbers.share_closed[numbers.share_closed > 0.0]
    return closed


SHAPES = Piece(
    "4",
    "Deflection shapes",
    f"Method 3.2 at {RESONANT} Hz, instants of one period about the strike of the tips, thick "
    "lamina straight at rest (black: nearer than 0.1 mm). The paper shows measured shapes, "
    "which are not available; compared is the sentence on the duration of contact.",
    measure_shapes,
    draw_shapes,
    (
        Statement(
            "the contact duration is not constant along the beam", "sec. 2.2",
            lambda n: f"{_touched(n).size} of {n.share_closed.size} pairs touch in a period, for "
            f"{100 * _touched(n).min():.1f} to {100 * _touched(n).max():.1f} % of it; within "
            f"0.1 mm: {100 * n.share_near.min():.1f} to {100 * n.share_near.max():.1f} %",
            lambda n: [
                Criterion(
                    "longest over shortest", _touched(n).max() / _touched(n).min(), ">", 2.0
                )
            ],
        ),
    ),
    film,
)  # fmt: skip

# -- Fig. 11: the flow chart of the contact algorithm with the recorded decisions --------------

OPEN, SEPARATING, STRUCK, BEGUN, HELD, RELEASED = range(6)
"""Decisions of the supervisor on a pair at the end of a step. OPEN: U > 0 without a spring;
SEPARATING: U <= 0, but the pair is already parting; STRUCK: sudden impact with separation (Γₛ);
BEGUN: impact and beginning of permanent contact (Γₚ₀); HELD: permanent contact goes on (Γₚₚ);
RELEASED: the spring is removed (eq. 21)."""
NAMES = (
    "open", "closed, separating", "Γₛ: impact, separates", "Γₚ₀: impact, stays",
    "Γₚₚ: stays on spring", "spring released",
)  # fmt: skip
MARGIN = 0.005
"""Margin of the close view around the contact phase, in periods."""
COLOURS = ("#ffffff", "#bbbbbb", style.VERMILLION, style.ORANGE, style.BLUE, style.SKY)


def decisions(result: Result) -> tuple[npt.NDArray[np.int8], int]:
    """Read the supervisor's decisions from a run that keeps a frame at every step.

    The first step of the window is left out, because the state of the pairs before it is unknown.

    Returns:
        Decision on every pair at every step as an index into `NAMES`, shape (n_steps, n_pairs);
        number of decisions that break eq. 17 as corrected.
    """
    history = result.history
    is_resting = history["contact_state"].to_numpy()[:, 1:] == 2
    closed = diagnostics.gap_field(history)[0, :, 1:] <= 0.0
    hit = np.zeros_like(is_resting)
    steps = np.rint(
        (history["event_time"].to_numpy() - float(history["frame"][0])) / result.case.time_step
    ).astype(np.int64)
    hit[steps, history["event_node"].to_numpy() - 1] = True
    before = is_resting[:-1]
    is_resting = is_resting[1:]
    closed = closed[1:]
    hit = hit[1:]
    state = np.select(
        [
            before & ~is_resting,
            before & is_resting & ~hit,
            hit & is_resting,
            hit,
            closed,
        ],  # the first that fits
        [RELEASED, HELD, BEGUN, STRUCK, SEPARATING],
        OPEN,
    ).astype(np.int8)
    # a spring stays exactly while the pair is closed, without a hit; only a hit can begin one
    wrong = (before & (is_resting != closed)) | (before & hit) | (hit & ~closed)
    wrong |= is_resting & ~before & ~hit
    return state, int(np.count_nonzero(wrong))


def measure_chart(lab: Laboratory) -> Numbers:
    """Compute the motion at 3.25 Hz and count the decisions on every pair at every step.

    Returns:
        states: names of the decisions; pair_steps_per_period: pair-steps per period by decision,
        shape (6,); violations: number of decisions that break the partition; pair_steps: number of
        decisions; impacts_followed_by_contact: share of the impacts that begin permanent contact
        [-]; mean_contact_steps: mean length of permanent contacts, in steps; state: the decisions,
        shape (n_steps, n_pairs); steps_per_period: N.
    """
    (result,) = lab.motions([detailed_case(lab)])
    (state, violations), N = decisions(result), result.case.time.steps_per_period
    counts = np.bincount(state.ravel(), minlength=len(NAMES))
    return Numbers(
        {
            "states": list(NAMES),
            "pair_steps_per_period": counts / (state.shape[0] / N),
            "violations": violations,
            "pair_steps": int(state.size),
            "impacts_followed_by_contact": float(
                counts[BEGUN] / max(counts[BEGUN] + counts[STRUCK], 1)
            ),
        },
        mean_contact_steps=float((counts[HELD] + counts[BEGUN]) / max(counts[BEGUN], 1)),
        state=state,
        steps_per_period=N,
    )


def draw_chart(numbers: Numbers) -> Figure:
    """Draw the decisions of the supervisor as a chart with counts, and as a timeline of pairs."""
    state = numbers.state
    N = numbers.steps_per_period
    figure = style.canvas(9.6)
    grid = figure.add_gridspec(2, 2, height_ratios=[3, 2], width_ratios=[1, 2])
    _flow(figure.add_subplot(grid[0, :]), numbers.pair_steps_per_period, state.shape[1] * N)
    overview, close = (figure.add_subplot(grid[1, k]) for k in range(2))
    last = state[-N:]
    n_pairs = state.shape[1]
    for axes in (overview, close):
        axes.grid(False)  # marks, so that rare decisions are visible
        for kind, marker in (
            (SEPARATING, "."),
            (HELD, "s"),
            (RELEASED, "x"),
            (BEGUN, "D"),
            (STRUCK, "o"),
        ):
            steps, pairs = np.nonzero(last == kind)
            axes.plot(
                (steps + 0.5) / N, pairs + 1, marker, color=COLOURS[kind], markersize=4,
                linestyle="none", label=NAMES[kind],
            )  # fmt: skip
        axes.set(
            xlabel="time t/T [–]", xlim=(0.0, 1.0),
            ylim=(0.0, n_pairs + 1.0), yticks=range(2, n_pairs + 1, 2),
        )  # fmt: skip
    busy = np.flatnonzero((last != OPEN).any(axis=1)) / N
    overview.set(title="one period", ylabel="pair (1 near the clamp)")
    limits = (busy.min(initial=1.0) - MARGIN, busy.max(initial=0.0) + MARGIN)
    close.set(title="its contact phase", xlim=limits)
    style.legend_outside(figure, close, 5, "outside lower center")
    return figure


def _flow(axes: Axes, counts: FloatArray, total: int) -> None:
    """Draw the chart: questions as rounded boxes, coloured outcomes, numbers on the arrows."""
    axes.axis("off")
    axes.set(xlim=(0.0, 100.0), ylim=(0.0, 100.0))
    with_spring = counts[HELD] + counts[RELEASED]
    closed = counts[SEPARATING] + counts[STRUCK] + counts[BEGUN]
    hit = counts[STRUCK] + counts[BEGUN]
    boxes = {
        "step": (50, 94, "Newmark step → U, U̇⁻ of every pair", "#f2f2f2"),
        "spring": (50, 78, "on a spring already?", "#ffffff"),
        "still": (80, 62, "U ≤ 0 still?", "#ffffff"),
        "closed": (33, 62, "U ≤ 0?", "#ffffff"),
        "approach": (33, 46, "U̇⁻ < 0?", "#ffffff"),
        "impact": (33, 31, "impact:  U̇⁺ = −e U̇⁻", "#f2f2f2"),
        "slow": (33, 17, "U̇⁺ < γ?", "#ffffff"),
        "open": (8, 62, "open", COLOURS[OPEN]),
        "parting": (6, 46, "closed,\nseparating", COLOURS[SEPARATING]),
        "struck": (10, 3, "Γₛ: separates", COLOURS[STRUCK]),
        "begun": (44, 3, "Γₚ₀: gets a spring", COLOURS[BEGUN]),
        "held": (69, 46, "Γₚₚ: stays,\nno impact", COLOURS[HELD]),
        "released": (91, 46, "spring is\nreleased", COLOURS[RELEASED]),
    }
    drawn = {}
    for name, (x, y, text, colour) in boxes.items():
        dark = colour in (style.BLUE, style.VERMILLION)
        drawn[name] = axes.text(
            x, y, text, ha="center", va="center", fontsize=9.5,
            color="white" if dark else style.BLACK,
            bbox={"boxstyle": "round,pad=0.45", "facecolor": colour, "edgecolor": style.BLACK},
        )  # fmt: skip
    edges = (
        ("step", "spring", f"{total} pair-steps"),
        ("spring", "closed", f"no: {total - with_spring:.0f}"),
        ("spring", "still", f"yes: {with_spring:.0f}"),
        ("closed", "open", f"no: {counts[OPEN]:.0f}"),
        ("closed", "approach", f"yes: {closed:.1f}"),
        ("approach", "parting", f"no: {counts[SEPARATING]:.1f}"),
        ("approach", "impact", f"yes: {hit:.1f}"),
        ("impact", "slow", ""),
        ("slow", "struck", f"no: {counts[STRUCK]:.1f}"),
        ("slow", "begun", f"yes: {counts[BEGUN]:.1f}"),
        ("still", "held", f"yes: {counts[HELD]:.1f}"),
        ("still", "released", f"no: {counts[RELEASED]:.1f}"),
    )
    for a, b, text in edges:
        _arrow(axes, drawn[a], drawn[b], text)


def _arrow(axes: Axes, begin: Text, end: Text, text: str) -> None:
    """Draw an arrow from the edge of a box to the edge of another, with a number in its middle."""
    start = begin.get_position()
    stop = end.get_position()
    is_level = start[1] == stop[1]
    axes.annotate(
        "", stop, start, zorder=0,
        arrowprops={
            "arrowstyle": "-|>", "color": style.BLACK, "shrinkA": 0, "shrinkB": 0,
            "patchA": begin.get_bbox_patch(), "patchB": end.get_bbox_patch(),
        },
    )  # fmt: skip
    x = 0.5 * (start[0] + stop[0])
    y = 0.5 * (start[1] + stop[1])
    axes.text(
        x + (0.0 if is_level else 1.0), y + (1.0 if is_level else 0.0), text, fontsize=8.5,
        ha="center" if is_level else "left", va="bottom" if is_level else "center",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8},
    )  # fmt: skip


CHART = Piece(
    "11",
    "Flow chart of the contact algorithm",
    "Drawn from the recorded decisions of the contact supervisor at every step (method 3.2, "
    "3.25 Hz): numbers are pair-steps per period. Below: the decision on each pair over one "
    "period. The paper's chart is not available; the rules are its eq. 17 as corrected.",
    measure_chart,
    draw_chart,
    (
        Statement(
            "each closed pair is in exactly one of Γₛ, Γₚ₀, Γₚₚ (eq. 17, corrected)", "sec. 3.2",
            lambda n: f"{n.violations} of {n.pair_steps} recorded decisions break the partition",
            lambda n: [Criterion("violations", n.violations, "<", 1.0)],
        ),
        Statement(
            "a sudden impact marks the beginning of each contact event", "sec. 3.2",
            lambda n: f"{100 * n.impacts_followed_by_contact:.0f} % of the impacts begin permanent "
            f"contact, which lasts {n.mean_contact_steps:.1f} steps on average; no pair got a "
            "spring unhit",
            lambda n: [Criterion("violations", n.violations, "<", 1.0)],
        ),
    ),
)  # fmt: skip

"""Fig. 11 of the paper: the flow chart of the contact algorithm with the recorded decisions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.paper.claims import NOT_IN_JSON, Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.figures.shapes import detailed_case
from delam_fem.paper.lab import Laboratory
from delam_fem.results.diagnostics import gap_field
from delam_fem.results.figures.style import (
    BLACK,
    BLUE,
    ORANGE,
    SKY,
    VERMILLION,
    WIDTH,
    legend_outside,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from delam_fem.results.folder import Result

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
COLOURS = ("#ffffff", "#bbbbbb", VERMILLION, ORANGE, BLUE, SKY)


@dataclass(frozen=True)
class Decisions:
    """The decisions on every pair at every step of the window.

    Attributes:
        state: decision as an index into `NAMES`, shape (n_steps, n_pairs).
        violations: number of decisions (one per pair and step) that break eq. 17 as corrected.
    """

    state: npt.NDArray[np.int8]
    violations: int

    @property
    def counts(self) -> IntArray:
        """Number of pair-steps by decision, shape (6,)."""
        return np.bincount(self.state.ravel(), minlength=len(NAMES))


def decisions(result: Result) -> Decisions:
    """Read the supervisor's decisions from a run that keeps a frame at every step.

    The first step of the window is left out, because the state of the pairs before it is unknown.
    """
    history = result.history
    held = history["contact_state"].to_numpy()[:, 1:] == 2
    closed = gap_field(history)[0, :, 1:] <= 0.0
    hit = np.zeros_like(held)
    steps = np.rint(
        (history["event_time"].to_numpy() - float(history["frame"][0])) / result.case.time_step
    ).astype(np.int64)
    hit[steps, history["event_node"].to_numpy() - 1] = True
    before, held, closed, hit = held[:-1], held[1:], closed[1:], hit[1:]
    state = np.full(held.shape, OPEN, dtype=np.int8)
    state[closed] = SEPARATING
    state[hit & ~held] = STRUCK
    state[hit & held] = BEGUN
    state[before & held & ~hit] = HELD
    state[before & ~held] = RELEASED
    wrong = (before & (held != closed)) | (before & hit) | (hit & ~closed)
    wrong |= held & ~before & ~hit
    return Decisions(state, int(np.count_nonzero(wrong)))


@dataclass(frozen=True)
class Chart(Numbers):
    """How often the supervisor takes each decision.

    Attributes:
        states: names of the decisions.
        pair_steps_per_period: pair-steps per period by decision, shape (6,).
        violations: number of decisions that break the partition.
        pair_steps: number of decisions.
        impacts_followed_by_contact: share of the impacts that begin permanent contact [-].
        mean_contact_steps: mean length of permanent contacts, in steps.
        decisions: the decisions themselves.
        steps_per_period: N.
    """

    states: list[str]
    pair_steps_per_period: FloatArray
    violations: int
    pair_steps: int
    impacts_followed_by_contact: float
    mean_contact_steps: float = field(metadata=NOT_IN_JSON)
    decisions: Decisions = field(metadata=NOT_IN_JSON)
    steps_per_period: int = field(metadata=NOT_IN_JSON)


def measure(lab: Laboratory) -> Chart:
    """Compute the motion at 3.25 Hz and count the decisions on every pair at every step."""
    (result,) = lab.motions([detailed_case(lab)])
    found, N = decisions(result), result.case.time.steps_per_period
    return Chart(
        states=list(NAMES),
        pair_steps_per_period=found.counts / (found.state.shape[0] / N),
        violations=found.violations,
        pair_steps=int(found.state.size),
        impacts_followed_by_contact=_staying(found.counts),
        mean_contact_steps=_mean_length(found.state),
        decisions=found,
        steps_per_period=N,
    )


def _staying(counts: IntArray) -> float:
    """Return the share of impacts that begin permanent contact."""
    return float(counts[BEGUN] / max(counts[BEGUN] + counts[STRUCK], 1))


def _mean_length(state: npt.NDArray[np.int8]) -> float:
    """Return the mean length of permanent contacts in steps."""
    on_spring = np.count_nonzero((state == HELD) | (state == BEGUN))
    return float(on_spring / max(np.count_nonzero(state == BEGUN), 1))


def draw(numbers: Chart) -> Figure:
    """Draw the decisions of the supervisor as a chart with counts, and as a timeline of pairs."""
    from matplotlib.figure import Figure

    state, N = numbers.decisions.state, numbers.steps_per_period
    figure = Figure(figsize=(WIDTH, 9.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=[3, 2], width_ratios=[1, 2])
    _flow(figure.add_subplot(grid[0, :]), numbers.pair_steps_per_period, state.shape[1] * N)
    whole, close = (figure.add_subplot(grid[1, k]) for k in range(2))
    last = state[-N:]
    for axes in (whole, close):
        _timeline(axes, last)
    busy = np.flatnonzero((last != OPEN).any(axis=1)) / N
    whole.set_ylabel("pair (1 near the clamp)")
    close.set_xlim(busy.min(initial=1.0) - MARGIN, busy.max(initial=0.0) + MARGIN)
    whole.set_title("one period", loc="left")
    close.set_title("its contact phase", loc="left")
    legend_outside(figure, close, 5, "outside lower center")
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
        dark = colour in (BLUE, VERMILLION)
        drawn[name] = axes.text(
            x, y, text, ha="center", va="center", color="white" if dark else BLACK, fontsize=9.5,
            bbox={"boxstyle": "round,pad=0.45", "facecolor": colour, "edgecolor": BLACK},
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
    start, stop = begin.get_position(), end.get_position()
    is_level = start[1] == stop[1]
    axes.annotate(
        "", stop, start, zorder=0,
        arrowprops={
            "arrowstyle": "-|>", "color": BLACK, "shrinkA": 0, "shrinkB": 0,
            "patchA": begin.get_bbox_patch(), "patchB": end.get_bbox_patch(),
        },
    )  # fmt: skip
    x, y = 0.5 * (start[0] + stop[0]), 0.5 * (start[1] + stop[1])
    axes.text(
        x + (0.0 if is_level else 1.0), y + (1.0 if is_level else 0.0), text, fontsize=8.5,
        ha="center" if is_level else "left", va="bottom" if is_level else "center",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8},
    )  # fmt: skip


def _timeline(axes: Axes, state: npt.NDArray[np.int8]) -> None:
    """Draw the decisions on each pair over one period, as marks, so that rare ones are visible."""
    N, n_pairs = state.shape
    axes.grid(False)
    for kind, marker in (
        (SEPARATING, "."),
        (HELD, "s"),
        (RELEASED, "x"),
        (BEGUN, "D"),
        (STRUCK, "o"),
    ):
        steps, pairs = np.nonzero(state == kind)
        axes.plot(
            (steps + 0.5) / N, pairs + 1, marker, color=COLOURS[kind], markersize=4,
            linestyle="none", label=NAMES[kind],
        )  # fmt: skip
    axes.set(xlabel="time t/T [–]", xlim=(0.0, 1.0), ylim=(0.0, n_pairs + 1.0))
    axes.set_yticks(range(2, n_pairs + 1, 2))


def judge(numbers: Chart) -> tuple[Claim, ...]:
    """Judge whether the decisions follow the corrected eq. 17."""
    return (
        Claim(
            "11", "each closed pair is in exactly one of Γₛ, Γₚ₀, Γₚₚ (eq. 17, corrected)",
            "sec. 3.2",
            f"{numbers.violations} of {numbers.pair_steps} recorded decisions break the partition",
            *judged(Criterion("violations", numbers.violations, "<", 1.0)),
        ),
        Claim(
            "11", "a sudden impact marks the beginning of each contact event", "sec. 3.2",
            f"{100 * numbers.impacts_followed_by_contact:.0f} % of the impacts begin permanent "
            f"contact, which lasts {numbers.mean_contact_steps:.1f} steps on average; no pair got "
            "a spring unhit",
            *judged(Criterion("violations", numbers.violations, "<", 1.0)),
        ),
    )  # fmt: skip


CHART = Piece(
    "11",
    "Flow chart of the contact algorithm",
    "Drawn from the recorded decisions of the contact supervisor at every step (method 3.2, "
    "3.25 Hz): numbers are pair-steps per period. Below: the decision on each pair over one "
    "period. The paper's chart is not available; the rules are its eq. 17 as corrected.",
    measure,
    draw,
    judge,
)

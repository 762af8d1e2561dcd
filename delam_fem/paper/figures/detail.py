"""Figs. 10 and 13 of the paper: the contact phase at 3.25 Hz by method 3.1 and by method 3.2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np

from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.claims import NOT_IN_JSON, Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import LAWS, RESONANT, Laboratory, PaperMethod, motion_case, strikes
from delam_fem.paper.measures import CLEARLY, SMOOTH_HARMONICS, roughness, tip_positions
from delam_fem.results import diagnostics
from delam_fem.results.figures.style import (
    PORTRAIT_PERIODS,
    WIDTH,
    label_x,
    lamina_colours,
    legend_above,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delam_fem.results.folder import Result

DETAIL = (0.10, 0.25)
"""Time before and after the strike that details show, in periods."""


@dataclass(frozen=True)
class StrikeDetail:
    """The motion of both tips around the last strike whose details are all in the window.

    Attributes:
        names: names of the laminae.
        time: t/T since the strike, shape (n,) [-].
        position: positions of the tips, shape (2, n) [mm].
        velocity: velocities of the tips, shape (2, n) [m/s].
    """

    names: tuple[str, str]
    time: FloatArray
    position: FloatArray
    velocity: FloatArray

    @classmethod
    def of(cls, result: Result) -> Self:
        """Return the detail of a result that has at least one strike."""
        N = result.case.time.steps_per_period
        t, y = tip_positions(result, PORTRAIT_PERIODS)
        v = diagnostics.phase_portrait(result.history, result.case, PORTRAIT_PERIODS)[:, 1]
        steps = strikes(result).step
        at = int(steps[steps + DETAIL[1] * N < t.size][-1])
        part = slice(max(at - int(DETAIL[0] * N), 0), at + int(DETAIL[1] * N))
        thick, thin = result.case.lamina
        return cls((thick.name, thin.name), t[part] - t[at], y[:, part], v[:, part])


def _draw(details: Mapping[PaperMethod, StrikeDetail]) -> Figure:
    """Draw the phase portrait and the history around a strike; one row per method."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 0.5 + 4.1 * len(details)), layout="constrained")
    panels = figure.subplots(len(details), 2, squeeze=False, sharex="col", sharey="col")
    for row, (method, detail) in zip(panels, details.items(), strict=True):
        for i, colour in enumerate(lamina_colours(2)):
            y, v, name = detail.position[i], detail.velocity[i], detail.names[i]
            style = {"color": colour, "linewidth": 0.7, "marker": ".", "markersize": 2.5}
            row[0].plot(y, v, label=name, **style)
            row[1].plot(detail.time, y, label=name, **style)
        row[0].set_title(f"[a] phase portrait, method {method}", loc="left")
        row[1].set_title("[b] history", loc="left")
        row[0].set_ylabel("velocity of the tip [m/s]")
        row[1].set_ylabel("position of the tip [mm]")
        row[1].set_xticks(np.arange(-1, 3) / 10.0)
    label_x(panels[:, 0], "position of the tip [mm]")
    label_x(panels[:, 1], "time since the strike  t/T [–]")
    legend_above(panels[0][1])
    return figure


# -- Fig. 10: method 3.1 ----------------------------------------------------------------------


@dataclass(frozen=True)
class Impacts(Numbers):
    """The contact phase by method 3.1.

    Attributes:
        roughness_velocity, roughness_displacement: roughness of both tips while they are near [-].
        impacts_per_period: impacts per period, by method 3.1 and by method 3.2.
        detail: motion around a strike.
    """

    roughness_velocity: tuple[float, float]
    roughness_displacement: tuple[float, float]
    impacts_per_period: list[float]
    detail: StrikeDetail = field(metadata=NOT_IN_JSON)


def measure_impacts(lab: Laboratory) -> Impacts:
    """Compute the motion at 3.25 Hz by both methods."""
    result, other = lab.motions([motion_case(RESONANT, lab.plan, m) for m in LAWS])
    return Impacts(
        roughness_velocity=roughness(result, free=False, quantity="tip_velocity"),
        roughness_displacement=roughness(result, free=False, quantity="tip_displacement"),
        impacts_per_period=[float(r.summary["impacts_per_period"]) for r in (result, other)],
        detail=StrikeDetail.of(result),
    )


def draw_impacts(numbers: Impacts) -> Figure:
    """Draw the contact phase by method 3.1: phase portrait [a] and time history [b]."""
    return _draw({"3.1": numbers.detail})


def judge_impacts(numbers: Impacts) -> tuple[Claim, ...]:
    """Judge how method 3.1 resolves permanent contact."""
    v, q = numbers.roughness_velocity, numbers.roughness_displacement
    impacts = numbers.impacts_per_period
    return (
        Claim(
            "10", "permanent contact is captured by numerous single impacts", "sec. 3.1",
            f"{impacts[0]:.0f} impacts on all pairs per period at {RESONANT} Hz ({impacts[1]:.0f} "
            "by method 3.2)",
            *judged(Criterion("impacts per period", impacts[0], ">", 1.0)),
        ),
        Claim(
            "10", "the time history is hardly affected by successive impacts", "sec. 3.1",
            f"share of the motion above harmonic {SMOOTH_HARMONICS} while the tips are near: "
            f"velocity {100 * v[0]:.0f} / {100 * v[1]:.0f} %, displacement {100 * q[0]:.1f} / "
            f"{100 * q[1]:.1f} % (thick / thin)",
            *judged(Criterion("displacement over velocity", max(q) / max(v), "<", 0.1, "%")),
        ),
    )  # fmt: skip


IMPACTS = Piece(
    "10",
    "Contact phase by method 3.1",
    f"Method 3.1 at {RESONANT} Hz about one strike, every time step a dot.",
    measure_impacts,
    draw_impacts,
    judge_impacts,
)


# -- Fig. 13: method 3.2 beside method 3.1 ----------------------------------------------------


@dataclass(frozen=True)
class Contact(Numbers):
    """The contact phase by both methods.

    Attributes:
        roughness_near: roughness of both tips while they are near, by method [-].
        ratio: roughness by method 3.2 over that by method 3.1, shape (2,) [-].
        details: motion around a strike, by method.
    """

    roughness_near: dict[PaperMethod, tuple[float, float]]
    ratio: FloatArray
    details: dict[PaperMethod, StrikeDetail] = field(metadata=NOT_IN_JSON)


def measure_contact(lab: Laboratory) -> Contact:
    """Compute the motion at 3.25 Hz by both methods."""
    found = {m: lab.motions([motion_case(RESONANT, lab.plan, m)])[0] for m in LAWS}
    rough = {m: roughness(r, free=False) for m, r in found.items()}
    return Contact(
        roughness_near=rough,
        ratio=np.divide(rough["3.2"], rough["3.1"]),
        details={m: StrikeDetail.of(r) for m, r in found.items()},
    )


def draw_contact(numbers: Contact) -> Figure:
    """Draw the contact phase by method 3.2 above that by method 3.1."""
    return _draw({"3.2": numbers.details["3.2"], "3.1": numbers.details["3.1"]})


def judge_contact(numbers: Contact) -> tuple[Claim, ...]:
    """Judge whether permanent contact makes the contact phase smoother."""
    ratio = numbers.ratio
    return (
        Claim(
            "13", "permanent contact makes the contact phase more realistic", "sec. 3.2",
            f"velocity above harmonic {SMOOTH_HARMONICS} while the tips are near, 3.2 over 3.1: "
            f"{ratio[0]:.2f} (thick), {ratio[1]:.2f} (thin)",
            *judged(Criterion("larger ratio", float(np.max(ratio)), "<", CLEARLY)),
        ),
    )  # fmt: skip


CONTACT = Piece(
    "13",
    "Contact phase by method 3.2",
    f"{RESONANT} Hz about one strike by both methods, every time step a dot.",
    measure_contact,
    draw_contact,
    judge_contact,
)

"""Lateral impact of a steel strip: Fig. 6 (on the ground) and 7 (its tip on a block)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.api import style
from delam_fem.paper import rigid_ground
from delam_fem.paper.claims import Criterion, Numbers, Piece, Statement
from delam_fem.paper.falling_strip import (
    LIFT,
    LONG,
    PEAK_DURATION,
    Rolling,
    RollingStudy,
    TipBlock,
    exact_beam,
    rolling_study,
    tip_block,
)
from delam_fem.paper.panels import line, show
from delam_fem.paper.runs import Laboratory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# -- Fig. 6: a strip that falls on the ground on which it lies ----------------------------------

MAIN = "newton@moreau-jean"
"""The law of the thin strip by which the statements are judged."""
NEARLY_ALL = 0.9
"""A share of the energy above this counts as nearly all."""
FROM_CLAMP = 0.5
"""With a larger rank correlation of place and time, the contact line runs from clamp to tip."""


NO_REBOUND = 0.05
"""A rebound below this share of the speed or height before the impact counts as none."""
LAW_COLOURS = {"newton@moreau-jean": style.BLUE, "newton-penalty@newmark": style.ORANGE}
MARKERS = {20: ("s", "□"), 40: ("^", "△"), 80: ("o", "○")}
"""Markers of the meshes of the refinement, and how a title shows them, by number of elements."""
SHOWN_LANDING = (-0.02, 0.06)
SHOWN_ENERGY = (-0.05, 0.25)
"""Parts of the period around the first hit that are drawn."""


GAUGE_COLOURS = (style.BLUE, style.VERMILLION)


def measure_rolling(lab: Laboratory) -> Numbers:
    """Compute the fall of a strip on the ground with its variations, and the one on a block.

    Both experiments of the paper are computed at the same time.

    Returns:
        by_law, stiff, by_height_mm, refinement: from `RollingStudy.numbers`; study: all results of
        the first experiment; block: results of the second experiment, whose set-up is drawn.
    """
    begun = lab.begin("rolling study", rolling_study, fast=not lab.plan.has_long_refinements)
    block = struck_block(lab)
    return rolling_numbers(begun.result(), block)


def rolling_numbers(study: RollingStudy, block: TipBlock) -> Numbers:
    """Return the numbers of a study of the falling strip, with the block for the set-up."""
    return Numbers(study.numbers(), study=study, block=block)


def struck_block(lab: Laboratory) -> TipBlock:
    """Compute a strip with its tip on a block, once; other computations may run meanwhile."""
    return lab.begin("tip block", tip_block).result()


def draw_rolling(numbers: Numbers) -> Figure:
    """Draw the results of the strip on the ground, and the set-up of the strip on a block."""
    figure = style.canvas(12.6)
    study = numbers.study
    rows = figure.subfigures(4, 1, height_ratios=(1.0, 1.35, 1.35, 1.35))
    _draw_setup(rows[0].subplots(), numbers.block)
    main = study.by_law["newton@moreau-jean"]
    for axes, run in zip(rows[1].subplots(1, 2), (main, study.stiff), strict=True):
        _draw_contact_line(axes, run)
    left, right = rows[2].subplots(1, 2)
    energy = main.energy
    parts = np.array([energy.stored, energy.damped, energy.impact]) / energy.stored[0]
    names = ("in the strip", "lost to damping", "lost at impacts")
    left.stackplot(
        1e3 * energy.time,
        parts,
        labels=names,
        colors=(style.BASE_COLOUR, style.SKY, style.VERMILLION),
    )
    time_span = main.landing[0] + main.period * np.array(SHOWN_ENERGY)
    left.set(
        title=f"thin strip, {main.method}, {main.x.size} elements",
        xlabel="time after the release  [ms]", xlim=1e3 * time_span,
        ylabel="share of the energy  [–]", ylim=(0.0, 1.0),
    )  # fmt: skip
    left.legend(loc="lower right")
    show(
        right,
        *(
            line(1e3 * run.time, 1e3 * run.tip, color=LAW_COLOURS[name], label=name)
            for name, run in study.by_law.items()
        ),
        title="tip of the thin strip", xlabel="time after the release  [ms]", xmargin=0.0,
        ylabel="height of the tip  [mm]", ylim=(-1.0, 1.02e3 * LIFT), legend="upper right",
    )  # fmt: skip
    left, right = rows[3].subplots(1, 2)
    _draw_refinement(left, study)
    _draw_heights(right, study)
    return figure


def _draw_setup(axes: Axes, block: TipBlock) -> None:
    """Draw the strip with its sensors to scale, once lifted and once free of stress."""
    from matplotlib.patches import Rectangle

    strip = block.lamina
    n = 100
    x = 1e3 * np.concatenate([[0.0], rigid_ground.nodes(strip, n)])
    length = 1e3 * strip.length
    t = 1e3 * strip.mean("thickness")
    up = 1e3 * np.concatenate([[0.0], rigid_ground.lifted(strip, n, LIFT, "tip force")[::2]])
    axes.fill_between(x, 0.0, t, color=style.BASE_COLOUR, linewidth=0.0)
    axes.plot(
        x, up + 0.5 * t, color=style.BLACK, linestyle="--", label="lifted, before the release"
    )
    axes.add_patch(Rectangle((-22.0, -16.0), 22.0, 35.0, facecolor="#c8c8c8", hatch="///"))
    axes.add_patch(Rectangle((length - 12.0, -16.0), 14.0, 16.0, facecolor=style.ORANGE))
    axes.annotate(
        "[3] block and force transducer",
        (length - 5.0, -10.0),
        (length - 40.0, -13.0),
        ha="right",
        va="center",
        arrowprops={"arrowstyle": "-"},
    )
    for number, (place, colour) in enumerate(zip(block.gauges, GAUGE_COLOURS, strict=True), 1):
        at = 1e3 * float(place)
        axes.plot([at - 4.0, at + 4.0], [t + 1.5] * 2, color=colour, linewidth=4.0)
        axes.text(at, t + 6.0, f"[{number}]", color=colour, ha="center")
    axes.annotate(
        "", (length + 6.0, t), (length + 6.0, t + 1e3 * LIFT), arrowprops={"arrowstyle": "<->"}
    )
    axes.text(length + 9.0, 0.5e3 * LIFT, f"{1e3 * LIFT:g} mm", va="center")
    frequency = float(strip.angular_frequencies(1)[0]) / (2.0 * np.pi)
    section = f"{1e3 * strip.mean('width'):g} mm × {t:g} mm × {length:.0f} mm"
    axes.set(
        title=f"steel strip {section}, lowest frequency {frequency:.0f} Hz", aspect="equal",
        xlabel="place  x  [mm]", xlim=(-30.0, length + 45.0),
        ylabel="height  [mm]", ylim=(-20.0, 62.0),
    )  # fmt: skip
    axes.legend(loc="upper left", bbox_to_anchor=(0.08, 1.0), frameon=False)


def _draw_contact_line(axes: Axes, run: Rolling) -> None:
    """Draw the hits of the nodes over time and place, with the first hit of each node on top."""
    pushes = run.impulses
    x = 1e3 * run.x
    time_span = run.landing[0] + run.period * np.array(SHOWN_LANDING)
    is_shown = (pushes.time > time_span[0]) & (pushes.time < time_span[1])
    time = pushes.time[is_shown]
    pair = pushes.pair[is_shown]
    apart = np.ptp(time_span) / 400.0  # more dots than that cannot be distinguished
    _, firsts = np.unique(np.stack([np.floor(time / apart), pair]), axis=1, return_index=True)
    direction, speed = run.front()
    words = "clamp → tip" if direction > 0.0 else "tip → clamp"
    size = f"{1e3 * run.lamina.mean('thickness'):g} mm × {1e3 * run.lamina.length:.0f} mm"
    sag = 1e3 * rigid_ground.sag(run.lamina, run.gravity)
    show(
        axes,
        line(1e3 * time[firsts], x[pair[firsts]], ".", color=style.SKY, markersize=2.5,
             label="node is pushed"),
        line(1e3 * run.contact_line, x, ".", color=style.BLACK, markersize=4.5,
             label="for the first time"),
        title=f"{size}, sag {sag:.0f} mm, lifted {1e3 * run.tip[0]:.0f} mm\n"
        f"{words}, {speed:.0f} m/s",
        xlabel="time after the release  t  [ms]", xlim=1e3 * time_span,
        ylabel="place  x  [mm]", ylim=(0.0, 1.03e3 * run.lamina.length),
        legend="upper left" if direction > 0.0 else "center right",
    )  # fmt: skip


def _draw_refinement(axes: Axes, study: RollingStudy) -> None:
    """Draw the total loss and the loss at impacts over the time step, for the damped strip."""
    from matplotlib.ticker import NullLocator

    damping_ratio = max(level["damping_ratio"] for level in study.refinement)
    lines = []
    for (law, colour), (n, (marker, _)) in product(LAW_COLOURS.items(), MARKERS.items()):
        levels = completed(study, law, damping_ratio, n)
        steps = [level["steps_per_period"] for level in levels]
        # a law's name stands once in the legend
        name = law if n == max(MARKERS) else "_nolegend_"
        look: dict[str, Any] = {
            "color": colour,
            "marker": marker,
            "markersize": 4.5,
            "linewidth": 0.9,
        }
        lines.append(line(steps, [level["impacts"] for level in levels], label=name, **look))
        lines.append(line(steps, [1.0 - level["left"] for level in levels], "--", **look))
    ticks = sorted({level["steps_per_period"] for level in study.refinement})
    meshes = ", ".join(f"{n} {sign}" for n, (_, sign) in MARKERS.items())
    show(
        axes, *lines, title=f"dashed: all, solid: at impacts\nelements: {meshes}",
        xlabel="time steps per lowest period  [–]", xscale="log",
        ylabel="share lost in half a period  [–]", ylim=(0.0, 1.05), legend="lower left",
    )  # fmt: skip
    axes.set_xticks(ticks, [f"{n}" for n in ticks])
    axes.xaxis.set_minor_locator(NullLocator())


def completed(
    study: RollingStudy, law: str, damping_ratio: float, elements: int
) -> Sequence[Mapping[str, Any]]:
    """Return the completed runs of a law, a damping and a mesh, by increasing steps."""
    entries = [
        level
        for level in study.refinement
        if (level["law"], level["damping_ratio"], level["elements"])
        == (law, damping_ratio, elements)
        and level["outcome"] == "completed"
    ]
    return sorted(entries, key=lambda level: level["steps_per_period"])


def _draw_heights(axes: Axes, study: RollingStudy) -> None:
    """Draw the direction of the contact line over the height of the tip, in sags of the strip."""
    runs = [*study.by_height.values(), study.stiff]
    ratio = [run.tip[0] / rigid_ground.sag(run.lamina, run.gravity) for run in runs]
    direction = [run.front()[0] for run in runs]
    show(
        axes,
        line(ratio[:-1], direction[:-1], "o-", color=style.BLUE, label="thin strip"),
        line(ratio[-1:], direction[-1:], "s", color=style.VERMILLION, label="stiff strip"),
        title="1: clamp → tip\n−1: tip → clamp",
        xlabel="height of the tip / sag  [–]", xscale="log",
        ylabel="rank correlation, place and time  [–]", ylim=(-1.15, 1.15), legend="center left",
    )  # fmt: skip


def _line(numbers: Numbers) -> str:
    """Return in words how the thin and the stiff strip land."""
    main = numbers.by_law[MAIN]
    stiff = numbers.stiff
    rolled = [
        run["height_mm"] / main["sag_mm"]
        for run in numbers.by_height_mm.values()
        if run["front_direction"] > FROM_CLAMP
    ]
    strip = f"{1e3 * main['strip']['thickness']:g} mm × {1e3 * main['strip']['length']:.0f} mm"
    reach = f"{min(rolled):.1f} to {max(rolled):.1f}" if rolled else "no"
    return (
        f"steel {strip} (sags by {main['sag_mm']:.0f} mm under its weight) lifted "
        f"{main['height_mm']:.0f} mm at the tip: rank correlation of place and time of contact "
        f"{main['front_direction']:+.2f}, {main['front_speed_m_s'] or float('inf'):.0f} m/s; so "
        f"for heights of {reach} sags; a stiff strip ({stiff['height_mm'] / stiff['sag_mm']:.0f} "
        f"sags) lands tip first ({stiff['front_direction']:+.2f})"
    )


def _dissipation(numbers: Numbers) -> str:
    """Return in words where the energy goes at the landing."""
    shares = numbers.by_law[MAIN]["shares_after_landing"]
    taken = [
        level["impacts"]
        for level in numbers.refinement
        if level["law"] == MAIN and level["outcome"] == "completed"
    ]
    return (
        f"{100 * shares['lost']:.0f} % are lost 2 % of the lowest period after landing: "
        f"{100 * shares['impacts']:.0f} % at impacts, {100 * shares['damping']:.0f} % to "
        "material damping of the waves that impacts make; over meshes and time steps, with and "
        f"without damping ({MAIN}), impacts take {100 * min(taken):.0f} to "
        f"{100 * max(taken):.0f} %"
    )


def _highest(numbers: Numbers, name: str) -> float:
    """Return the largest value of a number over the runs with each law."""
    return max(float(run[name]) for run in numbers.by_law.values())


ROLLING_STRIP = Piece(
    "6",
    "Lateral impact of a strip",
    "Above: the set-up of the second experiment. Below: the first one; a steel strip lies on "
    "rigid ground, is lifted by a force at its tip and let go. Strip and height are not told, "
    "and the ratio of the height to the sag under its own weight decides how it lands: a thin "
    "strip rolls down from the clamp, a stiff one (that of the second experiment, lowest "
    "period 50 ms) lands with its tip first. Energies and refinements are those of the thin strip. "
    "Nothing is printed of the strip: compared is what the text says.",
    measure_rolling,
    draw_rolling,
    (
        Statement(
            "a contact line that evolves from the clamped end to the free one", "sec. 2.3",
            _line,
            lambda n: [
                Criterion(
                    "rank correlation", n.by_law[MAIN]["front_direction"], ">", FROM_CLAMP
                )
            ],
        ),
        Statement(
            "total dissipation of the energy into the surface", "sec. 2.3",
            _dissipation,
            lambda n: [
                Criterion(
                    "lost", n.by_law[MAIN]["shares_after_landing"]["lost"], ">", NEARLY_ALL, "%"
                )
            ],
        ),
        Statement(
            "no snap-back or local lift-off", "sec. 2.3",
            lambda n: f"until {LONG:g} of the lowest period the tip rises again to at most "
            f"{100 * _highest(n, 'rebound_of_tip'):.1f} % of the height it fell from, any place of "
            f"the strip to {100 * _highest(n, 'lift_off'):.1f} % (three laws); the stiff strip's "
            f"tip to {100 * n.stiff['rebound_of_tip']:.0f} %",
            lambda n: [
                Criterion(
                    "highest rise of three laws", _highest(n, "lift_off"), "<", NO_REBOUND, "%"
                )
            ],
        ),
    ),
)  # fmt: skip

# -- Fig. 7: a strip whose tip falls on a block -------------------------------------------------

MUCH_SMALLER = 0.5
STRONGLY = 0.5
"""The contact dissipates strongly if it takes more than this share of the energy."""
EXTREMELY_SHORT = 0.01
"""A time below this share of the lowest period counts as extremely short."""
SHOWN_WAVE = 350.0
"""Time after the touch up to which the wave is drawn [µs]."""


def measure_struck(lab: Laboratory) -> Numbers:
    """Compute the second experiment, the fall of a strip with its tip on a block.

    Returns:
        The numbers of `TipBlock.numbers`; block: the computed signals.
    """
    block = struck_block(lab)
    return Numbers(block.numbers(), block=block)


def draw_struck(numbers: Numbers) -> Figure:
    """Draw strains and contact force: the signals, the first wave, its dispersion."""
    figure = style.canvas(8.6)
    block = numbers.block
    axes = figure.subplots(3, 2)
    for k in (0, 1):
        spring, free = (
            (1e3 * motion.time, 1e6 * motion.strain[k]) for motion in (block.spring, block.free)
        )
        before = 1e6 * block.static_strain[k]
        place = 1e3 * block.gauges[k]
        show(
            axes[k, 0],
            line(*spring, color=GAUGE_COLOURS[k]),
            line(*free, "--", color=style.BASE_COLOUR, label="no block"),
            title=f"[{k + 1}]  x = {place:.0f} mm, held up: ε = {before:.0f}·10⁻⁶", xmargin=0.0,
            xlabel="time after the touch  [ms]", ylabel="strain  ε  [10⁻⁶]", legend="best",
        )  # fmt: skip
    show(
        axes[2, 0],
        line(1e3 * block.spring.time, 1e-3 * block.force, color=style.BLACK, linewidth=0.9),
        title="[3]  block of finite stiffness", xmargin=0.0,
        xlabel="time after the touch  [ms]", ylabel="force  [kN]",
    )  # fmt: skip
    _draw_waves(axes[0, 1], block)
    _draw_dispersion(axes[1, 1], block)
    _draw_peak(axes[2, 1], block)
    return figure


def _draw_waves(axes: Axes, block: TipBlock) -> None:
    """Draw the strain that the block causes, with that of the exact beam without a clamp."""
    time = 1e6 * block.spring.time
    wave = 1e6 * block.wave(block.spring)
    exact = 1e6 * block.exact_wave()
    is_shown = (time > 0.0) & (time < SHOWN_WAVE)
    largest = 1.1 * float(np.abs(wave[:, is_shown]).max())
    distances = 1e3 * (block.lamina.length - block.gauges)
    show(
        axes,
        *(
            line(time, wave[k], color=GAUGE_COLOURS[k], label=f"[{k + 1}]  {x:.0f} mm from the tip")
            for k, x in enumerate(distances)
        ),
        line(time, exact[1], ":", color=style.BLACK, label="[2] exact, no clamp"),
        xlabel="time after the touch  [µs]", xlim=(0.0, SHOWN_WAVE),
        ylabel="strain by the block  [10⁻⁶]", ylim=(-largest, 1.9 * largest), legend="upper left",
    )  # fmt: skip


def _draw_dispersion(axes: Axes, block: TipBlock) -> None:
    """Draw frequency over arrival time at the second gauge, with the dispersion relation."""
    beam, (middle, frequency) = exact_beam(block.lamina), block.half_waves()
    distance = float(block.lamina.length - block.gauges[1])
    frequencies = np.geomspace(0.5 * frequency.min(), 1.3 * frequency.max(), 100)
    arrival = 1e6 * distance / beam.group_speed(frequencies)
    slower = 1e6 * distance / beam.timoshenko_group_speed(frequencies)
    rod = (
        1e6
        * distance
        / float(np.sqrt(block.lamina.mean("young_modulus") / block.lamina.mean("density")))
    )
    top = 2e-3 * float(frequencies.max())
    show(
        axes,
        line(arrival, 1e-3 * frequencies, color=style.BLACK, label="distance / $c_g$ (bending)"),
        line(slower, 1e-3 * frequencies, ":", color=style.BLACK, label="with shear (Timoshenko)"),
        line(
            [rod, rod], [0.0, top], "--", color=style.PURPLE,
            label="distance / $c_0$ (longitudinal)",
        ),
        line(1e6 * middle, 1e-3 * frequency, "o", color=GAUGE_COLOURS[1],
             label="half waves at [2]"),
        xlabel="arrival after the largest force  [µs]", xlim=(0.0, float(arrival.max())),
        ylabel="frequency  [kHz]", ylim=(0.0, top), legend="upper right",
    )  # fmt: skip


def _draw_peak(axes: Axes, block: TipBlock) -> None:
    """Draw the first peak of the force, and the impulse of the rigid block."""
    time = 1e6 * block.spring.time
    exact_time = np.linspace(0.0, 1e-4, 300)
    beam = exact_beam(block.lamina)
    exact = beam.spring_force(exact_time, block.speed, block.stiffness)
    _, end = block.peak()
    show(
        axes,
        line(time, 1e-3 * block.force, color=style.BLACK, label="force"),
        line(1e6 * exact_time, 1e-3 * exact, "--", color=style.ORANGE, label="exact"),
        title=f"[3]  peak of {1e6 * end:.0f} µs", ylabel="force  [kN]",
        xlabel="time after the touch  [µs]", xlim=(-10.0, 100.0),
    )  # fmt: skip
    right = axes.twinx()
    impulse = beam.rigid_impulse(exact_time, block.speed)
    show(
        right,
        line(1e6 * block.rigid.time, block.rigid.impulse, color=style.GREEN,
             label="impulse, rigid block"),
        line(1e6 * exact_time, impulse, "--", color=style.ORANGE),
        ylim=(0.0, 0.15),
    )  # fmt: skip
    right.set_ylabel("impulse  [N s]", color=style.GREEN)
    right.grid(visible=False)
    axes.axvspan(0.0, 1e6 * end, color="#eeeeee", zorder=0)
    axes.legend(handles=[*axes.lines, right.lines[0]], loc="upper right")


def _peak(numbers: Numbers) -> str:
    """Return duration and size of the force peak in words."""
    duration, blocks = numbers.peak_duration_us, numbers.duration_of_block_us
    soft = min(blocks, key=float)
    hard = max(blocks, key=float)
    return (
        f"{duration:.1f} µs (1/{1e3 * numbers.lowest_period_ms / duration:.0f} of the period) "
        f"and {1e-3 * numbers.peak_force_N:.1f} kN with a block of "
        f"{1e-6 * numbers.block_stiffness_N_m:.0f} N/µm, which is chosen for it; blocks of "
        f"{1e-6 * float(soft):g} to {1e-6 * float(hard):g} N/µm have {blocks[soft]:.0f} to "
        f"{blocks[hard]:.0f} µs"
    )


def _dissipated(numbers: Numbers) -> float:
    """Return the share of the energy that contact and material take [-]."""
    spring = numbers.spring
    return float(spring["lost_to_damping"] + spring["lost_at_impacts"])


STRUCK_TIP = Piece(
    "7",
    "Strain and contact force",
    "A steel strip, lowest period 50 ms, with its tip alone over a block, lifted by 50 mm and "
    "let go (without its weight, which moves the tip by 1 mm): strains near the clamp [1] and "
    "half-way [2], contact force [3], the wave that the block sends and its dispersion. Dotted: "
    "the dispersion with shear and rotary inertia (Timoshenko), which the computation leaves out. "
    "The stiffness of the block is chosen such that the exact beam has a peak of 30 µs. The "
    "paper's signals are not available; compared is what its text says of them.",
    measure_struck,
    draw_struck,
    (
        Statement(
            "a force peak of about 30 µs, extremely short beside the period of 50 ms", "sec. 2.3",
            _peak,
            lambda n: [
                Criterion("shortest", min(n.duration_of_block_us.values()),
                          "<", 1e6 * PEAK_DURATION, "µs"),
                Criterion("longest", max(n.duration_of_block_us.values()),
                          ">", 1e6 * PEAK_DURATION, "µs"),
                Criterion(
                    "longest over period",
                    max(n.duration_of_block_us.values())
                    / (1e3 * n.lowest_period_ms),
                    "<", EXTREMELY_SHORT, "%",
                ),
            ],
        ),
        Statement(
            "no snap-back in the time scope of the impact", "sec. 2.3",
            lambda n: f"the tip leaves the first peak at "
            f"{100 * n.restitution_after_peak:.1f} % of its speed before, without any "
            "restitution given",
            lambda n: [
                Criterion(
                    "speed after", abs(n.restitution_after_peak), "<", NO_REBOUND, "%"
                )
            ],
        ),
        Statement(
            "a snap-back in the ensuing oscillation cannot be excluded", "sec. 2.3",
            lambda n: "the last push comes after {last_push_ms:.1f} ms; then the first mode swings "
            "back at ".format(**n.spring)
            + f"{100 * n.spring['restitution_of_first_mode']:.0f} % of its speed",
            lambda n: [
                Criterion(
                    "swings back at", n.spring["restitution_of_first_mode"],
                    ">", NO_REBOUND, "%",
                )
            ],
        ),
        Statement(
            "strong energy dissipation during the contact", "sec. 2.3",
            lambda n: f"only {100 * _dissipated(n):.0f} % of the energy is dissipated "
            "within 8 ms, by the material; the first mode has "
            f"{100 * n.spring['first_mode_after']:.0f} % of the energy "
            f"({100 * n.spring['first_mode_before']:.0f} % before) and looks strongly "
            "damped, but the rest still waves; impacts on a rigid block with e = 0 take "
            f"{100 * n.rigid['lost_at_impacts']:.0f} %",
            lambda n: [Criterion("dissipated", _dissipated(n), ">", STRONGLY, "%")],
        ),
        Statement(
            "the strain wave decays with the distance from the impact", "sec. 2.3",
            lambda n: "exact, without a clamp: the peak alone sends {1:.0f} µm/m half-way, {0:.0f} "
            "µm/m to the clamp; computed half-way, before the clamp's answer: {2:.0f} µm/m; the "
            "slow part that the lasting contact sends does not decay".format(
                *(1e6 * strain for strain in n.peak_wave_strain_max_exact),
                1e6 * n.wave_strain_max[1],
            ),
            lambda n: [
                Criterion(
                    "at the clamp over half-way",
                    float(np.divide(*n.peak_wave_strain_max_exact)), "<", 1.0,
                )
            ],
        ),
        Statement(
            "the mean wave velocity is much smaller than the longitudinal one", "sec. 2.3",
            lambda n: f"{n.mean_wave_speed_m_s:.0f} m/s to the second gauge, "
            f"longitudinal {n.longitudinal_speed_m_s:.0f} m/s; shear and rotary inertia "
            "(Timoshenko), which are left out, would lower the group speeds by "
            f"{100 * min(n.timoshenko_lowers_by):.0f} to "
            f"{100 * max(n.timoshenko_lowers_by):.0f} % at "
            f"{1e-3 * min(n.half_wave_Hz):.0f} to "
            f"{1e-3 * max(n.half_wave_Hz):.0f} kHz",
            lambda n: [
                Criterion(
                    "ratio",
                    n.mean_wave_speed_m_s / n.longitudinal_speed_m_s,
                    "<", MUCH_SMALLER,
                )
            ],
        ),
    ),
)  # fmt: skip

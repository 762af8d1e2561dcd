"""Fig. 2a of the paper: frequency responses of each lamina alone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.cantilever import frequency_rise
from delam_fem.paper.claims import Claim, Piece, judged
from delam_fem.paper.figures.swept_sine import (
    BAND,
    SWEEP_SECONDS,
    peak_frequency,
    swept_case,
    swept_envelope,
    swept_extremes,
)
from delam_fem.paper.lab import Laboratory, motion_case
from delam_fem.results.dataset import Result
from delam_fem.results.style import (
    BASE_COLOUR,
    BLACK,
    BLUE,
    ORANGE,
    SKY,
    VERMILLION,
    WIDTH,
    legend_above,
    legend_outside,
)

LINEAR_STEPS = 250
"""Steps per period of the highest frequency; the resonances have more per period of theirs."""
LINEAR_PERIODS = 200
"""After each step of the linear stepped sine: e^(-2πD·200) = 4e-5 of a transient is left."""
PRINTED = {"thin": 1.47, "thick": 3.17}
"""Natural frequencies as the paper prints them [Hz]."""
PRINTED_DIGIT = 0.005
SWEEP_PEAK = (1.455, 1.465)
"""Where the swept sine of the thin lamina must peak to explain what is printed [Hz]."""
STATIONARY = 0.15
"""Shortfall up to which the peak of a swept sine counts as stationary [-]."""
LINEAR = 0.5
"""Rise of the frequency at large amplitudes, in damping ratios, up to which a resonance is linear:
its curve leans by less than a quarter of its width."""
SWEEPS = {
    "linear, up": ("linear", BAND), "linear, down": ("linear", BAND[::-1]),
    "logarithmic, up": ("logarithmic", BAND), "logarithmic, down": ("logarithmic", BAND[::-1]),
}  # fmt: skip
_STYLES = {
    "linear, up": (BLUE, "-"), "linear, down": (VERMILLION, "-"),
    "logarithmic, up": (SKY, "--"), "logarithmic, down": (ORANGE, "--"),
}  # fmt: skip
_ZOOM = 0.06
"""Half width of the close views, relative to the frequency."""


def stepped_frequencies(case: Case, step: float) -> FloatArray:
    """Return the frequencies of the linear stepped sine: even, and dense at the resonances."""
    even = np.arange(BAND[0], BAND[1] + 0.5 * step, step)
    near = [
        float(lam.angular_frequencies(1)[0])
        / (2.0 * math.pi)
        * (1.0 + np.linspace(-0.04, 0.04, 17))
        for lam in case.lamina
    ]
    frequencies: FloatArray = np.unique(np.round(np.concatenate([even, *near]), 5))
    return frequencies


def without_contact(lab: Laboratory) -> Piece:
    """Draw the linear responses: exact, by stepped sine, and by the 30-minute swept sines."""
    base = motion_case(3.25, lab.plan)
    f_step = stepped_frequencies(base, 2.0 * lab.plan.response_step)
    cases = [swept_case(how, ends, "none", LINEAR_STEPS) for how, ends in SWEEPS.values()]
    swept = dict(zip(SWEEPS, lab.motions(cases), strict=True))
    stepped = lab.sweep(
        {
            "name": "linear response",
            "set": {
                "contact": {"law": "none"},
                "time": {"steps_per_period": LINEAR_STEPS, "periods": LINEAR_PERIODS},
            },
            "axis": [{"key": "excitation.frequency", "values": f_step.tolist()}],
            "record": {"strobes": 0},
        }
    )
    amplitudes = stepped["tip_amplitude"].transpose("lamina", ...).to_numpy()
    figure = Figure(figsize=(WIDTH, 9.4), layout="constrained")
    panels = figure.subplots(3, 2)
    for i, lamina in enumerate(base.lamina):
        f1 = float(lamina.angular_frequencies(1)[0]) / (2.0 * math.pi)
        _record_panel(panels[2, i], swept["linear, up"], i)
        for row, panel in enumerate(panels[:2, i]):
            _linear_panel(panel, base, i, swept, (f_step, amplitudes[i]))
            panel.set(xlabel="frequency of the base [Hz]", ylabel="tip amplitude [mm]")
            if row == 0:
                panel.set(yscale="log", xlim=BAND, ylim=(1.0, 400.0))
                panel.set_title(f"{lamina.name} alone", loc="left")
            else:
                panel.set_xlim(f1 * (1.0 - _ZOOM), f1 * (1.0 + _ZOOM))
                panel.set_ylim(0.0)
                panel.axvline(f1, color=BLACK, linewidth=0.8)
                panel.axvline(PRINTED[lamina.name], color=BLACK, linewidth=0.8, linestyle=":")
                panel.set_title("lines: f₁ exact, dotted: as the paper prints it", loc="left")
    legend_outside(figure, panels[0, 0], 3)
    numbers = _linear_numbers(base, swept, f_step, amplitudes)
    caption = (
        "Each lamina alone: the exact cantilever, the computed stepped sine and the envelopes of "
        "30-minute swept sines (0.5 to 4 Hz); below the record of one of them. The paper's curves "
        "are not available; compared are the two natural frequencies that its text reads off them."
    )
    title = "Frequency responses without contact"
    claims = _linear_claims(numbers, base.lamina[0].length)
    return Piece("2a", title, caption, figure, numbers, claims)


def _linear_panel(
    panel: Axes,
    base: Case,
    i: int,
    swept: dict[str, Result],
    stepped: tuple[FloatArray, FloatArray],
) -> None:
    """Draw all linear responses of one lamina."""
    f = np.linspace(*BAND, 20001)
    panel.plot(
        f, 1e3 * base.linear_amplitude(i, f), color=BASE_COLOUR, linewidth=2.5, label="exact"
    )
    for name, result in swept.items():
        colour, line = _STYLES[name]
        f_swept, amplitude = swept_envelope(result)
        panel.plot(
            f_swept, 1e3 * amplitude[i], line, color=colour, linewidth=1.0, label=f"swept {name}"
        )
    panel.plot(stepped[0], 1e3 * stepped[1], "o", color=BLACK, markersize=2.5, label="stepped sine")


def _record_panel(panel: Axes, result: Result, i: int) -> None:
    """Draw the record of a swept sine, 30 minutes of oscillation, with its envelope."""
    time, (low, high) = swept_extremes(result)
    _, amplitude = swept_envelope(result)
    minutes = time / 60.0
    panel.fill_between(minutes, 1e3 * low[i], 1e3 * high[i], color=SKY, label="record")
    for sign in (1.0, -1.0):
        label = "envelope" if sign > 0.0 else None
        panel.plot(minutes, sign * 1e3 * amplitude[i], color=BLUE, linewidth=0.8, label=label)
    panel.set(xlabel="time [min]", ylabel="displacement of the tip [mm]")
    panel.set_xlim(0.0, SWEEP_SECONDS / 60.0)
    panel.set_title("swept linear, up", loc="left")
    legend_above(panel)


def _linear_numbers(
    base: Case, swept: dict[str, Result], f: FloatArray, stepped: FloatArray
) -> dict[str, Any]:
    f1 = [float(lam.angular_frequencies(1)[0]) / (2.0 * math.pi) for lam in base.lamina]
    exact = np.stack([base.linear_amplitude(i, f) for i in range(2)])
    fine = np.linspace(*BAND, 200001)
    top = [base.linear_amplitude(i, fine) for i in range(2)]
    return {
        "natural_frequency_hz": f1,
        "exact_peak_hz": [float(fine[a.argmax()]) for a in top],
        "exact_peak_m": [float(a.max()) for a in top],
        "frequency_rise_at_peak": [
            frequency_rise(float(a.max()) / lam.length)
            for a, lam in zip(top, base.lamina, strict=True)
        ],
        "damping_ratio": [lam.damping_ratio for lam in base.lamina],
        "sweep_peak_hz": {
            name: [peak_frequency(result, i) for i in range(2)] for name, result in swept.items()
        },
        "sweep_peak_m": {
            name: swept_envelope(result)[1].max(axis=1) for name, result in swept.items()
        },
        "stepped_frequency_hz": f,
        "stepped_amplitude_m": stepped,
        "stepped_over_exact": stepped / exact,
        "largest_deviation_of_stepped": float(np.abs(stepped / exact - 1.0).max()),
    }


def _linear_claims(numbers: dict[str, Any], length: float) -> tuple[Claim, ...]:
    thick, thin = numbers["natural_frequency_hz"]
    up, down = (numbers["sweep_peak_hz"][f"linear, {way}"] for way in ("up", "down"))
    rise, damping = numbers["frequency_rise_at_peak"], min(numbers["damping_ratio"])
    top, swept = numbers["exact_peak_m"], numbers["sweep_peak_m"]["linear, up"]
    return (
        Claim(
            "2a", "lowest natural frequencies 1.47 Hz and 3.17 Hz", "sec. 2.2",
            f"exact {thin:.4f} Hz (thin) and {thick:.4f} Hz (thick): "
            f"{100 * (thin / 1.47 - 1):+.1f} % and {100 * (thick / 3.17 - 1):+.1f} %",
            judged(abs(thin - 1.47) < PRINTED_DIGIT and abs(thick - 3.17) < PRINTED_DIGIT), True,
        ),
        Claim(
            "2a", "read off a 30-minute swept sine", "sec. 2.2",
            f"linear up-sweep peaks at {up[1]:.3f} Hz (thin) and {up[0]:.3f} Hz (thick), "
            f"down-sweep at {down[1]:.3f} and {down[0]:.3f} Hz: that explains most of "
            "the 1.47",
            judged(SWEEP_PEAK[0] <= up[1] <= SWEEP_PEAK[1]), True,
        ),
        Claim(
            "2a", "the duration of 30 min ensures a sufficiently stationary response", "sec. 2.2",
            f"swept peaks are {100 * swept[1] / top[1]:.0f} % (thin) and "
            f"{100 * swept[0] / top[0]:.0f} % (thick) of the stationary ones, displaced by "
            f"{1e3 * (up[1] - thin):+.0f} and {1e3 * (up[0] - thick):+.0f} mHz",
            judged(float(np.min(np.divide(swept, top))) > 1.0 - STATIONARY),
        ),
        Claim(
            "2a", "linear behaviour with large amplitudes at resonance", "sec. 2.2",
            f"stationary tip amplitudes of linear theory: {1e3 * top[0]:.0f} mm (thick) and "
            f"{1e3 * top[1]:.0f} mm (thin), {100 * max(top) / length:.0f} % of the length; the "
            f"lowest frequency of a beam that keeps its length is there {100 * max(rise):.2f} % "
            f"higher, little beside half the width of the resonance, D = {100 * damping:.1f} %",
            judged(max(rise) < LINEAR * damping),
        ),
    )  # fmt: skip

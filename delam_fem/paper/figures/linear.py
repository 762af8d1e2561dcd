"""Fig. 2a of the paper: frequency responses of each lamina alone, without contact."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.sections import Lamina
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.beams import frequency_rise
from delam_fem.paper.claims import NOT_IN_JSON, Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import (
    BAND,
    RESONANT,
    SWEEP_SECONDS,
    Laboratory,
    motion_case,
    peak_frequency,
    swept_case,
    swept_envelope,
    swept_extremes,
)
from delam_fem.results.figures.style import (
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

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINEAR_STEPS = 250
"""Steps per period of the highest frequency; the periods of the resonances have more steps."""
LINEAR_PERIODS = 200
"""Periods at each frequency of the linear stepped sine; e^(-2πD·200) = 4e-5 of a transient is
left."""
PRINTED = {"thin": 1.47, "thick": 3.17}
"""Natural frequencies as printed in the paper [Hz]."""
PRINTED_DIGIT = 0.005
SWEEP_PEAK = (1.455, 1.465)
"""Range in which the swept sine of the thin lamina must peak to explain the printed value [Hz]."""
STATIONARY = 0.15
"""Shortfall up to which the peak of a swept sine counts as stationary [-]."""
LINEAR = 0.5
"""A resonance counts as linear if its frequency rises by at most this number of damping ratios at
large amplitudes; its curve then leans by less than a quarter of its width."""
SWEEPS = {
    "linear, up": ("linear", BAND), "linear, down": ("linear", BAND[::-1]),
    "logarithmic, up": ("logarithmic", BAND), "logarithmic, down": ("logarithmic", BAND[::-1]),
}  # fmt: skip
_STYLES = {
    "linear, up": (BLUE, "-"), "linear, down": (VERMILLION, "-"),
    "logarithmic, up": (SKY, "--"), "logarithmic, down": (ORANGE, "--"),
}  # fmt: skip
_ZOOM = 0.06
"""Half width of the close views, relative to the natural frequency."""


def stepped_frequencies(case: Case, step: float) -> FloatArray:
    """Return the frequencies of the linear stepped sine, evenly spaced but denser at resonances."""
    even = np.arange(BAND[0], BAND[1] + 0.5 * step, step)
    near = [_lowest_frequency(lam) * (1.0 + np.linspace(-0.04, 0.04, 17)) for lam in case.lamina]
    frequencies: FloatArray = np.unique(np.round(np.concatenate([even, *near]), 5))
    return frequencies


@dataclass(frozen=True)
class WithoutContact(Numbers):
    """Linear responses of the thick and the thin lamina, exact and computed.

    Attributes:
        natural_frequency_hz: exact lowest natural frequencies.
        exact_peak_hz, exact_peak_m: frequency and size of the largest exact responses.
        frequency_rise_at_peak: relative rise of the lowest frequency at this amplitude, for a beam
            that keeps its length [-].
        damping_ratio: D [-].
        sweep_peak_hz, sweep_peak_m: frequency and size of the largest responses of the swept sines,
            by name of the sweep.
        stepped_frequency_hz: frequencies of the stepped sine, shape (n,).
        stepped_amplitude_m: tip amplitudes of the stepped sine, shape (2, n).
        stepped_over_exact: tip amplitudes of the stepped sine over the exact ones, shape (2, n)
            [-].
        largest_deviation_of_stepped: largest relative deviation from the exact amplitude [-].
        case: case with these laminae.
        envelopes: frequencies, shape (n,) [Hz], and amplitudes, shape (2, n) [m], of the swept
            sines, by name of the sweep.
        record: times, shape (n,) [s], and extremes, shape (2, 2, n) [m], of the linear up-sweep.
    """

    natural_frequency_hz: list[float]
    exact_peak_hz: list[float]
    exact_peak_m: list[float]
    frequency_rise_at_peak: list[float]
    damping_ratio: list[float]
    sweep_peak_hz: dict[str, list[float]]
    sweep_peak_m: dict[str, FloatArray]
    stepped_frequency_hz: FloatArray
    stepped_amplitude_m: FloatArray
    stepped_over_exact: FloatArray
    largest_deviation_of_stepped: float
    case: Case = field(metadata=NOT_IN_JSON)
    envelopes: dict[str, tuple[FloatArray, FloatArray]] = field(metadata=NOT_IN_JSON)
    record: tuple[FloatArray, FloatArray] = field(metadata=NOT_IN_JSON)


def measure(lab: Laboratory) -> WithoutContact:
    """Compute the linear responses: exact, by stepped sine, and by the 30-minute swept sines."""
    case = motion_case(RESONANT, lab.plan)
    cases = [swept_case(how, ends, "none", LINEAR_STEPS) for how, ends in SWEEPS.values()]
    swept = dict(zip(SWEEPS, lab.motions(cases), strict=True))
    f, stepped = _stepped_sine(lab, case)
    exact = np.stack([case.linear_amplitude(i, f) for i in range(2)])
    fine = np.linspace(*BAND, 200001)
    top = [case.linear_amplitude(i, fine) for i in range(2)]
    envelopes = {name: swept_envelope(result) for name, result in swept.items()}
    return WithoutContact(
        natural_frequency_hz=[_lowest_frequency(lam) for lam in case.lamina],
        exact_peak_hz=[float(fine[a.argmax()]) for a in top],
        exact_peak_m=[float(a.max()) for a in top],
        frequency_rise_at_peak=[
            frequency_rise(float(a.max()) / lam.length)
            for a, lam in zip(top, case.lamina, strict=True)
        ],
        damping_ratio=[lam.damping_ratio for lam in case.lamina],
        sweep_peak_hz={
            name: [peak_frequency(result, i) for i in range(2)] for name, result in swept.items()
        },
        sweep_peak_m={name: np.nanmax(a, axis=1) for name, (_, a) in envelopes.items()},
        stepped_frequency_hz=f,
        stepped_amplitude_m=stepped,
        stepped_over_exact=stepped / exact,
        largest_deviation_of_stepped=float(np.abs(stepped / exact - 1.0).max()),
        case=case,
        envelopes=envelopes,
        record=swept_extremes(swept["linear, up"]),
    )


def _stepped_sine(lab: Laboratory, case: Case) -> tuple[FloatArray, FloatArray]:
    """Compute the stepped sine: frequencies, (n,) [Hz], and amplitudes of the tips, (2, n) [m]."""
    frequencies = stepped_frequencies(case, 2.0 * lab.plan.response_step)
    data = lab.sweep(
        {
            "name": "linear response",
            "set": {
                "contact": {"law": "none"},
                "time": {"steps_per_period": LINEAR_STEPS, "periods": LINEAR_PERIODS},
            },
            "axis": [{"key": "excitation.frequency", "values": frequencies.tolist()}],
            "record": {"strobes": 0},
        }
    )
    return frequencies, data["tip_amplitude"].transpose("lamina", ...).to_numpy()


def _lowest_frequency(lamina: Lamina) -> float:
    """Return the exact lowest natural frequency of a lamina [Hz]."""
    return float(lamina.angular_frequencies(1)[0]) / (2.0 * math.pi)


def draw(numbers: WithoutContact) -> Figure:
    """Draw the responses of both laminae, close views of the resonances, and a record."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 9.4), layout="constrained")
    panels = figure.subplots(3, 2)
    for i, lamina in enumerate(numbers.case.lamina):
        f1 = numbers.natural_frequency_hz[i]
        _record_panel(panels[2, i], numbers, i)
        for row, panel in enumerate(panels[:2, i]):
            _linear_panel(panel, numbers, i)
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
    return figure


def _linear_panel(panel: Axes, numbers: WithoutContact, i: int) -> None:
    """Draw all linear responses of one lamina."""
    f = np.linspace(*BAND, 20001)
    exact = 1e3 * numbers.case.linear_amplitude(i, f)
    panel.plot(f, exact, color=BASE_COLOUR, linewidth=2.5, label="exact")
    for name, (f_swept, amplitude) in numbers.envelopes.items():
        colour, line = _STYLES[name]
        panel.plot(
            f_swept, 1e3 * amplitude[i], line, color=colour, linewidth=1.0, label=f"swept {name}"
        )
    panel.plot(
        numbers.stepped_frequency_hz, 1e3 * numbers.stepped_amplitude_m[i],
        "o", color=BLACK, markersize=2.5, label="stepped sine",
    )  # fmt: skip


def _record_panel(panel: Axes, numbers: WithoutContact, i: int) -> None:
    """Draw the record of a swept sine, 30 minutes of oscillation, with its envelope."""
    time, (low, high) = numbers.record
    _, amplitude = numbers.envelopes["linear, up"]
    minutes = time / 60.0
    panel.fill_between(minutes, 1e3 * low[i], 1e3 * high[i], color=SKY, label="record")
    for sign in (1.0, -1.0):
        label = "envelope" if sign > 0.0 else None
        panel.plot(minutes, sign * 1e3 * amplitude[i], color=BLUE, linewidth=0.8, label=label)
    panel.set(xlabel="time [min]", ylabel="displacement of the tip [mm]")
    panel.set_xlim(0.0, SWEEP_SECONDS / 60.0)
    panel.set_title("swept linear, up", loc="left")
    legend_above(panel)


def judge(numbers: WithoutContact) -> tuple[Claim, ...]:
    """Judge the natural frequencies that the paper prints, and the effect of its swept sine."""
    return *_claims_on_frequencies(numbers), *_claims_on_amplitudes(numbers)


def _claims_on_frequencies(numbers: WithoutContact) -> tuple[Claim, Claim]:
    """Judge the natural frequencies, as they are and as a swept sine shows them."""
    thick, thin = numbers.natural_frequency_hz
    up, down = (numbers.sweep_peak_hz[f"linear, {way}"] for way in ("up", "down"))
    per_cycle = (BAND[1] - BAND[0]) / SWEEP_SECONDS / up[1]
    one_cycle = (up[1] - 0.5 * per_cycle, up[1] + 0.5 * per_cycle)
    return (
        Claim(
            "2a", "lowest natural frequencies 1.47 Hz and 3.17 Hz", "sec. 2.2",
            f"exact {thin:.4f} Hz (thin) and {thick:.4f} Hz (thick): "
            f"{100 * (thin / 1.47 - 1):+.1f} % and {100 * (thick / 3.17 - 1):+.1f} %",
            *judged(
                Criterion("thin: away by", abs(thin - 1.47), "<", PRINTED_DIGIT, "Hz"),
                Criterion("thick: away by", abs(thick - 3.17), "<", PRINTED_DIGIT, "Hz"),
            ),
        ),
        Claim(
            "2a", "read off a 30-minute swept sine", "sec. 2.2",
            f"linear up-sweep peaks at {up[1]:.3f} Hz (thin) and {up[0]:.3f} Hz (thick), "
            f"down-sweep at {down[1]:.3f} and {down[0]:.3f} Hz: that explains most of "
            "the 1.47",
            *judged(
                Criterion("thin peak", up[1], ">", SWEEP_PEAK[0], "Hz", one_cycle),
                Criterion("thin peak", up[1], "<", SWEEP_PEAK[1], "Hz", one_cycle),
            ),
        ),
    )  # fmt: skip


def _claims_on_amplitudes(numbers: WithoutContact) -> tuple[Claim, Claim]:
    """Judge whether the swept sine is slow enough, and whether the laminae stay linear."""
    (thick, thin), up = numbers.natural_frequency_hz, numbers.sweep_peak_hz["linear, up"]
    rise, damping = numbers.frequency_rise_at_peak, min(numbers.damping_ratio)
    top, swept = numbers.exact_peak_m, numbers.sweep_peak_m["linear, up"]
    length = numbers.case.lamina[0].length
    smaller = float(np.min(np.divide(swept, top)))
    return (
        Claim(
            "2a", "the duration of 30 min ensures a sufficiently stationary response", "sec. 2.2",
            f"swept peaks are {100 * swept[1] / top[1]:.0f} % (thin) and "
            f"{100 * swept[0] / top[0]:.0f} % (thick) of the stationary ones, displaced by "
            f"{1e3 * (up[1] - thin):+.0f} and {1e3 * (up[0] - thick):+.0f} mHz",
            *judged(
                Criterion("smaller ratio", smaller, ">", 1.0 - STATIONARY, "%")
            ),
        ),
        Claim(
            "2a", "linear behaviour with large amplitudes at resonance", "sec. 2.2",
            f"stationary tip amplitudes of linear theory: {1e3 * top[0]:.0f} mm (thick) and "
            f"{1e3 * top[1]:.0f} mm (thin), {100 * max(top) / length:.0f} % of the length; the "
            f"lowest frequency of a beam that keeps its length is there {100 * max(rise):.2f} % "
            f"higher, little beside half the width of the resonance, D = {100 * damping:.1f} %",
            *judged(Criterion("rise over D", max(rise) / damping, "<", LINEAR)),
        ),
    )  # fmt: skip


WITHOUT_CONTACT = Piece(
    "2a",
    "Frequency responses without contact",
    "Each lamina alone: the exact cantilever, the computed stepped sine and the envelopes of "
    "30-minute swept sines (0.5 to 4 Hz) without the transient of their first minute; below the "
    "record of one of them. The paper's curves "
    "are not available; compared are the two natural frequencies that its text reads off them.",
    measure,
    draw,
    judge,
)

"""Frequency responses: Fig. 2a (each lamina alone) and 2b (with contact, up and down)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.api import BoolArray, Case, FloatArray, Lamina, beams, style
from delam_fem.paper.claims import Criterion, Numbers, Piece, Statement, between
from delam_fem.paper.panels import Line, line, show
from delam_fem.paper.runs import (
    BAND,
    FREQUENCIES,
    RESONANT,
    SWEEP_SECONDS,
    Laboratory,
    motion_case,
    peak_frequencies,
    swept_case,
    swept_envelope,
    swept_extremes,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

# -- Fig. 2a: without contact -----------------------------------------------------------------

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
"""Shortfall of the peak of a swept sine up to which the response counts as stationary [-]."""
LINEAR = 0.5
"""A resonance counts as linear if its frequency rises by at most this number of damping ratios at
large amplitudes; its curve then leans by less than a quarter of its width."""
SWEEPS = {
    "linear, up": ("linear", BAND), "linear, down": ("linear", BAND[::-1]),
    "logarithmic, up": ("logarithmic", BAND), "logarithmic, down": ("logarithmic", BAND[::-1]),
}  # fmt: skip
_STYLES: dict[str, dict[str, Any]] = {
    "linear, up": {"color": style.BLUE}, "linear, down": {"color": style.VERMILLION},
    "logarithmic, up": {"color": style.SKY, "line_style": "--"},
    "logarithmic, down": {"color": style.ORANGE, "line_style": "--"},
}  # fmt: skip
LABELS = {"xlabel": "frequency of the base [Hz]", "ylabel": "tip amplitude [mm]"}
_ZOOM = 0.06
"""Half width of the close views, relative to the natural frequency."""


def measure_linear(lab: Laboratory) -> Numbers:
    """Compute the linear responses: exact, by stepped sine, and by the 30-minute swept sines.

    Returns:
        natural_frequency_hz: exact lowest natural frequencies; exact_peak_hz, exact_peak_m:
        frequency and size of the largest exact responses; frequency_rise_at_peak: relative rise of
        the lowest frequency at this amplitude, for a beam that keeps its length [-]; damping_ratio:
        D [-]; sweep_peak_hz, sweep_peak_m: frequency and size of the largest responses of the swept
        sines, by name of the sweep; stepped_frequency_hz: frequencies of the stepped sine, shape
        (n,); stepped_amplitude_m: tip amplitudes of the stepped sine, shape (2, n);
        stepped_over_exact: the same over the exact ones, shape (2, n) [-];
        largest_deviation_of_stepped: largest relative deviation from the exact amplitude [-];
        case: case with these laminae; envelopes: frequencies, shape (n,) [Hz], and amplitudes,
        shape (2, n) [m], of the swept sines, by name of the sweep; record: times, shape (n,) [s],
        and extremes, shape (2, 2, n) [m], of the linear up-sweep.
    """
    case = motion_case(RESONANT, lab.plan)
    cases = [swept_case(how, ends, "none", LINEAR_STEPS) for how, ends in SWEEPS.values()]
    swept = dict(zip(SWEEPS, lab.motions(cases), strict=True))
    f, stepped = _linear_sine(lab, case)
    over_exact = stepped / np.stack([case.linear_amplitude(i, f) for i in range(2)])
    fine = np.linspace(*BAND, 200001)
    top = [case.linear_amplitude(i, fine) for i in range(2)]
    envelopes = {name: swept_envelope(result) for name, result in swept.items()}
    return Numbers(
        {
            "natural_frequency_hz": [_lowest_frequency(lam) for lam in case.lamina],
            "exact_peak_hz": [float(fine[a.argmax()]) for a in top],
            "exact_peak_m": [float(a.max()) for a in top],
            "frequency_rise_at_peak": [
                beams.frequency_rise(float(a.max()) / lam.length)
                for a, lam in zip(top, case.lamina, strict=True)
            ],
            "damping_ratio": [lam.damping_ratio for lam in case.lamina],
            "sweep_peak_hz": {
                name: peak_frequencies(*envelope) for name, envelope in envelopes.items()
            },
            "sweep_peak_m": {name: np.nanmax(a, axis=1) for name, (_, a) in envelopes.items()},
            "stepped_frequency_hz": f,
            "stepped_amplitude_m": stepped,
            "stepped_over_exact": over_exact,
            "largest_deviation_of_stepped": float(np.abs(over_exact - 1.0).max()),
        },
        case=case,
        envelopes=envelopes,
        record=swept_extremes(swept["linear, up"]),
    )


def _linear_sine(lab: Laboratory, case: Case) -> tuple[FloatArray, FloatArray]:
    """Compute the stepped sine at frequencies that are denser at the resonances.

    Returns:
        Frequencies, shape (n,) [Hz]; amplitudes of the tips, shape (2, n) [m].
    """
    step = 2.0 * lab.plan.response_step
    even = np.arange(BAND[0], BAND[1] + 0.5 * step, step)
    near = [_lowest_frequency(lam) * (1.0 + np.linspace(-0.04, 0.04, 17)) for lam in case.lamina]
    frequencies = np.unique(np.round(np.concatenate([even, *near]), 5))
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


def draw_linear(numbers: Numbers) -> Figure:
    """Draw the responses of both laminae, close views of the resonances, and a record."""
    figure = style.canvas(9.4)
    panels = figure.subplots(3, 2)
    for i, lamina in enumerate(numbers.case.lamina):
        f1 = numbers.natural_frequency_hz[i]
        overview, close, record = panels[:, i]
        show(
            overview, *_linear_lines(numbers, i), **LABELS,
            title=f"{lamina.name} alone", yscale="log", xlim=BAND, ylim=(1.0, 400.0),
        )  # fmt: skip
        show(
            close, *_linear_lines(numbers, i), **LABELS,
            title="lines: f₁ exact, dotted: as the paper prints it",
            xlim=(f1 * (1.0 - _ZOOM), f1 * (1.0 + _ZOOM)), ylim=(0.0, None),
        )  # fmt: skip
        close.axvline(f1, color=style.BLACK, linewidth=0.8)
        close.axvline(PRINTED[lamina.name], color=style.BLACK, linewidth=0.8, linestyle=":")
        time, (low, high) = numbers.record
        minutes = time / 60.0
        envelope = 1e3 * numbers.envelopes["linear, up"][1][i]
        record.fill_between(minutes, 1e3 * low[i], 1e3 * high[i], color=style.SKY, label="record")
        show(
            record,
            line(minutes, envelope, color=style.BLUE, linewidth=0.8, label="envelope"),
            line(minutes, -envelope, color=style.BLUE, linewidth=0.8),
            title="swept linear, up", xlabel="time [min]", xlim=(0.0, SWEEP_SECONDS / 60.0),
            ylabel="displacement of the tip [mm]", legend="above",
        )  # fmt: skip
    style.legend_outside(figure, panels[0, 0], 3)
    return figure


def _linear_lines(numbers: Numbers, i: int) -> Iterator[Line]:
    """Yield all linear responses of one lamina."""
    f = np.linspace(*BAND, 20001)
    yield line(
        f, 1e3 * numbers.case.linear_amplitude(i, f),
        color=style.BASE_COLOUR, linewidth=2.5, label="exact",
    )  # fmt: skip
    for name, (f_swept, amplitude) in numbers.envelopes.items():
        look = _STYLES[name] | {"linewidth": 1.0, "label": f"swept {name}"}
        yield line(f_swept, 1e3 * amplitude[i], **look)
    yield line(
        numbers.stepped_frequency_hz, 1e3 * numbers.stepped_amplitude_m[i],
        "o", color=style.BLACK, markersize=2.5, label="stepped sine",
    )  # fmt: skip


def _one_cycle(peak: float) -> tuple[float, float]:
    """Return the range of a peak's frequency that one cycle of the swept sine leaves open [Hz]."""
    half = 0.5 * ((BAND[1] - BAND[0]) / SWEEP_SECONDS / peak)
    return peak - half, peak + half


WITHOUT_CONTACT = Piece(
    "2a",
    "Frequency responses without contact",
    "Each lamina alone: the exact cantilever, the computed stepped sine and the envelopes of "
    "30-minute swept sines (0.5 to 4 Hz) without the transient of their first minute; below the "
    "record of one of them. The paper's curves "
    "are not available; compared are the two natural frequencies that its text reads off them.",
    measure_linear,
    draw_linear,
    (
        Statement(
            "lowest natural frequencies 1.47 Hz and 3.17 Hz", "sec. 2.2",
            lambda n: "exact {1:.4f} Hz (thin) and {0:.4f} Hz (thick): ".format(
                *n.natural_frequency_hz
            )
            + f"{100 * (n.natural_frequency_hz[1] / 1.47 - 1):+.1f} % and "
            f"{100 * (n.natural_frequency_hz[0] / 3.17 - 1):+.1f} %",
            lambda n: [
                Criterion(
                    f"{name}: away by", abs(n.natural_frequency_hz[i] - PRINTED[name]),
                    "<", PRINTED_DIGIT, "Hz",
                )
                for i, name in ((1, "thin"), (0, "thick"))
            ],
        ),
        Statement(
            "read off a 30-minute swept sine", "sec. 2.2",
            lambda n: "linear up-sweep peaks at {1:.3f} Hz (thin) and {0:.3f} Hz (thick), "
            "down-sweep at {3:.3f} and {2:.3f} Hz: that explains most of the 1.47".format(
                *n.sweep_peak_hz["linear, up"], *n.sweep_peak_hz["linear, down"]
            ),
            lambda n: between(
                "thin peak", n.sweep_peak_hz["linear, up"][1], SWEEP_PEAK, "Hz",
                _one_cycle(n.sweep_peak_hz["linear, up"][1]),
            ),
        ),
        Statement(
            "the duration of 30 min ensures a sufficiently stationary response", "sec. 2.2",
            lambda n: "swept peaks are {1:.0f} % (thin) and {0:.0f} % (thick) of the stationary "
            "ones, displaced by {3:+.0f} and {2:+.0f} mHz".format(
                *100 * np.divide(n.sweep_peak_m["linear, up"], n.exact_peak_m),
                *1e3 * np.subtract(n.sweep_peak_hz["linear, up"], n.natural_frequency_hz),
            ),
            lambda n: [
                Criterion(
                    "smaller ratio",
                    float(np.min(np.divide(n.sweep_peak_m["linear, up"], n.exact_peak_m))),
                    ">", 1.0 - STATIONARY, "%",
                )
            ],
        ),
        Statement(
            "linear behaviour with large amplitudes at resonance", "sec. 2.2",
            lambda n: "stationary tip amplitudes of linear theory: {:.0f} mm (thick) and "
            "{:.0f} mm (thin), {:.0f} % of the length; the lowest frequency of a beam that keeps "
            "its length is there {:.2f} % higher, little beside half the width of the resonance, "
            "D = {:.1f} %".format(
                *(1e3 * top for top in n.exact_peak_m),
                100 * max(n.exact_peak_m) / n.case.lamina[0].length,
                100 * max(n.frequency_rise_at_peak), 100 * min(n.damping_ratio),
            ),
            lambda n: [
                Criterion(
                    "rise over D", max(n.frequency_rise_at_peak) / min(n.damping_ratio),
                    "<", LINEAR,
                )
            ],
        ),
    ),
)  # fmt: skip

# -- Fig. 2b: with contact --------------------------------------------------------------------

WAYS = {"up": BAND, "down": BAND[::-1]}
"""First and last frequency of the swept sines, by direction [Hz]."""
CONTACT_STEPS = 1000
"""Steps per period of the highest frequency of a swept sine."""
DIFFERS = 0.15
"""Amplitudes with a larger relative difference belong to different motions."""
MANY = 3
"""A bifurcation scenario has at least this number of different periodicities, and of different
numbers of contacts in two periods."""
UNDECIDED = -1.0
"""Value in place of a periodicity that is undecided, because the scatter is near the threshold."""
JUMP = 3.0
"""A jump of the amplitude is this factor larger than the changes beside it."""


def measure_contact(lab: Laboratory) -> Numbers:
    """Compute the responses with contact, up and down, and the paper's four points.

    Returns:
        frequency_hz: frequencies of the stepped sine, shape (n,); amplitude_up_m, amplitude_down_m:
        half peak-to-peak of the tips, shape (2, n); periodicity_up, periodicity_down: periodicity,
        NaN if the motion has none, `UNDECIDED` if it is undecided or not settled, shape (n,);
        tip_contacts_per_period: up and down, shape (2, n); hysteresis_hz: frequencies at which up
        and down differ; jumps_up_hz, jumps_down_hz: frequencies at which the amplitude of each tip
        jumps; largest_amplitude_m, largest_amplitude_at_hz: largest amplitude of each tip, and its
        frequency; largest_swept_amplitude_m: largest amplitude of each tip, by direction of the
        swept sine; linear_peak_m: largest amplitude of each lamina alone; case: case with these
        laminae; envelopes: frequencies, shape (n,) [Hz], and amplitudes, shape (2, n) [m], of the
        swept sines, up and down; marked_m: amplitude of both tips at the paper's four excitations,
        from rest, shape (4, 2).
    """
    case = motion_case(RESONANT, lab.plan)
    data = _contact_sine(lab).transpose("lamina", "direction", "frequency", ...)
    cases = [swept_case("linear", ends, case.contact.law, CONTACT_STEPS) for ends in WAYS.values()]
    envelopes = dict(zip(WAYS, map(swept_envelope, lab.motions(cases)), strict=True))
    marked = lab.motions([motion_case(f, lab.plan) for f in FREQUENCIES])
    f = data["frequency"].to_numpy()
    amplitude = data["tip_amplitude"].to_numpy()
    up, down = amplitude[:, 0], amplitude[:, 1]
    is_known = (data["is_decided"] != 0.0) & (data["settled"] != 0.0)
    periodicity = data["periodicity"].where(is_known, UNDECIDED).to_numpy()
    linear = np.stack([case.linear_amplitude(i, np.linspace(*BAND, 50001)) for i in range(2)])
    return Numbers(
        {
            "frequency_hz": f,
            "amplitude_up_m": up,
            "amplitude_down_m": down,
            "periodicity_up": periodicity[0],
            "periodicity_down": periodicity[1],
            "tip_contacts_per_period": data["tip_contacts_per_period"].to_numpy(),
            "hysteresis_hz": f[_differ(up, down).any(axis=0)],
            "jumps_up_hz": [jumps(f, up[i]) for i in range(2)],
            "jumps_down_hz": [jumps(f, down[i]) for i in range(2)],
            "largest_amplitude_m": np.nanmax(amplitude, axis=(1, 2)),
            "largest_amplitude_at_hz": [
                float(f[np.nanmax(amplitude[i], axis=0).argmax()]) for i in range(2)
            ],
            "largest_swept_amplitude_m": {
                way: np.nanmax(a, axis=1) for way, (_, a) in envelopes.items()
            },
            "linear_peak_m": linear.max(axis=1),
        },
        case=case,
        envelopes=envelopes,
        marked_m=np.array([result.summary["tip_amplitude"] for result in marked]),
    )


def _contact_sine(lab: Laboratory) -> xr.Dataset:
    """Compute the stepped sine up and down; each frequency continues from the one before."""
    step = lab.plan.response_step
    values = np.round(np.arange(BAND[0], BAND[1] + 0.5 * step, step), 6)
    return lab.sweep(
        {
            "name": "response",
            "order": "both",
            "set": {"time": {"periods": lab.plan.response_periods}},
            "axis": [{"key": "excitation.frequency", "values": values.tolist()}],
            "record": {"strobes": 40},
        }
    )


def _differ(up: FloatArray, down: FloatArray) -> BoolArray:
    """Return where the amplitudes up and down belong to different motions, same shape as `up`."""
    return np.asarray(np.abs(up - down) > DIFFERS * np.maximum(up, down))


def draw_contact(numbers: Numbers) -> Figure:
    """Draw the responses with contact, up and down, with the paper's four points."""
    figure = style.canvas(5.4)
    panels = figure.subplots(1, 2)
    for i, panel in enumerate(panels):
        f = numbers.frequency_hz
        up = 1e3 * numbers.amplitude_up_m[i]
        down = 1e3 * numbers.amplitude_down_m[i]
        half = 0.5 * (f[1] - f[0])
        for k, at in enumerate(f[_differ(up, down)]):
            label = "hysteresis" if k == 0 else None
            panel.axvspan(
                at - half, at + half, color=style.GAP_COLOUR, linewidth=0, zorder=0, label=label
            )
        fine = np.linspace(*BAND, 5001)
        linear = 1e3 * numbers.case.linear_amplitude(i, fine)
        swept = {way: (f, 1e3 * amplitude[i]) for way, (f, amplitude) in numbers.envelopes.items()}
        look: dict[str, Any] = {"markersize": 2.8, "linewidth": 0.9}
        show(
            panel,
            line(fine, linear, ":", color=style.BASE_COLOUR, label="linear, no contact"),
            line(*swept["up"], color=style.SKY, linewidth=0.7, label="swept up"),
            line(*swept["down"], color=style.ORANGE, linewidth=0.7, label="swept down"),
            line(f, up, "^-", color=style.BLUE, label="stepped up", **look),
            line(f, down, "v-", color=style.VERMILLION, label="stepped down", **look),
        )
        for k, at in enumerate(numbers.jumps_up_hz[i] + numbers.jumps_down_hz[i]):
            label = "jump of the amplitude" if k == 0 else None
            panel.axvline(at, color=style.GREEN, linewidth=0.8, linestyle="--", label=label)
        points = 1e3 * numbers.marked_m[:, i]
        panel.plot(FREQUENCIES, points, "o", markerfacecolor="white", markeredgecolor=style.BLACK,
                   markersize=8, zorder=5, label="[a]–[d]")  # fmt: skip
        for letter, f, y in zip("abcd", FREQUENCIES, points, strict=True):
            panel.annotate(
                f"[{letter}]", (f, y), (8 if letter in "bd" else -8, 4), zorder=6,
                textcoords="offset points", ha="left" if letter in "bd" else "right",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8},
            )  # fmt: skip
        both = np.stack([numbers.amplitude_up_m[i], numbers.amplitude_down_m[i]])
        panel.set(
            title=numbers.case.lamina[i].name,
            xlabel="frequency of the base [Hz]", xlim=BAND,
            ylabel="half peak-to-peak of the tip [mm]",
            ylim=(0.0, 1.25e3 * float(np.nanmax(both))),
        )  # fmt: skip
    style.legend_outside(figure, panels[0], 4)
    return figure


def jumps(f: FloatArray, amplitude: FloatArray) -> list[float]:
    """Return the frequencies at which an amplitude jumps [Hz].

    A jump is a change between neighbouring frequencies of more than the share `DIFFERS` of the
    amplitude, and more than `JUMP` times the changes beside it.

    Args:
        f: frequencies, shape (n,) [Hz].
        amplitude: amplitudes, shape (n,).

    Returns:
        The middles of the intervals with a jump [Hz].
    """
    change = np.abs(np.diff(amplitude))
    large = change > DIFFERS * np.maximum(amplitude[1:], amplitude[:-1])
    beside = np.maximum(np.append(change[1:], 0.0), np.insert(change[:-1], 0, 0.0))
    middles = 0.5 * (f[1:] + f[:-1])
    return [float(at) for at in middles[large & (change > JUMP * beside)]]


def doubled_window(numbers: Numbers, frequency: float) -> tuple[float, float] | None:
    """Return the ends of the range around a frequency where both directions have period 2 [Hz].

    Return None if the motion at this frequency does not have period 2 in both directions.
    """
    f = numbers.frequency_hz
    both = (numbers.periodicity_up == 2) & (numbers.periodicity_down == 2)
    at = int(np.abs(f - frequency).argmin())
    others = np.flatnonzero(~both)
    if not both[at]:
        return None
    first = others[others < at].max(initial=-1) + 1
    last = others[others > at].min(initial=f.size) - 1
    return float(f[first]), float(f[last])


def _window(numbers: Numbers) -> str:
    """Return in words the range of frequencies about 3.65 Hz in which the motion has period 2."""
    window = doubled_window(numbers, 3.65)
    if window is None:
        return "no period 2 beside 3.65 Hz"
    return "the motion has period 2 from {:.2f} to {:.2f} Hz, up and down".format(*window)


def _inside(numbers: Numbers) -> Criterion:
    """Return the criterion that 3.65 Hz is in the range with period 2, whose ends are uncertain.

    Each end lies somewhere between two frequencies of the stepped sine.
    """
    first, last = doubled_window(numbers, 3.65) or (math.nan, math.nan)
    inside = min(3.65 - first, last - 3.65)
    step = float(np.diff(numbers.frequency_hz).min())
    return Criterion("distance to the nearer end", inside, ">", 0.0, "Hz", (inside, inside + step))


def _periods(numbers: Numbers) -> FloatArray:
    """Return the different periodicities of all motions, increasing."""
    periods = np.array([numbers.periodicity_up, numbers.periodicity_down], dtype=float)
    return np.asarray(np.unique(periods[periods > 0]))


def _scenario(numbers: Numbers) -> str:
    """Return in words the periods, numbers of contacts, hysteresis and jumps of the motions."""
    periodicity = np.array([numbers.periodicity_up, numbers.periodicity_down], dtype=float)
    irregular = numbers.frequency_hz[np.isnan(periodicity).any(axis=0)]
    undecided = numbers.frequency_hz[(periodicity == UNDECIDED).any(axis=0)]
    all_jumps = sorted({at for one in numbers.jumps_up_hz + numbers.jumps_down_hz for at in one})
    contacts, hysteresis = numbers.tip_contacts_per_period, numbers.hysteresis_hz
    return (
        f"periods {', '.join(f'{p:g}' for p in _periods(numbers))}, "
        + (f"none up to 8 at {_listed(irregular)} Hz, " if irregular.size else "")
        + (f"undecided at {_listed(undecided)} Hz, " if undecided.size else "")
        + f"{contacts.min():.2g} to {contacts.max():.2g} tip contacts per period; "
        + (f"up and down differ at {_listed(hysteresis)} Hz" if len(hysteresis)
           else "up and down agree everywhere")
        + (f"; jumps at {_listed(all_jumps)} Hz" if all_jumps else "")
    )  # fmt: skip


def _listed(frequencies: Iterable[float]) -> str:
    return ", ".join(f"{f:.2f}" for f in frequencies)


WITH_CONTACT = Piece(
    "2b",
    "Frequency responses with contact, up and down",
    "Both laminae in contact (method 3.2): stepped sine, each frequency going on from the one "
    "before, and 30-minute swept sines without the transient of their first minute. Grey: up "
    f"and down differ by more than {100 * DIFFERS:g} %. White dots: the four "
    "excitations of the text, from rest. The paper's curves are not available; compared is what "
    "its text says of them.",
    measure_contact,
    draw_contact,
    (
        Statement(
            "contact reduces the amplitudes at resonance significantly", "sec. 2.2",
            lambda n: "largest half peak-to-peak with contact {:.0f} mm (thick, {:.2f} Hz) and "
            "{:.0f} mm (thin, {:.2f} Hz): {:.0f} % and {:.0f} % of the linear peaks".format(
                1e3 * n.largest_amplitude_m[0], n.largest_amplitude_at_hz[0],
                1e3 * n.largest_amplitude_m[1], n.largest_amplitude_at_hz[1],
                *100 * n.largest_amplitude_m / n.linear_peak_m,
            ),
            lambda n: [
                Criterion(
                    "larger ratio", float(np.max(n.largest_amplitude_m / n.linear_peak_m)),
                    "<", 0.5, "%",
                )
            ],
        ),
        Statement(
            "3.65 Hz lies within a window of bifurcated oscillations", "sec. 2.2",
            _window, lambda n: [_inside(n)],
        ),
        Statement(
            "a bifurcation scenario with different numbers of impacts in a period", "sec. 1, 4",
            _scenario,
            lambda n: [
                Criterion("decided periods", len(_periods(n)), ">", MANY - 1),
                Criterion(
                    "numbers of contacts in two periods",
                    np.unique(np.round(2.0 * n.tip_contacts_per_period)).size, ">", MANY - 1,
                ),
            ],
        ),
    ),
)  # fmt: skip

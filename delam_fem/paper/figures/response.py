"""Fig. 2b of the paper: frequency responses with contact, up and down."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import BoolArray, FloatArray
from delam_fem.paper.claims import NOT_IN_JSON, Claim, Criterion, Numbers, Piece, judged
from delam_fem.paper.lab import (
    BAND,
    FREQUENCIES,
    RESONANT,
    Laboratory,
    motion_case,
    swept_case,
    swept_envelope,
)
from delam_fem.paper.measures import half_ranges
from delam_fem.results.figures.style import (
    BASE_COLOUR,
    BLACK,
    BLUE,
    GAP_COLOUR,
    GREEN,
    ORANGE,
    SKY,
    VERMILLION,
    WIDTH,
    legend_outside,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
"""In place of a periodicity without a margin."""
JUMP = 3.0
"""A jump of the amplitude is this factor larger than the changes beside it."""


@dataclass(frozen=True)
class WithContact(Numbers):
    """Responses of the tips with contact, of both laminae, up and down.

    Attributes:
        frequency_hz: frequencies of the stepped sine, shape (n,).
        amplitude_up_m, amplitude_down_m: half peak-to-peak of the tips, shape (2, n).
        periodicity_up, periodicity_down: periodicity, NaN if the motion has none, `UNDECIDED` if
            it has no margin, shape (n,).
        tip_contacts_per_period: tip contacts per period, up and down, shape (2, n).
        hysteresis_hz: frequencies at which up and down differ.
        jumps_up_hz, jumps_down_hz: frequencies at which the amplitude of each tip jumps.
        largest_amplitude_m, largest_amplitude_at_hz: largest amplitude of each tip, and its
            frequency.
        largest_swept_amplitude_m: largest amplitude of each tip, by direction of the swept sine.
        linear_peak_m: largest amplitude of each lamina alone.
        case: case with these laminae.
        envelopes: frequencies, shape (n,) [Hz], and amplitudes, shape (2, n) [m], of the swept
            sines, up and down.
        marked_m: amplitude of both tips at the paper's four excitations, from rest, shape (4, 2).
    """

    frequency_hz: FloatArray
    amplitude_up_m: FloatArray
    amplitude_down_m: FloatArray
    periodicity_up: FloatArray
    periodicity_down: FloatArray
    tip_contacts_per_period: FloatArray
    hysteresis_hz: FloatArray
    jumps_up_hz: list[list[float]]
    jumps_down_hz: list[list[float]]
    largest_amplitude_m: FloatArray
    largest_amplitude_at_hz: list[float]
    largest_swept_amplitude_m: dict[str, FloatArray]
    linear_peak_m: FloatArray
    case: Case = field(metadata=NOT_IN_JSON)
    envelopes: dict[str, tuple[FloatArray, FloatArray]] = field(metadata=NOT_IN_JSON)
    marked_m: FloatArray = field(metadata=NOT_IN_JSON)


def measure(lab: Laboratory) -> WithContact:
    """Compute the responses with contact, up and down, and the paper's four points."""
    case = motion_case(RESONANT, lab.plan)
    data = _stepped_sine(lab)
    cases = [swept_case("linear", ends, case.contact.law, CONTACT_STEPS) for ends in WAYS.values()]
    swept = dict(zip(WAYS, lab.motions(cases), strict=True))
    envelopes = {way: swept_envelope(result) for way, result in swept.items()}
    marked = lab.motions([motion_case(f, lab.plan) for f in FREQUENCIES])
    f = data["frequency"].to_numpy()
    amplitude = data["tip_amplitude"].transpose("lamina", "direction", "frequency").to_numpy()
    up, down = amplitude[:, 0], amplitude[:, 1]
    periodicity, contacts = (
        data[name].transpose("direction", "frequency").to_numpy()
        for name in ("periodicity", "tip_contacts_per_period")
    )
    is_known = (data["is_decided"] != 0.0) & (data["settled"] != 0.0)
    known = is_known.transpose("direction", "frequency").to_numpy()
    periodicity = np.where(known, periodicity, UNDECIDED)
    linear = np.stack([case.linear_amplitude(i, np.linspace(*BAND, 50001)) for i in range(2)])
    return WithContact(
        frequency_hz=f,
        amplitude_up_m=up,
        amplitude_down_m=down,
        periodicity_up=periodicity[0],
        periodicity_down=periodicity[1],
        tip_contacts_per_period=contacts,
        hysteresis_hz=f[_differ(up, down).any(axis=0)],
        jumps_up_hz=[jumps(f, up[i]) for i in range(2)],
        jumps_down_hz=[jumps(f, down[i]) for i in range(2)],
        largest_amplitude_m=np.nanmax(amplitude, axis=(1, 2)),
        largest_amplitude_at_hz=[
            float(f[np.nanmax(amplitude[i], axis=0).argmax()]) for i in range(2)
        ],
        largest_swept_amplitude_m={way: np.nanmax(a, axis=1) for way, (_, a) in envelopes.items()},
        linear_peak_m=linear.max(axis=1),
        case=case,
        envelopes=envelopes,
        marked_m=np.array([half_ranges(result) for result in marked]),
    )


def _stepped_sine(lab: Laboratory) -> xr.Dataset:
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
    differ: BoolArray = np.abs(up - down) > DIFFERS * np.maximum(up, down)
    return differ


def draw(numbers: WithContact) -> Figure:
    """Draw the responses with contact, up and down, with the paper's four points."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 5.4), layout="constrained")
    panels = figure.subplots(1, 2)
    for i, panel in enumerate(panels):
        _contact_panel(panel, numbers, i)
        points = 1e3 * numbers.marked_m[:, i]
        panel.plot(FREQUENCIES, points, "o", markerfacecolor="white", markeredgecolor=BLACK,
                   markersize=8, zorder=5, label="[a]–[d]")  # fmt: skip
        for letter, f, y in zip("abcd", FREQUENCIES, points, strict=True):
            _mark(panel, f"[{letter}]", (f, y), is_right=letter in "bd")
        both = np.stack([numbers.amplitude_up_m[i], numbers.amplitude_down_m[i]])
        panel.set(xlabel="frequency of the base [Hz]", ylabel="half peak-to-peak of the tip [mm]")
        panel.set(xlim=BAND, ylim=(0.0, 1.25e3 * float(np.nanmax(both))))
        panel.set_title(numbers.case.lamina[i].name, loc="left")
    legend_outside(figure, panels[0], 4)
    return figure


def _contact_panel(panel: Axes, numbers: WithContact, i: int) -> None:
    """Draw the responses of one lamina with contact."""
    f = numbers.frequency_hz
    up, down = 1e3 * numbers.amplitude_up_m[i], 1e3 * numbers.amplitude_down_m[i]
    half = 0.5 * (f[1] - f[0])
    for k, at in enumerate(f[_differ(up, down)]):
        label = "hysteresis" if k == 0 else None
        panel.axvspan(at - half, at + half, color=GAP_COLOUR, linewidth=0, zorder=0, label=label)
    fine = np.linspace(*BAND, 5001)
    linear = 1e3 * numbers.case.linear_amplitude(i, fine)
    panel.plot(fine, linear, ":", color=BASE_COLOUR, label="linear, no contact")
    for way, colour in (("up", SKY), ("down", ORANGE)):
        f_swept, amplitude = numbers.envelopes[way]
        panel.plot(f_swept, 1e3 * amplitude[i], color=colour, linewidth=0.7, label=f"swept {way}")
    for values, colour, marker, way in ((up, BLUE, "^", "up"), (down, VERMILLION, "v", "down")):
        panel.plot(f, values, color=colour, marker=marker, markersize=2.8, linewidth=0.9,
                   label=f"stepped {way}")  # fmt: skip
    for k, at in enumerate(numbers.jumps_up_hz[i] + numbers.jumps_down_hz[i]):
        label = "jump of the amplitude" if k == 0 else None
        panel.axvline(at, color=GREEN, linewidth=0.8, linestyle="--", label=label)


def _mark(panel: Axes, text: str, point: tuple[float, float], *, is_right: bool) -> None:
    """Write a text beside a point, to the right or to the left of it."""
    panel.annotate(
        text, point, (8 if is_right else -8, 4), textcoords="offset points", zorder=6,
        ha="left" if is_right else "right",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8},
    )  # fmt: skip


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


def doubled_window(numbers: WithContact, frequency: float) -> tuple[float, float] | None:
    """Return the ends of the range around a frequency where both directions have period 2 [Hz].

    Return None if the motion at this frequency does not have period 2 in both directions.
    """
    f = numbers.frequency_hz
    both = (numbers.periodicity_up == 2) & (numbers.periodicity_down == 2)
    first = last = int(np.abs(f - frequency).argmin())
    if not both[first]:
        return None
    while first > 0 and both[first - 1]:
        first -= 1
    while last + 1 < f.size and both[last + 1]:
        last += 1
    return float(f[first]), float(f[last])


def judge(numbers: WithContact) -> tuple[Claim, ...]:
    """Judge the paper's statements about the response with contact."""
    largest = numbers.largest_amplitude_m
    reduced = largest / numbers.linear_peak_m
    at = numbers.largest_amplitude_at_hz
    window = doubled_window(numbers, 3.65)
    step = float(np.diff(numbers.frequency_hz).min())
    inside = min(3.65 - window[0], window[1] - 3.65) if window else math.nan
    return (
        Claim(
            "2b", "contact reduces the amplitudes at resonance significantly", "sec. 2.2",
            f"largest half peak-to-peak with contact {1e3 * largest[0]:.0f} mm (thick, {at[0]:.2f} "
            f"Hz) and {1e3 * largest[1]:.0f} mm (thin, {at[1]:.2f} Hz): {100 * reduced[0]:.0f} % "
            f"and {100 * reduced[1]:.0f} % of the linear peaks",
            *judged(Criterion("larger ratio", float(np.max(reduced)), "<", 0.5, "%")),
        ),
        Claim(
            "2b", "3.65 Hz lies within a window of bifurcated oscillations", "sec. 2.2",
            f"the motion has period 2 from {window[0]:.2f} to {window[1]:.2f} Hz, up and down"
            if window else "no period 2 beside 3.65 Hz",
            *judged(
                Criterion(
                    "distance to the nearer end", inside, ">", 0.0, "Hz", (inside, inside + step)
                )
            ),
        ),
        _claim_on_scenario(numbers),
    )  # fmt: skip


def _claim_on_scenario(numbers: WithContact) -> Claim:
    """Judge whether the motions have many periods and numbers of contacts."""
    hysteresis = numbers.hysteresis_hz
    all_jumps = sorted({at for one in numbers.jumps_up_hz + numbers.jumps_down_hz for at in one})
    periodicity = np.array([numbers.periodicity_up, numbers.periodicity_down], dtype=float)
    periods = np.unique(periodicity[np.isfinite(periodicity) & (periodicity > 0)])
    irregular = numbers.frequency_hz[np.isnan(periodicity).any(axis=0)]
    undecided = numbers.frequency_hz[(periodicity == UNDECIDED).any(axis=0)]
    contacts = numbers.tip_contacts_per_period
    kinds = np.unique(np.round(2.0 * contacts)).size
    return Claim(
        "2b", "a bifurcation scenario with different numbers of impacts in a period",
        "sec. 1, 4",
        f"periods {', '.join(f'{p:g}' for p in periods)}, "
        + (f"none up to 8 at {_listed(irregular)} Hz, " if irregular.size else "")
        + (f"undecided at {_listed(undecided)} Hz, " if undecided.size else "")
        + f"{contacts.min():.2g} to {contacts.max():.2g} tip contacts per period; "
        + (f"up and down differ at {_listed(hysteresis)} Hz" if len(hysteresis)
           else "up and down agree everywhere")
        + (f"; jumps at {_listed(all_jumps)} Hz" if all_jumps else ""),
        *judged(
            Criterion("decided periods", len(periods), ">", MANY - 1),
            Criterion("numbers of contacts in two periods", kinds, ">", MANY - 1),
        ),
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
    measure,
    draw,
    judge,
)

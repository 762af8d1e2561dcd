"""Fig. 2b of the paper: frequency responses in contact, up and down."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
from delam_fem.paper.claims import Claim, Piece, judged
from delam_fem.paper.figures.swept_sine import BAND, swept_case, swept_envelope
from delam_fem.paper.lab import FREQUENCIES, Laboratory, motion_case
from delam_fem.results.style import (
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

    from delam_fem.results.dataset import Result


CONTACT_STEPS = 1000
"""Steps per period of the highest frequency of a swept sine."""
DIFFERS = 0.15
"""Amplitudes that differ by more belong to different motions."""
MANY = 3
"""So many periods, and numbers of contacts in two periods, make a bifurcation scenario."""
JUMP = 3.0
"""A jump of the amplitude is so many times larger than the changes beside it."""


def with_contact(lab: Laboratory) -> Piece:
    """Draw the responses with contact, up and down, with the paper's four points."""
    base = motion_case(3.25, lab.plan)
    step = lab.plan.response_step
    values = np.round(np.arange(BAND[0], BAND[1] + 0.5 * step, step), 6)
    data = lab.sweep(
        {
            "name": "response",
            "order": "both",
            "set": {"time": {"periods": lab.plan.response_periods}},
            "axis": [{"key": "excitation.frequency", "values": values.tolist()}],
            "record": {"strobes": 40},
        }
    )
    law = base.contact.law
    cases = [swept_case("linear", ends, law, CONTACT_STEPS) for ends in (BAND, BAND[::-1])]
    swept = dict(zip(("up", "down"), lab.motions(cases), strict=True))
    marked = lab.motions([motion_case(f, lab.plan) for f in FREQUENCIES])
    amplitude = data["tip_amplitude"].transpose("lamina", "direction", "frequency").to_numpy()
    figure = Figure(figsize=(WIDTH, 5.4), layout="constrained")
    panels = figure.subplots(1, 2)
    for i, panel in enumerate(panels):
        _contact_panel(panel, base, i, swept, (values, amplitude[i]))
        points = [0.5e3 * (r.summary["tip_max"][i] - r.summary["tip_min"][i]) for r in marked]
        panel.plot(FREQUENCIES, points, "o", markerfacecolor="white", markeredgecolor=BLACK,
                   markersize=8, zorder=5, label="[a]–[d]")  # fmt: skip
        for letter, f, y in zip("abcd", FREQUENCIES, points, strict=True):
            _mark(panel, f"[{letter}]", (f, y), is_right=letter in "bd")
        panel.set(xlabel="frequency of the base [Hz]", ylabel="half peak-to-peak of the tip [mm]")
        panel.set(xlim=BAND, ylim=(0.0, 1.25e3 * float(np.nanmax(amplitude[i]))))
        panel.set_title(base.lamina[i].name, loc="left")
    legend_outside(figure, panels[0], 4)
    numbers = _contact_numbers(base, data, amplitude, swept)
    caption = (
        "Both laminae in contact (method 3.2): stepped sine, each frequency going on from the one "
        "before, and 30-minute swept sines. Grey: up and down differ by more than "
        f"{100 * DIFFERS:g} %. White dots: the four excitations of the text, from rest. The "
        "paper's curves are not available; compared is what its text says of them."
    )
    title = "Frequency responses with contact, up and down"
    return Piece("2b", title, caption, figure, numbers, claims(numbers))


def _contact_panel(
    panel: Axes,
    base: Case,
    i: int,
    swept: dict[str, Result],
    stepped: tuple[FloatArray, FloatArray],
) -> None:
    """Draw the responses of one lamina with contact."""
    f, (up, down) = stepped
    differs = np.abs(up - down) > DIFFERS * np.maximum(up, down)
    half = 0.5 * (f[1] - f[0])
    for k, at in enumerate(f[differs]):
        label = "hysteresis" if k == 0 else None
        panel.axvspan(at - half, at + half, color=GAP_COLOUR, linewidth=0, zorder=0, label=label)
    fine = np.linspace(*BAND, 5001)
    linear = 1e3 * base.linear_amplitude(i, fine)
    panel.plot(fine, linear, ":", color=BASE_COLOUR, label="linear, no contact")
    for way, colour in (("up", SKY), ("down", ORANGE)):
        f_swept, amplitude = swept_envelope(swept[way])
        panel.plot(f_swept, 1e3 * amplitude[i], color=colour, linewidth=0.7, label=f"swept {way}")
    for values, colour, marker, way in ((up, BLUE, "^", "up"), (down, VERMILLION, "v", "down")):
        panel.plot(f, 1e3 * values, color=colour, marker=marker, markersize=2.8, linewidth=0.9,
                   label=f"stepped {way}")  # fmt: skip
    for k, at in enumerate(jumps(f, up) + jumps(f, down)):
        label = "jump of the amplitude" if k == 0 else None
        panel.axvline(at, color=GREEN, linewidth=0.8, linestyle="--", label=label)


def _mark(panel: Axes, text: str, point: tuple[float, float], *, is_right: bool) -> None:
    """Write beside a point, on the side where the curves are not."""
    panel.annotate(
        text, point, (8 if is_right else -8, 4), textcoords="offset points", zorder=6,
        ha="left" if is_right else "right",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5, "alpha": 0.8},
    )  # fmt: skip


def jumps(f: FloatArray, amplitude: FloatArray) -> list[float]:
    """Return where an amplitude jumps: it changes by `DIFFERS` and by `JUMP` times its neighbours.

    Args:
        f: frequencies, shape (n,) [Hz].
        amplitude: shape (n,).

    Returns:
        The middles of the intervals [Hz].
    """
    change = np.abs(np.diff(amplitude))
    large = change > DIFFERS * np.maximum(amplitude[1:], amplitude[:-1])
    beside = np.maximum(np.append(change[1:], 0.0), np.insert(change[:-1], 0, 0.0))
    middles = 0.5 * (f[1:] + f[:-1])
    return [float(at) for at in middles[large & (change > JUMP * beside)]]


def doubled_window(numbers: dict[str, Any], frequency: float) -> tuple[float, float] | None:
    """Return the frequencies about a given one at which both directions have period 2 [Hz]."""
    f = np.asarray(numbers["frequency_hz"])
    both = (np.asarray(numbers["periodicity_up"]) == 2) & (
        np.asarray(numbers["periodicity_down"]) == 2
    )
    first = last = int(np.abs(f - frequency).argmin())
    if not both[first]:
        return None
    while first > 0 and both[first - 1]:
        first -= 1
    while last + 1 < f.size and both[last + 1]:
        last += 1
    return float(f[first]), float(f[last])


def _contact_numbers(
    base: Case, data: xr.Dataset, amplitude: FloatArray, swept: dict[str, Result]
) -> dict[str, Any]:
    f = data["frequency"].to_numpy()
    linear = np.stack([base.linear_amplitude(i, np.linspace(*BAND, 50001)) for i in range(2)])
    up, down = amplitude[:, 0], amplitude[:, 1]
    differs = (np.abs(up - down) > DIFFERS * np.maximum(up, down)).any(axis=0)
    periodicity, contacts = (
        data[name].transpose("direction", "frequency").to_numpy()
        for name in ("periodicity", "tip_contacts_per_period")
    )
    return {
        "frequency_hz": f,
        "amplitude_up_m": up,
        "amplitude_down_m": down,
        "periodicity_up": periodicity[0],
        "periodicity_down": periodicity[1],
        "tip_contacts_per_period": contacts,
        "hysteresis_hz": f[differs],
        "jumps_up_hz": [jumps(f, up[i]) for i in range(2)],
        "jumps_down_hz": [jumps(f, down[i]) for i in range(2)],
        "largest_amplitude_m": np.nanmax(amplitude, axis=(1, 2)),
        "largest_amplitude_at_hz": [
            float(f[np.nanmax(amplitude[i], axis=0).argmax()]) for i in range(2)
        ],
        "largest_swept_amplitude_m": {
            way: swept_envelope(result)[1].max(axis=1) for way, result in swept.items()
        },
        "linear_peak_m": linear.max(axis=1),
    }


def claims(numbers: dict[str, Any]) -> tuple[Claim, ...]:
    """Return the rows about the response in contact."""
    largest = numbers["largest_amplitude_m"]
    reduced = largest / numbers["linear_peak_m"]
    at = numbers["largest_amplitude_at_hz"]
    window = doubled_window(numbers, 3.65)
    hysteresis = numbers["hysteresis_hz"]
    all_jumps = sorted(
        {at for way in ("up", "down") for one in numbers[f"jumps_{way}_hz"] for at in one}
    )
    periodicity = np.array([numbers["periodicity_up"], numbers["periodicity_down"]], dtype=float)
    periods = np.unique(periodicity[np.isfinite(periodicity) & (periodicity > 0)])
    irregular = np.asarray(numbers["frequency_hz"])[~(periodicity > 0).all(axis=0)]
    contacts = np.asarray(numbers["tip_contacts_per_period"])
    return (
        Claim(
            "2b", "contact reduces the amplitudes at resonance significantly", "sec. 2.2",
            f"largest half peak-to-peak with contact {1e3 * largest[0]:.0f} mm (thick, {at[0]:.2f} "
            f"Hz) and {1e3 * largest[1]:.0f} mm (thin, {at[1]:.2f} Hz): {100 * reduced[0]:.0f} % "
            f"and {100 * reduced[1]:.0f} % of the linear peaks",
            judged(bool(np.all(reduced < 0.5))), True,
        ),
        Claim(
            "2b", "3.65 Hz lies within a window of bifurcated oscillations", "sec. 2.2",
            f"the motion has period 2 from {window[0]:.2f} to {window[1]:.2f} Hz, up and down"
            if window else "no period 2 beside 3.65 Hz",
            judged(window is not None),
        ),
        Claim(
            "2b", "a bifurcation scenario with different numbers of impacts in a period",
            "sec. 1, 4",
            f"periods {', '.join(f'{p:g}' for p in periods)}, "
            + (f"none up to 8 at {_listed(irregular)} Hz, " if irregular.size else "")
            + f"{contacts.min():.2g} to {contacts.max():.2g} tip contacts per period; "
            + (f"up and down differ at {_listed(hysteresis)} Hz" if len(hysteresis)
               else "up and down agree everywhere")
            + (f"; jumps at {_listed(all_jumps)} Hz" if all_jumps else ""),
            judged(len(periods) >= MANY and np.unique(np.round(2.0 * contacts)).size >= MANY),
        ),
    )  # fmt: skip


def _listed(frequencies: Iterable[float]) -> str:
    return ", ".join(f"{f:.2f}" for f in frequencies)

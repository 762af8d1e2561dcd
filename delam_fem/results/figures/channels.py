"""Figures of any channels of a run: histories and spectra with a panel for each unit, portraits."""

from __future__ import annotations

from itertools import cycle

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from delam_fem.case.definition import Case
from delam_fem.numerics import harmonics
from delam_fem.numerics.types import FloatArray
from delam_fem.results import diagnostics, record
from delam_fem.results.channels import require_channels
from delam_fem.results.figures.style import (
    BLACK,
    HISTORY_PERIODS,
    LAMINA_COLOURS,
    PORTRAIT_PERIODS,
    VERMILLION,
    finite,
    hertz_below,
    label_x,
    legend_above,
    over_time,
    powers_of_ten,
    shown_unit,
    side_by_side,
    stacked,
    time_axis,
)
from delam_fem.results.schema import SENSOR, sensors_of

FEW_SAMPLES = 400
"""Samples up to which they are drawn as dots too."""
SHOWN_HARMONICS = 20
"""Harmonics of the excitation that a spectrum shows."""
DECADES = 6.0
"""Range of amplitudes that a logarithmic axis shows."""
WIDE = 10.0
"""Ratio of the largest amplitude to the smallest from which an axis is logarithmic."""
WIDE_BAND = 100.0
"""Ratio of the ends of a band from which the axis of frequencies is logarithmic."""
FEW_CHANNELS = 3
"""Channels of a panel up to which the legend has their distortions."""
ZERO = 1e-14
"""Share of the largest amplitude that is round-off: nothing moves there."""


def chosen(history: xr.Dataset, channels: xr.Dataset, names: tuple[str, ...]) -> list[xr.DataArray]:
    """Return channels by their names: those of the sensors unless others are asked for, or all.

    Args:
        history: dataset of a run.
        channels: its record.
        names: names of channels.

    Raises:
        CaseError: there is no channel of a name.
    """
    require_channels(names, channels)
    sensors = [name for name in map(str, channels) if f"{SENSOR}{name}" in sensors_of(history)]
    return [channels[name] for name in names or sensors or map(str, channels)]


def _by_unit(channels: list[xr.DataArray]) -> dict[str, list[tuple[xr.DataArray, str]]]:
    """Return channels with their colours by unit."""
    groups: dict[str, list[tuple[xr.DataArray, str]]] = {}
    for channel, colour in zip(channels, cycle(LAMINA_COLOURS), strict=False):
        groups.setdefault(channel.attrs["units"], []).append((channel, colour))
    return groups


def _quantities(channels: list[tuple[xr.DataArray, str]]) -> str:
    """Return the quantities of some channels in words, one a line; those of the base as others."""
    words = [str(channel.attrs["quantity"]).removeprefix("base ") for channel, _ in channels]
    return ",\n".join(dict.fromkeys(words))


def histories(history: xr.Dataset, case: Case, *names: str) -> Figure:
    """Draw channels over the last periods, with a panel for each unit, and ticks at impacts."""
    groups = _by_unit(chosen(history, record.of_run(history, case), names))
    start = float(diagnostics.last_periods(history, case, HISTORY_PERIODS)["time"][0])
    figure, panels = stacked(len(groups), max(4.2, 1.0 + 2.4 * len(groups)))
    for axes, (units, channels) in zip(panels, groups.items(), strict=True):
        unit, factor = shown_unit(units)
        for channel, colour in channels:
            time = channel[channel.dims[0]].to_numpy()
            is_late = time >= start
            is_sparse = channel.dims[0] != "time" and is_late.sum() <= FEW_SAMPLES
            axes.plot(
                time[is_late] / time_axis(case)[0], factor * finite(channel)[is_late],
                color=colour, linewidth=0.9, marker="." if is_sparse else None, markersize=3.0,
                label=str(channel.name),
            )  # fmt: skip
        axes.set_ylabel(f"{_quantities(channels)} [{unit}]")
        axes.margins(x=0.0)
    when = history["event_time"].to_numpy()
    when = when[when >= start] / time_axis(case)[0]
    if when.size:
        low = np.full(when.size, panels[0].get_ylim()[0])
        panels[0].plot(when, low, "|", color=VERMILLION, markersize=9.0, label="impacts")
    for axes in panels:
        legend_above(axes)
    return over_time(figure, panels, case)


def spectrum(channel: xr.DataArray, case: Case) -> tuple[FloatArray, FloatArray]:
    """Return frequencies [Hz] and amplitudes of a channel over whole periods of the window.

    NaN where nothing moves: what no drive and no contact excites has no amplitude to show.
    """
    time = channel[channel.dims[0]].to_numpy()
    values = finite(channel)
    step = float(time[1] - time[0])
    if channel.dims[0] == "time" and values.size >= case.steps_per_period:
        values = values[values.size % case.steps_per_period :]
    amplitudes = harmonics.amplitude_spectrum(values)[1:]
    frequencies = np.arange(1, amplitudes.size + 1) / (values.size * step)
    floor = ZERO * np.nanmax(amplitudes, initial=0.0)
    return frequencies, np.where(amplitudes > floor, amplitudes, np.nan)


def spectra(history: xr.Dataset, case: Case, *names: str) -> Figure:
    """Draw the amplitude spectra of channels, with a panel for each unit.

    An axis is logarithmic where its range asks for it; amplitudes then stand in dB beside it. Under
    a harmonic drive the harmonics are marked.
    """
    groups = _by_unit(chosen(history, record.of_run(history, case), names))
    figure, panels = stacked(len(groups), max(4.2, 1.2 + 2.6 * len(groups)))
    scale = case.period if case.is_periodic else 1.0
    end = SHOWN_HARMONICS + 0.5 if case.is_periodic else np.inf
    for axes, (units, channels) in zip(panels, groups.items(), strict=True):
        unit, factor = shown_unit(units)
        curves = []
        for channel, colour in channels:
            f, a = spectrum(channel, case)
            is_inside = scale * f <= end
            curve = a[is_inside] * factor
            curves.append(curve)
            is_sparse = np.isfinite(curve).sum() <= FEW_SAMPLES
            (line,) = axes.plot(
                scale * f[is_inside], curve, color=colour, linewidth=0.9,
                marker="." if is_sparse else None, markersize=3.0, label=str(channel.name),
            )  # fmt: skip
            if case.is_harmonic and channel.dims[0] == "time":
                distortion = _mark_harmonics(axes, channel, case, (factor, colour))
                line.set_label(f"{channel.name}{distortion * (len(channels) <= FEW_CHANNELS)}")
        amplitudes = np.concatenate(curves)
        top = float(np.nanmax(amplitudes, initial=0.0))
        if top > WIDE * np.nanmin(amplitudes, initial=top):
            axes.set_yscale("log")
            axes.set_ylim(top * 10.0**-DECADES, 2.0 * top)
            powers_of_ten(axes.yaxis)
            axes.yaxis.set_minor_locator(NullLocator())
            beside = axes.twinx()  # a second axis with another scale cannot follow a logarithm
            beside.set_ylim(20.0 * np.log10(axes.get_ylim()))
            beside.set_ylabel(f"dB re 1 {unit}")
            beside.grid(visible=False)
        if not case.is_periodic and f[-1] > WIDE_BAND * f[0]:
            axes.set_xscale("log")
        axes.set_ylabel(f"amplitude of {_quantities(channels)} [{unit}]")
        axes.margins(x=0.0)
        if case.is_periodic:
            axes.set_xlim(0.0, end)
            axes.set_xticks(np.arange(0, SHOWN_HARMONICS + 1, 2))
        legend_above(axes)
    axis = "frequency / frequency of excitation [–]" if case.is_periodic else "frequency [Hz]"
    label_x(panels, axis)
    hertz_below(panels[-1], case)
    figure.suptitle(case.title)
    return figure


def _mark_harmonics(axes: Axes, channel: xr.DataArray, case: Case, look: tuple[float, str]) -> str:
    """Mark the harmonics in a spectrum; return the distortion of the channel in words."""
    values = finite(channel)
    N = case.steps_per_period
    values = values[values.size % N :]
    if not (values.size and np.isfinite(values).all()):
        return ""
    amplitudes = harmonics.harmonic_amplitudes(values, values.size // N)
    if amplitudes[0] <= 0.0:
        return ""
    factor, colour = look
    marked = factor * amplitudes[:SHOWN_HARMONICS]
    orders = 1 + np.arange(marked.size)
    axes.plot(orders, marked, "o", color=colour, markeredgecolor=BLACK, markersize=4.5)
    d = 100.0 * float(harmonics.distortion_factor(amplitudes))
    thd = 100.0 * float(harmonics.total_harmonic_distortion(amplitudes))
    return f": d = {d:.2f} %, THD = {thd:.1f} %"


def portraits(history: xr.Dataset, case: Case, *names: str) -> Figure:
    """Draw the time derivative of each channel over the channel itself.

    The derivative of a displacement is the velocity at the same place, where the record has it.
    """
    of_run = record.of_run(history, case)
    channels = chosen(history, of_run, names)
    n_steps = PORTRAIT_PERIODS * case.steps_per_period
    figure, panels = side_by_side(len(channels), 4.2)
    for axes, channel, colour in zip(panels, channels, cycle(LAMINA_COLOURS), strict=False):
        unit, factor = shown_unit(channel.attrs["units"])
        time = channel[channel.dims[0]].to_numpy()
        values = factor * finite(channel)
        rates = np.gradient(values, time, edge_order=2) if values.size > 2 else 0.0 * values
        rate_words = "its rate"
        if (velocity := f"{channel.name}_velocity") in of_run:
            rates = factor * finite(of_run[velocity])
            rate_words = "velocity"
        axes.plot(values[-n_steps:], rates[-n_steps:], color=colour, linewidth=0.8)
        if case.is_periodic and channel.dims[0] == "time":
            ends = slice(-1, -n_steps - 1, -case.steps_per_period)
            axes.plot(values[ends], rates[ends], "o", color=BLACK, markersize=4)
        axes.set_title(str(channel.name), loc="left", color=colour)
        axes.set(xlabel=f"{channel.attrs['quantity']} [{unit}]", ylabel=f"{rate_words} [{unit}/s]")
    figure.suptitle(f"{case.title}; dots: ends of periods" if case.is_periodic else case.title)
    return figure

"""Figures of the motion of both tips: histories, phase portraits, spectra, envelope."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from delam_fem.case.definition import Case
from delam_fem.numerics import harmonics
from delam_fem.results import diagnostics
from delam_fem.results.style import (
    BASE_COLOUR,
    BLACK,
    GAP_COLOUR,
    HISTORY_PERIODS,
    LAMINA_COLOURS,
    PORTRAIT_PERIODS,
    WIDTH,
    finite,
    legend_above,
    time_axis,
    title,
)

SHOWN_HARMONICS = 20
"""Harmonics that a spectrum shows: the amplitudes beyond are below a micrometre."""
SPECTRUM_DECADES = 5.0
"""Depth of a spectrum's axis below its largest amplitude."""


def tip_histories(history: xr.Dataset, case: Case) -> Figure:
    """Draw the positions y_1 = q_1 and y_2 = g0(L) + q_2 of both tips over the last periods."""
    last = diagnostics.last_periods(history, case, HISTORY_PERIODS)
    unit, label = time_axis(case)
    t = last["time"].to_numpy() / unit
    q = 1e3 * finite(last["tip_displacement"])
    y = q + np.array([[0.0], [1e3 * float(history["gap0"][diagnostics.TIP])]])
    figure = Figure(figsize=(WIDTH, 4.2), layout="constrained")
    axes = figure.subplots()
    if "base_displacement" in last:
        base = 1e3 * finite(last["base_displacement"])
        axes.plot(t, base, color=BASE_COLOUR, linewidth=0.9, linestyle="--", label="base")
    axes.fill_between(t, y[0], y[1], where=y[1] >= y[0], color=GAP_COLOUR, label="gap")
    for i, name in enumerate(history["lamina"].to_numpy()):
        axes.plot(t, y[i], color=LAMINA_COLOURS[i], label=f"{name}  $y_{i + 1}$")
    if case.contact.law != "none":
        closed = diagnostics.tip_closed(last)
        middle = y.mean(axis=0)[closed]
        axes.plot(t[closed], middle, "o", color=BLACK, markersize=4.5, label="tips in contact")
    axes.set(xlabel=label, ylabel="position of the tip [mm]")
    axes.margins(x=0.0)
    legend_above(axes)
    figure.suptitle(title(case))
    return figure


def phase_portraits(history: xr.Dataset, case: Case) -> Figure:
    """Draw velocity over displacement of both tips, with the state at the end of each period."""
    portrait = finite(diagnostics.phase_portrait(history, case, PORTRAIT_PERIODS))
    figure = Figure(figsize=(WIDTH, 4.6), layout="constrained")
    N = case.time.steps_per_period
    for i, axes in enumerate(figure.subplots(1, 2)):
        q, v = 1e3 * portrait[i, 0], portrait[i, 1]
        axes.plot(q, v, color=LAMINA_COLOURS[i], linewidth=0.8)
        if case.excitation.kind == "harmonic":
            at_end = slice(N - 1, None, N)
            axes.plot(q[at_end], v[at_end], "o", color=BLACK, markersize=4, label="ends of periods")
            legend_above(axes)
        axes.set_title(str(history["lamina"].to_numpy()[i]), loc="left", color=LAMINA_COLOURS[i])
        axes.set(xlabel=f"tip displacement  $q_{i + 1}$ [mm]", ylabel="tip velocity [m/s]")
    count = portrait.shape[-1] / N
    figure.suptitle(f"{title(case)}; {count:g} period{'s' if count != 1 else ''}")
    return figure


def spectra(history: xr.Dataset, case: Case) -> Figure:
    """Draw the amplitude spectra of both tip displacements with the harmonics marked."""
    whole = diagnostics.last_periods(history, case)
    amplitudes = 1e3 * harmonics.amplitude_spectrum(finite(whole["tip_displacement"]))
    n_periods = whole.sizes["time"] // case.time.steps_per_period
    orders = np.arange(amplitudes.shape[1]) / n_periods
    found = diagnostics.window_harmonics(history, case)
    figure = Figure(figsize=(WIDTH, 6.0), layout="constrained")
    is_harmonic = case.excitation.kind == "harmonic"
    unit = 1.0 if is_harmonic else 1.0 / case.period
    for i, axes in enumerate(figure.subplots(2, 1, sharex=True, sharey=True)):
        name = str(history["lamina"].to_numpy()[i])
        axes.semilogy(unit * orders[1:], amplitudes[i, 1:], color=LAMINA_COLOURS[i], linewidth=0.9)
        if is_harmonic and found is not None:
            marked = 1e3 * found[i, :SHOWN_HARMONICS]
            axes.plot(1 + np.arange(marked.size), marked, "o", color=BLACK, markersize=4.5)
            d = 100.0 * float(harmonics.distortion_factor(found[i]))
            thd = 100.0 * float(harmonics.total_harmonic_distortion(found[i]))
            name += f":  d = {d:.2f} %,  THD = {thd:.1f} %;  dots: harmonics of the excitation"
        axes.set_title(name, loc="left", color=LAMINA_COLOURS[i])
        axes.set_ylabel(f"amplitude of $q_{i + 1}$ [mm]")
        axes.yaxis.set_major_locator(LogLocator(numticks=12))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_xlim(0.0, unit * (SHOWN_HARMONICS + 0.5))
    top = np.nanmax(amplitudes[:, 1:], initial=0.0)
    if top > 0.0:
        axes.set_ylim(top * 10.0**-SPECTRUM_DECADES, 2.0 * top)
    if is_harmonic:
        axes.set_xticks(np.arange(0, SHOWN_HARMONICS + 1, 2))
    axes.set_xlabel("frequency / frequency of excitation [–]" if is_harmonic else "frequency [Hz]")
    figure.suptitle(f"{title(case)}; {n_periods} period{'s' if n_periods != 1 else ''}")
    return figure


def envelope(history: xr.Dataset, case: Case) -> Figure:
    """Draw between which displacements each tip moved in every period of the run."""
    unit, label = time_axis(case)
    edges = np.arange(history.sizes["period"] + 1) * case.period / unit
    figure = Figure(figsize=(WIDTH, 4.8), layout="constrained")
    for i, axes in enumerate(figure.subplots(2, 1, sharex=True)):
        low, high, strobe = (
            1e3 * finite(history[name][i])
            for name in ("envelope_min", "envelope_max", "strobe_displacement")
        )
        colour = LAMINA_COLOURS[i]
        axes.use_sticky_edges = False
        axes.stairs(high, edges, baseline=low, fill=True, color=colour, alpha=0.3, label="range")
        axes.plot(
            edges[1:], strobe, ".", color=BLACK, markersize=3, label="at the end of the period"
        )
        axes.set_title(str(history["lamina"].to_numpy()[i]), loc="left", color=colour)
        axes.set_ylabel(f"$q_{i + 1}$ [mm]")
    legend_above(axes)
    axes.margins(x=0.01)
    axes.set_xlabel(label)
    figure.suptitle(f"{title(case)}: tip displacements within each period")
    return figure

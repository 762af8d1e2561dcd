"""Compute what docs/loads.md shows, and the paper's laminae with their weight for docs/errata.md.

    nice -n 15 .venv/bin/python scripts/evidence/loads_study.py [--part ball] [-o DOCS]

It replaces the tables of docs/loads.md, figures/loads.png and figures/upright.png. It takes about
two minutes.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from loads import pressed_bar, pressed_delamination, shaking_table
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from refinements.document import fill

import delam_fem as df
from delam_fem.api import FloatArray, Table, style
from delam_fem.studies.orbits.newton import Perturbations
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.run import run_sweep

DOCS = Path(__file__).parents[2] / "docs"
FREQUENCIES = (2.8, 4.0, 49)
"""Lowest and highest frequency of the sweep of the paper's laminae [Hz], and their number."""
SEEDS = 6
"""Largest number of searches for a limit."""
PARTS = ("ball", "contact", "upright")
RESTITUTIONS = (0.3, 0.5)
PRESSURES = (0.8, 0.5, 0.2)
ELEMENTS = (10, 20, 40)
"""Elements in a wavelength of the second harmonic."""
SHARES = (0.5, 0.9, 0.98, 1.01, 1.05, 1.2, 1.5, 2.0, 3.0)
"""Amplitudes of the base relative to the threshold."""
RESONANT = (1.0, 0.7)
"""Frequencies relative to the resonance."""


def main(arguments: list[str] | None = None) -> int:
    """Compute, write tables and the figure; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("-o", "--output", type=Path, default=DOCS)
    options = parser.parse_args(arguments)
    tables: dict[str, Table] = {}
    if "ball" in options.part:
        tables["ball"] = balls()
    if "contact" in options.part:
        levels = delamination_levels()
        tables |= {"pressed bar": bars(), "pressed delamination": delaminations(levels)}
        with style.styled():
            (options.output / "figures").mkdir(parents=True, exist_ok=True)
            figure(levels).savefig(options.output / "figures" / "loads.png")
    if "upright" in options.part:
        with style.styled():
            (options.output / "figures").mkdir(parents=True, exist_ok=True)
            upright_figure().savefig(options.output / "figures" / "upright.png")
    page = options.output / "loads.md"
    page.write_text(fill(page.read_text("utf-8"), tables, page.parent), "utf-8")
    return 0


def balls() -> Table:
    """Return phases, speeds and limits of a ball on a table, by formulas and as found."""
    rows = []
    for e in RESTITUTIONS:
        fold, doubling = shaking_table.limits(e)
        gamma = 0.5 * (fold + doubling)
        phase = shaking_table.phase_of(gamma, e)
        case = shaking_table.ball(gamma, e, phase)
        contact = "contact_stop 1"
        orbit = df.orbit(case, settle=20, channels=("base", contact))
        (step,) = np.flatnonzero(orbit.histories[contact])
        base = orbit.histories["base"][step] / case.excitation.amplitude
        impulse = orbit.histories[contact][step] * case.time_step
        speed = impulse / shaking_table.M / (1.0 + e)
        limits = [
            limit_of(e, 1.02 * fold, 0.99 * fold, "fold"),
            limit_of(e, 0.96 * doubling, 1.04 * doubling, "period doubling"),
        ]
        exact_speed = shaking_table.G * shaking_table.T / (1.0 + e)
        rows.append((
            f"{e:g}", f"{gamma:.3f}", f"{phase:.4f}", f"{math.asin(base):.4f}",
            f"{exact_speed:.4f}", f"{speed:.4f}", f"{fold:.4f}", limits[0], f"{doubling:.4f}",
            limits[1],
        ))  # fmt: skip
    header = (
        "e", "Γ", "phase [rad], formula", "found", "speed [m/s], formula", "found",
        "fold at Γ, formula", "found (95 %)", "doubling at Γ, formula", "found (95 %)",
    )  # fmt: skip
    return Table("a ball on a shaking table", header, rows)


def limit_of(e: float, start: float, stop: float, kind: str) -> str:
    """Return Γ at an event of the branch from one Γ to another, and its interval, in words.

    Close to a fold a branch may be lost; another seed then finds it.
    """
    unit = shaking_table.amplitude_of(1.0)
    case = shaking_table.ball(start, e, shaking_table.phase_of(start, e))
    for seed in range(SEEDS):
        with tempfile.TemporaryDirectory() as folder:
            data = df.follow(
                case, "excitation.amplitude", start * unit, stop * unit, folder, settle=20,
                perturbations=Perturbations(seed=seed), step=0.2, doublings=0,
            )  # fmt: skip
        for event in np.flatnonzero(data.event_kind.values == kind):
            at, low, high = (
                float(data[name].values[event]) / unit
                for name in ("event_parameter", "event_low", "event_high")
            )
            return f"{at:.4f} ({low:.4f} to {high:.4f})"
    raise ArithmeticError(f"no {kind} is found with e = {e:g}")


def bars() -> Table:
    """Return the second harmonic behind a pressed cut, exact and with more and more elements."""
    rows = []
    for pressure in PRESSURES:
        exact = pressed_bar.passing(pressure)[1]
        errors = []
        for n in ELEMENTS:
            case = pressed_bar.cut_bar(pressure, n, steps=6400, waves=0.5)
            errors.append(pressed_bar.harmonics_of(case)[1] / exact - 1.0)
        rows.append((f"{pressure:g}", f"{exact:.4f}", *(f"{100.0 * e:+.2f} %" for e in errors)))
    header = ("P/a", "second harmonic / a", *(f"error, {n} elements" for n in ELEMENTS))
    return Table("a pressed bar", header, rows)


def delamination_levels() -> FloatArray:
    """Return the second harmonic of a beam with a pressed delamination [dB], shape (2, n)."""
    case = pressed_delamination.beam()
    resonance = pressed_delamination.resonance(case)
    levels = []
    for share in RESONANT:
        frequency = share * resonance
        opening = pressed_delamination.threshold(case, frequency)
        levels.append([
            pressed_delamination.harmonics_of(case, frequency, amplitude * opening)[0]
            for amplitude in SHARES
        ])  # fmt: skip
    return np.array(levels)


def delaminations(levels: FloatArray) -> Table:
    """Return the second harmonic over the amplitude, on and off resonance."""
    header = ("amplitude / threshold", *(f"{share:g}" for share in SHARES))
    rows = [
        (f"{share:g} f₁", *(f"{level:.0f} dB" for level in row))
        for share, row in zip(RESONANT, levels, strict=True)
    ]
    return Table("a pressed delamination", header, rows)


def figure(levels: FloatArray) -> Figure:
    """Return the figure of the page."""
    drawn = Figure(figsize=(style.WIDTH, 3.4), layout="constrained")
    bar, beam = drawn.subplots(1, 2)
    assert isinstance(bar, Axes)
    assert isinstance(beam, Axes)
    pressures = np.linspace(0.02, 1.2, 119)
    exact = np.array([pressed_bar.passing(p, 3) for p in pressures])
    places = (0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.1)
    computed = np.array([
        pressed_bar.harmonics_of(pressed_bar.cut_bar(p, 20, steps=1600, waves=0.5), count=3)
        for p in places
    ])  # fmt: skip
    for k, colour in enumerate((style.BLACK, style.BLUE, style.VERMILLION)):
        bar.plot(pressures, exact[:, k], color=colour, label=f"harmonic {k + 1}")
        bar.plot(places, computed[:, k], "o", color=colour, markersize=4.0)
    bar.set(xlabel="pressure / amplitude of the wave  P/a  [–]", ylabel="behind the cut  [a]")
    bar.set_title("a pressed bar: exact (lines), 20 elements (points)", fontsize=9.0)
    bar.legend(loc="center right", fontsize=8.0)
    for share, row, colour in zip(RESONANT, levels, (style.BLUE, style.VERMILLION), strict=True):
        beam.plot(SHARES, row, "o-", color=colour, markersize=4.0, label=f"at {share:g} f₁")
    beam.axvline(1.0, color=style.BASE_COLOUR, linewidth=1.0)
    beam.set(xlabel="amplitude of the base / threshold  [–]", ylabel="second harmonic  [dB]")
    beam.set_title("a pressed delamination", fontsize=9.0)
    beam.legend(loc="lower right", fontsize=8.0)
    return drawn


def strobes(weight: dict[str, float], order: str) -> tuple[FloatArray, FloatArray]:
    """Return frequencies [Hz] and strobes of the thin tip [mm] of the paper's laminae, (n, 30)."""
    low, high, count = FREQUENCIES
    sweep = sweep_of({
        "name": "upright", "base": "paper", "order": order,
        "set": {"time.periods": 150, "output.fields_per_period": 0} | weight,
        "record": {"strobes": 30},
        "axis": [{"key": "excitation.frequency", "start": low, "stop": high, "count": count}],
    })  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        data = run_sweep(sweep, Path(folder) / "sweep", "serial", is_confirmed=True)
        tips = 1e3 * data["strobe_displacement"].isel(lamina=1).values
        frequencies = data["frequency"].values
    return frequencies, tips.reshape(len(frequencies), -1)


def upright_figure() -> Figure:
    """Return strobes of the thin tip over the frequency, without weight and upright."""
    drawn = Figure(figsize=(style.WIDTH, 4.6), layout="constrained")
    panels = drawn.subplots(2, 1, sharex=True, sharey=True)
    rows = (("without weight", {}), ("upright", {"gravity.inclination": 90.0}))
    for panel, (title, weight) in zip(panels, rows, strict=True):
        for order, colour in (("up", style.BLUE), ("down", style.VERMILLION)):
            frequencies, tips = strobes(weight, order)
            panel.plot(
                np.repeat(frequencies, tips.shape[1]), tips.ravel(), ".", color=colour,
                markersize=2.0, label=f"frequency {order}",
            )  # fmt: skip
        panel.set(ylabel="thin tip at t = nT  [mm]")
        panel.set_title(title, fontsize=9.0)
    panels[0].legend(loc="upper right", fontsize=8.0)
    panels[1].set_xlabel("frequency of the base  [Hz]")
    return drawn


if __name__ == "__main__":
    sys.exit(main())

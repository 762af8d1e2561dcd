"""Compare models of one case: what is measured of each, tables, files, a picture."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.api import (
    CHANNEL_MEASURES,
    WITHOUT_FRAMES,
    Case,
    CaseError,
    CaseSource,
    EngineName,
    Finding,
    FloatArray,
    Report,
    Structure,
    Table,
    assemble,
    diagnostics,
    factored,
    find_case,
    of_references,
    require,
    require_channels,
    require_held,
    style,
)
from delam_fem.studies.modes.frequencies import modes_of, structure_modes

Name = Literal["beam", "plane-stress", "solid", "modes"]
NAMES: tuple[Name, ...] = get_args(Name)
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Variant:
    """One model of a case.

    Attributes:
        name: name of the model.
        case: the case with this model.
        structure: the discretised case.
        engine: the engine that computes its steps.
        seconds: processor time of the assembly, or of the reduction [s].
    """

    name: str
    case: Case
    structure: Structure
    engine: EngineName
    seconds: float


def variants(case: Case, names: Sequence[str], modes: int) -> list[Variant]:
    """Return the models of a case in the order of their names.

    Args:
        case: the case; its own `model` gives Poisson's ratio, degree, layers and strips.
        names: of `NAMES`; "modes" reduces the model that is named before it.
        modes: number of modes of each body of a reduced model.

    Raises:
        CaseError: there is no such model, none to reduce, or one cannot be made.
    """
    if unknown := [name for name in names if name not in NAMES]:
        raise CaseError(f"models: expected some of {', '.join(NAMES)}, given {unknown[0]!r}")
    result: list[Variant] = []
    for name in names:
        begin = time.process_time()
        if name == "modes":
            if not result:
                raise CaseError(
                    "models: expected a model before modes, the one that it reduces, for example "
                    "plane-stress,modes"
                )
            from delam_fem.api import reduced_case, struck, with_sensors

            full_variant = result[-1]
            reduction = reduced_case(full_variant.case, modes)
            require(
                all(sensor.quantity != "strain" for sensor in case.sensor), "sensor: models: modes",
                "no strains, which need the shapes of the elements", "strain",
            )  # fmt: skip
            structure = with_sensors(struck(reduction.structure, case), full_variant.case)
            variant_case = full_variant.case
            label = f"{full_variant.name}, {modes} modes"
        else:
            variant_case = with_model(case, name)
            label = name
            structure = assemble(variant_case, needs_dolfinx=False)
        engine: EngineName = "compiled" if name in ("beam", "modes") else "petsc"
        seconds = time.process_time() - begin
        result.append(Variant(label, variant_case, structure, engine, seconds))
    return result


def with_model(case: Case, kind: str) -> Case:
    """Return the case with another kind of model, whose mesh is made from `mesh.elements`."""
    if case.mesh.file is not None and kind != case.model.kind:
        raise CaseError(
            f"models: mesh.file is a mesh of kind {case.model.kind!r}; give mesh.elements for "
            f"{kind!r}, given {Path(case.mesh.file).name}"
        )
    return case.with_overrides({"model.kind": kind, "model.file": None})


ENERGIES = ("base_work", "force_work", "damping_loss", "contact_damping_loss", "impact_loss")
"""Columns of the ledger that explain where the energy of a period goes."""

NEAR = 0.1
"""Distance from the reference probes, in lengths, within which an impact is a strike there."""


@dataclass(frozen=True)
class Motion:
    """The motion of one model at one frequency.

    Attributes:
        frequency: frequency of the excitation [Hz].
        time: times after each step, shape (n_steps,) [s].
        values: histories of channels, shape (n_channels, n_steps).
        strike: time of the first impact nearer to the probes than `NEAR` lengths [s]; infinite if
            there is none.
        summary: numbers of the second half of the run; see `diagnostics.summary_of`.
        energies: means over the periods of the second half, by the names in `ENERGIES` [J].
        residual: largest part of a period's energy that the ledger does not explain [-].
        x: positions along the contact line, shape (n_points,) [m].
        impulse: mean impulse per period and length, shape (n_points,) [N s/m].
        cost: duration of a step by the clock [µs], and steps in a period.
        units: units of the channels by their names.
    """

    frequency: float
    time: FloatArray
    values: FloatArray
    strike: float
    summary: dict[str, Any]
    energies: dict[str, float]
    residual: float
    x: FloatArray
    impulse: FloatArray
    cost: tuple[float, float]
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def measures(self) -> dict[str, dict[str, float]]:
        """Measures of each channel over the second half of the run, by name."""
        late = self.values[:, self.time.size // 2 :]
        return {
            name: {key: float(measure.of(row)) for key, measure in CHANNEL_MEASURES.items()}
            for name, row in zip(self.units, late, strict=True)
        }


@dataclass(frozen=True)
class ModelResult:
    """What one model makes of a case.

    Attributes:
        name: name of the model.
        dofs: number of unknowns.
        pairs: number of contact pairs.
        seconds: processor time of the assembly [s].
        frequencies: natural frequencies, delaminations open, shape (k,) [Hz].
        labels: names of these frequencies.
        compliance: displacement of each reference probe under a unit force there, shape
            (n_laminae,) [m/N].
        motions: its motions, one for each frequency.
    """

    name: str
    dofs: int
    pairs: int
    seconds: float
    frequencies: FloatArray
    labels: tuple[str, ...]
    compliance: FloatArray
    motions: tuple[Motion, ...]


def measure(
    model: Variant,
    frequencies: tuple[float, ...],
    periods: int,
    modes: int,
    channels: Sequence[str],
) -> ModelResult:
    """Measure natural frequencies, compliance and motions of one model.

    Args:
        model: the model.
        frequencies: frequencies of the excitation [Hz].
        periods: number of periods of each motion, which begins at rest.
        modes: number of natural frequencies of each lamina, or of a bonded stack.
        channels: names of channels whose histories are kept.

    Raises:
        CaseError: a motion cannot be computed, or has no such channel.
    """
    o = model.structure.operators
    count = len(model.structure.layout.parts)
    factor = factored(o.stiffness, o.mass)
    if model.case.has_exact_laminae:
        natural = modes_of(model.structure, model.case, modes).frequencies.ravel()
        owners = [f", {lamina.name}" for lamina in model.case.lamina]
    else:
        natural = structure_modes(model.structure, model.case, modes, factor=factor).frequencies
        owners = [""]
    rows = o.probes[:count]
    bent = factor.solve(rows.T.toarray())
    del factor
    if frequencies:
        # compiled code is loaded before costs are measured
        _motion(model, frequencies[0], 1, channels)
    return ModelResult(
        model.name,
        o.n_dofs,
        o.n_pairs,
        model.seconds,
        np.asarray(natural),
        tuple(f"f{k + 1}{owner}" for owner in owners for k in range(natural.size // len(owners))),
        np.einsum("ij,ji->i", rows.toarray(), bent),
        tuple(_motion(model, frequency, periods, channels) for frequency in frequencies),
    )


def _motion(model: Variant, frequency: float, periods: int, channels: Sequence[str]) -> Motion:
    """Compute the motion of a model from rest at one frequency.

    Raises:
        CaseError: there is no such channel, or it has samples of its own.
    """
    from delam_fem.api import run  # dolfinx comes with it

    span: dict[str, object] = {"time.periods": periods, "output.window_periods": periods}
    keys: dict[str, object] = {"excitation.frequency": frequency, **WITHOUT_FRAMES}
    case = model.case.with_overrides(span | keys)
    result = run(case, model.engine, structure=model.structure)
    record = result.record
    stepped = [name for name, channel in record.items() if channel.dims == ("time",)]
    require_channels(channels, stepped, "compare: channel")
    history = result.history
    t = history["time"].to_numpy()
    late = diagnostics.last_periods(history, case, math.ceil(periods / 2))
    x = history["x"].to_numpy()
    is_late = history["event_time"].to_numpy() >= float(late["time"][0])
    if "event_interface" in history:
        is_late &= history["event_interface"].to_numpy() == 0
    node = history["event_node"].to_numpy()[is_late]
    total = np.bincount(node, history["event_impulse"].to_numpy()[is_late], minlength=x.size)
    impulse = np.asarray(total / np.gradient(x))  # per length along the contact line
    second_half = slice(periods // 2, None)
    return Motion(
        frequency,
        t,
        np.array([record[name].to_numpy() for name in channels]),
        _first_strike(history),
        diagnostics.summary(late.isel(period=second_half), case),
        {name: float(history[f"energy_{name}"][second_half].mean()) for name in ENERGIES},
        float(result.summary["energy_residual"]),
        x,
        impulse / math.ceil(periods / 2),
        (result.summary["microseconds_per_step"], result.summary["steps"] / periods),
        {name: record[name].attrs["units"] for name in channels},
    )


def _first_strike(history: xr.Dataset) -> float:
    """Return the time of the first impact near the reference probes [s]; infinite without one."""
    x = history["x"].to_numpy()
    apart = np.abs(x[history["event_node"].to_numpy()] - x[diagnostics.probe_node(history)])
    near = history["event_time"].to_numpy()[apart <= NEAR * np.ptp(x)]
    is_closed = diagnostics.ProbeMotion.of(history).is_closed.any(axis=0)
    closed = history["time"].to_numpy()[is_closed]
    return float(min(near.min(initial=math.inf), closed.min(initial=math.inf)))


COLOURS = (style.BLACK, style.VERMILLION, style.BLUE, style.GREEN, style.ORANGE)
SHOWN_PERIODS = 4
"""Periods of the histories that are shown, from rest."""


MODES, PERIODS = 3, 20
"""Natural frequencies of each lamina, and periods of each motion, unless others are asked for."""
Rows = list[tuple[str, ...]]


@dataclass(frozen=True)
class ModelComparison(Finding):
    """Results of several models of one case, of which the first is compared with the others.

    Attributes:
        case: the case.
        models: results of each model.
    """

    case: Case
    models: tuple[ModelResult, ...]

    def linear_rows(self) -> Rows:
        """Return rows with a column for each model: sizes, frequencies, compliance."""
        first = self.models[0]
        sizes = (
            ("unknowns", [str(model.dofs) for model in self.models]),
            ("contact pairs", [str(model.pairs) for model in self.models]),
            ("assembly [s]", [f"{model.seconds:.2g}" for model in self.models]),
        )
        rows = [(name, *values) for name, values in sizes]
        for k, label in enumerate(first.labels):
            values = [model.frequencies[k] for model in self.models]
            rows.append((f"{label} [Hz]", *_relative(values, 6)))
        for k, lamina in enumerate(self.case.lamina):
            values = [model.compliance[k] for model in self.models]
            rows.append((f"compliance, {lamina.name} [m/N]", *_relative(values, 5)))
        return rows

    def motion_rows(self, number: int) -> Rows:
        """Return rows of one motion with a column for each model.

        "Difference until then" is the largest one of the channels from those of the first model
        before the first strike near the reference probes, relative to their largest value.

        Args:
            number: number of the frequency.
        """
        first = self.models[0].motions[number]
        columns = [_column(model.motions[number], first, self.case) for model in self.models]
        return [(name, *(column[name] for column in columns)) for name in columns[0]]

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        heading = ("", *(model.name for model in self.models))
        first = self.models[0].motions
        models = [
            {
                "name": model.name,
                "dofs": model.dofs,
                "pairs": model.pairs,
                "assembly_seconds": model.seconds,
                "frequencies": model.frequencies,
                "compliance": model.compliance,
                "motions": [_numbers(*pair) for pair in zip(model.motions, first, strict=True)],
            }
            for model in self.models
        ]
        return Report(
            name="models",
            numbers={"models": models},
            tables=[
                Table(f"models of case {self.case.name}", heading, self.linear_rows()),
                *(
                    Table(f"{motion.frequency:g} Hz", heading, self.motion_rows(k))
                    for k, motion in enumerate(first)
                ),
            ],
            pictures={"models": (self.figure, "")},
        )

    def figure(self) -> Figure:
        """Return histories of all models, a panel for each unit, and impulses along laminae."""
        first = self.models[0].motions[0]
        units = list(dict.fromkeys(first.units.values()))
        n = len(self.models[0].motions)
        figure = Figure(figsize=(style.WIDTH, 2.6 * n * len(units) + 0.6), layout="constrained")
        grid = figure.subplots(n * len(units), 2, squeeze=False, width_ratios=(2, 1))
        for k, motion in enumerate(self.models[0].motions):
            rows = grid[k * len(units) : (k + 1) * len(units)]
            for spare in rows[1:, 1]:
                figure.delaxes(spare)
            for (histories, _), unit in zip(rows, units, strict=True):
                self._histories(histories, k, unit)
            along = rows[0, 1]
            for model, colour in zip(self.models, cycle(COLOURS), strict=False):
                of_model = model.motions[k]
                along.plot(of_model.x, 1e3 * of_model.impulse, color=colour, lw=1.0)
            rows[0, 0].set_title(f"{motion.frequency:g} Hz; thin line: first strike")
            along.set(ylabel="impulse [mN s/m per period]", title="second half of the run")
            along.set_xlabel("x [m]")
        grid[-1, 0].set_xlabel("periods")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        figure.suptitle(f"{self.case.name}: {', '.join(first.units)} (full, dashed, …) by model")
        return figure

    def _histories(self, axes: Axes, k: int, unit: str) -> None:
        """Draw the first periods of the channels of a unit, of all models at one frequency."""
        name, factor = style.shown_unit(unit)
        for model, colour in zip(self.models, cycle(COLOURS), strict=False):
            motion = model.motions[k]
            turns = motion.time * motion.frequency
            is_shown = turns <= SHOWN_PERIODS
            rows = [
                row
                for row, unit_of_channel in enumerate(motion.units.values())
                if unit_of_channel == unit
            ]
            for number, row in enumerate(rows):
                axes.plot(
                    turns[is_shown],
                    factor * motion.values[row, is_shown],
                    ("-", "--", ":", "-.")[number % 4],
                    color=colour,
                    lw=1.0,
                    label=None if number else model.name,
                )
            if motion.strike * motion.frequency <= SHOWN_PERIODS:
                axes.axvline(motion.strike * motion.frequency, color=colour, lw=0.5)
        names = [
            channel
            for channel, unit_of_channel in self.models[0].motions[k].units.items()
            if unit_of_channel == unit
        ]
        axes.set_ylabel(f"{', '.join(names)} [{name}]")


def compare_models(
    case: CaseSource,
    names: Sequence[str],
    *,
    frequencies: Sequence[float] = (),
    periods: int = PERIODS,
    natural: int = MODES,
    modes: int = 20,
    channels: Sequence[str] = (),
) -> ModelComparison:
    """Compute one case as several models.

    Args:
        case: the case.
        names: "beam", "plane-stress", "solid"; "modes" reduces the one before it.
        frequencies: of the excitation [Hz]; none: that of the case.
        periods: number of periods of each motion, which begins at rest.
        natural: number of natural frequencies of each lamina, or of a bonded stack.
        modes: number of modes of a reduced model.
        channels: channels that are compared; none: the reference probes of all laminae.

    Raises:
        CaseError: a model or a motion cannot be computed, there is no such channel, or something
            floats, which has neither compliance nor frequency.
    """
    case = find_case(case)
    require(periods >= 2, "periods", "at least 2", periods)
    if not case.is_harmonic:
        raise CaseError(
            "compare: models are compared by periodic motions; expected a harmonic excitation or a "
            f"harmonic force, given kind {case.excitation.kind!r}"
        )
    require_held(case, "compare")
    laminae = [lamina.name for lamina in case.lamina]
    names_of_channels = tuple(channels) or tuple(of_references(laminae))
    at = tuple(frequencies) or (case.excitation.top_frequency,)
    measured_models = []
    for model in variants(case, names, modes):
        _log.info("computing %s", model.name)
        measured_models.append(measure(model, at, periods, natural, names_of_channels))
    return ModelComparison(case, tuple(measured_models))


def difference_until(motion: Motion, first: Motion) -> tuple[float, float]:
    """Return the first strike of either motion [s], and the difference of channels until then.

    The difference is the largest of all channels and steps, relative to the largest value of the
    same channel in the motion `first` until then; channels that do not move there do not count.
    """
    end = min(motion.strike, first.strike)
    n = min(motion.time.size, first.time.size)
    before = first.time[:n] < end
    a, b = (m.values[:, :n][:, before] for m in (motion, first))
    apart, size = (np.abs(values).max(axis=1, initial=0.0) for values in (a - b, b))
    moves = size > 0.0
    return end, float((apart[moves] / size[moves]).max(initial=0.0))


def _column(motion: Motion, first: Motion, case: Case) -> dict[str, str]:
    """Return the numbers of a motion by their names."""
    period, (end, apart) = 1.0 / motion.frequency, difference_until(motion, first)
    s, energies = motion.summary, motion.energies
    names = [lamina.name for lamina in case.lamina]
    d, scatter = s["distortion_factor"], s["strobe_scatter"]
    ranges = {}
    for name, measures in motion.measures.items():
        unit, factor = style.shown_unit(motion.units[name])
        low, high = (factor * measures[key] for key in ("min", "max"))
        ranges[f"{name} [{unit}]"] = f"{low:.4g} … {high:.4g}"
    work = energies["base_work"] + energies["force_work"]
    damping = energies["damping_loss"] + energies["contact_damping_loss"]
    return {
        "first strike [T]": "–" if np.isinf(end) else f"{end / period:.3f}",
        "difference until then": f"{apart:.2%}",
        **ranges,
        "contacts per period": f"{s['tip_contacts_per_period'] or 0.0:.2f}",
        "motion": (s["periodicity_class"] or "–"),
        "scatter": "–" if scatter is None else f"{scatter:.2%}",
        **{f"d, {name}": "–" if d is None else f"{d[k]:.2%}" for k, name in enumerate(names)},
        "work [mJ per period]": f"{1e3 * work:.3g}",
        "damping": f"{1e3 * damping:.3g}",
        "impacts": f"{1e3 * energies['impact_loss']:.3g}",
        "ledger's residual": f"{motion.residual:.0e}",
        "steps per period": f"{motion.cost[1]:.0f}",
        "cost of a step [µs]": f"{motion.cost[0]:.3g}",
    }


def _numbers(motion: Motion, first: Motion) -> dict[str, object]:
    """Return the numbers of a motion for models.json."""
    end, apart = difference_until(motion, first)
    keys = ("tip_min", "tip_max", "tip_contacts_per_period", "periodicity_class", "strobe_scatter",
            "distortion_factor", "minimum_tip_gap")  # fmt: skip
    return {
        "frequency": motion.frequency,
        "first_strike": None if np.isinf(end) else end,
        "difference_until_then": apart,
        "channels": motion.measures,
        **{key: motion.summary[key] for key in keys},
        "energies": motion.energies,
        "energy_residual": motion.residual,
        "impulse_x": motion.x.tolist(),
        "impulse_per_length": motion.impulse.tolist(),
        "microseconds_per_step": motion.cost[0],
        "steps_per_period": motion.cost[1],
    }


def _relative(values: Sequence[float], digits: int) -> list[str]:
    """Return numbers, each with its relative difference from the first."""
    first = values[0]
    changes = ["", *(f" ({round(value / first - 1.0, 4) + 0.0:+.2%})" for value in values[1:])]
    return [f"{v:.{digits}g}{change}" for v, change in zip(values, changes, strict=True)]

"""What is measured of one model: frequencies, compliance, and the motion at some frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from scipy.sparse.linalg import splu

from delam_fem.numerics.arrays import FloatArray
from delam_fem.results import diagnostics
from delam_fem.studies.models.variants import Variant
from delam_fem.studies.modes import modes_of
from delam_fem.studies.structure_modes import structure_modes

ENERGIES = ("base_work", "force_work", "damping_loss", "contact_damping_loss", "impact_loss")
"""Columns of the ledger that explain where the energy of a period goes."""

NEAR = 0.1
"""Distance from the reference probes, in lengths, within which an impact is a strike there."""


@dataclass(frozen=True)
class Motion:
    """The motion of one model at one frequency.

    Attributes:
        frequency: of the excitation [Hz].
        time: shape (n_steps,) [s].
        tips: displacements of the reference probes, shape (n_laminae, n_steps) [m].
        strike: time of the first impact within a tenth of the length of the probes [s]; infinite if
            there is none.
        summary: numbers of the second half of the run; see `diagnostics.summary_of`.
        energies: means over the periods of the second half, by the names in `ENERGIES` [J].
        residual: largest part of a period's energy that the ledger does not explain [-].
        x: positions along the contact line, shape (n_points,) [m].
        impulse: mean impulse of a period and length, shape (n_points,) [N s/m].
        cost: duration of a step by the clock [µs], and steps in a period.
    """

    frequency: float
    time: FloatArray
    tips: FloatArray
    strike: float
    summary: dict[str, Any]
    energies: dict[str, float]
    residual: float
    x: FloatArray
    impulse: FloatArray
    cost: tuple[float, float]


@dataclass(frozen=True)
class Measured:
    """What one model makes of a case.

    Attributes:
        name: name of the model.
        dofs: number of unknowns.
        pairs: number of contact pairs.
        seconds: processor time of the assembly [s].
        frequencies: natural frequencies, delaminations open, shape (k,) [Hz].
        labels: what each of them belongs to.
        compliance: displacement of each reference probe under a unit force there, shape
            (n_laminae,) [m/N].
        motions: one for each frequency.
    """

    name: str
    dofs: int
    pairs: int
    seconds: float
    frequencies: FloatArray
    labels: tuple[str, ...]
    compliance: FloatArray
    motions: tuple[Motion, ...]


def measure(model: Variant, frequencies: tuple[float, ...], periods: int, modes: int) -> Measured:
    """Measure one model.

    Args:
        model: the model.
        frequencies: of the excitation [Hz].
        periods: number of periods of each motion, which begins at rest.
        modes: number of natural frequencies of each lamina, or of a bonded stack.

    Raises:
        CaseError: a motion cannot be computed.
    """
    o, count = model.structure.operators, len(model.structure.layout.parts)
    if model.case.is_apart and not model.case.point_mass:
        natural = modes_of(model.structure, model.case, modes).frequencies.ravel()
        owners = [f", {lamina.name}" for lamina in model.case.lamina]
    else:
        natural, owners = structure_modes(model.structure, model.case, modes).frequencies, [""]
    rows = o.probes[:count]
    bent = splu(o.stiffness.tocsc()).solve(rows.T.toarray())
    if frequencies:
        _motion(model, frequencies[0], 1)  # compiled code is loaded before costs are measured
    return Measured(
        model.name,
        o.n_dofs,
        o.n_pairs,
        model.seconds,
        np.asarray(natural),
        tuple(f"f{k + 1}{owner}" for owner in owners for k in range(natural.size // len(owners))),
        np.einsum("ij,ji->i", rows.toarray(), bent),
        tuple(_motion(model, frequency, periods) for frequency in frequencies),
    )


def _motion(model: Variant, frequency: float, periods: int) -> Motion:
    """Compute the motion of a model from rest at one frequency."""
    from delam_fem.pipeline import run  # dolfinx comes with it

    span: dict[str, object] = {"time.periods": periods, "output.window_periods": periods}
    keys: dict[str, object] = {"excitation.frequency": frequency, "output.fields_per_period": 0}
    case = model.case.with_overrides(span | keys)
    found = run(case, model.engine, structure=model.structure)
    history = found.history
    t = history["time"].to_numpy()
    late = diagnostics.last_periods(history, case, math.ceil(periods / 2))
    x, impulse = _along(history, model, float(late["time"][0]))
    kept = slice(periods // 2, None)
    return Motion(
        frequency,
        t,
        history["tip_displacement"].to_numpy(),
        _first_strike(history),
        diagnostics.summary(late.isel(period=kept), case),
        {name: float(history[f"energy_{name}"][kept].mean()) for name in ENERGIES},
        float(found.summary["energy_residual"]),
        x,
        impulse / math.ceil(periods / 2),
        (found.summary["microseconds_per_step"], found.summary["steps"] / periods),
    )


def _first_strike(history: xr.Dataset) -> float:
    """Return the time of the first impact near the reference probes [s]; infinite without one."""
    x = history["x"].to_numpy()
    apart = np.abs(x[history["event_node"].to_numpy()] - x[diagnostics.probe_node(history)])
    near = history["event_time"].to_numpy()[apart <= NEAR * np.ptp(x)]
    closed = history["time"].to_numpy()[diagnostics.tip_closed(history)]
    return float(min(near.min(initial=math.inf), closed.min(initial=math.inf)))


def _along(history: xr.Dataset, model: Variant, since: float) -> tuple[FloatArray, FloatArray]:
    """Return positions along the contact line, and the impulse per length there since a time."""
    x = history["x"].to_numpy()
    is_late = history["event_time"].to_numpy() >= since
    if "event_interface" in history:
        is_late &= history["event_interface"].to_numpy() == 0
    node = history["event_node"].to_numpy()[is_late]
    total = np.bincount(node, history["event_impulse"].to_numpy()[is_late], minlength=x.size)
    return x, np.asarray(total / np.gradient(x))

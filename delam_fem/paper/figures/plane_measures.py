"""What a plane of parameters (Fig. 15) is measured by: kinds of motion, scatter, main effects."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.numerics import attractors
from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.results.diagnostics import STROBES

if TYPE_CHECKING:
    import xarray as xr


KINDS = ("one-periodic", "higher order", "quasi-periodic", "irregular", "diverged", "failed")
"""The paper's names of `attractors.KINDS`, in their order."""
ONE_CONTACT = (0.95, 1.05)
"""Tip contacts per period that count as one."""


def one_period_scatter(strobes: FloatArray, half_range: FloatArray) -> FloatArray:
    """Return the rms difference of strobes one period apart in half ranges, of the worse tip.

    Args:
        strobes: shape (..., 2, n) [m].
        half_range: half peak-to-peak of both tips, shape (..., 2) [m].

    Returns:
        Shape (...) [-].
    """
    change = np.diff(strobes[..., -STROBES:], axis=-1)
    scatter: FloatArray = (np.sqrt((change**2).mean(axis=-1)) / half_range).max(axis=-1)
    return scatter


def plane_numbers(data: xr.Dataset) -> dict[str, Any]:
    """Return kinds, scatter and amplitudes of a plane, and how far each axis changes them."""
    first, second = axes_of(data)
    data = data.transpose(first, second, "lamina", "strobe", ...)
    strobes, amplitude = data["strobe_displacement"].to_numpy(), data["tip_amplitude"].to_numpy()
    kind = attractors.kinds_of_motion(
        data["outcome"].to_numpy(), data["periodicity"].to_numpy(), strobes
    )
    contacts = data["tip_contacts_per_period"].to_numpy()
    n = max(kind.size, 1)
    completed = np.isfinite(amplitude).all(axis=-1)
    return {
        first: data[first].to_numpy(),
        second: data[second].to_numpy(),
        "kind": kind,
        "kinds": dict(enumerate(KINDS)),
        "share": {name: float((kind == k).sum() / n) for k, name in enumerate(KINDS)},
        "scatter": one_period_scatter(strobes, amplitude),
        "tip_amplitude_m": amplitude,
        "tip_contacts_per_period": contacts,
        "one_contact_share": float(
            ((contacts >= ONE_CONTACT[0]) & (contacts <= ONE_CONTACT[1])).sum() / n
        ),
        "amplitude_spread": amplitude[completed].std(axis=0) / amplitude[completed].mean(axis=0),
        "amplitude_by_first": main_effect(amplitude, 0),
        "amplitude_by_second": main_effect(amplitude, 1),
    }


def best_decade(damping: FloatArray, kind: IntArray, amplitude: FloatArray) -> dict[str, Any]:
    """Return the decade of the penalty law's damping with the most one-periodic points.

    Args:
        damping: c, increasing, shape (m,) [N s/m].
        kind: of motion, 0 is one-periodic, shape (m, n).
        amplitude: shape (m, n, 2) [m].
    """
    best: dict[str, Any] = {"one_periodic": -1.0}
    for low in damping[damping <= damping[-1] / 10.0 * (1.0 + 1e-9)]:
        inside = (damping >= low) & (damping <= 10.0 * low * (1.0 + 1e-9))
        share = float((kind[inside] == 0).mean())
        if share > best["one_periodic"]:
            chosen = amplitude[inside].reshape(-1, 2)
            spread = np.nanstd(chosen, axis=0) / np.nanmean(chosen, axis=0)
            best = {"from": float(low), "one_periodic": share, "amplitude_spread": spread}
    return best


def axes_of(data: xr.Dataset) -> tuple[str, str]:
    """Return the names of a plane's axes: damping or restitution, stiffness."""
    first = "restitution" if "restitution" in data.dims else "penalty_damping"
    return first, "penalty_stiffness"


def main_effect(values: FloatArray, axis: int) -> FloatArray:
    """Return the share of a plane's variance that the means along one axis have, (2,) [-]."""
    means = np.nanmean(values, axis=1 - axis)
    total = np.nanvar(values, axis=(0, 1))
    share: FloatArray = np.divide(
        np.nanvar(means, axis=0), total, out=np.zeros_like(total), where=total > 0
    )
    return share

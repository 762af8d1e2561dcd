"""Measure a plane of two parameters (Fig. 15): kinds of motion, scatter, main effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from delam_fem.numerics import attractors
from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.paper.piece import NOT_IN_JSON, Numbers
from delam_fem.results.diagnostics import STROBES

if TYPE_CHECKING:
    import xarray as xr


KINDS = (
    "one-periodic", "higher order", "quasi-periodic", "irregular", "diverged", "failed",
    "undecided", "not settled",
)  # fmt: skip
"""The paper's names for the kinds of motion, in the order of `attractors.KINDS`."""
THRESHOLDS = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 15.0, 20.0, 30.0, 50.0)
"""Largest scatters of a one-periodic motion that are tried [%]."""
ONE_CONTACT = (0.95, 1.05)
"""A number of tip contacts per period in this range counts as one."""


def one_period_scatter(strobes: FloatArray, half_range: FloatArray) -> FloatArray:
    """Return the rms difference of strobes one period apart, in half ranges, of the worse tip.

    Args:
        strobes: displacements of both tips at the ends of periods, shape (..., 2, n) [m].
        half_range: half peak-to-peak of both tips, shape (..., 2) [m].

    Returns:
        Scatter, shape (...) [-].
    """
    change = np.diff(strobes[..., -STROBES:], axis=-1)
    scatter: FloatArray = (np.sqrt((change**2).mean(axis=-1)) / half_range).max(axis=-1)
    return scatter


@dataclass(frozen=True)
class Plane(Numbers):
    """The motions over a plane of two parameters with m and n values.

    Attributes:
        kind: kind of motion, an index into `KINDS`, shape (m, n).
        kinds: names of these indices.
        share: share of the points by kind [-].
        scatter: rms difference of strobes one period apart, in half ranges, shape (m, n) [-].
        one_periodic_by_threshold: share of the points whose scatter is below a threshold, by the
            threshold [%] [-].
        tip_amplitude_m: half peak-to-peak of both tips, shape (m, n, 2).
        tip_contacts_per_period: tip contacts per period, shape (m, n).
        one_contact_share: share of the points with one tip contact per period [-].
        amplitude_spread: standard deviation over mean of the amplitudes, shape (2,) [-].
        amplitude_by_first, amplitude_by_second: share of the amplitudes' variance that the first
            and the second parameter explain, shape (2,) [-].
        axes: names of both parameters.
        first, second: values of both parameters, shapes (m,) and (n,).
    """

    kind: IntArray
    kinds: dict[int, str]
    share: dict[str, float]
    scatter: FloatArray
    one_periodic_by_threshold: dict[float, float]
    tip_amplitude_m: FloatArray
    tip_contacts_per_period: FloatArray
    one_contact_share: float
    amplitude_spread: FloatArray
    amplitude_by_first: FloatArray
    amplitude_by_second: FloatArray
    axes: tuple[str, str] = field(metadata=NOT_IN_JSON)
    first: FloatArray = field(metadata=NOT_IN_JSON)
    second: FloatArray = field(metadata=NOT_IN_JSON)

    @property
    def one_periodic_within(self) -> tuple[float, float]:
        """Share of one-periodic points without and with the undecided ones [-]."""
        share = self.share["one-periodic"]
        return share, share + self.share.get("undecided", 0.0)

    def to_json(self) -> Mapping[str, Any]:
        """Return both parameters under their own names, and the other fields."""
        parameters = dict(zip(self.axes, (self.first, self.second), strict=True))
        return {**parameters, **super().to_json()}


def plane_of(data: xr.Dataset) -> Plane:
    """Return kinds, scatter and amplitudes of a plane, and the main effect of each axis."""
    first, second = axes_of(data)
    data = data.transpose(first, second, "lamina", "strobe", ...)
    strobes, amplitude = data["strobe_displacement"].to_numpy(), data["tip_amplitude"].to_numpy()
    kind = attractors.kinds_of_motion(
        data["outcome"].to_numpy(),
        data["periodicity"].to_numpy(),
        strobes,
        data["is_decided"].to_numpy() != 0.0,
        data["settled"].to_numpy() != 0.0 if "settled" in data else None,
    )
    contacts = data["tip_contacts_per_period"].to_numpy()
    n = max(kind.size, 1)
    scatter = one_period_scatter(strobes, amplitude)
    completed = np.isfinite(amplitude).all(axis=-1)
    return Plane(
        kind=kind,
        kinds=dict(enumerate(KINDS)),
        share={name: float((kind == k).sum() / n) for k, name in enumerate(KINDS)},
        scatter=scatter,
        one_periodic_by_threshold={
            percent: float((100.0 * scatter < percent).sum() / n) for percent in THRESHOLDS
        },
        tip_amplitude_m=amplitude,
        tip_contacts_per_period=contacts,
        one_contact_share=float(
            ((contacts >= ONE_CONTACT[0]) & (contacts <= ONE_CONTACT[1])).sum() / n
        ),
        amplitude_spread=amplitude[completed].std(axis=0) / amplitude[completed].mean(axis=0),
        amplitude_by_first=main_effect(amplitude, 0),
        amplitude_by_second=main_effect(amplitude, 1),
        axes=(first, second),
        first=data[first].to_numpy(),
        second=data[second].to_numpy(),
    )


@dataclass(frozen=True)
class Decade(Numbers):
    """A range of the penalty law's damping whose ends differ by a factor of ten.

    Attributes:
        begin: smallest damping c of the range [N s/m].
        one_periodic: share of one-periodic points in the range [-].
        one_periodic_within: the same without and with the undecided points [-].
        amplitude_spread: standard deviation over mean of the amplitudes, shape (2,) [-].
    """

    begin: float
    one_periodic: float
    one_periodic_within: tuple[float, float]
    amplitude_spread: FloatArray

    def to_json(self) -> Mapping[str, Any]:
        """Return the fields; `begin` is named "from", which Python does not allow as a name."""
        kept = dict(super().to_json())
        return {"from": kept.pop("begin"), **kept}


def best_decade(damping: FloatArray, kind: IntArray, amplitude: FloatArray) -> Decade:
    """Return the decade of the penalty law's damping with the most one-periodic points.

    If several decades have the same share, return the one with the smallest damping.

    Args:
        damping: values of c, increasing, shape (m,) [N s/m].
        kind: kind of motion at each point, 0 is one-periodic, shape (m, n).
        amplitude: half peak-to-peak of both tips at each point, shape (m, n, 2) [m].
    """
    decades = []
    for low in damping[damping <= damping[-1] / 10.0 * (1.0 + 1e-9)]:
        inside = (damping >= low) & (damping <= 10.0 * low * (1.0 + 1e-9))
        chosen = amplitude[inside].reshape(-1, 2)
        spread = np.nanstd(chosen, axis=0) / np.nanmean(chosen, axis=0)
        share = float((kind[inside] == attractors.PERIOD_1).mean())
        unsure = float((kind[inside] == attractors.UNDECIDED).mean())
        decades.append(Decade(float(low), share, (share, share + unsure), spread))
    return max(decades, key=lambda decade: decade.one_periodic)


def axes_of(data: xr.Dataset) -> tuple[str, str]:
    """Return the names of a plane's axes: first damping or restitution, then stiffness."""
    first = "restitution" if "restitution" in data.dims else "penalty_damping"
    return first, "penalty_stiffness"


def main_effect(values: FloatArray, axis: int) -> FloatArray:
    """Return the share of a plane's variance that the means along one axis explain, (2,) [-]."""
    means = np.nanmean(values, axis=1 - axis)
    total = np.nanvar(values, axis=(0, 1))
    share: FloatArray = np.divide(
        np.nanvar(means, axis=0), total, out=np.zeros_like(total), where=total > 0
    )
    return share

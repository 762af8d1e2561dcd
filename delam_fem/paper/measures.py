"""Measure motions and planes of motions: phases, roughness, kinds, scatter, main effects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from delam_fem.numerics import attractors
from delam_fem.numerics.arrays import FloatArray, IntArray
from delam_fem.paper.claims import NOT_IN_JSON, Criterion, Numbers, yes
from delam_fem.paper.lab import is_as_described, strikes
from delam_fem.results import diagnostics
from delam_fem.results.diagnostics import STROBES
from delam_fem.results.figures.style import HISTORY_PERIODS

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.results.folder import Result

SMOOTH_HARMONICS = 20
"""The part of a signal above this harmonic of the excitation counts as roughness."""
FREE_GAP = 1e-3
"""Tips farther apart than this are in free flight [m]."""
CLEARLY = 0.8
"""A roughness below this fraction of the other one counts as a distinct improvement."""
SERIES_STEP = 4
"""Distance in steps between the samples that are kept in the numbers of a figure."""


def half_ranges(result: Result) -> FloatArray:
    """Return the half peak-to-peak amplitudes of both tips, shape (2,) [m]."""
    s = result.summary
    half: FloatArray = 0.5 * (np.array(s["tip_max"]) - np.array(s["tip_min"]))
    return half


def near_share(result: Result) -> float:
    """Return the share of the window in which the tips are less than `FREE_GAP` apart [-]."""
    return float((diagnostics.tip_gap(result.history) < FREE_GAP).mean())


def rough_part(values: FloatArray, n_periods: int, above: int = SMOOTH_HARMONICS) -> FloatArray:
    """Return the part of a signal above a harmonic of the excitation, same shape as `values`.

    Args:
        values: signal over whole periods along the last axis.
        n_periods: number of periods in the signal.
        above: number of the highest harmonic that is removed.
    """
    spectrum = np.fft.rfft(values, axis=-1)
    spectrum[..., : above * n_periods + 1] = 0.0
    return np.fft.irfft(spectrum, n=values.shape[-1], axis=-1)


def roughness(result: Result, *, free: bool, quantity: str = "tip_velocity") -> tuple[float, float]:
    """Return, for both tips, the rms of the rough part over the rms of the whole signal [-].

    Args:
        result: a result whose window has whole periods.
        free: True: use the steps at which the tips are more than `FREE_GAP` apart; False: use the
            other steps.
        quantity: "tip_velocity" or "tip_displacement".
    """
    whole = diagnostics.last_periods(result.history, result.case)
    values = whole[quantity].to_numpy()
    rough = rough_part(values, values.shape[-1] // result.case.time.steps_per_period)
    chosen = (diagnostics.tip_gap(whole) > FREE_GAP) == free
    values = values - values.mean(axis=1, keepdims=True)
    scale = np.sqrt((values**2).mean(axis=1))
    part = np.sqrt((rough[:, chosen] ** 2).mean(axis=1)) if chosen.any() else np.zeros(2)
    thick, thin = part / scale
    return float(thick), float(thin)


def settling(strobe: FloatArray, half_range: FloatArray, periodicity: int, within: float) -> int:
    """Return the number of periods after which a motion from rest stays near its stationary cycle.

    Args:
        strobe: displacement of both tips at the end of each period, shape (2, n) [m].
        half_range: half peak-to-peak of both tips, shape (2,) [m].
        periodicity: P, the number of periods after which the stationary motion repeats.
        within: distance from the cycle that counts as near, in half ranges [-].

    Returns:
        Number of the last period at whose end a tip is farther than that from the mean of the last
        strobes of the same phase.
    """
    n = strobe.shape[1]
    last = 0
    for phase in range(periodicity):
        periods = np.arange(n - 1 - phase, -1, -periodicity)[::-1]
        same = strobe[:, periods]
        mean = same[:, -(diagnostics.STROBES // periodicity) :].mean(axis=1, keepdims=True)
        away = (np.abs(same - mean) > within * half_range[:, None]).any(axis=0)
        last = max(last, int(periods[away].max(initial=-1)) + 1)
    return last


def describe(result: Result) -> str:
    """Return the kind of a motion in a few words."""
    s = result.summary
    thick, thin = strikes(result).mean
    period = s["periodicity_class"] or "not periodic"
    struck = "" if np.isnan(thick) else f", {thick:+.2f} / {thin:+.2f} m/s"
    return f"{period}, {s['tip_contacts_per_period']:.2g} contacts/T{struck}"


def tip_positions(result: Result, count: int) -> tuple[FloatArray, FloatArray]:
    """Return the time and the positions of both tips over the last periods.

    Returns:
        t/T from the start of these periods, shape (n,) [-]; positions, shape (2, n) [mm].
    """
    last = diagnostics.last_periods(result.history, result.case, count)
    y = 1e3 * diagnostics.probe_positions(last)
    t = np.arange(1, y.shape[1] + 1) / result.case.time.steps_per_period
    return t, y


@dataclass(frozen=True)
class MotionNumbers(Numbers):
    """The numbers that characterise a motion, and the positions of the tips in its last periods.

    Attributes:
        periodicity, periodicity_class, …, energy_residual: the same as in the summary of a run.
        kind: the motion in words.
        is_as_described: whether the motion is as the paper describes it for its frequency.
        strike_velocities: mean velocities of thick and thin tip before a strike [m/s].
        near_share: share of the time in which the tips are less than `FREE_GAP` apart [-].
        t_over_T, position_mm: time and tip positions, every `SERIES_STEP` steps, shapes (n,) and
            (2, n).
    """

    periodicity: int | None
    periodicity_class: str | None
    strobe_scatters: list[float] | None
    strobe_scatter: float | None
    tip_contacts_per_period: float
    impacts_per_period: float
    tip_min: list[float]
    tip_max: list[float]
    minimum_tip_gap: float
    distortion_factor: list[float]
    thd: list[float]
    energy_residual: float
    kind: str
    is_as_described: bool
    strike_velocities: tuple[float, float]
    near_share: float
    t_over_T: FloatArray
    position_mm: FloatArray

    def criteria(self, periodicity: int) -> tuple[Criterion, ...]:
        """Return what must be so for this to be a motion of a period as the paper describes it.

        The scatter of cycles counts as uncertain by the factor `diagnostics.PERIODIC_MARGIN`.
        """
        margin, bound = diagnostics.PERIODIC_MARGIN, diagnostics.PERIODIC_SCATTER
        found = [yes("as described", self.is_as_described)]
        for P in range(1, periodicity + 1):
            scatter = (self.strobe_scatters or ())[P - 1 : P]
            value = scatter[0] if scatter else math.nan
            relation: Literal["<", ">"] = "<" if periodicity == P else ">"
            if periodicity % P == 0:
                within = (value / margin, value * margin)
                name = f"scatter {P} period{'s' if P > 1 else ''} apart"
                found.append(Criterion(name, value, relation, bound, "%", within))
        return tuple(found)


def motion_numbers(result: Result) -> MotionNumbers:
    """Return the numbers that characterise the motion of a result."""
    t, y = tip_positions(result, HISTORY_PERIODS)
    names = (
        "periodicity", "periodicity_class", "strobe_scatters", "strobe_scatter",
        "tip_contacts_per_period", "impacts_per_period",
        "tip_min", "tip_max", "minimum_tip_gap", "distortion_factor", "thd", "energy_residual",
    )  # fmt: skip
    return MotionNumbers(
        **{name: result.summary[name] for name in names},
        kind=describe(result),
        is_as_described=is_as_described(result),
        strike_velocities=strikes(result).mean,
        near_share=near_share(result),
        t_over_T=t[::SERIES_STEP],
        position_mm=np.round(y[:, ::SERIES_STEP], 4),
    )


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

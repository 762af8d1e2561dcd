"""Draw a drive with many lines, what it moves, and the frequency responses of each channel.

Beside the estimates stand the exact responses of beams without contact, at their tips.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.case.excitation import (
    BurstExcitation,
    MultisineExcitation,
    RandomExcitation,
    RecordExcitation,
)
from delam_fem.model.discretise import assemble
from delam_fem.model.linear import response
from delam_fem.numerics.beams import ComplexArray
from delam_fem.numerics.types import FloatArray
from delam_fem.results.figures.style import (
    BLACK,
    finite,
    label_x,
    lamina_colours,
    legend_above,
    stacked,
)
from delam_fem.results.record import of_run

SEGMENTS = 8
"""Segments into which a random record is cut; they overlap by half, each with a Hann window."""
LINES = 300
"""Frequencies at which the exact responses are computed."""
MOST_CHANNELS = 8
"""Channels that are drawn."""
LEAST = 1e-3
"""Share of the largest amplitude of a burst below which its spectrum gives no response."""


class Estimates(NamedTuple):
    """Frequency responses of the channels of a run to its drive.

    Attributes:
        frequency: shape (n,) [Hz].
        drive: size of the drive, shape (n,): amplitude of a multisine or burst, otherwise density.
        motion: sizes of the channels, shape (channels, n).
        response: H of each channel, shape (channels, n).
        names: of the channels.
        units: of the drive and of each channel.
    """

    frequency: FloatArray
    drive: FloatArray
    motion: FloatArray
    response: ComplexArray
    names: tuple[str, ...]
    units: tuple[str, ...]


def has_many_lines(case: Case) -> bool:
    """Return whether the drive of a case has many lines."""
    kinds = MultisineExcitation | RandomExcitation | BurstExcitation | RecordExcitation
    return isinstance(getattr(case, "excitation", None), kinds)


def estimates(history: xr.Dataset, case: Case) -> Estimates:
    """Estimate the frequency responses of all channels of a run but contact forces.

    A multisine needs no window: spectra are those of its last whole period, of several realisations
    of the last period of each. A burst that has decayed is one segment. Others are averaged.

    Args:
        history: dataset of a run with a period of a multisine at least.
        case: its case.
    """
    record = of_run(history, case)
    driving = "drive" if "drive" in record else "base"
    of_contact = ("contact force", "impulse")
    names = tuple(
        str(name)
        for name, channel in record.data_vars.items()
        if channel.dims == ("time",)
        and channel.attrs["quantity"] not in of_contact
        and name != driving
    )[:MOST_CHANNELS]
    units = tuple(str(record[name].attrs["units"]) for name in (driving, *names))
    force = finite(record[driving])
    motions = np.array([finite(record[name]) for name in names])
    excitation = case.excitation
    step = case.time_step
    if isinstance(excitation, MultisineExcitation):
        n = case.steps_per_period
        ends = range(force.size // n * n, 0, -n * (excitation.periods or force.size))
        numbers = excitation.numbers
        both = np.vstack([force[None], motions])
        last = np.array([both[:, end - n : end] for end in ends])
        spectra = 2.0 * np.fft.rfft(last, axis=2)[..., numbers] / n
        H = (spectra[:, 1:] / spectra[:, :1]).mean(axis=0)
        size = np.sqrt((np.abs(spectra) ** 2).mean(axis=0))
        return Estimates(numbers * excitation.spacing, size[0], size[1:], H, names, units)
    if isinstance(excitation, BurstExcitation):
        spectra = np.fft.rfft(np.vstack([force[None], motions])) * step
        frequency = np.fft.rfftfreq(force.size, step)
        size = np.abs(spectra)
        in_band = (size[0] > LEAST * size[0].max()) & (frequency > 0.0)
        H = spectra[1:, in_band] / spectra[0, in_band]
        return Estimates(frequency[in_band], size[0, in_band], size[1:, in_band], H, names, units)
    from scipy.signal import csd, welch  # imports statistics, which takes long

    length = force.size // SEGMENTS
    frequency, density = welch(force, 1.0 / step, nperseg=length)
    _, cross = csd(force[None], motions, 1.0 / step, nperseg=length)
    _, motion = welch(motions, 1.0 / step, nperseg=length)
    low = getattr(excitation, "low", frequency[1])
    high = getattr(excitation, "high", 0.25 / step)
    in_band = (frequency >= max(low, frequency[1])) & (frequency <= high) & (density > 0.0)
    H = cross[:, in_band] / density[in_band]
    return Estimates(frequency[in_band], density[in_band], motion[:, in_band], H, names, units)


def exact(case: Case, frequency: FloatArray) -> dict[str, ComplexArray] | None:
    """Return the responses of the tips of beams without contact, by channel; None of others.

    Args:
        case: the case.
        frequency: shape (k,) [Hz].
    """
    if case.model.kind != "beam" or case.is_massless:
        return None
    structure = assemble(case.without_impactors, needs_dolfinx=False)
    o = structure.operators
    rows = [o.probes @ response(o, f) + o.probe_shift[: o.n_probes] for f in frequency.tolist()]
    tips = np.array(rows).T
    of_tips: dict[str, ComplexArray] = {}
    for name, tip in zip(structure.layout.names, tips, strict=False):
        of_tips[f"tip_{name}"] = tip
        of_tips[f"tip_{name}_velocity"] = 2j * math.pi * frequency * tip
    return of_tips


def responses(history: xr.Dataset, case: Case) -> Figure:
    """Draw the drive, the channels, and their responses beside the exact ones without contact."""
    values = estimates(history, case)
    colours = lamina_colours(len(values.names))
    figure, panels = stacked(3, 9.0, sharex=True)
    is_density = not isinstance(case.excitation, MultisineExcitation | BurstExcitation)
    what = "density" if is_density else "amplitude"
    panels[0].semilogy(values.frequency, values.drive, ".-", color=BLACK, markersize=2)
    panels[0].set_ylabel(f"{what} of the drive")
    panels[1].set_ylabel(f"{what} of channels")
    panels[2].set_ylabel("|H|")
    grid = np.linspace(values.frequency[0], values.frequency[-1], LINES)
    known = exact(case, grid) or {}
    drive_unit, *units = values.units
    for k, (name, unit, colour) in enumerate(zip(values.names, units, colours, strict=True)):
        panels[1].semilogy(values.frequency, values.motion[k], color=colour, linewidth=0.8)
        panels[2].semilogy(
            values.frequency, np.abs(values.response[k]), ".", color=colour, markersize=3,
            label=f"{name} [{unit}]",
        )  # fmt: skip
        if name in known:
            panels[2].semilogy(grid, np.abs(known[name]), color=colour, linewidth=0.7)
    legend_above(panels[2])
    label_x(panels, "frequency [Hz]")
    lines = ", lines: exact, without contact" if known else ""
    figure.suptitle(f"{case.title}\ndrive in {drive_unit}; dots: estimated{lines}")
    return figure

"""Draw a drive with many lines, what it moves, and the frequency responses of each channel.

Beside the estimates stand the exact responses of beams without contact.
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
from delam_fem.model.responses import of_channels
from delam_fem.numerics.beams import ComplexArray
from delam_fem.numerics.spectra import densities, h1, lines_of_periods
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
        numbers = excitation.numbers
        each = min(excitation.periods or force.size, force.size // n)
        last = lines_of_periods(
            np.vstack([force[None], motions]), n, max(1, force.size // n // each)
        )[:, :, -1]
        spectra = last[..., numbers - 1].swapaxes(0, 1)
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
    length = force.size // SEGMENTS
    frequency, both = densities(np.vstack([force[None], motions]), step, length)
    density = both[0]
    motion = both[1:]
    low = getattr(excitation, "low", frequency[1])
    high = getattr(excitation, "high", 0.25 / step)
    in_band = (frequency >= max(low, frequency[1])) & (frequency <= high) & (density > 0.0)
    H = h1(force, motions, step, length)[:, in_band]
    return Estimates(frequency[in_band], density[in_band], motion[:, in_band], H, names, units)


def exact(case: Case, frequency: FloatArray) -> dict[str, ComplexArray] | None:
    """Return the responses of the channels of beams without contact; None of others.

    Args:
        case: the case.
        frequency: shape (k,) [Hz].
    """
    if case.model.kind != "beam" or case.is_massless:
        return None
    alone = case.without_impactors
    structure = assemble(alone, needs_dolfinx=False)
    return of_channels(structure, alone, 2j * math.pi * frequency)


def responses(history: xr.Dataset, case: Case) -> Figure:
    """Draw the drive, the channels, and their responses beside the exact ones without contact."""
    values = estimates(history, case)
    colours = lamina_colours(len(values.names))
    figure, panels = stacked(3, 9.0, sharex=True)
    is_density = not isinstance(case.excitation, MultisineExcitation | BurstExcitation)
    what = "density" if is_density else "amplitude"
    panels[0].semilogy(values.frequency, values.drive, ".-", color=BLACK, markersize=2)
    drive_unit, *units = values.units
    of_drive = f"({drive_unit})²/Hz" if is_density else drive_unit
    of_channel = "square of the unit of each per Hz" if is_density else "unit of each"
    panels[0].set_ylabel(f"{what} of the drive\n[{of_drive}]")
    panels[1].set_ylabel(f"{what} of channels\n[{of_channel}]")
    panels[2].set_ylabel(f"|H| [unit of each per {drive_unit}]")
    grid = np.linspace(values.frequency[0], values.frequency[-1], LINES)
    known = exact(case, grid) or {}
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
    figure.suptitle(f"{case.title}\ndots: estimated{lines}")
    return figure

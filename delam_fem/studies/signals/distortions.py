"""Best linear approximation of what a multisine moves, with its distortions and the noise.

A multisine repeats, so that its spectra over whole periods need no window. Of realisation r and
period p of those that have settled, U and Y are the spectra of excitation and response, and

    G_r = mean_p Y / mean_p U,    G = mean_r G_r                                                (D1)

is the best linear approximation of a response that is not linear. What scatters from period to
period is noise. What scatters more than that from realisation to realisation, whose phases differ,
is distortion: its size at a driven line is |U| sqrt(R (var G - noise of G)).

At lines that are not driven a linear structure is still. A nonlinearity of even order answers odd
lines at even ones, one of odd order at odd ones: where only odd lines are driven, and some of these
left out, the levels there tell both apart with a single realisation.

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed.,
2012, sec. 4.3 (fast and robust method).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.figure import Figure

from delam_fem.api import (
    BoolArray,
    CaseError,
    FloatArray,
    MultisineExcitation,
    load_numbers,
    spectra,
    style,
)
from delam_fem.studies.signals.channels import Values
from delam_fem.studies.signals.reading import history_of
from delam_fem.studies.signals.responses import chosen, step_of, with_estimates

NEIGHBOURS = 3
"""Lines on each side of a line beside which it may count as driven."""
DRIVEN, LOUD, FAINT = 0.1, 10.0, 1e-7
"""Least size of a driven line: over the largest near it, its noise, and the largest of all."""
WHOLE = 1e-3
"""Share of a sample by which a period may differ from whole samples over the whole record."""
ABOVE_NOISE, LEAST_DISTORTION = 3.0, 1e-3
"""Distortions are some if they are above that many times the noise, and that share of what is
driven (-60 dB); a linear run leaves that much of its transient."""
KINDS = ("driven", "even", "odd")
"""What a line is: driven, or not driven with an even or an odd number."""


class Distortions(NamedTuple):
    """What a multisine moves, per line of its spacing.

    Attributes:
        is_driven: which lines are driven, shape (n_lines,); the first is at the spacing.
        response: G at driven lines, shape (outputs, n_driven).
        deviation: its standard deviation, noise and distortion together, same shape; NaN of a
            single realisation.
        noise: its standard deviation by noise alone, same shape; NaN of a single period.
        level: amplitude of the response at each line, shape (outputs, n_lines).
        level_noise: standard deviation of that by noise, same shape.
        scattered: distortion at driven lines by the scatter of realisations, (outputs, n_driven);
            NaN of a single realisation.
    """

    is_driven: BoolArray
    response: Values
    deviation: FloatArray
    noise: FloatArray
    level: FloatArray
    level_noise: FloatArray
    scattered: FloatArray


def distortions_of(
    excitation: FloatArray, responses: FloatArray, n_samples: int, realisations: int = 1
) -> Distortions:
    """Return the best linear approximation of responses to a multisine, and their distortions.

    Args:
        excitation: samples of whole periods, shape (realisations * periods * n_samples,).
        responses: the same of the responses, shape (outputs, n).
        n_samples: samples of a period.
        realisations: number of realisations, one after the other; of each the first period is its
            transient, if there are several.
    """
    both = np.vstack([excitation[None], responses])
    of_periods = spectra.lines_of_periods(both, n_samples, realisations)
    settled = of_periods[:, :, min(1, of_periods.shape[2] - 1) :]
    n_periods = settled.shape[2]
    mean = settled.mean(axis=2)
    U, Y = mean[0], mean[1:]
    size = np.sqrt((np.abs(U) ** 2).mean(axis=0))
    noise_of_lines = np.full(mean.shape, np.nan)
    if n_periods > 1:
        noise_of_lines = np.sqrt(settled.var(axis=2, ddof=1) / n_periods)
    is_driven = _driven(size, np.nan_to_num(noise_of_lines[0]).mean(axis=0))
    G = Y[:, :, is_driven] / U[:, is_driven]
    response = G.mean(axis=1)
    noise = np.full(response.shape, np.nan)
    if n_periods > 1:
        ratio = settled[1:, :, :, is_driven] / settled[0][:, :, is_driven]
        noise = np.sqrt(ratio.var(axis=2, ddof=1).mean(axis=1) / n_periods / realisations)
    deviation = np.full(response.shape, np.nan)
    scattered = deviation.copy()
    if realisations > 1:
        variance = G.var(axis=1, ddof=1) / realisations
        deviation = np.sqrt(variance)
        excess = np.maximum(variance - np.nan_to_num(noise) ** 2, 0.0)
        scattered = size[is_driven] * np.sqrt(realisations * excess)
    level = np.sqrt((np.abs(Y) ** 2).mean(axis=1))
    level_noise = np.sqrt((noise_of_lines[1:] ** 2).mean(axis=1))
    return Distortions(is_driven, response, deviation, noise, level, level_noise, scattered)


def _driven(size: FloatArray, noise: FloatArray) -> BoolArray:
    """Return which lines of an excitation are driven, by their size and its noise."""
    padded = np.pad(size, NEIGHBOURS)
    near = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1).max(axis=1)
    is_loud = (size > LOUD * noise) & (size > FAINT * size.max())
    return np.asarray((size > DRIVEN * near) & is_loud)


def with_distortions(
    data: xr.Dataset, excitation: str, period: float, realisations: int = 1
) -> xr.Dataset:
    """Return a measurement under a multisine with its response and its distortions.

    Args:
        data: a measurement; its last whole periods are taken.
        excitation: name of the channel of the excitation.
        period: period of the multisine, the reciprocal of its spacing [s].
        realisations: number of realisations in the record, one after the other, of equal length.

    Returns:
        The measurement with `response(frequency, output)` at the driven lines, its standard
        deviations `response_deviation` and `response_noise`, and at all lines up to twice the
        highest driven one `line_level(line_frequency, output)`, `line_noise` and `line_kind`. The
        attribute `is_linear` is 0 if there are distortions; the notes say how large they are.

    Raises:
        CaseError: there is no such channel, a period is not one of whole samples, or the record
            does not hold whole periods of all realisations.
    """
    first, outputs = chosen(data, excitation)
    step = step_of(data["time"].to_numpy())
    n_samples = round(period / step)
    total = data.sizes["time"]
    if n_samples < 8 or abs(n_samples * step - period) * (total / n_samples) > WHOLE * step:
        raise CaseError(
            f"period: expected one of whole samples of {step:.6g} s, given {period:.10g} s = "
            f"{period / step:.6g} samples; take the sampling rate of the generator"
        )
    periods = total // n_samples // realisations
    if not periods:
        raise CaseError(
            f"period: expected a record of at least {realisations} period(s) of {period:g} s, one "
            f"for each realisation, given {total * step:g} s"
        )
    used = realisations * periods * n_samples
    force = history_of(data, first)[-used:]
    motions = np.array([history_of(data, k) for k in outputs])[:, -used:]
    result = distortions_of(force, motions, n_samples, realisations)
    if not result.is_driven.any():
        raise CaseError(f"excitation: expected a channel that moves, given {excitation!r} at rest")
    lines = np.arange(1, result.is_driven.size + 1) / (n_samples * step)
    frequency = lines[result.is_driven]
    nothing = np.full(result.response.shape, np.nan)
    data = with_estimates(data, frequency, (result.response, nothing), (first, outputs))
    dims = ("frequency", "output")
    about = {"units": data["response"].attrs["units"]}
    for name, values, words in (
        ("response_deviation", result.deviation, "standard deviation of the frequency response"),
        ("response_noise", result.noise, "its part by noise"),
    ):
        data[name] = (dims, values.T, about | {"long_name": words})
    data = _with_levels(data, lines, result)
    texts, is_linear = _verdict(data, result)
    notes = (data.attrs.get("notes"), *texts)
    return data.assign_attrs(notes="\n".join(filter(None, notes)), is_linear=int(is_linear))


class RunRecord(NamedTuple):
    """What the folder of a run says of its drive.

    Attributes:
        file: the file with its numbers.
        excitation: name of the channel of its drive.
        period: period of its multisine [s]; None: it has none.
        realisations: number of realisations of the multisine.
        claps: whether anything has touched in its window.
    """

    file: Path
    excitation: str
    period: float | None
    realisations: int
    claps: bool


def run_in(paths: Sequence[Path]) -> RunRecord | None:
    """Return what a run says of its drive, if one folder of a run is all that is given.

    Raises:
        CaseError: the folder holds no run.
    """
    if len(paths) != 1 or not paths[0].is_dir():
        return None
    case, history, _ = load_numbers(paths[0])
    drive = case.excitation
    name = "force" if drive.acts_on == "force" else "base_displacement"
    claps = bool(history.sizes.get("event", 0))
    if not isinstance(drive, MultisineExcitation):
        return RunRecord(paths[0] / "result.nc", name, None, 1, claps)
    period = 1.0 / drive.spacing
    return RunRecord(paths[0] / "result.nc", name, period, drive.realisations, claps)


def _with_levels(data: xr.Dataset, lines: FloatArray, result: Distortions) -> xr.Dataset:
    """Return a measurement with the levels of its lines, up to twice the highest driven one."""
    top = min(lines.size, 2 * int(np.flatnonzero(result.is_driven)[-1]) + 2)
    kind = np.where(np.arange(1, top + 1) % 2 == 0, 1, 2)
    kind[result.is_driven[:top]] = 0
    about = {"units": "Hz", "long_name": "frequency of a line"}
    data = data.assign_coords(line_frequency=("line_frequency", lines[:top], about))
    words = {"units": "1", "long_name": ", ".join(f"{k}: {word}" for k, word in enumerate(KINDS))}
    data["line_kind"] = ("line_frequency", kind, words)
    for name, values, text in (
        ("line_level", result.level, "amplitude of a response at a line"),
        ("line_noise", result.level_noise, "its standard deviation by noise"),
    ):
        dims = ("line_frequency", "output")
        data[name] = (dims, values[:, :top].T, {"units": "of the channel", "long_name": text})
    scattered = np.full((top, len(values)), np.nan)
    scattered[result.is_driven[:top]] = result.scattered.T
    text = "distortion at a driven line, by realisations"
    data["line_scattered"] = (dims, scattered, {"units": "of the channel", "long_name": text})
    return data


def _rms(values: npt.ArrayLike) -> float:
    """Return the root mean square of what is known; NaN if nothing is."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    return float(np.sqrt(np.mean(known**2))) if known.size else np.nan


def _verdict(data: xr.Dataset, result: Distortions) -> tuple[list[str], bool]:
    """Return what is said of the distortions of each response, and whether all are linear."""
    texts = []
    is_linear = True
    kind = data["line_kind"].to_numpy()
    inside = data["line_frequency"].to_numpy() <= float(data["frequency"][-1])
    for k, name in enumerate(data["output"].to_numpy().tolist()):
        level, noise, scattered = (
            data[f"line_{word}"].to_numpy()[:, k] for word in ("level", "noise", "scattered")
        )
        driven = _rms(level[kind == 0])
        parts = {
            word: _rms(level[(kind == number) & inside])
            for number, word in ((1, "even"), (2, "odd"))
        }
        parts["realisations"] = _rms(scattered[kind == 0])
        floor = max(ABOVE_NOISE * np.nan_to_num(_rms(noise[inside])), LEAST_DISTORTION * driven)
        largest = max((size for size in parts.values() if np.isfinite(size)), default=0.0)
        sizes = ", ".join(
            f"{word} {20.0 * np.log10(max(size, 1e-300) / driven):.1f} dB"
            for word, size in {**parts, "noise": _rms(noise[inside])}.items()
            if np.isfinite(size)
        )
        is_one = bool(largest <= floor)
        is_linear = is_linear and is_one
        word = "linear" if is_one else "not linear"
        texts.append(f"{name}: {word}; below what is driven: {sizes or 'nothing is known'}")
    return texts, is_linear


def distortions(data: xr.Dataset) -> Figure:
    """Draw responses with two standard deviations, and the levels of all lines, of each output."""
    names = data["output"].to_numpy().tolist()
    figure, grid = style.stacked(2 * len(names), 5.0 * len(names), sharex=False)
    kind = data["line_kind"].to_numpy()
    f = data["frequency"].to_numpy()
    lines = data["line_frequency"].to_numpy()
    marks = ((0, style.BLACK, "driven"), (1, style.BLUE, "even"), (2, style.ORANGE, "odd"))
    for k, name in enumerate(names):
        upper, lower = grid[2 * k], grid[2 * k + 1]
        size = np.abs(data["response"].to_numpy()[:, k])
        upper.semilogy(f, size, ".-", color=style.BLACK, linewidth=0.8, markersize=3)
        deviation = data["response_deviation"].to_numpy()[:, k]
        if np.isfinite(deviation).any():
            low = np.maximum(size - 2.0 * deviation, 1e-3 * size)
            upper.fill_between(f, low, size + 2.0 * deviation, color=style.BLUE, alpha=0.3)
        upper.set_ylabel(f"|G| [{data['response_units'].to_numpy()[k]}]")
        upper.set_title(name, loc="left")
        level, noise, scattered = (
            data[f"line_{word}"].to_numpy()[:, k] for word in ("level", "noise", "scattered")
        )
        top = float(level.max())
        series = (
            *((lines[kind == number], level[kind == number], colour, word)
              for number, colour, word in marks),
            (lines, scattered, style.GREEN, "scatter of realisations"),
            (lines, noise, style.SKY, "noise"),
        )  # fmt: skip
        for x, y, colour, word in series:
            positive = np.where(y > 1e-12 * top, y, np.nan)  # nothing has no level
            decibels = 20.0 * np.log10(positive / top)
            if np.isfinite(decibels).any():
                lower.plot(x, decibels, ".", color=colour, markersize=3, label=word)
        lower.set_ylabel("level [dB]")
        lower.set_xlabel("frequency [Hz]")
        style.legend_above(lower)
    style.label_x(grid, "frequency [Hz]")
    figure.suptitle("best linear approximation and distortions")
    return figure

"""Lay a measurement over a run: the whole comparison, its figures and its page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from scipy.signal import savgol_filter

from delam_fem.api import (
    Case,
    FloatArray,
    Result,
    diagnostics,
    html,
    json_ready,
    load_numbers,
    record,
    schema,
    style,
    write_dataset,
    write_json,
    write_text,
)
from delam_fem.studies.signals import reading
from delam_fem.studies.signals.alignment import (
    COARSE,
    Alignment,
    MatchedHistories,
    MotionCourse,
    aligned,
    best_start,
    correlation,
    matched,
    with_common_rate,
)
from delam_fem.studies.signals.comparison import (
    ChannelComparison,
    Deviation,
    compared,
    drive_frequency,
    findings,
)

SHOWN_PERIODS = 3.0
"""Periods that histories show."""
MOST_CHANNELS = 6
"""Channels that a figure shows."""
SHOWN_ORDERS = 10
"""Harmonics that the bars show, and overlay.json lists."""
SMOOTHED = 11
"""Samples over which a history that does not repeat is smoothed for its derivative."""


def save_figures(overlay: Overlay, directory: Path) -> list[Path]:
    """Write the figures of an overlay as PNG.

    Harmonics are left out where the motion does not repeat.

    Raises:
        OSError: a file cannot be written.
    """
    draws: dict[str, Callable[[Overlay], Figure]] = {"histories": histories}
    if overlay.course.period is not None:
        draws["harmonics"] = harmonics
    draws["portraits"] = portraits
    return [
        style.save_figure(partial(draw, overlay), directory / f"overlay_{name}.png")
        for name, draw in draws.items()
    ]


def _channels(overlay: Overlay) -> list[tuple[int, ChannelComparison, str]]:
    """Return number, comparison and colour of the channels that are shown."""
    colours = iter(style.lamina_colours(len(overlay.channels)))
    return [
        (k, channel, style.BASE_COLOUR if channel.is_drive else next(colours))
        for k, channel in enumerate(overlay.channels[:MOST_CHANNELS])
    ]


def histories(overlay: Overlay) -> Figure:
    """Draw each channel over the run, and below it the difference."""
    entries = _channels(overlay)
    data = overlay.data
    unit, label = style.time_axis(overlay.case)
    t = data["time"].to_numpy()
    inside = t <= t[0] + SHOWN_PERIODS * (unit if overlay.case.is_periodic else np.inf)
    n = len(entries)
    figure, panels = style.stacked(2 * n, 3.3 * n, sharex=True, height_ratios=[3, 1] * n)
    for (k, channel, colour), axes, below in zip(entries, panels[::2], panels[1::2], strict=True):
        name, factor = style.shown_unit(channel.units)
        mean = channel.mean_difference
        axes.plot(
            t[inside] / unit, factor * data["measured"][k].to_numpy()[inside], ".",
            color=style.BLACK, markersize=2.5, label="measured",
        )  # fmt: skip
        fine = np.linspace(t[0], t[inside][-1], 2000)
        axes.plot(fine / unit, factor * overlay.course.at(fine)[k], color=colour, label="run")
        axes.set_ylabel(f"[{name}]")
        axes.set_title(channel.name, loc="left", color=colour)
        axes.margins(x=0.0)
        style.legend_above(axes)
        residual = factor * (data["residual"][k].to_numpy()[inside] - mean)
        below.plot(t[inside] / unit, residual, color=style.BLACK, linewidth=0.6)
        below.set_ylabel(f"difference\n[{name}]")
        style.label_x((axes, below), label)
        below.margins(x=0.0)
    figure.suptitle(f"{overlay.case.title}; differences without their mean")
    return figure


def harmonics(overlay: Overlay) -> Figure:
    """Draw measured and computed amplitudes of the harmonics, with the floor of the noise."""
    entries = _channels(overlay)
    figure, panels = style.stacked(len(entries), 2.7 * len(entries))
    for (_, channel, colour), axes in zip(entries, panels, strict=True):
        if channel.measured is None or channel.computed is None:
            continue
        name, factor = style.shown_unit(channel.units)
        a = channel.measured.amplitudes[:SHOWN_ORDERS]
        b = channel.computed.amplitudes[:SHOWN_ORDERS]
        orders = np.arange(1, a.size + 1)
        floor = factor * channel.measured.floor
        axes.bar(orders - 0.2, factor * a, 0.4, color=style.BLACK, label="measured")
        axes.bar(orders + 0.2, factor * b, 0.4, color=colour, label="run")
        axes.axhline(
            floor, color=style.BASE_COLOUR, linestyle="--", label="noise of the measurement"
        )
        axes.set_yscale("log")
        largest = factor * max(float(a.max()), float(b.max()))
        axes.set_ylim(max(0.3 * floor, 1e-5 * largest), 2.0 * largest)
        axes.set(xlabel="harmonic of the drive", ylabel=f"amplitude [{name}]", xticks=orders)
        d, _ = channel.measured.distortion()
        d_run, _ = channel.computed.distortion()
        text = f"{channel.name}: d measured {100 * d:.2f} %, run {100 * d_run:.2f} %"
        axes.set_title(text, loc="left", color=colour, fontsize=9.0)
        style.legend_above(axes)
    figure.suptitle(overlay.case.title)
    return figure


def portraits(overlay: Overlay) -> Figure:
    """Draw the time derivative of each channel over the channel itself, measured and computed.

    Both are of the same harmonics; those within the noise are left out. A motion that does not
    repeat is smoothed instead.
    """
    entries = [entry for entry in _channels(overlay) if not entry[1].is_drive] or _channels(overlay)
    figure, panels = style.side_by_side(len(entries), 4.4)
    for (k, channel, colour), axes in zip(entries, panels, strict=True):
        name, factor = style.shown_unit(channel.units)
        u = overlay.alignment.on_clock_of_run(overlay.pairs.time)
        period = overlay.course.period
        at = u if period is None else u[0] + np.linspace(0.0, period, 1000)
        if channel.measured is None or channel.computed is None:
            computed = overlay.course.at(at)[k], overlay.course.at(at, 1)[k]
            values: FloatArray = overlay.pairs.measured[k]
            n = min(SMOOTHED, values.size - 1 + values.size % 2)
            step = float(np.median(np.diff(u)))
            measured = (
                savgol_filter(values, n, min(3, n - 1)),
                savgol_filter(values, n, min(3, n - 1), deriv=1, delta=step),
            )
        else:
            clear = channel.measured.clear()
            run = channel.computed
            measured = clear.at(at), clear.at(at, 1)
            computed = run.at(at), run.at(at, 1)
        axes.plot(factor * computed[0], factor * computed[1], color=colour, label="run")
        axes.plot(factor * measured[0], factor * measured[1], color=style.BLACK, linewidth=0.9,
                  linestyle="--", label="measured")  # fmt: skip
        axes.set(xlabel=f"{channel.name} [{name}]", ylabel=f"time derivative [{name}/s]")
        style.legend_above(axes)
    figure.suptitle(overlay.case.title)
    return figure


CAPTIONS = {
    "overlay_histories": "The measurement (dots) over the run, and below each the difference.",
    "overlay_harmonics": "Amplitudes at the harmonics of the drive; dashed: what noise gives.",
    "overlay_portraits": "Phase portraits, both made of the harmonics that stand out of the noise.",
}
MEANINGS = {
    "gain": ("measured amplitude over that of the run", "gain_error"),
    "phase_degrees": ("later than the other channels say, degrees", "phase_degrees_error"),
    "correlation": ("of both after the alignment", ""),
    "mean_difference": ("mean of the measurement minus that of the run", ""),
    "residual_rms": ("root mean square of the difference without its mean", ""),
    "misfit_rms": ("the same of what repeats", ""),
    "noise_rms": ("what does not repeat in the measurement", ""),
    "distortion_measured": ("d of the measurement without its noise", "distortion_measured_error"),
    "distortion_computed": ("d of the run, from the same harmonics", ""),
}  # fmt: skip
"""Rows of the table of a channel: meaning, and the name of the error."""
IN_UNITS = ("mean_difference", "residual_rms", "misfit_rms", "noise_rms")
"""Rows in the unit of the channel."""


def page(overlay: Overlay, figures: Sequence[Path]) -> str:
    """Return the page of an overlay as HTML, with the figures inside.

    Raises:
        OSError: a figure cannot be read.
    """
    numbers = overlay.numbers
    kind = "warning" if overlay.findings else "verdict"
    outcome: list[html.Block] = [
        html.Paragraph(text, kind) for text in list(overlay.sentences())[1:]
    ]
    pictures = [
        html.Gallery([html.embedded(path)], CAPTIONS[path.stem], CAPTIONS[path.stem])
        for path in figures
    ]
    sections = [
        html.PageSection("", outcome),
        html.PageSection("Alignment", [_alignment(overlay, numbers)]),
        *(
            html.PageSection(name, [_channel(channel)])
            for name, channel in numbers["channels"].items()
        ),
        html.PageSection("Figures", pictures),
    ]
    return html.page(f"Measured over {overlay.case.title}", sections, contents=True)


def _alignment(overlay: Overlay, numbers: dict[str, Any]) -> html.HtmlTable:
    """Return the numbers of the alignment as a table."""
    offset, offset_error, drift = (
        schema.shown(numbers[key], 1e3) for key in ("offset", "offset_error", "clock_drift")
    )
    rows = [
        ("offset", f"{offset} ± {offset_error} ms",
         f"time of the run minus that of the measurement, at {numbers['first_sample']:.10g} s"),
        ("clock", f"{numbers['clock_rate']:.8g} ± {numbers['clock_rate_error']:.1g}",
         f"seconds of the run in one measured: {drift} ms in all"),
        ("method", numbers["method"], "of the alignment"),
        ("samples", f"{numbers['samples']} in {schema.shown(numbers['duration'])} s", "measured"),
    ]  # fmt: skip
    if numbers["measured_frequency"] is not None:
        drive = f"{numbers['measured_frequency']:.6g} Hz; run: {numbers['frequency']:.6g} Hz"
        rows.append(("frequency", drive, "of the drive, from the measurement"))
    if numbers["offset_degrees"] is not None:
        phase = schema.shown(numbers["offset_degrees"])
        rows.append(("phase", f"{phase}°", "the offset at the drive"))
    if overlay.pairs.unmatched:
        rows.append(("not in the run", ", ".join(overlay.pairs.unmatched), "left out"))
    return html.HtmlTable(("", "value", "meaning"), rows)


def _channel(own: dict[str, Any]) -> html.HtmlTable:
    """Return the numbers of one channel as a table."""
    rows = []
    for key, (meaning, error) in MEANINGS.items():
        if own.get(key) is None:
            continue
        unit, factor = style.shown_unit(own["units"]) if key in IN_UNITS else ("", 1.0)
        text = schema.shown(own[key], factor)
        if error and own.get(error) is not None:
            text += f" ± {own[error]:.2g}"
        rows.append((key.replace("_", " "), f"{text}\u00a0{unit}" if unit else text, meaning))
    return html.HtmlTable(("", "value", "meaning"), rows)


@dataclass(frozen=True)
class Overlay:
    """A measurement laid over a run.

    Attributes:
        case: case of the run.
        pairs: the histories of both.
        course: the motion of the run.
        alignment: alignment of the measurement with the run.
        measured_frequency: frequency of the drive in the measurement [Hz]; None: not found.
        channels: a comparison for each channel.
        findings: differences worth a sentence; none: both agree.
    """

    case: Case
    pairs: MatchedHistories
    course: MotionCourse
    alignment: Alignment
    measured_frequency: float | None
    channels: tuple[ChannelComparison, ...]
    findings: tuple[Deviation, ...]

    @property
    def offset(self) -> float:
        """Time of the run minus that of the measurement at its first sample [s].

        For a periodic motion the offset is within half a period of zero. At the last sample it is
        larger by `drift`.
        """
        offset = self.alignment.start - self.alignment.first
        period = self.course.period
        return offset if period is None else (offset + period / 2) % period - period / 2

    @property
    def drift(self) -> float:
        """By how much the clock of the run gains on the measurement's over the record [s]."""
        return (self.alignment.rate - 1.0) * float(self.pairs.time[-1] - self.pairs.time[0])

    @property
    def data(self) -> xr.Dataset:
        """Measured and computed histories at the samples, on the clock of the run.

        Variables measured, computed, residual (channel, time), in the unit of each channel.
        """
        u = self.alignment.on_clock_of_run(self.pairs.time)
        computed = self.course.at(u)
        columns = {
            "measured": self.pairs.measured,
            "computed": computed,
            "residual": self.pairs.measured - computed,
        }
        about = {"units": "see channel_units"}
        data = xr.Dataset(
            {k: (("channel", "time"), v, {**about, "long_name": k}) for k, v in columns.items()},
            coords={"channel": list(self.pairs.names)},
        )
        data["time"] = (("time",), u, {"units": "s", "long_name": "time of the run"})
        data["channel_units"] = (("channel",), np.array(self.pairs.units))
        return data

    @property
    def numbers(self) -> dict[str, Any]:
        """The entries of overlay.json in SI units; None where something is not defined."""
        frequency = self.frequency
        content: dict[str, Any] = {
            "method": "periodic" if self.course.period is not None else "cross-correlation",
            "verdict": "differs" if self.findings else "agrees",
            "findings": [finding.__dict__ for finding in self.findings],
            "offset": self.offset,
            "offset_error": self.alignment.start_error,
            "offset_degrees": None if frequency is None else 360.0 * frequency * self.offset,
            "frequency": frequency,
            "measured_frequency": self.measured_frequency,
            "first_sample": self.alignment.first,
            "clock_rate": self.alignment.rate,
            "clock_rate_error": self.alignment.rate_error,
            "clock_drift": self.drift,
            "samples": self.pairs.time.size,
            "duration": float(self.pairs.time[-1] - self.pairs.time[0]),
            "unmatched": list(self.pairs.unmatched),
            "notes": list(self.pairs.notes),
            "channels": {channel.name: self._of_channel(channel) for channel in self.channels},
        }
        return dict(json_ready(content))

    @property
    def frequency(self) -> float | None:
        """Frequency of the drive of the run [Hz]; None: it has none."""
        return 1.0 / self.case.period if self.case.is_harmonic else None

    def _of_channel(self, own: ChannelComparison) -> dict[str, Any]:
        """Return the numbers of one channel."""
        turn = None if self.frequency is None else 360.0 * self.frequency
        drives = (channel.delay_error for channel in self.channels if channel.is_drive)
        # phases count from the drive, which has an error of its own
        of_drive = 0.0 if own.is_drive else min(drives, default=0.0)
        error = float(np.hypot(own.delay_error, of_drive))
        content: dict[str, Any] = {
            "units": own.units, "gain": own.gain, "gain_error": own.gain_error,
            "delay": own.delay, "delay_error": own.delay_error,
            "phase_degrees": None if turn is None else turn * own.delay,
            "phase_degrees_error": None if turn is None else turn * error,
            "correlation": own.correlation, "mean_difference": own.mean_difference,
            "residual_rms": own.residual, "misfit_rms": own.misfit, "noise_rms": own.noise,
        }  # fmt: skip
        if own.measured is not None and own.computed is not None:
            d, d_error = own.measured.distortion()
            content |= {
                "harmonics_measured": own.measured.amplitudes[:SHOWN_ORDERS],
                "harmonics_computed": own.computed.amplitudes[:SHOWN_ORDERS],
                "harmonic_noise": own.measured.floor,
                "distortion_measured": d, "distortion_measured_error": d_error,
                "distortion_computed": own.computed.distortion()[0],
            }  # fmt: skip
        return content

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield gain, phase, noise, misfit and d of each channel as texts."""
        for name, channel in self.numbers["channels"].items():
            unit, factor = style.shown_unit(channel["units"])
            phase = channel["phase_degrees"]
            sizes = (channel["noise_rms"], channel["misfit_rms"])
            distortions = (channel.get("distortion_measured"), channel.get("distortion_computed"))
            yield (
                name,
                f"{channel['gain']:.4g}",
                "–" if phase is None else f"{phase:+.2f} ± {channel['phase_degrees_error']:.1g}",
                *("–" if v is None else f"{factor * v:.3g} {unit}" for v in sizes),
                *("–" if v is None else f"{100 * v:.3g} %" for v in distortions),
            )

    def sentences(self) -> Iterator[str]:
        """Yield the outcome in sentences."""
        fit = self.alignment
        yield (
            f"time of the run = time of the measurement {self.offset:+.6g} s ± "
            f"{fit.start_error:.2g} s at the first sample ({fit.first:.10g} s); the run's clock is "
            f"{fit.rate:.8g} ± {fit.rate_error:.1g} times as fast, {self.drift:+.2g} s at the last"
        )
        yield from (finding.text for finding in self.findings)
        if not self.findings:
            yield "measurement and run agree within 5 % in amplitude, 5° in phase, 0.01 % in clocks"
        yield from self.pairs.notes
        if self.pairs.unmatched:
            yield f"not in the run: {', '.join(self.pairs.unmatched)}"

    def save(self, directory: str | Path) -> list[Path]:
        """Write overlay.json, overlay.nc, figures and overlay.html.

        Args:
            directory: folder, which is made where it does not exist.

        Returns:
            The files.

        Raises:
            OSError: a file cannot be written.
        """
        directory = Path(directory)
        written = [
            write_json(directory / "overlay.json", self.numbers),
            write_dataset(self.data, directory / "overlay.nc"),
        ]
        figures = save_figures(self, directory)
        return [*written, *figures, write_text(directory / "overlay.html", page(self, figures))]


def overlay(
    run: str | Path | Result, *measurements: str | Path | xr.Dataset, **options: Any
) -> Overlay:
    """Lay a measurement over a run: align both, and compare them channel by channel.

    Args:
        run: the folder of a run, or its result.
        measurements: files, or one dataset of `read_measured`.
        options: `channels`, `units` and `rate`, as `read_measured` takes them.

    Returns:
        Alignment, comparison of each channel, findings.

    Raises:
        CaseError: the run or a file cannot be read, or they have no channel in common.
    """
    if isinstance(run, Result):
        case, history, summary = run.case, run.history, run.summary
    else:
        case, history, summary = load_numbers(run, is_strict=True)
    first = measurements[0] if measurements else None
    if not isinstance(first, xr.Dataset):
        first = reading.read_measured(*measurements, **options)  # type: ignore[arg-type]
    pairs = matched(record.of_run(history, case), reading.record(first), repeats=case.is_periodic)
    if "periodicity" not in summary:
        summary = diagnostics.summary(history, case)
    course, rate, frequency = _course(pairs, case, summary.get("periodicity"))
    turn = case.period if case.is_harmonic else None
    # most records are filtered before they are sampled, so that they cannot have all of the run
    step = rate * float(np.median(np.diff(pairs.time)))
    filtered = course.below(0.5 / step)
    alignment = _alignment_with(pairs, course, rate, turn)
    if filtered is not course:
        of_filtered = _alignment_with(pairs, filtered, rate, turn)
        if _likeness(pairs, filtered, of_filtered) > _likeness(pairs, course, alignment):
            course = filtered
            alignment = of_filtered
    channels = tuple(compared(pairs, k, course, alignment, turn) for k in range(len(pairs.names)))
    drive = 1.0 / turn if turn else None
    if frequency is not None and drive is not None:
        frequency = alignment.rate * drive
    differences = tuple(findings(channels, alignment, drive))
    return Overlay(case, pairs, course, alignment, frequency, channels, differences)


def _alignment_with(
    pairs: MatchedHistories, course: MotionCourse, rate: float, turn: float | None
) -> Alignment:
    """Return the alignment with a course of the run.

    Args:
        pairs: measurement and run.
        course: course of all channels.
        rate: s to begin with.
        turn: period of the drive [s]; None: there is none.
    """
    drives = [k for k, is_drive in enumerate(pairs.is_drive) if is_drive]
    others = [k for k, is_drive in enumerate(pairs.is_drive) if not is_drive]
    leaders = drives or others
    alignment = aligned(
        pairs.time, pairs.measured[leaders], course.only(leaders), rate, is_rate_free=True
    )
    if not (drives and others and turn is not None):
        return alignment
    if course.period is not None:
        alignment = with_common_rate(pairs.time, pairs.measured, course, alignment, drives)
    # the drive alone cannot tell its periods apart
    low, high = course.starts(rate * (pairs.time - pairs.time[0]), COARSE)[[0, -1]]
    first = alignment.start - turn * np.floor((alignment.start - low) / turn)
    starts = np.arange(first, high + turn, turn)
    start = best_start(
        pairs.time, pairs.measured[others], course.only(others), alignment, starts, power=2
    )
    return replace(alignment, start=start)


def _likeness(pairs: MatchedHistories, course: MotionCourse, alignment: Alignment) -> float:
    """Return the sum of the squared correlations of all channels."""
    computed = course.at(alignment.on_clock_of_run(pairs.time))
    return correlation(pairs.measured, computed, power=2)


def _course(
    pairs: MatchedHistories, case: Case, periodicity: int | None
) -> tuple[MotionCourse, float, float | None]:
    """Return the course of the run, a first rate s of the clock, the drive's measured frequency."""
    if not case.is_harmonic:
        return MotionCourse.of(pairs.run_time, pairs.computed, None), 1.0, None
    frequency = drive_frequency(pairs.time, pairs.measured, 1.0 / case.period)
    rate = 1.0 if frequency is None else frequency * case.period
    period = None if periodicity is None else periodicity * case.period
    if period and period > pairs.run_time.size * case.time_step * (1.0 + 1e-9):
        period = None
    course = MotionCourse.of(pairs.run_time, pairs.computed, period, periodicity or 1)
    return course, rate, frequency

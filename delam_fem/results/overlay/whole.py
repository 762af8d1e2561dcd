"""Lay a measurement over a run: align, compare, and keep all of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.results.diagnostics import summary as summary_of_run
from delam_fem.results.folder import Result, json_ready, load_numbers, write_dataset
from delam_fem.results.measured.reading import read_measured
from delam_fem.results.overlay.alignment import (
    COARSE,
    Alignment,
    Course,
    Pairs,
    aligned,
    best_start,
    matched,
)
from delam_fem.results.overlay.comparison import (
    Comparison,
    Finding,
    compared,
    drive_frequency,
    findings,
)
from delam_fem.results.overlay.figures import save_figures, shown_unit
from delam_fem.system.files import write_text

SHOWN_HARMONICS = 10
"""Harmonics whose amplitudes overlay.json lists."""


@dataclass(frozen=True)
class Overlay:
    """A measurement laid over a run.

    Attributes:
        case: of the run.
        pairs: the histories of both.
        course: the motion of the run.
        alignment: of the measurement with it.
        measured_frequency: of the drive in the measurement [Hz]; None: not found.
        channels: a comparison for each channel.
        findings: differences worth a sentence; none: both agree.
    """

    case: Case
    pairs: Pairs
    course: Course
    alignment: Alignment
    measured_frequency: float | None
    channels: tuple[Comparison, ...]
    findings: tuple[Finding, ...]

    @property
    def offset(self) -> float:
        """Time of the run minus that of the measurement at its first sample [s].

        For a periodic motion within half a period of zero. At the last sample it is larger by
        `drift`.
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
        """What overlay.json says; SI units, None where something is not defined."""
        frequency = self.frequency
        found: dict[str, Any] = {
            "method": "periodic" if self.course.period is not None else "cross-correlation",
            "verdict": "differs" if self.findings else "agrees",
            "findings": [own.__dict__ for own in self.findings],
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
            "channels": {own.name: self._of_channel(own) for own in self.channels},
        }
        return dict(json_ready(found))

    @property
    def frequency(self) -> float | None:
        """Frequency of the drive of the run [Hz]; None: it has none."""
        return 1.0 / self.case.period if self.case.is_periodic else None

    def _of_channel(self, own: Comparison) -> dict[str, Any]:
        """Return the numbers of one channel."""
        frequency = self.frequency
        turn = None if frequency is None else 360.0 * frequency
        found: dict[str, Any] = {
            "units": own.units, "gain": own.gain, "gain_error": own.gain_error,
            "delay": own.delay, "delay_error": own.delay_error,
            "phase_degrees": None if turn is None else turn * own.delay,
            "phase_degrees_error": None if turn is None else turn * own.delay_error,
            "correlation": own.correlation, "mean_difference": own.mean_difference,
            "residual_rms": own.residual, "misfit_rms": own.misfit, "noise_rms": own.noise,
        }  # fmt: skip
        if own.measured is not None and own.computed is not None:
            d, d_error = own.measured.distortion()
            found |= {
                "harmonics_measured": own.measured.amplitudes[:SHOWN_HARMONICS],
                "harmonics_computed": own.computed.amplitudes[:SHOWN_HARMONICS],
                "harmonic_noise": own.measured.floor,
                "distortion_measured": d, "distortion_measured_error": d_error,
                "distortion_computed": own.computed.distortion()[0],
            }  # fmt: skip
        return found

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield gain, phase, noise, misfit and d of each channel as texts."""
        for name, own in self.numbers["channels"].items():
            unit, factor = shown_unit(own["units"])
            phase = own["phase_degrees"]
            sizes = (own["noise_rms"], own["misfit_rms"])
            distortions = (own.get("distortion_measured"), own.get("distortion_computed"))
            yield (
                name,
                f"{own['gain']:.4g}",
                "–" if phase is None else f"{phase:+.2f} ± {own['phase_degrees_error']:.1g}",
                *("–" if v is None else f"{factor * v:.3g} {unit}" for v in sizes),
                *("–" if v is None else f"{100 * v:.3g} %" for v in distortions),
            )

    def sentences(self) -> Iterator[str]:
        """Yield the outcome in sentences."""
        own = self.alignment
        yield (
            f"time of the run = time of the measurement {self.offset:+.6g} s ± "
            f"{own.start_error:.2g} s at the first sample ({own.first:.10g} s); the run's clock is "
            f"{own.rate:.8g} ± {own.rate_error:.1g} times as fast, {self.drift:+.2g} s at the last"
        )
        yield from (own.text for own in self.findings)
        if not self.findings:
            yield "measurement and run agree within 5 % in amplitude, 5° in phase, 0.01 % in clocks"
        if self.pairs.unmatched:
            yield f"not in the run: {', '.join(self.pairs.unmatched)}"

    def save(self, directory: str | Path) -> list[Path]:
        """Write overlay.json, overlay.nc, figures and overlay.html.

        Args:
            directory: made where it does not exist.

        Returns:
            The files.

        Raises:
            OSError: a file cannot be written.
        """
        from delam_fem.results.overlay.figures import page

        directory = Path(directory)
        directory.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.numbers, indent=2, allow_nan=False) + "\n"
        written = [
            write_text(directory / "overlay.json", text),
            write_dataset(self.data, directory / "overlay.nc"),
        ]
        figures = save_figures(self, directory)
        report = write_text(directory / "overlay.html", page(self, figures))
        return [*written, *figures, report]


def overlay(
    run: str | Path | Result, *measurements: str | Path | xr.Dataset, **options: Any
) -> Overlay:
    """Lay a measurement over a run.

    Args:
        run: the folder of a run, or its result.
        measurements: files, or one dataset of `read_measured`.
        options: `channels`, `units`, `rate` as of `read_measured`.

    Returns:
        Alignment, comparison of each channel, findings.

    Raises:
        CaseError: the run or a file cannot be read, or they have no channel in common.
    """
    if isinstance(run, Result):
        case, history, summary = run.case, run.history, run.summary
    else:
        case, history, summary = load_numbers(run)
    first = measurements[0] if measurements else None
    data = first if isinstance(first, xr.Dataset) else read_measured(*measurements, **options)  # type: ignore[arg-type]
    pairs = matched(history, data)
    if "periodicity" not in summary:
        summary = summary_of_run(history, case)
    course, rate, frequency = _course(pairs, case, summary.get("periodicity"))
    turn = case.period if case.is_periodic else None
    drives = [k for k, is_drive in enumerate(pairs.is_drive) if is_drive]
    tips = [k for k, is_drive in enumerate(pairs.is_drive) if not is_drive]
    leaders = drives or tips
    alignment = aligned(
        pairs.time, pairs.measured[leaders], course.only(leaders), rate, is_rate_free=True
    )
    if drives and tips and turn is not None:  # the drive alone cannot tell its periods apart
        low, high = course.starts(rate * (pairs.time - pairs.time[0]), COARSE)[[0, -1]]
        first = alignment.start - turn * np.floor((alignment.start - low) / turn)
        starts = np.arange(first, high + turn, turn)
        others = (pairs.measured[tips], course.only(tips))
        start = best_start(pairs.time, *others, alignment, starts, power=2)
        alignment = replace(alignment, start=start)
    channels = tuple(compared(pairs, k, course, alignment, turn) for k in range(len(pairs.names)))
    drive = 1.0 / turn if turn else None
    if frequency is not None and drive is not None:
        frequency = alignment.rate * drive
    found = findings(channels, alignment, drive)
    return Overlay(case, pairs, course, alignment, frequency, channels, tuple(found))


def _course(
    pairs: Pairs, case: Case, periodicity: int | None
) -> tuple[Course, float, float | None]:
    """Return the motion of the run, s to begin with, and the measured frequency of the drive."""
    if not case.is_periodic:
        return Course.of(pairs.run_time, pairs.computed, None), 1.0, None
    frequency = drive_frequency(pairs.time, pairs.measured, 1.0 / case.period)
    rate = 1.0 if frequency is None else frequency * case.period
    period = None if periodicity is None else periodicity * case.period
    if period and period > pairs.run_time.size * case.time_step * (1.0 + 1e-9):
        period = None
    course = Course.of(pairs.run_time, pairs.computed, period, periodicity or 1)
    return course, rate, frequency

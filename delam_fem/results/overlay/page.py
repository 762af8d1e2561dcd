"""An overlay as one self-contained page: what agrees, what differs, the figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delam_fem.results.figures.style import title
from delam_fem.results.overlay.figures import shown_unit
from delam_fem.results.pages import html
from delam_fem.results.pages.html import Block, Figure, Paragraph, Section, Table, embedded
from delam_fem.results.pages.numbers import shown

if TYPE_CHECKING:
    from delam_fem.results.overlay.whole import Overlay

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
    """Return the page as HTML, with the figures inside.

    Raises:
        OSError: a figure cannot be read.
    """
    numbers = overlay.numbers
    kind = "warning" if overlay.findings else "verdict"
    outcome: list[Block] = [Paragraph(text, kind) for text in list(overlay.sentences())[1:]]
    pictures = [
        Figure([embedded(path)], CAPTIONS[path.stem], CAPTIONS[path.stem]) for path in figures
    ]
    sections = [
        Section("", outcome),
        Section("Alignment", [_alignment(overlay, numbers)]),
        *(Section(name, [_channel(own)]) for name, own in numbers["channels"].items()),
        Section("Figures", pictures),
    ]
    return html.page(f"Measured over {title(overlay.case)}", sections, contents=True)


def _alignment(overlay: Overlay, numbers: dict[str, Any]) -> Table:
    """Return the numbers of the alignment as a table."""
    rows = [
        ("offset", f"{shown(numbers['offset'], 1e3)} ± {shown(numbers['offset_error'], 1e3)} ms",
         f"time of the run minus that of the measurement, at {numbers['first_sample']:.10g} s"),
        ("clock", f"{numbers['clock_rate']:.8g} ± {numbers['clock_rate_error']:.1g}",
         f"seconds of the run in one measured: {shown(numbers['clock_drift'], 1e3)} ms in all"),
        ("method", numbers["method"], "of the alignment"),
        ("samples", f"{numbers['samples']} in {shown(numbers['duration'])} s", "measured"),
    ]  # fmt: skip
    if numbers["measured_frequency"] is not None:
        drive = f"{numbers['measured_frequency']:.6g} Hz; run: {numbers['frequency']:.6g} Hz"
        rows.append(("frequency", drive, "of the drive, from the measurement"))
    if numbers["offset_degrees"] is not None:
        rows.append(("phase", f"{shown(numbers['offset_degrees'])}°", "the offset at the drive"))
    if overlay.pairs.unmatched:
        rows.append(("not in the run", ", ".join(overlay.pairs.unmatched), "left out"))
    return Table(("", "value", "meaning"), rows)


def _channel(own: dict[str, Any]) -> Table:
    """Return the numbers of one channel as a table."""
    rows = []
    for key, (meaning, error) in MEANINGS.items():
        if own.get(key) is None:
            continue
        unit, factor = shown_unit(own["units"]) if key in IN_UNITS else ("", 1.0)
        text = shown(own[key], factor)
        if error and own.get(error) is not None:
            text += f" ± {own[error]:.2g}"
        rows.append((key.replace("_", " "), f"{text}\u00a0{unit}" if unit else text, meaning))
    return Table(("", "value", "meaning"), rows)

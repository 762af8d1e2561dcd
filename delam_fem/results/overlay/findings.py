"""What a comparison says in sentences: agrees, another amplitude, another phase, another motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from delam_fem.results.overlay.comparison import Comparison

SIGNIFICANT = 3.0
"""Standard deviations from which a difference is not the noise's."""
SAME_GAIN, SAME_PHASE, SAME_RATE = 0.05, 5.0, 0.01
"""Differences that are not worth a sentence: of amplitude, of phase [degrees], of frequency."""
SAME_SHAPE = 0.1
"""Share of a motion that the run may leave without a sentence."""
FACTORS = {
    1e3: "as if millimetres were read as metres",
    1e-3: "as if metres were read as millimetres",
    1e6: "as if micrometres were read as metres",
    25.4: "as if inches were millimetres",
    1 / 25.4: "as if millimetres were inches",
    10.0: "as if centimetres were millimetres",
    0.1: "as if millimetres were centimetres",
    2.0: "as if peak-to-peak were an amplitude",
    0.5: "as if an amplitude were peak-to-peak",
    -1.0: "is its sign turned?",
}
"""Ratios that mistakes have, with what they look like."""
NEAR_FACTOR = 0.05
NO_NUMBERS = "not compared, as its gain, delay or correlation is no finite number"


@dataclass(frozen=True)
class Finding:
    """One difference.

    Attributes:
        kind: "frequency", "amplitude", "phase", "shape" or "numbers".
        channel: name; empty: of all channels.
        text: a sentence.
    """

    kind: str
    channel: str
    text: str


def findings(
    channels: Sequence[Comparison],
    *,
    frequency: float | None,
    measured_frequency: float | None,
) -> list[Finding]:
    """Return the differences between a measurement and a run that are worth a sentence.

    Args:
        channels: comparisons.
        frequency: of the run's drive [Hz]; None: there is none.
        measured_frequency: of the measurement [Hz]; None: not found.
    """
    found = list(_of_frequency(frequency, measured_frequency))
    reference = next((own for own in channels if own.is_drive), None)
    reference = reference or min(channels, key=lambda own: abs(own.delay))
    for own in channels:
        numbers = (own.gain, own.gain_error, own.delay, own.delay_error, own.unlike)
        if not all(map(math.isfinite, numbers)):
            found.append(Finding("numbers", own.name, f"{own.name}: {NO_NUMBERS}"))
            continue
        found += _of_shape(own)
        if own is not reference and frequency is not None:
            found += _of_phase(own, reference, frequency)
    return found


def _of_frequency(frequency: float | None, measured: float | None) -> Iterator[Finding]:
    """Yield what the frequencies say."""
    if frequency is None or measured is None:
        return
    ratio = measured / frequency
    if abs(ratio - 1.0) > SAME_RATE:
        yield Finding(
            "frequency", "",
            f"the measurement was driven at {measured:.4g} Hz, the run at {frequency:.4g} Hz; "
            "phases are compared, which is not the same motion",
        )  # fmt: skip


def _of_shape(own: Comparison) -> Iterator[Finding]:
    """Yield whether a channel moves alike, and whether by the same amplitude."""
    is_found = abs(own.gain) > SIGNIFICANT * own.gain_error
    if own.unlike > SAME_SHAPE or not is_found:
        yield Finding(
            "shape", own.name,
            f"{own.name}: the measured motion is not that of the run (correlation "
            f"{own.correlation:.2f}, {100 * own.unlike:.2g} % of it is left)",
        )  # fmt: skip
    if abs(own.gain - 1.0) > max(SAME_GAIN, SIGNIFICANT * own.gain_error):
        factor = next((f for f in FACTORS if abs(own.gain / f - 1.0) < NEAR_FACTOR), None)
        hint = f", {FACTORS[factor]}" if factor is not None else ""
        yield Finding(
            "amplitude", own.name,
            f"{own.name}: measured {own.gain:.4g} ± {own.gain_error:.2g} times the amplitude of "
            f"the run{hint}",
        )  # fmt: skip


def _of_phase(own: Comparison, reference: Comparison, frequency: float) -> Iterator[Finding]:
    """Yield whether a channel has another phase than the drive or, without it, than a channel."""
    turn = 360.0 * frequency
    phase = (turn * (own.delay - reference.delay) + 180.0) % 360.0 - 180.0
    error = turn * max(own.delay_error, reference.delay_error)
    if abs(phase) > max(SAME_PHASE, SIGNIFICANT * error):
        hint = "" if reference.is_drive else "; no drive was measured, so either may be wrong"
        yield Finding(
            "phase", own.name,
            f"{own.name}: measured {abs(phase):.1f}° ± {error:.1g}° "
            f"{'later' if phase > 0 else 'earlier'} than {reference.name}{hint}",
        )  # fmt: skip

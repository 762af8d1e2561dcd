"""The numbers of a run as rows of a table: in the units of the figures, each with its meaning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

UNITS = {
    "wall_seconds": "s", "microseconds_per_step": "µs", "tip_min": "m", "tip_max": "m",
    "minimum_tip_gap": "m", "impact_energy_gain": "J",
}  # fmt: skip
"""Units of the entries of summary.json that have one."""

SHOWN = {"m": ("mm", 1e3), "J": ("mJ", 1e3)}
"""Units that figures show in place of those of summary.json, and the factors."""

PERCENT = (
    "distortion_factor", "thd", "strobe_scatter", "strobe_scatters", "transient", "uncertainty",
    "scatter", "allowed",
)  # fmt: skip
"""Entries that are shown in percent."""

MEANINGS = {
    "outcome": "how the run ended",
    "engine": "what computed the steps",
    "steps": "time steps of the whole run, of all sizes",
    "wall_seconds": "duration of the computation",
    "microseconds_per_step": "duration per time step",
    "unforeseen_contacts": "share of contacts that coarse steps did not see; 0 is good",
    "tip_min": "smallest displacement of each tip over the last periods, base motion included",
    "tip_max": "largest displacement of each tip over the last periods",
    "periodicity": "periods of the excitation after which the motion repeats; – if it does not",
    "periodicity_class": "the same with a margin; undecided: the cycles differ by about 10 %",
    "strobe_scatters": "how much cycles 1, 2, … 8 periods apart differ",
    "strobe_scatter": "how much successive periods differ, in half peak-to-peak amplitudes",
    "settled": "whether the transient has died out; irregular: it has, and no cycle repeats",
    "settling": "the numbers behind it",
    "transient": "what is left of the transient, in half peak-to-peak amplitudes",
    "uncertainty": "two standard errors of the transient",
    "scatter": "how much the cycles scatter, in half peak-to-peak amplitudes",
    "allowed": "transient of a settled motion, at most: 1 %, or the scatter of its cycles",
    "decay": "e-folds of the slowest mode per period, without contact",
    "observed_decay": "e-folds per period by which the cycles draw nearer to one another",
    "periods_judged": "last periods that were judged",
    "periods_needed": "further periods until it has settled, at most; – if nothing bounds them",
    "intervals": "means over windows of an irregular motion with their 95 % intervals",
    "periods": "periods computed",
    "tip_contacts_per_period": "how often the tips meet; closures within 0.05 periods count once",
    "impacts_per_period": "impulses on single pairs; depends on the time step, does not converge",
    "distortion_factor": "d = √(ΣAᵢ²)/A₁ − 1 over all harmonics: how far each tip is from a sine",
    "thd": "amplitude of all higher harmonics over that of the first, for each tip",
    "minimum_tip_gap": "smallest gap at the tips; negative: the contact gives way so far",
    "energy_residual": "relative energy that the ledger does not explain: round-off if all is well",
    "impact_energy_gain": "energy that impacts have added; 0 with laws that only dissipate",
    "unread_keys": "keys of the case that this run did not use",
    "warnings": "warnings of the run",
    "message": "why the run diverged, and what may help",
}
"""What each entry of summary.json says."""


ELSEWHERE = ("warnings", "message")
"""Entries that a page shows above its tables."""
LAST = ("outcome", "periods", "engine", "steps", "wall_seconds", "microseconds_per_step",
        "unforeseen_contacts", "unread_keys")  # fmt: skip
"""Entries about the computation, which follow those about the motion."""


def rows(summary: Mapping[str, Any], laminae: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return table rows: name, value with its unit, meaning.

    Args:
        summary: the numbers of summary.json.
        laminae: names, shown before the values of each lamina.
    """
    intervals = summary.get("intervals") or {}
    values: dict[str, Any] = {}
    for key, value in summary.items():
        if isinstance(value, Mapping):
            values |= value if key == "settling" else {}
        elif key not in (*ELSEWHERE, "settling", "intervals"):
            values[key] = value
    return [
        _interval_row(key, intervals[key], laminae)
        if key in intervals
        else _row(key, values[key], laminae)
        for key in sorted(values, key=LAST.__contains__)
    ]


def _interval_row(
    key: str, entry: Mapping[str, Any], laminae: Sequence[str]
) -> tuple[str, str, str]:
    """Return the row of a number with its interval."""
    unit, factor = _shown_unit(key)
    means, widths = (np.atleast_1d(entry[name]) for name in ("mean", "half_width"))
    names = [f"{name} " for name in laminae] if means.size == len(laminae) else [""] * means.size
    parts = [
        f"{name}{shown(float(mean), factor)} ± {factor * float(width):.2g}"
        for name, mean, width in zip(names, means, widths, strict=True)
    ]
    text = ", ".join(parts) + (f"\u00a0{unit}" if unit else "")
    meaning = f"mean and 95 % interval, {entry['windows']} windows in {entry['periods']} periods"
    return key.replace("_", " "), text, f"{meaning}: {MEANINGS.get(key, '')}"


def _shown_unit(key: str) -> tuple[str, float]:
    """Return the unit in which an entry is shown, and the factor to it."""
    if key in PERCENT:
        return "%", 100.0
    return SHOWN.get(UNITS.get(key, ""), (UNITS.get(key, ""), 1.0))


def _row(key: str, value: Any, laminae: Sequence[str]) -> tuple[str, str, str]:
    """Return one row."""
    unit, factor = _shown_unit(key)
    if isinstance(value, (list, tuple, np.ndarray)):
        of_laminae = len(value) == len(laminae) and not any(isinstance(v, str) for v in value)
        names = [f"{name} " for name in laminae] if of_laminae else [""] * len(value)
        parts = [name + shown(entry, factor) for name, entry in zip(names, value, strict=True)]
        text = ", ".join(parts) or "none"
    else:
        text = shown(value, factor)
    with_unit = f"{text}\u00a0{unit}" if unit and value is not None else text
    return key.replace("_", " "), with_unit, MEANINGS.get(key, "")


def shown(value: Any, factor: float = 1.0) -> str:
    """Return a value of the summary as text; numbers are multiplied."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return ", ".join(shown(entry, factor) for entry in value)
    if isinstance(value, float):
        return f"{factor * value:.4g}".replace("-", "−")
    return "–" if value is None else str(value)

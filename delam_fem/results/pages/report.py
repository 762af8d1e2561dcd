"""A run as one self-contained page: report.html with its figures inside, nothing to load."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.atomic import write_text
from delam_fem.case.definition import Case
from delam_fem.results.figures.contact import FLOWS
from delam_fem.results.figures.style import title
from delam_fem.results.pages import html
from delam_fem.results.pages.html import Figure, Paragraph, Preformatted, Section, Table, embedded

CAPTIONS = {
    "laminae": "The deformed laminae about the strongest strike of the window.",
    "tip_histories": (
        "Positions of the tips over the last periods: yᵢ is the displacement qᵢ plus the gaps at "
        "rest below lamina i."
    ),
    "phase_portraits": "Phase portraits of the tips.",
    "spectra": "Amplitude spectra of the tip displacements.",
    "contact_line": "Where and when neighbouring laminae touch.",
    "energy_ledger": "What changed the energy in each period, and what was stored at its end.",
    "envelope": "Tip displacements within each period of the whole run.",
}
"""Captions of the figures in the order of the report; missing figures are left out."""

UNITS = {
    "wall_seconds": "s", "microseconds_per_step": "µs", "tip_min": "m", "tip_max": "m",
    "minimum_tip_gap": "m", "impact_energy_gain": "J",
}  # fmt: skip
"""Units of the entries of the summary that have one."""

ORIGIN = ("delam_fem", "dolfinx", "petsc", "numpy", "engine", "outcome")
"""Attributes of the history with its origin."""


def write_report(
    history: xr.Dataset, summary: Mapping[str, Any], case: Case, directory: str | Path
) -> Path:
    """Write report.html with the figures found in the folder `figures` beside it.

    Args:
        history: of a run; see `schema.VARIABLES`.
        summary: the numbers of summary.json.
        case: the case.
        directory: made where it does not exist.

    Returns:
        The file.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    text = page(history, summary, case, directory / "figures")
    return write_text(directory / "report.html", text)


def page(history: xr.Dataset, summary: Mapping[str, Any], case: Case, figures: Path) -> str:
    """Return the page as HTML."""
    names = ", ".join(str(name) for name in history["lamina"].to_numpy())
    about = f"Over the window of the last periods; laminae from bottom to top: {names}."
    flows = "What changed the stored energy, added up over the run and in the last period."
    energy = Table(("", "whole run [J]", "last period [J]"), energy_rows(history))
    origin = [(name, str(history.attrs[name]), "") for name in ORIGIN if name in history.attrs]
    sections = [
        Section("Summary", [Paragraph(about), Table(("", "value", "unit"), summary_rows(summary))]),
        Section("Figures", _figures(figures)),
        Section("Energy", [Paragraph(flows), energy]),
        Section("Case", [Preformatted(case.to_toml())]),
        Section("Made by", [Table(("", "version", ""), origin)]),
    ]
    return html.page(title(case), sections)


def summary_rows(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return table rows: name, value, unit."""
    return [
        (key.replace("_", " "), _shown(value), UNITS.get(key, "")) for key, value in summary.items()
    ]


def energy_rows(history: xr.Dataset) -> list[tuple[str, str, str]]:
    """Return table rows: what changed the stored energy, over the run and in the last period."""
    rows = []
    for name, sign, label, _ in FLOWS:
        column = sign * history[f"energy_{name}"].to_numpy()
        if column.any():
            rows.append((label, f"{column.sum():+.4g}", f"{column[-1]:+.4g}"))
    residual = history["energy_residual"].to_numpy()
    return [*rows, ("not accounted for", f"{residual.sum():+.1e}", f"{residual[-1]:+.1e}")]


def _shown(value: Any) -> str:
    """Return a value of the summary as text."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return ", ".join(_shown(entry) for entry in value)
    if isinstance(value, float):
        return f"{value:.4g}"
    return "–" if value is None else str(value)


def _figures(directory: Path) -> list[Figure]:
    """Return the figures that exist in the folder, embedded."""
    found = {directory / f"{name}.png": caption for name, caption in CAPTIONS.items()}
    return [
        Figure([embedded(path)], caption, caption)
        for path, caption in found.items()
        if path.is_file()
    ]

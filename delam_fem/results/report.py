"""A run as one self-contained page: report.html with its figures inside, nothing to load."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.atomic import write_text
from delam_fem.case.definition import Case
from delam_fem.results.contact_figures import FLOWS
from delam_fem.results.style import title

CAPTIONS = {
    "laminae": "The deformed laminae about the strongest strike of the window.",
    "tip_histories": "Positions of both tips over the last periods, y₁ = q₁ and y₂ = g₀(L) + q₂.",
    "phase_portraits": "Phase portraits of both tips.",
    "spectra": "Amplitude spectra of both tip displacements.",
    "contact_line": "Where and when the laminae touch.",
    "energy_ledger": "What changed the energy in each period, and what was stored at its end.",
    "envelope": "Tip displacements within each period of the whole run.",
}
"""Figures of the report, in its order; those that are missing are left out."""

UNITS = {
    "wall_seconds": "s", "microseconds_per_step": "µs", "tip_min": "m", "tip_max": "m",
    "minimum_tip_gap": "m",
}  # fmt: skip
"""Units of the entries of the summary that have one."""

ORIGIN = ("delam_fem", "dolfinx", "petsc", "numpy", "engine", "outcome")
"""Attributes of the history that say what made it."""

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 60rem;
       margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.5rem; }
table { border-collapse: collapse; } td, th { padding: .2rem .9rem .2rem 0; text-align: left;
        border-bottom: 1px solid #ddd; }
figure { margin: 1.5rem 0; } img { max-width: 100%; } figcaption { color: #555; }
pre { background: #f4f4f4; padding: 1rem; overflow-x: auto; font-size: .85rem; }
"""


def write_report(
    history: xr.Dataset, summary: Mapping[str, Any], case: Case, directory: str | Path
) -> Path:
    """Write report.html with the figures found in the folder `figures` beside it.

    Args:
        history: of a run; see results.py.
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
    heading = escape(title(case))
    origin = [(name, str(history.attrs[name]), "") for name in ORIGIN if name in history.attrs]
    parts = [
        f"<h1>{heading}</h1>",
        "<h2>Summary</h2>",
        f"<p>Over the window of the last periods; laminae in the order {_names(history)}.</p>",
        _table(("", "value", "unit"), summary_rows(summary)),
        "<h2>Figures</h2>",
        *_figures(figures),
        "<h2>Energy</h2>",
        "<p>What changed the stored energy, added up over the run and in the last period.</p>",
        _table(("", "whole run [J]", "last period [J]"), energy_rows(history)),
        "<h2>Case</h2>",
        f"<pre>{escape(case.to_toml())}</pre>",
        "<h2>Made by</h2>",
        _table(("", "version", ""), origin),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{heading}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(parts)
        + "\n</body>\n</html>\n"
    )


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


def _names(history: xr.Dataset) -> str:
    return escape(", ".join(str(name) for name in history["lamina"].to_numpy()))


def _shown(value: Any) -> str:
    """Return a value of the summary as text."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return ", ".join(_shown(entry) for entry in value)
    if isinstance(value, float):
        return f"{value:.4g}"
    return "–" if value is None else str(value)


def _figures(directory: Path) -> Iterable[str]:
    """Yield the figures that are there, embedded."""
    for name, caption in CAPTIONS.items():
        path = directory / f"{name}.png"
        if path.is_file():
            data = base64.b64encode(path.read_bytes()).decode("ascii")
            text = escape(caption, quote=True)
            yield (
                f'<figure><img alt="{text}" src="data:image/png;base64,{data}">'
                f"<figcaption>{text}</figcaption></figure>"
            )


def _table(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as HTML; all entries are escaped."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heading)
    body = "\n".join(
        "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows
    )
    return f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"

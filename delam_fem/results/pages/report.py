"""A run as one self-contained page: report.html with figures and film inside, nothing to load."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from delam_fem.case.atomic import write_text
from delam_fem.case.definition import Case
from delam_fem.results.figures.contact import FLOWS
from delam_fem.results.figures.style import title
from delam_fem.results.pages import html, numbers, verdict
from delam_fem.results.pages.film import film
from delam_fem.results.pages.html import (
    Block,
    Figure,
    Paragraph,
    Preformatted,
    Section,
    Table,
    embedded,
)
from delam_fem.results.schema import SENSOR, sensors_of

CAPTIONS = {
    "laminae": "The deformed laminae about the strongest strike of the window.",
    "solid": (
        "Von Mises stress and stress along the solid laminae after the strongest strike, their "
        "thickness drawn larger."
    ),
    "tip_histories": (
        "Positions of the reference probes over the last periods: yᵢ is the displacement qᵢ plus "
        "the gaps at rest below lamina i."
    ),
    "phase_portraits": "Phase portraits of the reference probes.",
    "sensors": "Signals of the sensors over the last periods.",
    "spectra": "Amplitude spectra of the displacements at the reference probes.",
    "contact_line": "Where and when neighbouring laminae touch.",
    "energy_ledger": "What changed the energy in each period, and what was stored at its end.",
    "envelope": "Displacements at the reference probes within each period of the whole run.",
}
"""Captions of the figures in the order of the report; missing figures are left out."""

MOST_BYTES = 3_000_000
"""Size of all pictures up to which they are put in as SVG: a page stays below 5 MB."""

FILES = {
    "case.toml": "the complete case; it repeats the run",
    "result.nc": "all numbers, NetCDF",
    "summary.json": "the numbers above, SI units",
    "fields/fields.vtkhdf": "the laminae of all frames for ParaView",
    "fields/solid.vtkhdf": "the solid laminae of all frames with their stresses",
    "fields/fields.pvd": "the laminae of the last period, one file per frame",
    "fields/fields.bp": "the middle lines, for ParaView's ADIOS2 reader",
    "fields/solid.bp": "the solid laminae, for ParaView's ADIOS2 reader",
    "figures": "the figures as PNG and SVG",
}
"""Files beside the page with what they are; missing ones are left out."""

ORIGIN = (
    "delam_fem", "git_revision", "dolfinx", "petsc", "numpy", "numba", "blas", "processor", "host",
    "command", "engine", "outcome",
)  # fmt: skip
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
    return write_text(directory / "report.html", page(history, summary, case, directory))


def page(history: xr.Dataset, summary: Mapping[str, Any], case: Case, directory: Path) -> str:
    """Return the page as HTML.

    Args:
        history: of a run.
        summary: the numbers of summary.json.
        case: the case.
        directory: of the results; the page shows its figures and names its files.
    """
    names = [str(name) for name in history["lamina"].to_numpy()]
    about = f"Over the window of the last periods; laminae from bottom to top: {', '.join(names)}."
    flows = "What changed the stored energy, added up over the run and in the last period."
    energy = Table(("", "whole run [mJ]", "last period [mJ]"), energy_rows(history))
    origin = [(name, str(history.attrs[name])) for name in ORIGIN if name in history.attrs]
    table = Table(("", "value", "meaning"), numbers.rows(summary, names), kind="meanings")
    sections = [
        Section("", [*_verdict(history, summary, case)]),
        Section("In motion", [film(history, case) or Paragraph(NO_FRAMES, "about")]),
        Section("Numbers", [Paragraph(about, "about"), table]),
        Section("Figures", _figures(directory / "figures")),
        *_sensors(history),
        Section("Energy", [Paragraph(flows, "about"), energy]),
        Section("Files", [html.files(directory, FILES)]),
        Section("Case", [Preformatted(case.to_toml())]),
        Section("Made by", [Table(("", "version"), origin)]),
    ]
    return html.page(title(case), sections, contents=True)


NO_FRAMES = "There is no film, because output.fields_per_period is 0 or the motion is not finite."


def _sensors(history: xr.Dataset) -> Iterator[Section]:
    """Yield the section on the sensors, if there are any."""
    if found := sensor_rows(history):
        heading = ("sensor", "what it measures", "smallest", "largest", "rms")
        yield Section("Sensors", [Table(heading, found)])


def sensor_rows(history: xr.Dataset) -> list[tuple[str, ...]]:
    """Return table rows of all sensors over the window: what, smallest, largest, rms."""
    rows = []
    for name in sensors_of(history):
        own = history[name]
        values, unit = own.to_numpy(), str(own.attrs["units"])
        numbers_of = (values.min(), values.max(), np.sqrt(np.mean(values**2)))
        shown = (f"{value:.4g} {unit}".replace("-", "−") for value in numbers_of)
        rows.append((name.removeprefix(SENSOR), str(own.attrs["long_name"]), *shown))
    return rows


def energy_rows(history: xr.Dataset) -> list[tuple[str, str, str]]:
    """Return table rows [mJ]: what changed the stored energy, over the run and the last period."""
    rows = []
    for name, sign, label, _ in FLOWS:
        if f"energy_{name}" not in history:
            continue
        column = 1e3 * sign * history[f"energy_{name}"].to_numpy()
        if column.any():
            rows.append((label, _signed(column.sum(), ".4g"), _signed(column[-1], ".4g")))
    rest = 1e3 * history["energy_residual"].to_numpy()
    return [*rows, ("not accounted for", _signed(rest.sum(), ".1e"), _signed(rest[-1], ".1e"))]


def _signed(value: float, form: str) -> str:
    """Return a number with its sign."""
    return f"{value:+{form}}".replace("-", "−")


def _verdict(history: xr.Dataset, summary: Mapping[str, Any], case: Case) -> Iterator[Block]:
    """Yield the sentence on the run, and its warnings."""
    yield Paragraph(verdict.sentence(history, summary, case), "verdict")
    for text in (summary.get("message"), *summary.get("warnings", ())):
        if text:
            yield Paragraph(str(text), "warning")


def _figures(directory: Path) -> list[Figure]:
    """Return the figures that exist in the folder, embedded; SVG before PNG while there is room."""
    found, size = [], 0
    for name, caption in CAPTIONS.items():
        for picture in (directory / f"{name}.svg", directory / f"{name}.png"):
            if not picture.is_file():
                continue
            own = picture.stat().st_size
            if picture.suffix == ".png" or size + own <= MOST_BYTES:
                found.append(Figure([embedded(picture)], caption, caption))
                size += own
                break
    return found

"""Make tables and figures of docs/evidence/convergence.md from the studies of `study.py`."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from refinements.study import DAMPINGS
from refinements.tables import document_tables

from delam_fem.api import assemble, preset, style
from delam_fem.studies.convergence.analysis import (
    Convergence,
    Table,
    error_over_cost,
    free_over,
    limit_over_meshes,
    work_over_steps,
)

SHOWN_PERIODS = 240
"""Number of periods in the figure of the literal scheme."""


@dataclass(frozen=True)
class Document:
    """The tables of the document by name, and the functions that draw its figures by name."""

    tables: dict[str, Table]
    figures: dict[str, Callable[[], Figure]]


def document(found: dict[str, Convergence]) -> Document:
    """Return the tables and figures of the document; `found`: computed studies by name."""
    figures: dict[str, Callable[[], Figure]] = {"literal": literal_figure}
    for damping in DAMPINGS:
        name = damping.replace("-", "_")
        figures[f"cost_{name}"] = partial(error_over_cost, found[f"errors {damping}"])
        figures[f"work_{name}"] = partial(work_over_steps, found[f"uniform {damping}"])
        figures[f"meshes_{name}"] = partial(limit_over_meshes, found[f"meshes {damping}"])
    figures["free_steps"] = partial(free_over, direction="steps", found=found["errors two-mode"])
    figures["free_elements"] = partial(
        free_over, direction="elements", found=found["meshes two-mode"]
    )
    return Document(document_tables(found), figures)


def fill(text: str, tables: dict[str, Table], folder: Path | None = None) -> str:
    """Return the text of a document with new tables.

    A table lies between the lines `<!-- table NAME -->` and `<!-- end -->`. Where the document says
    `<!-- table NAME in FILE -->`, the table is written to this file, as CSV.

    Args:
        text: text of the document.
        tables: new tables by name.
        folder: folder of the document, from which names of files count.

    Returns:
        The text in which these tables are replaced.

    Raises:
        KeyError: the document has no place for a table, or more than one.
    """
    for name, table in tables.items():
        pattern = re.compile(rf"(<!-- table {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
        body = table.markdown().split("\n\n", 1)[1]
        text, places = pattern.subn(partial(_framed, body), text)
        files = re.findall(rf"<!-- table {re.escape(name)} in (\S+) -->", text)
        if places + len(files) != 1:
            n = places + len(files)
            raise KeyError(f"table {name}: expected one place in the document, found {n}")
        for file in files:
            write_csv((folder or Path()) / file, table)
    return text


def write_csv(path: Path, table: Table) -> None:
    """Write a table to a file of comma-separated values."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = [[cell.replace("**", "") for cell in row] for row in table.rows]
        csv.writer(file, lineterminator="\n").writerows([table.heading, *rows])


def _framed(body: str, match: re.Match[str]) -> str:
    """Return a text between the two marks that a match contains."""
    return match[1] + body + match[2]


def literal_figure() -> Figure:
    """Draw the motion of tip 1 with Newton's law, by lumped (literal) and consistent impulses."""
    from delam_fem.api import run

    figure = Figure(figsize=(style.WIDTH, 4.4), layout="constrained")
    axes = figure.subplots()
    runs = (
        ("mass", 20, style.VERMILLION),
        ("stiffness", 50, style.BLUE),
        ("two-mode", 80, style.GREEN),
    )
    for damping, elements, colour in runs:
        for impulse, line in (("lumped", "-"), ("consistent", "--")):
            keys = {"contact.law": "newton", "contact.impulse": impulse, "mesh.elements": elements}
            few = {"time.periods": SHOWN_PERIODS, "time.steps_per_period": 1000}
            chosen = preset("paper", {**keys, **few, "damping.rayleigh": damping})
            history = run(
                chosen, "compiled", structure=assemble(chosen, needs_dolfinx=False)
            ).history
            y1 = 1e3 * np.abs(history["envelope_min"].to_numpy()[0])
            label = f"{damping}, {elements} elements, {impulse} impulses"
            axes.semilogy(np.arange(1, y1.size + 1), y1, line, color=colour, label=label)
    axes.axhline(1e3 * chosen.lamina[0].length, color=style.BLACK, linestyle=":", label="length")
    axes.set(xlabel="period of the excitation", ylabel="largest −y1 in the period [mm]")
    axes.legend()
    figure.suptitle("3.25 Hz, newton, consistent mass, T/1000")
    return figure

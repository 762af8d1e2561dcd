"""Draw and write the figures of a run; the other modules draw each of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import xarray as xr
from matplotlib.figure import Figure

from delam_fem.case.atomic import atomic
from delam_fem.case.definition import Case
from delam_fem.results.figures import contact, motion, sensors
from delam_fem.results.figures.style import styled
from delam_fem.results.schema import sensors_of

FIGURES: dict[str, Callable[[xr.Dataset, Case], Figure]] = {
    "tip_histories": motion.tip_histories,
    "phase_portraits": motion.phase_portraits,
    "spectra": motion.spectra,
    "contact_line": contact.contact_line,
    "energy_ledger": contact.energy_ledger,
    "envelope": motion.envelope,
}
"""The figures of every run by the names of their files."""
OF_SENSORS = {"sensors": sensors.sensors}
"""The figures of runs with sensors."""
KINDS = ("png", "svg")
"""Formats of each figure."""
_METADATA: dict[str, dict[str, str | None]] = {".png": {}, ".svg": {"Date": None}}
"""What the files say of themselves; without a date, the same figure is the same file."""


class Plots:
    """The figures of one run as methods without arguments: `plots.tip_histories()`.

    They return matplotlib's figures, which a notebook shows. `dir(plots)` lists them.
    """

    def __init__(self, history: xr.Dataset, case: Case) -> None:
        """Keep what the figures are drawn from."""
        self._history, self._case = history, case

    def __dir__(self) -> list[str]:
        """List the figures."""
        return list(figures_of(self._history))

    def __getattr__(self, name: str) -> Callable[[], Figure]:
        """Return the function that draws a figure."""
        found = {} if name.startswith("_") else figures_of(self._history)
        if name not in found:
            raise AttributeError(f"no figure {name!r}; there are {', '.join(found)}")
        draw, history, case = found[name], self._history, self._case

        def drawn() -> Figure:
            with styled():
                return draw(history, case)

        return drawn


def figures_of(history: xr.Dataset) -> dict[str, Callable[[xr.Dataset, Case], Figure]]:
    """Return the figures of a run by the names of their files."""
    return FIGURES | (OF_SENSORS if sensors_of(history) else {})


def save_figures(history: xr.Dataset, case: Case, directory: str | Path) -> list[Path]:
    """Draw all figures and write them as PNG and SVG.

    A spectrum needs a whole period in the window; without one it is left out.

    Args:
        history: of a run, however short; see `schema.VARIABLES`.
        case: its case.
        directory: made where it does not exist.

    Returns:
        The files, PNG and SVG of each figure, in the order of `figures_of`.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    has_period = history.sizes["time"] >= case.steps_per_period
    figures = figures_of(history)
    names = [name for name in figures if has_period or name != "spectra"]
    for name in (FIGURES | OF_SENSORS).keys() - set(names):
        for kind in KINDS:
            (directory / f"{name}.{kind}").unlink(missing_ok=True)  # of an earlier run
    return [
        path
        for name in names
        for path in save_figure(figures[name], history, case, directory / name)
    ]


def save_figure(
    draw: Callable[[xr.Dataset, Case], Figure], history: xr.Dataset, case: Case, path: Path
) -> list[Path]:
    """Draw one figure and write it as PNG and SVG.

    Args:
        draw: function of the history and the case.
        history: of a run.
        case: its case.
        path: of the files, without suffix.

    Returns:
        The files.

    Raises:
        OSError: a file cannot be written.
    """
    paths = [path.with_suffix(f".{kind}") for kind in KINDS]
    with styled():
        figure = draw(history, case)
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)  # once for both files; each would find it twice
            figure.set_layout_engine(None)
        for target in paths:
            with atomic(target) as temporary:
                figure.savefig(temporary, metadata=_METADATA[target.suffix])
    return paths

"""Write what `df.solve` returns: the dataset, a figure, and a page with the energy ledger."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from delam_fem.engines.session import Solution
from delam_fem.results.folder import RESULT, write_dataset
from delam_fem.results.schema import provenance
from delam_fem.studies.findings import Report, Table

if TYPE_CHECKING:
    import xarray as xr


def save(solution: Solution, directory: str | Path, title: str = "Own operators") -> list[Path]:
    """Write result.nc, summary.json, the histories of the probes, and report.html.

    Several ranks have the same solution: let one of them write.

    Args:
        solution: of `solve`, with probes.
        directory: made where it does not exist.
        title: of the page.

    Returns:
        The files written.

    Raises:
        OSError: a file cannot be written.
    """
    directory, data = Path(directory), solution.history.assign_attrs(provenance())
    directory.mkdir(parents=True, exist_ok=True)
    numbers = {
        "outcome": solution.outcome,
        "impacts": int(data.sizes["event"]),
        "energy_residual": float(data.attrs["energy_residual"]),
        "lowest_displacement": data["displacement"].min("time").values.tolist(),
        "highest_displacement": data["displacement"].max("time").values.tolist(),
        "probes": list(solution.names),
    }
    ledger = [
        (str(data[name].attrs["long_name"]), *(f"{v:.6g}" for v in (values[-1], sum(values))))
        for name in data
        if str(name).startswith("energy_") and len(values := data[name].values)
    ]
    report = Report(
        name="summary",
        numbers=numbers,
        files=[RESULT],
        title=title,
        sentences=[
            f"{solution.outcome.capitalize()}, {numbers['impacts']} impacts in the window. The "
            f"energy balance of a period is open by {numbers['energy_residual']:.2g} at most."
        ],
        tables=[Table("energy ledger [J]", ("", "last period", "all periods"), ledger)],
        pictures={"figures/probes": (partial(_histories, data), "Displacements of the probes")},
    )
    return [write_dataset(data, directory / RESULT), *report.save(directory)]


def _histories(data: xr.Dataset) -> Figure:
    """Draw the displacements of the probes over time, and the instants of impacts."""
    figure = Figure()
    axes = figure.subplots()
    for number in range(data.sizes["probe"]):
        row = data["displacement"].isel(probe=number)
        name = str(row["probe"].values) if "probe" in data.coords else f"probe {number + 1}"
        axes.plot(data["time"], 1e3 * row, label=name)
    low, _ = axes.get_ylim()
    axes.plot(data["event_time"], np.full(data.sizes["event"], low), "|", color="k")
    axes.set(xlabel="time [s]", ylabel="displacement [mm]")
    axes.legend()
    return figure

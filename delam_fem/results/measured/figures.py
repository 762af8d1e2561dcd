"""Draw frequency responses: amplitude, phase and coherence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from delam_fem.case.atomic import atomic
from delam_fem.results.figures.style import WIDTH, lamina_colours, legend_above, styled

FILE = "responses.png"


def save_responses(data: xr.Dataset, directory: Path) -> Path:
    """Write the figure of the responses of a measurement.

    Raises:
        OSError: the file cannot be written.
    """
    path = directory / FILE
    with styled(), atomic(path) as temporary:
        responses(data).savefig(temporary)
    return path


def responses(data: xr.Dataset) -> Figure:
    """Draw amplitudes, phases and, where there is one, the coherence over the frequency."""
    names = [str(name) for name in data["output"].to_numpy()]
    figure = Figure(figsize=(WIDTH, 7.5), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True, height_ratios=[2, 1, 1])
    f = data["frequency"].to_numpy()[1:]
    for k, (name, colour) in enumerate(zip(names, lamina_colours(len(names)), strict=True)):
        h = data["response"].to_numpy()[1:, k]
        panels[0].semilogy(f, np.where(h == 0.0, np.nan, np.abs(h)), color=colour, label=name)
        panels[1].plot(f, np.degrees(np.angle(h)), ".", markersize=2, color=colour)
        if "coherence" in data:
            panels[2].plot(f, data["coherence"].to_numpy()[1:, k], color=colour)
    panels[0].set_ylabel(f"amplitude [{data['response'].attrs.get('units', '')}]")
    panels[1].set(ylabel="phase [°]", ylim=(-190, 190), yticks=[-180, -90, 0, 90, 180])
    panels[2].set(ylabel="coherence", ylim=(0.0, 1.05))
    for panel in panels:
        panel.set_xlabel("frequency [Hz]")
        panel.tick_params(labelbottom=True)
    legend_above(panels[0])
    figure.suptitle(str(data["response"].attrs.get("long_name", "frequency responses")))
    return figure

"""The laminae of all frames as a film for a page: positions and contacts, quantised."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.results.fields import derived
from delam_fem.results.fields.ribbons import drawable_frames, middle_lines
from delam_fem.results.figures.style import lamina_colours
from delam_fem.results.pages.html import Film

MOST_NUMBERS = 300_000
"""Positions that a film holds at most: they make a page 0.8 MB larger."""
MOST_NODES = 101
"""Nodes that a film shows of each lamina at most."""
LARGEST = 32_000
"""Largest quantised position; int16 holds it."""


def film(history: xr.Dataset, case: Case) -> Film | None:
    """Return the film of a run.

    Where there are too many nodes, some are left out; where there are too many frames, the first
    periods are left out.

    Returns:
        The film; None if no frame has finite values.
    """
    history = drawable_frames(history)
    if not history.sizes["frame"]:
        return None
    nodes = _nodes(history.sizes["node"])
    per_frame = history.sizes["lamina"] * nodes.size
    last = slice(-max(1, MOST_NUMBERS // per_frame), None)
    u = history["displacement"].to_numpy()
    largest = max(float(np.abs(u).max()), float(history["gap0"].max()))
    factor = _factor(largest, sum(lamina.thickness for lamina in case.lamina))
    y = middle_lines(history, case, factor)[:, None] + factor * u
    y = 1e3 * y.transpose(1, 0, 2)[last][..., nodes]
    unit = float(np.abs(y).max()) / LARGEST or 1.0
    data = {
        "names": [str(name) for name in history["lamina"].to_numpy()],
        "colours": list(lamina_colours(history.sizes["lamina"])),
        "thickness": [1e3 * lamina.thickness for lamina in case.lamina],
        "x": _short(1e3 * history["x"].to_numpy()[nodes]),
        "time": _short(history["frame"].to_numpy()[last]),
        "period": case.period if case.is_periodic else None,
        "unit": unit,
        "factor": factor,
        "y": _text(np.rint(y / unit).astype("<i2")),
        "lit": _text(_around(derived.contact_lights(history)[last], nodes)),
        "held": derived.held_ends(case),
    }
    caption = (
        "The laminae in motion, with orange dots where pairs have been hit since the frame before "
        "and squares where they rest on one another; the strip below shows the last nodes. "
        "Between two frames the motion is interpolated."
    )
    if factor != 1.0:
        caption += f" Deflections and gaps are drawn {factor:g} times as large as they are."
    return Film(data, "The laminae in motion", caption)


def _factor(largest: float, thickness: float) -> float:
    """Return 1, or a power of ten that makes small lengths larger than the thickness."""
    if largest == 0.0 or largest >= thickness:
        return 1.0
    return float(10.0 ** np.ceil(np.log10(thickness / largest)))


def _nodes(count: int) -> npt.NDArray[np.int64]:
    """Return the nodes that are shown, both ends among them."""
    shown = np.linspace(0, count - 1, min(count, MOST_NODES))
    nodes: npt.NDArray[np.int64] = np.rint(shown).astype(np.int64)
    return nodes


def _around(values: npt.NDArray[Any], nodes: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
    """Return the largest value of the nodes nearest to each shown node."""
    first = np.concatenate([[0], (nodes[:-1] + nodes[1:]) // 2 + 1])
    largest: npt.NDArray[Any] = np.maximum.reduceat(values, first, axis=-1)
    return largest


def _short(values: npt.NDArray[Any]) -> list[float]:
    """Return numbers with seven digits."""
    return [float(f"{value:.7g}") for value in values]


def _text(values: npt.NDArray[Any]) -> str:
    """Return an array as base64."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")

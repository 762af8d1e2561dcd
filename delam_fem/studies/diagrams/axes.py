"""Read from the dataset of a sweep what all diagrams need: axes, title, required variables."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray

if TYPE_CHECKING:
    import xarray as xr


_EVEN = 1e-6
"""Relative difference of steps up to which a spacing counts as even."""


@dataclass(frozen=True)
class DiagramAxis:
    """An axis of a sweep as a diagram shows it.

    Attributes:
        name: name of the coordinate.
        key: key of the case.
        values: values along the axis, shape (n,).
        shown: values in the unit of the label, or 0, 1, … for words, shape (n,).
        label: label of the axis, with its unit.
        words: labels of the ticks of an axis of words; empty for numbers.
    """

    name: str
    key: str
    values: FloatArray
    shown: FloatArray
    label: str
    words: tuple[str, ...] = ()

    @property
    def is_logarithmic(self) -> bool:
        """Whether the values are evenly spaced on a logarithmic axis but not on a linear one."""
        v = self.shown
        if v.size < 3 or v.min() <= 0.0 or self.words:
            return False
        steps, ratios = np.diff(v), np.diff(np.log(v))
        return bool(
            np.ptp(ratios) < _EVEN * np.abs(ratios).max() <= np.ptp(steps)
            or (
                np.ptp(ratios) < _EVEN * np.abs(ratios).max()
                and np.ptp(steps) > _EVEN * np.abs(steps).max()
            )
        )


def axes_of(data: xr.Dataset, count: int, kind: str) -> tuple[DiagramAxis, ...]:
    """Return the axes of a sweep, and check their number.

    Args:
        data: dataset of the sweep.
        count: required number of axes.
        kind: kind of the diagram, for the message.

    Raises:
        CaseError: the sweep has more or fewer axes.
    """
    names = [str(name) for name in data["outcome"].dims if name != "direction"]
    if len(names) != count:
        raise CaseError(
            f"diagram {kind}: expected a sweep over {count} "
            f"{'axis' if count == 1 else 'axes'}, given {', '.join(names)}; select one value of "
            "the others: data.isel(name=0)"
        )
    return tuple(_axis(data, name) for name in names)


def _axis(data: xr.Dataset, name: str) -> DiagramAxis:
    """Return one axis; lengths are shown in millimetres."""
    coordinate = data[name]
    key, text = str(coordinate.attrs["key"]), str(coordinate.attrs["long_name"])
    units = str(coordinate.attrs.get("units", ""))
    if not units:
        words = tuple(str(word) for word in coordinate.to_numpy())
        places = np.arange(float(len(words)))
        return DiagramAxis(name, key, places, places, text, words)
    values = coordinate.to_numpy().astype(np.float64)
    factor, unit = (1e3, "mm") if units == "m" else (1.0, "–" if units == "1" else units)
    return DiagramAxis(name, key, values, factor * values, f"{text}  [{unit}]")


def require(data: xr.Dataset, name: str, remedy: str) -> None:
    """Check that a dataset has a variable.

    Raises:
        CaseError: the variable is missing; the message contains the remedy.
    """
    if name not in data:
        raise CaseError(f"diagram: the sweep has no {name}; compute it with {remedy}")


def is_unsettled(data: xr.Dataset) -> xr.DataArray:
    """Return which points were completed, but have not settled."""
    is_completed = data["outcome"] == "completed"
    return is_completed & ((data["settled"] == 0.0) if "settled" in data else False)


def sweep_keys(data: xr.Dataset) -> dict[str, object]:
    """Return the sweep file as `tomllib` returns it; empty if the dataset does not have it."""
    return tomllib.loads(data.attrs.get("sweep", ""))


def heading(data: xr.Dataset) -> str:
    """Return a short description of the base case, without the keys that an axis changes."""
    case = Case.from_toml(data.attrs["case"])
    keys = {str(data[name].attrs.get("key")) for name in data.coords}
    motion, contact = case.excitation, case.contact
    parts = []
    if motion.kind == "harmonic" and "excitation.frequency" not in keys:
        parts.append(f"{motion.frequency:g} Hz")
    if not {"excitation.amplitude", "excitation.acceleration"} & keys:
        parts.append(motion.size)
    if "contact.law" not in keys:
        parts.append(f"contact: {contact.law}")
    if "contact.restitution" not in keys:
        parts.append(f"e = {contact.restitution:g}")
    is_open = case.time.periods == "settled"
    parts.append("each point until settled" if is_open else f"{case.n_periods} periods per point")
    return f"{case.name}: {', '.join(parts)}"

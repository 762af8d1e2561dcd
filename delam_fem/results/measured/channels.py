"""Columns of measurements: their names, their units, and those that are parts of responses."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from delam_fem.case.toml import shown
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError

Values = npt.NDArray[Any]
"""Real or complex values, shape (n,)."""

TIMES = {"t", "time", "zeit", "temps", "tempo", "seconds", "sekunden"}
FREQUENCIES = {"f", "freq", "frequency", "frequenz", "frequencies"}
POSITIONS = {"x", "position", "pos"}
"""Names of columns that are axes of the others, in lower case."""
HEADING = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\))?\s*$")
"""A name with its unit behind it."""
AXES = {"time": TIMES, "frequency": FREQUENCIES, "x": POSITIONS}


@dataclass(frozen=True)
class Column:
    """A column as a file has it.

    Attributes:
        name: name in the file; in a table without headings colN.
        values: values in the unit of the file, real or complex, shape (n,).
        unit: unit as the file names it; None: it names none.
        quantity: quantity that the file states; empty: it follows from the unit.
        position: place of the measurement [m]; None: not known.
        lamina: lamina on which it was measured; empty: not known.
        kind: "signal", "response" (a frequency response), "coherence".
    """

    name: str
    values: Values
    unit: str | None = None
    quantity: str = ""
    position: float | None = None
    lamina: str = ""
    kind: str = "signal"


@dataclass(frozen=True)
class Sheet:
    """Columns of the same length that belong together.

    Attributes:
        label: file, and what in it, for messages.
        columns: columns in the order of the file.
        rate: samples per second, where the file says so; None: a column has the times.
        notes: what was put right when the file was read.
        alias: another name of its only signal, such as set3; empty: none.
    """

    label: str
    columns: tuple[Column, ...]
    rate: float | None = None
    notes: tuple[str, ...] = ()
    alias: str = ""


def axis_of(name: str, unit: str | None) -> str:
    """Return which axis a column is: "time", "frequency", "x", or "" for none.

    Args:
        name: name of the column.
        unit: unit that the file names.
    """
    word = name.strip().lower()
    for axis, names in AXES.items():
        if word in names:
            return axis
    if unit in ("s", "ms", "us", "µs", "min"):
        return "time"
    return "frequency" if unit in ("Hz", "kHz") and word.startswith("freq") else ""


def heading(text: str) -> tuple[str, str | None]:
    """Return name and unit of a heading such as "thick [mm]" or "thick (mm)"; None: no unit."""
    found = HEADING.match(text.strip().strip('"'))
    if found is None:
        return text, None
    unit = found["square"] if found["square"] is not None else found["round"]
    return found["name"].strip(), unit if unit is None else unit.strip()


def matrix_columns(
    name: str, values: Values, names: list[str] | None = None, unit: str | None = None
) -> list[Column]:
    """Return the rows of a matrix, shape (n_columns, n), as columns.

    Args:
        name: name of the matrix.
        values: one row for each column.
        names: names of the columns; None: they are numbered.
        unit: unit of all of them.
    """
    rows = np.atleast_2d(values)
    if names is None:
        names = [name] if len(rows) == 1 else [f"{name}_{k}" for k in range(1, len(rows) + 1)]
    return [Column(own, row, unit) for own, row in zip(names, rows, strict=True)]


QUANTITIES = {
    "displacement": ("m", {"[length]": 1.0}),
    "velocity": ("m/s", {"[length]": 1.0, "[time]": -1.0}),
    "acceleration": ("m/s2", {"[length]": 1.0, "[time]": -2.0}),
    "force": ("N", {"[mass]": 1.0, "[length]": 1.0, "[time]": -2.0}),
    "impulse": ("N s", {"[mass]": 1.0, "[length]": 1.0, "[time]": -1.0}),
    "moment": ("N m", {"[mass]": 1.0, "[length]": 2.0, "[time]": -2.0}),
    "strain": ("1", {}),
    "time": ("s", {"[time]": 1.0}),
    "frequency": ("Hz", {"[time]": -1.0}),
    "voltage": ("V", {"[mass]": 1.0, "[length]": 2.0, "[time]": -3.0, "[current]": -1.0}),
    "receptance": ("m/N", {"[mass]": -1.0, "[time]": 2.0}),
    "mobility": ("m/(N s)", {"[mass]": -1.0, "[time]": 1.0}),
    "accelerance": ("m/(N s2)", {"[mass]": -1.0}),
}
"""Quantities with their SI unit and their dimensions."""
SI = "SI"
"""Text in place of a unit: the SI unit of the quantity, which the file names."""
GRAVITY = ("g", "G", "gn")
"""How accelerometers name the standard gravity; a channel is not in grams."""
POWER = re.compile(r"(?<=[A-Za-zµμ])(-?[23])(?!\w)")
"""The exponent of a unit as in m/s2."""


@dataclass(frozen=True)
class Unit:
    """A unit of measurement as a factor to the SI unit.

    Attributes:
        factor: value in SI per value in the unit.
        units: the SI unit.
        quantity: one of `QUANTITIES`; empty for other quantities.
    """

    factor: float
    units: str
    quantity: str


def unit_of(text: str, label: str) -> Unit:
    """Return the factor, the SI unit and the quantity of a unit that is given as text.

    Args:
        text: a unit such as "mm", "m/s²", "µm/m", "g"; empty or "1": a pure number.
        label: name of what has the unit, for messages.

    Raises:
        CaseError: there is no such unit, or it has a zero of its own (°C).
    """
    name = "g_0" if text in GRAVITY else text
    try:
        written = POWER.sub(r"**\1", name.strip("[] ")) or "1"
        zero, base = (_registry().Quantity(n, written).to_base_units() for n in (0.0, 1.0))
        if zero.magnitude:
            raise ValueError("its zero is not that of the SI unit")
    except Exception as error:  # pint raises its own, tokenize's and arithmetic errors
        reason = "" if type(error).__name__ == "UndefinedUnitError" else f" ({error})"
        raise CaseError(
            f"{label}: expected a unit such as mm, m/s, m/s2, g, N or um/m, given "
            f"{shown(text)}{reason[:80]}"
        ) from None
    dimensions = {str(key): float(power) for key, power in base.dimensionality.items()}
    for quantity, (units, own) in QUANTITIES.items():
        if own == dimensions:
            return Unit(float(base.magnitude), units, quantity)
    return Unit(float(base.magnitude), f"{base.units:~C}".replace("**", ""), "")


def of_quantity(quantity: str) -> Unit:
    """Return the SI unit of a quantity."""
    return Unit(1.0, QUANTITIES[quantity][0], quantity)


@cache
def _registry() -> Any:
    """Return pint's registry of units; reading its definitions takes a third of a second."""
    import pint

    return pint.UnitRegistry()


SPECIFICATION = re.compile(
    r"(?P<source>.+?)(?::(?P<unit>[^@]*))?(?:@(?P<place>[^/]+)(?:/(?P<lamina>.+))?)?"
)
PLACE = re.compile(r"(?P<name>.+?)\s*@\s*(?P<place>[-+.\d][^/]*)(?:/(?P<lamina>.+))?")
"""A name in a file with a position behind it, as in `v@0.12/upper`."""
LENGTH = re.compile(r"(?P<number>[-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(?P<unit>\D*)")
NUMBERED = re.compile(r"col(\d+)")
Assignment = tuple[str, dict[str, Any]]
AXIS_UNITS = {"time": "s", "frequency": "Hz"}
"""Units of axes that name none."""


def assignment(text: str, label: str) -> Assignment:
    """Return what a text `SOURCE[:UNIT][@POSITION[/LAMINA]]` says of a column.

    Returns:
        The source: the name of the column in the file, or colN, or setN; and the attributes of the
        column that differ from what the file says: unit, position [m] and lamina.
    """
    found = SPECIFICATION.fullmatch(text.strip())
    if found is None:
        raise CaseError(
            f"{label}: expected SOURCE, SOURCE:UNIT or SOURCE:UNIT@POSITION/LAMINA, given "
            f"{shown(text)}"
        )
    place = None if found["place"] is None else length_of(found["place"], label)
    says = {"unit": found["unit"], "position": place, "lamina": found["lamina"]}
    return found["source"].strip(), {key: v for key, v in says.items() if v is not None}


@dataclass(frozen=True, kw_only=True)
class Channel(Column):
    """A measured history, frequency response, coherence or shape in SI.

    Attributes:
        axis: "time", "frequency" or "x".
        points: values of the axis in SI, shape (n,).
        si: unit of the file, as the factor that was applied, with the SI unit and the quantity.
        source: file and column, with the unit there, for messages.
    """

    axis: str
    points: FloatArray
    si: Unit
    source: str


def length_of(text: str, label: str) -> float:
    """Return a position such as `0.12` or `120 mm` [m]."""
    found = LENGTH.fullmatch(text.strip())
    if found is None:
        raise CaseError(f"{label}: expected a position such as 0.12 or 120mm, given {shown(text)}")
    unit = unit_of(found["unit"].strip() or "m", label)
    if unit.quantity != "displacement":
        raise CaseError(f"{label}: expected a position in a unit of length, given {shown(text)}")
    return float(found["number"]) * unit.factor


def channels_of(
    sheets: Sequence[Sheet],
    assignments: Mapping[str, Assignment],
    units: str | None,
    rate: float | None,
) -> list[Channel]:
    """Return the columns of all sheets as channels.

    Args:
        sheets: sheets of all files.
        assignments: assignments by name of the channel; columns without one keep their name.
        units: unit of columns that name none.
        rate: samples per second of sheets without times.

    Raises:
        CaseError: an assignment names no column or several; a unit is missing or unknown; or an
            axis is missing or does not increase.
    """
    named = [_renamed(sheet, assignments, len(sheets)) for sheet in sheets]
    left = set(assignments) - {name for _, used in named for name in used}
    if left:
        held = [column.name for sheet in sheets for column in sheet.columns]
        first, _ = assignments[min(left)]
        raise CaseError(
            f"--channel {min(left)}: there is no column {shown(first)}; the files have "
            f"{', '.join(held)[:300]}"
        )
    return [channel for sheet, _ in named for channel in _of_sheet(sheet, units, rate)]


def _renamed(
    sheet: Sheet, assignments: Mapping[str, Assignment], n_sheets: int
) -> tuple[Sheet, list[str]]:
    """Return a sheet whose columns have their assigned names, and the names that were used."""
    columns, used = list(sheet.columns), []
    for name, (source, says) in assignments.items():
        k = _place(sheet, source)
        if k is None:
            continue
        if n_sheets > 1 and NUMBERED.fullmatch(source) and sheet.columns[k].name != source:
            raise CaseError(
                f"--channel {name}: {source} is not clear with several tables; use the names of "
                "the columns, or measure the files one by one"
            )
        columns[k] = replace(columns[k], name=name, **says)
        used.append(name)
    return replace(sheet, columns=tuple(columns)), used


def _place(sheet: Sheet, source: str) -> int | None:
    """Return the number of the column that a user names; None: not in this sheet."""
    names = [column.name for column in sheet.columns]
    if source in names:
        return names.index(source)
    lower = [name.lower() for name in names]
    if lower.count(source.lower()) == 1:
        return lower.index(source.lower())
    if sheet.alias and source == sheet.alias:
        return len(names) - 1
    numbered = NUMBERED.fullmatch(source)
    k = int(numbered[1]) - 1 if numbered else -1
    return k if 0 <= k < len(names) else None


def _of_sheet(sheet: Sheet, units: str | None, rate: float | None) -> list[Channel]:
    """Return the columns of a sheet beside its axis as channels."""
    axes = [axis_of(column.name, column.unit) for column in sheet.columns]
    rate = sheet.rate if rate is None else rate
    k = next((i for i, axis in enumerate(axes) if axis), 0 if rate is None else -1)
    kind = axes[k] or "time"
    if k < 0:
        kind, points = "time", np.arange(sheet.columns[0].values.size) / float(rate or 1.0)
    else:
        label = f"{sheet.label}, column {shown(sheet.columns[k].name)}"
        unit, _ = _unit_in(label, sheet.columns[k], units if kind == "x" else AXIS_UNITS[kind], "x")
        points = np.asarray(sheet.columns[k].values.real * unit.factor, dtype=np.float64)
        steps = np.flatnonzero(~(np.diff(points) > 0.0))
        if steps.size:
            raise CaseError(
                f"{label}: expected the {kind} to increase, given {points[steps[0] + 1]:.6g} after "
                f"{points[steps[0]]:.6g}"
                + ("; without times, --rate gives the samples per second" if kind == "time" else "")
            )
    others = [column for i, column in enumerate(sheet.columns) if i != k]
    if not others:
        raise CaseError(f"{sheet.label}: expected a column beside the {kind}, given none")
    return [_channel(sheet, column, kind, points, units) for column in others]


def _unit_in(label: str, column: Column, units: str | None, kind: str) -> tuple[Unit, str]:
    """Return the unit of a column over an axis of some kind, and a label of column and unit."""
    text = column.unit if column.unit is not None else units
    if text is None:
        raise CaseError(
            f"{label}: no unit; expected one in the heading, as in '{column.name} [mm]', or an "
            "option such as --units mm"
        )
    return _si(column, kind) if text == SI else unit_of(text, label), f"{label} [{text}]"


def _channel(
    sheet: Sheet, column: Column, kind: str, points: FloatArray, units: str | None
) -> Channel:
    """Return a column as a channel in SI; its name may say where it was measured."""
    label = f"{sheet.label}, column {shown(column.name)}"
    place, lamina = column.position, column.lamina
    if found := PLACE.fullmatch(column.name):
        place = length_of(found["place"], label) if place is None else place
        lamina = lamina or found["lamina"] or ""
    unit, source = _unit_in(label, column, units, kind)
    if not np.all(np.isfinite(column.values)):
        bad = int(np.flatnonzero(~np.isfinite(column.values))[0])
        raise CaseError(f"{label}: expected finite numbers, given none at sample {bad + 1}")
    about = vars(column) | {"values": column.values * unit.factor}
    about |= {"position": place, "lamina": lamina}
    return Channel(**about, axis=kind, points=points, si=unit, source=source)


def _si(column: Column, kind: str) -> Unit:
    """Return the SI unit of a column whose file says what it measures."""
    if column.quantity:
        return of_quantity(column.quantity)
    word = column.name.lower()
    for quantity in ("velocity", "acceleration", "force", "strain"):
        if quantity in word:
            return of_quantity(quantity)
    return of_quantity("displacement" if kind != "frequency" else "receptance")


PART = re.compile(
    r"(?P<name>.+?)[\s_.-]+(?P<part>real|re|imaginary|imag|im|amplitude|magnitude|mag|phase|coherence"
    r"|coh)",
    re.IGNORECASE,
)
"""The name of a response with the part of it that a column is."""
PARTS = {"real": "real", "re": "real", "imaginary": "imag", "imag": "imag", "im": "imag",
         "amplitude": "size", "magnitude": "size", "mag": "size", "phase": "phase",
         "coherence": "coherence", "coh": "coherence"}  # fmt: skip


def joined(channels: Sequence[Channel]) -> list[Channel]:
    """Return channels in which each frequency response is one complex channel.

    Columns `NAME real` and `NAME imag`, or `NAME amplitude` and `NAME phase`, become the response
    NAME; `NAME coherence` its coherence. A phase is in radians once its unit has been converted.
    Other columns over the frequency are responses as they are.
    """
    kept = [own for own in channels if own.axis != "frequency"]
    parts: dict[str, dict[str, Channel]] = {}
    for channel in (own for own in channels if own.axis == "frequency"):
        found = PART.fullmatch(channel.name)
        if channel.kind == "coherence":
            name, part = channel.name, "coherence"
        elif found is None:
            name, part = channel.name, "whole"
        else:
            name, part = found["name"], PARTS[found["part"].lower()]
        parts.setdefault(name, {})[part] = channel
    for name, own in parts.items():
        coherence = own.pop("coherence", None)
        if {"real", "imag"} <= own.keys():
            responses = [(name, own["real"], own["real"].values + 1j * own["imag"].values)]
        elif {"size", "phase"} <= own.keys():
            responses = [(name, own["size"], own["size"].values * np.exp(1j * own["phase"].values))]
        else:
            responses = [(one.name, one, one.values.astype(complex)) for one in own.values()]
        kept += [replace(one, name=n, kind="response", values=v) for n, one, v in responses]
        if coherence is not None:
            kept.append(replace(coherence, name=name, kind="coherence"))
    return kept

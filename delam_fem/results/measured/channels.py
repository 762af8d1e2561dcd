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
        name: in the file; of a table without headings colN.
        values: in the unit of the file, real or complex, shape (n,).
        unit: as the file names it; None: it names none.
        quantity: where the file says so itself; empty: by the unit.
        position: where it was measured [m]; None: not known.
        lamina: on which it was measured; empty: not known.
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
        columns: in the order of the file.
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
        name: of the column.
        unit: that the file names.
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


def matrix_columns(name: str, values: Values, names: list[str] | None = None) -> list[Column]:
    """Return the rows of a matrix, shape (n_columns, n), as columns.

    Args:
        name: of the matrix.
        values: one row for each column.
        names: of the columns; None: they are numbered.
    """
    rows = np.atleast_2d(values)
    if names is None:
        names = [name] if len(rows) == 1 else [f"{name}_{k}" for k in range(1, len(rows) + 1)]
    return [Column(own, row) for own, row in zip(names, rows, strict=True)]


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
"""What names the SI unit of a quantity that is known otherwise."""
GRAVITY = ("g", "G", "gn")
"""How accelerometers name the standard gravity; a channel is not in grams."""
POWER = re.compile(r"(?<=[A-Za-zµμ])(-?[23])(?!\w)")
"""The exponent of a unit as in m/s2."""


@dataclass(frozen=True)
class Unit:
    """A unit as a factor.

    Attributes:
        factor: value in SI per value in the unit.
        units: the SI unit.
        quantity: one of `QUANTITIES`; empty for others.
    """

    factor: float
    units: str
    quantity: str


def unit_of(text: str, label: str) -> Unit:
    """Return what a unit is.

    Args:
        text: for example "mm", "m/s²", "µm/m", "g"; empty or "1": a pure number.
        label: of what has the unit, for messages.

    Raises:
        CaseError: there is no such unit, or it has a zero of its own (°C).
    """
    name = "g_0" if text in GRAVITY else text
    try:
        parsed: Any = _registry().Quantity(1.0, POWER.sub(r"**\1", name.strip("[] ")) or "1")
        base = parsed.to_base_units()
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
    """Return pint's units; to read their definitions takes a third of a second."""
    import pint

    return pint.UnitRegistry()


SPECIFICATION = re.compile(
    r"(?P<source>.+?)(?::(?P<unit>[^@]*))?(?:@(?P<place>[^/]+)(?:/(?P<lamina>.+))?)?"
)
PLACE = re.compile(r"(?P<name>.+?)\s*@\s*(?P<place>[-+.\d][^/]*)(?:/(?P<lamina>.+))?")
"""A name in a file with a position behind it, as in `v@0.12/upper`."""
LENGTH = re.compile(r"(?P<number>[-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(?P<unit>\D*)")
NUMBERED = re.compile(r"col(\d+)")
AXIS_UNITS = {"time": "s", "frequency": "Hz"}
"""Units of axes that name none."""


@dataclass(frozen=True)
class Assignment:
    """What a user says of a column.

    Attributes:
        source: name of the column in the file, or colN, or setN.
        unit: of its values; None: as the file says.
        position: where it was measured [m]; None: as the file says.
        lamina: on which; empty: as the file says.
    """

    source: str
    unit: str | None = None
    position: float | None = None
    lamina: str = ""

    @classmethod
    def parsed(cls, text: str, label: str) -> Assignment:
        """Return the assignment that a text `SOURCE[:UNIT][@POSITION[/LAMINA]]` describes."""
        found = SPECIFICATION.fullmatch(text.strip())
        if found is None:
            raise CaseError(
                f"{label}: expected SOURCE, SOURCE:UNIT or SOURCE:UNIT@POSITION/LAMINA, given "
                f"{shown(text)}"
            )
        place = None if found["place"] is None else length_of(found["place"], label)
        return cls(found["source"].strip(), found["unit"], place, found["lamina"] or "")


@dataclass(frozen=True)
class Channel:
    """A measured history, frequency response, coherence or shape in SI.

    Attributes:
        name: of the channel.
        axis: "time", "frequency" or "x".
        points: values of the axis in SI, shape (n,).
        values: in SI, shape (n,).
        unit: what makes the values SI; with the SI unit and the quantity.
        column: as it was read, with position, lamina and kind.
        source: file and column, for people.
    """

    name: str
    axis: str
    points: FloatArray
    values: Values
    unit: Unit
    column: Column
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
        sheets: of all files.
        assignments: by name of the channel; columns without one keep their name.
        units: of columns that name none.
        rate: samples per second of sheets without times.

    Raises:
        CaseError: an assignment names no column or several; a unit is missing or unknown; or an
            axis is missing or does not increase.
    """
    named = [_renamed(sheet, assignments, len(sheets)) for sheet in sheets]
    left = set(assignments) - {name for _, used in named for name in used}
    if left:
        held = [column.name for sheet in sheets for column in sheet.columns]
        first = assignments[min(left)].source
        raise CaseError(
            f"--channel {min(left)}: there is no column {shown(first)}; the files have "
            f"{', '.join(held)[:300]}"
        )
    found = []
    for sheet, _ in named:
        found += _of_sheet(sheet, units, rate)
    return found


def _renamed(
    sheet: Sheet, assignments: Mapping[str, Assignment], n_sheets: int
) -> tuple[Sheet, list[str]]:
    """Return a sheet with the assigned names, and those that it used."""
    columns, used = list(sheet.columns), []
    for name, wanted in assignments.items():
        k = _place(sheet, wanted.source)
        if k is None:
            continue
        if (
            n_sheets > 1
            and NUMBERED.fullmatch(wanted.source)
            and sheet.columns[k].name != wanted.source
        ):
            raise CaseError(
                f"--channel {name}: {wanted.source} is not clear with several tables; use the "
                "names of the columns, or measure the files one by one"
            )
        old = columns[k]
        columns[k] = replace(
            old,
            name=name,
            unit=old.unit if wanted.unit is None else wanted.unit,
            position=old.position if wanted.position is None else wanted.position,
            lamina=wanted.lamina or old.lamina,
        )
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
    if any(axes):
        k = next(i for i, axis in enumerate(axes) if axis)
        kind = axes[k]
    elif rate is None:
        k, kind = 0, "time"
    else:
        k, kind = -1, "time"
    if k < 0:
        points = np.arange(sheet.columns[0].values.size) / float(rate or 1.0)
    else:
        points = _axis_points(sheet, sheet.columns[k], kind, units)
    others = [column for i, column in enumerate(sheet.columns) if i != k]
    if not others:
        raise CaseError(f"{sheet.label}: expected a column beside the {kind}, given none")
    return [_channel(sheet, column, kind, points, units) for column in others]


def _axis_points(sheet: Sheet, column: Column, kind: str, units: str | None) -> FloatArray:
    """Return the values of an axis in SI."""
    default = units if kind == "x" else AXIS_UNITS[kind]
    text = column.unit if column.unit is not None else default
    label = f"{sheet.label}, column {shown(column.name)}"
    if text is None:
        raise CaseError(f"{label}: {_NO_UNIT.format(name=column.name)}")
    unit = of_quantity("displacement") if text == SI else unit_of(text, label)
    points = np.asarray(column.values.real * unit.factor, dtype=np.float64)
    steps = np.flatnonzero(~(np.diff(points) > 0.0))
    if steps.size:
        raise CaseError(
            f"{label}: expected the {kind} to increase, given {points[steps[0] + 1]:.6g} after "
            f"{points[steps[0]]:.6g}"
            + ("; without times, --rate gives the samples per second" if kind == "time" else "")
        )
    return points


_NO_UNIT = (
    "no unit; expected one in the heading, as in '{name} [mm]', or an option such as --units mm"
)


def _channel(
    sheet: Sheet, column: Column, kind: str, points: FloatArray, units: str | None
) -> Channel:
    """Return a column in SI with what its name says of its place."""
    if found := PLACE.fullmatch(column.name):
        label = f"{sheet.label}, column {shown(column.name)}"
        column = replace(
            column,
            position=column.position
            if column.position is not None
            else length_of(found["place"], label),
            lamina=column.lamina or found["lamina"] or "",
        )
    label = f"{sheet.label}, column {shown(column.name)}"
    text = column.unit if column.unit is not None else units
    if text is None:
        raise CaseError(f"{label}: {_NO_UNIT.format(name=column.name)}")
    unit = _si(column, kind) if text == SI else unit_of(text, label)
    if not np.all(np.isfinite(column.values)):
        bad = int(np.flatnonzero(~np.isfinite(column.values))[0])
        raise CaseError(f"{label}: expected finite numbers, given none at sample {bad + 1}")
    values = column.values * unit.factor
    return Channel(column.name, kind, points, values, unit, column, f"{label} [{text}]")


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
    kept = [channel for channel in channels if channel.axis != "frequency"]
    parts: dict[str, dict[str, Channel]] = {}
    for channel in channels:
        if channel.axis != "frequency":
            continue
        found = PART.fullmatch(channel.name)
        if channel.column.kind == "coherence":
            name, part = channel.name, "coherence"
        elif found is None:
            name, part = channel.name, "whole"
        else:
            name, part = found["name"], PARTS[found["part"].lower()]
        parts.setdefault(name, {})[part] = channel
    for name, own in parts.items():
        kept += _joined(name, own)
    return kept


def _joined(name: str, parts: dict[str, Channel]) -> list[Channel]:
    """Return the response that parts make, and its coherence."""
    found = []
    if "real" in parts and "imag" in parts:
        values = parts["real"].values + 1j * parts["imag"].values
        found.append(_as_kind(parts["real"], name, "response", values))
    elif "size" in parts and "phase" in parts:
        values = parts["size"].values * np.exp(1j * parts["phase"].values)
        found.append(_as_kind(parts["size"], name, "response", values))
    else:
        found += [
            _as_kind(own, own.name, "response", own.values.astype(complex))
            for part, own in parts.items()
            if part != "coherence"
        ]
    if "coherence" in parts:
        own = parts["coherence"]
        found.append(_as_kind(own, name, "coherence", own.values))
    return found


def _as_kind(channel: Channel, name: str, kind: str, values: object) -> Channel:
    """Return a channel with a name, a kind and values."""
    column = replace(channel.column, name=name, kind=kind)
    return replace(channel, name=name, column=column, values=np.asarray(values))

"""Name the columns of measurements, and make their values SI."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from delam_fem.case.toml import CaseError, shown
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.measured.columns import Column, Sheet, Values, axis_of
from delam_fem.results.measured.units import SI, Unit, of_quantity, unit_of

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

"""Columns of measurements: their names, their units, and those that are parts of responses."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from delam_fem.api import CaseError, FloatArray, shown
from delam_fem.studies.signals.units import MeasuredUnit, ambient, of_quantity, unit_of

Values = npt.NDArray[Any]
"""Real or complex values, shape (n,)."""

TIMES = {"t", "time", "zeit", "temps", "tempo", "seconds", "sekunden", "elapsed time", "timestamp",
         "time stamp"}  # fmt: skip
FREQUENCIES = {"f", "freq", "frequency", "frequenz", "frequencies"}
POSITIONS = {"x", "position", "pos"}
"""Names of columns that are axes of the others, in lower case."""
AXES = {"time": TIMES, "frequency": FREQUENCIES, "x": POSITIONS}
COUNTERS = frozenset(
    "sample samples index idx no no. nr nr. n # number row point scan count i k".split()
)
"""Names of columns that count the rows, in lower case."""


@dataclass(frozen=True)
class Column:
    """A column as a file has it.

    Attributes:
        name: name in the file; in a table without headings colN.
        values: values in the unit of the file, real or complex, shape (n,).
        unit: unit as the file names it; None: it names none.
        quantity: quantity that the file states; empty: it follows from the unit.
        position: place of the measurement along a lamina [m]; None: not known.
        lamina: lamina on which it was measured; empty: not known.
        kind: "signal", "response" (a frequency response), "coherence".
        across: its place across a plate, from the middle of the width [m]; None: not known.
    """

    name: str
    values: Values
    unit: str | None = None
    quantity: str = ""
    position: float | None = None
    lamina: str = ""
    kind: str = "signal"
    across: float | None = None


@dataclass(frozen=True)
class Sheet:
    """Columns of the same length that belong together.

    Attributes:
        label: file, and what in it, for messages.
        columns: columns in the order of the file.
        rate: samples per second, where the file says so; None: a column has the times.
        notes: what was put right when the file was read.
        alias: another name of its only signal, such as set3; empty: none.
        axis: kind of the axis, "time", "frequency" or "x", if it is the first column; empty: its
            name or unit tells which column is the axis.
    """

    label: str
    columns: tuple[Column, ...]
    rate: float | None = None
    notes: tuple[str, ...] = ()
    alias: str = ""
    axis: str = ""


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
    if unit in TIME_UNITS:
        return "time"
    return "frequency" if unit in ("Hz", "kHz") and word.startswith("freq") else ""


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
    return [Column(column_name, row, unit) for column_name, row in zip(names, rows, strict=True)]


TIME_UNITS = frozenset(
    "s ms us µs μs ns min h sec msec usec µsec Sec SEC second seconds secs Sekunde Sekunden".split()
)
"""Units that tell that a column is a time; `S` and `M` are none."""
SI = "SI"
"""Text in place of a unit: the SI unit of the quantity, which the file names."""


PLACE = re.compile(r"@\s*+(?=[-+.\d])")
"""Where a position begins behind a name in a file, as in `v@0.12/upper` or `v@0.12:-0.03`."""
LENGTH = re.compile(
    r"(?P<number>[-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d{1,3}+)?+)\s*+(?P<unit>\D*+)"
)
NUMBERED = re.compile(r"col(\d{1,9})")
Assignment = tuple[str, dict[str, Any]]
AXIS_UNITS = {"time": "s", "frequency": "Hz"}
"""Units of axes that name none."""
AXIS_QUANTITIES = {"time": "time", "frequency": "frequency", "x": "displacement"}


def assignment(text: str, label: str) -> Assignment:
    """Return what a text `SOURCE[:UNIT][@POSITION[/LAMINA]]` says of a column.

    A position on a plate is X:Z.

    Returns:
        The source: the name of the column in the file, or colN, or setN; and the attributes of the
        column that differ from what the file says: unit, position and across [m], lamina.
    """
    said, at, where = text.strip().partition("@")
    source, colon, unit = said.partition(":")
    length, slash, lamina = where.partition("/")
    if not source or bool(at) != bool(length) or bool(slash) != bool(lamina):
        raise CaseError(
            f"{label}: expected SOURCE, SOURCE:UNIT or SOURCE:UNIT@POSITION/LAMINA, given "
            f"{shown(text)}"
        )
    says: dict[str, Any] = {"unit": unit} if colon else {}
    if at:
        says |= place_of(length, label)
    if slash:
        says["lamina"] = lamina
    return source.strip(), says


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
    si: MeasuredUnit
    source: str


def length_of(text: str, label: str) -> float:
    """Return a position such as `0.12` or `120 mm` [m]."""
    match = LENGTH.fullmatch(text.strip())
    if match is None:
        raise CaseError(f"{label}: expected a position such as 0.12 or 120mm, given {shown(text)}")
    unit = unit_of(match["unit"].strip() or "m", label)
    if unit.quantity != "displacement":
        raise CaseError(f"{label}: expected a position in a unit of length, given {shown(text)}")
    return float(match["number"]) * unit.factor


def place_of(text: str, label: str) -> dict[str, float]:
    """Return `position` and, of a plate, `across` [m] of a place such as `0.12` or `0.12:-30mm`."""
    along, colon, across = text.partition(":")
    place = {"position": length_of(along, label)}
    return place | ({"across": length_of(across, label)} if colon else {})


def channels_of(
    sheets: Sequence[Sheet],
    assignments: Mapping[str, Assignment],
    units: str | None,
    times: Times,
    notes: list[str],
) -> list[Channel]:
    """Return the columns of all sheets as channels.

    Args:
        sheets: sheets of all files.
        assignments: assignments by name of the channel; columns without one keep their name.
        units: unit of columns that name none.
        times: what the user says of the times.
        notes: what was put right is added here.

    Raises:
        CaseError: an assignment names no column or several; a unit is missing or unknown; an axis
            is missing or does not increase; or all columns are temperatures or humidities.
    """
    named = [_renamed(sheet, assignments, len(sheets)) for sheet in sheets]
    left = set(assignments) - {name for _, used in named for name in used}
    if left:
        names = [column.name for sheet in sheets for column in sheet.columns]
        first, _ = assignments[min(left)]
        raise CaseError(
            f"--channel {min(left)}: there is no column {shown(first)}; the files have "
            f"{', '.join(names)[:300]}"
        )
    _require_single(named)
    channels = [
        channel for sheet, used in named for channel in _of_sheet(sheet, units, times, notes, used)
    ]
    if not channels:
        labels = ", ".join(sheet.label for sheet in sheets)
        raise CaseError(
            f"{labels[:300]}: expected a channel, found temperatures or humidities alone"
        )
    return channels


def _require_single(named: Sequence[tuple[Sheet, list[str]]]) -> None:
    """Check that no assignment fits the columns of two sheets.

    A response and its coherence may share a name.

    Raises:
        CaseError: one does.
    """
    labels: dict[tuple[str, str], str] = {}
    for sheet, used in named:
        for column in sheet.columns:
            if column.name not in used:
                continue
            if (key := (column.name, column.kind)) in labels:
                raise CaseError(
                    f"--channel {column.name}: its source is a column of {labels[key]} and of "
                    f"{sheet.label}; name it by what only one has, such as set3, or read the files "
                    "one by one"
                )
            labels[key] = sheet.label


def _renamed(
    sheet: Sheet, assignments: Mapping[str, Assignment], n_sheets: int
) -> tuple[Sheet, list[str]]:
    """Return a sheet whose columns have their assigned names, and the names that were used."""
    columns = list(sheet.columns)
    used = []
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


@dataclass(frozen=True)
class Times:
    """What a user says of the times of the samples.

    Attributes:
        rate: samples per second, which replaces the times of the files; None: the files have them.
        fill: whether missing samples are interpolated.
        between: first and last time that are read [s]; None: all.
    """

    rate: float | None = None
    fill: bool = False
    between: tuple[float, float] | None = None


def _of_sheet(
    sheet: Sheet, units: str | None, times: Times, notes: list[str], used: Sequence[str] = ()
) -> list[Channel]:
    """Return the columns of a sheet beside its axis as channels.

    Temperatures and humidities, which no channel is, are left out, unless the user names them.
    """
    k, kind = _axis(sheet)
    rate = sheet.rate if times.rate is None else times.rate
    others = [column for i, column in enumerate(sheet.columns) if i != k]
    if kind in ("", "time") and rate is not None:
        if k >= 0:
            notes.append(
                f"{sheet.label}: the column {shown(sheet.columns[k].name)} is left out, as --rate "
                f"gives {rate:g} samples per second"
            )
        kind = "time"
        points = np.arange(sheet.columns[0].values.size) / rate
    else:
        if times.rate is not None:
            notes.append(f"{sheet.label}: over the {kind}; --rate has no effect on it")
        k, kind = (k, kind) if k >= 0 else (_unnamed_time(sheet), "time")
        others = [column for i, column in enumerate(sheet.columns) if i != k]
        points = _points(sheet, sheet.columns[k], kind, units)
    counters = [column for column in others if _counts_rows(column) and len(others) > 1]
    for column in counters:
        notes.append(f"{sheet.label}: the column {shown(column.name)} counts the rows; left out")
    others = [column for column in others if column not in counters]
    signals = []
    for column in others:
        what = ambient(column.unit or "")
        if not what or column.name in used:
            signals.append(column)
            continue
        notes.append(
            f"{sheet.label}: the column {shown(column.name)} is {what} [{column.unit}]; left out"
        )
    if others and not signals:
        return []
    others = signals
    if not others:
        raise CaseError(f"{sheet.label}: expected a column beside the {kind}, given none")
    if kind == "time" and times.between is not None:
        points, others = _between(sheet, points, others, times.between)
    if kind == "time":
        points, others = _without_holes(sheet, points, others, times, notes)
    return [_channel(sheet, column, kind, points, units) for column in others]


def _axis(sheet: Sheet) -> tuple[int, str]:
    """Return which column is the axis, and its kind; -1 and empty if no name or unit tells it."""
    if sheet.axis:
        return 0, sheet.axis
    names = [axis_of(column.name, None) for column in sheet.columns]
    for kind in AXES:
        if kind in names:
            return names.index(kind), kind
    for k, column in enumerate(sheet.columns):
        if kind := axis_of(column.name, column.unit):
            return k, kind
    return -1, ""


def _unnamed_time(sheet: Sheet) -> int:
    """Return the number of the first column, if it can be the time.

    Raises:
        CaseError: it has another name or unit, or counts the rows.
    """
    first = sheet.columns[0]
    is_counter = bool(np.all(np.diff(first.values.real) == 1.0))
    if NUMBERED.fullmatch(first.name) and first.unit is None and not is_counter:
        return 0
    what = "counts the rows" if is_counter else f"has the unit {first.unit or 'none'}"
    raise CaseError(
        f"{sheet.label}: expected a column of times, named time or with a unit such as [s], given "
        f"{shown(first.name)} first, which {what}; --rate gives the samples per second, or "
        "--channel time=col1:s says that it is a time"
    )


def _counts_rows(column: Column) -> bool:
    """Return whether a column only counts the rows."""
    if column.unit is not None or not column.values.size > 1:
        return False
    is_named = column.name.strip().lower() in COUNTERS or column.name == "col1"
    return is_named and bool(np.all(np.diff(column.values.real) == 1.0))


def _points(sheet: Sheet, column: Column, kind: str, units: str | None) -> FloatArray:
    """Return the values of an axis in SI.

    Raises:
        CaseError: its unit is that of another quantity, or it does not increase.
    """
    label = f"{sheet.label}, column {shown(column.name)}"
    text = column.unit or (units if kind == "x" else AXIS_UNITS[kind])
    if text == SI:
        text = "m" if kind == "x" else AXIS_UNITS[kind]
    if text is None:
        raise _no_unit(label, column)
    unit = unit_of(text.partition(" since ")[0], label)
    factor = unit.factor
    if kind == "frequency" and unit.quantity == "angular velocity":
        factor /= 2.0 * np.pi
    elif unit.quantity != AXIS_QUANTITIES[kind]:
        raise CaseError(
            f"{label}: expected the {kind} in a unit such as {AXIS_UNITS.get(kind, 'm')}, given "
            f"{shown(text)}, a {unit.quantity or 'number'}; --channel "
            f"{kind}={column.name[:40]}:UNIT gives another"
        )
    points = np.asarray(column.values.real * factor, dtype=np.float64)
    steps = np.flatnonzero(~(np.diff(points) > 0.0))
    if steps.size:
        raise CaseError(
            f"{label}: expected the {kind} to increase, given {points[steps[0] + 1]:.6g} after "
            f"{points[steps[0]]:.6g} in row {steps[0] + 2}"
            + ("; --rate gives the samples per second instead" if kind == "time" else "")
        )
    return points


def _between(
    sheet: Sheet, points: FloatArray, columns: Sequence[Column], ends: tuple[float, float]
) -> tuple[FloatArray, list[Column]]:
    """Return the part of a record between two times.

    Raises:
        CaseError: fewer than two samples are there.
    """
    is_in = (points >= ends[0]) & (points <= ends[1])
    if is_in.sum() < 2:
        raise CaseError(
            f"{sheet.label}: --between: expected two times [s] from {points[0]:.6g} to "
            f"{points[-1]:.6g} with samples between, given {ends[0]:g} and {ends[1]:g}"
        )
    return points[is_in], [replace(column, values=column.values[is_in]) for column in columns]


LONG = 1.5
"""Steps of the time, over the usual one, between which samples are missing."""
FILLED = 10
"""Most samples in sequence that are interpolated where that is asked for."""


def _without_holes(
    sheet: Sheet,
    points: FloatArray,
    columns: Sequence[Column],
    times: Times,
    notes: list[str],
) -> tuple[FloatArray, list[Column]]:
    """Return times and columns; holes are noted, or filled where the user asks for it.

    Raises:
        CaseError: a hole is too long to be filled.
    """
    step = float(np.median(np.diff(points)))
    sizes = np.round(np.diff(points) / step).astype(np.int64)
    holes = np.flatnonzero(np.diff(points) > LONG * step)
    if not holes.size or holes.size > LONG * points.size / 4:
        return points, list(columns)
    n_missing = int((sizes[holes] - 1).sum())
    first, last = points[holes[0]], points[holes[0] + 1]
    what = (
        f"{holes.size} hole(s) among steps of {step:.6g} s, {n_missing} samples missing; the first "
        f"from {first:.6g} to {last:.6g} s"
    )
    if not times.fill:
        notes.append(
            f"{sheet.label}: {what}; --between takes a part without holes, --fill interpolates "
            "short ones, and --rate replaces times that are only rounded"
        )
        return points, list(columns)
    if sizes[holes].max() > FILLED + 1:
        longest = holes[np.argmax(sizes[holes])]
        raise CaseError(
            f"{sheet.label}: --fill: expected holes of at most {FILLED} samples, given "
            f"{sizes[longest] - 1} from {points[longest]:.6g} to {points[longest + 1]:.6g} s; "
            "--between takes a part without it"
        )
    pieces = [
        np.linspace(points[k], points[k + 1], n, endpoint=False) if n > 1 else points[k : k + 1]
        for k, n in enumerate(sizes)
    ]
    axis = np.concatenate([*pieces, points[-1:]])
    notes.append(f"{sheet.label}: {what}; interpolated by cubic splines")
    return axis, [
        replace(column, values=CubicSpline(points, column.values)(axis)) for column in columns
    ]


def _no_unit(label: str, column: Column) -> CaseError:
    """Return the error that a column has no unit."""
    return CaseError(
        f"{label}: no unit; expected one in the heading, as in {shown(column.name + ' [mm]')}, "
        "or an option such as --units mm"
    )


def _channel(
    sheet: Sheet, column: Column, kind: str, points: FloatArray, units: str | None
) -> Channel:
    """Return a column as a channel in SI; its name may say where it was measured."""
    label = f"{sheet.label}, column {shown(column.name)}"
    lamina = column.lamina
    place = {"position": column.position, "across": column.across}
    if match := PLACE.search(column.name, 1):
        length, _, other = column.name[match.end() :].partition("/")
        if column.position is None:
            place |= place_of(length, label)
        lamina = lamina or other
    text = column.unit or units
    if text is None:
        raise _no_unit(label, column)
    if text == SI:
        unit = _si(column, kind, label)
    else:
        unit = unit_of(text, label, is_response=kind == "frequency")
    if unit.units == "1" and column.quantity:
        unit = replace(unit, quantity=column.quantity)
    if not np.all(np.isfinite(column.values)):
        bad = int(np.flatnonzero(~np.isfinite(column.values))[0])
        raise CaseError(f"{label}: expected finite numbers, given none at sample {bad + 1}")
    about = vars(column) | {"values": column.values * unit.factor}
    about |= {**place, "lamina": lamina}
    return Channel(**about, axis=kind, points=points, si=unit, source=f"{label} [{text}]")


WORDS = ("velocity", "acceleration", "force", "strain", "displacement", "receptance", "mobility",
         "accelerance")  # fmt: skip
"""Quantities that the name of a column may say."""


def _si(column: Column, kind: str, label: str) -> MeasuredUnit:
    """Return the SI unit of a column whose file says what it measures.

    Raises:
        CaseError: it does not.
    """
    name = column.name.lower()
    quantity = column.quantity or next((word for word in WORDS if word in name), "")
    if not quantity and (kind == "x" or name.startswith("tip")):
        quantity = "displacement"
    if not quantity:
        raise CaseError(
            f"{label}: expected a file that says what it measures for --units SI, given none of "
            f"{', '.join(WORDS)}; --channel NAME={column.name}:UNIT gives the unit"
        )
    return of_quantity(quantity)


PART = re.compile(
    r"[\s_.-](real|re|imaginary|imag|im|amplitude|magnitude|mag|phase|coherence|coh)\Z",
    re.IGNORECASE,
)
"""The part of a response that a column is, behind the name of the response."""
PARTS = {"real": "real", "re": "real", "imaginary": "imag", "imag": "imag", "im": "imag",
         "amplitude": "size", "magnitude": "size", "mag": "size", "phase": "phase",
         "coherence": "coherence", "coh": "coherence"}  # fmt: skip


def part_of(text: str) -> tuple[str, str]:
    """Return the name of a response and which part of it a column with some name is."""
    match = PART.search(text)
    if match is None:
        return text, "whole"
    end = match.start()
    while end and (text[end - 1].isspace() or text[end - 1] in "_.-"):
        end -= 1
    return (text[:end], PARTS[match[1].lower()]) if end else (text, "whole")


def joined(channels: Sequence[Channel]) -> list[Channel]:
    """Return channels in which each frequency response is one complex channel.

    Columns `NAME real` and `NAME imag`, or `NAME amplitude` and `NAME phase`, become the response
    NAME; `NAME coherence` its coherence. A phase is in radians once its unit has been converted.
    Other columns over the frequency are responses as they are.
    """
    result = [channel for channel in channels if channel.axis != "frequency"]
    parts: dict[str, dict[str, Channel]] = {}
    for channel in (channel for channel in channels if channel.axis == "frequency"):
        name, part = part_of(channel.name)
        if channel.kind == "coherence":
            name = channel.name
            part = "coherence"
        if part in parts.setdefault(name, {}):
            raise same_names(name, parts[name][part].source, channel.source)
        parts[name][part] = channel
    for name, group in parts.items():
        coherence = group.pop("coherence", None)
        if {"real", "imag"} <= group.keys():
            real = group.pop("real")
            imag = group.pop("imag")
            _require_unit(imag, real.si.units)
            result.append(
                replace(real, name=name, kind="response", values=real.values + 1j * imag.values)
            )
        elif {"size", "phase"} <= group.keys():
            size = group.pop("size")
            phase = group.pop("phase")
            if phase.si.units != "1":
                _require_unit(phase, "rad")
            values = size.values * np.exp(1j * phase.values)
            result.append(replace(size, name=name, kind="response", values=values))
        result += [
            replace(one, kind="response", values=one.values.astype(complex))
            for one in group.values()
        ]
        if coherence is not None:
            result.append(replace(coherence, name=name, kind="coherence"))
    return result


def _require_unit(channel: Channel, units: str) -> None:
    """Check that a part of a response has a unit.

    Raises:
        CaseError: it has another one.
    """
    if channel.si.units != units:
        raise CaseError(
            f"{channel.source}: expected a unit of {units}, as for a part of a response, given "
            f"one of {channel.si.units}; --channel {channel.name}={channel.name}:UNIT gives another"
        )


def same_names(name: str, first: str, second: str) -> CaseError:
    """Return the error that two channels have the same name."""
    return CaseError(
        f"channel {name!r}: expected different names, given it twice: {first} and {second}; "
        "--channel NAME=… renames one"
    )

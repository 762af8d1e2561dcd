"""Read a sweep file, and derive its grid of cases and their order.

A sweep file is read into frozen, strict models: base case, axes, order of the points, record. A
`Sweep` derives the grid from them: the case of each point, and the order of the points.
"""

from __future__ import annotations

import difflib
import math
import pickle
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from delam_fem.api import (
    LISTS,
    PRESETS,
    Case,
    CaseError,
    CaseSource,
    CountOrNone,
    Data,
    Expected,
    IntArray,
    Label,
    NotNegative,
    Positive,
    Section,
    apply_overrides,
    find_case,
    identity,
    in_si,
    inconsistent,
    load_case,
    message,
    parts_of,
    preset,
    read_toml,
    settling,
    tables,
    toml_text,
)
from delam_fem.studies.signals.scan import LEAST_PERIODS, scan_positions

Value: TypeAlias = int | float | str
"""A value of an axis."""

_FINITE = Field(strict=True, allow_inf_nan=False)
_Number = Annotated[
    Annotated[int, Field(strict=True)] | Annotated[float, _FINITE], Expected("a number")
]
_Values = Annotated[
    tuple[
        Annotated[int, Field(strict=True)]
        | Annotated[float, _FINITE]
        | Annotated[str, Field(strict=True)],
        ...,
    ],
    Field(min_length=1),
    Expected("a list of at least one number or word"),
]
MOST_VALUES = 1_000_000
"""Largest number of values of an axis."""
AxisCount = Annotated[
    int, Field(strict=True, ge=1, le=MOST_VALUES), Expected("a whole number from 1 to 1000000")
]
_Perturbation = Annotated[
    float, _FINITE, Field(gt=0.0, lt=1.0), Expected("a number above 0 and below 1")
]
_Key = Annotated[
    str, Field(strict=True, pattern=r"^[\w-]+(\.[\w-]+)+$"), Expected("a key such as gap.tip")
]


def _flat(value: object) -> dict[str, object]:
    """Return nested tables as one table with dotted keys, so that `a.b = 1` equals `"a.b" = 1`.

    A table over x, as of a thickness, is a value.
    """
    if not isinstance(value, Mapping):
        raise PydanticCustomError("unexpected", "expected a table")
    flat: dict[str, object] = {}
    for key, entry in value.items():
        if isinstance(entry, Mapping) and not entry.keys() >= {"x", "value"}:
            flat |= {f"{key}.{subkey}": deep for subkey, deep in _flat(entry).items()}
        else:
            flat[str(key)] = entry
    return flat


def _some_tables(value: object) -> object:
    """Check that there is at least one [[axis]] table."""
    if not isinstance(value, list | tuple) or not value:
        raise PydanticCustomError("inconsistent", "expected at least one [[axis]] table")
    return value


def _in_si(value: object, units: list[str], name: str) -> object:
    """Return a value in the first SI unit that fits the one that it carries.

    Raises:
        PydanticCustomError: none fits.
    """
    for unit in units[1:]:
        with suppress(PydanticCustomError):
            return in_si(value, unit, name)
    return in_si(value, units[0], name)


class Axis(Section):
    """An axis of a sweep: a key of the case and its values.

    Attributes:
        key: key of the case, or `initial.LAMINA.displacement` or `initial.LAMINA.velocity`.
        name: name of the coordinate in the result; by default the last part of the key.
        start: first value of a range.
        stop: last value of the range, included.
        count: number of values of the range.
        spacing: "linear" or "logarithmic" spacing of the range.
        values: list of values, instead of a range.
    """

    key: _Key
    name: Label | None = None
    start: _Number | None = None
    stop: _Number | None = None
    count: AxisCount | None = None
    spacing: Literal["linear", "logarithmic"] = "linear"
    values: _Values | None = None

    @model_validator(mode="before")
    @classmethod
    def _in_si(cls, data: Any) -> Any:
        """Return the table with numbers in SI where its values carry a unit."""
        if not isinstance(data, dict):
            return data
        key = str(data.get("key"))
        entry = dict(data)
        units = units_of(key)
        if not units and any(isinstance(entry.get(name), str) for name in ("start", "stop")):
            names = [entry.name for table in tables() for entry in table.keys if entry.has_unit]
            near = difflib.get_close_matches(key.rpartition(".")[2], names, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise inconsistent(
                "key", f"expected a key whose values have a unit, given {data.get('key')!r}{hint}"
            )
        for name in {"start", "stop", "values"} & set(entry) if units else ():
            value = entry[name]
            is_list = isinstance(entry[name], list | tuple)
            entry[name] = (
                [_in_si(v, units, name) for v in value] if is_list else _in_si(value, units, name)
            )
        return entry

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        """Check that there is either a complete range or a list of values of one type."""
        keys = [name for name in ("start", "stop", "count") if getattr(self, name) is not None]
        if self.values is not None:
            if keys or "spacing" in self.model_fields_set:
                raise inconsistent("values", "expected no start, stop, count or spacing beside it")
            if len({isinstance(value, str) for value in self.values}) > 1:
                raise inconsistent("values", "expected only numbers or only words, given both")
        elif len(keys) < 3:
            raise PydanticCustomError(
                "inconsistent",
                "expected start, stop and count, or values, given {given}",
                {"given": " and ".join(keys) or "none"},
            )
        elif self.spacing == "logarithmic" and not min(self.start or 0, self.stop or 0) > 0:
            raise inconsistent(
                "spacing",
                f'expected "linear", or start and stop above 0, given {self.start} and {self.stop}',
            )
        return self

    @property
    def size(self) -> int:
        """Number of values."""
        return len(self.values) if self.values is not None else self.count or 0

    @property
    def points(self) -> tuple[Value, ...]:
        """Values along the axis; whole numbers if start, stop and all steps are whole."""
        if self.values is not None:
            return self.values
        assert self.start is not None and self.stop is not None and self.count is not None
        space = np.geomspace if self.spacing == "logarithmic" else np.linspace
        numbers = [float(value) for value in space(self.start, self.stop, self.count)]
        is_whole = isinstance(self.start, int) and isinstance(self.stop, int)
        if is_whole and all(value.is_integer() for value in numbers):
            return tuple(int(value) for value in numbers)
        return tuple(numbers)


class ScanRecord(Section):
    """A row of points on the surface of a lamina, as a scanning vibrometer measures it.

    Of a plate the points are those of its [scan], and the table has no keys.

    Attributes:
        lamina: its name; None: the thinner outermost one.
        spacing: distance of the points [m]; None: the case is a plate.
        first: position of the first point [m].
    """

    lamina: Label | None = None
    spacing: Positive | None = None
    first: NotNegative = 0.0


class Record(Section):
    """The quantities that a sweep records at each point.

    Attributes:
        summary: whether to record the numbers of summary.json that describe the motion.
        strobes: number of last stroboscopic points.
        harmonics: number of harmonics whose amplitudes and phases are recorded.
        node_distortion: whether to record d and THD of the displacement at every node.
        energies: whether to record the energy ledger, averaged over the window.
        channels: names of channels of a run's record, of which min, max, amplitude, rms and mean
            over the window are kept as NAME_min, ….
        scan: points whose velocity is recorded as complex shapes at multiples of the excitation.
        lyapunov: number of periods for the largest Lyapunov exponent; 0: not computed.
        perturbation: initial distance of the second motion for this exponent, relative to the norm
            of the motion.
    """

    summary: Annotated[bool, Field(strict=True), Expected("true or false")] = True
    strobes: CountOrNone = settling.FEWEST_STROBES
    harmonics: CountOrNone = 0
    node_distortion: Annotated[bool, Field(strict=True), Expected("true or false")] = False
    energies: Annotated[bool, Field(strict=True), Expected("true or false")] = False
    channels: Annotated[tuple[str, ...], Expected("a list of different names of channels")] = ()
    scan: ScanRecord | None = None
    lyapunov: CountOrNone = 0
    perturbation: _Perturbation = 0.03


class SweepFile(Section):
    """The content of a sweep file.

    Attributes:
        name: name of the sweep and of its folder; by default that of the file.
        base: a preset, or a case file relative to the sweep file.
        set: overrides of the base case.
        initial: tip displacement [m] and velocity [m/s] at the start, in the first mode of each
            lamina, by `LAMINA.displacement` and `LAMINA.velocity`.
        start: "rest", or "steady": the linear steady motion with delaminations kept as they are at
            rest, from which a stack under a harmonic excitation settles sooner.
        axis: the axes.
        combine: "product": every combination of values; "zip": the k-th values of all axes
            together.
        order: "independent": every point starts from the initial state; "up" or "down": along the
            first axis, each point starts from the final state of the point before it; "both": both
            directions, as two sets of points.
        engine: name of the engine that computes the steps.
        operators: method that assembles the matrices.
        record: quantities that are recorded at each point.
    """

    name: Annotated[
        str,
        Field(strict=True, pattern=r"^\w[\w .+-]*$", max_length=100),
        Expected("a name fit for a folder: letters, digits, space and . + - _"),
    ]
    base: Annotated[str, Field(strict=True), Expected("a preset or the name of a case file")]
    combine: Literal["product", "zip"] = "product"
    order: Literal["independent", "up", "down", "both"] = "independent"
    engine: Literal["petsc", "compiled"] = "compiled"
    operators: Literal["closed-form", "dolfinx"] = "closed-form"
    set: Annotated[dict[str, object], BeforeValidator(_flat), Field(default_factory=dict)]
    initial: Annotated[dict[str, object], BeforeValidator(_flat), Field(default_factory=dict)]
    start: Literal["rest", "steady"] = "rest"
    axis: Annotated[tuple[Axis, ...], BeforeValidator(_some_tables)]
    record: Record = Record()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Check conditions that involve several keys."""
        keys = [axis.key for axis in self.axis]
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            raise inconsistent("axis", f"expected different keys, given {twice} twice")
        if self.combine == "zip":
            counts = [axis.size for axis in self.axis]
            if len(set(counts)) > 1:
                raise inconsistent(
                    "combine",
                    f'expected axes of one length with "zip", given {counts}; or "product"',
                )
        if self.start == "steady" and (self.initial or any(k.startswith("initial.") for k in keys)):
            raise inconsistent("start", 'expected "rest" beside initial conditions')
        if self.order != "independent":
            self._check_continuation()
        return self

    def _check_continuation(self) -> None:
        """Check that the state at one point can be the initial state of the next."""
        first = self.axis[0]
        if first.values is not None and isinstance(first.values[0], str):
            raise inconsistent(
                "order", f'expected "independent", as {first.key} of the first axis has no order'
            )
        is_points = first.key == "contact.points_per_element"  # pairs at rest are kept, too
        if is_points or first.key.split(".")[0] in ("mesh", "initial"):
            raise inconsistent(
                "order",
                f'expected "independent", as a state cannot be carried along {first.key}; or '
                "another axis first",
            )


DIRECTIONS = ("up", "down")
"""Values of the coordinate `direction` in a sweep with order "both"."""
INITIAL = "initial"
"""First part of the keys that set initial conditions."""
_INITIAL_QUANTITIES = ("displacement", "velocity")
TAKEN = {
    "direction", "lamina", "node", "strobe", "harmonic", "x", "outcome", "error", "order", "scan_x",
    "scan_z",
}  # fmt: skip
"""Names that an axis cannot have, because the result uses them."""


def units_of(key: str, kind: str = "") -> list[str]:
    """Return the units that values of a key of a case can have; [] of pure numbers.

    Args:
        key: the key.
        kind: kind of the case's excitation; "" if it is not known.
    """
    section = key.partition(".")[0]
    *_, table_key, column, last = ("", "", *key.split("."))
    if last.isdecimal() and column in LISTS:
        return units_of(f"{section}.{table_key}", kind) if column == "value" else ["m"]
    units = (
        entry.unit.partition(" per ")[0]
        for table in tables()
        if table.name == section and (not kind or table.kind in ("", kind))
        for entry in table.keys
        if entry.name == last and entry.has_unit
    )
    return list(dict.fromkeys(units))


def unit_of(key: str, case: Case) -> str:
    """Return the unit of a key of a case, "1" of a pure number."""
    number = key.split(".")[1] if key.startswith("excitation.") else ""
    drives = parts_of(case.excitation)
    one = drives[int(number) - 1] if number.isdecimal() else drives[0]
    return next(iter(units_of(key, one.kind)), "1")


@dataclass(frozen=True)
class Dimension:
    """One coordinate of the result.

    Attributes:
        name: name of the coordinate.
        key: key of the case or of the initial conditions.
        values: values along the coordinate.
        units: unit of the values.
        long_name: the key in words.
        along: name of the dimension of the coordinate; with "zip" all have the first axis' name.
    """

    name: str
    key: str
    values: tuple[Value, ...]
    units: str
    long_name: str
    along: str


@dataclass(frozen=True, init=False)
class Sweep:
    """A sweep: a grid of points, each with its case.

    Attributes:
        base: base case with the overrides of the file.
        file: content of the sweep file.
    """

    base: Case
    file: SweepFile

    def __init__(
        self,
        base: CaseSource,
        axes: SweepFile | Mapping[str, Iterable[Value]],
        **options: object,
    ) -> None:
        """Describe a sweep, as in `Sweep("default", {"excitation.frequency": [3.2, 3.3]})`.

        Args:
            base: the case that is varied; also the name of a preset, or the path of a case file.
            axes: values by key of the case; or the content of a sweep file, used as it is.
            **options: further keys of a sweep file, such as order="up" or record={"strobes": 80}.

        Raises:
            CaseError: a key or a value is not valid.
        """
        object.__setattr__(self, "base", find_case(base))
        if isinstance(axes, SweepFile):
            object.__setattr__(self, "file", axes)
            return
        axis_tables = [{"key": k, "values": np.asarray(v).tolist()} for k, v in axes.items()]
        data = {"name": self.base.name, "base": self.base.name, "axis": axis_tables, **options}
        object.__setattr__(self, "file", _file_of(data))
        require_valid(self)

    @cached_property
    def dimensions(self) -> tuple[Dimension, ...]:
        """Axes of the sweep as coordinates of its result."""
        keys = [axis.key for axis in self.file.axis]
        short = [_short_name(key) for key in keys]
        names = [
            axis.name
            or (name if short.count(name) == 1 and name not in TAKEN else key.replace(".", "_"))
            for axis, name, key in zip(self.file.axis, short, keys, strict=True)
        ]
        is_zip = self.file.combine == "zip"
        return tuple(
            Dimension(
                name,
                axis.key,
                axis.points,
                unit_of(axis.key, self.base),
                axis.key.replace(".", " ").replace("_", " "),
                names[0] if is_zip else name,
            )
            for name, axis in zip(names, self.file.axis, strict=True)
        )

    def _repr_html_(self) -> str:
        """Return the axes and the case that they vary as HTML for a notebook."""
        rows = "".join(
            f"<tr><td>{escape(d.key)}</td><td>{len(d.values)}</td>"
            f"<td>{escape(str(d.values[0]))} … {escape(str(d.values[-1]))}</td>"
            f"<td>{escape(d.units)}</td></tr>"
            for d in self.dimensions
        )
        heading = "<tr><th>key</th><th>values</th><th>from … to</th><th>unit</th></tr>"
        return (
            f"<p>sweep {escape(self.file.name)}: {self.n_points} points</p>"
            f"<table>{heading}{rows}</table>{self.base._repr_html_()}"
        )

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Size of each dimension of the grid by name, in order."""
        sizes = {"direction": len(DIRECTIONS)} if self.file.order == "both" else {}
        return sizes | {d.along: len(d.values) for d in self.dimensions}

    @property
    def n_points(self) -> int:
        """Number of points."""
        return math.prod(self.sizes.values())

    def overrides(self, index: int) -> dict[str, Value]:
        """Return the values of a point by key; `index` counts the grid in C order."""
        place = dict(
            zip(self.sizes, np.unravel_index(index, tuple(self.sizes.values())), strict=True)
        )
        return {d.key: d.values[place[d.along]] for d in self.dimensions}

    def case(self, index: int) -> Case:
        """Return the case of a point.

        Raises:
            CaseError: its values do not make a valid case.
        """
        return self.case_of(self.overrides(index), f"point {index}")

    def initial(self, index: int) -> dict[str, float]:
        """Return the initial conditions of a point; see `SweepFile.initial` for the keys."""
        return self.initial_of(self.overrides(index))

    @cached_property
    def tracks(self) -> tuple[IntArray, ...]:
        """Points in sequences in which each starts from the state of the one before; () if none."""
        if self.file.order == "independent":
            return ()
        first = self.dimensions[0]
        grid = np.arange(self.n_points).reshape(tuple(self.sizes.values()))
        along = list(self.sizes).index(first.name)
        rising = np.argsort(np.array(first.values, dtype=np.float64), kind="stable")
        lines = np.moveaxis(grid, along, -1)[..., rising].reshape(-1, rising.size)
        if self.file.order == "down":
            lines = lines[:, ::-1]
        elif self.file.order == "both":
            half = len(lines) // 2  # direction is the outermost dimension
            lines = np.concatenate([lines[:half], lines[half:, ::-1]])
        return tuple(np.asarray(line, dtype=np.int64) for line in lines)

    def to_toml(self, base: str) -> str:
        """Return the sweep as TOML, with `base` as the name of its base case file."""
        return toml_text(self._written | {"base": base})

    @property
    def _written(self) -> dict[str, Any]:
        """What the sweep file says beside its base."""
        data = self.file.model_dump(exclude_none=True, exclude_unset=True, exclude={"set", "base"})
        return {"name": self.file.name} | data

    @cached_property
    def identity(self) -> str:
        """Text that is equal only for sweeps with the same numbers; see `case.identity`."""
        question = self._written
        del question["name"]  # by default that of the file
        for axis in question["axis"]:
            if axis["key"].endswith(".file"):
                axis["values"] = [Path(name) for name in axis["values"]]
        return identity(self.base, sweep=question)

    @cached_property
    def _data(self) -> bytes:
        """Base case as a pickled dictionary, the fastest way to many copies."""
        return pickle.dumps(tomllib.loads(self.base.to_toml()))

    def case_of(self, overrides: Mapping[str, Value], label: str) -> Case:
        """Return the base case with other values of keys.

        Args:
            overrides: values by key; those of initial conditions are left out.
            label: name of the case in messages.

        Raises:
            CaseError: the values do not make a valid case.
        """
        values = {key: value for key, value in overrides.items() if not is_initial(key)}
        data = pickle.loads(self._data)
        apply_overrides(data, values)
        if not self.base.is_of_points and not any(key.startswith("lamina.") for key in values):
            try:  # the laminae are those of the base, which are checked
                return Case.checked(data | {"lamina": self.base.lamina}, label).with_files_checked(
                    label
                )
            except CaseError:
                pass  # said below, with all that the case says
        return Case.checked(data, label).with_files_checked(label)

    def initial_of(self, overrides: Mapping[str, object]) -> dict[str, float]:
        """Return the initial conditions that go with values of axes.

        Raises:
            CaseError: one of them is not known, or not a number.
        """
        prefix = f"{INITIAL}."
        entries = self.file.initial | {
            key.removeprefix(prefix): value for key, value in overrides.items() if is_initial(key)
        }
        allowed = [f"{lam.name}.{what}" for lam in self.base.lamina for what in _INITIAL_QUANTITIES]
        initial = {}
        for key, value in entries.items():
            if key not in allowed:
                raise CaseError(
                    f"sweep {self.file.name}: {prefix}{key}: unknown key; expected one of "
                    f"{', '.join(prefix + name for name in allowed)}"
                )
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise CaseError(
                    f"sweep {self.file.name}: {prefix}{key}: expected a number, given {value!r}"
                )
            initial[key] = float(value)
        return initial


def _short_name(key: str) -> str:
    """Return the last part of a key; for laminae and initial conditions, the last two parts."""
    parts = key.split(".")
    return "_".join(parts[-2:]) if parts[0] in ("lamina", INITIAL) else parts[-1]


def is_initial(key: str) -> bool:
    """Return whether a key sets an initial condition."""
    return key.startswith(f"{INITIAL}.")


CHECKED = 1000
"""Largest number of values of an axis that are checked before the sweep."""


def load_sweep(path: str | Path, overrides: Mapping[str, object] | None = None) -> Sweep:
    """Read a sweep file.

    Args:
        path: TOML file; a relative name of a case file in it is relative to its folder.
        overrides: values of the base case by key; they replace those in `[set]` of the file.

    Returns:
        The sweep; every value of its axes is checked.

    Raises:
        CaseError: the file is missing or is not a valid sweep file, or a value is not valid.
    """
    path = Path(path)
    data = read_toml(path)
    if "lamina" in data:
        raise CaseError(f"sweep {path}: is a case; compute it with delam-fem run {path}")
    return sweep_of({"name": path.stem} | data, overrides, path.absolute().parent)


def sweep_of(
    data: Data, overrides: Mapping[str, object] | None = None, folder: Path | None = None
) -> Sweep:
    """Return the sweep that a dictionary describes.

    Args:
        data: content of a sweep file as `tomllib` returns it, with `name`.
        overrides: values of the base case by key; they replace those in `[set]` of the file.
        folder: folder of the base case file; default: the working directory.

    Raises:
        CaseError: the file is missing or is not a valid sweep file, or a value is not valid.
    """
    label = f"sweep {data.get('name')}"
    file = _file_of(data)
    values = file.set | dict(overrides or {})
    clash = next((axis.key for axis in file.axis if axis.key in (overrides or {})), None)
    if clash is not None:
        raise CaseError(f"override {clash}: is an axis of {label}; change it in the file")
    path = (folder or Path()) / file.base
    if file.base not in PRESETS and not path.is_file():
        raise CaseError(
            f"base {file.base!r}: neither a preset ({', '.join(PRESETS)}) nor a case file; no such "
            f"file: {path}"
        )
    base = preset(file.base, values) if file.base in PRESETS else load_case(path, values)
    sweep = Sweep(base, file)
    require_valid(sweep)
    return sweep


def _file_of(data: Data) -> SweepFile:
    """Return the content of a sweep file as a checked `SweepFile`."""
    try:
        return SweepFile.model_validate(data)
    except ValidationError as error:
        raise CaseError(message(f"sweep {data.get('name')}", error, data)) from None


def require_valid(sweep: Sweep) -> None:
    """Check the values of every axis of a sweep, with the other axes at their first value.

    Of a long axis the ends and some values between them are checked.

    Raises:
        CaseError: a value is not valid, or a requested record is not possible.
    """
    label = f"sweep {sweep.file.name}"
    names = [d.name for d in sweep.dimensions]
    clash = next((n for n in names if n in TAKEN or names.count(n) > 1), None)
    if clash is not None:
        raise CaseError(f"{label}: axis: the name {clash} is taken; give name = another one")
    first = sweep.overrides(0)
    if sweep.file.combine == "zip":
        trials = [sweep.overrides(index) for index in _some(sweep.n_points)]
    else:
        trials = [
            first | {d.key: d.values[k]} for d in sweep.dimensions for k in _some(len(d.values))
        ]
    for trial in trials:
        case = sweep.case_of(trial, label)
        sweep.initial_of(trial)
    case = sweep.case_of(first, label)
    record = sweep.file.record
    is_rest = sweep.file.start == "rest" and not sweep.file.initial
    if case.impactor and not (is_rest and not any(is_initial(d.key) for d in sweep.dimensions)):
        raise CaseError(f"{label}: start: expected rest beside impactors, which bring their own")
    if not case.is_periodic and (sweep.file.order != "independent" or record.lyapunov):
        what = "order" if sweep.file.order != "independent" else "record.lyapunov"
        raise CaseError(f"{label}: {what}: expected an excitation that repeats for it")
    N, frames = case.steps_per_period, case.frames_per_period
    if record.node_distortion and not case.is_harmonic:
        raise CaseError(f"{label}: record.node_distortion: expected a harmonic excitation")
    if record.node_distortion and (frames < 4 or N % frames):
        raise CaseError(
            f"{label}: record.node_distortion: expected output.fields_per_period of at least 4 "
            f"that divides time.steps_per_period = {N}, given {frames}"
        )
    meshes = [d.key for d in sweep.dimensions if d.key.split(".")[0] == "mesh"]
    if record.node_distortion and meshes:
        raise CaseError(
            f"{label}: record.node_distortion: expected one mesh for all points, given the "
            f"axis {meshes[0]}"
        )
    if (scan := record.scan) is None:
        return
    if not case.is_harmonic:
        raise CaseError(f"{label}: record.scan: expected a harmonic excitation")
    if frames < 5 or N % frames or case.n_window_periods < LEAST_PERIODS:
        raise CaseError(
            f"{label}: record.scan: expected output.window_periods of at least {LEAST_PERIODS},"
            " and output.fields_per_period of at least 5 that divides time.steps_per_period = "
            f"{N}, given {case.n_window_periods} and {frames}"
        )
    _check_points(case, scan, label)
    if any(d.key.endswith(".length") or d.key.startswith("scan.") for d in sweep.dimensions):
        raise CaseError(f"{label}: record.scan: expected one length and one scan for all points")


def _check_points(case: Case, scan: ScanRecord, label: str) -> None:
    """Check that the points of a scan are said once: of a plate by the case, of others here.

    Raises:
        CaseError: they are not.
    """
    if not case.is_plate:
        if scan.spacing is None:
            raise CaseError(f"{label}: record.scan.spacing: missing, but required of beams")
        scan_positions(case.length, scan.spacing, scan.first)
        return
    if case.scan is None:
        raise CaseError(f"{label}: record.scan: expected a plate with [scan], given none")
    if keys := sorted(scan.model_fields_set):
        raise CaseError(
            f"{label}: record.scan.{keys[0]}: expected none of a plate, whose [scan] says it"
        )


def _some(count: int) -> list[int]:
    """Return all numbers below `count`, or if they are many, some of them, the ends included."""
    numbers = np.unique(np.linspace(0, count - 1, min(count, CHECKED)).astype(np.int64))
    return [int(number) for number in numbers]

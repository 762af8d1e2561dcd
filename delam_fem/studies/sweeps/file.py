"""Define a sweep file as frozen, strict models: base case, axes, order of the points, record.

`grid.py` derives the points of the grid from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal, Self, TypeAlias

import numpy as np
from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from delam_fem.case.values import (
    CountOrNone,
    Label,
    NotNegative,
    Positive,
    Section,
    expected,
    inconsistent,
)

Value: TypeAlias = int | float | str
"""A value of an axis."""

_FINITE = Field(strict=True, allow_inf_nan=False)
_Number = Annotated[
    Annotated[int, Field(strict=True)] | Annotated[float, _FINITE], expected("a number")
]
_Values = Annotated[
    tuple[
        Annotated[int, Field(strict=True)]
        | Annotated[float, _FINITE]
        | Annotated[str, Field(strict=True)],
        ...,
    ],
    Field(min_length=1),
    expected("a list of at least one number or word"),
]
MOST_VALUES = 1_000_000
"""Largest number of values of an axis."""
AxisCount = Annotated[
    int, Field(strict=True, ge=1, le=MOST_VALUES), expected("a whole number from 1 to 1000000")
]
_Perturbation = Annotated[
    float, _FINITE, Field(gt=0.0, lt=1.0), expected("a number above 0 and below 1")
]
_Key = Annotated[
    str, Field(strict=True, pattern=r"^[\w-]+(\.[\w-]+)+$"), expected("a key such as gap.tip")
]


def _flat(value: object) -> dict[str, object]:
    """Return nested tables as one table with dotted keys, so that `a.b = 1` equals `"a.b" = 1`."""
    if not isinstance(value, Mapping):
        raise PydanticCustomError("unexpected", "expected a table")
    flat: dict[str, object] = {}
    for key, entry in value.items():
        if isinstance(entry, Mapping):
            flat |= {f"{key}.{rest}": deep for rest, deep in _flat(entry).items()}
        else:
            flat[str(key)] = entry
    return flat


def _some_tables(value: object) -> object:
    """Check that there is at least one [[axis]] table."""
    if not isinstance(value, list | tuple) or not value:
        raise PydanticCustomError("inconsistent", "expected at least one [[axis]] table")
    return value


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

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        """Check that there is either a complete range or a list of values of one type."""
        given = [name for name in ("start", "stop", "count") if getattr(self, name) is not None]
        if self.values is not None:
            if given or "spacing" in self.model_fields_set:
                raise inconsistent("values", "expected no start, stop, count or spacing beside it")
            if len({isinstance(value, str) for value in self.values}) > 1:
                raise inconsistent("values", "expected only numbers or only words, given both")
        elif len(given) < 3:
            raise PydanticCustomError(
                "inconsistent",
                "expected start, stop and count, or values, given {given}",
                {"given": " and ".join(given) or "none"},
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
        found = [float(value) for value in space(self.start, self.stop, self.count)]
        is_whole = isinstance(self.start, int) and isinstance(self.stop, int)
        if is_whole and all(value.is_integer() for value in found):
            return tuple(int(value) for value in found)
        return tuple(found)

    @property
    def is_numeric(self) -> bool:
        """Whether the values are numbers."""
        return self.values is None or not isinstance(self.values[0], str)


class ScanRecord(Section):
    """A row of points on the surface of a lamina, as a scanning vibrometer measures it.

    Attributes:
        lamina: its name; None: the thinner outermost one.
        spacing: distance of the points [m].
        first: position of the first point [m].
    """

    lamina: Label | None = None
    spacing: Positive
    first: NotNegative = 0.0


class Record(Section):
    """The quantities that a sweep records at each point.

    Attributes:
        summary: whether to record the numbers of summary.json that describe the motion.
        strobes: number of last stroboscopic points of the tips.
        harmonics: number of harmonics of the tips whose amplitudes and phases are recorded.
        node_distortion: whether to record d and THD of the displacement at every node.
        energies: whether to record the energy ledger, averaged over the window.
        scan: points whose velocity is recorded as complex shapes at multiples of the excitation.
        lyapunov: number of periods for the largest Lyapunov exponent; 0: not computed.
        perturbation: initial distance of the second motion for this exponent, relative to the norm
            of the motion.
    """

    summary: Annotated[bool, Field(strict=True), expected("true or false")] = True
    strobes: CountOrNone = 40
    harmonics: CountOrNone = 0
    node_distortion: Annotated[bool, Field(strict=True), expected("true or false")] = False
    energies: Annotated[bool, Field(strict=True), expected("true or false")] = False
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
        expected("a name fit for a folder: letters, digits, space and . + - _"),
    ]
    base: Annotated[str, Field(strict=True), expected("a preset or the name of a case file")]
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
        if not first.is_numeric:
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

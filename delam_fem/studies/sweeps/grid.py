"""Turn the content of a sweep file into a grid: the case of each point, the order of the points.

`load.py` reads and checks sweep files.
"""

from __future__ import annotations

import math
import pickle
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.overrides import apply_overrides
from delam_fem.case.toml import CaseError, toml_text
from delam_fem.numerics.arrays import IntArray
from delam_fem.studies.sweeps.file import SweepFile, Value

DIRECTIONS = ("up", "down")
"""Values of the coordinate `direction` in a sweep with order "both"."""
INITIAL = "initial"
"""First part of the keys that set initial conditions."""
_INITIAL_QUANTITIES = ("displacement", "velocity")
TAKEN = {
    "direction", "lamina", "node", "strobe", "harmonic", "x", "outcome", "error", "order", "scan_x",
}  # fmt: skip
"""Names that an axis cannot have, because the result uses them."""
UNITS = {
    "frequency": "Hz", "start_frequency": "Hz", "end_frequency": "Hz", "duration": "s",
    "amplitude": "m", "tip": "m", "root": "m", "length": "m", "width": "m", "thickness": "m",
    "density": "kg/m3", "young_modulus": "Pa", "bending_stiffness": "N m2",
    "penalty_stiffness": "N/m", "penalty_damping": "N s/m", "threshold_velocity": "m/s",
    "displacement": "m", "velocity": "m/s", "start": "m", "end": "m", "opening": "m",
    "acceleration": "m/s2", "position": "m", "mass": "kg", "sampling_rate": "Hz",
    "refine_velocity": "m/s", "mass_per_length": "kg/m", "step": "s",
}  # fmt: skip
"""Units by the last part of a key; all other keys are numbers without a unit."""


def unit_of(key: str, case: Case) -> str:
    """Return the unit of a key of a case, "1" of a pure number."""
    if key == "excitation.amplitude" and case.excitation.acts_on == "force":
        return "N"
    return UNITS.get(key.rsplit(".", 1)[-1], "1")


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


@dataclass(frozen=True)
class Sweep:
    """A sweep: a grid of points, each with its case.

    Attributes:
        file: content of the sweep file.
        base: base case with the overrides of the file.
    """

    file: SweepFile
    base: Case

    @cached_property
    def dimensions(self) -> tuple[Dimension, ...]:
        """The axes as coordinates."""
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
        """Return what a notebook shows: the axes, and the case that they vary."""
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
        """Sequences of points in which each starts from the state of the one before; () if none."""
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
        data = self.file.model_dump(exclude_none=True, exclude_unset=True)
        data.pop("set", None)
        return toml_text({"name": self.file.name} | data | {"base": base})

    @property
    def identity(self) -> str:
        """Text that is equal only for sweeps with the same result."""
        return f"{self.to_toml('')}\n{self.base.to_toml()}"

    @cached_property
    def _data(self) -> bytes:
        """The base case as a dictionary, pickled: the fastest way to many copies."""
        return pickle.dumps(tomllib.loads(self.base.to_toml()))

    def case_of(self, overrides: Mapping[str, Value], label: str) -> Case:
        """Return the base case with other values.

        Args:
            overrides: values by key; those of initial conditions are left out.
            label: name of the case in messages.

        Raises:
            CaseError: they do not make a valid case.
        """
        data = pickle.loads(self._data)
        apply_overrides(data, {k: v for k, v in overrides.items() if not is_initial(k)})
        return Case.checked(data, label).with_files_checked(label)

    def initial_of(self, overrides: Mapping[str, object]) -> dict[str, float]:
        """Return the initial conditions that go with values of axes.

        Raises:
            CaseError: one of them is not known, or not a number.
        """
        prefix = f"{INITIAL}."
        given = self.file.initial | {
            key.removeprefix(prefix): value for key, value in overrides.items() if is_initial(key)
        }
        allowed = [f"{lam.name}.{what}" for lam in self.base.lamina for what in _INITIAL_QUANTITIES]
        found = {}
        for key, value in given.items():
            if key not in allowed:
                raise CaseError(
                    f"sweep {self.file.name}: {prefix}{key}: unknown key; expected one of "
                    f"{', '.join(prefix + name for name in allowed)}"
                )
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise CaseError(
                    f"sweep {self.file.name}: {prefix}{key}: expected a number, given {value!r}"
                )
            found[key] = float(value)
        return found


def _short_name(key: str) -> str:
    """Return the last part of a key; for laminae and initial conditions, the last two parts."""
    parts = key.split(".")
    return "_".join(parts[-2:]) if parts[0] in ("lamina", INITIAL) else parts[-1]


def is_initial(key: str) -> bool:
    """Return whether a key sets an initial condition."""
    return key.startswith(f"{INITIAL}.")

"""Cases in other units, and cases upside down: no number of a run may depend on either.

In other units of mass and time by powers of two no digit changes, so that results are the same bit
for bit: a tolerance with a hidden unit, or a number with a wrong one, shows at once. Other units of
length scale slopes in another way than deflections, and round-off differs.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from covertable import make
from support import slow_beyond

import delam_fem as df

Exponents = tuple[int, int, int]
UNITS: dict[str, Exponents] = {
    "kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "s2": (0, 0, 2), "N": (1, 1, -2),
    "J": (1, 2, -2), "W": (1, 2, -3), "1": (0, 0, 0),
}  # fmt: skip
KEYS = {
    "m": "length width thickness tip root start end opening position gap displacement amplitude",
    "kg": "mass", "kg / m m m": "density", "N / m m": "young_modulus", "N / m": "spring stiffness "
    "penalty_stiffness", "N s / m": "damping spring_damping", "1 / s": "frequency start_frequency "
    "end_frequency", "s": "step duration", "m / s": "velocity threshold_velocity refine_velocity",
    "N": "force", "N m": "rotational_stiffness",
}  # fmt: skip
"""Keys of a case by their unit; the amplitude of a force is called "force" here."""

STRUCTURES: dict[str, dict[str, Any]] = {
    "apart": {"gap": {"tip": 0.002, "root": 1e-4, "exponent": 2.0}},
    "embedded": {
        "support": {"start": "clamped", "end": "pinned", "rotational_stiffness": 10.0},
        "delamination": [{"between": ["a", "b"], "start": 0.15, "end": 0.35, "opening": 2e-5}],
    },
    "edge": {
        "delamination": [
            {"between": ["a", "b"], "start": 0.25, "end": 0.5, "opening": 1e-4, "shape": "power"}
        ]
    },
}
EXTRAS: dict[str, dict[str, Any]] = {
    "nothing": {},
    "stop": {"stop": [{"lamina": "a", "side": "below", "gap": 2e-4, "start": 0.2, "end": 0.35}]},
    "impactor": {
        "impactor": [
            {
                "lamina": "b", "side": "above", "mass": 0.01, "position": 0.3, "gap": 1e-4,
                "velocity": 0.1, "spring": 100.0, "spring_damping": 0.05,
            }
        ]
    },
    "start": {
        "initial": [{"lamina": "a", "shape": "mode", "displacement": -1e-4, "velocity": 0.02}],
        "point_mass": [{"lamina": "b", "mass": 0.02, "position": 0.25}],
    },
}  # fmt: skip
FACTORS = {
    "structure": list(STRUCTURES),
    "method": [
        ("newton", "moreau-jean"), ("newton", "newmark"), ("newton-penalty", "newmark"),
        ("penalty", "newmark"),
    ],
    "drive": ["harmonic", "force", "hammer", "sweep"],
    "extra": list(EXTRAS),
    "refine": [1, 8],
    "damping": ["two-mode", "stiffness"],
}  # fmt: skip
CELLS = slow_beyond(make(FACTORS), lambda cell: "-".join(str(cell[name]) for name in FACTORS))


def case_of(cell: dict[str, Any]) -> dict[str, Any]:
    """Return the case of a cell as a table."""
    law, scheme = cell["method"]
    f = 4.0 if cell["structure"] == "apart" else 60.0
    base = 0.005 if cell["structure"] == "apart" else 2e-4
    force = {"lamina": "b", "position": 0.3, "amplitude": 1.0}
    steps: dict[str, Any] = {"step": 0.0025 / f}
    drives: dict[str, dict[str, Any]] = {
        "harmonic": {"frequency": f, "amplitude": base},
        "sweep": {
            "start_frequency": f, "end_frequency": 1.5 * f, "duration": 3.0 / f, "amplitude": base
        },
        "force": {"frequency": f, **force},
        "hammer": {"duration": 0.1 / f, **force},
    }  # fmt: skip
    if cell["drive"] in ("harmonic", "force"):
        steps = {"steps_per_period": 400, "periods": 3}
    elif cell["drive"] == "hammer":
        steps["duration"] = 3.0 / f
    size = {"length": 0.5, "width": 0.02, "density": 2700.0, "young_modulus": 7e10}
    case = {
        "name": "cell",
        "lamina": [
            {"name": name, "thickness": h, "damping_ratio": 0.01, **size}
            for name, h in (("a", 0.0014), ("b", 0.0008))
        ],
        "mesh": {"elements": 10},
        "damping": {"rayleigh": cell["damping"]},
        "excitation": {"kind": cell["drive"], **drives[cell["drive"]]},
        "contact": {
            "law": law, "restitution": 0.3, "penalty_stiffness": 500.0, "threshold_velocity": 1e-3,
        },
        "time": {"scheme": scheme, "refine": cell["refine"], "refine_velocity": 0.02, **steps},
        "output": {"window_periods": 3} if "periods" in steps else {},
        "sensor": [
            {"name": "u", "quantity": "displacement", "lamina": "a", "position": 0.3},
            {"name": "v", "quantity": "velocity", "lamina": "b", "position": 0.35},
            {"name": "e", "quantity": "strain", "lamina": "b", "position": 0.22},
            {"name": "f", "quantity": "contact force", "between": ["a", "b"]},
        ],
        **copy.deepcopy(STRUCTURES[cell["structure"]] | EXTRAS[cell["extra"]]),
    }  # fmt: skip
    if law == "penalty":  # springs everywhere
        for one in (*case.get("stop", ()), *case.get("impactor", ())):
            one["stiffness"] = 5000.0
    return case


def factor(unit: str, scale: Exponents | tuple[float, ...]) -> float:
    """Return by what a number grows when kg, m and s shrink by `scale`."""
    above, _, below = unit.partition("/")
    exponents = [np.add.reduce([UNITS[name] for name in part.split()] or [(0, 0, 0)])
                 for part in (above, below)]  # fmt: skip
    return float(np.prod(np.power(scale, exponents[0] - exponents[1])))


def scaled(node: Any, scale: tuple[float, ...], key: str = "") -> Any:
    """Return a part of a case in other units."""
    if isinstance(node, dict):
        is_force = node.get("kind") in ("force", "hammer")
        return {
            name: scaled(part, scale, "force" if is_force and name == "amplitude" else name)
            for name, part in node.items()
        }
    if isinstance(node, list):
        return [scaled(part, scale, key) for part in node]
    unit = next((unit for unit, keys in KEYS.items() if key in keys.split()), "1")
    return node * factor(unit, scale) if isinstance(node, float) else node


def computed(case: dict[str, Any]) -> Any:
    """Return the history of a case."""
    history = df.run(df.Case.checked(case, "cell"), "compiled").history
    assert history.attrs["outcome"] == "completed"
    return history


def differences(one: Any, other: Any, scale: tuple[float, ...]) -> Iterator[tuple[str, float]]:
    """Yield how far each variable is from the expected one, relative to the largest of its unit."""
    names = [name for name in one.variables if one[name].dtype.kind == "f"]
    largest: dict[str, float] = {}
    for name in names:
        unit = one[name].attrs["units"]
        size = float(np.nanmax(np.abs(one[name].values), initial=0.0))
        largest[unit] = max(size, largest.get(unit, 0.0))
    for name in names:
        unit = one[name].attrs["units"]
        away = other[name].values / factor(unit, scale) - one[name].values
        np.testing.assert_array_equal(np.isnan(other[name].values), np.isnan(one[name].values))
        yield name, float(np.nanmax(np.abs(away), initial=0.0)) / (largest[unit] or 1.0)


@pytest.mark.parametrize("cell", CELLS)
def test_other_units_change_no_number(cell: dict[str, Any]) -> None:
    case = case_of(cell)
    one = computed(case)
    assert one.impact_count.values.sum() > 0 or cell["method"][0] == "penalty"
    for scale, most in (((4.0, 1.0, 0.25), 0.0), ((1.0, 2.0**-14, 1.0), 1e-6)):
        other = computed(scaled(case, scale))
        assert other.sizes == one.sizes
        for name in (name for name in one.variables if one[name].dtype.kind in "biu"):
            np.testing.assert_array_equal(other[name].values, one[name].values, name)
        assert {name: e for name, e in differences(one, other, scale) if e > most} == {}


def upside_down(case: dict[str, Any]) -> dict[str, Any]:
    """Return a case whose first lamina is the upper one, pushed the other way."""
    turned = copy.deepcopy(case)
    turned["lamina"].reverse()
    for one in (*turned.get("stop", ()), *turned.get("impactor", ())):
        one["side"] = {"above": "below", "below": "above"}[one["side"]]
    for one in turned.get("initial", ()):
        one["displacement"], one["velocity"] = -one["displacement"], -one["velocity"]
    for one in (*turned.get("delamination", ()), turned["sensor"][3]):
        one["between"] = ["b", "a"]
    turned["sensor"][2]["surface"] = "bottom"
    return turned


@pytest.mark.parametrize("cell", CELLS)
def test_a_case_upside_down_moves_the_other_way(tmp_path: Path, cell: dict[str, Any]) -> None:
    case = case_of(cell)
    turned = upside_down(case)
    is_force = cell["drive"] in ("force", "hammer")
    end = 3.0 / (4.0 if cell["structure"] == "apart" else 60.0)
    t = np.linspace(0.0, end, 301)
    y = np.sin(6.0 * np.pi * t / end) * np.sin(np.pi * t / end) ** 2
    size = 1.0 if is_force else 0.005 if cell["structure"] == "apart" else 2e-4
    what = "force [N]" if is_force else "displacement [m]"
    for one, sign in ((case, size), (turned, -size)):
        file = tmp_path / f"{sign:g}.csv"
        np.savetxt(file, np.column_stack([t, sign * y]), delimiter=",", header=f"time [s],{what}",
                   comments="", fmt="%.17g")  # fmt: skip
        drive = {"kind": "table", "file": str(file), "acts_on": "force" if is_force else "base"}
        one["excitation"] = drive | ({"lamina": "b", "position": 0.3} if is_force else {})
        one["time"] = {
            key: value for key, value in one["time"].items() if key.startswith(("scheme", "refine"))
        } | {"step": end / 1200.0, "duration": end}
        one["output"] = {}
    up, down = computed(case), computed(turned)
    assert float(np.abs(up.sensor_f).max()) > 0.0
    for name, sign in (("u", -1.0), ("v", -1.0), ("e", 1.0), ("f", 1.0)):
        a, b = up[f"sensor_{name}"].values, sign * down[f"sensor_{name}"].values
        assert np.abs(a - b).max() <= 1e-6 * np.abs(a).max(), name

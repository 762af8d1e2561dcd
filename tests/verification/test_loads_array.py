"""Both engines under constant loads: any load, body, method and beginning meet in some cell.

Each cell also says that the load counts: without it the motion is another one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from covertable import make
from support import slow_beyond

import delam_fem as df
from delam_fem.api import Case

SAME = 1e-8
"""Difference of engines relative to the motion; impacts amplify round-off. The state of rest is the
same for both."""
CLOSED = {"central-difference": 1e-5}
"""Relative residual of the ledger; central-difference balances energy only for small steps."""
ROUND_OFF = 1e-9
"""The same of other schemes."""

LOADS: dict[str, dict[str, Any]] = {
    "level": {"gravity": {}},
    "slanted": {"gravity": {"inclination": 50.0, "roll": 30.0}},
    "in place": {"gravity": {"gaps": "in place"}},
    "force": {"load": [{"lamina": "upper", "position": 0.17, "force": -0.4}]},
    "pressed": {"load": [{"between": ["lower", "upper"], "position": 0.15, "force": 0.3}]},
    "tension": {"load": [{"axial": 20.0}]},
}
STRIP = {"length": 0.3, "width": 0.02, "density": 2700.0, "young_modulus": 7e10,
         "damping_ratio": 0.01}  # fmt: skip
STRIPS = [
    {"name": "lower", "thickness": 0.002} | STRIP,
    {"name": "upper", "thickness": 1e-3} | STRIP,
]
BARS = [lamina | {"motion": "axial"} for lamina in STRIPS]
POINTS = [{"name": name, "mass": 0.05, "stiffness": 200.0, "damping_ratio": 0.02}
          for name in ("lower", "upper")]  # fmt: skip
STACK: dict[str, Any] = {
    "lamina": STRIPS, "mesh": {"elements": 9},
    "support": {"start": "clamped", "end": "clamped"},
    "delamination": [{"between": ["lower", "upper"], "start": 0.1, "end": 0.2}],
}  # fmt: skip
BODIES: dict[str, dict[str, Any]] = {
    "apart": {"lamina": STRIPS, "mesh": {"elements": 4}, "gap": {"tip": 1e-3}},
    "layered": STACK,
    "plane": STACK | {"model": {"kind": "plane-stress"}, "mesh": {"elements": 6}},
    "bars": {"lamina": BARS, "mesh": {"elements": 4}, "gap": {"tip": 1e-9, "root": 1e-9}},
    "points": {"lamina": POINTS, "mesh": {"elements": 1}, "gap": {"tip": 5e-4}},
    "struck": {
        "lamina": STRIPS[1:], "mesh": {"elements": 4},
        "stop": [{"lamina": "upper", "side": "below", "gap": 1e-3, "position": 0.3}],
        "impactor": [{"lamina": "upper", "side": "above", "position": 0.15, "mass": 0.01,
                      "gap": 1e-3, "velocity": 0.05}],
        "point_mass": [{"lamina": "upper", "mass": 0.01, "position": 0.3}],
    },
}  # fmt: skip
DRIVES = {"apart": (20.0, 1e-3), "layered": (120.0, 1e-4), "plane": (120.0, 1e-4),
          "bars": (3000.0, 1e-9), "points": (10.0, 1e-3), "struck": (20.0, 1e-3)}  # fmt: skip
"""Frequency [Hz] and amplitude [m] of the base."""
METHODS: dict[str, tuple[str, str, int]] = {
    "newton@moreau-jean": ("newton", "moreau-jean", 400),
    "newton-penalty@newmark": ("newton-penalty", "newmark", 400),
    "penalty@newmark": ("penalty", "newmark", 400),
    "penalty@central-difference": ("penalty", "central-difference", 20000),
    "none@newmark": ("none", "newmark", 400),
}
FACTORS: dict[str, list[str]] = {
    "load": list(LOADS), "body": list(BODIES), "method": list(METHODS),
    "begin": ["equilibrium", "unloaded"],
}  # fmt: skip
BENDING = ("apart", "layered", "plane", "struck")


def goes(load: str, body: str) -> bool:
    """Return whether a body takes a load."""
    if load == "tension":  # axial forces are those of beams and of solids that bend
        return body in BENDING
    if load == "in place":  # a free impactor falls: there is no place to measure at
        return body in ("apart", "points")
    if body == "bars":  # the weight of level bars is across them
        return load in ("slanted", "force", "pressed")
    return load != "pressed" or body != "struck"


CELLS: list[dict[str, str]] = make(
    FACTORS, strength=2,
    constraints=[
        {"operator": "fn", "requires": ["load", "body"],
         "evaluate": lambda cell: goes(cell["load"], cell["body"])},
        {"operator": "fn", "requires": ["body", "method"],  # a solid needs steps of 80 ns
         "evaluate": lambda cell: (
             (cell["body"], cell["method"]) != ("plane", "penalty@central-difference")
         )},
    ],
)  # fmt: skip


def case_of(load: str, body: str, method: str, begin: str) -> Case:
    """Return the case of a cell."""
    law, scheme, steps = METHODS[method]
    frequency, amplitude = DRIVES[body]
    data: dict[str, Any] = {
        "name": "cell",
        "excitation": {"kind": "harmonic", "frequency": frequency, "amplitude": amplitude},
        "contact": {"law": law, "penalty_stiffness": 1e4, "restitution": 0.4},
        "time": {"scheme": scheme, "steps_per_period": steps, "periods": 2, "begin": begin,
                 "mass": "lumped" if scheme == "central-difference" else "consistent"},
        "output": {"window_periods": 2, "fields_per_period": 0},
    } | BODIES[body]  # fmt: skip
    tables = {key: value for key, value in LOADS[load].items()}
    if body == "points" and "load" in tables:
        tables["load"] = [
            {k: v for k, v in entry.items() if k != "position"} for entry in tables["load"]
        ]
    if law == "newton" and body == "struck":
        data["contact"]["restitution"] = 0.0
    return Case(**(data | tables))


BEAMS, PLANE = ([cell for cell in CELLS if (cell["body"] == "plane") is is_plane]
                for is_plane in (False, True))  # fmt: skip


@pytest.mark.parametrize("cell", slow_beyond(BEAMS))
def test_engines_move_alike_under_loads(cell: dict[str, str]) -> None:
    check(cell)


@pytest.mark.slow
@pytest.mark.parametrize("cell", slow_beyond(PLANE))
def test_engines_move_solids_alike_under_loads(cell: dict[str, str]) -> None:
    check(cell)


def check(cell: dict[str, str]) -> None:
    """Compare a cell in both engines."""
    case = case_of(**cell)
    petsc, compiled = (df.run(case, engine) for engine in ("petsc", "compiled"))
    names = ["tip_displacement", "tip_velocity", "energy_strain", "energy_kinetic"]
    for name in names:
        first, second = petsc.history[name].values, compiled.history[name].values
        assert np.abs(first - second).max() < SAME * np.abs(first).max(), name
    for result in (petsc, compiled):
        closed = CLOSED.get(case.time.scheme, ROUND_OFF)
        assert abs(result.summary["energy_residual"]) < closed
    assert petsc.summary["rest"] == compiled.summary["rest"]
    free = df.run(case.without_loads, "compiled").history.tip_displacement.values
    moved = compiled.history.tip_displacement.values
    assert np.abs(moved - free).max() > 1e-4 * np.abs(moved).max(), "the load counts"

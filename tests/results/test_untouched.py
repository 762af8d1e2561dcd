"""A body that rests, or flies and strikes nothing, has not diverged, however far it goes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import Case, load_case

STEEL: dict[str, Any] = {
    "name": "body", "length": 0.3, "width": 0.02, "thickness": 0.002, "material": "steel",
    "damping_ratio": 0.0,
}  # fmt: skip
FREE: dict[str, Any] = {"support": {"start": "free", "end": "free"}}
POINT = {"name": "body", "mass": 0.007, "stiffness": 0.0, "damping_ratio": 0.0}
BODIES: dict[str, dict[str, Any]] = {
    "point": {"lamina": [POINT], "mesh": {"elements": 1}},
    "bar": {"lamina": [{**STEEL, "motion": "axial"}], "mesh": {"elements": 4}, **FREE},
    "beam": {"lamina": [STEEL], "mesh": {"elements": 4}, **FREE},
}
PERIOD, PERIODS = 0.05, 5


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize("scheme", ["newmark", "moreau-jean"])
@pytest.mark.parametrize(
    ("displacement", "velocity"), [(0.0, 0.0), (0.1, 0.0), (0.0, 1.0), (0.0, 300.0)]
)
@pytest.mark.parametrize("body", BODIES)
def test_what_nothing_touches_goes_on(
    body: str, displacement: float, velocity: float, scheme: str, engine: Any
) -> None:
    case = Case.model_validate({
        "name": "untouched", **BODIES[body],
        "initial": [{"displacement": displacement, "velocity": velocity}],
        "excitation": {"kind": "harmonic", "frequency": 1.0 / PERIOD, "amplitude": 1e-12},
        "contact": {"law": "newton"},
        "time": {"scheme": scheme, "steps_per_period": 500, "periods": PERIODS},
    })  # fmt: skip
    result = df.run(case, engine)
    assert result.summary["outcome"] == "completed"
    assert result.summary["warnings"] == []
    end = float(result.history["tip_displacement"][0, -1])
    wanted = displacement + velocity * PERIOD * PERIODS
    assert end == pytest.approx(wanted, rel=1e-6, abs=1e-9)


def test_a_ball_may_fall_fifty_metres(tmp_path: Path) -> None:
    """s = g t²/2; nobody has given a length that it must not exceed."""
    weight, duration = 0.007 * 9.81, 3.2
    table = tmp_path / "weight.csv"
    rows = [f"{t:.6f},{-weight:.12g}" for t in np.linspace(0.0, duration, 9)]
    table.write_text("time [s],force [N]\n" + "\n".join(rows) + "\n")
    path = tmp_path / "case.toml"
    path.write_text(
        'name = "ball"\n[[lamina]]\nname = "ball"\nmass = 0.007\nstiffness = 0.0\n'
        "damping_ratio = 0.0\n[mesh]\nelements = 1\n"
        '[excitation]\nkind = "table"\nacts_on = "force"\nlamina = "ball"\nposition = 1.0\n'
        'file = "weight.csv"\n[contact]\nlaw = "none"\n[time]\nstep = 1e-3\n'
    )
    result = df.run(load_case(path))
    assert result.summary["outcome"] == "completed"
    end = float(result.history["tip_displacement"][0, -1])
    assert end == pytest.approx(-0.5 * 9.81 * duration**2, rel=1e-5)

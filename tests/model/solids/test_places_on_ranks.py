"""What a case has at a place of a solid is the same on two ranks as on one."""

from __future__ import annotations

import json
from typing import Any

import pytest
from mpi_pool import Crew

from delam_fem.api import Case

L = 0.5
LOWER = {
    "name": "lower", "length": L, "width": 0.02, "thickness": 0.005, "mass_per_length": 0.1,
    "bending_stiffness": 10.0, "damping_ratio": 0.01,
}  # fmt: skip
UPPER = LOWER | {"name": "upper", "bending_stiffness": 4.0}
APART = {"lamina": [LOWER, UPPER], "gap": {"tip": 0.01}}
BONDED = {
    "lamina": [LOWER, UPPER],
    "delamination": [{"between": ["lower", "upper"], "start": 0.2, "end": L, "opening": 1e-3,
                      "shape": "power"}],
}  # fmt: skip
SENSORS = [
    {"name": f"{name}-{quantity}-{number}", "quantity": quantity, "lamina": name, "position": x}
    for name in ("lower", "upper")
    for quantity in ("displacement", "velocity", "acceleration", "strain")
    for number, x in enumerate((0.07, 0.43))
]
STOPS = [
    {"lamina": "upper", "position": 0.45, "side": "above", "gap": 1e-4, "on": "base"},
    {"lamina": "lower", "position": 0.3, "side": "below", "gap": 5e-5, "on": "ground"},
]
OF_STOPS = [
    {"name": f"stop-{number}", "quantity": "contact force", "stop": number} for number in (1, 2)
]
SPRINGS = {"law": "penalty@newmark", "penalty_stiffness": 2e3, "impulse": "consistent"}
FORCE = {"kind": "force", "amplitude": 0.1, "frequency": 20.0}

PROGRAM = """
import json
import numpy as np
import delam_fem as df
from delam_fem.api import assemble
from delam_fem.cli.endings import ended_together

case = df.Case(**json.loads(arguments[0]))
with ended_together(comm):
    o = assemble(case, comm=comm).operators
    assert 0 < o.n_own < o.n_dofs  # no rank has assembled all
    many = df.run(case, comm=comm)
    if comm.rank == 0:
        one = df.run(case).history
        names = [name for name in one if str(name).startswith(("tip_", "sensor_"))]
        assert len(names) >= 18
        for name in (*names, "energy_force_work", "energy_base_work", "energy_damping_loss"):
            a, b = one[name].values, many.history[name].values
            assert np.abs(a - b).max() <= 1e-6 * np.abs(a).max(), name
        assert np.abs(one.tip_displacement.values).max() > 1e-6
        assert all(one[f"sensor_stop-{k + 1}"].values.any() for k in range(len(case.stop)))
"""


@pytest.mark.parametrize(
    "sections",
    [
        APART | {"excitation": FORCE | {"lamina": "upper", "position": 0.45}},
        APART | {"excitation": FORCE | {"lamina": "lower", "position": 0.1}},
        BONDED | {"excitation": FORCE | {"lamina": "upper", "position": 0.48}},
        APART | {"point_mass": [{"lamina": "upper", "mass": 0.02, "position": 0.3}]},
        BONDED
        | {
            "point_mass": [{"lamina": "lower", "mass": 0.02}],
            "support": [{"position": 0.1, "kind": "spring", "stiffness": 2e3, "damping": 0.5}],
        },
        BONDED  # MUMPS's first workspace is too small for the rows of this spring
        | {
            "model": {"kind": "solid", "poisson": 0.0},
            "mesh": {"elements": 5},
            "support": [{"position": 0.1, "kind": "spring", "stiffness": 2e3, "damping": 0.5}],
        },
        APART | {"stop": STOPS, "sensor": SENSORS + OF_STOPS, "contact": SPRINGS},
        BONDED | {"stop": STOPS, "sensor": SENSORS + OF_STOPS, "contact": SPRINGS},
    ],
    ids=[
        "force on one rank",
        "force on the other",
        "force on a cut body",
        "mass",
        "spring",
        "spring of a solid",
        "stops",
        "stops of a cut body",
    ],
)
def test_places_are_the_same_on_two_ranks(sections: dict[str, Any], crew: Crew) -> None:
    case = Case.model_validate(
        {
            "name": "places", "mesh": {"elements": 10}, "contact": {"law": "none"},
            "model": {"kind": "plane-stress", "poisson": 0.0}, "sensor": SENSORS,
            "excitation": {"kind": "harmonic", "amplitude": 2e-4, "frequency": 20.0},
            "time": {"steps_per_period": 100, "periods": 2}, "output": {"window_periods": 2},
        }
        | sections
    )  # fmt: skip
    crew.run(2, PROGRAM, json.dumps(case.model_dump(mode="json", exclude_unset=True)))

"""What a summary says of springs, decay and forces is the same on two ranks as on one."""

from __future__ import annotations

import json

import pytest
from mpi_pool import Crew
from plates import patched

from delam_fem.api import Case

SAME = 1e-8
"""Relative difference that round-off may leave."""
AMPLIFIED = 1e-6
"""The same of forces after some blows, each of which makes differences larger."""

PROGRAM = """
import json
import logging
import delam_fem as df
from delam_fem.api import assemble
from delam_fem.simulation.recorder import energy_round_off
from delam_fem.cli.endings import ended_together


class Kept(logging.Handler):
    def emit(self, record):
        texts.append(record.getMessage())


texts, told = [], []
logging.getLogger("delam_fem").addHandler(Kept())
case = df.Case(**json.loads(arguments[0]))


def close(a, b, share=SAME):
    assert abs(a - b) <= share * abs(a), (a, b)


with ended_together(comm):
    many = df.run(case, comm=comm).summary
    assert comm.rank == 0 or not texts
    round_off = energy_round_off(assemble(case, comm=comm).operators)
    if comm.rank == 0:
        told = sorted(texts)
        texts.clear()
        one = df.run(case).summary
        assert told == sorted(texts) and many["warnings"] == one["warnings"]
        close(energy_round_off(assemble(case).operators), round_off)
        if "penalty" in case.contact.law:
            close(one["blow_steps"], many["blow_steps"])
            assert any(entry["peak_force"] for entry in one["contacts"])
        close(one["settling"]["decay"], many["settling"]["decay"])
        assert one["settling"]["decay"] > 0.0
        for a, b in zip(one["contacts"], many["contacts"], strict=True):
            assert a["strikes_per_period"] == b["strikes_per_period"]
            close(a["peak_force"] or 0.0, b["peak_force"] or 0.0, AMPLIFIED)
"""


def of_strips(**sections: object) -> Case:
    """Return a bonded pair of strips in plane stress whose delamination closes on springs."""
    strip = {"name": "lower", "length": 0.3, "width": 0.02, "thickness": 1e-3, "density": 2700.0,
             "young_modulus": 70e9, "damping_ratio": 0.01}  # fmt: skip
    data: dict[str, object] = {
        "name": "strips",
        "lamina": [strip, strip | {"name": "upper", "thickness": 5e-4}],
        "model": {"kind": "plane-stress"},
        "mesh": {"elements": 12},
        "delamination": [{"between": ["lower", "upper"], "start": 0.1, "end": 0.25}],
        "excitation": {"kind": "harmonic", "frequency": 40.0, "amplitude": 5e-4},
        "contact": {"law": "penalty", "penalty_stiffness": 2e4},
        "time": {"steps_per_period": 60, "periods": 1},
        "output": {"window_periods": 1, "fields_per_period": 6},
    }
    return Case.checked(data | sections, "strips")


def of_a_plate() -> Case:
    """Return a plate, whose damping dies out as its own modes do."""
    return patched(
        contact={"law": "none"},
        time={"steps_per_period": 20, "periods": 1},
        output={"window_periods": 1, "fields_per_period": 5},
    )


@pytest.mark.mpi
@pytest.mark.parametrize("case", [of_strips(), pytest.param(of_a_plate(), marks=pytest.mark.slow)])
def test_a_summary_is_the_same_on_two_ranks(case: Case, crew: Crew) -> None:
    data = json.dumps(case.model_dump(mode="json", exclude_unset=True))
    crew.run(2, f"SAME, AMPLIFIED = {SAME}, {AMPLIFIED}\n" + PROGRAM, data)

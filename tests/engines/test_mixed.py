"""Short runs of unlike laminae in full: motion, states, impacts, energies, by both engines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import golden
import numpy as np
import pytest
from mixed import FORCE, INNER, STOPS, apart, bonded

from delam_fem.case.definition import Case
from delam_fem.engines.session import ENGINES, EngineName, session_of
from delam_fem.model.beams import closed_form

Check = Callable[..., None]
NO_ENERGY = 1e-12
"""J; smaller ones are round-off of a few."""
HARD = {"kind": "harmonic", "amplitude": 2e-3, "frequency": 27.0}
TIMES = {"steps_per_period": 160, "periods": 2}
SPRINGS = {"law": "penalty", "penalty_stiffness": 3e3, "penalty_damping": 0.3}
RIGID = {"law": "newton", "restitution": 0.35, "impulse": "consistent"}
STICKY = {
    "law": "newton-penalty", "restitution": 0.2, "penalty_stiffness": 900.0,
    "threshold_velocity": 0.02,
}  # fmt: skip
FEW = {"mesh": {"elements": 5}, "excitation": HARD, "sensor": [], "output": {"window_periods": 2}}
ALONE = FEW | {"stop": [], "impactor": []}
CASES: dict[str, Case] = {
    "springs": apart(**FEW, contact=SPRINGS, time=TIMES),
    "springs, divided": bonded(
        **FEW | {"mesh": {"elements": 14}}, contact=SPRINGS | {"points_per_element": 2},
        time=TIMES | {"refine": 6, "refine_velocity": 0.01},
    ),
    "impacts": apart(**FEW, contact=RIGID, time=TIMES | {"mass": "lumped"}),
    "impacts, divided": apart(
        **ALONE, contact=RIGID | {"points_per_element": 2}, time=TIMES | {"refine": 4}
    ),
    "lumped impulses": apart(**ALONE, contact=RIGID | {"impulse": "lumped"}, time=TIMES),
    "resting": apart(**ALONE, contact=STICKY | {"impulse": "lumped"}, time=TIMES),
    "resting, divided": apart(
        **ALONE, contact=STICKY | {"impulse": "consistent"}, time=TIMES | {"refine": 4},
        damping={"rayleigh": "mass"},
    ),
    "steps": apart(
        **FEW, contact=RIGID | {"threshold_velocity": 0.03}, time=TIMES | {"scheme": "moreau-jean"}
    ),
    "steps, divided": bonded(
        **FEW | {"mesh": {"elements": 14}, "stop": STOPS[2:]}, contact=RIGID, delamination=INNER,
        support=[{"start": "clamped", "end": "pinned"}],
        time=TIMES | {"scheme": "moreau-jean", "refine": 6},
    ),
    "central": apart(
        **ALONE, contact=RIGID, damping={"rayleigh": "mass"},
        time={"steps_per_period": 900, "periods": 2, "scheme": "central-difference"},
    ),
    "central, springs": apart(
        **ALONE | {"excitation": FORCE | {"amplitude": 40.0}}, contact=SPRINGS, point_mass=[],
        time={"steps_per_period": 900, "periods": 2, "scheme": "central-difference",
              "mass": "lumped"},
        damping={"rayleigh": "mass"},
    ),
    "open": apart(**FEW, contact={"law": "none"}, time=TIMES),
}  # fmt: skip


PLASTIC = {"law": "newton", "restitution": 0.0}
MASSLESS = TIMES | {"mass": "massless", "refine": 5}
MODAL: dict[str, Case] = {
    "apart": apart(
        **FEW | {"stop": STOPS[1:2], "impactor": []}, contact=PLASTIC, time=MASSLESS,
        model={"kind": "modes", "modes": 3},
    ),
    "bonded": bonded(
        **ALONE | {"mesh": {"elements": 14}}, contact=PLASTIC, delamination=INNER, time=MASSLESS,
        support=[{"start": "clamped", "end": "pinned"}], model={"kind": "modes", "modes": 5},
    ),
    "open": apart(
        **ALONE | {"excitation": FORCE}, contact={"law": "none"}, time=MASSLESS | {"refine": 1},
        model={"kind": "modes", "modes": 2},
    ),
}  # fmt: skip


def of_run(case: Case, engine: EngineName) -> tuple[str, str]:
    """Return what is kept of a run, and what only this engine counts."""
    operators = closed_form.assemble(case).operators
    with session_of(case, operators, engine=engine) as opened:
        found = opened.solution(opened.run())
    records, counted = [], []
    for record in found.records:
        kept = {field.name: getattr(record, field.name) for field in fields(record)}
        kept |= {"contact": np.array(record.contact, dtype=np.int64), "jumps": None}
        for name in ("released", "impact", "flows", "damped", "start"):  # or round-off
            kept[name] = np.where(np.abs(kept[name]) < NO_ENERGY, 0.0, kept[name])
        counted.append({name: kept.pop(name) for name in ("effort", "flows")})
        records.append(kept)
    recorder = found.recorder
    told = {
        "outcome": found.outcome, "time": found.time, "displacement": found.displacement,
        "velocity": found.velocity, "frames": found.frames, "impacts": found.impacts,
        "energy": {k: np.where(np.abs(v) < NO_ENERGY, 0.0, v) for k, v in found.energy.items()},
        "records": records, "motion": found.state.motion[:2], "resting": found.state.resting,
        "strobe": recorder.strobe, "envelope": recorder.envelope, "impulse": recorder.impulse,
    }  # fmt: skip
    return golden.of_object(told), golden.of_object(counted, engine)


@pytest.mark.parametrize("name", CASES)
def test_runs_of_both_engines_are_the_stored_one(name: str, stored: Check) -> None:
    for engine in ENGINES:
        told, counted = of_run(CASES[name], engine)
        stored(told)
        stored(counted, f".{engine}")


@pytest.mark.parametrize("name", MODAL)
def test_runs_in_modes_are_the_stored_ones(name: str, stored: Check) -> None:
    stored("\n".join(of_run(MODAL[name], "modal")))

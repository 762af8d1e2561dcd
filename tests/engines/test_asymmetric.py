"""Both engines move laminae alike in which no two numbers are alike."""

from __future__ import annotations

import numpy as np
import pytest
from mixed import FORCE, INNER, STOPS, apart, bonded

from delam_fem.api import Case, assemble, session_of

SAME = 1e-7
"""Of the largest value; round-off that some tens of impacts have amplified."""
CLOSED = 1e-9
"""Relative residual of the ledger."""
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


@pytest.mark.parametrize("name", CASES)
def test_engines_move_alike_and_their_ledgers_close(name: str) -> None:
    case = CASES[name]
    operators = assemble(case, needs_dolfinx=False).operators
    solutions = []
    for engine in ("petsc", "compiled"):
        with session_of(case, operators, engine=engine) as session:
            solutions.append(session.solution(session.run()))
    petsc, compiled = solutions
    assert petsc.outcome == compiled.outcome == "completed"
    for quantity in ("displacement", "velocity", "frames"):
        expected = np.asarray(getattr(petsc, quantity))
        difference = np.asarray(getattr(compiled, quantity)) - expected
        assert np.abs(difference).max() < SAME * np.abs(expected).max(), quantity
    exchanged = np.abs(petsc.recorder.ledger).max()
    assert np.abs(compiled.recorder.ledger - petsc.recorder.ledger).max() < SAME * exchanged
    if case.time.scheme != "central-difference":  # its ledger is of the order of the step
        assert petsc.recorder.energy_residual() < CLOSED

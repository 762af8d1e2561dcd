"""Contact points inside the elements, in both engines."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from delam_fem.case.definition import Case
from delam_fem.case.files import preset
from delam_fem.contact.laws import COMBINATIONS
from delam_fem.engines.choose import ENGINES, EngineName
from delam_fem.engines.session import session_of
from delam_fem.model.beams import closed_form
from delam_fem.simulation.recorder import Recorder

SAME = 1e-10
"""m, m/s: round-off that some hundred impacts have amplified."""
CLOSED = 1e-9
"""Relative residual of the ledger."""


def methods() -> Iterator[Any]:
    """Every law under every scheme that it goes with, with consistent impulses."""
    for law, scheme in COMBINATIONS:
        yield pytest.param(law, scheme, id=f"{law}@{scheme}")


def case_of(law: str, scheme: str, p: int, **more: Any) -> Case:
    settings: dict[str, Any] = {
        "contact.law": law,
        "contact.impulse": "consistent",
        "contact.points_per_element": p,
        "time.scheme": scheme,
        "mesh.elements": 7,
        "damping.rayleigh": "stiffness",
        "time.periods": 2,
        "output.window_periods": 2,
    }
    if law == "penalty":
        settings |= {"contact.penalty_damping": 0.3}
    if scheme == "central-difference":
        settings |= {
            "mesh.elements": 3, "time.steps_per_period": 4000, "damping.rayleigh": "mass",
            "time.mass": "lumped", "time.periods": 3, "output.window_periods": 3,
        }  # fmt: skip
    return preset("paper", settings | more)


def compute(case: Case, name: EngineName) -> Recorder:
    with session_of(case, closed_form.assemble(case).operators, engine=name) as opened:
        assert opened.run() == "completed"
        return opened.recorder


@pytest.mark.parametrize(("law", "scheme"), list(methods()))
def test_both_engines_compute_the_same_motion(law: str, scheme: str) -> None:
    petsc, compiled = (compute(case_of(law, scheme, 3), name) for name in ENGINES)
    assert np.abs(petsc.strobe - compiled.strobe).max() < SAME
    for one, other in zip(petsc.window, compiled.window, strict=True):
        assert np.abs(one.u - other.u)[:, 3:].max() < SAME
        assert len(one.jumps) == len(other.jumps)
    if law not in ("none", "penalty"):
        assert sum(len(record.jumps) for record in petsc.window) > 10
    if scheme == "central-difference":  # its ledger is of the order of the step
        return
    for recorder in (petsc, compiled):
        assert recorder.energy_residual() < CLOSED

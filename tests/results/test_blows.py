"""Contact springs that the steps do not resolve: every kind of them is told, and before the run."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import BLOW_STEPS, Case, assemble, blow_steps
from delam_fem.results.quality import unresolved_blows

M, K, V, GAP, HEAVY = 0.007, 1e7, 1.0, 1e-3, 1e6
BLOW = float(np.pi * np.sqrt(M / K))
POINT: dict[str, Any] = {"name": "ball", "mass": M, "stiffness": 0.0, "damping_ratio": 0.0}
WALL: dict[str, Any] = {**POINT, "name": "wall", "mass": HEAVY}
CONTACTS: dict[str, dict[str, Any]] = {
    "stop.1.stiffness": {
        "lamina": [POINT], "initial": [{"velocity": -V}],
        "stop": [{"lamina": "ball", "side": "below", "gap": GAP, "stiffness": K}],
    },
    "impactor.1.stiffness": {
        "lamina": [WALL],
        "impactor": [{"lamina": "wall", "mass": M, "gap": GAP, "velocity": V, "stiffness": K}],
    },
    "contact.penalty_stiffness": {
        "lamina": [POINT, WALL], "initial": [{"lamina": "ball", "velocity": V}],
        "gap": {"tip": GAP},
    },
}  # fmt: skip


def striking(key: str, steps_in_a_blow: float, **time: Any) -> Case:
    """Return a free mass of 7 g that strikes a spring of 10 MN/m once; of a key, by its name."""
    step = BLOW / steps_in_a_blow
    n = int(np.ceil((1.6 * GAP / V + 3.0 * BLOW) / step)) + 3
    return Case.model_validate({
        "name": "blow", "mesh": {"elements": 1},
        "excitation": {"kind": "harmonic", "frequency": 1.0 / (n * step), "amplitude": 1e-15},
        "contact": {"law": "penalty", "penalty_stiffness": K, "penalty_damping": 0.0},
        "time": {"steps_per_period": n, "periods": 1, **time},
        "output": {"window_periods": 1, "fields_per_period": 0},
        **CONTACTS[key],
    })  # fmt: skip


def rebound(case: Case) -> tuple[float, list[str]]:
    """Return the energy of the mass after the blow over that before, and the warnings of a run."""
    result = df.run(case)
    return float(result.history["energy_kinetic"][-1]) / (0.5 * M * V**2), result.summary[
        "warnings"
    ]


@pytest.mark.parametrize("key", CONTACTS)
@pytest.mark.parametrize("steps", [0.2, 1.0, 4.0, 9.5, 10.5, 40.0])
def test_a_blow_has_its_energy_or_a_warning(key: str, steps: float) -> None:
    energy, warnings = rebound(striking(key, steps))
    named = [text for text in warnings if text.startswith(key)]
    assert bool(named) is (steps < BLOW_STEPS)
    if not named:
        assert energy == pytest.approx(1.0, abs=(np.pi / steps) ** 2)
    is_told = any("changed the energy" in text for text in warnings)
    assert is_told is (abs(energy - 1.0) > 0.02 * max(energy, 1.0))


@pytest.mark.parametrize("key", CONTACTS)
@pytest.mark.parametrize("steps", [0.5, 30.0])
def test_a_run_says_how_many_steps_its_blows_have(key: str, steps: float) -> None:
    case = striking(key, steps, refine=2)
    fewest = 2.0 * steps  # HEAVY changes the mass by 1e-8
    assert blow_steps(case, assemble(case, needs_dolfinx=False)) == pytest.approx(fewest, rel=1e-6)
    assert df.run(case).summary["blow_steps"] == pytest.approx(fewest, rel=1e-6)


def test_no_springs_no_blows() -> None:
    case = df.preset("paper", {"contact.law": "newton", "mesh.elements": 3})
    assert np.isnan(blow_steps(case, assemble(case, needs_dolfinx=False)))


@pytest.mark.parametrize("key", CONTACTS)
def test_fine_steps_near_contact_count(key: str) -> None:
    case = striking(key, 1.0, refine=32)
    energy, warnings = rebound(case)
    assert warnings == []
    assert energy == pytest.approx(1.0, abs=(np.pi / 30.0) ** 2)


def test_it_is_told_before_the_run(caplog: pytest.LogCaptureFixture) -> None:
    case = striking("stop.1.stiffness", 1.0)
    (text,) = unresolved_blows(case, assemble(case, needs_dolfinx=False))
    assert f"{BLOW:.2g} s" in text
    with caplog.at_level(logging.WARNING):
        result = df.run(case)
    assert text in result.summary["warnings"]
    assert [record.message for record in caplog.records].count(text) == 1
    assert caplog.records[0].message == text


def test_hertz_counts_the_springs_of_a_ball_together() -> None:
    """A blow by Hertz lasts 2.943 δ/v, δ = (5 m v²/4k)^(2/5); its steepest chord 3/4 of that."""
    steel = {"name": "block", "length": 0.3, "width": 0.02, "thickness": 0.01,
             "material": "steel", "damping_ratio": 0.01}  # fmt: skip
    ball = {"lamina": "block", "mass": 0.0005, "radius": 0.005, "gap": 1e-4, "velocity": 1.0}

    def case(step: float) -> Case:
        return Case.model_validate({
            "name": "ball", "lamina": [steel], "mesh": {"elements": 2}, "impactor": [ball],
            "excitation": {"kind": "harmonic", "frequency": 100.0, "amplitude": 1e-12},
            "contact": {"law": "penalty"},
            "time": {"steps_per_period": int(0.01 / step), "periods": 1},
        })  # fmt: skip

    k = 4.0 / 3.0 * 210e9 / (1.0 - 0.3**2) * np.sqrt(0.005)
    duration = 2.943 * (1.25 * 0.0005 / k) ** 0.4
    few, enough = (
        unresolved_blows(case(duration / n), assemble(case(duration / n), needs_dolfinx=False))
        for n in (0.7 * BLOW_STEPS, 1.6 * BLOW_STEPS)
    )
    assert len(few) == 1 and few[0].startswith("impactor.1.radius")
    assert enough == []

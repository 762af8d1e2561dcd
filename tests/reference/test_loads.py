"""The reference's own weight, loads, axial forces and state of rest beside those of the package."""

from __future__ import annotations

from typing import Any

import pytest

import delam_fem as df
from delam_fem import compare

ROUND_OFF = 1e-9
"""Of matrices and of motions up to the first impacts."""
STRIP = {
    "length": 0.3, "width": 0.03, "young_modulus": 2.1e11, "density": 7850.0,
    "damping_ratio": 0.01,
}  # fmt: skip
MASSES = [
    {"lamina": "lower", "mass": 0.013, "position": 0.12},
    {"lamina": "upper", "mass": 0.007, "position": 0.3},
]
LOADS = [
    {"lamina": "upper", "position": 0.17, "force": -0.3},
    {"between": ["lower", "upper"], "start": 0.05, "end": 0.28, "per_length": 0.7},
    {"axial": 4.0},
    {"lamina": "lower", "axial": -1.5},
]
CASES: dict[str, dict[str, Any]] = {
    "level": {"gravity": {}, "load": LOADS, "point_mass": MASSES},
    "upright": {"gravity": {"inclination": 90.0}, "load": LOADS, "point_mass": MASSES},
    "slanted": {"gravity": {"inclination": -35.0, "roll": 200.0}, "point_mass": MASSES},
    "in place": {"gravity": {"gaps": "in place"}, "load": LOADS},
    "unloaded": {"gravity": {}, "time": {"begin": "unloaded"}},
}


def case_of(time: dict[str, Any] | None = None, **tables: Any) -> df.Case:
    """Return a case of two strips that weight presses together, with further tables."""
    thickness = {"lower": 0.0017, "upper": 0.001}
    data: dict[str, Any] = {
        "name": "two",
        "lamina": [STRIP | {"name": name, "thickness": h} for name, h in thickness.items()],
        "gap": {"tip": 5e-4, "exponent": 2.0},
        "mesh": {"elements": 10},
        "excitation": {"kind": "harmonic", "frequency": 9.0, "amplitude": 1e-4},
        "contact": {"law": "newton-penalty", "penalty_stiffness": 500.0, "impulse": "lumped"},
        "time": {"periods": 2, "steps_per_period": 400} | (time or {}),
    }
    if "support" in tables:
        del data["gap"]
    return df.Case(**(data | tables))


@pytest.mark.parametrize("name", CASES)
def test_the_reference_has_the_same_loads_and_motions(name: str) -> None:
    comparison = compare(case_of(**CASES[name]), periods=2)
    assert max(comparison.matrices.values()) < ROUND_OFF
    assert comparison.frequencies < 1e-9
    assert not comparison.refusal
    assert comparison.motion is not None
    assert comparison.motion.until_impact < ROUND_OFF


def test_a_bonded_stack_under_tension_has_the_same_frequencies() -> None:
    tables = {
        "support": {"start": "clamped", "end": "clamped"},
        "delamination": [{"between": ["lower", "upper"], "start": 0.09, "end": 0.21}],
        "load": [{"axial": 300.0}, {"between": ["lower", "upper"], "per_length": 20.0}],
    }
    comparison = compare(case_of(**tables), periods=1)
    assert max(comparison.matrices.values()) < ROUND_OFF
    assert comparison.frequencies < 1e-9


def test_weight_along_a_bonded_stack_is_refused() -> None:
    tables = {
        "support": {"start": "clamped", "end": "clamped"},
        "delamination": [{"between": ["lower", "upper"], "start": 0.09, "end": 0.21}],
        "gravity": {"inclination": 90.0},
    }
    with pytest.raises(df.CaseError, match=r"gravity\.inclination: the reference"):
        compare(case_of(**tables))

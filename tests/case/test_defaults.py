"""The numbers of keys that a case file leaves out, and of materials: results depend on them."""

from typing import Any

import pytest

from delam_fem.api import Contact
from delam_fem.case.materials import MATERIALS
from delam_fem.case.sections import Damping, Output, Section, Support, TimeStepping

DEFAULTS: dict[type[Section], dict[str, Any]] = {
    TimeStepping: {
        "scheme": "newmark", "mass": "consistent", "steps_per_period": 1000, "refine": 1,
        "refine_velocity": 0.0, "periods": 300, "most_periods": 3000,
    },
    Contact: {
        "impulse": "consistent", "restitution": 0.1, "penalty_stiffness": 100.0,
        "penalty_damping": 0.0, "threshold_velocity": 5e-4, "points_per_element": 1,
    },
    Damping: {"rayleigh": "two-mode"},
    Output: {"window_periods": 10, "fields_per_period": 50},
    Support: {"start": "clamped", "end": "free"},
}  # fmt: skip


@pytest.mark.parametrize("section", DEFAULTS, ids=lambda section: section.__name__)
def test_defaults(section: type[Section]) -> None:
    fields = section.model_fields
    assert {key: fields[key].default for key in DEFAULTS[section]} == DEFAULTS[section]


def test_materials() -> None:
    """E [GPa] and density [kg/m³] as tabulated."""
    assert {name: (m["young_modulus"] / 1e9, m["density"]) for name, m in MATERIALS.items()} == {
        "aluminium": (70.0, 2700.0),
        "steel": (210.0, 7850.0),
        "titanium": (113.8, 4430.0),
        "carbon-epoxy": (181.0, 1600.0),
        "glass-epoxy": (38.6, 1800.0),
    }

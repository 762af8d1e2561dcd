"""A strip of steel that lies on one of aluminium: at rest, shaken, settled; both engines alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem import compare

G, L, B = 9.80665, 0.3, 0.03
ALUMINIUM = {"name": "lower", "thickness": 2e-3, "material": "aluminium"}
STEEL = {"name": "upper", "thickness": 1e-3, "material": "steel"}
SAGS = tuple(12.0 * rho * G * L**4 / (8.0 * E * h**2)
             for rho, E, h in ((2700.0, 7e10, 2e-3), (7850.0, 2.1e11, 1e-3)))  # fmt: skip
"""q L⁴/8EI of both [m]."""
RIGIDITIES = (7e10 * B * 2e-3**3 / 12.0, 2.1e11 * B * 1e-3**3 / 12.0)
"""EI of both [N m2]."""
ENGINES = 1e-10
"""Difference of two engines relative to the motion."""


def strips(amplitude: float, **tables: Any) -> df.Case:
    """Return both strips, 1 mm apart at the tip without weight, shaken by an amplitude [m]."""
    section = {"length": L, "width": B, "damping_ratio": 0.02}
    data: dict[str, Any] = {
        "name": "level",
        "lamina": [ALUMINIUM | section, STEEL | section],
        "gap": {"tip": 1e-3, "exponent": 2.0},
        "gravity": {},
        "mesh": {"elements": 8},
        "excitation": {"kind": "harmonic", "frequency": 14.0, "amplitude": amplitude},
        "contact": {"law": "penalty", "penalty_stiffness": 2000.0},
        "time": {"periods": 60, "steps_per_period": 1000},
        "output": {"window_periods": 2, "fields_per_period": 0},
    }
    return df.Case(**(data | tables))


def test_the_upper_strip_lies_on_the_lower_one() -> None:
    """Tips are those of cantilevers under their weights and the forces between them."""
    assert SAGS == pytest.approx((1.15e-3, 4.45e-3), rel=5e-3)
    equilibrium = df.rest(strips(1e-5))
    force = equilibrium.contact_force.values
    x = L * np.arange(1, 9) / 8.0
    assert force.any() and (force >= 0.0).all()
    for i, sign in ((0, -1.0), (1, 1.0)):
        bent = float((force * x**2 * (3.0 * L - x)).sum()) / (6.0 * RIGIDITIES[i])
        tip = equilibrium.displacement.values[i, -1]
        assert tip == pytest.approx(sign * bent - SAGS[i], rel=1e-8)


def alike(case: df.Case) -> df.Result:
    """Compare both engines, and return the result of one."""
    petsc, compiled = (df.run(case, engine) for engine in ("petsc", "compiled"))
    for name in ("tip_displacement", "tip_velocity", "energy_strain", "energy_kinetic"):
        first, second = petsc.history[name].values, compiled.history[name].values
        assert np.abs(first - second).max() < ENGINES * np.abs(first).max(), name
    for result in (petsc, compiled):
        assert abs(result.summary["energy_residual"]) < 1e-10
    assert petsc.summary["settled"] == compiled.summary["settled"]
    return compiled


def test_engines_shake_both_alike_until_they_settle() -> None:
    summary = alike(strips(2e-6)).summary
    assert summary["settled"] == "settled"
    assert summary["periodicity"] == 1
    for i, at_rest in enumerate(summary["rest"]["tip_displacement"]):
        assert summary["tip_min"][i] < at_rest < summary["tip_max"][i]
        assert summary["tip_max"][i] - summary["tip_min"][i] < 1e-4


def test_engines_let_both_clap_alike() -> None:
    """Round-off grows from impact to impact: a few periods."""
    result = alike(strips(3e-4).with_overrides({"time.periods": 3, "output.window_periods": 3}))
    gap = 1e-3 + np.diff(result.history.tip_displacement.values, axis=0)
    assert gap.max() > 2e-4


def test_they_are_those_of_the_independent_reference() -> None:
    case = strips(2e-4, contact={
        "law": "newton-penalty", "penalty_stiffness": 2000.0, "impulse": "lumped"
    })  # fmt: skip
    comparison = compare(case, periods=2)
    assert max(comparison.matrices.values()) < 1e-9
    assert comparison.motion is not None
    assert comparison.motion.until_impact < 1e-9

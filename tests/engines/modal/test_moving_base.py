"""A beam above a stop on a moving base: what is read counts from the fixed frame."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import delam_fem as df

GAP = 1e-3
"""Distance of the stop below the tip [m]."""


def beam(**keys: Any) -> df.Case:
    """Return a steel cantilever with a stop on the base below its tip, shaken at 5.3 Hz."""
    data: dict[str, Any] = {
        "name": "beam",
        "lamina": [
            {
                "name": "bar", "length": 0.5, "width": 0.02, "thickness": 0.002,
                "material": "steel", "damping_ratio": 0.01,
            }
        ],
        "support": {"start": "clamped", "end": "free"},
        "stop": [{"lamina": "bar", "position": 0.5, "side": "below", "gap": GAP}],
        "excitation": {"kind": "harmonic", "frequency": 5.3, "amplitude": 2e-3},
        "mesh": {"elements": 10},
        "contact": {"law": "newton", "restitution": 0.0},
        "time": {"scheme": "moreau-jean", "periods": 8, "refine": 8, "mass": "massless"},
        "output": {"window_periods": 8, "fields_per_period": 20},
    }  # fmt: skip
    case = df.Case.model_validate(data)
    return case.with_overrides({k.replace("__", "."): v for k, v in keys.items()})


def test_the_tip_stays_on_its_side_of_the_stop() -> None:
    history = df.run(beam()).history
    tip, base = (history[name].values.ravel() for name in ("tip_displacement", "base_displacement"))
    assert (tip - base).min() == pytest.approx(-GAP, rel=1e-6)  # a rigid stop, which it touches
    assert tip.min() == pytest.approx(-GAP - 2e-3, rel=1e-2)  # it lies on the stop as that turns


def test_strobes_envelopes_and_fields_are_those_of_the_tip() -> None:
    history = df.run(beam()).history
    tip = history["tip_displacement"].values[0]
    steps = np.arange(1, 9) * 1000 - 1
    np.testing.assert_allclose(history["strobe_displacement"].values[0], tip[steps], rtol=1e-12)
    lowest = tip.reshape(8, 1000).min(axis=1)
    assert (history["envelope_min"].values[0] <= lowest + 1e-12).all()
    frames = np.searchsorted(history["time"], history["frame"] * (1.0 - 1e-12))
    field = history["displacement"].values[0]
    np.testing.assert_allclose(field[:, -1], tip[frames], atol=1e-12)
    base = history["base_displacement"].values.ravel()
    np.testing.assert_allclose(field[:, 0], base[frames], atol=1e-12)


@pytest.mark.parametrize("rayleigh", ["mass", "two-mode", "stiffness"])
def test_damping_and_base_take_and_give_what_they_do_with_all_masses(rayleigh: str) -> None:
    keys = {"damping__rayleigh": rayleigh, "contact__law": "none", "time__periods": 20}
    massless = df.run(beam(**keys)).history
    consistent = df.run(beam(**keys, time__mass="consistent"), "compiled").history
    for name in ("energy_damping_loss", "energy_base_work"):
        ours, theirs = (float(history[name].sum()) for history in (massless, consistent))
        assert ours == pytest.approx(theirs, rel=0.02), name

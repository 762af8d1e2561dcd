"""Runs of plates: the full mesh beside its reduced model, and a plate without a patch."""

import numpy as np
import pytest
from plates import LENGTH, RHO, E, plate

import delam_fem as df
from delam_fem.api import Case

PATCH = {"between": ["lower", "upper"], "start": 0.06, "end": 0.12, "across": [-0.03, 0.01]}
FORCE = {
    "kind": "force", "lamina": "lower", "position": [0.03, 0.05], "amplitude": 1.0,
    "frequency": 900.0,
}  # fmt: skip
LAYERS = {"lower": 0.0014, "upper": 0.0006}
REDUCED = 2e-3
"""Largest difference of the reduced motion, in parts of the largest deflection: thirty modes."""
SILENT = 1e-6
"""Harmonic distortion of -120 dB."""


def case_of(
    *patches: dict[str, object], periods: int, damping_ratio: float = 0.01, **sections: object
) -> Case:
    """Return a plate under a force beside its middle line."""
    laminae = [
        {
            "name": name, "length": LENGTH, "width": 0.15, "thickness": thickness, "density": RHO,
            "young_modulus": E, "damping_ratio": damping_ratio,
        }
        for name, thickness in LAYERS.items()
    ]  # fmt: skip
    return plate(
        {"start": "clamped", "end": "clamped"}, 8, 6, width=0.15, lamina=laminae,
        delamination=list(patches), excitation=FORCE,
        time={"steps_per_period": 200, "periods": periods},
        output={"window_periods": 2, "fields_per_period": 0},
        **({"contact": {"law": "newton", "restitution": 0.0}} | sections),
    )  # fmt: skip


@pytest.mark.slow
def test_a_reduced_plate_claps_as_the_full_one() -> None:
    case = case_of(PATCH, periods=2)
    full = df.run(case, engine="petsc")
    reduction = df.reduced_case(case, 30)
    reduced = df.run(case, structure=reduction.structure, engine="petsc")
    assert full.summary["impacts_per_period"] > 0.0
    wanted = full.history.tip_displacement.to_numpy()
    computed = reduced.history.tip_displacement.to_numpy()
    np.testing.assert_allclose(computed, wanted, atol=REDUCED * np.abs(wanted).max())


def test_a_plate_without_a_patch_has_no_harmonics() -> None:
    case = case_of(periods=100, damping_ratio=0.1)
    reduction = df.reduced_case(case, 12)
    result = df.run(case, structure=reduction.structure, engine="petsc")
    assert max(result.summary["thd"]) < SILENT


def test_a_patch_that_is_pressed_shut_has_no_harmonics() -> None:
    """Twenty newtons hold it closed under a force of one; without them it claps."""
    press = [{"between": ["lower", "upper"], "position": 0.09, "force": 20.0}]
    sections = {"load": press, "contact": {"law": "newton@moreau-jean", "restitution": 0.0}}
    case = case_of(PATCH, periods=60, damping_ratio=0.2, **sections)
    reduction = df.reduced_case(case, 12)
    result = df.run(case, structure=reduction.structure, engine="petsc")
    assert max(result.summary["thd"]) < SILENT

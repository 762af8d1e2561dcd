"""Sweeps over the numbers of schemes, on both engines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import delam_fem as df
from delam_fem import load_sweep
from delam_fem.api import Case

PERIODS, STEPS = 3, 40
OMEGA, FREQUENCY = 100.0, 10.0
THETAS = (0.5, 0.55, 0.7, 1.0)
TEXT = """
name = "theta"
base = "case.toml"
engine = "{engine}"
operators = "closed-form"
[record]
energies = true
strobes = 0
[[axis]]
key = "time.theta"
values = {values}
"""


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_energy_over_theta_is_that_of_the_scheme(engine: str, tmp_path: Path) -> None:
    """A step of θ multiplies the energy of an oscillator by (1 + (1-θ)² h²)/(1 + θ² h²), h = ω Δt.

    Free vibrations of a point of mass m on a spring of m ω², without damping and almost without a
    drive.
    """
    mass = 2.0
    case = Case.model_validate({
        "name": "point", "mesh": {"elements": 1},
        "lamina": [{"name": "ball", "mass": mass, "stiffness": mass * OMEGA**2,
                    "damping_ratio": 0.0}],
        "initial": [{"lamina": "ball", "velocity": 1.0}],
        "excitation": {"kind": "harmonic", "frequency": FREQUENCY, "amplitude": 1e-15},
        "contact": {"law": "none"},
        "time": {"scheme": "moreau-jean", "steps_per_period": STEPS, "periods": PERIODS},
        "output": {"window_periods": 1, "fields_per_period": 0},
    })  # fmt: skip
    (tmp_path / "case.toml").write_text(case.to_toml())
    path = tmp_path / "s.toml"
    path.write_text(TEXT.format(engine=engine, values=list(THETAS)))
    data = df.run_sweep(load_sweep(path), tmp_path / "out", workers=1)
    energies = (data["energy_kinetic"] + data["energy_strain"]).to_numpy()
    theta = np.array(THETAS)
    h = OMEGA / (FREQUENCY * STEPS)
    factor = (1.0 + ((1.0 - theta) * h) ** 2) / (1.0 + (theta * h) ** 2)
    expected = 0.5 * mass * factor ** (PERIODS * STEPS)
    assert data["theta"].to_numpy() == pytest.approx(theta)
    assert energies == pytest.approx(expected, rel=1e-9)
    data.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "values"), [("time.theta", (0.5, 0.8)), ("time.gamma", (0.5, 0.6))]
)
def test_points_with_contact_are_those_of_runs(
    key: str, values: tuple[float, float], tmp_path: Path
) -> None:
    scheme = "moreau-jean" if key == "time.theta" else "newmark"
    keys = {
        "mesh.elements": 4, "time.periods": 6, "time.steps_per_period": 200, "time.beta": 0.35,
        "time.scheme": scheme, "contact.law": "newton", "output.fields_per_period": 0,
        "output.window_periods": 2,
    }  # fmt: skip
    base = df.preset("paper", keys)
    (tmp_path / "case.toml").write_text(base.to_toml())
    amplitudes = {}
    for engine in ("petsc", "compiled"):
        path = tmp_path / f"{engine}.toml"
        text = TEXT.format(engine=engine, values=list(values)).replace("time.theta", key)
        path.write_text(text)
        with df.run_sweep(load_sweep(path), tmp_path / engine, workers=1) as data:
            amplitudes[engine] = data["tip_amplitude"].to_numpy()
    assert amplitudes["petsc"] == pytest.approx(amplitudes["compiled"], rel=1e-9)
    for row, value in zip(amplitudes["compiled"], values, strict=True):
        run = df.run(base.with_overrides({key: value}), "compiled")
        assert row == pytest.approx(run.summary["tip_amplitude"], rel=1e-12)

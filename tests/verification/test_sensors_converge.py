"""Every quantity of a sensor converges with the steps, to the exact motion of its operators."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import delam_fem as df
from delam_fem.api import Case, FloatArray, assemble

AT: dict[str, Any] = {"lamina": "thin", "position": 0.685}
ROOT: dict[str, Any] = {"lamina": "thin", "position": 0.1}
QUANTITIES = {"displacement": AT, "velocity": AT, "strain": ROOT, "acceleration": AT}
AFTER = np.arange(20, 1000, 20)
"""Instants that are compared, in thousandths of a period: not the jolt, and not the last step."""
SECOND_ORDER = (3.2, 4.8)
"""Ratio of the errors at two step lengths, one half of the other."""


def jolted(scheme: str, rayleigh: str, n_steps: int) -> Case:
    """Return laminae that pass through one another, one of which is jolted off its clamp."""
    return df.preset("paper", {
        "contact.law": "none", "time.scheme": scheme, "time.steps_per_period": n_steps,
        "time.periods": 1, "output.window_periods": 1, "output.fields_per_period": 0,
        "mesh.elements": 4, "damping.rayleigh": rayleigh, "excitation.amplitude": 1e-15,
        "initial": [{"lamina": "thin", "shape": "uniform", "velocity": 0.5}],
        "sensor": [{"name": name, "quantity": name, **at} for name, at in QUANTITIES.items()],
    })  # fmt: skip


def exact(case: Case) -> dict[str, FloatArray]:
    """Return the exact signals at each step, by the exponential of the equation of motion."""
    operators = assemble(case, needs_dolfinx=False).operators
    M, C, K = (
        matrix.toarray() for matrix in (operators.mass, operators.damping, operators.stiffness)
    )
    n = operators.n_dofs
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, np.hstack([K, C]))]])
    step, states = expm(A * case.time_step), [operators.start.ravel()]
    for _ in range(case.steps_per_period):
        states.append(step @ states[-1])
    x = np.array(states[1:])
    rates = x @ A.T
    rows = operators.sensors.toarray()
    u, v, a = x[:, :n], x[:, n:], rates[:, n:]
    motions = {"displacement": u, "velocity": v, "strain": u, "acceleration": a}
    return {name: motion @ rows[k] for k, (name, motion) in enumerate(motions.items())}


@cache
def errors(scheme: str, rayleigh: str, engine: Any, n_steps: int) -> dict[str, float]:
    """Return the error of each signal over its size, root mean squares at the same instants."""
    case = jolted(scheme, rayleigh, n_steps)
    history, right = df.run(case, engine).history, exact(case)
    at = AFTER * (n_steps // 1000) - 1
    sizes = {name: np.linalg.norm(values[at]) for name, values in right.items()}
    return {
        name: float(np.linalg.norm((history[f"sensor_{name}"].values - right[name])[at]) / size)
        for name, size in sizes.items()
    }


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize("scheme", ["newmark", "moreau-jean", "central-difference"])
def test_signals_converge_with_the_second_order(scheme: str, engine: str, quantity: str) -> None:
    coarse, fine = (errors(scheme, "two-mode", engine, n)[quantity] for n in (2000, 4000))
    assert fine < 0.02
    assert SECOND_ORDER[0] < coarse / fine < SECOND_ORDER[1]


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("scheme", ["newmark", "moreau-jean"])
def test_overdamped_modes_do_not_ring(scheme: str, quantity: str) -> None:
    """A step of average acceleration multiplies modes that creep by nearly -1."""
    assert errors(scheme, "stiffness", "compiled", 1000)[quantity] < 0.02


MASS, STIFFNESS, SPEED, GAP = 0.007, 1e7, 1.0, 1e-3


def force_errors(scheme: str, engine: Any, n_steps: int) -> float:
    """Return the largest error of the force of a free mass that strikes an elastic stop, over its
    peak: F = v √(k m) sin(ω (t - g/v)) while it is positive, ω = √(k/m)."""
    case = Case.model_validate({
        "name": "blow",
        "lamina": [{"name": "mass", "mass": MASS, "stiffness": 0.0, "damping_ratio": 0.0}],
        "mesh": {"elements": 1}, "initial": [{"velocity": -SPEED}],
        "stop": [{"lamina": "mass", "side": "below", "gap": GAP, "stiffness": STIFFNESS}],
        "contact": {"law": "penalty"},
        "excitation": {"kind": "harmonic", "frequency": 500.0, "amplitude": 1e-15},
        "time": {"scheme": scheme, "steps_per_period": n_steps, "periods": 1},
        "output": {"window_periods": 1},
        "sensor": [{"name": "force", "quantity": "contact force", "stop": 1}],
    })  # fmt: skip
    history, rate = df.run(case, engine).history, np.sqrt(STIFFNESS / MASS)
    phase = rate * (history["time"].values - GAP / SPEED)
    wanted = np.where((phase > 0.0) & (phase < np.pi), np.sin(phase), 0.0)
    peak = SPEED * np.sqrt(STIFFNESS * MASS)
    return float(np.abs(history["sensor_force"].values / peak - wanted).max())


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize("scheme", ["newmark", "central-difference"])
def test_contact_forces_converge(scheme: str, engine: str) -> None:
    """The spring acts from the first step at whose end the gap is closed: the first order."""
    coarse, fine = (force_errors(scheme, engine, n) for n in (2000, 8000))
    assert fine < 0.02
    assert coarse / fine > 3.0

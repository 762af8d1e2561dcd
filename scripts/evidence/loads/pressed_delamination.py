"""A bonded beam with a closed delamination under pressure: linear below a threshold."""

from __future__ import annotations

from typing import Any

import numpy as np

from delam_fem.api import (
    Case,
    EngineName,
    FloatArray,
    assemble,
    lowest,
    opening_amplitude,
    run,
    springs_of,
)

PRESSURE = 50.0
"""Force per length that presses the delamination shut [N/m]."""


def beam(pressure: float = PRESSURE, **tables: Any) -> Case:
    """Return a clamped steel beam with a closed delamination under a force per length [N/m]."""
    lamina = {"length": 0.3, "width": 0.03, "density": 7850.0, "young_modulus": 2.1e11,
              "damping_ratio": 0.01}  # fmt: skip
    data: dict[str, Any] = {
        "name": "bonded",
        "lamina": [
            {"name": "lower", "thickness": 0.002} | lamina,
            {"name": "upper", "thickness": 0.001} | lamina,
        ],
        "support": {"start": "clamped", "end": "clamped"},
        "delamination": [{"between": ["lower", "upper"], "start": 0.1, "end": 0.2}],
        "mesh": {"elements": 15},
        "load": [{"between": ["lower", "upper"], "per_length": pressure}],
        "excitation": {"kind": "harmonic", "frequency": 100.0, "amplitude": 1e-4},
        "contact": {"law": "penalty", "penalty_stiffness": 1e5},
        "time": {"periods": 400, "steps_per_period": 400},
        "output": {"window_periods": 4, "fields_per_period": 0},
    }
    return Case(**(data | tables))


def resonance(case: Case) -> float:
    """Return the first frequency about the state of rest, with the springs of what is shut [Hz]."""
    operators = assemble(case, needs_dolfinx=False).operators
    springs = springs_of(operators, case)
    H, force = operators.gap_matrix, operators.equilibrium
    assert springs is not None and force is not None
    shut = np.where(force.force > 0.0, springs, 0.0)
    K = (operators.stiffness + H.T.multiply(shut) @ H).tocsr()
    return float(lowest(K, operators.mass, 1)[0][0])


def threshold(case: Case, frequency: float) -> float:
    """Return the amplitude of the base at which the first pair opens at a frequency [m]."""
    operators = assemble(case, needs_dolfinx=False).operators
    amplitude = opening_amplitude(operators, frequency, springs_of(operators, case))
    assert amplitude is not None
    return amplitude


def harmonics_of(
    case: Case, frequency: float, amplitude: float, engine: EngineName = "compiled"
) -> FloatArray:
    """Return harmonics 2, 3 and 4 of the upper lamina relative to the first [dB], shape (3,)."""
    keys = {"excitation.frequency": frequency, "excitation.amplitude": amplitude}
    tip = run(case.with_overrides(keys), engine).history.tip_displacement.values[1]
    window = case.output.window_periods
    levels = np.abs(np.fft.rfft(tip))[window * np.arange(1, 5)]
    return np.asarray(20.0 * np.log10(levels[1:] / levels[0]))

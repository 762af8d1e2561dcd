"""Signals of bars, beams and solids converge with the steps, to the motion of their operators.

A body begins in its first mode and strikes an elastic stop at its tip. Between two instants at
which the stop closes or opens the equation of motion is linear, and its solution the exponential
of a matrix. Here it is taken in steps of T/64000, each with the pairs that are closed at its
begin.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import delam_fem as df
from delam_fem.api import Case, FloatArray, assemble

LENGTH, STIFFNESS = 0.2, 1e6
FREQUENCIES = {"beam": 200.0, "plane-stress": 200.0, "solid": 200.0, "bar": 6000.0}
"""One period has about one of the first mode [Hz]."""
GAPS = {"beam": 1e-6, "plane-stress": 1e-6, "solid": 1e-6, "bar": 1e-8}
STEPS = (1000, 2000, 4000)
FINE = 64000
AFTER = np.arange(20, 1000, 20)
"""Instants that are compared, in thousandths of a period."""
SECOND_ORDER = (3.2, 4.8)
"""Ratio of the errors at two step lengths, one half of the other, without contact."""
CLOSING = 6.0
"""The same with a stop for T/1000 and T/4000, at least. Its spring acts from the first step at
whose end the gap is closed, which alone has the first order; the force of a gap that just closed
is small. Measured: 11 to 38."""
CLOSE = 1e-3
"""Relative errors at T/4000, at most. Measured: 3e-4."""
ENGINES = ("petsc", "compiled")
SCHEMES = ("newmark", "moreau-jean", "central-difference")
EXPLICIT = ("beam", "bar")
"""Bodies for which T/1000 is below the stability limit of the central difference."""


def body(kind: str, scheme: str, n_steps: int, *, is_stopped: bool) -> Case:
    """Return a body that begins in its first mode."""
    lamina: dict[str, Any] = {
        "name": "one", "length": LENGTH, "width": 0.02, "thickness": 0.01, "density": 2700.0,
        "young_modulus": 70e9, "damping_ratio": 0.01,
    }  # fmt: skip
    if kind == "bar":
        lamina["motion"] = "axial"
    places = {"displacement": LENGTH, "velocity": LENGTH, "acceleration": LENGTH}
    places |= {} if kind == "bar" else {"strain": 0.06}
    sensors: list[dict[str, Any]] = [
        {"name": name, "quantity": name, "lamina": "one", "position": x}
        for name, x in places.items()
    ]
    stops = []
    if is_stopped:
        stops = [{"lamina": "one", "side": "above", "gap": GAPS[kind], "stiffness": STIFFNESS}]
        sensors.append({"name": "force", "quantity": "contact force", "stop": 1})
    return Case.model_validate({
        "name": "body", "lamina": [lamina], "mesh": {"elements": 3},
        "damping": {"rayleigh": "stiffness"},
        "contact": {"law": "penalty" if is_stopped else "none"},
        "excitation": {"kind": "harmonic", "frequency": FREQUENCIES[kind], "amplitude": 1e-15},
        "time": {"scheme": scheme, "steps_per_period": n_steps, "periods": 1},
        "initial": [{"lamina": "one", "mode": 1, "velocity": 0.1}],
        "output": {"window_periods": 1, "fields_per_period": 0},
        "sensor": sensors, "stop": stops,
        **({} if kind in ("bar", "beam") else {"model": {"kind": kind}}),
    })  # fmt: skip


@cache
def exact(kind: str, *, is_stopped: bool) -> dict[str, FloatArray]:
    """Return the signals at the compared instants by exponentials of the equation of motion."""
    n_steps = FINE if is_stopped else 1000
    case = body(kind, "newmark", n_steps, is_stopped=is_stopped)
    o = assemble(case, needs_dolfinx=False).operators
    M, C, K = (matrix.toarray() for matrix in (o.mass, o.damping, o.stiffness))
    H = o.gap_matrix.toarray()
    n = o.n_dofs
    weights = np.ones(len(H)) if o.pair_weights is None else o.pair_weights
    stiffness = STIFFNESS * weights / weights.sum() if len(H) else weights

    @cache
    def rates(closed: tuple[bool, ...]) -> FloatArray:
        """Return A of z' = A z with z = (u, v, 1) where some springs act."""
        k = stiffness * np.array(closed, dtype=float)
        force = np.hstack([-K - H.T @ (k[:, None] * H), -C, -(H.T @ (k * o.gap0))[:, None]])
        still = np.zeros((n, 2 * n + 1))
        still[:, n : 2 * n] = np.eye(n)
        return np.vstack([still, np.linalg.solve(M, force), np.zeros(2 * n + 1)])

    @cache
    def step(closed: tuple[bool, ...]) -> FloatArray:
        return np.asarray(expm(rates(closed) * case.time_step))

    z = np.append(o.start.ravel(), 1.0)
    rows = []
    for number in range(n_steps):
        closed = tuple((H @ z[:n] + o.gap0 < 0.0).tolist())
        z = step(closed) @ z
        if (number + 1) * 1000 % n_steps == 0 and (number + 1) * 1000 // n_steps in AFTER:
            closed = tuple((H @ z[:n] + o.gap0 < 0.0).tolist())
            depth = np.where(closed, -(H @ z[:n] + o.gap0), 0.0)
            rows.append((z[:n], z[n : 2 * n], (rates(closed) @ z)[n : 2 * n], stiffness @ depth))
    u, v, a, force = (np.array(column) for column in zip(*rows, strict=True))
    motions = {"displacement": u, "velocity": v, "acceleration": a, "strain": u}
    names = [sensor.name for sensor in case.sensor]
    signals = {
        name: motion @ o.sensors.toarray()[names.index(name)]
        for name, motion in motions.items()
        if name in names
    }
    return signals | ({"force": force} if is_stopped else {})


@cache
def errors(
    kind: str, scheme: str, engine: Any, n_steps: int, *, is_stopped: bool
) -> dict[str, float]:
    """Return the error of each signal over its size, root mean squares over the instants."""
    result = df.run(body(kind, scheme, n_steps, is_stopped=is_stopped), engine)
    assert result.summary["outcome"] == "completed"
    at = AFTER * (n_steps // 1000) - 1
    return {
        name: float(
            np.linalg.norm(result.history[f"sensor_{name}"].values[at] - values)
            / np.linalg.norm(values)
        )
        for name, values in exact(kind, is_stopped=is_stopped).items()
    }


CELLS = [
    (kind, scheme, engine)
    for kind in GAPS
    for scheme in SCHEMES
    for engine in ENGINES
    if scheme != "central-difference" or kind in EXPLICIT
]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "scheme", "engine"), CELLS)
def test_signals_converge_without_contact(kind: str, scheme: str, engine: str) -> None:
    coarse, middle, fine = (errors(kind, scheme, engine, n, is_stopped=False) for n in STEPS)
    for name in fine:
        assert fine[name] < CLOSE
        assert SECOND_ORDER[0] < coarse[name] / middle[name] < SECOND_ORDER[1], name
        assert SECOND_ORDER[0] < middle[name] / fine[name] < SECOND_ORDER[1], name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "scheme", "engine"), [cell for cell in CELLS if cell[1] != "moreau-jean"]
)
def test_signals_and_forces_converge_with_a_stop(kind: str, scheme: str, engine: str) -> None:
    coarse, middle, fine = (errors(kind, scheme, engine, n, is_stopped=True) for n in STEPS)
    assert "force" in fine
    for name in fine:
        assert fine[name] < CLOSE
        assert coarse[name] > middle[name] > fine[name], name
        assert coarse[name] / fine[name] > CLOSING, name

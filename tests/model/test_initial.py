"""Points in place of beams, and initial states, beside exact solutions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from delam_fem import CaseError, Result, run
from delam_fem.case.definition import Case
from delam_fem.engines.session import ENGINES, EngineName

M, K, D = 2.0, 800.0, 0.05
"""Angular frequency 20 rad/s."""
POINT = {"name": "one", "mass": M, "stiffness": K, "damping_ratio": D}
EI, L = 10.0, 0.5
BEAM = {
    "name": "one", "length": L, "width": 0.02, "thickness": 0.002, "mass_per_length": 0.1,
    "bending_stiffness": EI, "damping_ratio": 0.0,
}  # fmt: skip


def case_of(lamina: dict[str, Any], *initial: dict[str, Any], **sections: Any) -> Case:
    given = {
        "name": "start", "lamina": [lamina], "mesh": {"elements": 1 if "mass" in lamina else 8},
        "excitation": {"kind": "harmonic", "amplitude": 0.0, "frequency": 5.0},
        "contact": {"law": "none"}, "initial": initial,
        "time": {"steps_per_period": 2000, "periods": 3}, "output": {"window_periods": 3},
    }  # fmt: skip
    return Case(**(given | sections))


def motion(result: Result) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    history = result.history
    return tuple(history[n].to_numpy() for n in ("time", "tip_displacement", "tip_velocity"))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_point_swings_as_it_must(engine: EngineName) -> None:
    case = case_of(POINT, {"displacement": 2e-3}, {"velocity": -0.03})
    t, (u,), _ = motion(run(case, engine=engine))
    omega = np.sqrt(K / M)
    own = omega * np.sqrt(1.0 - D**2)
    b = (-0.03 + D * omega * 2e-3) / own
    exact = np.exp(-D * omega * t) * (2e-3 * np.cos(own * t) + b * np.sin(own * t))
    np.testing.assert_allclose(u, exact, atol=1e-8)


def test_a_base_moves_a_point_by_spring_and_damper() -> None:
    """Absolute transmissibility sqrt((1 + (2 D r)²) / ((1 - r²)² + (2 D r)²))."""
    shaker = {"kind": "harmonic", "amplitude": 1e-3, "frequency": 5.0}
    case = case_of(POINT, excitation=shaker).with_overrides({"time.periods": 60})
    _, (u,), _ = motion(run(case, engine="compiled"))
    r = 2.0 * np.pi * 5.0 / np.sqrt(K / M)
    exact = 1e-3 * np.hypot(1.0, 2 * D * r) / np.hypot(1.0 - r**2, 2.0 * D * r)
    assert np.abs(u).max() == pytest.approx(exact, rel=1e-3)


def test_a_beam_begins_in_a_mode_or_bent_by_a_force() -> None:
    case = case_of(BEAM, {"shape": "mode", "mode": 2, "displacement": -1e-3})
    t, (u,), _ = motion(run(case, engine="compiled"))
    omega = float(case.lamina[0].angular_frequencies(2)[1])
    np.testing.assert_allclose(u[:400], -1e-3 * np.cos(omega * t[:400]), atol=3e-5)  # of the steps
    bent = {"lamina": "one", "shape": "force", "position": 0.6 * L, "displacement": 1e-3}
    fast = case_of(BEAM, bent).with_overrides({"time.steps_per_period": 100000, "time.periods": 1})
    start = run(
        fast.with_overrides({"output.fields_per_period": 100000}), engine="compiled"
    ).history
    x, u0 = start["x"].to_numpy(), start["displacement"][0, 0].to_numpy()
    a = 0.6 * L
    exact = np.where(x < a, x**2 * (3.0 * a - x), a**2 * (3.0 * x - a))
    np.testing.assert_allclose(u0, 1e-3 * exact / exact[-1], atol=1e-6)


@pytest.mark.parametrize("kind", ["base", "ground"])
def test_a_start_counts_in_the_fixed_frame_beside_any_stop(kind: str) -> None:
    """A stop on the base changes the dofs, not the state that they begin with."""
    shaker = {"kind": "harmonic", "amplitude": 1e-3, "frequency": 5.0}
    stop = {"lamina": "one", "side": "above", "gap": 1.0, "on": kind}
    case = case_of(POINT, {"velocity": 0.1}, excitation=shaker, stop=[stop])
    _, (u,), (v,) = motion(run(case, engine="compiled"))
    assert v[0] == pytest.approx(0.1, rel=1e-2)
    assert abs(u[0]) < 1e-4


@pytest.mark.parametrize(
    ("lamina", "initial", "sections", "expected"),
    [
        (POINT, [{"lamina": "two"}], {}, r"initial\.1\.lamina: expected one of one, given 'two'"),
        (POINT, [{"shape": "force", "lamina": "one"}], {}, r"position: missing"),
        (POINT, [{"mode": 2}], {}, r"mode: expected none"),
        (POINT, [], {"mesh": {"elements": 2}}, r"expected of points mesh\.elements = 1"),
        ({"name": "one", "mass": 1.0, "damping_ratio": 0.0}, [], {}, r"stiffness: missing"),
        (POINT | {"mass": -1.0}, [], {}, r"mass: expected a positive number"),
        (POINT, [{"shape": "mode", "mode": 3}], {}, r"initial\.1\.mode: expected at most 1"),
    ],
)
def test_bad_input_is_told(
    lamina: dict[str, Any], initial: list[dict[str, Any]], sections: dict[str, Any], expected: str
) -> None:
    with pytest.raises(CaseError, match=expected):
        run(case_of(lamina, *initial, **sections), engine="compiled")

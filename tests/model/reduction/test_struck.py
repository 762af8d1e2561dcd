"""Modes with stops, impactors, initial states and inner supports, beside the beams they are of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import Case, FloatArray, assemble, load_case, nodal, reduced_case
from delam_fem.engines.session import ENGINES

L = 0.5
LAMINA = {
    "name": "one", "length": L, "width": 0.02, "thickness": 0.002, "mass_per_length": 0.1,
    "bending_stiffness": 10.0, "damping_ratio": 0.01,
}  # fmt: skip
SHAKER = {"kind": "harmonic", "amplitude": 1e-4, "frequency": 20.0}
FORCE = {"kind": "force", "lamina": "one", "position": 0.3, "amplitude": 0.5, "frequency": 20.0}
STOP = {"lamina": "one", "side": "above", "gap": 2e-4}
ELASTIC = STOP | {"stiffness": 400.0, "damping": 0.02}
TUP = {"lamina": "one", "mass": 0.02, "velocity": 0.4, "gap": 2e-4}
SPRINGS = {"law": "penalty", "penalty_damping": 5e-3}
RIGID = {"law": "newton", "restitution": 0.3, "impulse": "consistent"}
WITHIN = {"steps_per_period": 400, "periods": 2, "scheme": "moreau-jean"}
ALL, ROUND_OFF = 99, 5e-9
"""More modes than there are; m."""

CASES: dict[str, dict[str, Any]] = {
    "elastic on the base": {"stop": [ELASTIC]},
    "elastic on the ground, inside an element": {
        "stop": [ELASTIC | {"position": 0.81 * L, "on": "ground", "side": "both"}]
    },
    "elastic stretch and a force": {
        "stop": [ELASTIC | {"start": 0.25, "end": L, "opening": 1e-4}], "excitation": FORCE,
    },
    "rigid on base and ground": {
        "stop": [STOP, STOP | {"position": 0.31, "gap": 1e-4, "on": "ground", "side": "below"}],
        "contact": RIGID, "time": WITHIN,
    },
    "a ball on a spring, beside a stop": {
        "impactor": [TUP | {"radius": 1e-5, "position": 0.37, "spring": 100.0, "on": "base"}],
        "stop": [STOP | {"side": "below", "gap": 2e-3}], "contact": {"law": "penalty"},
        "time": {"steps_per_period": 4000, "periods": 1},
    },
    "a rigid blow": {"impactor": [TUP], "contact": RIGID, "time": WITHIN},
    "let go of a static shape": {
        "stop": [ELASTIC],
        "initial": [{"shape": "force", "lamina": "one", "position": 0.31, "displacement": 1e-3},
                    {"shape": "uniform", "velocity": 0.02}],
    },
    "a pin and a spring inside": {
        "stop": [ELASTIC | {"gap": 2e-5}],
        "support": [
            {"start": "clamped", "end": "free"},
            {"position": 0.2, "kind": "pinned"},
            {"position": 0.36, "kind": "spring", "stiffness": 2e3, "damping": 0.4},
        ],
    },
}  # fmt: skip


def case_of(**sections: Any) -> Case:
    data = {
        "name": "struck", "lamina": [LAMINA], "mesh": {"elements": 10}, "excitation": SHAKER,
        "contact": SPRINGS, "time": {"steps_per_period": 400, "periods": 2},
        "output": {"window_periods": 2},
    }  # fmt: skip
    return Case(**(data | sections))


def reduced(case: Case, modes: int, folder: Path) -> Case:
    """Return the case that is computed with a file of modes."""
    return load_case(reduced_case(case, modes).save(folder / str(modes))[1])


def tips(result: df.Result) -> FloatArray:
    return np.asarray(result.history["tip_displacement"].to_numpy())


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_all_modes_move_as_the_beams_and_few_modes_nearly(name: str, tmp_path: Path) -> None:
    """From a file, in both engines; catches a wrong row, frame, weight, mass or start."""
    case = case_of(**CASES[name])
    full = df.run(case, engine="compiled", structure=assemble(case, needs_dolfinx=False))
    errors = []
    for modes in (1, 5, ALL):
        reduced_beams = reduced(case, modes, tmp_path)
        one, other = (df.run(reduced_beams, engine=engine) for engine in ENGINES)
        np.testing.assert_allclose(tips(one), tips(other), rtol=0.0, atol=ROUND_OFF)
        assert max(result.summary["energy_residual"] for result in (one, other)) < 1e-8
        errors.append(np.abs(tips(one) - tips(full)).max())
    assert errors[2] < ROUND_OFF
    assert errors[1] < 0.3 * errors[0], errors
    assert errors[0] > 10.0 * ROUND_OFF, "it is another model"
    assert (full.history["stop_state"] > 0).any() or full.history["event_time"].size


def test_one_mode_gives_way_at_stops_and_starts_as_the_beams(tmp_path: Path) -> None:
    """H V Ω⁻² Vᵀ Hᵀ is H K⁻¹ Hᵀ, and what the parts read at t = 0 is the start of the beams."""
    case = case_of(
        stop=[ELASTIC | {"position": 0.31}, ELASTIC], excitation=FORCE,
        initial=[{"shape": "force", "lamina": "one", "position": 0.2, "displacement": 1e-3},
                 {"shape": "uniform", "velocity": 0.02}],
    )  # fmt: skip
    full, small = assemble(case, needs_dolfinx=False), assemble(reduced(case, 1, tmp_path))
    both = []
    for structure in (full, small):
        o = structure.operators
        H = o.gap_matrix.toarray()
        both.append(H @ np.linalg.solve(o.stiffness.toarray(), H.T))
    np.testing.assert_allclose(both[1], both[0], rtol=1e-9)
    start = small.operators.start
    np.testing.assert_allclose(
        nodal(small.layout, start, np.zeros(2)),
        nodal(full.layout, full.operators.start, np.zeros(2)), atol=1e-9,
    )  # fmt: skip


def test_bonded_laminae_strike_and_are_struck(tmp_path: Path) -> None:
    """Strains and forces of stops and impactors too, before the motion is irregular."""
    gauges = [
        {"name": "strain", "quantity": "strain", "lamina": "one", "position": 0.2},
        {"name": "blow", "quantity": "contact force", "impactor": 1},
        {"name": "stop", "quantity": "contact force", "stop": 1},
    ]
    case = case_of(
        lamina=[LAMINA, LAMINA | {"name": "two", "bending_stiffness": 5.0}],
        delamination=[{"between": ["one", "two"], "start": 0.25, "end": 0.4, "opening": 5e-5}],
        stop=[STOP | {"side": "below", "gap": 1e-4, "stiffness": 100.0}],
        impactor=[TUP | {"lamina": "two", "position": 0.3, "gap": 0.0, "stiffness": 2e4}],
        contact={"law": "penalty"}, sensor=gauges,
        time={"steps_per_period": 2000, "periods": 1}, output={"window_periods": 1},
    )  # fmt: skip
    full = df.run(case, engine="compiled", structure=assemble(case, needs_dolfinx=False)).history
    history = df.run(reduced(case, ALL, tmp_path), engine="compiled").history
    for name in ("sensor_strain", "sensor_blow", "sensor_stop", "impactor_displacement"):
        size = np.abs(full[name]).max()
        assert size > 0.0, name
        assert np.abs(history[name] - full[name]).max() < 1e-6 * size, name
    np.testing.assert_array_equal(history["stop_height"], full["stop_height"])


def test_what_strikes_may_change_but_not_where(tmp_path: Path) -> None:
    """Gap, stiffness, mass and velocity of a reduced case are those of the beams with the same."""
    case = case_of(
        stop=[ELASTIC], impactor=[TUP | {"side": "below", "stiffness": 2e4, "damping": 1.0}]
    )
    small = reduced(case, ALL, tmp_path)
    changes = {
        "stop.1.gap": 1e-4, "stop.1.stiffness": 800.0, "stop.1.damping": 0.04,
        "stop.1.on": "ground", "impactor.1.mass": 0.03, "impactor.1.velocity": 0.2,
        "impactor.1.gap": 1e-4,
    }  # fmt: skip
    expected = case.with_overrides(changes)
    full = df.run(expected, engine="compiled", structure=assemble(expected, needs_dolfinx=False))
    assert np.abs(tips(full) - tips(df.run(case, engine="compiled"))).max() > 1e-5
    result = df.run(small.with_overrides(changes), engine="compiled")
    np.testing.assert_allclose(tips(result), tips(full), rtol=0.0, atol=ROUND_OFF)
    for key, value, message in (
        ("stop.1.position", 0.3, r"stop\.0\.position: expected None, with which .* given 0\.3"),
        ("impactor.1.position", 0.3, r"impactor\.0\.position: expected None"),
        ("stop", [], r"number of \[\[stop\]\]: expected 1, .* given 0"),
    ):
        with pytest.raises(df.CaseError, match=message):
            df.run(small.with_overrides({key: value}))


def test_few_massless_modes_rest_on_stops_as_massless_beams() -> None:
    stops = [STOP, STOP | {"position": 0.25, "gap": 1e-4, "on": "ground"}]
    rigid = {"law": "newton", "restitution": 0.0}
    motions = []
    for model in ({"kind": "modes", "modes": 4}, {"kind": "modes", "modes": 8}, {}):
        case = case_of(
            stop=stops, contact=rigid, model=model, damping={"rayleigh": "stiffness"},
            time={"steps_per_period": 1000, "periods": 2, "mass": "massless"},
        )  # fmt: skip
        result = df.run(case)
        assert result.summary["energy_residual"] < 1e-9
        assert (result.history["stop_state"] > 0).any()
        motions.append(tips(result))
    for motion in motions[:2]:
        assert np.abs(motion - motions[2]).max() < 0.01 * np.abs(motions[2]).max()

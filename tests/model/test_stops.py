"""Stops on base and ground: statics, frames, engines, messages."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from covertable import make

from delam_fem import CaseError, Result, load_case, run, save_case
from delam_fem.api import Case, EngineName, assemble, toml_text
from delam_fem.engines.session import ENGINES
from delam_fem.results.schema import VARIABLES

EI, L, A, GAP, K = 10.0, 0.5, 2e-3, 1e-3, 400.0
LAMINA = {
    "name": "one", "length": L, "width": 0.02, "thickness": 0.002, "mass_per_length": 0.1,
    "bending_stiffness": EI, "damping_ratio": 0.01,
}  # fmt: skip
"""First frequency 22.4 Hz."""
FORCE = {"kind": "force", "lamina": "one", "position": L, "amplitude": 0.5, "frequency": 20.0}
SHAKER = {"kind": "harmonic", "amplitude": 1e-4, "frequency": 20.0}
RIGID = {"law": "newton", "restitution": 0.3}
OF_STOPS = {"event_stop", *(name for name in VARIABLES if name.startswith("stop_"))}
ELASTIC = {"stiffness": K, "damping": 0.02}
CURVED = {"position": None, "start": 0.25, "end": L, "opening": 3e-3}


def case_of(stop: dict[str, Any] | list[dict[str, Any]], **sections: Any) -> Case:
    stops = stop if isinstance(stop, list) else [stop]
    sensors = [
        {"name": f"stop-{k}", "quantity": "contact force", "stop": k}
        for k in range(1, len(stops) + 1)
    ]
    data = {
        "name": "stop", "lamina": [LAMINA], "mesh": {"elements": 4}, "excitation": SHAKER,
        "contact": {"law": "penalty"}, "sensor": sensors,
        "stop": [{"lamina": "one", "side": "above", "gap": GAP} | stop for stop in stops],
        "time": {"steps_per_period": 1000, "periods": 3}, "output": {"window_periods": 3},
    }  # fmt: skip
    return Case(**(data | sections))


def forces(result: Result) -> np.ndarray:
    return np.array([result.history[f"sensor_stop-{k + 1}"] for k in range(len(result.case.stop))])


@pytest.mark.parametrize("side", ["above", "below"])
@pytest.mark.parametrize("place", [1.0, 0.8], ids=["node", "inside"])
def test_a_slow_base_presses_on_an_elastic_stop_on_the_ground(side: str, place: float) -> None:
    """F = (|q| - gap) / (x³/3EI + 1/k): catches a wrong frame, sign, place, stiffness or share."""
    x = place * L
    slow = {"kind": "harmonic", "amplitude": A, "frequency": 0.02}
    stop = {"position": x, "side": side, "on": "ground", "stiffness": K}
    case = case_of(stop, excitation=slow, time={"steps_per_period": 4000, "periods": 1})
    result = run(case, engine="compiled")
    q = result.history["base_displacement"].to_numpy() * (1.0 if side == "above" else -1.0)
    exact = np.maximum(q - GAP, 0.0) / (x**3 / (3.0 * EI) + 1.0 / K)
    stop_force = forces(result)[0]
    assert np.abs(stop_force - exact).max() < 0.01 * exact.max()
    # round-off, whatever the step: u is that of the ground's frame, so almost rigid
    assert result.summary["energy_residual"] < 1e-7


def test_a_slow_base_carries_its_stop_along() -> None:
    """A stop on the base is not touched by a slow motion; one on the ground would be."""
    slow = {"kind": "harmonic", "amplitude": A, "frequency": 0.1}
    time = {"steps_per_period": 2000, "periods": 1}
    on_base = run(case_of({"position": L, "stiffness": K}, excitation=slow, time=time))
    history = on_base.history
    assert not forces(on_base).any()
    moved = history["tip_displacement"][0] - history["base_displacement"]
    assert np.abs(moved).max() < 1e-2 * A  # of the start
    assert float(np.abs(history["tip_displacement"]).max()) == pytest.approx(A, rel=1e-2)


def test_the_frame_changes_nothing_but_round_off_and_steps() -> None:
    """With an open stop on the base, which moves the dofs' frame, the motion is that without."""
    far = run(case_of({"position": L, "gap": 1.0}, contact=RIGID), engine="compiled")
    none = run(case_of([], contact=RIGID), engine="compiled")
    for name in ("tip_displacement", "tip_velocity", "displacement", "velocity", "moment",
                 "strobe_displacement", "envelope_max"):  # fmt: skip
        one, other = far.history[name].to_numpy(), none.history[name].to_numpy()
        assert np.abs(one - other).max() < 1e-3 * np.abs(other).max(), name


@pytest.mark.parametrize("engine", ENGINES)
def test_rigid_stops_hold_the_tip(engine: EngineName) -> None:
    """The tip stays between a stop on the base and the ground's, each in its own frame."""
    stops = [{"position": L, "side": "below"}, {"position": 0.5 * L, "on": "ground", "gap": 4e-4}]
    shaker = SHAKER | {"amplitude": 8e-4}
    case = case_of(stops, contact=RIGID, excitation=shaker).with_overrides(
        {"time.scheme": "moreau-jean", "time.steps_per_period": 4000}
    )
    result = run(case, engine=engine)
    history = result.history
    relative = history["tip_displacement"][0] - history["base_displacement"]
    assert -GAP * 1.1 < float(relative.min()) < -0.9 * GAP
    middle = history["displacement"].sel(node=np.argmin(np.abs(history["x"].to_numpy() - 0.5 * L)))
    assert 0.8 * 4e-4 < float(middle.max()) < 1.2 * 4e-4
    assert OF_STOPS <= set(history.data_vars)
    assert set(history["event_stop"].to_numpy().tolist()) == {0, 1}
    assert forces(result).min() >= 0.0
    assert result.summary["energy_residual"] < 1e-9
    assert result.summary["tip_contacts_per_period"] is None, "no tips meet"


ARRAY = make(
    {
        "side": ["above", "below", "both"], "on": ["base", "ground"],
        "place": ["node", "inside", "stretch"], "drive": ["shaker", "force"],
        "law": ["elastic", "rigid"], "scheme": ["newmark", "moreau-jean"], "refine": [1, 4],
        "laminae": ["one", "supported", "two"],
    },
    constraints=[
        {"operator": "fn", "requires": ["law", "scheme"],
         "evaluate": lambda cell: (cell["law"], cell["scheme"]) != ("elastic", "moreau-jean")},
    ],
)  # fmt: skip


@pytest.mark.parametrize("row", ARRAY, ids=lambda row: "-".join(map(str, row.values())))
def test_engines_agree(row: dict[str, Any]) -> None:
    place = {"node": {"position": L}, "inside": {"position": 0.8 * L},
             "stretch": {"start": 0.5 * L, "end": L}}[row["place"]]  # fmt: skip
    gap = 2e-5 if row["laminae"] == "supported" else 2e-4
    stop = place | {"side": row["side"], "on": row["on"], "gap": gap}
    is_elastic = row["law"] == "elastic"
    sections: dict[str, Any] = {
        "excitation": SHAKER if row["drive"] == "shaker" else FORCE | {"position": 0.6 * L},
        "contact": {"law": "penalty", "penalty_damping": 5e-3} if is_elastic else RIGID,
        "time": {"steps_per_period": 400, "periods": 4, "scheme": row["scheme"],
                 "refine": row["refine"]},
    }  # fmt: skip
    if row["laminae"] == "supported":
        sections["support"] = {"start": "pinned", "end": "pinned"}
        stop |= {"position": 0.8 * L} if row["place"] == "node" else {}
    if row["laminae"] == "two":
        sections |= {
            "lamina": [LAMINA, LAMINA | {"name": "two", "bending_stiffness": 4.0}],
            "gap": {"tip": 5e-4},
        }
    case = case_of(stop | (ELASTIC if is_elastic else {}), **sections)
    results = [
        run(case, engine=engine, structure=assemble(case, needs_dolfinx=False))
        for engine in ENGINES
    ]
    one, other = (result.history for result in results)
    events = one["event_time"].to_numpy()
    end = events[9] if events.size > 9 else math.inf  # before the tenth impact
    is_before = one["time"].to_numpy() < end
    for name, atol in (("tip_displacement", 1e-9), ("tip_velocity", 1e-6)):
        both = [history[name].to_numpy()[:, is_before] for history in (one, other)]
        np.testing.assert_allclose(*both, rtol=0.0, atol=atol)
    touched = (
        one["stop_state"].to_numpy().any() or (one.get("event_stop", one["event_node"]) >= 0).any()
    )
    assert touched
    for result in results:
        assert result.summary["energy_residual"] < 1e-8


def test_dolfinx_assembles_the_same_stops() -> None:
    case = case_of(
        [{"position": 0.4 * L, "side": "both"}, {"start": 0.3, "end": L, "on": "ground"}]
    )
    operators, expected = assemble(case).operators, assemble(case, needs_dolfinx=False).operators
    np.testing.assert_allclose(
        operators.gap_matrix.toarray(), expected.gap_matrix.toarray(), atol=1e-12
    )
    np.testing.assert_allclose(operators.base.shift, expected.base.shift, atol=1e-9)
    np.testing.assert_allclose(operators.base.mass, expected.base.mass, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("side", ["above", "below"])
@pytest.mark.parametrize(
    ("shape", "opened"),
    [
        ({"opening": 3e-3}, [0.0, 3e-3, 0.0]),
        ({"opening": 3e-3, "shape": "power"}, [0.0, 0.75e-3, 3e-3]),
        ({"opening": 3e-3, "shape": "power", "exponent": 3.0}, [0.0, 0.375e-3, 3e-3]),
        ({"file": "curve.csv"}, [1e-4, 2e-4, 4e-4]),
    ],
)
def test_a_stop_along_a_stretch_has_a_shape(
    tmp_path: Path, shape: dict[str, Any], opened: list[float], side: str
) -> None:
    """Nodes at the ends and in the middle; a folder that was written has the table, too."""
    (tmp_path / "curve.csv").write_text("x [m],gap [m]\n0.25,1e-4\n0.375,2e-4\n0.5,4e-4\n")
    stop = {"lamina": "one", "side": side, "gap": GAP, "start": 0.25, "end": L, **shape}
    data = case_of([]).model_dump(exclude_unset=True, exclude_none=True) | {"stop": [stop]}
    (tmp_path / "case.toml").write_text(toml_text(data))
    case = load_case(save_case(load_case(tmp_path / "case.toml"), tmp_path / "copy"))
    assembled = assemble(case, needs_dolfinx=False)
    [stop_pairs] = assembled.layout.stops
    np.testing.assert_allclose(assembled.operators.gap0[stop_pairs.pairs], GAP + np.array(opened))


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"lamina": "none"}, r"stop\.1\.lamina: .*given 'none'"),
        ({"position": 0.6}, r"stop\.1\.position: .*given 0\.6"),
        ({"start": 0.2}, "position: "),
        ({"position": None, "start": 0.4, "end": 0.3}, "end: "),
        ({"gap": -1e-3}, r"gap: expected a number of at least 0|gap: expected .* given -0\.001"),
        ({"side": "left"}, r"side"),
        ({"stiffness": -1.0}, r"stiffness: .*given -1\.0"),
        ({"damping": 1.0}, "damping: "),
        ({"opening": 1e-3}, "opening: "),
        ({"shape": "power"}, "shape: "),
        (CURVED | {"exponent": 3.0}, "exponent: "),
        (CURVED | {"file": "a.csv"}, "file: "),
    ],
)
def test_bad_stops_are_told(change: dict[str, Any], expected: str) -> None:
    stop = {key: v for key, v in ({"position": L} | change).items() if v is not None}
    with pytest.raises(CaseError, match=expected):
        case_of(stop)


@pytest.mark.parametrize(("own", "order"), [(ELASTIC, 2.0), ({}, 1.0)], ids=["elastic", "rigid"])
def test_errors_vanish_with_the_step(own: dict[str, Any], order: float) -> None:
    """As between laminae: order 2 of springs, 1 of impacts."""
    is_elastic, motions = bool(own), []
    for steps in (500, 1000, 2000, 16000):
        case = case_of(
            {"position": L, "gap": 2.3e-4, "on": "ground"} | own,
            lamina=[LAMINA | {"damping_ratio": 0.05}], mesh={"elements": 2},
            contact={"law": "penalty", "penalty_damping": 5e-3} if is_elastic else RIGID,
            excitation=SHAKER | {"amplitude": 3e-4},
            time={"steps_per_period": steps, "periods": 1}, output={"window_periods": 1},
        )  # fmt: skip
        history = run(case, engine="compiled").history
        motions.append(history["tip_displacement"][0, steps // 4 - 1 :: steps // 4].to_numpy())
    errors = [np.abs(one - motions[-1]).max() for one in motions[:-1]]
    assert abs(0.5 * math.log2(errors[0] / errors[2]) - order) < 0.5, errors


AT_ONE_PLACE = r"stop\.2\.{}: expected another place or side of lamina one than that of stop 1"


@pytest.mark.parametrize(
    ("first", "second", "key"),
    [
        ({"position": L}, {}, "position"),
        ({"position": 0.3, "side": "both"}, {"position": 0.3, "gap": 2 * GAP}, "position"),
        (
            {"start": 0.2, "end": 0.4, "side": "below"},
            {"position": 0.3, "side": "both"},
            "position",
        ),
        ({"position": 0.3, "stiffness": K}, {"position": 0.3}, "position"),
        ({"start": 0.2, "end": 0.4}, {"start": 0.3, "end": L}, "start"),
    ],
)
def test_two_stops_at_one_place_are_told(
    first: dict[str, Any], second: dict[str, Any], key: str
) -> None:
    with pytest.raises(CaseError, match=AT_ONE_PLACE.format(key)):
        case_of([first, second])
    apart = case_of([first | {"side": "above"}, second | {"side": "below"}])
    assert len(apart.stop) == 2


def test_elastic_stops_at_one_place_are_springs_one_after_the_other() -> None:
    """Twice k beyond the second gap; catches a pair that is dropped."""
    slow = {"kind": "harmonic", "amplitude": A, "frequency": 0.02}
    k = 100.0
    stop = {"position": L, "on": "ground", "stiffness": k}
    case = case_of(
        [stop, stop | {"gap": 1.5 * GAP}], excitation=slow,
        time={"steps_per_period": 4000, "periods": 1},
    )  # fmt: skip
    first, second = (force.max() for force in forces(run(case, engine="compiled")))
    give = L**3 / (3.0 * EI)
    tip = (A + give * k * 2.5 * GAP) / (1.0 + 2.0 * give * k)
    assert first == pytest.approx(k * (tip - GAP), rel=0.01)
    assert second == pytest.approx(k * (tip - 1.5 * GAP), rel=0.01)


def test_what_does_not_go_together_is_told() -> None:
    soft = {"position": L, "stiffness": K}
    within = {"scheme": "moreau-jean", "steps_per_period": 1000, "periods": 3}
    with pytest.raises(CaseError, match=r'stop\.1\.stiffness: .*time\.scheme = "newmark"'):
        case_of(soft, contact=RIGID, time=within)
    with pytest.raises(CaseError, match="gap: "):
        case_of([], gap={"tip": 1e-3})
    with pytest.raises(CaseError, match=r"stop\.1: "):
        assemble(case_of({"position": 0.0}), needs_dolfinx=False)
    both = [{"position": L}, {"position": L, "on": "ground", "side": "below"}]
    with pytest.raises(CaseError, match="at different places, as the base moves"):
        assemble(case_of(both), needs_dolfinx=False)
    lumped = {"law": "newton", "impulse": "lumped"}
    with pytest.raises(CaseError, match=r"stop\.1\.position: "):
        assemble(case_of({"position": 0.3}, contact=lumped), needs_dolfinx=False)

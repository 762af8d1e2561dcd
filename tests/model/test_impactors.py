"""Impactors: blows with known solutions, engines, frames, orders, messages."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from covertable import make
from typer.testing import CliRunner

from delam_fem import CaseError, Result, Sweep, modes, run
from delam_fem.api import Case, Study, assemble
from delam_fem.cli.app import app
from delam_fem.engines.session import ENGINES
from delam_fem.plugins.discovery import studies
from delam_fem.results.pages.report import film
from delam_fem.studies.sweeps.point import assembly_key

M, V, GAP, L = 2.0, 1.5, 1e-3, 0.5
WALL = {"name": "one", "mass": 1e7, "stiffness": 0.0, "damping_ratio": 0.0}
"""A point so heavy that it hardly moves."""
LAMINA = {
    "name": "one", "length": L, "width": 0.02, "thickness": 0.002, "mass_per_length": 0.1,
    "bending_stiffness": 10.0, "damping_ratio": 0.01,
}  # fmt: skip
"""First frequency 22.4 Hz, mass 50 g."""
NO_FORCE = {"kind": "force", "lamina": "one", "position": 1.0, "amplitude": 0.0}
SHAKER = {"kind": "harmonic", "amplitude": 1e-3, "frequency": 20.0}
RIGID = {"law": "newton", "restitution": 0.4, "impulse": "consistent"}
BALL = {"radius": 0.01, "velocity": V}


def case_of(impactor: dict[str, Any], **sections: Any) -> Case:
    data = {
        "name": "tap", "lamina": [LAMINA], "mesh": {"elements": 4}, "excitation": SHAKER,
        "contact": {"law": "penalty"},
        "impactor": [{"lamina": "one", "mass": M, "gap": GAP} | impactor],
        "sensor": [{"name": "blow", "quantity": "contact force", "impactor": 1}],
        "time": {"steps_per_period": 1000, "periods": 3}, "output": {"window_periods": 3},
    }  # fmt: skip
    return Case(**(data | sections))


def on_wall(impactor: dict[str, Any], seconds: float, steps: int = 4000, **sections: Any) -> Case:
    data = {
        "lamina": [WALL], "mesh": {"elements": 1},
        "excitation": NO_FORCE | {"frequency": 1.0 / seconds},
        "time": {"steps_per_period": steps, "periods": 1}, "output": {"window_periods": 1},
    }  # fmt: skip
    return case_of({"velocity": V} | impactor, **(data | sections))


def pulse(result: Result) -> tuple[float, float, float]:
    """Return the largest force [N], the length [s] and the impulse [N s] of the blow."""
    force, time = (result.history[name].to_numpy() for name in ("sensor_blow", "time"))
    step = time[1] - time[0]
    return force.max(), np.count_nonzero(force) * step, force.sum() * step


@pytest.mark.parametrize("side", ["above", "below"])
def test_a_blow_on_a_spring_is_half_a_sine(side: str) -> None:
    """F = v √(k m), length π √(m/k), impulse 2 m v; the rest of the way is the gap's."""
    k = 1e4
    result = run(on_wall({"side": side, "stiffness": k}, 0.06), engine="compiled")
    force, length, impulse = pulse(result)
    assert force == pytest.approx(V * math.sqrt(k * M), rel=1e-4)
    assert length == pytest.approx(math.pi * math.sqrt(M / k), rel=1e-3)
    assert impulse == pytest.approx(2.0 * M * V, rel=1e-4)
    history, sign = result.history, -1.0 if side == "above" else 1.0
    assert float(history["impactor_displacement"][0, 0]) > 0.0 or sign < 0.0
    assert float(history["impactor_velocity"][0, 0]) == pytest.approx(sign * V)
    assert float(history["impactor_velocity"][0, -1]) == pytest.approx(-sign * V, rel=1e-6)
    first = float(history["time"][np.flatnonzero(history["sensor_blow"])[0]])
    assert first == pytest.approx(GAP / V, abs=0.06 / 2000)
    assert result.summary["energy_residual"] < 1e-6


def test_a_ball_follows_hertz() -> None:
    """F = k δ^1.5 and T = 2.9433 δ / v at δ = (5 m v² / 4 k)^0.4 (Johnson 1985, section 11.4)."""
    k = 4.0 / 3.0 * 1e10 * math.sqrt(BALL["radius"])  # the picture of a point has E = 1e10
    depth = (1.25 * M * V**2 / k) ** 0.4
    length = 2.9432752 * depth / V
    result = run(on_wall(BALL | {"gap": 0.0}, 1.5 * length), engine="compiled")
    measured_pulse = pulse(result)
    assert measured_pulse[0] == pytest.approx(k * depth**1.5, rel=1e-3)
    assert measured_pulse[1] == pytest.approx(length, rel=2e-3)
    assert measured_pulse[2] == pytest.approx(2.0 * M * V, rel=1e-3)


@pytest.mark.parametrize(
    ("keys", "nu"),
    [({}, 0.3), ({"model": {"poisson": 0.0}}, 0.0), ({"model": {"poisson": 0.4}}, 0.4)],
)
def test_the_material_of_a_lamina_brings_its_poissons_ratio_to_hertz(
    keys: dict[str, Any], nu: float
) -> None:
    """k = 4/3 E √R / (1 - ν²) of EN 1993-1-1: E = 210 GPa, ν = 0.3; model.poisson replaces ν."""
    k = 4.0 / 3.0 * 210e9 * math.sqrt(BALL["radius"]) / (1.0 - nu**2)
    depth = (1.25 * M * V**2 / k) ** 0.4
    wall = WALL | {"material": "steel"}
    case = on_wall(BALL | {"gap": 0.0}, 5.0 * depth / V, lamina=[wall], **keys)
    assert not case.unread
    assert pulse(run(case, engine="compiled"))[0] == pytest.approx(k * depth**1.5, rel=1e-3)


@pytest.mark.parametrize("scheme", ["newmark", "moreau-jean"])
def test_a_rigid_blow_shares_momentum(scheme: str) -> None:
    """v₁ = v (m₁ - e m₂) / (m₁ + m₂), v₂ = v m₁ (1 + e) / (m₁ + m₂), downwards."""
    m2, e = 3.0, 0.4
    point = {"name": "one", "mass": m2, "stiffness": 0.0, "damping_ratio": 0.0}
    time = {"steps_per_period": 50, "periods": 1, "scheme": scheme}
    case = on_wall({}, 0.01, lamina=[point], contact=RIGID, time=time)
    history = run(case, engine="compiled").history
    v1, v2 = V * (M - e * m2) / (M + m2), V * M * (1.0 + e) / (M + m2)
    assert float(history["impactor_velocity"][0, -1]) == pytest.approx(-v1, rel=1e-9)
    assert float(history["tip_velocity"][0, -1]) == pytest.approx(-v2, rel=1e-9)
    assert float(history["event_stop"][0]) == 0
    assert float(history["event_energy"].sum()) == pytest.approx(
        -0.5 * (1.0 - e**2) * V**2 * M * m2 / (M + m2), rel=1e-9
    )


@pytest.mark.parametrize("on", ["base", "ground"])
@pytest.mark.parametrize("stop", ["base", None])
def test_a_spring_carries_it_with_the_base_or_the_ground(on: str, stop: str | None) -> None:
    """Slowly driven it moves with what carries it, whatever the frame of the dofs."""
    slow = {"kind": "harmonic", "amplitude": 2e-4, "frequency": 0.1}
    stops = [] if stop is None else [{"lamina": "one", "side": "below", "gap": 0.1, "on": stop}]
    case = case_of(
        {"spring": 2e4, "spring_damping": 50.0, "on": on}, excitation=slow, stop=stops,
        time={"steps_per_period": 2000, "periods": 1}, output={"window_periods": 1},
    )  # fmt: skip
    result = run(case, engine="compiled")
    history = result.history
    expected = history["base_displacement"] * (on == "base")
    assert np.abs(history["impactor_displacement"][0] - expected).max() < 0.03 * 2e-4
    assert result.summary["energy_residual"] < 1e-9


@pytest.mark.parametrize(("contact", "order"), [({"stiffness": 3e3}, 2.0), ({}, 1.0)])
def test_errors_vanish_with_the_step(contact: dict[str, Any], order: float) -> None:
    """As between laminae: order 2 of springs, 1 of impacts."""
    sections: dict[str, Any] = {} if contact else {"contact": RIGID}
    motions = []
    for steps in (500, 1000, 2000, 16000):
        case = case_of(
            {"mass": 0.02, "velocity": 0.5, "gap": 3.1e-4, "spring": 50.0} | contact,
            time={"steps_per_period": steps, "periods": 1}, output={"window_periods": 1},
            excitation=SHAKER | {"frequency": 60.0}, **sections,
        )  # fmt: skip
        history = run(case, engine="compiled").history
        motions.append(history["impactor_displacement"][0, steps // 4 - 1 :: steps // 4].to_numpy())
    errors = [np.abs(one - motions[-1]).max() for one in motions[:-1]]
    assert abs(0.5 * math.log2(errors[0] / errors[2]) - order) < 0.5, errors


ARRAY = make(
    {
        "side": ["above", "below"], "place": ["node", "inside"], "drive": ["shaker", "force"],
        "contact": ["linear", "hertz", "rigid"], "scheme": ["newmark", "moreau-jean"],
        "spring": ["none", "base", "ground"], "laminae": ["one", "two", "embedded"],
        "stop": [False, True],
    },
    constraints=[
        {"operator": "fn", "requires": ["contact", "scheme"],
         "evaluate": lambda row: row["contact"] == "rigid" or row["scheme"] == "newmark"},
    ],
)  # fmt: skip


@pytest.mark.parametrize("row", ARRAY, ids=lambda row: "-".join(map(str, row.values())))
def test_engines_agree(row: dict[str, Any]) -> None:
    """To 1e-9 m before the tenth impact, on every pair of settings."""
    impactor: dict[str, Any] = {
        "mass": 0.02, "velocity": 0.4, "gap": 2e-4, "side": row["side"],
        "position": {"node": L, "inside": 0.8 * L}[row["place"]],
    }  # fmt: skip
    impactor |= {"linear": {"stiffness": 2e4}, "hertz": {"radius": 1e-5}, "rigid": {}}[
        row["contact"]
    ]
    if row["spring"] != "none":
        impactor |= {"spring": 100.0, "spring_damping": 0.05, "on": row["spring"]}
    names = ["one"] if row["laminae"] == "one" else ["one", "two"]
    force = {"kind": "force", "lamina": "one", "position": 0.3, "amplitude": 0.2, "frequency": 20.0}
    sections: dict[str, Any] = {
        "lamina": [LAMINA | {"name": name, "bending_stiffness": 10.0 - 5.0 * k}
                   for k, name in enumerate(names)],
        "excitation": SHAKER if row["drive"] == "shaker" else force,
        "contact": RIGID if row["contact"] == "rigid" else {"law": "penalty"},
        "time": {"steps_per_period": 5000 if row["contact"] == "hertz" else 500, "periods": 2,
                 "scheme": row["scheme"]},
    }  # fmt: skip
    sections["sensor"] = [
        {"name": "gauge", "quantity": "strain", "lamina": "one", "position": 0.2},
        {"name": "blow", "quantity": "contact force", "impactor": 1},
    ]
    if row["laminae"] == "two":
        sections["gap"] = {"tip": 5e-4}
    if row["laminae"] == "embedded":
        sections["delamination"] = [{"between": names, "start": 0.25, "end": 0.375}]
        sections["mesh"] = {"elements": 8}
    if row["stop"]:
        sections["stop"] = [{"lamina": "one", "position": 0.375, "side": "below", "gap": 2e-3}]
    case = case_of(impactor, **sections)
    structure = assemble(case, needs_dolfinx=False)
    results = [run(case, engine=engine, structure=structure) for engine in ENGINES]
    one, other = (result.history for result in results)
    blows = one["time"][1:][np.diff(one["sensor_blow"] > 0.0)].to_numpy()
    blows = np.sort(np.concatenate([blows, one["event_time"].to_numpy()]))
    is_before = one["time"].to_numpy() < (blows[9] if blows.size > 9 else math.inf)
    for name in ("tip_displacement", "impactor_displacement"):
        both = [history[name].to_numpy()[:, is_before] for history in (one, other)]
        np.testing.assert_allclose(*both, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(
        one["sensor_gauge"][is_before], other["sensor_gauge"][is_before], atol=1e-7
    )
    assert blows.size
    for result in results:
        assert result.summary["energy_residual"] < 1e-6


def test_dolfinx_assembles_the_same_impactor() -> None:
    case = case_of({"position": 0.8 * L, "spring": 10.0, "on": "base"} | BALL)
    operators, expected = assemble(case).operators, assemble(case, needs_dolfinx=False).operators
    for name in ("mass", "stiffness", "gap_matrix", "sensors"):
        both = [getattr(o, name).toarray() for o in (operators, expected)]
        np.testing.assert_allclose(*both, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(operators.pair_weights, expected.pair_weights)


def test_the_film_shows_it_where_it_is_and_modes_leave_it_out() -> None:
    """One mark, though a ball has many springs, its face at gap and displacement."""
    case = case_of({"gap": 2e-3, "mass": 0.01} | BALL)
    history = run(case, engine="compiled").history
    scene = film(history, case)
    assert scene is not None
    (mark,) = scene.data["stops"]
    flight = history["impactor_displacement"][0].to_numpy()
    moved = np.interp(history["frame"], history["time"], flight)
    expected = scene.data["factor"] * (2e-3 + moved)
    is_small = moved < 1e-3
    np.testing.assert_allclose(np.array(mark["y"])[is_small], 1e3 * expected[is_small], atol=1e-5)
    alone = case.without_impactors
    np.testing.assert_array_equal(modes(case).frequencies, modes(alone).frequencies)


def test_a_sweep_over_the_contact_springs_leaves_the_blow_as_it_is() -> None:
    """Its stiffness is a share of that of contact springs: structures are not shared then."""
    two = [LAMINA, LAMINA | {"name": "two"}]
    case = case_of({"stiffness": 1e3}, lamina=two, gap={"tip": 1e-3})
    keys = {assembly_key(case.with_overrides({"contact.penalty_stiffness": k})) for k in (1.0, 2.0)}
    assert len(keys) == 2


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"lamina": "none"}, r"impactor\.1\.lamina: .*given 'none'"),
        ({"position": 0.6}, r"impactor\.1\.position: "),
        ({"mass": -1.0}, r"impactor\.1\.mass: .*given -1\.0"),
        ({"gap": -1e-3}, r"impactor\.1\.gap: .*given -0\.001"),
        ({"side": "both"}, r"impactor\.1\.side"),
        ({"stiffness": 0.0}, "stiffness: "),
        ({"damping": 1.0}, "damping: "),
        ({"stiffness": 1.0} | BALL, "radius: "),
        ({"radius": 0.01}, "velocity: "),
    ],
)
def test_bad_impactors_are_told(change: dict[str, Any], expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        case_of(change)


def test_what_does_not_go_together_is_told() -> None:
    with pytest.raises(CaseError, match=r'impactor\.1\.radius: .*time\.scheme = "newmark"'):
        case_of(BALL, contact=RIGID | {"law": "newton@moreau-jean"})
    with pytest.raises(CaseError, match=r"sensor\.blow\.impactor: "):
        case_of({}, sensor=[{"name": "blow", "quantity": "contact force", "impactor": 2}])
    with pytest.raises(CaseError, match=r"impactor\.1: "):
        assemble(case_of({"position": 0.0}), needs_dolfinx=False)
    up = [{"lamina": "one", "displacement": 2e-3}]
    with pytest.raises(CaseError, match=r"impactor\.1\.gap: "):
        assemble(case_of({}, initial=up), needs_dolfinx=False)
    assemble(case_of({"side": "below"}, initial=up), needs_dolfinx=False)
    with pytest.raises(CaseError, match="start: "):
        Sweep(case_of({}), {"impactor.1.velocity": [0.1, 0.2]}, start="steady")
    with pytest.raises(CaseError, match="orbit: "):
        from delam_fem import orbit

        orbit(case_of({}))
    assert {name for name, study in studies().items() if takes_impactors(study)} == {
        "modes", "orbit find", "orbit follow", "detect tap",
    }  # fmt: skip


def test_a_refinement_names_the_impactor_before_its_law(tmp_path: Path) -> None:
    path = tmp_path / "tap.toml"
    path.write_text(case_of({"stiffness": 1e5}).to_toml())
    result = CliRunner().invoke(app, ["converge", str(path), "-o", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert (
        "impactor: converge: expected none, as their blows need not repeat, given 1"
        in result.output
    )


def takes_impactors(study: Study[Any, Any]) -> bool:
    """Return whether a study says nothing against impactors."""
    try:
        study.require_fit(case_of({}))
    except CaseError as error:
        return not str(error).startswith("impactor: ")
    return True

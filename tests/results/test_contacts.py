"""What contacts did, beside motions that are integrated here or known by formulas."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support import refusal

import delam_fem as df
from delam_fem.api import EngineName, load_numbers
from delam_fem.engines.session import ENGINES

M, K, D, F, OMEGA = 0.5, 800.0, 0.05, 2.0, 2.0 * math.pi * 7.0
"""Mass [kg], spring [N/m] (6.37 Hz), damping ratio, force [N] and its angular frequency [rad/s]."""
PERIOD = 2.0 * math.pi / OMEGA
GAP, STOP = 1.5e-3, 4000.0
PERIODS, WINDOW = 40, 4
POINT = {"name": "one", "mass": M, "stiffness": K, "damping_ratio": D}
FORCE = {"kind": "force", "lamina": "one", "position": 1.0, "amplitude": F, "frequency": 7.0}


def case_of(**sections: Any) -> df.Case:
    time = {"steps_per_period": 1000, "periods": PERIODS}
    defaults: dict[str, Any] = {
        "name": "struck", "lamina": [POINT], "mesh": {"elements": 1}, "excitation": FORCE,
        "time": time, "output": {"window_periods": WINDOW, "fields_per_period": 0},
    }  # fmt: skip
    return df.Case(**(defaults | sections))


def entry(case: df.Case, engine: EngineName = "compiled") -> dict[str, Any]:
    (single,) = df.run(case, engine=engine).summary["contacts"]
    return dict(single)


Rate = Callable[[float, np.ndarray], list[float]]


def oscillator(of_stop: Callable[[float], float]) -> Rate:
    def rate(t: float, y: np.ndarray) -> list[float]:
        force = F * math.sin(OMEGA * t) - K * y[0] - 2.0 * D * math.sqrt(K * M) * y[1]
        return [y[1], (force - of_stop(y[0])) / M]

    return rate


def course(rate: Rate, t: float, y: np.ndarray, end: float, level: float, way: float) -> Any:
    def reaches(_: float, state: np.ndarray) -> float:
        return float(state[0] - level)

    reaches.terminal, reaches.direction = True, way  # type: ignore[attr-defined]
    return solve_ivp(rate, (t, end), y, events=reaches, rtol=1e-10, atol=1e-13, max_step=0.01)


@cache
def on_springs(sides: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    """Return strikes per period, their speed, impulse and largest force, and the closed share."""

    def of_stop(x: float) -> float:
        return sum(side * STOP * max(side * x - GAP, 0.0) for side in sides)

    rate = oscillator(of_stop)
    before = solve_ivp(rate, (0.0, (PERIODS - WINDOW) * PERIOD), [0.0, 0.0], rtol=1e-9, atol=1e-12,
                       max_step=PERIOD / 100)  # fmt: skip
    time = np.linspace(before.t[-1], PERIODS * PERIOD, 40_001)
    after = solve_ivp(rate, (time[0], time[-1]), before.y[:, -1], t_eval=time, rtol=1e-9,
                      atol=1e-12, max_step=PERIOD / 100)  # fmt: skip
    x, v = after.y
    force = np.array([abs(of_stop(value)) for value in x.tolist()])
    closed = force > 0.0
    begins = np.flatnonzero(closed[1:] & ~closed[:-1]) + 1
    total = float(force.sum() * (time[1] - time[0]))
    return (
        begins.size / WINDOW,
        float(np.abs(v[begins]).mean()),
        total / begins.size,
        float(force.max()),
        float(closed.mean()),
    )


NUMBERS = ("strikes_per_period", "approach_velocity", "impulse", "peak_force", "closed_share")


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("side", "sides", "strikes"),
    [("above", (1.0,), 1.0), ("below", (-1.0,), 1.0), ("both", (1.0, -1.0), 2.0)],
)
def test_a_mass_on_an_elastic_stop(
    side: str, sides: tuple[float, ...], strikes: float, engine: EngineName
) -> None:
    stop = {"lamina": "one", "side": side, "gap": GAP, "stiffness": STOP}
    numbers = entry(case_of(stop=[stop], contact={"law": "penalty"}), engine)
    exact = on_springs(sides)
    assert (numbers["name"], numbers["kind"]) == ("stop 1", "stop")
    assert numbers["strikes_per_period"] == pytest.approx(strikes) == exact[0]
    for name, value in zip(NUMBERS[1:], exact[1:], strict=True):
        assert numbers[name] == pytest.approx(value, rel=2e-3), name


def on_a_wall(restitution: float) -> tuple[float, float]:
    """Return strikes per period and their mean speed."""
    rate, t, y = oscillator(lambda _: 0.0), 0.0, np.zeros(2)
    speeds, begin = [], (PERIODS - WINDOW) * PERIOD
    while t < PERIODS * PERIOD:
        flight = course(rate, t, y, PERIODS * PERIOD, GAP, 1.0)
        t, y = float(flight.t[-1]), flight.y[:, -1].copy()
        if flight.t_events[0].size:
            if t > begin:
                speeds.append(y[1])
            y = np.array([GAP - 1e-15, -restitution * y[1]])
    return len(speeds) / WINDOW, float(np.mean(speeds))


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("scheme", ["newmark", "moreau-jean"])
def test_a_mass_on_a_rigid_stop(engine: EngineName, scheme: str) -> None:
    stop = {"lamina": "one", "side": "above", "gap": GAP}
    contact = {"law": "newton", "restitution": 0.6}
    time = {"steps_per_period": 4000, "periods": PERIODS, "scheme": scheme}
    numbers = entry(case_of(stop=[stop], contact=contact, time=time), engine)
    strikes, speed = on_a_wall(0.6)
    assert numbers["strikes_per_period"] == pytest.approx(strikes) == 1.0
    assert numbers["approach_velocity"] == pytest.approx(speed, rel=5e-3)
    assert numbers["impulse"] == pytest.approx(1.6 * M * speed, rel=5e-3)
    assert numbers["peak_force"] is None


def free_mass(impactor: dict[str, Any], contact: dict[str, Any], seconds: float) -> dict[str, Any]:
    """Return what an impactor of 2 kg and 1.5 m/s did on a wall 1 mm away."""
    wall = {"name": "one", "mass": 1e7, "stiffness": 0.0, "damping_ratio": 0.0}
    impactor = {"lamina": "one", "mass": 2.0, "gap": 1e-3, "velocity": 1.5} | impactor
    return entry(case_of(
        lamina=[wall], impactor=[impactor], contact=contact,
        excitation=FORCE | {"amplitude": 0.0, "frequency": 1.0 / seconds},
        time={"steps_per_period": 4000, "periods": 1},
        output={"window_periods": 1, "fields_per_period": 0},
    ))  # fmt: skip


def test_a_blow_of_an_impactor_on_its_spring() -> None:
    """Half a sine: F = v √(k m), length π √(m/k), impulse 2 m v."""
    k, seconds = 1e4, 0.06
    numbers = free_mass({"stiffness": k}, {"law": "penalty"}, seconds)
    assert (numbers["name"], numbers["kind"]) == ("impactor 1", "impactor")
    assert numbers["strikes_per_period"] == 1.0
    assert numbers["approach_velocity"] == pytest.approx(1.5, rel=1e-6)
    assert numbers["impulse"] == pytest.approx(2.0 * 2.0 * 1.5, rel=1e-4)
    assert numbers["peak_force"] == pytest.approx(1.5 * math.sqrt(k * 2.0), rel=1e-4)
    assert numbers["closed_share"] == pytest.approx(
        math.pi * math.sqrt(2.0 / k) / seconds, rel=2e-3
    )


def test_a_blow_of_a_ball_is_one_strike() -> None:
    """Hertz's force is F = k δ^1.5 at δ = (5 m v² / 4 k)^0.4; its springs are one contact."""
    k = 4.0 / 3.0 * 1e10 * math.sqrt(0.01)
    depth = (1.25 * 2.0 * 1.5**2 / k) ** 0.4
    numbers = free_mass({"radius": 0.01, "gap": 0.0}, {"law": "penalty"}, 4.4 * depth / 1.5)
    assert numbers["impulse"] == pytest.approx(2.0 * 2.0 * 1.5, rel=1e-2)
    assert numbers["peak_force"] == pytest.approx(k * depth**1.5, rel=2e-3)


def test_a_blow_of_a_rigid_impactor_is_an_impulse() -> None:
    contact = {"law": "newton", "restitution": 0.4, "impulse": "consistent"}
    numbers = free_mass({}, contact, 0.06)
    assert numbers["approach_velocity"] == pytest.approx(1.5, rel=1e-9)
    assert numbers["impulse"] == pytest.approx(1.4 * 2.0 * 1.5, rel=1e-6)
    assert numbers["peak_force"] is None


@pytest.mark.slow
@pytest.mark.parametrize("mass", ["consistent", "massless"])
def test_a_beam_on_a_stop_has_the_impulse_and_the_force_of_a_sensor(mass: str) -> None:
    """Two places that compute the force of a stop agree, whatever the contact points weigh."""
    beam = {
        "name": "one", "length": 0.5, "width": 0.02, "thickness": 0.002, "mass_per_length": 0.1,
        "bending_stiffness": 10.0, "damping_ratio": 0.02,
    }  # fmt: skip
    stop = {"lamina": "one", "position": 0.5, "side": "above", "gap": 2e-4, "on": "ground"}
    contact: dict[str, Any] = {"law": "newton", "restitution": 0.0}
    if mass == "consistent":
        contact, stop = {"law": "penalty"}, stop | {"stiffness": 2000.0}
    time = {"steps_per_period": 2000, "periods": 20, "mass": mass}
    result = df.run(case_of(
        lamina=[beam], stop=[stop], contact=contact, mesh={"elements": 8},
        excitation={"kind": "force", "lamina": "one", "position": 0.5, "amplitude": 1.0,
                    "frequency": 20.0},
        sensor=[{"name": "push", "quantity": "contact force", "stop": 1}], time=time,
    ), engine="compiled")  # fmt: skip
    (numbers,) = result.summary["contacts"]
    force = result.history["sensor_push"].to_numpy()
    step = result.case.time_step
    assert numbers["peak_force"] == pytest.approx(force.max(), rel=1e-9)
    strikes = numbers["strikes_per_period"] * WINDOW
    assert strikes > 0 and numbers["approach_velocity"] > 0.0
    assert numbers["impulse"] * strikes == pytest.approx(force.sum() * step, rel=1e-9)
    assert 0.0 < numbers["closed_share"] < 0.5


def test_an_interface_is_struck_as_often_as_its_probes_meet() -> None:
    for law in ("newton", "penalty"):
        result = df.run(df.preset("paper", {"contact.law": law, "time.periods": 20}), "compiled")
        (numbers,) = result.summary["contacts"]
        assert numbers["kind"] == "interface"
        assert numbers["strikes_per_period"] == result.summary["tip_contacts_per_period"] > 0.0
        periods = result.case.n_window_periods
        total = numbers["impulse"] * numbers["strikes_per_period"] * periods
        if law == "newton":
            assert total == pytest.approx(float(result.history["event_impulse"].sum()), rel=1e-12)
            assert numbers["peak_force"] is None
        else:
            sensor = {"name": "push", "quantity": "contact force", "between": ["thick", "thin"]}
            every = df.run(result.case.with_overrides({"sensor": [sensor]}), "compiled")
            (exact,) = every.summary["contacts"]  # from every step, not from the frames
            force = every.history["sensor_push"].to_numpy()
            assert exact["peak_force"] == pytest.approx(force.max(), rel=1e-9)
            sum_of_steps = float(force.sum()) * result.case.time_step
            count = exact["strikes_per_period"] * periods
            assert exact["impulse"] * count == pytest.approx(sum_of_steps, rel=1e-9)
            assert total == pytest.approx(sum_of_steps, rel=0.03)
            assert 0.9 * exact["peak_force"] < numbers["peak_force"] <= exact["peak_force"]


def test_without_a_law_nothing_is_a_contact() -> None:
    stop = {"lamina": "one", "side": "above", "gap": GAP}
    case = case_of(stop=[stop], contact={"law": "none"})
    assert df.run(case, engine="compiled").summary["contacts"] == []


@pytest.mark.slow
def test_contacts_are_read_back_and_damaged_ones_refused(tmp_path: Path) -> None:
    stop = {"lamina": "one", "side": "above", "gap": GAP}
    time = {"steps_per_period": 200, "periods": 4}
    case = case_of(stop=[stop], contact={"law": "newton", "restitution": 0.5}, time=time)
    result = df.run(case, engine="compiled")
    result.save(tmp_path)
    _, _, summary = load_numbers(tmp_path)
    assert summary["contacts"] == result.summary["contacts"]
    path = tmp_path / "summary.json"
    numbers = json.loads(path.read_text("utf-8"))
    for damaged in ("none", [{"name": "stop 1"}], [numbers["contacts"][0] | {"impulse": "much"}]):
        path.write_text(json.dumps(numbers | {"contacts": damaged}), "utf-8")
        assert "contacts" in refusal(lambda: load_numbers(tmp_path))

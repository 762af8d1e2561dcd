"""Signals of sensors: the motion that the engine computes, sampling, noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem.simulation.signals import low_passed

N = 500
SENSORS: list[dict[str, Any]] = [
    {"name": "d", "quantity": "displacement", "lamina": "thin", "position": 0.685},
    {"name": "v", "quantity": "velocity", "lamina": "thin", "position": "300 mm"},
    {"name": "a", "quantity": "acceleration", "lamina": "thin", "position": 0.3},
    {"name": "f", "quantity": "contact force", "between": ["thick", "thin"]},
    {**{"quantity": "velocity", "lamina": "thin", "position": 0.3}, "name": "slow",
     "sampling_rate": 400.0, "noise": 1e-3, "seed": 4},
]  # fmt: skip
KEYS = {"time.steps_per_period": N, "time.periods": 2, "output.window_periods": 2}


def run(engine: str = "compiled", **keys: object) -> Any:
    """Return a short run with all sensors; keys are those of `contact`."""
    contact = {f"contact.{key}": value for key, value in keys.items()}
    case = df.preset("paper", {**KEYS, **contact, "sensor": SENSORS})
    return df.run(case, engine)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def springs() -> Any:
    """Return a run with impacts and springs."""
    return run(penalty_stiffness=2000.0, threshold_velocity=0.02, impulse="consistent")


def test_motion_is_that_of_the_probe(springs: Any) -> None:
    history = springs.history
    np.testing.assert_array_equal(history["sensor_d"], history["tip_displacement"][1])
    assert history["sensor_d"].dims == ("time",)
    assert history["sensor_a"].attrs["units"] == "m/s2"
    assert history["sensor_f"].attrs["long_name"] == "contact force between thick and thin"


@pytest.mark.parametrize(
    "keys",
    [
        {"law": "none"},
        {"law": "penalty", "penalty_stiffness": 2000.0, "penalty_damping": 1.0},
        {"penalty_stiffness": 2000.0, "threshold_velocity": 0.02, "impulse": "consistent"},
        {"penalty_stiffness": 2000.0, "threshold_velocity": 0.02, "impulse": "lumped"},
    ],
)
def test_acceleration_is_that_of_the_scheme(keys: dict[str, object]) -> None:
    """Newmark: Δv = Δt/2 (a + a⁺) in each step at whose ends no spring is switched.

    Switching makes the force jump at one end. Steps with impacts are left out: there the velocity
    jumps. In a good part of the other steps springs are closed, so a wrong sign of their force or
    a wrong set of resting pairs shows.
    """
    history = run(**keys).history
    v, a, f = (history[f"sensor_{name}"].values for name in "vaf")
    dt = float(history["time"][1] - history["time"][0])
    error = np.abs(np.diff(v) - 0.5 * dt * (a[1:] + a[:-1]))
    hit = np.zeros(v.size, dtype=bool)
    hit[np.rint(history["event_time"].values / dt).astype(int) - 1] = True
    smooth = ~hit[1:] & ~hit[:-1]
    in_contact = smooth & (np.abs(f[1:]) > 0.0) & (np.abs(f[:-1]) > 0.0)
    good = error < 1e-9 * np.abs(v).max() + 1e-7 * dt * np.abs(a[1:])
    if keys.get("law") == "none":
        assert good.all() and not f.any()
        return
    assert f.max() > 0.01
    assert in_contact.sum() > 20
    assert good[in_contact].mean() > 0.5  # in the others a spring is switched
    assert good[smooth].mean() > 0.9


def test_contact_force_has_the_impulses() -> None:
    history = run(law="newton", impulse="consistent").history
    dt = float(history["time"][1] - history["time"][0])
    force = history["sensor_f"].values
    assert force.sum() * dt == pytest.approx(float(history["event_impulse"].sum()), rel=1e-12)
    steps = np.rint(history["event_time"].values / dt).astype(int) - 1
    assert set(np.flatnonzero(force)) == set(steps.tolist())


def test_both_engines_have_the_same_signals(springs: Any) -> None:
    keys = {"penalty_stiffness": 2000.0, "threshold_velocity": 0.02, "impulse": "consistent"}
    other = run("petsc", **keys).history
    for name in "dvaf":
        expected = springs.history[f"sensor_{name}"].values[:100]
        scale = np.abs(expected).max() + 1e-12
        assert np.abs(other[f"sensor_{name}"].values[:100] - expected).max() < 1e-6 * scale


def test_sampling_and_noise(springs: Any) -> None:
    slow, time = springs.history["sensor_slow"], springs.history["sensor_slow_time"]
    assert slow.dims == ("sensor_slow_time",) and time.attrs["units"] == "s"
    np.testing.assert_allclose(np.diff(time), 1.0 / 400.0, rtol=1e-9)
    np.testing.assert_allclose(time * 400.0, np.rint(time * 400.0), atol=1e-6)
    full = springs.history["sensor_v"]
    smooth = low_passed(full.values, 400.0 * float(full["time"][1] - full["time"][0]))
    rest = slow.values - np.interp(time, full["time"], smooth)
    assert 0.8e-3 < rest.std() < 1.3e-3
    again = run(penalty_stiffness=2000.0, threshold_velocity=0.02, impulse="consistent").history
    np.testing.assert_array_equal(again["sensor_slow"], slow)


def test_groups_have_tables(springs: Any) -> None:
    from delam_fem.results.dataset import grouped

    groups = grouped(springs.history)
    assert "sensor_d" in groups["history"] and list(groups["sensor_slow"]) == ["sensor_slow"]
    assert len(groups["sensor_slow"].to_dataframe()) == springs.history["sensor_slow"].size


@pytest.mark.parametrize(("frequency", "gain"), [(0.0, 1.0), (0.35, 1.0), (0.55, 0.0), (2.0, 0.0)])
def test_filter(frequency: float, gain: float) -> None:
    """What is below 0.4 of the rate passes, what is above 0.5 does not fold back (-60 dB)."""
    rate, steps = 0.05, np.arange(4000)
    signal = np.cos(2.0 * np.pi * frequency * rate * steps)
    inner = slice(1000, 3000)
    assert np.abs(low_passed(signal, rate) - gain * signal)[inner].max() < 2e-3
    assert low_passed(signal, 1.0) is signal

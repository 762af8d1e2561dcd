"""Records of every quantity, computed from formulas, lie on their run as the formulas say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import delam_fem as df
from delam_fem.api import Result
from delam_fem.results.schema import add
from delam_fem.studies.signals.overlay import Overlay

STEPS, WINDOW, ORDERS = 1000, 4, 300
CASE = df.preset("paper", {
    "time.steps_per_period": STEPS, "time.periods": 50, "output.window_periods": WINDOW,
    "output.fields_per_period": 0, "mesh.elements": 5,
})  # fmt: skip
PERIOD = CASE.period
OMEGA = 2.0 * np.pi / PERIOD
START, RATE, DURATION = 14.3217, 1000.0, 6.0
"""Time of the run at the first sample [s], samples per second, length of the record [s]."""
TIME = np.arange(int(DURATION * RATE)) / RATE
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2", "strain": "1",
         "force": "N"}  # fmt: skip
DECAYS = {"displacement": 2.2, "velocity": 1.2, "acceleration": 0.2, "strain": 1.5, "force": 0.5}
"""Harmonic k has 0.4 k^-d of the first: of an acceleration all are nearly alike, as of clicks."""
SIZES = {"displacement": 1e-2, "velocity": 0.2, "acceleration": 4.0, "strain": 1e-4, "force": 3.0}
NOISE = {name: 0.05 * size for name, size in SIZES.items()}
SIGMAS = 4.0
"""Deviations within which an estimate must be: one in 16 000 fails by chance; the seed is fixed."""
QUANTITIES = sorted(UNITS)
NAMES = {quantity: "push" if quantity == "force" else quantity for quantity in UNITS}
"""A channel "force" is that of the drive."""
BELOW_HALF_THE_RATE = int(0.5 * RATE * PERIOD)


def coefficients(quantity: str) -> np.ndarray:
    k = np.arange(1, ORDERS + 1)
    size = SIZES[quantity] * k ** -DECAYS[quantity] * np.where(k > 1, 0.4, 1.0)
    return np.asarray(size * np.exp(1j * (0.3 + 0.7 * k)))


def signal(quantity: str, time: np.ndarray, n_orders: int = ORDERS) -> np.ndarray:
    k = np.arange(1, n_orders + 1)
    return np.real(np.exp(1j * OMEGA * np.outer(time, k)) @ coefficients(quantity)[:n_orders])


def base(time: np.ndarray, quantity: str) -> np.ndarray:
    amplitude, turn = CASE.excitation.amplitude, OMEGA * time
    return np.asarray({
        "displacement": amplitude * np.sin(turn),
        "velocity": amplitude * OMEGA * np.cos(turn),
        "acceleration": -amplitude * OMEGA**2 * np.sin(turn),
    }[quantity])  # fmt: skip


def run() -> Result:
    time = (46 * STEPS + 1 + np.arange(WINDOW * STEPS)) * PERIOD / STEPS
    history = xr.Dataset(coords={"lamina": ["thick", "thin"]})
    tips = np.array([signal("displacement", time)] * 2)
    add(history, time=time, tip_displacement=tips, base_displacement=base(time, "displacement"))
    for quantity in QUANTITIES:
        about = {"units": UNITS[quantity], "quantity": quantity}
        history[f"sensor_{NAMES[quantity]}"] = ("time", signal(quantity, time), about)
    return Result(CASE, history, {"periodicity": 1}, None)


RUN = run()


def record(
    folder: Path, quantities: list[str], of_base: str = "", *, late: float = 0.0, rng_seed: int = 3
) -> Path:
    """Write a filtered record: it has nothing above half its rate."""
    rng, at = np.random.default_rng(rng_seed), START + TIME
    columns, heading = [TIME], ["time [s]"]
    for quantity in quantities:
        clean = signal(quantity, at - late, BELOW_HALF_THE_RATE)
        columns.append(clean + rng.normal(0.0, NOISE[quantity], at.size))
        heading.append(f"{NAMES[quantity]} [{UNITS[quantity]}]")
    if of_base:
        clean = base(at, of_base)
        columns.append(clean + rng.normal(0.0, 0.02 * np.abs(clean).max(), at.size))
        heading.append(f"base [{UNITS[of_base]}]")
    path = folder / "record.csv"
    np.savetxt(path, np.array(columns).T, "%.12g", ",", header=",".join(heading), comments="")
    return path


def wrapped(difference: float) -> float:
    return (difference + PERIOD / 2) % PERIOD - PERIOD / 2


def distortion(quantity: str) -> float:
    a = np.abs(coefficients(quantity))[:BELOW_HALF_THE_RATE]
    return float(np.sqrt((a**2).sum()) / a[0] - 1.0)


def check(found: Overlay, quantity: str) -> None:
    """Compare what an overlay says of a channel with the formulas."""
    channel = found.numbers["channels"][NAMES[quantity]]
    assert channel["noise_rms"] == pytest.approx(NOISE[quantity], rel=0.04)
    assert abs(channel["gain"] - 1.0) < max(SIGMAS * channel["gain_error"], 1e-3)
    assert channel["phase_degrees_error"] < 0.5
    assert abs(channel["phase_degrees"]) < SIGMAS * channel["phase_degrees_error"]
    assert channel["residual_rms"] >= channel["noise_rms"]
    assert channel["misfit_rms"] < 0.3 * channel["noise_rms"]
    exact = distortion(quantity)
    assert channel["distortion_computed"] == pytest.approx(exact, rel=1e-2)
    error = channel["distortion_measured_error"]
    assert abs(channel["distortion_measured"] - exact) < SIGMAS * error + 1e-3 * exact
    amplitudes = np.abs(coefficients(quantity))[:10]
    assert channel["harmonics_computed"] == pytest.approx(amplitudes, rel=1e-2)
    assert channel["harmonics_measured"] == pytest.approx(
        amplitudes, abs=SIGMAS * channel["harmonic_noise"]
    )


@pytest.mark.parametrize("of_base", ["", "displacement", "acceleration"])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_a_record_of_each_quantity(tmp_path: Path, quantity: str, of_base: str) -> None:
    comparison = df.overlay(RUN, record(tmp_path, [quantity], of_base))
    check(comparison, quantity)
    assert comparison.numbers["verdict"] == "agrees" and not comparison.pairs.unmatched
    assert abs(wrapped(comparison.offset - START)) < SIGMAS * comparison.alignment.start_error


@pytest.mark.parametrize("of_base", ["displacement", "velocity", "acceleration"])
def test_a_sensor_on_the_base_is_the_base_whatever_it_measures(
    tmp_path: Path, of_base: str
) -> None:
    """It gives the clock of the run, so that a late channel is seen as late."""
    late = 10.0 / 360.0 * PERIOD
    comparison = df.overlay(RUN, record(tmp_path, ["velocity"], of_base, late=late))
    drive = next(channel for channel in comparison.channels if channel.is_drive)
    assert drive.name == "base" and not comparison.pairs.unmatched
    assert abs(wrapped(comparison.offset - START)) < SIGMAS * comparison.alignment.start_error
    assert drive.gain == pytest.approx(1.0, abs=2e-3)
    velocity = comparison.numbers["channels"]["velocity"]
    error = velocity["phase_degrees_error"]
    assert velocity["phase_degrees"] == pytest.approx(10.0, abs=SIGMAS * error)
    assert [finding.kind for finding in comparison.findings] == ["phase"]


def test_a_record_that_was_not_filtered_is_compared_with_all_of_the_run(tmp_path: Path) -> None:
    """Each fourth step of the run itself: what is above half of that rate is folded down."""
    rng, time = np.random.default_rng(4), 4.0 * PERIOD / STEPS * np.arange(5000)
    values = signal("acceleration", 46 * PERIOD + time)
    values += rng.normal(0.0, NOISE["acceleration"], time.size)
    path = tmp_path / "record.csv"
    np.savetxt(path, np.array([time, values]).T, "%.12g", ",",
               header="time [s],acceleration [m/s2]", comments="")  # fmt: skip
    channel = df.overlay(RUN, path).numbers["channels"]["acceleration"]
    assert channel["gain"] == pytest.approx(1.0, abs=0.02)
    assert channel["noise_rms"] == pytest.approx(NOISE["acceleration"], rel=0.05)
    assert channel["noise_rms"] <= channel["residual_rms"]
    assert abs(channel["phase_degrees"]) < SIGMAS * channel["phase_degrees_error"]


def test_what_does_not_repeat_is_noise_whatever_its_spectrum(tmp_path: Path) -> None:
    """A hum between the harmonics, and a drift: neither is part of the motion."""
    hum = 0.3 * SIZES["acceleration"] * np.sin(2.0 * np.pi * 50.7 * TIME)
    hum += 0.2 * SIZES["acceleration"] * (TIME / DURATION - 0.5)
    clean = signal("acceleration", START + TIME, BELOW_HALF_THE_RATE)
    path = tmp_path / "record.csv"
    np.savetxt(path, np.array([TIME, clean + hum]).T, "%.12g", ",",
               header="time [s],acceleration [m/s2]", comments="")  # fmt: skip
    channel = df.overlay(RUN, path).numbers["channels"]["acceleration"]
    assert channel["noise_rms"] == pytest.approx(float(hum.std()), rel=0.05)

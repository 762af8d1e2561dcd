"""Every channel in every study, beside exact motions of a mass on a spring and a stop.

A mass hangs on a moving base by a spring and strikes an elastic stop on the ground once a period.
The equation is integrated here to ten digits. A cantilever that a slow force bends has the strain
F (L - x) h / (2 E I). A free mass that strikes another gives it (1 + e) v m M / (m + M).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.io import loadmat
from support import refusal

import delam_fem as df
from delam_fem import diagram
from delam_fem.results.figures.run import Plots
from delam_fem.studies.diagrams import DiagramName
from delam_fem.studies.identification.identify import Experiment, Unknown
from delam_fem.studies.orbits.newton import Perturbations
from delam_fem.studies.orbits.run import PeriodicOrbit

M, K, D, A, GAP, STOP, FREQUENCY = 0.5, 800.0, 0.1, 2e-3, 1.5e-3, 3000.0, 7.0
"""Mass [kg], springs [N/m], damping ratio, base and gap [m], frequency of the drive [Hz]."""
C = 2.0 * D * math.sqrt(K * M)
OMEGA = 2.0 * math.pi * FREQUENCY
STEPS, PERIODS = 1000, 40
PLACE = {"lamina": "one", "position": 1.0}
SENSORS = [
    *({"name": name, **PLACE, "quantity": name} for name in ("velocity", "acceleration")),
    {"name": "cell", "quantity": "contact force", "stop": 1},
]
CASE = df.Case(
    name="one", lamina=[{"name": "one", "mass": M, "stiffness": K, "damping_ratio": D}],
    mesh={"elements": 1}, contact={"law": "penalty"}, sensor=SENSORS,
    excitation={"kind": "harmonic", "frequency": FREQUENCY, "amplitude": A},
    stop=[{"lamina": "one", "side": "above", "gap": GAP, "on": "ground", "stiffness": STOP}],
    time={"steps_per_period": STEPS, "periods": PERIODS},
    output={"window_periods": 4, "fields_per_period": 2},
)  # fmt: skip
CHANNELS = {
    "displacement": "tip_one", "velocity": "velocity", "acceleration": "acceleration",
    "contact force": "cell", "stop": "contact_stop 1", "base": "base",
}  # fmt: skip
"""Names of the channels by what they are."""
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2", "contact force": "N",
         "stop": "N", "base": "m"}  # fmt: skip
CLOSE = 5e-3
"""Relative error of T/1000 where an elastic stop closes within a step."""

L, H, B, E, F = 0.4, 2e-3, 0.02, 70e9, 0.05
BENT = df.Case(
    name="bent",
    lamina=[{"name": "one", "length": L, "width": B, "thickness": H, "density": 2700.0,
             "young_modulus": E, "damping_ratio": 0.02}],
    mesh={"elements": 4}, contact={"law": "none"},
    excitation={"kind": "force", "lamina": "one", "position": L, "amplitude": F, "frequency": 0.1},
    sensor=[{"name": "gauge", "lamina": "one", "position": 0.1, "quantity": "strain"}],
    time={"steps_per_period": 400, "periods": 6}, output={"window_periods": 2},
)  # fmt: skip
STRAIN = F * (L - 0.1) * H / 2.0 / (E * B * H**3 / 12.0)

BALL, SPEED, RESTITUTION = 0.02, 0.3, 0.4
BLOW = df.Case(
    name="blow", lamina=[{"name": "one", "mass": M, "stiffness": K, "damping_ratio": D}],
    mesh={"elements": 1}, contact={"law": "newton", "restitution": RESTITUTION},
    excitation={"kind": "harmonic", "frequency": 20.0, "amplitude": 0.0},
    impactor=[{"lamina": "one", "mass": BALL, "velocity": SPEED}],
    time={"steps_per_period": 500, "periods": 2}, output={"window_periods": 2},
)  # fmt: skip
IMPULSE = (1.0 + RESTITUTION) * SPEED * BALL * M / (BALL + M)


@cache
def exact() -> Callable[[np.ndarray], dict[str, np.ndarray]]:
    """Return the function that gives the exact channels at times of the last periods."""

    def force(u: np.ndarray) -> np.ndarray:
        return STOP * np.maximum(u - GAP, 0.0)

    def rates(t: float, y: np.ndarray) -> list[float]:
        q, q_rate = A * math.sin(OMEGA * t), A * OMEGA * math.cos(OMEGA * t)
        return [y[1], (-K * (y[0] - q) - C * (y[1] - q_rate) - force(y[0])) / M]

    end = PERIODS / FREQUENCY
    solution = solve_ivp(rates, (0.0, end), [0.0, 0.0], "DOP853", rtol=1e-10, atol=1e-13,
                         dense_output=True, max_step=1e-3)  # fmt: skip

    def channels(t: np.ndarray) -> dict[str, np.ndarray]:
        u, v = solution.sol(t)
        q, q_rate = A * np.sin(OMEGA * t), A * OMEGA * np.cos(OMEGA * t)
        a = (-K * (u - q) - C * (v - q_rate) - force(u)) / M
        return {"displacement": u, "velocity": v, "acceleration": a, "contact force": force(u),
                "stop": force(u), "base": q}  # fmt: skip

    return channels


def of_window(what: str, periods: int = 4) -> np.ndarray:
    t = (PERIODS - periods + np.arange(1, periods * STEPS + 1) / STEPS) / FREQUENCY
    return exact()(t)[what]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@cache
def run() -> df.Result:
    return df.run(CASE, engine="compiled")


@pytest.mark.parametrize("what", CHANNELS)
class TestOscillator:
    """The channels of a mass on a stop."""

    def test_summary(self, what: str) -> None:
        entry = run().summary["channels"][CHANNELS[what]]
        values = of_window(what)
        expected = {"min": values.min(), "max": values.max(), "amplitude": np.ptp(values) / 2.0,
                    "rms": rms(values)}  # fmt: skip
        size = float(np.abs(values).max())
        for key, value in expected.items():
            assert entry[key] == pytest.approx(value, abs=CLOSE * size), key
        assert entry["units"] == UNITS[what]

    def test_page_and_figures(self, what: str, tmp_path: Path) -> None:
        from delam_fem.results.pages.report import channel_rows

        rows = {row[0]: row for row in channel_rows(run().history, CASE)}
        text = rows[CHANNELS[what]][3].replace("−", "-").split()[0]
        factor = 1e3 if UNITS[what] == "m" else 1.0
        assert float(text) == pytest.approx(factor * of_window(what).max(), rel=CLOSE)
        plots = Plots(run().history, CASE)
        (axes, *_) = plots.channel_spectra(CHANNELS[what]).axes
        orders, amplitudes = axes.lines[0].get_data()
        line = 2.0 * np.abs(np.fft.rfft(of_window(what))[4]) / (4 * STEPS)
        first = amplitudes[np.argmin(np.abs(orders - 1.0))]
        assert first == pytest.approx(factor * line, rel=CLOSE)

    def test_export(self, what: str, tmp_path: Path) -> None:
        """A record in a file is that of the run; the force of the stop goes to MATLAB as well."""
        path = df.write_record(run().record, tmp_path / "record.nc")
        values = df.read_record(path)[CHANNELS[what]].to_numpy()
        np.testing.assert_array_equal(values, run().record[CHANNELS[what]])
        measured = df.read_measured(path)
        assert UNITS[what] in measured["channel_units"]
        (exported,) = run().export("mat", tmp_path / "run.mat")
        variables = {"displacement": "tip_displacement", "stop": "contact_force",
                     "base": "base_displacement", "contact force": "sensor_cell"}  # fmt: skip
        row = np.ravel(loadmat(exported)[variables.get(what, f"sensor_{what}")])
        np.testing.assert_allclose(row, values)

    @pytest.mark.slow
    def test_converge(self, what: str, converged: Any) -> None:
        name = CHANNELS[what]
        levels = converged.refinement.along_steps(converged.refinement.methods[0], 1)
        errors = [
            abs(converged.value(level, f"{name}:rms") / rms(of_window(what)) - 1.0)
            for level in levels
        ]
        assert errors[-1] < CLOSE
        assert errors[-1] < errors[0] or what == "base"

    @pytest.mark.slow
    def test_sweep(self, what: str, swept: xr.Dataset) -> None:
        name = CHANNELS[what]
        values = of_window(what)
        assert float(swept[f"{name}_rms"][0]) == pytest.approx(rms(values), rel=CLOSE)
        first = 2.0 * np.abs(np.fft.rfft(values)[4]) / values.size
        amplitude = float(swept[f"{name}_harmonic_amplitude"][0, 0])
        assert amplitude == pytest.approx(first, rel=CLOSE)
        assert swept[f"{name}_rms"].attrs["units"] == UNITS[what]
        ends = swept[f"{name}_strobe"][0, -4:]
        size = float(np.abs(values).max())
        np.testing.assert_allclose(ends, values[STEPS - 1 :: STEPS], atol=CLOSE * size)

    @pytest.mark.slow
    def test_diagrams(self, what: str, swept: xr.Dataset) -> None:
        """Points of the first amplitude are the exact ones, in the unit of the axis."""
        name = CHANNELS[what]
        factor = 1e3 if UNITS[what] == "m" else 1.0
        values = factor * of_window(what)
        drawn = {"response": np.ptp(values) / 2.0, "bifurcation": values[-1]}
        kinds: tuple[DiagramName, ...] = ("response", "bifurcation")
        for kind in kinds:
            (panel,) = diagram(kind, swept, [name]).axes
            assert panel.get_title("left") == name
            points = panel.lines[0].get_ydata()
            size = float(np.abs(values).max())
            assert float(
                points[0 if kind == "response" else swept.sizes["strobe"] - 1]
            ) == pytest.approx(drawn[kind], abs=CLOSE * size)

    @pytest.mark.slow
    def test_orbit(self, what: str, found: PeriodicOrbit) -> None:
        """The orbit is the settled motion, from another instant on."""
        values = of_window(what, 1)
        entry = found.numbers["channels"][CHANNELS[what]]
        size = float(np.abs(values).max())
        for key, value in {"min": values.min(), "max": values.max(), "rms": rms(values)}.items():
            assert entry[key] == pytest.approx(value, abs=CLOSE * size), key
        assert entry["units"] == UNITS[what]
        steps = round(found.numbers["phase"] * STEPS)
        later = np.roll(values, -steps)
        np.testing.assert_allclose(found.histories[CHANNELS[what]], later, atol=2.0 * CLOSE * size)

    @pytest.mark.slow
    def test_overlay(self, what: str, tmp_path: Path) -> None:
        """An exact record of the channel alone, which begins at another time."""
        t = np.arange(2500) / 2000.0
        values = exact()(t + (PERIODS - 10.3) / FREQUENCY)[what]
        name = "tip one" if what == "displacement" else CHANNELS[what]
        path = tmp_path / "record.csv"
        np.savetxt(path, np.column_stack([t, values]), "%.12g", ",", comments="",
                   header=f"time [s],{name} [{UNITS[what]}]")  # fmt: skip
        overlay = df.overlay(run(), path)
        (channel,) = overlay.channels
        assert channel.gain == pytest.approx(1.0, abs=CLOSE)
        assert channel.correlation > 0.999
        shift = (overlay.offset - (PERIODS - 10.3) / FREQUENCY) * FREQUENCY
        assert (shift + 0.5) % 1.0 - 0.5 == pytest.approx(0.0, abs=1e-3)

    @pytest.mark.slow
    def test_identify(self, what: str, fitted: np.ndarray) -> None:
        """What a fit reads of a channel are its harmonics."""
        first, second = np.abs(fitted[[*CHANNELS].index(what), :2])
        lines = 2.0 * np.abs(np.fft.rfft(of_window(what))) / (4 * STEPS)
        assert first == pytest.approx(lines[4], rel=CLOSE)
        assert second == pytest.approx(lines[8], abs=CLOSE * lines[4])


@pytest.mark.parametrize("units", [*dict.fromkeys(UNITS.values()), "1"])
def test_response(units: str) -> None:
    """What is three times the force has the response 3, in its own unit over N; "1": a strain."""
    from delam_fem.studies.signals.responses import with_responses

    x = np.random.default_rng(2).normal(size=4096)
    data = xr.Dataset(
        {"force": ("time", x), "sensor_y": ("time", 3.0 * x),
         "channel_variable": ("channel", ["force", "sensor_y"]),
         "channel_units": ("channel", ["N", units]),
         "channel_lamina": ("channel", ["", ""])},
        {"time": np.arange(4096) / 1000.0, "channel": ["force", "y"]},
    )  # fmt: skip
    response = with_responses(data, "force", segment=0.5)["response"]
    np.testing.assert_allclose(response[1:-1, 0], 3.0, rtol=1e-9)


@pytest.fixture(scope="module")
def converged(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return df.converge(
        CASE, tmp_path_factory.mktemp("refinement"), of=[*CHANNELS.values()],
        steps=(125, 250, 500, 1000), limit_steps=2000, periods=4, workers=1,
    )  # fmt: skip


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    folder = tmp_path_factory.mktemp("swept")
    (folder / "case.toml").write_text(CASE.to_toml())
    names = ", ".join(f'"{name}"' for name in CHANNELS.values())
    (folder / "sweep.toml").write_text(
        'base = "case.toml"\n[[axis]]\nkey = "excitation.amplitude"\n'
        f"values = [{A}, {2 * A}]\n[record]\nharmonics = 2\nchannels = [{names}]\n"
    )
    return df.run_sweep(df.load_sweep(folder / "sweep.toml"), folder / "out", workers=1)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    return harmonics_of(CASE, FREQUENCY, [*CHANNELS.values()], tmp_path_factory.mktemp("fitted"))


def harmonics_of(case: df.Case, frequency: float, names: list[str], folder: Path) -> np.ndarray:
    """Return the harmonics of channels that a fit reads, shape (n_channels, HARMONICS)."""
    unknown = Unknown("lamina.one.damping_ratio", 0.001, 0.5)
    rig = Experiment(case, (frequency,), (unknown,), 1.0, channels=tuple(names))
    return rig.simulate(np.array([rig.truth]), folder, executor="serial")[0, 0]


@pytest.fixture(scope="module")
def found() -> PeriodicOrbit:
    few = Perturbations(copies=4)
    return df.orbit(CASE, settle=60, perturbations=few, channels=[*CHANNELS.values()])


def test_a_verdict_is_that_of_the_tips() -> None:
    """The other channels follow from the state that repeats when the tips do."""
    summary = run().summary
    assert (summary["settled"], summary["periodicity"]) == ("settled", 1)
    assert summary["judged_by"] == ["tip_one"]


def test_strain_in_summary_record_and_overlay(tmp_path: Path) -> None:
    result = df.run(BENT, engine="compiled")
    assert result.summary["channels"]["gauge"]["amplitude"] == pytest.approx(STRAIN, rel=2e-3)
    path = df.write_record(result.record, tmp_path / "record.nc")
    assert df.read_record(path)["gauge"].attrs["x"] == 0.1
    t = np.arange(2000) / 200.0
    np.savetxt(tmp_path / "g.csv",
               np.column_stack([t, 1e6 * STRAIN * np.sin(2 * np.pi * 0.1 * t)]), "%.12g", ",",
               header="time [s],gauge [µm/m]", comments="")  # fmt: skip
    (channel,) = df.overlay(result, tmp_path / "g.csv").channels
    assert abs(channel.gain) == pytest.approx(1.0, abs=5e-3)


def on_page(result: df.Result, name: str) -> float:
    """Return the largest value of a channel on the page of a run, in the unit of the page."""
    from delam_fem.results.pages.report import channel_rows

    rows = {row[0]: row for row in channel_rows(result.history, result.case)}
    return float(rows[name][3].split()[0].replace("−", "-"))


def test_strain_on_the_page_and_in_an_export(tmp_path: Path) -> None:
    result = df.run(BENT, engine="compiled")
    assert on_page(result, "gauge") == pytest.approx(1e6 * STRAIN, rel=2e-3)
    (axes, *_) = Plots(result.history, BENT).channel_spectra("gauge").axes
    orders, amplitudes = axes.lines[0].get_data()
    assert amplitudes[np.argmin(np.abs(orders - 1.0))] == pytest.approx(1e6 * STRAIN, rel=2e-3)
    (exported,) = result.export("mat", tmp_path / "run.mat")
    assert np.ptp(loadmat(exported)["sensor_gauge"]) / 2.0 == pytest.approx(STRAIN, rel=2e-3)


@pytest.mark.slow
def test_strain_in_a_sweep(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(BENT.to_toml())
    (tmp_path / "sweep.toml").write_text(
        'base = "case.toml"\n[[axis]]\nkey = "excitation.amplitude"\n'
        f'values = [{F}, {2 * F}]\n[record]\nsummary = false\nchannels = ["gauge"]\n'
    )
    swept = df.run_sweep(df.load_sweep(tmp_path / "sweep.toml"), tmp_path / "out", workers=1)
    np.testing.assert_allclose(swept["gauge_amplitude"], [STRAIN, 2.0 * STRAIN], rtol=2e-3)


@pytest.mark.slow
def test_strain_in_converge_orbit_and_fit(tmp_path: Path) -> None:
    study = df.converge(
        BENT, tmp_path / "refined", laws=["newton@newmark"], of=["gauge:amplitude"],
        steps=(100, 200, 400), limit_steps=0, periods=2, workers=1,
    )  # fmt: skip
    for level in study.refinement.along_steps(study.refinement.methods[0], 4):
        assert study.value(level, "gauge:amplitude") == pytest.approx(STRAIN, rel=2e-3)
    (first, *_) = harmonics_of(BENT, 0.1, ["gauge"], tmp_path / "fitted")[0]
    assert abs(first) == pytest.approx(STRAIN, rel=2e-3)
    few = Perturbations(copies=4)
    orbit = df.orbit(BENT, settle=10, perturbations=few, channels=["gauge"])
    assert np.ptp(orbit.histories["gauge"]) / 2.0 == pytest.approx(STRAIN, rel=2e-3)
    assert orbit.numbers["channels"]["gauge"]["units"] == "1"


@pytest.mark.slow
def test_a_fit_reads_the_impulse_of_an_impactor(tmp_path: Path) -> None:
    """One impulse I in two periods has the amplitude I / T at each harmonic."""
    (row,) = np.abs(harmonics_of(BLOW, 20.0, ["contact_impactor 1"], tmp_path))
    np.testing.assert_allclose(row, IMPULSE / BLOW.period, rtol=1e-3)


def test_blows_that_need_not_repeat_are_not_refined() -> None:
    said = refusal(lambda: df.converge(BLOW, of=["contact_impactor 1"]))
    assert "impactor" in said and "need not repeat" in said


def test_an_impactor_in_summary_and_record(tmp_path: Path) -> None:
    result = df.run(BLOW, engine="compiled")
    channel = result.record["contact_impactor 1"]
    assert float(channel.sum()) * BLOW.time_step == pytest.approx(IMPULSE, rel=1e-6)
    entry = result.summary["channels"]["contact_impactor 1"]
    assert entry["max"] * BLOW.time_step == pytest.approx(IMPULSE, rel=1e-6)
    again = df.read_record(df.write_record(result.record, tmp_path / "record.nc"))
    np.testing.assert_array_equal(again["contact_impactor 1"], channel)


def test_an_impactor_on_the_page_and_in_an_export(tmp_path: Path) -> None:
    result = df.run(BLOW, engine="compiled")
    assert on_page(result, "contact_impactor 1") == pytest.approx(
        IMPULSE / BLOW.time_step, rel=1e-3
    )
    (exported,) = result.export("mat", tmp_path / "run.mat")
    assert loadmat(exported)["event_impulse"].item() == pytest.approx(IMPULSE, rel=1e-6)


@pytest.mark.parametrize("begin", [0.0, -0.01, 0.001])
def test_a_load_cell_of_an_impactor_is_overlaid(begin: float, tmp_path: Path) -> None:
    """The blow of an elastic impactor is a half sine; its record begins at another time."""
    stiffness, gap = 2e4, 1e-3
    keys = {"impactor.1.stiffness": stiffness, "impactor.1.gap": gap}
    result = df.run(BLOW.with_overrides({"contact.law": "penalty", **keys}), engine="compiled")
    m = BALL * M / (BALL + M)
    omega = math.sqrt(stiffness / m)
    t = 1e-4 * np.arange(900)
    phase = omega * (t + begin - gap / SPEED)
    is_in_contact = (phase > 0.0) & (phase < math.pi)
    force = np.where(is_in_contact, SPEED * math.sqrt(stiffness * m) * np.sin(phase), 0.0)
    path = tmp_path / "cell.csv"
    np.savetxt(path, np.column_stack([t, force]), "%.12g", ",", comments="",
               header="time [s],contact_impactor 1 [N]")  # fmt: skip
    overlay = df.overlay(result, path)
    (channel,) = overlay.channels
    assert channel.gain == pytest.approx(1.0, abs=CLOSE)
    assert channel.correlation > 0.999
    assert overlay.offset == pytest.approx(begin, abs=2e-5)


def test_blows_that_need_not_repeat_have_no_orbit() -> None:
    assert "impactors that are all held" in refusal(
        lambda: df.orbit(BLOW, channels=["contact_impactor 1"])
    )


@pytest.mark.slow
def test_a_sweep_keeps_the_impulse_of_an_impactor(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(BLOW.to_toml())
    (tmp_path / "sweep.toml").write_text(
        'base = "case.toml"\n[[axis]]\nkey = "contact.restitution"\nvalues = [0.2, 0.6]\n'
        '[record]\nsummary = false\nstrobes = 0\nchannels = ["contact_impactor 1"]\n'
    )
    swept = df.run_sweep(df.load_sweep(tmp_path / "sweep.toml"), tmp_path / "out", workers=1)
    impulses = swept["contact_impactor 1_mean"] * 2.0 * BLOW.period
    expected = IMPULSE / (1.0 + RESTITUTION) * np.array([1.2, 1.6])
    np.testing.assert_allclose(impulses, expected, rtol=1e-6)


@pytest.mark.slow
def test_a_base_acceleration_in_g_aligns_two_accelerometers(tmp_path: Path) -> None:
    """Noise of 1 %, a clock 0.2 % off: the offset is within two of its errors in 45 of 50."""
    sensors = [*SENSORS, {"name": "a2", **PLACE, "quantity": "displacement"}]
    result = df.run(df.Case(**(CASE.model_dump() | {"sensor": sensors})), engine="compiled")
    rng = np.random.default_rng(11)
    n_inside = 0
    for _ in range(50):
        start = rng.uniform(30.0, 35.0) / FREQUENCY
        t = np.arange(1200) / 1500.0
        u = start + 1.002 * t
        exact_channels = exact()(u)
        base = -A * OMEGA**2 * np.sin(OMEGA * u) / 9.80665
        columns = [t, base, exact_channels["acceleration"], exact_channels["acceleration"]]
        noisy = [
            row + 0.01 * rms(row) * rng.normal(size=row.size) if k else row
            for k, row in enumerate(columns)
        ]
        np.savetxt(tmp_path / "r.csv", np.column_stack(noisy), "%.9g", ",", comments="",
                   header="time [s],base [g],acceleration [m/s2],tip one [m/s2]")  # fmt: skip
        overlay = df.overlay(result, tmp_path / "r.csv")
        assert len(overlay.channels) == 3 and overlay.channels[0].is_drive
        assert overlay.alignment.rate == pytest.approx(1.002, abs=5e-4)
        late = (overlay.offset - start) * FREQUENCY
        error = 2.0 * overlay.alignment.start_error * FREQUENCY
        n_inside += abs((late + 0.5) % 1.0 - 0.5) < error
    assert n_inside >= 45

"""Responses to multisines: best linear approximation, levels of distortions, noise, verdicts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import delam_fem as df
from delam_fem.api import CaseError, FloatArray, drive, preset
from delam_fem.case import broadband
from delam_fem.case.broadband import Lines
from delam_fem.cli.app import app
from delam_fem.studies.signals.distortions import distortions_of, with_distortions

DECIBELS = 0.5
"""Error of a level [dB]."""
N = 512
"""Samples of a period of the synthetic records."""


def multisine(seed: int, kind: str = "odd", top: int = 61) -> tuple[Any, FloatArray]:
    """Return the driven lines, and one period of samples of a multisine of rms 1."""
    numbers = broadband.line_numbers(1, top, kind, seed=1)
    phases = broadband.phases(numbers.size, "random", seed, 0)
    lines = Lines(numbers * 1.0, math.sqrt(2.0 / numbers.size) * np.exp(1j * phases))
    return numbers, lines.states(np.arange(N) / N)[:, 0]


def level(values: FloatArray) -> Any:
    """Return amplitudes at the lines 1, 2, … of one period."""
    return 2.0 * np.abs(np.fft.rfft(values))[1 : N // 2] / N


def test_lines_that_are_not_driven_have_the_levels_of_a_polynomial() -> None:
    """y = u + a u² + b u³: even lines have those of a u², odd ones of b u³, by their spectra."""
    numbers, u = multisine(3, "odd-random")
    y = u + 0.01 * u**2 + 0.02 * u**3
    result = distortions_of(np.tile(u, 3), np.tile(y, 3)[None], N)
    assert (np.flatnonzero(result.is_driven) + 1).tolist() == numbers.tolist()
    even, cubic = level(0.01 * u**2), level(0.02 * u**3)
    lines = np.arange(1, N // 2)
    is_even = (lines % 2 == 0) & (lines <= 120)
    left_out = (lines % 2 == 1) & (lines <= 180) & ~result.is_driven
    assert result.level[0][is_even] == pytest.approx(even[is_even], rel=1e-9, abs=1e-13)
    assert result.level[0][left_out] == pytest.approx(cubic[left_out], rel=1e-9, abs=1e-13)
    assert np.nanmax(result.level_noise) < 1e-14


def test_the_best_linear_approximation_of_a_cubic_is_its_mean_slope() -> None:
    """Of a normally distributed u of variance 1, y = u + b u³ has G = 1 + 3 b (Bussgang)."""
    b = 0.05
    blocks = [multisine(seed, "all")[1] for seed in range(60)]
    u = np.concatenate([np.tile(block, 2) for block in blocks])
    result = distortions_of(u, (u + b * u**3)[None], N, realisations=60)
    G = result.response[0]
    finite = 1.0 - 0.5 / 61.0  # of 61 lines u is nearly normal: E u⁴ = 3 - 3/(2·61)
    assert G.mean().real == pytest.approx(1.0 + 3.0 * b * finite, rel=1e-3)
    off = np.abs(G - G.mean()) / result.deviation[0]
    assert np.mean(off**2) == pytest.approx(1.0, abs=0.4)  # 61 lines, nearly independent
    # the scatter is that of b u³ without its linear part: var(u³) - 9 = 6
    scatter = math.sqrt(np.mean(result.scattered[0] ** 2) / 2.0)
    inside = level(u[:N] ** 3)  # a third of it lies above the band
    assert scatter == pytest.approx(b * math.sqrt(6.0 * 0.66 / 61.0), rel=0.1)
    assert inside[61:].any()


def test_noise_has_the_size_that_was_added() -> None:
    rng = np.random.default_rng(5)
    _, u = multisine(2)
    clean = np.tile(u, 40)
    noisy = clean + 0.1 * rng.standard_normal(clean.size)
    result = distortions_of(clean, noisy[None], N)
    expected = 0.1 * math.sqrt(2.0) * math.sqrt(2.0 / N) / math.sqrt(39.0)
    assert math.sqrt(np.mean(result.level_noise**2)) == pytest.approx(expected, rel=0.05)
    driven = result.noise[0] * math.sqrt(2.0 / 31.0)
    assert math.sqrt(np.mean(driven**2)) == pytest.approx(expected, rel=0.15)


def measurement(tmp_path: Path, step: float, **columns: FloatArray) -> xr.Dataset:
    """Return a measurement of forces and displacements as read from a file."""
    n = len(next(iter(columns.values())))
    names = ["time [s]", *(f"{k} [{'N' if k == 'force' else 'm'}]" for k in columns)]
    rows = np.column_stack([step * np.arange(n), *columns.values()])
    path = tmp_path / "record.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    return df.read_measured(path)


def test_a_polynomial_oscillator_has_its_known_distortions(tmp_path: Path) -> None:
    """ẍ + 2Dω ẋ + ω² x + a x² + b x³ = F: to first order the lines of -H (a x₁² + b x₁³)."""
    numbers = broadband.line_numbers(1, 40, "odd-random", seed=2)
    phases = broadband.phases(numbers.size, "random", 4, 0)
    force = Lines(numbers * 1.0, np.exp(1j * phases) * 10.0)
    w = 2.0 * math.pi * 14.3
    D = 0.05
    a, b = 4e3, 4e4

    def slope(t: float, y: FloatArray) -> list[float]:
        F = float(force.states([t])[0, 0])
        x, v = y
        return [v, F - 2 * D * w * v - w**2 * x - a * x**2 - b * x**3]

    end = 8.0
    times = np.arange(int(end) * N) / N
    solved = solve_ivp(slope, (0.0, end), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-12,
                       method="DOP853", max_step=0.01)  # fmt: skip
    late = times >= 4.0
    data = measurement(
        tmp_path, 1.0 / N, force=force.states(times)[late, 0], mass=solved.y[0, late]
    )
    result = with_distortions(data, "force", 1.0)
    omega = 2.0 * math.pi * np.arange(1, N // 2)
    H = 1.0 / (w**2 - omega**2 + 2j * D * w * omega)
    t = np.arange(N) / N
    x1 = Lines(numbers * 1.0, force.amplitude * H[numbers - 1]).states(t)[:, 0]
    spectra = [2.0 * np.fft.rfft(p)[1 : N // 2] / N for p in (a * x1**2, b * x1**3)]
    levels = result["line_level"].to_numpy()[:, 0]
    kind = result["line_kind"].to_numpy()
    assert result.attrs["is_linear"] == 0
    for number, spectrum in ((1, spectra[0]), (2, spectra[1])):
        known = np.abs(H * spectrum)[: levels.size]
        chosen = (kind == number) & (known > 1e-3 * known.max())
        off = 20.0 * np.log10(levels[chosen] / known[chosen])
        assert chosen.sum() >= 6
        assert np.median(np.abs(off)) < DECIBELS, off
    peak = np.abs(result["response"].to_numpy()[:, 0]).max()
    assert peak == pytest.approx(np.abs(H[numbers - 1]).max(), rel=0.01)


@pytest.mark.slow
def test_a_mass_on_a_stop_has_the_levels_of_its_own_integration() -> None:
    """m ẍ + c (ẋ - q̇) + k (x - q) = -K max(x - q - gap, 0): a stop on the base."""
    case = preset("default", {
        "lamina": [{"name": "beam", "mass": 0.1, "stiffness": 100.0, "damping_ratio": 0.05}],
        "gap": None, "mesh.elements": 1, "output": {},
        "stop": [{"lamina": "beam", "side": "above", "gap": 1e-3, "stiffness": 400.0}],
        "contact": {"law": "penalty", "penalty_stiffness": 400.0},
        "excitation": {"kind": "multisine", "low": 1.0, "high": 12.0, "spacing": 0.5, "rms": 1.5,
                       "lines": "odd"},
        "time": {"scheme": "newmark", "steps_per_period": 200, "periods": 20},
        "output.window_periods": 3,
    })  # fmt: skip
    history = df.run(case, "compiled").history
    motion = drive(case.excitation)
    w = math.sqrt(1000.0)

    def slope(t: float, y: FloatArray) -> list[float]:
        q, dq, _ = motion.states([t])[0]
        x, v = y
        push = 400.0 * max(x - q - 1e-3, 0.0)
        return [v, (-100.0 * (x - q) - 0.1 * 2 * 0.05 * w * (v - dq) - push) / 0.1]

    n = case.steps_per_period
    times = case.time_step * np.arange(14 * n + 1)
    solved = solve_ivp(slope, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-8, atol=1e-11,
                       max_step=2e-3)  # fmt: skip
    other = solved.y[0][12 * n + 1 :]
    base = motion.states(times[12 * n + 1 :])[:, 0]
    u = history["base_displacement"].to_numpy()[-2 * n :]
    x = history["tip_displacement"].to_numpy()[0, -2 * n :]
    run, exact = distortions_of(u, x[None], n), distortions_of(base, other[None], n)
    lines = np.arange(1, run.level.shape[1] + 1)
    chosen = (lines <= 40) & (exact.level[0] > 1e-3 * exact.level[0].max())
    assert (chosen & ~exact.is_driven).sum() >= 4  # even lines: what the stop adds
    off = 20.0 * np.log10(run.level[0] / exact.level[0])[chosen]
    assert np.abs(off).max() < DECIBELS, off


@pytest.mark.slow
@pytest.mark.parametrize("law", ["none", "newton-penalty"])
def test_a_run_that_claps_is_not_linear_and_has_no_poles(tmp_path: Path, law: str) -> None:
    case = preset("paper", {
        "excitation": {"kind": "multisine", "low": 0.5, "high": 8.0, "spacing": 0.1, "rms": 0.5,
                       "lines": "all"},
        "output": {}, "time": {"steps_per_period": 40, "periods": 30},
        "output.window_periods": 3, "mesh.elements": 6, "contact.law": law,
        "lamina.thick.damping_ratio": 0.05, "lamina.thin.damping_ratio": 0.05,
    })  # fmt: skip
    df.run(case, "compiled").save_numbers(tmp_path / "run")
    words = ["measure", "response", str(tmp_path / "run"), "--poles", "0.8", "5", "-o",
             str(tmp_path / "response")]  # fmt: skip
    said = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert said.exit_code == 0, said.output
    assert ("not printed" in said.output) == (law != "none")
    assert ("not linear" in said.output) == (law != "none")
    assert ("the run claps" in said.output) == (law != "none")
    assert {"responses.png", "distortions.png"} <= {p.name for p in tmp_path.glob("response/*")}
    if law == "none":
        assert "3.16" in said.output  # natural frequency of the thick lamina [Hz]


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    _, u = multisine(2)
    data = measurement(tmp_path, 1.0 / N, force=np.tile(u, 2), mass=np.tile(u, 2))
    with pytest.raises(CaseError, match="period: expected one of whole samples"):
        with_distortions(data, "force", 1.0013)
    with pytest.raises(CaseError, match=r"at least 3 period\(s\)"):
        with_distortions(data, "force", 1.0, realisations=3)
    with pytest.raises(CaseError, match="expected one of the histories"):
        with_distortions(data, "push", 1.0)


def test_a_burst_has_no_window_and_noise_has_densities(tmp_path: Path) -> None:
    """A mass on a spring: H at its peak, and S_x = |H|² S_f of white noise."""
    from delam_fem.studies.signals.responses import with_responses

    w, D, T = 2.0 * math.pi * 10.0, 0.05, 40.0
    numbers = np.arange(80, 1600)
    omega = 2.0 * math.pi * numbers / T
    H = 1.0 / (w**2 - omega**2 + 2j * D * w * omega)
    amplitude = broadband.random_amplitudes(np.ones(numbers.size), T, seed=3)
    t = np.arange(int(T) * 200) / 200.0
    force, motion = (Lines(numbers / T, c).states(t)[:, 0] for c in (amplitude, amplitude * H))
    data = with_responses(
        measurement(tmp_path, 1 / 200, force=force, mass=motion), "force", segment=5.0
    )
    f = data["frequency"].to_numpy()
    band = (f > 15.0) & (f < 35.0)
    assert data["psd_excitation"].to_numpy()[band].mean() == pytest.approx(1.0, rel=0.1)
    exact = np.abs(1.0 / (w**2 - (2 * np.pi * f) ** 2 + 2j * D * w * 2 * np.pi * f)) ** 2
    ratio = data["psd"].to_numpy()[band, 0] / exact[band]
    assert ratio.mean() == pytest.approx(1.0, rel=0.1)
    case = preset("default", {
        "lamina": [{"name": "beam", "mass": 0.1, "stiffness": 100.0, "damping_ratio": 0.05}],
        "gap": None, "mesh.elements": 1, "output": {}, "contact": {"law": "none"},
        "excitation": {"kind": "burst", "low": 1.0, "high": 12.0, "rms": 1.0, "duration": 20.0,
                       "share": 0.4},
        "time": {"scheme": "newmark", "steps_per_period": 200},
    })  # fmt: skip
    df.run(case, "compiled").save_numbers(tmp_path / "run")
    record = with_responses(df.read_measured(tmp_path / "run" / "result.nc"), "base_displacement")
    assert "burst" in record.attrs["notes"]
    f = record["frequency"].to_numpy()
    s = 2j * math.pi * f
    w0 = math.sqrt(1000.0)
    exact_h = (w0**2 + 2 * 0.05 * w0 * s) / (w0**2 + 2 * 0.05 * w0 * s + s**2)
    h = record["response"].to_numpy()[:, 0]
    inside = (f > 1.5) & (f < 11.0)
    assert np.abs(h - exact_h)[inside].max() < 2e-3 * np.abs(exact_h).max()

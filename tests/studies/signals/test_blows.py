"""Frequency responses by blows of a hammer, beside the exact ones of two oscillators."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.signal import chirp, max_len_seq
from typer.testing import CliRunner

from delam_fem import read_measured
from delam_fem.api import CaseError
from delam_fem.cli.app import app
from delam_fem.studies.signals.responses import poles, pulses, with_responses

RATE, BLOW = 4000.0, 0.004
"""Samples per second, and the duration of a blow [s]; 16 samples know its force to 0.3 %."""
MODES = ((25.0, 0.01, 1.0), (64.0, 0.008, -2.0))
"""Frequency [Hz], damping ratio and residue of each mode."""
FIVE = ((0.1, 1.0), (4.1, 0.7), (8.05, 1.3), (12.2, 0.9), (16.1, 1.1))
"""Start [s] and height [N] of five blows."""


def from_rest(t: np.ndarray, f: float, damping: float, p: float) -> np.ndarray:
    """Return x of x'' + 2 D w x' + w^2 x = sin(p t), x(0) = x'(0) = 0; zero before."""
    w = 2.0 * np.pi * f
    wd, u = w * np.sqrt(1.0 - damping**2), np.maximum(t, 0.0)
    g = 1.0 / (w**2 - p**2 + 2j * damping * w * p)
    x0, v0 = -g.imag, -(1j * p * g).imag
    free = x0 * np.cos(wd * u) + (v0 + damping * w * x0) / wd * np.sin(wd * u)
    return np.where(t > 0.0, (g * np.exp(1j * p * u)).imag + np.exp(-damping * w * u) * free, 0.0)


def record(
    duration: float,
    blows: tuple[tuple[float, float], ...],
    *,
    noise: tuple[float, float] = (0.0, 0.0),
    seed: int = 0,
) -> xr.Dataset:
    """Return force and response to half-sine blows, with noise as shares of the largest values."""
    t = np.arange(round(duration * RATE)) / RATE
    force, y = np.zeros(t.size), np.zeros(t.size)
    for start, height in blows:
        s, p = t - start, np.pi / BLOW
        force += height * np.where((s > 0.0) & (s < BLOW), np.sin(p * s), 0.0)
        for f, damping, residue in MODES:  # sin(p s) from 0, and again from its first zero on
            y += height * residue * from_rest(s, f, damping, p)
            y += height * residue * from_rest(s - BLOW, f, damping, p)
    rng = np.random.default_rng(seed)
    force += noise[0] * np.abs(force).max() * rng.normal(size=t.size)
    y += noise[1] * np.abs(y).max() * rng.normal(size=t.size)
    return xr.Dataset(
        {"force": ("time", force), "sensor_y": ("time", y),
         "channel_variable": ("channel", ["force", "sensor_y"]),
         "channel_units": ("channel", ["N", "m"]), "channel_lamina": ("channel", ["", ""])},
        {"time": t, "channel": ["force", "y"]},
    )  # fmt: skip


def exact(f: np.ndarray) -> np.ndarray:
    w = 2.0 * np.pi * f
    terms = [
        r / ((2.0 * np.pi * f0) ** 2 - w**2 + 2j * d * 2.0 * np.pi * f0 * w) for f0, d, r in MODES
    ]
    return np.sum(terms, axis=0)


def largest_error(found: xr.Dataset) -> float:
    """Return the largest error at both peaks and beside them, relative to the response there."""
    f = found["frequency"].to_numpy()
    ratio = found["response"].to_numpy()[:, 0] / exact(f)
    is_near = (abs(f - 25.0) < 1.5) | (abs(f - 64.0) < 2.5)
    return float(np.abs(ratio[is_near] - 1.0).max())


def are_the_modes(found: xr.Dataset, share: float) -> bool:
    """Return whether the poles are those of the modes, their damping within a share."""
    pytest.importorskip("sdypy.EMA")
    fitted_poles, _ = poles(found, 10.0, 100.0)
    assert [pole.frequency for pole in fitted_poles] == pytest.approx([25.0, 64.0], rel=1e-3)
    return [pole.damping for pole in fitted_poles] == pytest.approx([0.01, 0.008], rel=share)


def test_one_blow_needs_no_window_and_has_no_coherence() -> None:
    responses = with_responses(record(4.0, ((0.1, 1.0),)), "force")
    assert responses["frequency"].to_numpy()[1] == pytest.approx(1.0 / 3.9, rel=0.01)
    assert largest_error(responses) < 0.01
    assert are_the_modes(responses, 0.01)
    assert np.isnan(responses["coherence"].to_numpy()).all()
    assert "window" not in responses.attrs["notes"] and "means nothing" in responses.attrs["notes"]


@pytest.mark.parametrize("seed", range(3))
def test_five_blows_with_noise_are_averaged(seed: int) -> None:
    data = record(20.0, FIVE, noise=(0.005, 0.01), seed=seed)
    responses = with_responses(data, "force")
    f, coherence = responses["frequency"].to_numpy(), responses["coherence"].to_numpy()[:, 0]
    assert largest_error(responses) < 0.04  # 1 % of noise is 2 % of a line beside a peak
    k = [int(np.argmin(np.abs(f - frequency))) for frequency in (25.0, 64.0)]
    assert np.abs(responses["response"].to_numpy()[k, 0] / exact(f[k]) - 1.0).max() < 0.015
    assert are_the_modes(responses, 0.02)
    assert coherence[k].min() > 0.999 and coherence[f > 1000.0].mean() < 0.6
    assert responses.attrs["notes"].startswith("5 blow(s)")


@pytest.mark.parametrize(
    ("duration", "noise", "error", "share"),
    [(1.0, 0.0, 0.01, 0.01), (0.5, 0.0, 0.01, 0.02), (1.0, 0.005, 0.04, 0.02)],
)
def test_a_short_record_has_its_own_damping(
    duration: float, noise: float, error: float, share: float
) -> None:
    """Half a second keeps 45 % of the response: unwindowed, the peak is as much too low."""
    responses = with_responses(record(duration, ((0.02, 1.0),), noise=(0.001, noise)), "force")
    assert largest_error(responses) < error
    assert are_the_modes(responses, share)
    assert "exponential window" in responses.attrs["notes"]


def test_the_length_of_a_segment_is_the_users() -> None:
    data = record(4.0, ((0.1, 1.0),))
    assert largest_error(with_responses(data, "force", segment=2.0)) < 0.01
    responses = with_responses(data, "force", segment=4.0)
    assert responses["frequency"].to_numpy()[1] == 0.25 and largest_error(responses) < 0.01
    with pytest.raises(CaseError, match="to the record, 4 s, given 5 s"):
        with_responses(data, "force", segment=5.0)


def test_a_double_hit_is_named_and_still_right() -> None:
    blows = (*FIVE, (4.133, 0.3))
    responses = with_responses(record(20.0, blows), "force")
    assert (
        "blow at 4.1" in responses.attrs["notes"] and "hit, again 0.033" in responses.attrs["notes"]
    )
    assert largest_error(responses) < 0.01


def test_cut_blows_are_left_out() -> None:
    responses = with_responses(record(8.5, ((-0.001, 1.0), (4.1, 1.0), (8.3, 1.0))), "force")
    notes = responses.attrs["notes"]
    assert notes.count("left out, the record") == 2 and notes.startswith("1 blow(s)")
    assert largest_error(responses) < 0.01
    with pytest.raises(CaseError, match="expected a whole blow, given none"):
        with_responses(record(4.0, ((-0.001, 1.0),)), "force")


def test_few_samples_of_a_blow_are_said() -> None:
    data = record(4.0, ((0.1, 1.0),)).isel(time=slice(None, None, 4))
    assert "a blow lasts 3 samples" in with_responses(data, "force").attrs["notes"]


def test_what_disturbs_the_next_blow_is_said() -> None:
    blows = tuple((0.1 + 1.02 * k + 0.03 * (k % 2), 1.0) for k in range(5))
    notes = with_responses(record(5.3, blows), "force").attrs["notes"]
    assert "of a response is left at its end and disturbs the next" in notes


def test_other_forces_are_not_taken_for_blows() -> None:
    rng, t = np.random.default_rng(3), np.arange(40_000) / RATE
    others = {
        "normal": rng.normal(size=t.size),
        "uniform": rng.uniform(-1.0, 1.0, t.size),
        "laplace": rng.laplace(size=t.size),
        "burst random": rng.normal(size=t.size) * ((t % 2.5) < 0.5),
        "chirp": chirp(t, 1.0, 10.0, 200.0),
        "sine": np.sin(50.0 * t),
        "binary": 2.0 * max_len_seq(15)[0] - 1.0,
        "silent": np.zeros(t.size),
    }
    assert {name: len(pulses(force)) for name, force in others.items()} == dict.fromkeys(others, 0)


def test_an_excitation_at_rest_is_refused() -> None:
    data = record(1.0, ((0.1, 1.0),))
    with pytest.raises(CaseError, match="a channel that moves, given 'force' at rest"):
        with_responses(data.assign(force=0.0 * data["force"]), "force")


def test_the_command_shows_what_it_did(tmp_path: Path) -> None:
    data = record(4.0, ((0.1, 1.0),))
    columns = [data[name].to_numpy() for name in ("time", "force", "sensor_y")]
    np.savetxt(
        tmp_path / "hammer.csv", np.array(columns).T, delimiter=",", comments="",
        header="time [s],force [N],y [m]",
    )  # fmt: skip
    done = CliRunner().invoke(
        app,
        ["measure", "response", str(tmp_path / "hammer.csv"), "-o", str(tmp_path / "out"),
         "--excitation", "force"],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "note: coherence: of one segment it means nothing" in done.output
    again = read_measured(tmp_path / "out" / "measured.nc")
    assert largest_error(again) < 0.01

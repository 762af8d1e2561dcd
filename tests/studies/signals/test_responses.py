"""What the estimates of responses return, number by number: blows, windows, poles, decays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lfilter
from support import refusal

from delam_fem.studies.signals.responses import (
    MOST_LOUD,
    QUIET,
    TRIGGER,
    UNEVEN,
    cut,
    on_axis,
    poles,
    pulses,
    with_free_vibrations,
    with_responses,
)
from delam_fem.studies.signals.writing import save_pictures

RATE = 200.0
BLOW = 0.3 + np.sin(np.pi * (np.arange(7) + 0.5) / 7.0)
"""Force of a blow: seven samples."""


def struck(
    n: int, begins: dict[int, float], *, mode: tuple[float, float] = (1.1, 11.0),
    drift: float = 0.0, width: int = 7,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return times, force and two responses to blows; both sensors have an offset.

    Args:
        n: samples.
        begins: size of each blow by its first sample.
        mode: decay [1/s] and frequency [Hz].
        drift: of the second response [1/s].
        width: samples of a blow.
    """
    time, force = 3.0 + np.arange(n) / RATE, np.full(n, 0.7)
    first, (decay, frequency) = np.zeros(n), mode
    for begin, size in begins.items():
        end = min(begin + width, n)
        force[begin:end] += size * BLOW[: end - begin]
        since = time - time[begin]
        motion = np.exp(-decay * since) * np.sin(2.0 * np.pi * frequency * since)
        first += np.where(since > 0.0, size * motion, 0.0)
    second = -0.5 * np.roll(first, 2) + drift * (time - time[0])
    return time, force, np.array([first + 0.3, second])


def as_dataset(time: np.ndarray, force: np.ndarray, motions: np.ndarray) -> xr.Dataset:
    """Return force and responses as a measurement; the force stands between the responses."""
    names = ["a", "force", "b"]
    values = {"sensor_a": motions[0], "force": force, "sensor_b": motions[1]}
    return xr.Dataset(
        {name: ("time", array) for name, array in values.items()}
        | {"channel_variable": ("channel", list(values)),
           "channel_units": ("channel", ["m", "N", "m/s"]),
           "channel_lamina": ("channel", ["", "", ""])},
        {"time": time, "channel": names},
    )  # fmt: skip


# ---- blows


def test_pulses_are_found_to_the_sample_whatever_the_offset() -> None:
    for offset in (0.0, 5.0, -3.0):
        force = np.full(1000, offset)
        for begin, sign in ((0, 1.0), (300, -1.0), (320, 0.9), (990, 1.0)):
            force[begin : begin + 7] += sign * BLOW
        assert pulses(force) == [(0, 7), (300, 307), (320, 327), (990, 997)]
    force[303] = offset  # noise makes two of a blow: they are nearer than a blow is wide
    assert pulses(force) == [(0, 7), (300, 307), (320, 327), (990, 997)]


@pytest.mark.parametrize(("rest", "n_pulses"), [(5, 1), (7, 1), (8, 2)])
def test_what_follows_within_the_width_of_a_blow_is_part_of_it(rest: int, n_pulses: int) -> None:
    """The rest between both counts, from the end of one to the start of the next."""
    force, second = np.zeros(400), 107 + rest
    force[100:107] = force[second : second + 7] = BLOW
    apart = [(100, 107), (second, second + 7)]
    assert pulses(force) == (apart if n_pulses == 2 else [(100, second + 7)])


def test_thresholds_of_pulses_are_met_on_both_sides() -> None:
    """Noise of -1, 0 and 1, whose scatter is 1.4826, begins no blow below six times that."""
    noise, scatter = np.resize([-1.0, 0.0, 1.0], 999), 1.4826
    for share, expected in ((0.99, []), (1.01, [(500, 501)])):
        force = noise.copy()
        force[500] = share * QUIET * scatter
        assert pulses(force) == expected
    for height, end in ((5.9 * scatter, 501), (6.1 * scatter, 502)):
        force[500:502] = 30.0 * scatter, height
        assert pulses(force) == [(500, end)]
    for share, end in ((0.99, 501), (1.01, 502)):
        force[500:502] = 500.0, share * TRIGGER * 500.0  # 5 % of it is more than the noise
        assert pulses(force) == [(500, end)]
    force = np.zeros(1000)
    force[: round(1000 * MOST_LOUD)] = 1.0
    assert pulses(force) == [(0, 100)]
    force[100] = 1.0
    assert pulses(force) == []


def test_without_a_whole_blow_the_reasons_are_said() -> None:
    time, force, motions = struck(400, {0: 1.0, 390: 1.0})
    told = refusal(lambda: cut(time, force, motions, pulses(force)))
    reason = "left out, the record begins in it or the decay is cut off"
    assert told == (
        f"excitation: expected a whole blow, given none (blow at 3 s: {reason}; blow at 4.95 s: "
        f"{reason})"
    )


def test_a_quarter_of_the_longest_segment_is_long_enough() -> None:
    """The second segment begins seven samples, the width of a blow, before it."""
    for n, n_blows in ((500 - 7 + 100, 1), (500 - 7 + 101, 2)):
        time, force, motions = struck(n, {100: 1.0, 500: 1.0}, mode=(30.0, 11.0))
        forces, *_ = cut(time, force, motions, pulses(force))
        assert forces.shape == (n_blows, 1, 400)


def test_double_hits_are_those_within_a_tenth_of_the_longest_segment() -> None:
    for gap, words in ((60, "a double hit, again 0.3 s later"), (61, "left out")):
        blows = {100 - gap: 1.0, 100: 1.0, 700: 1.0}
        time, force, motions = struck(940, blows, mode=(60.0, 31.0))
        forces, _, _, [note] = cut(time, force, motions, pulses(force))
        assert len(forces) == 2
        assert note.startswith(f"blow at {3.0 + (100 - gap) / RATE:.6g} s: {words}")


# ---- windows


def two_modes(s: np.ndarray) -> np.ndarray:
    """Return two responses of two modes, one with a line beside it."""
    responses = np.zeros((2, s.size), dtype=complex)
    for pole, residues in (
        (2j * np.pi * 20.0 - 0.8, (1.0 - 0.3j, 0.5)), (2j * np.pi * 55.0 - 1.5, (-0.8, 1.2 + 1.0j)),
    ):  # fmt: skip
        r = np.array(residues)[:, None]
        responses += r / (s - pole) + r.conj() / (s - np.conj(pole))
    return responses


@pytest.mark.parametrize("decay", [0.4, 3.0])
def test_the_window_is_taken_out_at_the_peaks(decay: float) -> None:
    f = 0.1 * np.arange(1000)
    axis, windowed = two_modes(2j * np.pi * f), two_modes(2j * np.pi * f + decay)
    response, led = on_axis(f, windowed, np.ones(f.size), decay)
    np.testing.assert_allclose(led, [20.0, 55.0], atol=0.051)
    near = (np.abs(f - 20.0) < 2.0) | (np.abs(f - 55.0) < 2.0)
    largest = np.abs(axis).max()
    assert np.abs(response - axis)[:, near].max() < 2e-6 * largest
    assert np.abs(windowed - axis)[:, near].max() > 0.1 * largest
    assert np.abs(response - windowed)[:, near].max() > 0.1 * largest


def test_peaks_without_force_or_pole_stay_as_they_are() -> None:
    f = 0.1 * np.arange(1000)
    windowed = two_modes(2j * np.pi * f + 1.0)
    for weak, led in ((0.099, [20.0]), (0.101, [20.0, 55.0])):
        force = np.where(f > 40.0, weak, 1.0)
        np.testing.assert_allclose(on_axis(f, windowed, force, 1.0)[1], led, atol=0.051)
    for place, led in ((5, []), (6, [0.6])):  # it reaches five lines to both sides
        piece = windowed[:, 200 - place : 300]
        response, peaks = on_axis(f[: piece.shape[1]], piece, np.ones(piece.shape[1]), 1.0)
        np.testing.assert_allclose(peaks, led)
        assert np.array_equal(response, piece) == (not led)


# ---- responses


def noisy(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, a random force and two responses with noise of their own."""
    rng, time = np.random.default_rng(4), 1.0 + np.arange(n) / RATE
    force, *noise = rng.normal(size=(3, n))
    motions = np.array([
        lfilter([0.0, 1.0], [1.0, -1.2, 0.9], force) + 0.4 * noise[0],
        lfilter([0.5, 0.2], [1.0, 0.3, 0.5], force) + 0.2 * noise[1],
    ])  # fmt: skip
    return time, force, motions


def test_messages_of_responses_are_exact() -> None:
    data, blows = as_dataset(*noisy(400)), as_dataset(*struck(400, {20: 1.0}))
    told = "estimator: expected one of H1, H2, Hv, given 'H3'"
    assert refusal(lambda: with_responses(data, "force", estimator="H3")) == told
    told = "excitation: expected one of the histories a, force, b, given 'c'"
    assert refusal(lambda: with_responses(data, "c")) == told
    still = data.assign(force=0.0 * data["force"] + 2.0)
    told = "excitation: expected a channel that moves, given 'force' at rest"
    assert refusal(lambda: with_responses(still, "force")) == told
    for record, segment, upper, text in (
        (data, 1.01, "half the record, 1 s", "1.01"),
        (data, 0.035, "half the record, 1 s", "0.035"), (blows, 2.005, "the record, 2 s", "2"),
    ):  # fmt: skip
        assert refusal(lambda own=record, segment=segment: with_responses(
            own, "force", segment=segment)) == (
            f"segment: expected from 0.04 s to {upper}, given {text} s"
        )  # fmt: skip
    for record, segment in ((data, 1.0), (data, 0.04), (blows, 2.0)):
        assert with_responses(record, "force", segment=segment)["frequency"][-1] > 0.0
    only = data.isel(channel=[1])
    told = "excitation: expected a response beside it, found none"
    assert refusal(lambda: with_responses(only, "force")) == told
    short = data.isel(time=slice(0, 63))
    assert "given 0.035 s" in refusal(lambda: with_responses(short, "force"))
    assert with_responses(data.isel(time=slice(0, 64)), "force").sizes["frequency"] == 5
    time = data["time"].to_numpy().copy()
    for share in (0.98, 1.02):
        moved = time.copy()
        moved[200] += share * UNEVEN / RATE
        uneven = data.assign_coords(time=moved)
        if share < 1.0:
            assert "response" in with_responses(uneven, "force")
        else:
            told = refusal(lambda own=uneven: with_responses(own, "force"))
            assert "0.51 steps off" in told and "from 1.995 to 2.00255 s" in told


# ---- poles


def measured_poles(shift: float = 0.0) -> xr.Dataset:
    f = 0.05 * np.arange(1601)
    h = two_modes(2j * np.pi * f) + shift
    names = [f"out{k}" for k in range(len(h))]
    return xr.Dataset(
        {"response": (("frequency", "output"), h.T)}, {"frequency": f, "output": names}
    )


def test_poles_of_exact_responses() -> None:
    pytest.importorskip("sdypy.EMA")
    data = measured_poles()
    (first, second), left = poles(data, 5.0, 70.0)
    for pole, frequency, decay in ((first, 20.0, 0.8), (second, 55.0, 1.5)):
        size = float(np.hypot(frequency, decay / (2.0 * np.pi)))
        assert pole.frequency == pytest.approx(size, rel=1e-8)
        assert pole.damping == pytest.approx(decay / (2.0 * np.pi * size), rel=1e-6)
        assert pole.frequency_error < 1e-8 * size and pole.damping_error < 1e-6 * pole.damping
    assert max(left.values()) < 1e-8
    assert [pole.frequency for pole in poles(data, 30.0, 80.0)[0]] == pytest.approx(
        [55.0], rel=1e-4
    )
    assert poles(data, 22.0, 50.0)[0] == []
    assert {round(pole.frequency) for pole in poles(data, 0.0, 70.0)[0]} <= {20, 55}


def test_messages_of_poles_are_exact() -> None:
    pytest.importorskip("sdypy.EMA")
    data = measured_poles()
    told = "poles: expected frequency responses, found none; --excitation makes them"
    assert refusal(lambda: poles(data.drop_vars("response"), 1.0, 2.0)) == told
    for lower, upper in ((-0.5, 30.0), (30.0, 30.0), (30.0, 20.0), (5.0, 80.5), (5.0, 5.15)):
        message = refusal(lambda ends=(lower, upper): poles(data, *ends))
        assert "from 0 to 80 Hz" in message and f"given {lower:g} to {upper:g}" in message


# ---- free vibrations


def vibrating(n: int = 900, rate: float = 100.0) -> xr.Dataset:
    """Return a decay with another mode close by, and a small motion that no exponential is."""
    time = 2.0 + np.arange(n) / rate
    y = 0.002 * np.sin(0.3 * (time - 2.0) ** 2)
    for size, decay, f in ((2.0, 0.3, 9.0), (0.7, 0.2, 12.5)):
        y = y + size * np.exp(-decay * (time - 2.0)) * np.cos(2.0 * np.pi * f * time + 0.3)
    return as_dataset(time, 0.0 * y, np.array([y, -3.0 * y]))


def test_a_fast_record_is_thinned() -> None:
    """To four times the highest frequency: the middles are those of the samples that are left."""
    vibrations = with_free_vibrations(vibrating(4000, 1000.0), "a", 6.0, 11.0, 1.0)
    thinning = int(1000.0 / 44.0)
    n = round(1000.0 / thinning)
    middle = 2.0 + 0.5 * (n - 1) * thinning / 1000.0
    assert float(vibrations["free_time"][0]) == pytest.approx(middle, abs=1e-12)
    steps = np.diff(vibrations["free_time"])
    np.testing.assert_allclose(steps, n // 2 * thinning / 1000.0, rtol=1e-9)
    np.testing.assert_allclose(vibrations["free_frequency"], 9.0, rtol=1e-3)


def test_the_last_segment_is_a_whole_one() -> None:
    """The segments are 200 samples long, each begins 100 later: the fourth would end at 500."""
    for n, n_segments in ((499, 3), (500, 4), (599, 4)):
        vibrations = with_free_vibrations(vibrating(n), "a", 6.0, 15.0, 2.0)
        wanted = 2.0 + (100.0 * np.arange(n_segments) + 99.5) / 100.0
        np.testing.assert_allclose(vibrations["free_time"], wanted, rtol=1e-12)


def test_the_strongest_mode_has_most_energy_and_not_most_amplitude() -> None:
    """The mode at 14 Hz begins three times as large, but decays fifteen times as fast."""
    time = np.arange(400) / 100.0
    y = 1e-6 * np.random.default_rng(3).normal(size=(2, time.size))
    for size, decay, f in ((1.0, 0.25, 9.0), (3.0, 3.75, 14.0)):
        y += size * np.exp(-decay * time) * np.cos(2.0 * np.pi * f * time)
    vibrations = with_free_vibrations(as_dataset(time, 0.0 * time, y), "a", 5.0, 18.0, 4.0)
    np.testing.assert_allclose(vibrations["free_frequency"], [9.0], rtol=1e-3)


def test_messages_of_free_vibrations_are_exact() -> None:
    data = vibrating()
    told = "free: expected one of the histories a, force, b, given 'c'"
    assert refusal(lambda: with_free_vibrations(data, "c", 6.0, 11.0)) == told
    for ends in ((-1.0, 11.0), (11.0, 6.0), (6.0, 6.0), (6.0, 40.0), (6.0, 11.0, 0.31)):
        segment = ends[2] if len(ends) > 2 else 10.0 / max(ends[0], 1e-9)
        thinned = max(1, int(100.0 / (4.0 * ends[1])))
        assert refusal(lambda ends=ends: with_free_vibrations(data, "a", *ends)) == (
            f"free: expected LOW below HIGH up to 40 Hz, and segments from "
            f"{32 * thinned / 100.0:.3g} s to the whole record, given {ends[0]:g} to {ends[1]:g} "
            f"Hz and {segment:g} s"
        )
    assert with_free_vibrations(data, "a", 6.0, 11.0, 0.64).sizes["free_time"] == 27
    assert with_free_vibrations(data, "a", 6.0, 11.0, 9.0).sizes["free_time"] == 1
    assert with_free_vibrations(data, "a", 0.0, 11.0, 9.0).sizes["free_time"] == 1


# ---- pictures


def test_pictures_are_the_stored_ones(tmp_path: Path) -> None:
    data = with_responses(as_dataset(*struck(1000, {20: 1.0, 420: 0.8})), "force")
    free = with_free_vibrations(vibrating(), "a", 6.0, 11.0)
    names = [path.name for path in save_pictures(data, tmp_path)]
    assert names == ["responses.png"]
    both = data.drop_vars("coherence").merge(free[[n for n in free if "free" in str(n)]])
    assert [path.name for path in save_pictures(both, tmp_path)] == [
        "responses.png", "free_vibration.png",
    ]  # fmt: skip
    assert save_pictures(data.drop_vars("response"), tmp_path) == []

"""Signals of sensors: the motion that the engine computes, sampling, noise."""

from __future__ import annotations

import zlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem import Decision
from delam_fem.api import N_BASE, PeriodRecord, Sensor, frames_of
from delam_fem.model.layout import SensorRows
from delam_fem.simulation import signals
from delam_fem.simulation.signals import low_passed, resting_pairs, spring_forces, steps_of

N = 500
SENSORS: list[dict[str, Any]] = [
    {"name": "d", "quantity": "displacement", "lamina": "thin", "position": 0.685},
    {"name": "v", "quantity": "velocity", "lamina": "thin", "position": "300 mm"},
    {"name": "here", "quantity": "velocity", "lamina": "thin", "position": 0.3},
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


@pytest.mark.parametrize("law", ["none", "penalty", "newton", "newton-penalty"])
def test_an_acceleration_adds_up_to_the_change_of_velocity(law: str) -> None:
    """At impacts, too: Σ a Δt is the change of the velocity from middle to middle of two steps."""
    history = run(law=law, penalty_stiffness=2000.0, threshold_velocity=0.02).history
    rate, a = (history[f"sensor_{name}"].values for name in ("here", "a"))
    dt = float(history["time"][1] - history["time"][0])
    means = 0.5 * (rate[1:] + rate[:-1])
    moved = means - means[0]
    np.testing.assert_allclose(np.cumsum(a[1:-1]) * dt, moved[1:], atol=1e-9 * np.ptp(rate))


@pytest.mark.parametrize(("steps_a_cycle", "share"), [(2.0, 1.0), (4.5, 0.0), (20.0, 0.0)])
def test_a_signal_alternates_if_it_has_few_steps_a_cycle(
    steps_a_cycle: float, share: float
) -> None:
    wave = np.cos(2.0 * np.pi * np.arange(500) / steps_a_cycle + 0.3)
    assert signals.alternating_share(wave) == pytest.approx(share, abs=0.02)
    assert signals.alternating_share(np.r_[wave, np.zeros(500)]) == pytest.approx(
        0.5 * share, abs=0.02
    )


def test_peaks_of_single_steps_do_not_alternate() -> None:
    peaks = np.zeros(300)
    peaks[::7] = 5.0
    assert signals.alternating_share(peaks) == 0.0
    assert signals.alternating_share(np.zeros(300)) == 0.0


@pytest.mark.parametrize(("n_steps", "is_told"), [(1000, True), (16000, False)])
def test_a_run_says_which_sensors_its_steps_do_not_resolve(n_steps: int, is_told: bool) -> None:
    """Damping by stiffness makes most modes creep, which long steps turn into alternating ones."""
    case = df.preset("paper", {
        "contact.law": "newton", "contact.impulse": "consistent", "damping.rayleigh": "stiffness",
        "time.steps_per_period": n_steps, "time.periods": 2, "output.window_periods": 2,
        "sensor": [{**SENSORS[0], "name": "shock", "quantity": "acceleration"}, SENSORS[0]],
    })  # fmt: skip
    told = [text for text in df.run(case).summary["warnings"] if "alternate" in text]
    assert bool(told) is is_told
    for text in told:
        assert "shock" in text and f"time.steps_per_period = {n_steps}" in text
        assert f"{SENSORS[0]['name']} in" not in text


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
    noise = slow.values - np.interp(time, full["time"], smooth)
    assert 0.8e-3 < noise.std() < 1.3e-3
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


# ---- a record that is written down

STEPS, TICKS, PAIRS, PROBES = 7, 3, 4, 2


def record(seed: int = 1, n_steps: int = STEPS) -> PeriodRecord:
    """Return a period of random numbers, with impacts at some ticks, also within steps."""
    rng = np.random.default_rng(seed)
    period_record = PeriodRecord(
        rng.normal(size=(STEPS + 1, 3)), rng.normal(size=(STEPS + 1, N_BASE + PROBES + 1 + PAIRS)),
        rng.normal(size=(STEPS + 1, PROBES + 1 + PAIRS)), np.array([2, 5, 7]), np.zeros(6),
        ticks_per_step=TICKS, resting=rng.random(PAIRS) < 0.5,
    )  # fmt: skip
    period_record.n_steps = n_steps
    period_record.frames = [
        rng.normal(size=(2, 5)) for step in period_record.frame_steps if step <= n_steps
    ]
    period_record.contact = [rng.integers(0, 3, PAIRS) for _ in period_record.frames]
    for tick in (1, 3, 4, 8, 9, 15, 21):
        hit = rng.permutation(PAIRS)[: 1 + tick % 3]
        decision = Decision(hit, *rng.normal(size=(3, hit.size)))
        period_record.jumps.append(tick, decision, rng.normal())
    return period_record


def structure(weights: Any = None) -> Any:
    """Return what signals read of a structure; the gaps stand behind another functional."""
    o = SimpleNamespace(
        n_probes=PROBES,
        n_pairs=PAIRS,
        pair_weights=weights,
        pair_numbers=None,
        gap0=np.array([0.1, -0.2, 0.3, 0.0]),
    )
    return SimpleNamespace(operators=o, layout=SimpleNamespace(gap_row=1, first_gap=0))


def case_of(law: str, impulse: str = "consistent", **more: float) -> df.Case:
    contact = {"contact.penalty_stiffness": 50.0, "contact.penalty_damping": 3.0}
    return df.preset("paper", {"contact.law": law, "contact.impulse": impulse, **contact, **{
        f"contact.{key}": value for key, value in more.items()}})  # fmt: skip


@pytest.mark.parametrize("n_steps", [STEPS, 4])
@pytest.mark.parametrize("seed", range(4))
def test_pairs_rest_from_impact_to_impact(seed: int, n_steps: int) -> None:
    period_record, threshold = record(seed, n_steps), 0.3
    if n_steps < STEPS:  # impacts lie within the steps that were computed
        period_record.jumps = record(seed + 9).jumps
        ticks = period_record.jumps.columns().ticks
        n_impacts = int((ticks <= TICKS * n_steps).sum())
        columns = period_record.jumps.columns()
        hits = int(columns.sizes[:n_impacts].sum())
        period_record.jumps = type(period_record.jumps)(columns.part((0, n_impacts), (0, hits)))
    gap = np.random.default_rng(seed).normal(size=(n_steps, PAIRS)) - 0.5
    rests, resting = period_record.resting.copy(), resting_pairs(period_record, gap, threshold)
    columns = period_record.jumps.columns()
    ends = np.r_[0, np.cumsum(columns.sizes)]
    for step in range(1, n_steps + 1):
        for k, tick in enumerate(columns.ticks):
            if TICKS * (step - 1) < tick <= TICKS * step:
                here = slice(ends[k], ends[k + 1])
                rests[columns.hit[here]] = columns.rate_post[here] < threshold
        rests &= gap[step - 1] <= 0.0
        assert resting[step - 1].tolist() == rests.tolist(), step


def test_a_rate_at_the_threshold_does_not_rest() -> None:
    period_record = record()
    period_record.jumps = type(period_record.jumps)()
    period_record.resting = np.zeros(PAIRS, bool)
    rates = np.array([0.3, np.nextafter(0.3, 0.0)])
    period_record.jumps.append(1, Decision(np.array([0, 1]), rates, rates, rates), 0.0)
    gap = -np.ones((STEPS, PAIRS))
    gap[1] = 0.0
    assert resting_pairs(period_record, gap, 0.3)[:, :2].tolist() == [[False, True]] * STEPS


@pytest.mark.parametrize("weights", [None, np.array([1.0, 2.0, 0.5, 3.0])])
def test_springs_and_dampers_act_while_pairs_are_closed(weights: Any) -> None:
    period_record, of, share = record(), structure(weights), 1.0 if weights is None else weights
    gap = of.operators.gap0 + period_record.u[1:, N_BASE + PROBES + 1 :]
    rate = period_record.v[1:, PROBES + 1 :]
    assert (gap > 0.0).any() and (gap < 0.0).any()
    forces = spring_forces(period_record, of, case_of("penalty"))
    wanted = np.where(gap <= 0.0, -share * (50.0 * gap + 3.0 * rate), 0.0)
    np.testing.assert_allclose(forces, wanted, rtol=1e-14)
    rests = spring_forces(period_record, of, case_of("newton-penalty", threshold_velocity=0.3))
    wanted = np.where(resting_pairs(period_record, gap, 0.3), -share * 50.0 * gap, 0.0)
    np.testing.assert_allclose(rests, wanted, rtol=1e-14)
    assert rests.any() and not np.array_equal(rests, forces)
    none = spring_forces(record(n_steps=5), of, case_of("newton"))
    assert none.shape == (5, PAIRS) and not none.any()
    assert spring_forces(record(n_steps=5), of, case_of("penalty")).shape == (5, PAIRS)


@pytest.mark.parametrize("n_steps", [STEPS, 6])
def test_impulses_count_with_their_mean_force(n_steps: int) -> None:
    """Each impulse is in the step within which it lies; those behind the last step do not count."""
    period_record, of, case = record(n_steps=n_steps), structure(), case_of("newton")
    forces = signals.contact_forces_of(period_record, of, case)
    wanted, place = np.zeros((n_steps, PAIRS)), 0
    columns = period_record.jumps.columns()
    for tick, size in zip(columns.ticks, columns.sizes, strict=True):
        step = -(-tick // TICKS)
        for k in range(place, place + size):
            if step <= n_steps:
                wanted[step - 1, columns.hit[k]] += columns.impulses[k] / case.time_step
        place += size
    np.testing.assert_allclose(forces, wanted, rtol=1e-13)


def test_a_sensor_reads_the_sum_of_its_parts() -> None:
    rows = SensorRows(
        "s", of_base=(0.5, -2.0), of_u=1, of_v=2, of_forces=np.array([1.0, -1.0, 2.0, 0.5])
    )
    rng = np.random.default_rng(5)
    u, v, base, forces = (rng.normal(size=size) for size in ((4, 5), (4, 5), (4, 3), (3, PAIRS)))
    reading = signals.read(rows, (u, v, base), forces, PROBES)
    wanted = 0.5 * base[:, 0] - 2.0 * base[:, 1] + u[:, PROBES + 1] + v[:, PROBES + 2]
    wanted[1:] += forces[:, 0] - forces[:, 1] + 2.0 * forces[:, 2] + 0.5 * forces[:, 3]
    np.testing.assert_allclose(reading, wanted, rtol=1e-13)


def window() -> Any:
    """Return a recorder of three periods, the last of which ended early."""
    records = [record(1), record(2), record(3, 5)]
    return SimpleNamespace(window=records, steps_per_period=STEPS, is_forced=False)


def test_steps_of_a_window_follow_one_another() -> None:
    run_recorder = window()
    u, v, base = steps_of(run_recorder)
    first, second, last = run_recorder.window
    np.testing.assert_array_equal(u[:8], first.u[:, N_BASE:])
    np.testing.assert_array_equal(v[8:15], second.v[1:])
    np.testing.assert_array_equal(base[15:], last.base_states[1:6])
    assert len(u) == len(v) == len(base) == 1 + 7 + 7 + 5


def test_frames_of_a_window_have_their_steps_and_the_base() -> None:
    run_recorder = window()
    frames = frames_of(run_recorder)
    assert frames.steps.tolist() == [2, 5, 7, 9, 12, 14, 16, 19]
    assert len(frames.states) == len(frames.contact) == 8 and frames.contact.dtype == np.int8
    np.testing.assert_array_equal(frames.base[4], run_recorder.window[1].base_states[5, :2])
    np.testing.assert_array_equal(frames.states[7], run_recorder.window[2].frames[1])
    run_recorder.is_forced = True
    assert not frames_of(run_recorder).base.any()
    none = frames_of(SimpleNamespace(window=[], steps_per_period=STEPS, is_forced=False))
    assert none.steps.size == 0 and none.base.shape == (0, 2) and none.states == []


@pytest.mark.parametrize(
    ("start", "end", "first", "last"),
    [(1.0, 3.0, 1.0, 3.0), (1.0 + 1e-9, 3.0 - 1e-9, 1.0 + 1e-9, 3.0 - 1e-9),
     (1.001, 2.999, 1.25, 2.75), (0.9, 3.1, 1.0, 3.0)],
)  # fmt: skip
def test_samples_are_at_whole_multiples_of_the_interval(
    start: float, end: float, first: float, last: float
) -> None:
    """A straight line passes the filter, also at its ends."""
    sensor = Sensor(name="s", quantity="velocity", lamina="a", position=0.1, sampling_rate=4.0)
    time = np.linspace(start, end, 201)
    line = 2.0 + 3.0 * np.r_[time[0], time]
    signal = signals._sampled(sensor, time, line, float(time[1] - time[0]))
    assert signal.sensor is sensor
    assert (signal.time[0], signal.time[-1]) == pytest.approx((first, last), abs=1e-15)
    np.testing.assert_allclose(
        signal.time, np.arange(first * 4.0, last * 4.0 + 0.5) / 4.0, atol=1e-8
    )
    np.testing.assert_allclose(signal.value, 2.0 + 3.0 * signal.time, rtol=1e-9)


def test_noise_is_that_of_the_seed_and_the_name() -> None:
    about = {"quantity": "velocity", "lamina": "a", "position": 0.1, "noise": 0.2, "seed": 5}
    sensor = Sensor(name="s", **about)  # type: ignore[arg-type]
    time = np.arange(9.0)
    signal = signals._sampled(sensor, time, 2.0 * np.r_[0.0, time], 1.0)
    rng = np.random.default_rng([5, zlib.crc32(b"s")])
    np.testing.assert_array_equal(signal.value, 2.0 * time + rng.normal(scale=0.2, size=9))
    other = signals._sampled(Sensor(name="t", **about), time, 2.0 * time, 1.0)  # type: ignore[arg-type]
    assert not np.array_equal(other.value, signal.value)


def test_fast_samples_pass_and_short_signals_stay() -> None:
    value = np.sin(np.arange(50.0))
    assert low_passed(value, 1.0) is value and low_passed(value[:1], 0.1).tolist() == [0.0]
    assert not np.array_equal(low_passed(value, 0.999), value)
    two = low_passed(np.array([1.0, 3.0]), 0.5)
    assert two.shape == (2,)
    t = np.arange(4000)
    for share, gain in ((0.2, 1.0), (0.4, 1.0), (0.45, 0.5), (0.5, 0.0), (0.8, 0.0)):
        wave = np.sin(2.0 * np.pi * share * 0.1 * t)
        amplitude = np.abs(low_passed(wave, 0.1)[1000:3000]).max()
        assert amplitude == pytest.approx(gain, abs=5e-3 if share != 0.45 else 0.02)

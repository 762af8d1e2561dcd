"""Planes of two parameters and other numbers of the paper, of data whose answers are known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from delam_fem.paper import parameters, responses
from delam_fem.paper.claims import Numbers
from delam_fem.paper.parameters import KINDS, THRESHOLDS
from delam_fem.paper.runs import (
    BAND,
    SWEEP_SECONDS,
    Effort,
    swept_case,
    swept_envelope,
    swept_extremes,
)
from delam_fem.results.diagnostics import STROBES

FIRST, SECOND = np.array([0.0, 0.3, 0.6]), np.array([1e2, 1e3])
KIND = np.array([[0, 0], [0, 6], [4, 2]])
CONTACTS = np.array([[0.95, 1.0], [1.05, 0.94], [np.nan, 1.06]])
SCATTER = 0.01 * np.array([[1.99, 2.01], [0.0, 60.0], [8.5, 49.0]])


@pytest.fixture
def plane(monkeypatch: pytest.MonkeyPatch) -> Numbers:
    """A plane whose strobes alternate, and before them move by far more."""
    axes = [key.partition(".")[2] for key, *_ in parameters.PLANE_AXES["newton-penalty"]]
    amplitude = np.stack(
        [1.0 + FIRST[:, None] + 0.0 * SECOND, 2.0 + 1e-3 * SECOND + 0.0 * KIND], -1
    )
    n = STROBES + 7
    strobes = np.zeros((3, 2, 2, n))
    # the thin tip alone moves: by the scatter times its half range from period to period
    swing = 0.5 * SCATTER * amplitude[..., 1]
    strobes[:, :, 1] = swing[..., None] * (-1.0) ** np.arange(n)
    strobes[..., : n - STROBES] = 99.0
    arrays: dict[str, Any] = {
        "strobe_displacement": ((*axes, "lamina", "strobe"), strobes),
        "tip_amplitude": ((*axes, "lamina"), amplitude),
        "tip_contacts_per_period": (axes, CONTACTS),
        "outcome": (axes, KIND), "periodicity": (axes, KIND), "is_decided": (axes, KIND),
    }  # fmt: skip
    data = xr.Dataset(arrays, {axes[0]: FIRST, axes[1]: SECOND}).transpose(..., *axes)
    captured: list[Any] = []

    def kinds(*columns: Any) -> np.ndarray:
        captured.extend(columns)
        return KIND

    monkeypatch.setattr(parameters.settling, "kinds_of_motion", kinds)
    numbers = parameters.plane_of(data, "newton-penalty")
    outcome, periodicity, read_strobes, is_decided, settled = captured
    np.testing.assert_array_equal(outcome, KIND)
    np.testing.assert_array_equal(periodicity, KIND)
    np.testing.assert_array_equal(read_strobes, strobes)
    np.testing.assert_array_equal(is_decided, KIND != 0)
    assert settled is None
    captured.clear()
    parameters.plane_of(data.assign(settled=data["outcome"]), "newton-penalty")
    np.testing.assert_array_equal(captured[-1], KIND != 0)
    return numbers


def test_shares_of_a_plane(plane: Numbers) -> None:
    assert plane.law == "newton-penalty" and plane.kinds == dict(enumerate(KINDS))
    np.testing.assert_array_equal(getattr(plane, plane.axes[0]), FIRST)
    np.testing.assert_array_equal(getattr(plane, plane.axes[1]), SECOND)
    share = {name: 0.0 for name in KINDS} | {
        "one-periodic": 0.5, "quasi-periodic": 1 / 6, "diverged": 1 / 6, "undecided": 1 / 6,
    }  # fmt: skip
    assert plane.share == pytest.approx(share)
    assert parameters.one_periodic_within(plane) == pytest.approx((0.5, 2.0 / 3.0))
    assert plane.one_contact_share == pytest.approx(0.5)
    np.testing.assert_allclose(plane.scatter, SCATTER, atol=1e-12)
    counts = {percent: int((100.0 * SCATTER < percent).sum()) / 6.0 for percent in THRESHOLDS}
    assert plane.one_periodic_by_threshold == pytest.approx(counts)
    assert plane.one_periodic_by_threshold[2.0] == pytest.approx(2.0 / 6.0)
    assert "axes" not in plane.kept and "kind" in plane.kept


def test_amplitudes_of_a_plane(plane: Numbers) -> None:
    amplitude = plane.tip_amplitude_m
    wanted = amplitude.reshape(6, 2)
    spread = wanted.std(axis=0) / wanted.mean(axis=0)
    np.testing.assert_allclose(plane.amplitude_spread, spread, rtol=1e-12)
    for axis, axis_amplitudes in enumerate((plane.amplitude_by_first, plane.amplitude_by_second)):
        explained = amplitude.mean(axis=1 - axis).var(axis=0) / wanted.var(axis=0)
        np.testing.assert_allclose(axis_amplitudes, explained, rtol=1e-12)


def test_effects_of_what_does_not_change_are_none() -> None:
    values = np.stack([np.full((3, 2), 2.0), np.array([[1.0, np.nan], [2.0, 2.0], [3.0, 3.0]])], -1)
    assert parameters.main_effect(values, 0).tolist()[0] == 0.0
    assert parameters.main_effect(values, 0)[1] == pytest.approx(
        (2 / 3) / np.nanvar(values[..., 1])
    )


def test_decades_reach_ten_times_and_have_undecided_points() -> None:
    damping = np.array([1.0, 2.0, 10.0, 20.0, 100.0])
    kind = np.array([[0], [6], [6], [0], [0]])
    amplitude = np.ones((5, 1, 2))
    best = parameters.best_decade(damping, kind, amplitude)
    assert best.kept["from"] == 10.0
    assert best.one_periodic_within == pytest.approx((2.0 / 3.0, 1.0))
    best = parameters.best_decade(damping, kind[::-1], amplitude)
    assert best.kept["from"] == 1.0 and best.one_periodic == pytest.approx(2.0 / 3.0)
    best = parameters.best_decade(damping, np.zeros((5, 1)), amplitude)
    assert best.kept["from"] == 1.0  # the smallest of equals


def test_only_the_last_strobes_count() -> None:
    strobes = np.zeros((2, STROBES + 2))
    strobes[0, 2] = strobes[1, 1] = 7.0
    scatter = parameters.one_period_scatter(strobes, np.array([2.0, 1.0]))
    assert scatter == pytest.approx(7.0 / np.sqrt(STROBES - 1) / 2.0)


def test_impacts_after_which_a_pair_stays() -> None:
    case = SimpleNamespace(contact=SimpleNamespace(restitution=0.5))
    history = xr.Dataset({"event_velocity_before": ("event", -np.array([1.0, 2.0, 3.0, 4.0]))})
    result: Any = SimpleNamespace(case=case, history=history)
    for gamma, share in ((0.5, 0.0), (0.51, 0.25), (1.5, 0.5), (2.01, 1.0)):
        assert parameters.staying_share(result, gamma) == share
    result.history = history.isel(event=slice(0))
    assert parameters.staying_share(result, 9.0) == 0.0


def test_ranges_of_amplitudes_up_to_a_threshold() -> None:
    numbers = Numbers({
        "gamma_m_s": np.array([1.0, 2.0, 3.0]),
        "amplitude_mm": {
            "1.6": [np.array([1.0, 5.0]), np.array([2.0, 5.0]), np.array([1.0, 50.0])],
            "3.2": [np.array([4.0, 1.0]), np.array([4.0, 3.0]), np.array([4.0, 2.0])],
        },
    })  # fmt: skip
    assert parameters._spreads(numbers, 2.0) == pytest.approx({"1.6": 2.0 / 3.0, "3.2": 1.0})
    assert parameters._spreads(numbers) == pytest.approx({"1.6": 2.25, "3.2": 1.0})


# ---- responses


def response(**changed: Any) -> Numbers:
    values = {
        "frequency_hz": np.array([1.0, 1.25, 1.5]),
        "periodicity_up": np.array([1.0, 2.0, 1.0]), "periodicity_down": np.array([1.0, 4.0, 1.0]),
        "jumps_up_hz": [[1.125], []], "jumps_down_hz": [[1.375], [1.125]],
        "tip_contacts_per_period": np.array([[0.5, 1.234], [2.0, 1.0]]),
        "hysteresis_hz": [1.25, 1.5],
    }  # fmt: skip
    return Numbers(values | changed)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, "periods 1, 2, 4, 0.5 to 2 tip contacts per period; up and down differ at 1.25, 1.50 "
             "Hz; jumps at 1.12, 1.38 Hz"),
        ({"hysteresis_hz": [], "jumps_up_hz": [[]], "jumps_down_hz": [[]]},
         "periods 1, 2, 4, 0.5 to 2 tip contacts per period; up and down agree everywhere"),
        ({"periodicity_up": np.array([np.nan, 2.0, 1.0]),
          "periodicity_down": np.array([1.0, 1.0, -1.0])},
         "periods 1, 2, none up to 8 at 1.00 Hz, undecided at 1.50 Hz, 0.5 to 2 tip contacts per "
         "period; up and down differ at 1.25, 1.50 Hz; jumps at 1.12, 1.38 Hz"),
    ],
)  # fmt: skip
def test_scenarios_in_words(changed: dict[str, Any], words: str) -> None:
    assert responses._scenario(response(**changed)) == words


def test_motions_differ_by_a_share_of_the_larger_one() -> None:
    share = responses.DIFFERS
    up, down = np.array([1.0, 1.0 - 0.99 * share, 1.0 - 1.01 * share]), np.ones(3)
    assert responses._differ(up, down).tolist() == [False, False, True]
    assert responses._differ(down, up).tolist() == [False, False, True]


# ---- swept sines


def test_extremes_within_a_cycle_are_combined() -> None:
    """Of a sine swept from 10 to 2.5 Hz; half a cycle reaches two tenths of a second from 5 Hz."""
    case = swept_case("linear", (10.0, 2.5), "none", 100)
    n = round(SWEEP_SECONDS * 10.0)
    rng = np.random.default_rng(5)
    low, high = -rng.uniform(1.0, 2.0, (2, n)), rng.uniform(1.0, 2.0, (2, n))
    history = xr.Dataset({
        "envelope_min": (("lamina", "period"), low), "envelope_max": (("lamina", "period"), high),
    })  # fmt: skip
    result: Any = SimpleNamespace(history=history, case=case)
    times, extremes = swept_extremes(result)
    np.testing.assert_allclose(times, 0.1 * (np.arange(n) + 0.5), rtol=1e-12)
    np.testing.assert_array_equal(extremes, [low, high])
    f, envelope = swept_envelope(result)
    np.testing.assert_allclose(f, 10.0 - 7.5 * times / SWEEP_SECONDS, rtol=1e-9)
    rate = min(lamina.damping_ratio * lamina.angular_frequencies(1)[0] for lamina in case.lamina)
    settled = times >= np.log(100.0) / rate
    assert 0.0 < times[settled][0] < 100.0
    assert np.isnan(envelope[:, ~settled]).all() and np.isfinite(envelope[:, settled]).all()
    at_five = int(np.flatnonzero(f < 5.0)[0])
    for k, w in ((at_five - 1, 1), (at_five, 2), (n - 3, 2), (n - 1, 2)):
        about = slice(k - w, k + w + 1)
        wanted = 0.5 * (high[:, about].max(axis=1) - low[:, about].min(axis=1))
        np.testing.assert_allclose(envelope[:, k], wanted, rtol=1e-12)


def test_one_cycle_of_a_swept_sine_leaves_the_change_of_its_frequency_open() -> None:
    low, high = responses._one_cycle(2.0)
    per_cycle = (BAND[1] - BAND[0]) / SWEEP_SECONDS / 2.0
    assert (low, high) == pytest.approx((2.0 - per_cycle / 2.0, 2.0 + per_cycle / 2.0), rel=1e-12)


def test_stepped_sines_are_denser_at_the_resonances() -> None:
    asked: list[Any] = []

    def sweep(description: Any) -> xr.Dataset:
        asked.append(description)
        values = np.arange(2.0 * len(description["axis"][0]["values"])).reshape(-1, 2)
        return xr.Dataset({"tip_amplitude": (("point", "lamina"), values)})

    case = swept_case("linear", (0.5, 4.0), "none", 100)
    lab: Any = SimpleNamespace(plan=Effort(response_step=0.25), sweep=sweep)
    frequencies, amplitude = responses._linear_sine(lab, case)
    even = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]
    assert set(even) <= set(frequencies.tolist()) and frequencies[[0, -1]].tolist() == [0.5, 4.0]
    near = np.setdiff1d(frequencies, even)
    first = [lamina.angular_frequencies(1)[0] / (2.0 * np.pi) for lamina in case.lamina]
    wanted = np.concatenate([f * np.arange(0.96, 1.0401, 0.005) for f in sorted(first)])
    np.testing.assert_allclose(near, wanted, atol=6e-6)
    assert asked[0]["axis"][0]["values"] == frequencies.tolist()
    np.testing.assert_array_equal(amplitude[:, 1], [2.0, 3.0])
    assert amplitude.shape == (2, frequencies.size)

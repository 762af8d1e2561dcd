"""Drives with many lines: lines, phases, derivatives, densities, seeds; measured drives."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from delam_fem.api import Case, CaseError, FloatArray, drive, preset
from delam_fem.case import broadband
from delam_fem.case.broadband import Gridded, Lines
from delam_fem.case.plausible import warnings

BAND = {"low": 0.5, "high": 20.0}
MULTISINE = {"kind": "multisine", **BAND, "spacing": 0.25, "rms": 1.0}
RANDOM = {"kind": "random", **BAND, "rms": 1.0, "duration": 40.0}
KINDS: dict[str, dict[str, Any]] = {
    "multisine": MULTISINE,
    "odd": MULTISINE | {"lines": "odd", "in": "velocity"},
    "schroeder": MULTISINE | {"phases": "schroeder", "in": "displacement", "rms": 1e-3},
    "realisations": MULTISINE | {"realisations": 3, "periods": 2},
    "random": RANDOM,
    "force": RANDOM | {"acts_on": "force", "lamina": "thin", "position": 0.3},
    "burst": RANDOM | {"kind": "burst", "share": 0.3},
}
STEP = 2e-5
DIFFERENCE = 2e-5
"""Relative error of a central difference, (2 pi 20 Hz STEP)^2/6 = 1e-6, where fades add to it."""
GRID = 1e-8
"""Error of the polynomials relative to the largest value; 32 points per period give 2e-9."""
GRAVITY = 9.80665


def with_excitation(**keys: object) -> Case:
    """Return the preset "paper" with another section `[excitation]`."""
    seconds = {"time.step": 1e-3} if keys["kind"] in ("record", "table", "none") else {}
    return preset("paper", {"excitation": keys, "output": {}, "time": {}, **seconds})


def states(keys: dict[str, Any], times: FloatArray) -> FloatArray:
    """Return the course of an excitation with its derivatives."""
    return drive(with_excitation(**keys).excitation).states(times)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("column", [0, 1])
def test_each_column_is_the_derivative_of_the_one_before(kind: str, column: int) -> None:
    t = np.random.default_rng(1).uniform(0.01, 39.0, 500)
    after, before = states(KINDS[kind], t + STEP), states(KINDS[kind], t - STEP)
    exact = states(KINDS[kind], t)[:, column + 1]
    difference = (after - before)[:, column] / (2 * STEP)
    assert difference == pytest.approx(exact, abs=DIFFERENCE * np.abs(exact).max())


@pytest.mark.parametrize("kind", KINDS)
def test_equal_steps_and_single_instants_give_the_same(kind: str) -> None:
    t = np.linspace(0.3, 7.1, 701)
    one_by_one = np.concatenate([states(KINDS[kind], t[k : k + 1]) for k in range(0, 701, 100)])
    together = states(KINDS[kind], t)[::100]
    scale = np.abs(states(KINDS[kind], t)).max(axis=0)
    assert (together - one_by_one) / scale == pytest.approx(0.0, abs=1e-11)


def test_a_multisine_has_its_lines_and_no_others() -> None:
    case = with_excitation(**MULTISINE | {"lines": "odd"})
    N = case.steps_per_period
    values = drive(case.excitation).states(case.time_step * np.arange(N))
    assert case.period == pytest.approx(4.0, rel=1e-14)
    spectrum = np.abs(np.fft.rfft(values[:, 2])) * 2.0 / N
    driven = np.arange(3, 80, 2)  # odd multiples of 0.25 Hz from 0.5 to 20 Hz
    expected = np.zeros(spectrum.size)
    expected[driven] = math.sqrt(2.0 / driven.size)
    assert spectrum == pytest.approx(expected, abs=1e-12)
    assert values[:, 2].std() == pytest.approx(1.0, rel=1e-12)
    assert values[0, 0] == pytest.approx(0.0, abs=1e-12 * np.abs(values[:, 0]).max())
    assert case.is_periodic
    assert not case.is_harmonic


def test_of_three_odd_lines_one_is_left_out() -> None:
    numbers = broadband.line_numbers(1, 59, "odd-random", seed=4)
    odd = np.arange(1, 60, 2).reshape(-1, 3)
    assert np.isin(odd, numbers).sum(axis=1).tolist() == [2] * 10
    others = broadband.line_numbers(1, 59, "odd-random", seed=5)
    assert numbers.tolist() != others.tolist()


def test_schroeder_phases_have_low_peaks() -> None:
    t = np.linspace(0.0, 4.0, 4001)
    crests = {}
    for phases in ("schroeder", "random"):
        value = states(MULTISINE | {"phases": phases}, t)[:, 2]
        crests[phases] = np.abs(value).max() / value.std()
    assert crests["schroeder"] < 1.9 < 2.2 < crests["random"]  # Schroeder 1970: 1.7 of flat ones


def test_a_realisation_follows_the_other_without_a_jump() -> None:
    keys = KINDS["realisations"]
    t = np.arange(0.0, 24.0, 1e-3)
    course = states(keys, t)
    lasts = with_excitation(**keys)
    assert (lasts.n_periods, lasts.period) == (6, pytest.approx(4.0))
    for order in range(3):
        jumps = np.abs(np.diff(course[:, order]))
        slope = 40.0 * math.pi * np.abs(course[:, order]).max()
        assert jumps.max() < 1.5e-3 * slope
    periods = course.reshape(6, 4000, 3)
    scale = np.abs(course).max(axis=(0, 1))
    assert periods[0] == pytest.approx(periods[1], abs=1e-9 * scale)
    first, second = states(keys | {"realisations": 1, "periods": None}, t[:4000]), periods[3]
    assert np.abs(first - second).max() > 0.5 * scale
    single = Lines(np.array([1.0]), np.array([1.0 + 0.0j]))
    assert single.from_zero().states(np.zeros(1))[0] == pytest.approx(
        [0.0, -2 * math.pi, 0.0], abs=1e-12
    )


def test_polynomials_give_the_sum_of_lines() -> None:
    rng = np.random.default_rng(3)
    numbers = np.arange(5, 120)
    amplitude = rng.standard_normal(115) + 1j * rng.standard_normal(115)
    t = rng.uniform(0.0, 30.0, 400)
    exact = Lines(numbers / 10.0, amplitude).states(t)
    gridded = Gridded.of(numbers, amplitude, 10.0).states(t)
    scale = np.abs(exact).max(axis=0)
    error = np.abs(gridded - exact).max(axis=0) / scale
    assert error[0] < GRID
    assert error[1] < 100 * GRID
    assert error[2] < 1000 * GRID


def test_a_random_motion_has_its_size_and_is_normally_distributed() -> None:
    keys = RANDOM | {"duration": 400.0, "low": 2.0}
    value = states(keys, np.arange(1.0, 400.0, 4e-3))[:, 2]
    assert value.std() == pytest.approx(1.0, rel=0.01)  # the fade is not in it
    normal = value / value.std()
    assert np.mean(normal**4) == pytest.approx(3.0, abs=0.2)  # 7,000 independent values
    assert np.mean(normal**3) == pytest.approx(0.0, abs=0.15)


@pytest.mark.parametrize(
    ("unit", "factor"), [("(m/s2)^2/Hz", 1.0), ("m2/s4/Hz", 1.0), ("g^2/Hz", GRAVITY**2)]
)
def test_a_random_motion_has_the_density_of_its_table(
    tmp_path: Path, unit: str, factor: float
) -> None:
    path = tmp_path / "density.csv"
    path.write_text(f"f [Hz], S [{unit}]\n1, 0.01\n10, 1\n100, 1\n")
    T = 50.0
    t = np.arange(0.0, T, T / 8192)
    powers = []
    for seed in range(40):
        keys = {"kind": "random", "low": 2.0, "high": 30.0, "duration": T, "psd": str(path)}
        drive: Any = with_excitation(**keys, seed=seed).excitation
        spectrum = np.fft.rfft(drive.stationary().states(t)[:, 2]) / t.size
        powers.append(2.0 * np.abs(spectrum) ** 2 * T)
    frequency = np.fft.rfftfreq(t.size, T / t.size)
    mean = np.mean(powers, axis=0)
    for low, high in ((2.0, 4.0), (4.0, 8.0), (8.0, 12.0), (12.0, 30.0)):
        band = (frequency >= low) & (frequency <= high)
        density = factor * np.where(frequency < 10.0, (frequency / 10.0) ** 2, 1.0)
        n = 40 * band.sum()  # each is exponentially distributed
        assert mean[band].sum() == pytest.approx(density[band].sum(), rel=5.0 / math.sqrt(n))
    assert mean[(frequency < 1.99) | (frequency > 30.01)].max() < 1e-9 * mean.max()


def test_a_seed_means_the_same_motion() -> None:
    t = np.linspace(0.0, 5.0, 101)
    again = states(RANDOM | {"seed": 7}, t)
    assert np.array_equal(states(RANDOM | {"seed": 7}, t), again)
    assert not np.allclose(states(RANDOM | {"seed": 8}, t), again)
    # the numbers are those of PCG64 (O'Neill 2014), which NumPy promises not to change
    bits = np.random.Generator(np.random.PCG64(np.random.SeedSequence((7, 3)))).random(5)
    assert broadband._uniform(5, 7, 3) == pytest.approx(bits, rel=1e-15)


def test_a_burst_ends_and_a_random_motion_begins_at_rest() -> None:
    value = states(KINDS["burst"], np.array([0.0, 6.0, 11.5, 12.01, 13.0, 39.0]))
    assert not value[[0, 3, 4, 5]].any()
    assert np.abs(value[1:3, 2]).min() > 1e-6


def test_sizes_carry_units() -> None:
    drive: Any = with_excitation(**MULTISINE | {"rms": "0.1 g_0"}).excitation
    assert drive.rms == pytest.approx(0.1 * GRAVITY, rel=1e-12)
    drive = with_excitation(**MULTISINE | {"in": "displacement", "rms": "2 mm"}).excitation
    assert drive.rms == pytest.approx(2e-3, rel=1e-12)
    with pytest.raises(CaseError, match=r"rms.*an acceleration such as"):
        with_excitation(**MULTISINE | {"rms": "2 mm"})


REFUSED: list[tuple[dict[str, Any], str]] = [
    (MULTISINE | {"amplitude": 1.0}, "expected either rms or amplitude, given both"),
    (RANDOM | {"rms": None}, "expected either rms or psd, given none"),
    (MULTISINE | {"high": 0.1}, "expected at least low"),
    (MULTISINE | {"spacing": 30.0}, "expected lines from 0.5 to 20 Hz, given none"),
    (MULTISINE | {"spacing": 1e-6}, "at most 100000 lines"),
    (MULTISINE | {"realisations": 2}, "required of several realisations"),
    (MULTISINE | {"periods": 2}, "time.periods says it"),
    (KINDS["realisations"] | {"phases": "schroeder"}, "always the same"),
    (MULTISINE | {"acts_on": "force"}, "missing, but required"),
    (MULTISINE | {"lamina": "thin"}, "expected none"),
    (KINDS["force"] | {"in": "velocity"}, "which is in N"),
    (RANDOM | {"duration": 0.01, "high": 0.6}, "has a line k/duration"),
    (RANDOM | {"duration": 1e6}, "periods of high"),
    (KINDS["burst"] | {"share": 1.0}, "between 0 and 1"),
]


@pytest.mark.parametrize(("keys", "words"), REFUSED)
def test_what_does_not_fit_is_refused(keys: dict[str, Any], words: str) -> None:
    with pytest.raises(CaseError, match=words):
        with_excitation(**{key: value for key, value in keys.items() if value is not None})


def record(path: Path, heading: str, *columns: FloatArray) -> Path:
    """Write a record with a heading."""
    rows = "\n".join(", ".join(map(repr, row)) for row in np.column_stack(columns).tolist())
    path.write_text(f"{heading}\n{rows}\n")
    return path


def test_a_record_in_g_drives_the_base(tmp_path: Path) -> None:
    t = np.arange(0.0, 4.0, 1e-3) + 12.0
    w = 2.0 * math.pi * 5.0
    path = record(
        tmp_path / "shaker.csv", "time [s], left [mm], shaker [g]", t, 0 * t,
        0.3 * np.cos(w * (t - 12.0)),
    )  # fmt: skip
    case = with_excitation(kind="record", file=str(path), channel="shaker")
    case = case.with_files_checked("case")
    assert case.time.duration == pytest.approx(3.999)
    s = np.linspace(0.1, 3.9, 301)
    course = drive(case.excitation).states(s)
    assert course[:, 2] == pytest.approx(0.3 * GRAVITY * np.cos(w * s), abs=1e-4)
    exact = 0.3 * GRAVITY / w**2 * (1.0 - np.cos(w * s))
    ends = 0.3 * GRAVITY / w**2 * (1.0 - np.cos(w * 3.999)) * s / 3.999  # 0 at both ends
    assert course[:, 0] == pytest.approx(exact - ends, abs=1e-6)


@pytest.mark.parametrize(
    ("unit", "factor", "column"), [("mm", 1e-3, 0), ("mm/s", 1e-3, 1), ("m/s2", 1.0, 2)]
)
def test_a_high_pass_leaves_what_is_fast(
    tmp_path: Path, unit: str, factor: float, column: int
) -> None:
    t = np.arange(0.0, 20.0, 1e-3)
    w = 2.0 * math.pi * 8.0
    slow = 3.0 + 0.5 * t + 2.0 * np.sin(2.0 * math.pi * 0.1 * t)
    path = record(tmp_path / "base.csv", f"time [s], a [{unit}]", t, slow + np.sin(w * t))
    case = with_excitation(kind="record", file=str(path), channel="a", high_pass=1.5)
    middle = np.linspace(8.0, 12.0, 401)
    value = drive(case.excitation).states(middle)[:, column]
    if column == 0:  # it begins at 0
        value = value - value.mean()
    assert value == pytest.approx(factor * np.sin(w * middle), abs=0.01 * factor)


def test_a_record_of_measure_read_is_taken(tmp_path: Path) -> None:
    import delam_fem as df

    t = np.arange(0.0, 1.0, 1e-3)
    path = record(tmp_path / "base.csv", "time [s], base [mm]", t, np.sin(20.0 * t))
    data = df.read_measured(path)
    data["base_displacement"].to_netcdf(tmp_path / "base.nc", engine="h5netcdf")
    keys = {"kind": "record", "channel": "base_displacement"}
    netcdf = drive(with_excitation(**keys, file=str(tmp_path / "base.nc")).excitation)
    table = drive(with_excitation(**keys | {"channel": "base"}, file=str(path)).excitation)
    s = np.linspace(0.0, 0.99, 50)
    assert netcdf.states(s) == pytest.approx(table.states(s), rel=1e-9, abs=1e-9)


def test_records_that_cannot_be_used_are_refused(tmp_path: Path) -> None:
    t = np.arange(0.0, 1.0, 1e-2)
    path = record(tmp_path / "base.csv", "time [s], a [mm], b [K]", t, t, t)

    def course(**keys: object) -> None:
        case = with_excitation(**{"kind": "record", "file": str(path), "channel": "a"} | keys)
        case.with_files_checked("case")

    course()
    with pytest.raises(CaseError, match=r"excitation.channel: expected one of a, b, given 'c'"):
        course(channel="c")
    with pytest.raises(CaseError, match="expected values in m or m/s or m/s2"):
        course(channel="b")
    with pytest.raises(CaseError, match="expected values in m/s2"):
        course(**{"in": "acceleration"})
    with pytest.raises(CaseError, match="half the sampling rate"):
        course(high_pass=60.0)
    record(path, "time [s], a [mm]", t**2 + t, t)
    with pytest.raises(CaseError, match="equal steps of time"):
        course(high_pass=2.0)


def test_an_offset_is_removed_or_refused(tmp_path: Path) -> None:
    t = np.arange(0.0, 2.0 + 5e-4, 1e-3)
    wave = np.cos(2.0 * math.pi * 5.0 * t)
    keys = {"kind": "table", "acts_on": "base", "file": str(tmp_path / "base.csv")}
    record(tmp_path / "base.csv", "time [s], a [m/s2]", t, 2.0 + wave)
    drifting = with_excitation(**keys)
    removed = with_excitation(**keys, offset="remove")
    s = np.linspace(0.0, 2.0, 201)
    drift = drive(drifting.excitation).states(s)[:, 0] - drive(removed.excitation).states(s)[:, 0]
    assert np.abs(drift).max() == pytest.approx(2.0 * 2.0**2 / 8.0, rel=1e-3)
    assert any("offset" in text for text in warnings(drifting))
    assert not any("offset" in text for text in warnings(removed))
    with pytest.raises(CaseError, match=r'"refuse", given the mean 2 m/s2.*drifts by 1 m'):
        with_excitation(**keys, offset="refuse").with_files_checked("case")
    record(tmp_path / "base.csv", "time [s], a [m/s2]", t, wave)
    with_excitation(**keys, offset="refuse").with_files_checked("case")
    record(tmp_path / "base.csv", "time [s], a [mm]", t, wave)
    with pytest.raises(CaseError, match="table of displacements"):
        with_excitation(**keys, offset="remove").with_files_checked("case")


def test_far_motions_and_no_motion_are_told() -> None:
    far = with_excitation(**RANDOM | {"low": 0.05})
    assert any("most of it at excitation.low" in text for text in warnings(far))
    assert not any("excitation" in text for text in warnings(with_excitation(**RANDOM)))
    still = preset("paper", {"excitation": {"kind": "none"}, "output": {},
                             "time": {"step": 1e-3, "duration": 0.1}})  # fmt: skip
    assert any("nothing moves" in text for text in warnings(still))

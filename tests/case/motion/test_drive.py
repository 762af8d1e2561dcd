"""The section `[excitation]`: kinds, keys that exclude each other, tables and their messages."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from delam_fem import HarmonicMotion
from delam_fem.api import Case, CaseError, SweptMotion, base_motion, drive, preset, save_case
from delam_fem.case.excitation import HalfSine, Tabulated, read_series
from delam_fem.case.plausible import warnings

FORCE = {"kind": "force", "lamina": "thin", "position": 0.3, "amplitude": 2.0, "frequency": 5.0}
HAMMER = {
    **{"kind": "hammer", "lamina": "thick", "position": 0.1, "amplitude": 20.0},
    **{"duration": 1e-3},
}
SECONDS = {"time.step": 1e-4, "time.duration": 0.8}


def with_excitation(**keys: object) -> Case:
    """Return the preset "paper" with another section `[excitation]`, its time in seconds."""
    kind = str(keys["kind"])
    time = {"hammer": SECONDS, "table": {"time.step": 1e-3}}.get(kind, {"time.periods": 4})
    left = {"time.periods": None} if kind == "table" else {}
    return preset("paper", {"excitation": keys, "output": {}, **time, **left})


def table(path: Path, value: object, heading: str = "time [s], value", n: int = 201) -> Path:
    """Write a table of values at n times from 0 to 1 s."""
    t = np.linspace(0.0, 1.0, n)
    rows = "\n".join(f"{a!r}, {b!r}" for a, b in zip(t.tolist(), value(t).tolist(), strict=True))
    path.write_text(f"{heading}\n{rows}\n")
    return path


def test_acceleration_is_the_amplitude_of_the_second_derivative() -> None:
    case = with_excitation(kind="harmonic", frequency=63.7, acceleration=0.1)
    motion = drive(case.excitation)
    assert motion == HarmonicMotion(63.7, 0.1 / (2 * math.pi * 63.7) ** 2)
    assert motion.states([0.25 / 63.7])[0, 2] == pytest.approx(-0.1, rel=1e-12)
    assert case.excitation.words == "63.7 Hz, a = 0.1 m/s²"


def test_swept_acceleration_keeps_its_amplitude() -> None:
    case = with_excitation(
        kind="sweep", start_frequency=50.0, end_frequency=80.0, duration=20.0, acceleration=0.1
    )
    motion = drive(case.excitation)
    assert isinstance(motion, SweptMotion)
    for start in (0.0, 10.0, 19.0):
        acceleration = motion.states(np.linspace(start, start + 0.5, 20001))[:, 2]
        assert np.abs(acceleration).max() == pytest.approx(0.1, rel=1e-3)


def test_an_override_of_one_size_replaces_the_other() -> None:
    case = preset("paper", {"excitation.acceleration": 0.1})
    assert (case.excitation.amplitude, case.excitation.acceleration) == (None, 0.1)
    assert case.with_overrides({"excitation.amplitude": 1e-3}).excitation.acceleration is None


def test_metres_do_not_become_newtons() -> None:
    keys = {f"excitation.{key}": value for key, value in FORCE.items() if key != "amplitude"}
    with pytest.raises(CaseError, match=r"excitation.amplitude: missing, but required"):
        preset("paper", keys)


def test_force_and_hammer() -> None:
    force = drive(with_excitation(**FORCE).excitation)
    assert force == HarmonicMotion(5.0, 2.0)
    case = with_excitation(**HAMMER)
    assert (case.n_periods, case.steps_per_period, case.is_periodic) == (100, 80, False)
    assert (case.time_step, case.n_window_periods) == (pytest.approx(1e-4), 100)
    blow = drive(case.excitation)
    t = np.linspace(0.0, 2e-3, 20001)
    F, rate, bend = blow.states(t).T
    assert F.max() == pytest.approx(20.0, rel=1e-7)
    assert 1e-7 * F.sum() == pytest.approx(2.0 / math.pi * 20.0 * 1e-3, rel=1e-6)
    assert (F[t >= 1e-3] == 0.0).all()
    inside = slice(1, 9000)
    assert np.gradient(F, t)[inside] == pytest.approx(rate[inside], abs=1e-2)
    assert np.gradient(rate, t)[inside] == pytest.approx(bend[inside], abs=10.0)
    assert HalfSine(1.0, 1.0, start=0.5).states(np.array([0.4, 1.0]))[:, 0].tolist() == [0.0, 1.0]


def test_swept_force() -> None:
    keys = {key: value for key, value in FORCE.items() if key != "frequency"}
    case = with_excitation(**keys, start_frequency=1.0, end_frequency=4.0, duration=3.0)
    assert (case.n_periods, case.is_periodic) == (12, False)
    assert drive(case.excitation) == SweptMotion(1.0, 4.0, 3.0, 2.0)


def test_table_of_displacements(tmp_path: Path) -> None:
    w = 2 * math.pi * 2.0
    file = table(tmp_path / "base.csv", lambda t: 0.5 + 1e-3 * np.sin(w * t), "t [s], q [m]")
    case = with_excitation(kind="table", file=str(file), acts_on="base")
    assert (case.n_periods * case.period, case.time_step) == (1.0, pytest.approx(1e-3))
    t = np.linspace(0.0, 1.0, 57)
    expected = HarmonicMotion(2.0, 1e-3).states(t)
    assert np.abs(drive(case.excitation).states(t) - expected).max(axis=0) == pytest.approx(
        np.zeros(3), abs=1e-6
    )


def test_table_of_accelerations_does_not_drift(tmp_path: Path) -> None:
    w = 2 * math.pi * 5.0
    heading = "# measured\ntime [s], acceleration [m/s²]"
    file = table(tmp_path / "a.csv", lambda t: -(w**2) * 1e-3 * np.sin(w * t), heading, 1001)
    motion = drive(with_excitation(kind="table", file=str(file), acts_on="base").excitation)
    assert isinstance(motion, Tabulated)
    t = np.linspace(0.0, 1.0, 301)
    expected = HarmonicMotion(5.0, 1e-3).states(t)
    assert np.abs(motion.states(t) - expected)[:, 0].max() < 1e-9
    assert np.abs(motion.states(t) - expected)[:, 1].max() < 1e-7


def test_table_of_forces(tmp_path: Path) -> None:
    file = table(tmp_path / "f.csv", lambda t: t * (1.0 - t), "time [s], force [N]")
    case = with_excitation(
        kind="table", file=str(file), acts_on="force", lamina="thin", position=0.2
    )
    rows = drive(case.excitation).states(np.array([0.5, 1.5]))
    assert rows[0, :2] == pytest.approx([0.25, 0.0], abs=1e-3)
    assert (rows[1] == 0.0).all()
    again = Case.from_toml(case.to_toml())
    assert again == case


def test_table_is_saved_with_its_case(tmp_path: Path) -> None:
    file = table(tmp_path / "f.csv", lambda t: t, "time [s], value [m]")
    case = with_excitation(kind="table", file=str(file), acts_on="base")
    save_case(case, tmp_path / "run")
    text = (tmp_path / "run" / "case.toml").read_text()
    assert 'file = "f.csv"' in text
    assert (tmp_path / "run" / "f.csv").read_text() == file.read_text()


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"kind": "harmonic", "frequency": 1.0}, "amplitude: missing, but required unless"),
        (
            {"kind": "harmonic", "frequency": 1.0, "amplitude": 1.0, "acceleration": 1.0},
            "excitation.acceleration: ",
        ),
        ({**FORCE, "lamina": "middle"}, "excitation.lamina: "),
        ({**FORCE, "position": 0.7}, "excitation.position: "),
        ({**FORCE, "position": -0.1}, "excitation.position: "),
        ({**FORCE, "duration": 2.0}, "excitation.duration: "),
        ({**FORCE, "frequency": None}, "excitation.frequency: missing, but required; or start_fr"),
        ({**HAMMER, "duration": 0.0}, "excitation.duration: "),
        ({**HAMMER, "period": 0.2}, "excitation.period: unknown key"),
        ({**HAMMER, "start": 0.7995}, "excitation.start: "),
        ({"kind": "table", "file": "x.csv", "acts_on": "base"}, "excitation.file: no such file: /"),
        ({"kind": "table", "file": "x.csv", "acts_on": "tip"}, "acts_on: "),
        (
            {"kind": "table", "file": "x.csv", "acts_on": "force"},
            'excitation.lamina: missing, but required with acts_on = "force"',
        ),
    ],
)
def test_bad_excitation(keys: dict[str, object], expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        with_excitation(**{key: value for key, value in keys.items() if value is not None})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time [mm], force [N]\n", "line 1: "),
        ("time [s], a [m/s2]\n", "line 1: "),
        ("1.0, 0.0\n", "line 1: .*given 1.0; subtract the first time"),
        ("0.0, 0.0\n0.0, 1.0\n", "line 2: .*given 0.0 after 0.0"),
        ("0.0, 0.0, 1.0\n", "line 1: .*given 3 columns"),
        (
            "0.0, 0.0\n1.0, x\n",
            "line 2: .*given a word in column 2",
        ),
        (
            "0.0, nan\n1.0, x\n",
            "line 1: .*given 0.0, nan",
        ),
    ],
)
def test_bad_table(tmp_path: Path, text: str, expected: str) -> None:
    file = tmp_path / "f.csv"
    is_short = "subtract" in expected or "after" in expected
    more = "".join(f"{k}, 0\n" for k in range(2, 9)) if is_short else ""
    file.write_text(text + more)
    with pytest.raises(CaseError, match=expected):
        with_excitation(kind="table", file=str(file), acts_on="force", lamina="thin", position=0.2)


def test_table_must_cover_the_run(tmp_path: Path) -> None:
    file = table(tmp_path / "f.csv", lambda t: t)
    case = with_excitation(kind="table", file=str(file), acts_on="base")
    with pytest.raises(CaseError, match=r"expected times up to time.duration = 1.1 s, given 1 s"):
        case.with_overrides({"time.duration": 1.1})


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"time.step": None}, 'time.step: missing, but required [s] with excitation.kind = "ham'),
        ({"time.duration": None}, "time.duration: missing, but required [s]"),
        ({"excitation.start": 0.79, "output.window_periods": 1}, "within the window, 0.792 to 0.8"),
        ({"excitation.duration": 0.9}, "expected a blow within the window, 0 to 0.8 s, given 0"),
        (
            {"excitation.kind": "harmonic", "excitation.frequency": 2.0, "excitation.amplitude": 1},
            "time.step: expected time.steps_per_period instead, because the excitation repeats; g",
        ),
    ],
)
def test_bad_time_of_a_blow(keys: dict[str, object], expected: str) -> None:
    with pytest.raises(CaseError, match=re.escape(expected)):
        with_excitation(**HAMMER).with_overrides(keys)


def test_two_steps_are_one_too_many() -> None:
    text = with_excitation(**HAMMER).to_toml()
    with pytest.raises(CaseError, match=r"time.step: "):
        Case.from_toml(text.replace("[time]\n", "[time]\nsteps_per_period = 100\n"))


@pytest.mark.parametrize(
    ("duration", "step", "steps", "periods"),
    [(1.0, 1e-5, 1000, 100), (0.101, 1e-3, 4, 26), (1e-3, 1e-2, 4, 1), (2.0, 0.9e-5, 2223, 100)],
)
def test_steps_cover_the_run_and_are_no_longer_than_asked(
    duration: float, step: float, steps: int, periods: int
) -> None:
    blow = {"excitation.duration": duration, "time.duration": duration, "time.step": step}
    case = with_excitation(**HAMMER).with_overrides(blow)
    assert (case.steps_per_period, case.n_periods) == (steps, periods)
    assert case.n_periods * case.period == pytest.approx(duration, rel=1e-12)
    assert case.time_step <= step * (1.0 + 1e-9)


def test_the_window_of_a_drive_that_does_not_repeat_is_the_whole_run() -> None:
    case = with_excitation(**HAMMER)
    assert (case.n_window_periods, case.frames_per_period) == (100, 5)
    late = {"excitation.start": 0.75, "output.window_periods": 10, "output.fields_per_period": 0}
    few = case.with_overrides(late)
    assert (few.n_window_periods, few.frames_per_period) == (10, 0)
    for variant in (case, few):
        again = Case.from_toml(variant.to_toml())
        assert (again, again.n_window_periods) == (variant, variant.n_window_periods)
        assert again.frames_per_period == variant.frames_per_period and not again.unread
    sweep = {"kind": "sweep", "start_frequency": 1.0, "end_frequency": 5.0, "duration": 40.0}
    swept = with_excitation(**sweep, amplitude=1e-3)
    assert (swept.n_periods, swept.n_window_periods, swept.frames_per_period) == (200, 200, 2)


def test_few_steps_of_a_blow_are_told() -> None:
    case = with_excitation(**HAMMER)
    assert warnings(case) == [
        "time.step = 0.0001 s is long: the blow of 0.001 s has 10 steps, below 20"
    ]
    assert not warnings(case.with_overrides({"time.step": 5e-5}))


def test_a_table_lasts_to_its_last_time_and_a_little_longer() -> None:
    t = np.linspace(0.0, 2.0, 9)
    force, motion = (Tabulated.of(t, 1.0 + t, unit) for unit in ("N", "m"))
    at = np.array([-0.5, 2.0, 2.0 + 1.9e-9, 2.0 + 2.1e-9, 3.0])
    assert force.states(at)[:, 0].tolist() == pytest.approx([1.0, 3.0, 3.0, 0.0, 0.0])
    assert motion.states(at)[:, 0].tolist() == pytest.approx([0.0, 2.0, 2.0, 2.0, 2.0])
    assert (force.ends, motion.ends, force.length) == (True, False, 2.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,1\n" * 5, ": expected at least 6 rows, given 5"),
        ("#\n1,1\n2,1\n3,1\n4,1\n5,1\n6,1\n", ", line 2: expected times from 0, given 1.0; "
         "subtract the first time"),
        ("0,1\n1,1\n2,1\n2,1\n4,1\n5,1\n", ", line 4: expected times to increase, given 2.0 "
         "after 2.0"),
        ("t [s], v [N]\n0,1\n1,1\n2,1\n3,1\n4,1\n5,1\n", ", line 1: expected values in m or "
         "m/s2, or in a multiple, in column 2, given N"),
    ],
)  # fmt: skip
def test_messages_of_tables_are_exact(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "b.csv"
    path.write_text(text)
    with pytest.raises(CaseError) as error:
        read_series(path, "base")
    assert str(error.value) == f"excitation.file {path}{message}"
    path.write_text("0,1\n1,3\n2,4\n")
    time, value, unit = read_series(path, "force", 3)
    assert (time.tolist(), value.tolist(), unit) == ([0.0, 1.0, 2.0], [1.0, 3.0, 4.0], "N")


def test_motions_are_those_of_the_base() -> None:
    with pytest.raises(CaseError) as error:
        base_motion(with_excitation(**FORCE).excitation)
    told = "excitation.kind: expected 'harmonic' or 'sweep' of the base, given 'force'"
    assert str(error.value) == told
    for frequency, amplitude, words in (
        (0.0, 1.0, "frequency: expected a number above 0 [Hz], given 0.0"),
        (math.inf, 1.0, "frequency: expected a number above 0 [Hz], given inf"),
        (1.0, math.nan, "amplitude: expected a finite number [m], given nan"),
    ):
        with pytest.raises(CaseError) as error:
            HarmonicMotion(frequency, amplitude)
        assert str(error.value) == words

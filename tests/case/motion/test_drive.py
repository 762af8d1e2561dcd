"""The section `[excitation]`: kinds, keys that exclude each other, tables and their messages."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from delam_fem.case.definition import Case
from delam_fem.case.files import preset, save_case
from delam_fem.case.motion.excitation import HarmonicMotion, SweptMotion, TabulatedMotion, drive
from delam_fem.case.motion.force import HalfSine
from delam_fem.case.toml import CaseError

FORCE = {"kind": "force", "lamina": "thin", "position": 0.3, "amplitude": 2.0, "frequency": 5.0}
HAMMER = {
    **{"kind": "hammer", "lamina": "thick", "position": 0.1, "amplitude": 20.0},
    **{"duration": 1e-3, "period": 0.2},
}


def with_excitation(**keys: object) -> Case:
    """Return the preset "paper" with another section `[excitation]`."""
    return preset("paper", {"excitation": keys, "time.periods": 4})


def table(path: Path, value: object, heading: str = "time [s], value", n: int = 201) -> Path:
    """Write a table of values at n times from 0 to 1 s."""
    t = np.linspace(0.0, 1.0, n)
    rows = "\n".join(f"{a!r}, {b!r}" for a, b in zip(t.tolist(), value(t).tolist(), strict=True))
    path.write_text(f"{heading}\n{rows}\n")
    return path


def test_acceleration_is_the_amplitude_of_the_second_derivative() -> None:
    case = with_excitation(kind="harmonic", frequency=63.7, acceleration=0.1)
    motion = drive(case)
    assert motion == HarmonicMotion(63.7, 0.1 / (2 * math.pi * 63.7) ** 2)
    assert motion.states([0.25 / 63.7])[0, 2] == pytest.approx(-0.1, rel=1e-12)
    assert case.excitation.words == "63.7 Hz, a = 0.1 m/s²"


def test_swept_acceleration_keeps_its_amplitude() -> None:
    case = with_excitation(
        kind="sweep", start_frequency=50.0, end_frequency=80.0, duration=20.0, acceleration=0.1
    )
    motion = drive(case)
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
    force = drive(with_excitation(**FORCE))
    assert force == HarmonicMotion(5.0, 2.0)
    case = with_excitation(**HAMMER)
    assert (case.period, case.n_periods, case.is_periodic) == (0.2, 4, False)
    blow = drive(case)
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
    assert drive(case) == SweptMotion(1.0, 4.0, 3.0, 2.0)


def test_table_of_displacements(tmp_path: Path) -> None:
    w = 2 * math.pi * 2.0
    file = table(tmp_path / "base.csv", lambda t: 0.5 + 1e-3 * np.sin(w * t), "t [s], q [m]")
    case = with_excitation(kind="table", file=str(file), acts_on="base")
    assert (case.period, case.time_step) == (0.25, pytest.approx(0.25 / 1000))
    t = np.linspace(0.0, 1.0, 57)
    expected = HarmonicMotion(2.0, 1e-3).states(t)
    assert np.abs(drive(case).states(t) - expected).max(axis=0) == pytest.approx(
        np.zeros(3), abs=1e-6
    )


def test_table_of_accelerations_does_not_drift(tmp_path: Path) -> None:
    w = 2 * math.pi * 5.0
    heading = "# measured\ntime [s], acceleration [m/s²]"
    file = table(tmp_path / "a.csv", lambda t: -(w**2) * 1e-3 * np.sin(w * t), heading, 1001)
    motion = drive(with_excitation(kind="table", file=str(file), acts_on="base"))
    assert isinstance(motion, TabulatedMotion)
    t = np.linspace(0.0, 1.0, 301)
    expected = HarmonicMotion(5.0, 1e-3).states(t)
    assert np.abs(motion.states(t) - expected)[:, 0].max() < 1e-9
    assert np.abs(motion.states(t) - expected)[:, 1].max() < 1e-7


def test_table_of_forces(tmp_path: Path) -> None:
    file = table(tmp_path / "f.csv", lambda t: t * (1.0 - t), "time [s], force [N]")
    case = with_excitation(
        kind="table", file=str(file), acts_on="force", lamina="thin", position=0.2, period=0.1
    )
    rows = drive(case).states(np.array([0.5, 1.5]))
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
            "excitation.acceleration: expected either amplitude",
        ),
        ({**FORCE, "lamina": "middle"}, "excitation.lamina: expected one of thick, thin, given 'm"),
        ({**FORCE, "position": 0.7}, "excitation.position: expected at most the length 0.685 m, g"),
        ({**FORCE, "position": -0.1}, "excitation.position: expected a number of at least 0"),
        ({**FORCE, "duration": 2.0}, "excitation.duration: expected either frequency or"),
        ({**FORCE, "frequency": None}, "excitation.frequency: missing, but required; or start_fr"),
        ({**HAMMER, "duration": 0.0}, "excitation.duration: expected a positive number, given 0"),
        ({**HAMMER, "period": None}, "excitation.period: missing, but required"),
        ({"kind": "table", "file": "x.csv", "acts_on": "base"}, "excitation.file: no such file: /"),
        ({"kind": "table", "file": "x.csv", "acts_on": "tip"}, "acts_on: expected 'base' or 'for"),
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
        ("time [ms], force [N]\n", r"line 1: expected times in s, given ms"),
        ("time [s], force [kN]\n", "line 1: expected values in N with acts_on = .force., given"),
        ("time [s], a [m/s2]\n", "line 1: expected values in N with acts_on = .force., given"),
        ("1.0, 0.0\n", "line 1: expected times from 0, given 1.0; subtract the first time"),
        ("0.0, 0.0\n0.0, 1.0\n", "line 2: expected times to increase, given 0.0 after 0.0"),
        ("0.0, 0.0, 1.0\n", "line 1: expected two numbers time, value, given 3 columns"),
        (
            "0.0, 0.0\n1.0, x\n",
            "line 2: expected two numbers time, value, given a word in column 2",
        ),
        (
            "0.0, nan\n1.0, x\n",
            "line 1: expected finite numbers, given 0.0, nan",
        ),
    ],
)
def test_bad_table(tmp_path: Path, text: str, expected: str) -> None:
    file = tmp_path / "f.csv"
    more = "" if "expected t" not in expected else "".join(f"{k}, 0\n" for k in range(2, 9))
    file.write_text(text + more)
    with pytest.raises(CaseError, match=expected):
        with_excitation(kind="table", file=str(file), acts_on="force", lamina="thin", position=0.2)


def test_table_must_cover_the_run(tmp_path: Path) -> None:
    file = table(tmp_path / "f.csv", lambda t: t)
    with pytest.raises(CaseError, match=r"given 1 s; set time.periods to at most 3"):
        with_excitation(kind="table", file=str(file), acts_on="base", period=0.3)

"""Several drives that add up: sums, common periods, keys, refusals, runs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import Case, CaseError, drive, parts_of, places_of, preset, save_case

SLOW = {"kind": "harmonic", "frequency": 2.0, "amplitude": 1e-3}
FAST = {"kind": "harmonic", "frequency": 3.25, "acceleration": 2.0}
MULTISINE = {"kind": "multisine", "low": 0.5, "high": 3.0, "spacing": 0.1, "rms": 1.0}
SWEEP = {"kind": "sweep", "start_frequency": 1.0, "end_frequency": 4.0, "duration": 6.0,
         "amplitude": 1e-3}  # fmt: skip
AT = {"lamina": "thin", "position": 0.3}
PUSH = {"kind": "force", **AT, "amplitude": 0.05, "frequency": 2.0}
BLOW = {"kind": "hammer", **AT, "amplitude": 2.0, "duration": 0.02, "start": 0.4}
SMALL = {"mesh.elements": 5, "time": {"steps_per_period": 40, "periods": 2}, "output": {},
         "output.fields_per_period": 4}  # fmt: skip


def with_drives(*drives: dict[str, Any], **more: Any) -> Case:
    """Return a small case with several drives."""
    keys = {key.replace("__", "."): value for key, value in more.items()}
    return preset("paper", {**SMALL, "excitation": list(drives), **keys})


def test_drives_add_up() -> None:
    case = with_drives(SLOW, FAST, MULTISINE)
    t = np.linspace(0.0, 3.0, 301)
    single = [preset("paper", {"excitation": keys}) for keys in (SLOW, FAST, MULTISINE)]
    expected = sum(drive(one.excitation).states(t) for one in single)
    assert drive(case.excitation).states(t) == pytest.approx(expected, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize(
    ("drives", "period", "turns"),
    [
        ((SLOW, FAST), 4.0, 13),  # 2 Hz = 8/4, 3.25 Hz = 13/4
        ((SLOW, FAST | {"frequency": 3.0}), 1.0, 3),
        ((SLOW, MULTISINE), 10.0, 30),  # of 0.1 Hz, up to 3 Hz
        ((SLOW, MULTISINE | {"high": 1.0}), 10.0, 20),
        ((FAST | {"frequency": 1.23}, FAST | {"frequency": 3.21}), 100.0 / 3.0, 107),
    ],
)
def test_the_common_period_is_that_of_all(drives: Any, period: float, turns: int) -> None:
    case = with_drives(*drives)
    assert case.is_periodic
    assert not case.is_harmonic
    assert case.period == pytest.approx(period, rel=1e-12)
    assert case.steps_per_period == 40 * turns
    t = np.linspace(0.0, 1.0, 50)
    motion = drive(case.excitation)
    scale = np.abs(motion.states(t)).max(axis=0)
    assert (motion.states(t + period) - motion.states(t)) / scale == pytest.approx(0.0, abs=1e-9)
    assert f"common period {period:.6g} s" in case.title


def test_each_place_has_a_course_and_the_base_is_the_first() -> None:
    case = with_drives(PUSH, BLOW | {"position": 0.2}, SLOW, PUSH | {"frequency": 3.0},
                       time={"step": 1e-3, "duration": 1.0})  # fmt: skip
    places = [[one.kind for one in group] for group in places_of(case.excitation)]
    assert places == [["harmonic"], ["force", "force"], ["hammer"]]
    assert case.excitation.acts_on == "base"
    t = np.linspace(0.0, 3.0, 301)
    table = drive(case.excitation).states(t)
    assert table.shape == (301, 9)
    both = 0.05 * (np.sin(4.0 * np.pi * t) + np.sin(6.0 * np.pi * t))
    assert table[:, 3] == pytest.approx(both, abs=1e-12)
    assert with_drives(PUSH, PUSH | {"position": 0.2}).excitation.acts_on == "force"


def test_an_irrational_ratio_has_no_period_and_needs_a_duration() -> None:
    irrational = FAST | {"frequency": 2.0 * math.sqrt(2.0)}
    with pytest.raises(CaseError, match=r"time.duration: missing, but required"):
        with_drives(SLOW, irrational)
    case = with_drives(SLOW, irrational, time={"steps_per_period": 40, "duration": 3.0})
    assert not case.is_periodic
    assert "no common period" in case.title
    assert df.run(case).summary["settled"] is None


def test_a_list_of_one_is_one() -> None:
    assert with_drives(SLOW).excitation == preset("paper", {"excitation": SLOW}).excitation
    assert parts_of(with_drives(SLOW).excitation) == (with_drives(SLOW).excitation,)


def test_keys_count_from_one_and_files_keep_them() -> None:
    case = with_drives(SLOW, FAST)
    assert "[[excitation]]" in case.to_toml()
    assert Case.from_toml(case.to_toml()) == case
    changed = case.with_overrides({"excitation.2.frequency": "3000 mHz"})
    assert parts_of(changed.excitation)[1].top_frequency == 3.0
    assert df.Sweep(case, {"excitation.1.amplitude": [1e-3, 2e-3]}).dimensions[0].units == "m"


def test_a_table_among_them_is_found_beside_the_file(tmp_path: Path) -> None:
    t = np.linspace(0.0, 2.0, 201)
    rows = "".join(f"{a!r}, {1e-3 * math.sin(7 * a)!r}\n" for a in t.tolist())
    (tmp_path / "base.csv").write_text(f"time [s], base [m]\n{rows}")
    table = {"kind": "table", "acts_on": "base", "file": str(tmp_path / "base.csv")}
    case = with_drives(SLOW, table, time={"step": 4e-3})
    assert case.time.duration == pytest.approx(2.0)
    again = df.load_case(save_case(case, tmp_path / "copy"))
    states = [drive(one.excitation).states(t) for one in (case, again)]
    assert np.array_equal(*states)
    assert case.files.keys() == {"excitation.2.file"}


REFUSED: list[tuple[tuple[dict[str, Any], ...], str]] = [
    ((SLOW, {"kind": "none"}), 'no "none" among several'),
    ((SLOW, FAST | {"frequency": -1.0}), r"excitation.2.frequency: expected a positive number"),
    ((SLOW, {"kind": "several"}), r"excitation.2.kind: expected 'harmonic'.*'none', given"),
    ((), "one or more"),
]


@pytest.mark.parametrize(("drives", "words"), REFUSED)
def test_what_does_not_fit_is_refused(drives: Any, words: str) -> None:
    with pytest.raises(CaseError, match=words):
        with_drives(*drives)


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_a_blow_during_a_sweep_is_the_sum_of_both(engine: Any) -> None:
    seconds = {"time": {"step": 2e-3, "duration": 1.5}, "contact": {"law": "none"}}
    sweep = PUSH | {"start_frequency": 1.0, "end_frequency": 4.0, "duration": 1.5}
    del sweep["frequency"]
    runs = [df.run(with_drives(*keys, **seconds), engine) for keys in ((sweep, BLOW), (sweep,))]
    alone = df.run(with_drives(BLOW, **seconds), engine)
    both, swept, struck = (
        result.history["tip_displacement"].to_numpy() for result in (*runs, alone)
    )
    assert both == pytest.approx(swept + struck, abs=1e-12 * np.abs(both).max())
    assert np.abs(struck).max() > 0.1 * np.abs(swept).max()


def test_two_tones_make_a_model_that_settles_in_both_engines() -> None:
    case = with_drives(SLOW, FAST, contact__law="none", time__periods=40, time__steps_per_period=60)
    case = case.with_overrides({f"lamina.{k}.damping_ratio": 0.1 for k in (1, 2)})
    results = [df.run(case, engine) for engine in ("petsc", "compiled")]
    for result in results:
        assert result.summary["settled"] == "settled"
        assert result.summary["periodicity"] == 1
        assert result.summary["thd"] is None
    one, other = (result.history["tip_displacement"].to_numpy() for result in results)
    assert one == pytest.approx(other, abs=1e-9 * np.abs(one).max())


def test_studies_of_one_sine_refuse_several() -> None:
    case = preset("embedded", {"excitation": [SLOW | {"frequency": 20.0}, FAST]})
    with pytest.raises(CaseError, match="harmonic"):
        df.detect(case)

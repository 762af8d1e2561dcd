"""Runs that judge themselves: linear ones, ones that end when settled, extended ones."""

from __future__ import annotations

import logging
import os
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import example, given, settings, strategies as st
from synthetic import STEPS, small_case

import delam_fem as df
from delam_fem.api import EngineName, assemble, diagnostics, session_of
from delam_fem.numerics.settling import TOLERANCE, Settling
from delam_fem.results import quality
from delam_fem.results.diagnostics import periodicity

SMALL = {
    "mesh.elements": 4, "time.steps_per_period": 60, "output.window_periods": 4,
    "output.fields_per_period": 0,
}  # fmt: skip
STRIPS = {
    f"lamina.{lamina}.{key}": value
    for lamina in (1, 2)
    for key, value in {
        "density": 2700.0, "young_modulus": 7e10, "bending_stiffness": None, "length": 0.4,
        "width": 0.03, "damping_ratio": 0.005,
    }.items()
}  # fmt: skip
"""Aluminium strips, 2 and 1 mm thick."""
EVERYTHING = ("tip_displacement", "strobe_displacement", "strobe_velocity", "energy_strain")


def case_of(**keys: object) -> df.Case:
    return df.preset("paper", SMALL | {k.replace("__", "."): v for k, v in keys.items()})


def judged(case: df.Case) -> tuple[Settling, int | None]:
    """Run a case without a dataset; return the verdict, and the period that strobes alone show."""
    structure = assemble(case, needs_dolfinx=False)
    decay = quality.decay_of(case, structure) * case.period
    with session_of(case, structure.operators, engine="compiled") as opened:
        assert opened.run() == "completed"
        recorder = opened.recorder
        half_range = np.ptp(recorder.envelope[-4:], axis=(0, 1)) / 2.0
        period = periodicity(recorder.strobe[:, 0, :2].T, half_range[:2])[0]
        return quality.verdict_of(recorder, 2, decay), period


def test_a_beat_that_looks_like_period_three_is_not_settled() -> None:
    keys = {"contact.law": "none", "excitation.frequency": 13.667, "time.periods": 160}
    case = df.preset("paper", SMALL | STRIPS | keys)
    verdict, period = judged(case)
    assert period == 3, "the strobes alone look like period 3"
    assert (verdict.word, verdict.periodicity) == ("not settled", None)
    assert verdict.transient == pytest.approx(0.07, abs=0.02)
    omega = case.lamina[1].angular_frequencies(1)[0]
    assert verdict.decay == pytest.approx(0.005 * omega / 13.667, rel=1e-3)
    assert verdict.observed_decay == pytest.approx(verdict.decay, rel=0.2)
    assert verdict.periods_needed is not None
    needed = 160 + verdict.periods_needed
    longer, _ = judged(case.with_overrides({"time.periods": needed}))
    assert longer.transient == pytest.approx(TOLERANCE, rel=0.2)
    longer, _ = judged(case.with_overrides({"time.periods": needed + 40}))
    assert (longer.word, longer.periodicity) == ("settled", 1)


@given(
    damping=st.floats(0.0005, 0.03),
    frequency=st.floats(0.8, 25.0),
    periods=st.integers(12, 200),
    law=st.sampled_from(["none", "newton-penalty", "penalty"]),
)
@example(damping=0.001, frequency=1.4357 * 3.0, periods=200, law="none")
@example(damping=0.001, frequency=1.4357 * 2.0, periods=200, law="penalty")
@settings(max_examples=25, deadline=None, derandomize=True)
def test_no_linear_run_is_called_subharmonic(
    damping: float, frequency: float, periods: int, law: str
) -> None:
    """Without a law, or with a gap of a metre that never closes."""
    case = case_of(
        excitation__frequency=frequency, time__periods=periods, contact__law=law,
        gap__tip=1.0, gap__exponent=0.001, excitation__amplitude=1e-4,
        lamina__thick__damping_ratio=damping, lamina__thin__damping_ratio=damping,
    )  # fmt: skip
    verdict, _ = judged(case)
    assert verdict.periodicity in (None, 1)
    assert verdict.word != "irregular"


@pytest.mark.parametrize("law", ["newton", "newton-penalty", "penalty", "newton@moreau-jean"])
def test_contact_is_noticed_whatever_the_law(law: str) -> None:
    case = case_of(contact__law=law, time__periods=3)
    structure = assemble(case, needs_dolfinx=False)
    with session_of(case, structure.operators) as opened:
        opened.run()
        assert quality.touches(opened.recorder)[1:].all()


@pytest.mark.parametrize("engine", ["compiled", "petsc"])
def test_a_run_ends_when_it_has_settled(engine: EngineName) -> None:
    case = case_of(time__periods="settled", excitation__frequency=1.25)
    result = df.run(case, engine)
    k = result.summary["periods"]
    assert quality.AGREEING * quality.EVERY <= k < 300 and k % quality.EVERY == 0
    assert result.history.sizes["period"] == k
    assert (result.summary["settled"], result.summary["outcome"]) == ("settled", "completed")
    counted = df.run(case.with_overrides({"time.periods": k}), engine)
    for name in EVERYTHING:
        assert np.array_equal(result.history[name], counted.history[name]), name
    before = df.run(case.with_overrides({"time.periods": k - quality.EVERY}), engine)
    earlier = df.run(case.with_overrides({"time.periods": k - 2 * quality.EVERY}), engine)
    assert "not settled" in (before.summary["settled"], earlier.summary["settled"])


def test_a_run_that_reaches_the_limit_says_so(caplog: pytest.LogCaptureFixture) -> None:
    keys = {"lamina.thin.damping_ratio": 0.0005, "contact.law": "none"}
    case = case_of(time__periods="settled", time__most_periods=50).with_overrides(keys)
    with caplog.at_level(logging.WARNING):
        summary = df.run(case, "compiled").summary
    assert (summary["settled"], summary["periods"], summary["periodicity"]) == (
        "not settled", 50, None,
    )  # fmt: skip
    assert summary["periodicity_class"] == "not settled"
    (text,) = (text for text in summary["warnings"] if "most_periods" in text)
    assert text.startswith("not settled after 50 periods, the limit time.most_periods; it may need")
    assert text in caplog.text


def test_only_a_periodic_excitation_can_settle() -> None:
    keys = {"excitation.kind": "sweep", "excitation.start_frequency": 2.0}
    keys |= {"excitation.end_frequency": 4.0, "excitation.duration": 1.0}
    with pytest.raises(df.CaseError, match=r"time\.periods: "):
        case_of(time__periods="settled").with_overrides(keys)
    summary = df.run(case_of().with_overrides(keys), "compiled").summary
    assert summary["settled"] is None and summary["settling"] is None


def interrupted(case: df.Case, folder: Path, after: int, **options: int) -> None:
    """Run a case, and stop it by Ctrl-C after a number of periods."""

    def stop(done: int, of: int) -> None:
        if done == after:
            os.kill(os.getpid(), signal.SIGINT)

    result = df.run(case, "compiled", directory=folder, progress=stop, **options)
    assert result.summary["outcome"] == "interrupted"


def test_a_resumed_run_ends_after_the_same_period(tmp_path: Path) -> None:
    case = case_of(time__periods="settled", excitation__frequency=1.25)
    complete_run = df.run(case, "compiled")
    interrupted(case, tmp_path, complete_run.summary["periods"] - 10)
    resumed = df.run(case, "compiled", directory=tmp_path, resume=True)
    assert resumed.summary["periods"] == complete_run.summary["periods"]
    for name in EVERYTHING:
        assert np.array_equal(resumed.history[name], complete_run.history[name]), name


@pytest.mark.parametrize("engine", ["compiled", "petsc"])
def test_an_extended_run_is_one_long_run(engine: EngineName, tmp_path: Path) -> None:
    """Two periods more than four: the window of four reaches into the first run."""
    case = case_of(time__periods=4)
    df.run(case, engine).save_numbers(tmp_path)
    extended = df.run(case, engine, directory=tmp_path, extend=2)
    long = df.run(case.with_overrides({"time.periods": 6}), engine)
    assert extended.case == long.case
    for name, variable in long.history.variables.items():
        if variable.dtype.kind in "fiu":
            assert np.array_equal(extended.history[name], variable), name
    extended.save_numbers(tmp_path)
    (tmp_path / "checkpoint.npz").unlink()  # as `save` does when figures and page are there, too
    again = df.run(extended.case, engine, directory=tmp_path, extend=1)
    assert again.history.sizes["period"] == 7


def test_a_run_that_ended_settled_is_extended_by_a_number(tmp_path: Path) -> None:
    case = case_of(time__periods="settled", excitation__frequency=1.25)
    first = df.run(case, "compiled")
    first.save_numbers(tmp_path)
    extended = df.run(case, "compiled", directory=tmp_path, extend=5)
    assert extended.summary["periods"] == first.summary["periods"] + 5
    assert extended.case.time.periods == first.summary["periods"] + 5


def test_an_interrupted_extension_goes_on(tmp_path: Path) -> None:
    case = case_of(time__periods=4)
    df.run(case, "compiled").save_numbers(tmp_path)
    interrupted(case, tmp_path, 10, extend=9)
    assert df.load_case(tmp_path / "case.toml") == case
    longer = case.with_overrides({"time.periods": 13})
    resumed = df.run(longer, "compiled", directory=tmp_path, resume=True)
    complete_run = df.run(longer, "compiled")
    assert np.array_equal(resumed.history["tip_velocity"], complete_run.history["tip_velocity"])


def test_what_cannot_be_extended_is_refused(tmp_path: Path) -> None:
    case = case_of(time__periods=2)
    for extend, folder in ((-1, tmp_path), (3, None)):
        with pytest.raises(df.CaseError, match="extend: "):
            df.run(case, directory=folder, extend=extend)
    with pytest.raises(df.CaseError, match=r"extend: .* no file .*state\.npz"):
        df.run(case, directory=tmp_path, extend=3)
    df.run(case, "compiled").save_numbers(tmp_path)
    with pytest.raises(df.CaseError, match=r'engine: "compiled" there, "petsc" here'):
        df.run(case, directory=tmp_path, extend=3)
    other = case.with_overrides({"contact.restitution": 0.2})
    with pytest.raises(df.CaseError, match="belongs to another case"):
        df.run(other, "compiled", directory=tmp_path, extend=3)
    (tmp_path / "state.npz").write_bytes(b"no archive")
    with pytest.raises(df.CaseError, match="is damaged"):
        df.run(case, "compiled", directory=tmp_path, extend=3)


def test_results_without_a_final_state_leave_none_behind(tmp_path: Path) -> None:
    case = case_of(time__periods=2)
    df.run(case, "compiled").save_numbers(tmp_path)
    assert (tmp_path / "state.npz").is_file()
    diverged = df.run(case.with_overrides({"excitation.amplitude": 60.0}), "compiled")
    assert diverged.summary["settled"] == "not settled"
    diverged.save_numbers(tmp_path)
    assert not (tmp_path / "state.npz").exists()


@pytest.fixture(scope="module")
def irregular() -> df.Result:
    """Return the motion with soft springs in place of impacts, which never repeats."""
    keys = {"contact.law": "penalty", "time.periods": 200, "time.steps_per_period": 200}
    return df.run(df.preset("paper", SMALL | keys | {"mesh.elements": 10}), "compiled")


def test_an_irregular_motion_has_intervals(irregular: df.Result) -> None:
    summary, history = irregular.summary, irregular.history
    assert (summary["settled"], summary["periodicity"]) == ("irregular", None)
    assert summary["periodicity_class"] == "not periodic"
    intervals = summary["intervals"]
    lows = history["envelope_min"].to_numpy()[:, -100:]
    means = lows.reshape(2, 10, 10).mean(axis=2)
    assert intervals["tip_min"]["mean"] == pytest.approx(lows.mean(axis=1).tolist())
    expected = 2.262157 * means.std(axis=1, ddof=1) / np.sqrt(10.0)  # t of 9 degrees of freedom
    assert intervals["tip_min"]["half_width"] == pytest.approx(expected.tolist(), rel=1e-6)
    assert (intervals["tip_min"]["windows"], intervals["tip_min"]["periods"]) == (10, 100)
    contacts = intervals["tip_contacts_per_period"]
    assert contacts["mean"] == pytest.approx(summary["tip_contacts_per_period"], abs=0.26)
    assert (contacts["windows"], contacts["periods"]) == (4, 4)
    assert len(intervals["distortion_factor"]["mean"]) == 2


def test_the_page_shows_intervals_in_place_of_single_numbers(irregular: df.Result) -> None:
    from delam_fem.results.pages import report

    rows = {name: (text, why) for name, text, why in report.rows(irregular.summary, ["a", "b"])}
    text, why = rows["tip min"]
    assert text.count("±") == 2 and text.endswith("mm") and text.startswith("a −")
    assert why.startswith("mean and 95 % interval, 10 windows in 100 periods: ")
    assert "±" not in rows["minimum tip gap"][0]
    assert rows["transient"][0].endswith("%") and rows["periods judged"][0] == "100"
    assert "intervals" not in rows and "settling" not in rows


def test_a_settled_motion_has_no_intervals(tmp_path: Path) -> None:
    result = df.run(case_of(time__periods=20), "compiled")
    assert result.summary["intervals"] is None
    result.save_numbers(tmp_path)
    with xr.open_dataset(tmp_path / "result.nc", engine="h5netcdf") as read:
        assert read.sizes["period"] == 20


def strobed(strobe: np.ndarray) -> dict[str, Any]:
    """Return the words of a summary on a motion with these strobes, and half a range of 1."""
    case, n = small_case(), strobe.size
    swing = np.sin(2.0 * np.pi * np.arange(4 * STEPS) / STEPS)
    of_probe = np.stack([strobe, np.zeros(n)], axis=1)
    record = SimpleNamespace(n_steps=STEPS, v=np.stack([swing[: STEPS + 1]] * 2, axis=1))
    recorder: Any = SimpleNamespace(
        strobe=np.stack([of_probe] * 2, axis=2),
        envelope=np.stack([-np.ones((n, 2)), np.ones((n, 2))], axis=1),
        window=[record] * 4, n_closed=n, steps_per_period=STEPS,
        impulse=np.ones((n, 3)), ledger=np.zeros((n, 10)),
    )  # fmt: skip
    motion = diagnostics.ProbeMotion(
        np.stack([swing, swing]), np.stack([strobe, strobe]), np.array([1.0]),
        np.zeros((1, swing.size), dtype=bool), 0,
    )  # fmt: skip
    return diagnostics.summary_of(motion, case) | quality.settling_summary(recorder, 2, case, 0.3)


def test_a_settled_motion_of_period_three_is_not_undecided() -> None:
    """Its cycles differ by 11 %, which alone does not tell one period from three."""
    phases = 1.15 * np.array([0.0, 0.09, -0.045])
    summary = strobed(np.tile(phases, 40))
    assert summary["settled"] == "settled"
    assert (summary["periodicity"], summary["periodicity_class"]) == (3, "period 3")
    assert summary["strobe_scatter"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("P", [1, 2, 3, 4])
@pytest.mark.parametrize("noise", [0.0, 0.03, 0.055, 0.065, 0.08, 0.2])
def test_the_period_and_its_class_say_the_same(P: int, noise: float) -> None:
    rng = np.random.default_rng(P)
    for size in (0.0, 0.05, 0.1, 0.15):
        cycle = size * rng.normal(size=P)
        strobe = np.tile(cycle, 120 // P) + noise * rng.normal(size=120 // P * P)
        summary = strobed(strobe)
        period, word = summary["periodicity"], summary["periodicity_class"]
        assert word == (f"period {period}" if period else word)
        assert period is not None or not word.startswith("period")
        assert (summary["strobe_scatter"] is None) == (period is None)

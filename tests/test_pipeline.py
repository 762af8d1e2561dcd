"""Runs from end to end: saving, resuming, stopping, diverging, sharing the work."""

from __future__ import annotations

import json
import logging
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from mpi_pool import Crew

import delam_fem as df
from delam_fem.api import Result

SHORT = {"time.periods": 4, "output.window_periods": 3, "output.fields_per_period": 8}
EXACT_VARIABLES = ("tip_displacement", "tip_velocity", "displacement", "event_impulse")


def short(**keys: object) -> df.Case:
    return df.preset("paper", {**SHORT, **{k.replace("__", "."): v for k, v in keys.items()}})


@pytest.fixture(scope="module")
def result() -> Result:
    return df.run(short())


def test_history_has_every_variable_with_unit_and_meaning(result: Result) -> None:
    history = result.history
    assert history.sizes["time"] == 3000
    assert history.sizes["frame"] == 24
    assert history.sizes["node"] == 21
    assert history.sizes["period"] == 4
    assert list(history.lamina.values) == ["thick", "thin"]
    for name, variable in history.variables.items():
        if name != "lamina":
            assert variable.attrs["units"], name
            assert variable.attrs["long_name"], name
    assert history.attrs["outcome"] == "completed"
    assert df.Case.from_toml(history.attrs["case"]) == result.case


def test_times_frames_and_strobes_agree(result: Result) -> None:
    history, period = result.history, result.case.period
    assert history.time.values[[0, -1]] == pytest.approx([1.001 * period, 4 * period])
    tips = history.tip_displacement.values
    assert history.displacement.values[:, -1, -1] == pytest.approx(tips[:, -1], abs=0.0)
    assert history.strobe_displacement.values[:, -1] == pytest.approx(tips[:, -1], abs=0.0)
    assert (history.envelope_max.values[:, 1:].max(axis=1) >= tips.max(axis=1)).all()
    assert (history.envelope_min.values[:, 1:].min(axis=1) <= tips.min(axis=1)).all()
    base = history.base_displacement.values
    omega = 2 * np.pi * result.case.excitation.frequency
    assert base == pytest.approx(0.0025 * np.sin(omega * history.time.values), abs=1e-15)
    frames = np.searchsorted(history.time.values, history.frame.values - 1e-9)
    assert history.displacement.values[0, :, 0] == pytest.approx(base[frames], abs=1e-15)


def test_events_are_impacts_of_the_window(result: Result) -> None:
    history = result.history
    assert history.sizes["event"] > 0
    assert (history.event_velocity_before < 0).all()
    assert (history.event_impulse > 0).all()
    assert history.event_node.values.min() >= 1
    assert history.event_time.values.min() > result.case.period
    in_window = history.impulse_sum.values[1:].sum()
    assert history.event_impulse.values.sum() == pytest.approx(in_window)


def test_ledger_closes_and_is_the_sum_of_its_parts(result: Result) -> None:
    h = result.history
    stored = (h.energy_kinetic + h.energy_strain + h.energy_spring).values
    losses = h.energy_damping_loss + h.energy_impact_loss + h.energy_contact_damping_loss
    net = (h.energy_base_work - losses + h.energy_spring_released).values
    scale = np.abs(h.energy_base_work.values).max()
    assert np.abs(np.diff(stored) - net[1:]).max() < 1e-9 * scale
    assert result.summary["energy_residual"] < 1e-9


def test_saved_folder_repeats_the_run(result: Result, tmp_path: Path) -> None:
    written = result.save(tmp_path)
    assert all(path.exists() for path in written)
    assert not list(tmp_path.rglob(".delam_fem-*"))
    with xr.open_dataset(tmp_path / "result.nc", engine="h5netcdf") as read:
        assert np.array_equal(read.tip_displacement, result.history.tip_displacement)
        assert read.tip_displacement.attrs["units"] == "m"
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary == result.summary
    again = df.run(df.load_case(tmp_path / "case.toml"))
    for name in EXACT_VARIABLES:
        assert np.array_equal(again.history[name], result.history[name]), name


@pytest.mark.parametrize("law", ["newton-penalty", "penalty", "newton@moreau-jean"])
def test_interrupted_run_goes_on_bit_for_bit(law: str, tmp_path: Path) -> None:
    case = short(contact__law=law, contact__penalty_damping=0.3, contact__impulse="consistent")
    complete_run = df.run(case)

    def interrupt(done: int, periods: int) -> None:
        if done == 2:
            signal.raise_signal(signal.SIGINT)

    part = df.run(case, directory=tmp_path, progress=interrupt)
    assert part.history.attrs["outcome"] == "interrupted"
    assert part.history.sizes["period"] == 2
    resumed = df.run(case, directory=tmp_path, resume=True)
    assert resumed.history.attrs["outcome"] == "completed"
    xr.testing.assert_equal(resumed.history, complete_run.history)
    assert (tmp_path / "checkpoint.npz").exists()  # nothing else is on the disk yet
    again = df.run(case, directory=tmp_path, resume=True)  # reads it, and computes nothing
    xr.testing.assert_equal(again.history, complete_run.history)
    if law == "penalty":  # the pictures take five seconds
        again.save(tmp_path)
        assert not (tmp_path / "checkpoint.npz").exists()


def test_resume_wants_a_checkpoint_of_the_same_case(tmp_path: Path) -> None:
    with pytest.raises(df.CaseError, match="expected a checkpoint"):
        df.run(short(), directory=tmp_path, resume=True)
    with pytest.raises(df.CaseError, match="directory of the interrupted run"):
        df.run(short(), resume=True)
    df.run(short(), directory=tmp_path, progress=lambda k, n: signal.raise_signal(signal.SIGINT))
    with pytest.raises(df.CaseError, match=r"restitution: 0.1 there, 0.2 here"):
        df.run(short(contact__restitution=0.2), directory=tmp_path, resume=True)
    with pytest.raises(df.CaseError, match='engine: "petsc" there, "compiled" here'):
        df.run(short(), "compiled", directory=tmp_path, resume=True)
    with pytest.raises(df.CaseError, match="not finished; go on with --resume"):
        df.run(short(), directory=tmp_path)


def test_a_run_starts_from_the_state_of_another() -> None:
    complete_run = df.run(short(contact__law="none"))
    half = short(contact__law="none", time__periods=2)
    second = df.run(half, initial=df.run(half).state)
    tips, expected = (r.history.tip_displacement.values[:, -1] for r in (second, complete_run))
    assert tips == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("law", "remedy"),
    [
        ("none", "smaller excitation.amplitude"),
        ("newton-penalty", 'contact.impulse = "consistent"'),
        ("newton@moreau-jean", "more steps per period"),
    ],
)
def test_diverged_run_keeps_what_it_has_and_names_a_remedy(law: str, remedy: str) -> None:
    result = df.run(short(excitation__amplitude=50.0, contact__law=law, time__periods=20))
    assert result.summary["outcome"] == "diverged"
    assert 0 < result.history.sizes["period"] < 20
    assert result.summary["message"].startswith("diverged at t = ")
    assert remedy in result.summary["message"]
    assert " J in the laminae" in result.summary["message"]


def test_central_difference_beyond_its_limit_is_refused() -> None:
    case = short(time__scheme="central-difference")
    with pytest.raises(df.CaseError, match=r"time step of at most 1\.\d+e-05 s, given 0\.0003077"):
        df.run(case)


def test_sweep_runs_for_its_duration() -> None:
    keys = {"excitation.kind": "sweep", "excitation.start_frequency": 2.0}
    keys |= {"excitation.end_frequency": 4.0, "excitation.duration": 2.0}
    case = df.preset("paper", {**keys, "contact.law": "none", "output.fields_per_period": 0})
    result = df.run(case)
    assert result.history.time.values[-1] == pytest.approx(2.0)
    assert result.history.sizes["period"] == 8
    assert result.summary["energy_residual"] < 1e-9
    assert result.summary["periodicity"] is None


PARALLEL = """
import numpy as np
import delam_fem as df
assert comm.size == 2
keys = {"time.periods": 2, "time.steps_per_period": 300, "mesh.elements": 8}
for impulse, law in (
    ("lumped", "newton-penalty"), ("consistent", "newton-penalty"), ("lumped", "newton@moreau-jean")
):
    case = df.preset("paper", keys | {"contact.impulse": impulse, "contact.law": law})
    one, both = df.run(case).history, df.run(case, comm=comm).history
    assert one.impulse_sum.values.sum() > 0.0
    away = np.abs(one.tip_displacement.values - both.tip_displacement.values).max()
    assert away < 1e-9, (impulse, law, away)
"""


@pytest.mark.mpi
def test_two_ranks_compute_what_one_does(crew: Crew) -> None:
    crew.run(2, PARALLEL)


def test_keys_that_nothing_reads_are_in_the_summary_and_the_log(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.DEBUG, logger="delam_fem.pipeline"):
        result = df.run(short(contact__law="none", time__periods=1), "compiled")
    expected = ["contact.impulse", "contact.penalty_stiffness", "contact.restitution"]
    assert result.summary["unread_keys"] == [*expected, "contact.threshold_velocity"]
    assert "given, but not read: contact.impulse" in caplog.text


def test_an_unknown_engine_is_refused() -> None:
    with pytest.raises(df.CaseError, match=r"engine: .*given 'fast'"):
        df.run(short(), "fast")  # type: ignore[arg-type]


QUICK = {"time.periods": 3, "time.steps_per_period": 60, "output.window_periods": 2,
         "output.fields_per_period": 0, "mesh.elements": 4}  # fmt: skip


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"until": 0.0}, "until: expected a number above 0 [s], given 0.0"),
        ({"drive": 3.0}, "run: drive: expected a HarmonicMotion with a case, given 3.0; others are "
         "sections [excitation] of the case"),
        ({"extend": 2}, "extend: expected a positive number of periods, the directory of a "
         "completed run, no resume, and an excitation that repeats; given 2 periods, directory "
         "None, resume False, an excitation of the kind harmonic"),
        ({"speed": 1}, "run: speed: a case has keys for all but checkpoint_seconds, comm, "
         "directory, drive, extend, initial, law, overwrite, progress, resume, scheme, structure, "
         "until"),
    ],
)  # fmt: skip
def test_options_that_do_not_fit_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(df.CaseError) as error:
        df.run(df.preset("paper", QUICK), "compiled", **options)
    assert str(error.value) == message

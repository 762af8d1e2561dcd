"""A checkpoint gives back everything that was saved, and refuses what does not fit."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from scripted import Engine, motion, recorder

from delam_fem.case.files import preset
from delam_fem.case.toml import CaseError
from delam_fem.simulation import checkpoint
from delam_fem.simulation.loop import simulate
from delam_fem.simulation.recorder import PeriodRecord

CASE = preset("paper")


@pytest.mark.parametrize("window", [1, 2, 3])
@pytest.mark.parametrize("closed", [1, 2])
def test_a_run_goes_on_as_if_nothing_had_happened(tmp_path: Path, window: int, closed: int) -> None:
    whole, first = recorder(window=window), recorder(window=window)
    simulate(Engine(), whole, motion)
    engine = Engine()
    simulate(engine, first, motion, stop=lambda k: k == closed)
    path = checkpoint.path_in(tmp_path)
    checkpoint.save(path, CASE, engine, first)
    resumed, again = Engine(), recorder(window=window)
    checkpoint.load(path, CASE, resumed, again, motion)
    assert again.n_closed == closed
    assert len(again.window) == min(window, closed)
    assert resumed.base_state is not None
    assert resumed.base_state.tolist() == motion(closed)[0].tolist()
    assert resumed.state().losses == engine.state().losses == (2.0 * closed, 1.0 * closed)
    assert resumed.stepper.resting.tolist() == [True, False]
    for one, other in zip(again.window, first.window, strict=True):
        same(one, other)
    assert simulate(resumed, again, motion) == "completed"
    for name in ("strobe", "envelope", "ledger", "impulse"):
        assert getattr(again, name).tolist() == getattr(whole, name).tolist(), name
    for one, other in zip(again.window, whole.window, strict=True):
        same(one, other)


def same(one: PeriodRecord, other: PeriodRecord) -> None:
    """Assert that two records hold the same, but for what is computed anew."""
    for name in (field.name for field in fields(PeriodRecord)):
        a, b = getattr(one, name), getattr(other, name)
        if name == "jumps":
            columns = zip(a.columns(), b.columns(), strict=True)
            assert all(x.tolist() == y.tolist() for x, y in columns)
        elif name in ("frames", "contact"):
            assert [x.tolist() for x in a] == [y.tolist() for y in b], name
        elif isinstance(a, np.ndarray):
            assert np.array_equal(a[: other.n_steps + 1], b[: other.n_steps + 1]), name
        elif name != "end":
            assert a == b, name


def test_another_rank_writes_nothing(tmp_path: Path) -> None:
    checkpoint.save(tmp_path / "x.npz", CASE, Engine(), recorder(), writes=False)
    assert not list(tmp_path.iterdir())


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    path = checkpoint.path_in(tmp_path)
    with pytest.raises(CaseError, match="expected the directory of the interrupted run"):
        checkpoint.load(None, CASE, Engine(), recorder(), motion)
    with pytest.raises(CaseError, match="expected a checkpoint of an interrupted run, no file"):
        checkpoint.load(path, CASE, Engine(), recorder(), motion)
    engine, kept = Engine(), recorder()
    simulate(engine, kept, motion, stop=lambda k: k == 1)
    checkpoint.save(path, CASE, engine, kept)
    other = CASE.with_overrides({"contact.restitution": 0.2})
    with pytest.raises(CaseError, match="belongs to another case"):
        checkpoint.load(path, other, Engine(), recorder(), motion)

"""Histories and tables of a run without a case."""

from __future__ import annotations

import numpy as np
from scripted import DT, STEPS, Engine, U, motion, recorder

from delam_fem.api import LEDGER, Solution
from delam_fem.simulation.loop import simulate


def solution(window: int, ends_at: int = 12) -> Solution:
    engine, run_recorder = Engine(ends_at=ends_at), recorder(window=window)
    outcome = simulate(engine, run_recorder, motion)
    return Solution(outcome, run_recorder, engine.state())


def test_histories_of_the_window_follow_one_another_without_a_gap() -> None:
    run_solution = solution(window=2)
    assert run_solution.outcome == "completed"
    assert run_solution.time.tolist() == (DT * np.arange(2 * STEPS + 1)).tolist()
    assert run_solution.displacement.tolist() == U[:, STEPS:].T.tolist()
    assert run_solution.velocity.tolist() == (10.0 * U[:, STEPS:].T).tolist()
    assert run_solution.frames.shape == (4, 2, 3)
    assert run_solution.frames[:, 0, 0].tolist() == [601.0, 801.0, 1001.0, 1201.0]


def test_impacts_have_times_from_the_start_of_the_window() -> None:
    impacts = solution(window=2).impacts
    assert impacts.time.tolist() == [4 * DT, 4 * DT, 6 * DT]
    assert impacts.pair.tolist() == [0, 1, 1]
    assert impacts.impulse.tolist() == [1.0, 2.0, 4.0]
    assert impacts.rate_pre.tolist() == [-3.0, -4.0, -5.0]
    assert solution(window=3).impacts.time.tolist() == [2 * DT, 8 * DT, 8 * DT, 10 * DT]


def test_a_run_that_ends_early_has_the_steps_before() -> None:
    run_solution = solution(window=3, ends_at=6)
    assert run_solution.outcome == "diverged"
    assert run_solution.time.size == 7
    assert run_solution.displacement.tolist() == U[:, :7].T.tolist()
    assert run_solution.velocity.shape == (7, 2)
    assert run_solution.impacts.time.tolist() == [2 * DT]
    assert run_solution.energy["kinetic"].tolist() == [4.0, 6.0]


def test_energies_have_the_names_of_the_ledger() -> None:
    energy = solution(window=1).energy
    assert tuple(energy) == LEDGER
    assert energy["strain"].tolist() == [8.0, 16.0, 24.0]

"""A ball on a shaking table: one touch in each period, with its phase, its speed and its limits.

Formulas T1 and T2 and the limits are those of `loads.shaking_table`. Motions that stick to the
table live beside this one: runs begin on the orbit.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from loads.shaking_table import (
    OMEGA,
    G,
    M,
    T,
    amplitude_of,
    ball,
    limits,
    phase_of,
    sum_of_multipliers,
)

import delam_fem as df
from delam_fem.api import EngineName
from delam_fem.studies.orbits.newton import Perturbations
from delam_fem.studies.orbits.search import map_of, start_of

STEPS = 1000
"""Steps per period: an impact is late by one of them at most."""
STEP = OMEGA * T / STEPS
"""Phase in a step [rad]."""
AMPLITUDE = "excitation.amplitude"
METHODS = (
    {"time.scheme": "moreau-jean"},
    {"time.scheme": "newmark", "contact.law": "newton-penalty", "contact.penalty_stiffness": 1e4,
     "time.begin": "unloaded"},
)  # fmt: skip
"""Keys of laws and schemes that can hold the weight of a ball at rest."""
FEW = Perturbations(copies=16)


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize("keys", METHODS, ids=["newton", "newton-penalty"])
@pytest.mark.parametrize(("gamma", "e"), [(1.2, 0.5), (0.65, 0.7)])
def test_the_ball_touches_once_in_a_period(
    gamma: float, e: float, keys: dict[str, Any], engine: EngineName
) -> None:
    phase = phase_of(gamma, e)
    case = ball(gamma, e, phase).with_overrides(keys)
    history = df.run(case, engine).history
    touches = OMEGA * history.event_time.values % (2.0 * math.pi)
    assert touches.size == 5
    assert np.abs(touches - phase).max() < 2.0 * STEP
    assert -history.event_velocity_before.values == pytest.approx(G * T / (1.0 + e), rel=2e-3)
    assert history.event_impulse.values == pytest.approx(M * G * T, rel=2e-3)  # weight times T


@pytest.mark.slow
@pytest.mark.parametrize(("gamma", "e"), [(1.06, 0.5), (1.3, 0.5), (0.8, 0.7)])
def test_its_orbit_is_found_with_its_multipliers(gamma: float, e: float) -> None:
    phase = phase_of(gamma, e)
    case = ball(gamma, e, phase)
    contact = "contact_stop 1"
    orbit = df.orbit(case, settle=20, channels=("base", "tip_ball_velocity", contact))
    assert orbit.stability == "stable"
    # far away everything that falls repeats to round-off, which is no orbit
    assert np.abs(orbit.state).max() < 1.0
    histories = orbit.histories
    (step,) = np.flatnonzero(histories[contact])
    A = amplitude_of(gamma)
    assert math.asin(histories["base"][step] / A) == pytest.approx(phase, abs=2.0 * STEP)
    velocity = histories["tip_ball_velocity"]
    assert velocity[[step - 1, step + 1]] == pytest.approx([-0.5 * G * T, 0.5 * G * T], rel=8e-3)
    assert histories[contact][step] * T / STEPS == pytest.approx(M * G * T, rel=1e-3)
    mu = orbit.coarse.multipliers.values
    assert mu.sum() == pytest.approx(sum_of_multipliers(gamma, e), abs=0.08)
    assert np.prod(mu).real == pytest.approx(e**2, abs=0.04)


def test_one_period_is_that_of_runs_of_both_engines() -> None:
    """So the orbit, its branch and their limits are those of both."""
    gamma, e = 1.3, 0.5
    case = ball(gamma, e, phase_of(gamma, e) + 0.1, time={
        "periods": 8, "steps_per_period": STEPS, "scheme": "moreau-jean"
    })  # fmt: skip
    start = start_of(case)
    assert start is not None
    strobes = map_of(case, AMPLITUDE).trajectory(start, case.excitation.amplitude, 8).strobes
    for engine in ("petsc", "compiled"):
        history = df.run(case, cast(EngineName, engine)).history
        tips = history.strobe_displacement.values[0]
        assert tips == pytest.approx(strobes[:, 0], rel=1e-11)


def test_what_floats_without_weight_has_no_orbit() -> None:
    case = ball(1.3, 0.5, 0.6).without_loads
    with pytest.raises(df.CaseError, match="all held"):
        df.orbit(case, settle=1)


def events_of(
    case: df.Case, start: float, stop: float, folder: Path
) -> tuple[list[tuple[str, float, float, float]], Any]:
    """Return kind, value and interval of events on the branch over the amplitude, in Γ."""
    unit = amplitude_of(1.0)
    data = df.follow(
        case, AMPLITUDE, start * unit, stop * unit, folder,
        settle=20, perturbations=FEW, step=0.2, doublings=0,
    )  # fmt: skip
    columns = (data.event_parameter, data.event_low, data.event_high)
    numbers = np.stack([column.values for column in columns], axis=-1) / unit
    kinds = data.event_kind.values
    return [(str(kind), *row) for kind, row in zip(kinds, numbers, strict=True)], data


@pytest.mark.slow
def test_its_branch_ends_in_a_fold_below(tmp_path: Path) -> None:
    e = 0.5
    fold, _ = limits(e)
    gamma = 1.02 * fold
    case = ball(gamma, e, phase_of(gamma, e))
    events, data = events_of(case, gamma, 0.99 * fold, tmp_path)
    (event,) = [event for event in events if event[0] == "fold"]
    assert event[1] == pytest.approx(fold, rel=2e-3)
    assert event[2] - 1e-3 * fold < fold < event[3] + 1e-3 * fold
    behind = data.stability.values[-3:]
    assert (behind == "unstable").all(), "the motion with -φ"
    assert data.stability.values[0] == "stable"


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.5, pytest.param(0.7, marks=pytest.mark.nightly)])
def test_it_doubles_its_period_above(e: float, tmp_path: Path) -> None:
    _, doubling = limits(e)
    gamma = 0.96 * doubling
    case = ball(gamma, e, phase_of(gamma, e))
    events, data = events_of(case, gamma, 1.04 * doubling, tmp_path)
    (event,) = [event for event in events if event[0] == "period doubling"]
    assert event[1] == pytest.approx(doubling, rel=8e-3)
    assert event[2] - 4e-3 * doubling < doubling < event[3] + 4e-3 * doubling
    assert data.stability.values[0] == "stable"
    assert data.stability.values[-1] == "unstable"


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_below_its_limit_it_chatters_to_rest_and_leaves_where_the_table_falls_faster(
    engine: EngineName,
) -> None:
    """It lies on the table until Γ sin ωt = 1, and is thrown up from there in each period."""
    gamma, e = 1.03, 0.5
    case = ball(gamma, e, 0.0, output={"window_periods": 3}).with_overrides({"time.periods": 60})
    history = df.run(case, engine).history
    late = (OMEGA * history.event_time.values) % (2.0 * math.pi)
    hits = np.sort(late.reshape(-1))
    leaves = math.asin(1.0 / gamma)
    last = hits[hits < 0.5 * math.pi].max()
    assert last == pytest.approx(leaves, abs=2.0 * STEP)
    resting = history.time.values * OMEGA % (2.0 * math.pi)
    q = amplitude_of(gamma) * np.sin(OMEGA * history.time.values)
    gap = history.tip_displacement.values[0] - q
    before = (resting > leaves - 0.2) & (resting < leaves - STEP)
    assert np.abs(gap[before]).max() < G * (T / STEPS) ** 2
    # then it flies: its height above the table is that of free fall from there
    flight = OMEGA * T / 16.0
    left = np.argmin(np.abs(resting - leaves - flight))
    A = amplitude_of(gamma)
    t = (resting[left] - leaves) / OMEGA
    exact = (
        A * math.sin(leaves) + A * OMEGA * math.cos(leaves) * t - 0.5 * G * t**2
    ) - A * math.sin(resting[left])
    assert gap[left] == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_on_a_slow_table_it_comes_to_rest(engine: EngineName) -> None:
    gamma, e = 0.95, 0.5
    history = df.run(ball(gamma, e, 0.0), engine).history
    q = amplitude_of(gamma) * np.sin(OMEGA * history.time.values)
    gap = history.tip_displacement.values[0] - q
    assert np.ptp(gap) < 1e-9
    force = history.event_impulse.values / (T / STEPS)
    t = history.event_time.values
    exact = M * (G - gamma * G * np.sin(OMEGA * t))
    assert force == pytest.approx(exact, abs=2.0 * STEP * M * G)

"""Drives at several places: sums, the work of each, every kind of model, ranks, reduced files."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi_pool import Crew

import delam_fem as df
from delam_fem.api import Case, CaseError, FloatArray, reduced_case

ROUND_OFF = 1e-9
"""Of the largest displacement."""
BASE = {"kind": "harmonic", "frequency": 20.0, "amplitude": 1e-4}
PUSH = {"kind": "force", "lamina": "upper", "position": 0.3, "amplitude": 0.5, "frequency": 20.0}
PROBE = PUSH | {"lamina": "lower", "position": 0.17, "amplitude": 0.3, "frequency": 60.0}
POINT = {"lamina": "upper", "quantity": "displacement", "position": 0.3, "name": "pushed"}
OTHER = POINT | {"lamina": "lower", "position": 0.17, "name": "probed"}
KINDS: dict[str, dict[str, Any]] = {
    "beam": {},
    "solid": {"model.kind": "plane-stress", "mesh.elements": 8},
    "massless": {
        "model.kind": "modes", "model.modes": 6, "time.mass": "massless",
        "contact.law": "none", "contact.restitution": 0.0,
    },
}  # fmt: skip


def case_of(*drives: dict[str, Any], **more: Any) -> Case:
    """Return a bonded pair of laminae without contact, with some drives and two sensors."""
    keys = {
        "mesh.elements": 10, "excitation": list(drives), "contact.law": "none",
        "contact.impulse": "consistent", "time.steps_per_period": 60, "time.periods": 2,
        "time.refine": 1, "output.window_periods": 2, "output.fields_per_period": 5,
        "sensor": [POINT, OTHER],
    }  # fmt: skip
    overrides = {key.replace("__", "."): value for key, value in more.items()}
    return df.preset("embedded", keys | overrides)


def field(result: df.Result) -> FloatArray:
    """Return what both sensors read."""
    history = result.history
    return np.array([history[f"sensor_{name}"].to_numpy() for name in ("pushed", "probed")])


def works_of(result: df.Result) -> FloatArray:
    """Return Σ mean(F) Δu of both forces over all steps, from what sensors read there."""
    force = np.pad(result.history["forces"].to_numpy(), ((0, 0), (1, 0)))  # 0 at the start
    moved = np.pad(field(result), ((0, 0), (1, 0)))
    return np.asarray((0.5 * (force[:, 1:] + force[:, :-1]) * np.diff(moved)).sum(axis=1))


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_acts_at_several_places_adds_up(kind: str, engine: Any) -> None:
    keys = KINDS[kind]
    result = df.run(case_of(BASE, PUSH, PROBE, **keys), engine)
    steps = {"time.steps_per_period": 180}  # of 20 Hz, as long as those of 60 Hz
    six = {"time.periods": 6, "output.window_periods": 6}
    alone = [df.run(case_of(one, **keys, **steps), engine) for one in (BASE, PUSH)]
    alone.append(df.run(case_of(PROBE, **keys, **six), engine))
    size = np.abs(field(result)).max()
    parts = [np.abs(field(one)).max() for one in alone]
    assert min(parts) > 0.01 * size
    assert field(result) == pytest.approx(sum(map(field, alone)), abs=ROUND_OFF * size)
    assert result.summary["energy_residual"] < ROUND_OFF
    if kind != "massless":  # its drive is linear within steps, and so is its work
        works = result.history["energy_force_works"].sum("period").to_numpy()
        assert works == pytest.approx(works_of(result), rel=1e-9)
    forces = result.history["energy_force_works"].sum("force_place").to_numpy()
    assert result.history["energy_force_work"].to_numpy() == pytest.approx(forces, rel=1e-12)


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_forces_on_what_a_moving_stop_meets_do_their_work(engine: Any) -> None:
    """Displacements then count from the base, and the work of a force does not."""
    stop = {"lamina": "upper", "side": "above", "position": 0.3, "gap": 5e-5, "on": "base",
            "stiffness": 2e3}  # fmt: skip
    steps = {"time.steps_per_period": 400}
    law = {"contact.law": "penalty", "time.scheme": "newmark"}
    case = case_of(BASE, PUSH, PROBE, stop=[stop], **law, **steps)
    result = df.run(case, engine)
    assert result.summary["contacts"][-1]["closed_share"] > 0.01
    assert result.summary["energy_residual"] < ROUND_OFF
    works = result.history["energy_force_works"].sum("period").to_numpy()
    assert works == pytest.approx(works_of(result), rel=1e-9)


def test_drives_have_their_places_in_results() -> None:
    result = df.run(case_of(PUSH, BASE, PROBE))
    places = result.history["force_place"].to_numpy().tolist()
    assert places == ["upper at 0.3 m", "lower at 0.17 m"]
    assert list(result.record)[4:7] == ["drive", "drive_2", "base"]
    t = result.history["time"].to_numpy()
    assert result.record["base"].to_numpy() == pytest.approx(
        1e-4 * np.sin(40.0 * np.pi * t), abs=1e-12
    )
    second = 0.3 * np.sin(120.0 * np.pi * t)
    assert result.record["drive_2"].to_numpy() == pytest.approx(second, abs=1e-9)
    forced = df.run(case_of(PUSH, PROBE))
    assert list(forced.record)[4:6] == ["drive", "drive_2"]
    assert result.record["drive"].attrs["units"] == "N"


def test_a_force_where_nothing_moves_is_refused() -> None:
    immobile = PROBE | {"position": 0.0}
    with pytest.raises(CaseError, match="a point that can move"):
        df.run(case_of(BASE, immobile))


def test_a_reduced_model_knows_all_places(tmp_path: Path) -> None:
    case = case_of(BASE, PUSH, PROBE)
    file, _ = reduced_case(case, modes=12).save(tmp_path)
    keys = {"model.kind": "modes", "model.file": str(file)}
    full = field(df.run(case))
    modes = field(df.run(case.with_overrides(keys)))
    assert modes == pytest.approx(full, abs=1e-3 * np.abs(full).max())
    moved = case.with_overrides({**keys, "excitation.3.position": 0.2})
    with pytest.raises(CaseError, match=r"excitation at place 3\.position: expected 0\.17"):
        df.run(moved)


def test_results_with_several_places_are_read_back(tmp_path: Path) -> None:
    """One force beside the base, or several."""
    for number, drives in enumerate([(BASE, PUSH), (BASE, PUSH, PROBE)]):
        result = df.run(case_of(*drives), "compiled")
        result.save(tmp_path / str(number))
        again = df.load_result(tmp_path / str(number))
        assert again.history["forces"].equals(result.history["forces"])
        assert again.history["force_place"].equals(result.history["force_place"])


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_a_run_with_several_places_goes_on_bit_for_bit(tmp_path: Path, engine: Any) -> None:
    case = case_of(BASE, PUSH, PROBE, **{"time.periods": 14})
    complete = df.run(case, engine)

    def interrupt(period: int, periods: int) -> None:
        if period == 10:
            os.kill(os.getpid(), signal.SIGINT)

    cut = df.run(case, engine, directory=tmp_path, progress=interrupt)
    assert cut.summary["outcome"] == "interrupted"
    again = df.run(case, engine, directory=tmp_path, resume=True)
    assert again.history.equals(complete.history)


SCRIPT = """
import numpy as np
import delam_fem as df
from delam_fem.cli.endings import ended_together

kind, = arguments
drives = [
    {"kind": "harmonic", "frequency": 3.0, "amplitude": 1e-3},
    {"kind": "force", "lamina": "thin", "position": 0.3, "amplitude": 0.05, "frequency": 3.0},
    {"kind": "force", "lamina": "thick", "position": 0.21, "amplitude": 0.5, "frequency": 6.0},
]
keys = {"model.kind": kind, "mesh.elements": 6, "time.periods": 2, "time.steps_per_period": 40}
keys |= {"contact.law": "newton@moreau-jean", "contact.impulse": "consistent"}
case = df.preset("paper", keys | {"excitation": drives})
with ended_together(comm):
    many = df.run(case, comm=comm)
    if comm.rank == 0:
        one = df.run(case)
        for name in ("tip_displacement", "energy_force_works"):
            a, b = (run.history[name].to_numpy()[:, :40] for run in (one, many))
            assert np.abs(a - b).max() < 1e-6 * np.abs(a).max(), name
"""


@pytest.mark.mpi
def test_ranks_share_several_places(crew: Crew) -> None:
    crew.run(2, SCRIPT, "plane-stress")

"""The estimate of time and space before a computation."""

import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from delam_fem import run_sweep
from delam_fem.api import (
    FILE_BYTES,
    CaseError,
    Cost,
    EngineName,
    assemble,
    load_case,
    preset,
    reduced_case,
    require_affordable,
    run_cost,
    step_hours,
)
from delam_fem.engines.cost import START_SECONDS
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.run import sweep_cost
from delam_fem.system import mpi

FINE_SOLID = {"mesh.elements": 40, "model.strips": 2}


def test_cost_counts_steps_and_records() -> None:
    """300 periods of 1000 steps at about 6 µs; the window of 10 periods has 500 frames."""
    case = preset("paper")
    cost = run_cost(case, "petsc")
    assert step_hours(case, "petsc") * 3600.0 == pytest.approx(300_000 * 6e-6, rel=0.3)
    assert cost.hours == pytest.approx(step_hours(case, "petsc") + START_SECONDS / 3600.0)
    more = case.with_overrides({"time.periods": 3000, "output.window_periods": 100})
    assert step_hours(more, "petsc") == pytest.approx(10.0 * step_hours(case, "petsc"))
    assert run_cost(more, "petsc").memory == pytest.approx(10.0 * cost.memory, rel=0.02)
    assert run_cost(more, "petsc").disk - FILE_BYTES == pytest.approx(
        10.0 * (cost.disk - FILE_BYTES)
    )
    assert step_hours(case, "compiled") < 0.1 * step_hours(case, "petsc")


@pytest.mark.parametrize(
    "keys",
    [
        {"time.periods": 1_000_000_000},
        {"time.steps_per_period": 100_000_000},
        {"time.periods": 100_000, "output.window_periods": 100_000},
    ],
)
def test_a_zero_too_many_must_be_confirmed(keys: dict[str, object]) -> None:
    cost = run_cost(preset("paper", keys), "petsc")
    with pytest.raises(
        CaseError, match=r"^case x: needs about .* of memory and .* by --yes$"
    ) as caught:
        require_affordable(cost, "case x", is_confirmed=False)
    assert "\n" not in str(caught.value)
    require_affordable(cost, "case x", is_confirmed=True)


def test_ordinary_computations_need_no_confirmation() -> None:
    for keys in ({}, {"mesh.elements": 200}, {"time.steps_per_period": 256_000}):
        require_affordable(run_cost(preset("paper", keys), "petsc"), "x", is_confirmed=False)


@pytest.mark.slow
def test_a_sweep_of_many_points_leaves_no_folder(tmp_path) -> None:  # type: ignore[no-untyped-def]
    axes = [
        {"key": "excitation.frequency", "start": 1.0, "stop": 4.0, "count": 10_000},
        {"key": "contact.restitution", "start": 0.0, "stop": 1.0, "count": 10_000},
    ]
    sweep = sweep_of({"name": "s", "base": "paper", "axis": axes})
    with pytest.raises(CaseError, match=r"^sweep s of 1e\+08 points: needs about .* by --yes$"):
        run_sweep(sweep, tmp_path / "out", "serial")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("keys", "engine", "seconds", "megabytes"),
    [
        ({}, "petsc", 8.7, 7.1),
        ({"mesh.elements": 200, "time.periods": 100}, "petsc", 9.4, 26.9),
        ({"time.periods": 100, "output.window_periods": 100}, "petsc", 8.3, 29.9),
        ({"time.periods": 3000}, "compiled", 7.8, 12.3),
    ],
)
def test_estimates_are_near_what_was_measured(
    keys: dict[str, object], engine: EngineName, seconds: float, megabytes: float
) -> None:
    """Processor time and size of the folder of `delam-fem run paper`, measured."""
    cost = run_cost(preset("paper", keys), engine)
    assert 0.5 < cost.hours * 3600.0 / seconds < 2.0
    assert 0.5 < cost.disk / 1e6 / megabytes < 2.0


@pytest.mark.parametrize(
    ("of", "keys", "engine", "microseconds"),
    [
        ("default", {}, "petsc", 93.0),
        ("default", {}, "compiled", 1.13),
        ("default", {"time.refine": 1}, "petsc", 8.3),
        ("default", {"contact.points_per_element": 4}, "petsc", 88.4),
        ("embedded", {}, "petsc", 34.5),
        ("embedded", {}, "compiled", 1.3),
        ("default", {"model.kind": "plane-stress"}, "petsc", 90.6),
        ("default", {"model.kind": "plane-stress"}, "compiled", 58.0),
        ("default", {"model.kind": "plane-stress", "mesh.elements": 80}, "petsc", 223.0),
        ("default", {"model.kind": "solid"}, "petsc", 1141.0),
        ("default", {"model.kind": "solid", **FINE_SOLID}, "petsc", 5434.0),
    ],
)
def test_a_step_of_every_model_is_estimated_within_a_factor_of_three(
    of: str, keys: dict[str, object], engine: EngineName, microseconds: float
) -> None:
    """Processor time of a coarse step, measured."""
    case = preset(of, keys)
    estimate = 3600e6 * step_hours(case, engine) / (case.n_periods * case.steps_per_period)
    assert 1 / 3 < estimate / microseconds < 3.0


def test_a_mesh_file_and_a_reduced_model_are_counted(tmp_path: Path) -> None:
    """The mesh has 2 × 48 cells through both strips: about 1200 dofs of degree 2."""
    solids = Path(__file__).parents[2] / "meshes" / "solids" / "plane_strips.msh"
    keys = {"model.kind": "plane-stress", "mesh.file": str(solids)}
    beam = preset("default", {"contact.law": "none"})
    plane = beam.with_overrides(keys)
    n_dofs = assemble(plane).operators.n_dofs
    like = {"model.kind": "plane-stress", "mesh.elements": n_dofs // 24}
    known = step_hours(beam.with_overrides(like), "petsc")
    assert 0.4 < step_hours(plane, "petsc") / known < 2.5
    assert step_hours(plane, "petsc") > 3.0 * step_hours(beam, "petsc")
    reduced_case(beam, 6).save(tmp_path)
    reduced = step_hours(load_case(tmp_path / "case.toml"), "compiled")
    assert 0.5 < reduced / step_hours(beam, "compiled") < 5.0


def test_periods_and_points_cost_something_whatever_they_compute() -> None:
    """A million short periods took 140 s, and 20,000 short points 29 s on two processors."""
    short = {"time.steps_per_period": 60, "mesh.elements": 4, "time.periods": 1_000_000}
    assert 1 / 3 < 3600.0 * run_cost(preset("paper", short), "compiled").hours / 140.0 < 3.0
    axis = {"key": "excitation.frequency", "start": 1.0, "stop": 4.0, "count": 20_000}
    few = {"mesh.elements": 4, "time.steps_per_period": 60, "time.periods": 3}
    sweep = sweep_of({"name": "s", "base": "paper", "set": few, "axis": [axis]})
    assert 1 / 3 < 3600.0 * sweep_cost(sweep, 2).hours / 29.0 < 3.0


def test_ranks_share_solids(monkeypatch: pytest.MonkeyPatch) -> None:
    case = preset("default", {"model.kind": "solid"})
    alone = run_cost(case, "petsc").hours - START_SECONDS / 3600.0
    monkeypatch.setattr(mpi, "MPI", SimpleNamespace(COMM_WORLD=SimpleNamespace(size=4)))
    shared = run_cost(case, "petsc").hours - START_SECONDS / 3600.0
    assert shared == pytest.approx(alone / 2.0)
    beam = preset("default")
    assert run_cost(beam, "petsc").hours == pytest.approx(
        step_hours(beam, "petsc") + START_SECONDS / 3600.0
    )


def test_long_solids_must_be_confirmed() -> None:
    """25 minutes were told as 8 seconds; a hundred times as many passed without a question."""
    case = preset("default", {"model.kind": "solid", "time.periods": 100_000})
    with pytest.raises(CaseError, match=r"needs about [\d.]+ h, .* by --yes$"):
        require_affordable(run_cost(case, "petsc"), "x", is_confirmed=False)


def test_costs_are_told_in_units_that_suit_them() -> None:
    assert str(Cost(0.002, 5e6, 8e6)) == "about 7 s, 705 MB of memory and 8 MB of files"
    assert str(Cost(0.5, 3e9, 8e9)) == "about 30 min, 3.7 GB of memory and 8 GB of files"
    assert str(Cost(30.0, 0.0, 0.0, programs=0.0)).startswith("about 30 h, 0 MB")
    many = Cost(1.0, 0.0, 0.0, programs=64 * 0.3e9)
    assert not many.is_large  # many workers alone are no reason to ask


def test_what_the_machine_does_not_have_must_be_confirmed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk with 5 MB free and a machine with 1 GB of memory."""
    monkeypatch.setattr(
        shutil, "disk_usage", lambda path: SimpleNamespace(free=5e6) if path == tmp_path else None
    )
    monkeypatch.setattr(os, "sysconf", {"SC_PAGE_SIZE": 1000, "SC_PHYS_PAGES": 1_000_000}.get)
    small, folder = Cost(0.1, 1e6, 4e6, programs=64 * 0.3e9), tmp_path / "runs" / "new"
    require_affordable(small, "x", is_confirmed=False, folder=folder)
    for cost, text in (
        (Cost(0.1, 1e6, 6e6), r"6 MB of files, but .* has 5 MB free; .* --yes$"),
        (Cost(0.1, 0.4e9, 4e6), "1.1 GB of memory, but the machine has 1 GB; "),
    ):
        with pytest.raises(CaseError, match=f"^x: needs about {text}"):
            require_affordable(cost, "x", is_confirmed=False, folder=folder)
        require_affordable(cost, "x", is_confirmed=True, folder=folder)

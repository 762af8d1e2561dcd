"""The estimate of time and space before a computation."""

import pytest

from delam_fem.case.files import preset
from delam_fem.case.toml import CaseError
from delam_fem.engines.cost import require_affordable, run_cost
from delam_fem.studies.sweeps.grid import sweep_of
from delam_fem.studies.sweeps.run import run_sweep


def test_cost_counts_steps_and_records() -> None:
    """300 periods of 1000 steps at about 8 µs; the window of 10 periods has 500 frames."""
    case = preset("paper")
    cost = run_cost(case, "petsc")
    assert cost.hours * 3600.0 == pytest.approx(300_000 * 8e-6, rel=0.3)
    more = case.with_overrides({"time.periods": 3000, "output.window_periods": 100})
    assert run_cost(more, "petsc").hours == pytest.approx(10.0 * cost.hours)
    assert run_cost(more, "petsc").memory == pytest.approx(10.0 * cost.memory)
    assert run_cost(case, "compiled").hours < 0.1 * cost.hours


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


def test_a_sweep_of_many_points_leaves_no_folder(tmp_path) -> None:  # type: ignore[no-untyped-def]
    axes = [
        {"key": "excitation.frequency", "start": 1.0, "stop": 4.0, "count": 10_000},
        {"key": "contact.restitution", "start": 0.0, "stop": 1.0, "count": 10_000},
    ]
    sweep = sweep_of({"name": "s", "base": "paper", "axis": axes})
    with pytest.raises(CaseError, match=r"^sweep s of 1e\+08 points: needs about .* by --yes$"):
        run_sweep(sweep, tmp_path / "out", "serial")
    assert not (tmp_path / "out").exists()

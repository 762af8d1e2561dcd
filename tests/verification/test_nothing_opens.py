"""Equal laminae that touch at rest move together: gaps and gap rates are nothing but round-off."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from support import invoke

import delam_fem as df
from delam_fem.api import EngineName
from delam_fem.contact import rules

LAMINA = {"length": 0.4, "width": 0.02, "thickness": 0.001, "material": "steel"}
TOGETHER = 1e-9
"""Largest difference of the two tips over their motion: round-off of many steps."""


def bonded(**keys: Any) -> df.Case:
    """Return two equal laminae, bonded but for a closed delamination, swept over its resonance."""
    overrides = {key.replace("__", "."): value for key, value in keys.items()}
    case = df.Case.model_validate(
        {
            "name": "bonded",
            "lamina": [LAMINA | {"name": name, "damping_ratio": 0.01} for name in ("low", "up")],
            "delamination": [{"between": ["low", "up"], "start": 0.12, "end": 0.28}],
            "support": {"start": "clamped", "end": "pinned"},
            "excitation": {
                "kind": "sweep", "start_frequency": 5.0, "end_frequency": 9.0, "amplitude": 1e-3,
                "duration": 2.0,
            },
            "mesh": {"elements": 20},
            "contact": {"law": "newton", "restitution": 0.5, "points_per_element": 4},
            "time": {"scheme": "moreau-jean", "refine": 4, "duration": 0.1},
        }
    )  # fmt: skip
    return case.with_overrides(overrides) if overrides else case


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
@pytest.mark.parametrize(
    "keys",
    [
        {"contact__restitution": 0.0},
        {"contact__restitution": 1.0, "contact__points_per_element": 8},
        {"time__scheme": "newmark", "contact__impulse": "consistent"},
    ],
)
def test_no_pair_is_hit_where_nothing_opens(engine: EngineName, keys: dict[str, Any]) -> None:
    result = df.run(bonded(**keys), engine)
    assert result.summary["outcome"] == "completed"
    assert int(result.history["impact_count"].sum()) == 0
    reading = result.history["displacement"].values
    assert np.abs(reading[1] - reading[0]).max() <= TOGETHER * np.abs(reading).max()


def test_a_delamination_that_opens_is_still_hit() -> None:
    """Unlike laminae part; what counts as round-off does not hide that."""
    result = df.run(bonded(lamina__up__thickness=0.0005, time__duration=0.1), "compiled")
    assert int(result.history["impact_count"].sum()) > 100


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_what_was_computed_before_a_step_without_solution_is_kept(engine: EngineName) -> None:
    """The base leaps beyond all numbers in the third period, whose first steps are kept."""

    class Leap:
        def states(self, times: np.ndarray) -> np.ndarray:
            smooth = df.HarmonicMotion(1.0, 1e-3).states(times)
            return np.where((times > 2.305)[:, None], -1e308, smooth)

    one = sp.identity(1, format="csr")
    problem = df.Operators(
        one, 0.1 * one, 40.0 * one,
        base=df.BaseCoupling(np.zeros(1), np.zeros(1), -40.0 * np.ones(1)), gap_matrix=one,
        gap0=np.array([1e-3]), probes=one,
    )  # fmt: skip
    run = {"law": "newton", "scheme": "moreau-jean", "drive": Leap(), "periods": 5}
    result = df.run(problem, engine, steps_per_period=100, time_step=0.01, **run)
    assert result.summary["outcome"] == "failed"
    assert "t = 2.31 s" in result.summary["message"]
    assert result.history["time"].values[-1] == pytest.approx(2.31)
    before = result.history["probe_displacement"].values[..., :230]
    assert np.isfinite(before).all()
    assert np.abs(before).max() > 1e-4


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the law fail at its hundredth step."""
    examine = rules.Rules.examine
    calls: list[Any] = []

    def examined(self: rules.Rules, step: Any) -> Any:
        calls.append(step)
        if len(calls) > 100:
            raise ArithmeticError("no impulses")
        return examine(self, step)

    monkeypatch.setattr(rules.Rules, "examine", examined)


@pytest.mark.usefixtures("failing")
def test_a_run_that_has_failed_is_read_from_its_checkpoint(tmp_path: Path) -> None:
    """As after a command that ended before its files were written."""
    case = bonded(lamina__up__thickness=0.0005)
    first = df.run(case, "petsc", directory=tmp_path)
    again = df.run(case, "petsc", directory=tmp_path, resume=True)
    assert (first.summary["outcome"], again.summary["outcome"]) == ("failed", "failed")
    assert np.array_equal(first.history["displacement"], again.history["displacement"])
    assert np.array_equal(first.history["time"], again.history["time"])


@pytest.mark.usefixtures("failing")
def test_a_failure_of_the_program_ends_a_command_with_what_it_had(tmp_path: Path) -> None:
    file = tmp_path / "case.toml"
    file.write_text(bonded(lamina__up__thickness=0.0005).to_toml())
    done = invoke("run", file, "-o", tmp_path / "run", "--no-figures")
    assert done.exit_code == 1
    assert "Traceback" not in done.output
    result = df.load_result(tmp_path / "run")
    assert result.summary["outcome"] == "failed"
    assert "no impulses" in result.summary["message"]
    assert 0.0 < float(result.history["time"][-1]) < 0.1
    assert result.summary["energy_residual"] < 1e-6


@pytest.mark.parametrize("key", ["stiffness", "rotational_stiffness"])
@pytest.mark.parametrize("position", [0.2, 0.051])
def test_a_spring_that_is_rigid_is_refused_with_what_to_take(key: str, position: float) -> None:
    spring = {"position": position, "kind": "spring", "stiffness": 1e3, key: 1e30}
    data = bonded().model_dump(exclude_unset=True)
    case = df.Case.model_validate(data | {"support": [{"end": "pinned"}, spring]})
    with pytest.raises(df.CaseError, match=rf"support\.1\.{key}: .*1e\+30.*kind = "):
        df.run(case, "compiled")

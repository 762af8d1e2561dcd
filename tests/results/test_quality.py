"""Warnings about numbers that are not good."""

import numpy as np
import pytest

import delam_fem as df
from delam_fem.case.definition import Case
from delam_fem.case.files import preset
from delam_fem.model.beams import closed_form
from delam_fem.results import quality
from delam_fem.results.diagnostics import GROUP_PERIODS, ProbeMotion
from delam_fem.results.quality import contacts_by_period, is_lost, quality_warnings
from delam_fem.simulation.recorder import Recorder
from delam_fem.system.errors import CaseError

SHORT = {
    "mesh.elements": 3,
    "time.periods": 2,
    "time.steps_per_period": 200,
    "output.fields_per_period": 0,
}


def warned(case: Case, residual: float) -> str:
    return "\n".join(quality_warnings(case, closed_form.assemble(case), residual))


def test_a_good_run_has_no_warning() -> None:
    for name in ("paper", "default"):
        assert warned(preset(name), 1e-11) == ""


def test_an_open_balance_is_told_with_its_reason() -> None:
    assert "open by 2e-06" in warned(preset("paper"), 2e-6)
    known = warned(preset("paper"), 2e-6)
    assert "the steps of newmark balance to round-off" in known
    assert "time.refine = 1, 80 dofs and 20 contact pairs" in known
    explicit = preset("paper", {"time.scheme": "central-difference"})
    assert "central-difference balances energy only for small steps" in warned(explicit, 2e-6)


@pytest.mark.parametrize("stiffness", [1e12, 1e15, 1e30])
def test_springs_that_no_step_resolves_are_told(stiffness: float) -> None:
    """A spring of 1e12 N/m on 0.0038 kg has 1.6e7 rad/s; a step of 0.3 ms is 5000 rad."""
    text = warned(preset("paper", {"contact.penalty_stiffness": stiffness}), 0.0)
    assert f"contact.penalty_stiffness = {stiffness:g} N/m" in text and "try below" in text
    assert warned(preset("paper", {"contact.penalty_stiffness": 1e8}), 0.0) == ""
    rigid = {"contact.law": "newton", "contact.penalty_stiffness": stiffness}
    assert warned(preset("paper", rigid), 0.0) == ""


def test_a_stop_that_no_step_resolves_is_told() -> None:
    keys = {"lamina": "thin", "position": 0.1, "side": "above", "gap": 0.01, "stiffness": 1e14}
    law = {"law": "penalty", "penalty_stiffness": 1e3}
    case = preset("paper", {"stop": [keys], "contact": law})
    assert "stop.1.stiffness = 1e+14 N/m turns a node" in warned(case, 0.0)


def test_a_motion_with_an_open_balance_is_not_completed(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(Recorder, "energy_residual", lambda _: 0.5)
    case = preset("paper", {**SHORT, "contact.penalty_stiffness": 1e11})
    result = df.run(case, "petsc", structure=closed_form.assemble(case))
    assert result.summary["outcome"] == result.history.attrs["outcome"] == "diverged"
    assert "the energy balance does not close" in result.summary["message"]
    warning = result.summary["warnings"][-1]
    assert "open by 0.5 of what is exchanged" in warning
    assert "contact.penalty_stiffness" in warning and warning in caplog.text


def test_graded_meshes_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    case = preset("paper")
    structure = closed_form.assemble(case)
    x = structure.layout.x.copy()
    monkeypatch.setattr(
        quality, "_lengths", lambda _: np.diff(x) * np.geomspace(1, 1e6, x.size - 1)
    )
    text = "\n".join(quality_warnings(case, structure, 0.0))
    assert "differ by a factor of 1e+06" in text


@pytest.mark.parametrize(("residual", "lost"), [(0.0, False), (9e-3, False), (1.0, True)])
def test_lost(residual: float, lost: bool) -> None:
    assert is_lost(residual) == lost
    assert is_lost(float("nan"))


def test_a_first_step_out_of_bounds_is_refused() -> None:
    case = preset("paper", {**SHORT, "excitation.amplitude": 1e6})
    with pytest.raises(CaseError, match=r"the first step of .* s already goes beyond"):
        df.run(case, "petsc", structure=closed_form.assemble(case))


def test_contacts_count_in_the_period_in_which_they_begin() -> None:
    """A group ends where the next closed step is a twentieth of a period away, not before."""
    N, first = 100, 10  # steps before the first whole period
    apart = round(GROUP_PERIODS * N)
    closed = [first, first + apart - 1, first + 2 * apart - 1, first + N + 3, first + 2 * N - 1]
    hit = np.zeros((1, first + 3 * N), dtype=bool)
    hit[0, closed] = True
    motion = ProbeMotion(np.zeros((2, hit.size)), np.zeros((2, 3)), np.array([1.0]), hit, 5)
    assert contacts_by_period(motion, N).tolist() == [2.0, 2.0, 0.0]

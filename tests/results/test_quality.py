"""Warnings about numbers that are not good."""

from types import SimpleNamespace

import numpy as np
import pytest
from synthetic import STEPS

import delam_fem as df
from delam_fem.api import Case, CaseError, Recorder, assemble, is_lost, preset
from delam_fem.results import quality
from delam_fem.results.diagnostics import GROUP_PERIODS, ProbeMotion
from delam_fem.results.quality import contacts_by_period, quality_warnings

SHORT = {
    "mesh.elements": 3,
    "time.periods": 2,
    "time.steps_per_period": 200,
    "output.fields_per_period": 0,
}


def warned(case: Case, residual: float) -> str:
    return "\n".join(quality_warnings(case, assemble(case, needs_dolfinx=False), residual))


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
    """A node of a few grams leaves a spring of 1e12 N/m after 0.1 µs; a step has 0.3 ms."""
    text = warned(preset("paper", {"contact.penalty_stiffness": stiffness}), 0.0)
    assert f"contact.penalty_stiffness = {stiffness:g} N/m" in text and "arbitrary" in text
    assert warned(preset("paper", {"contact.penalty_stiffness": 500.0}), 0.0) == ""
    rigid = {"contact.law": "newton", "contact.penalty_stiffness": stiffness}
    assert warned(preset("paper", rigid), 0.0) == ""


def test_a_stop_that_no_step_resolves_is_told() -> None:
    keys = {"lamina": "thin", "position": 0.1, "side": "above", "gap": 0.01, "stiffness": 1e14}
    law = {"law": "penalty", "penalty_stiffness": 1e3}
    case = preset("paper", {"stop": [keys], "contact": law})
    assert "stop.1.stiffness = 1e+14 N/m" in warned(case, 0.0)


def test_a_motion_with_an_open_balance_is_not_completed(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(Recorder, "energy_residual", lambda *_: 0.5)
    case = preset("paper", {**SHORT, "contact.penalty_stiffness": 1e11})
    result = df.run(case, "petsc", structure=assemble(case, needs_dolfinx=False))
    assert result.summary["outcome"] == result.history.attrs["outcome"] == "diverged"
    assert "the energy balance does not close" in result.summary["message"]
    warning = result.summary["warnings"][-1]
    assert "open by 0.5 of what is exchanged" in warning
    assert "contact.penalty_stiffness" in warning and warning in caplog.text


def test_graded_meshes_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    case = preset("paper")
    structure = assemble(case, needs_dolfinx=False)
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
        df.run(case, "petsc", structure=assemble(case, needs_dolfinx=False))


def test_contacts_count_in_the_period_in_which_they_begin() -> None:
    """A group ends where the next closed step is a twentieth of a period away, not before."""
    N, first = 100, 10  # steps before the first whole period
    apart = round(GROUP_PERIODS * N)
    closed = [first, first + apart - 1, first + 2 * apart - 1, first + N + 3, first + 2 * N - 1]
    hit = np.zeros((1, first + 3 * N), dtype=bool)
    hit[0, closed] = True
    motion = ProbeMotion(np.zeros((2, hit.size)), np.zeros((2, 3)), np.array([1.0]), hit, 5)
    assert contacts_by_period(motion, N).tolist() == [2.0, 2.0, 0.0]


def test_what_is_said_of_balances_is_exact() -> None:
    case = preset("paper", {"time.refine": 8})
    known = (
        "the steps of newmark balance to round-off, so that these do not say why; known are steps "
        "of 0.000308 s, time.refine = 8, 80 dofs and 20 contact pairs. Compare with the other "
        "--engine, time.refine = 1 and fewer elements, to see what opens it"
    )
    opened = "the energy balance of a period is open by {} of what is exchanged (good: below 1e-06)"
    assert warned(case, 1e-6) == ""
    assert warned(case, 1.1e-6) == f"{opened.format('1.1e-06')}: {known}"
    explicit = case.with_overrides({"time.scheme": "central-difference"})
    assert warned(explicit, 0.02) == (
        f"{opened.format('0.02')}: central-difference balances energy only for small steps, given "
        "0.000308 s; try more steps per period"
    )
    infinite = "the energies of a period are not finite: this is no motion of the case"
    for residual in (np.nan, np.inf):
        assert warned(case, residual) == infinite
    assert [is_lost(value) for value in (0.00999, 0.01, np.nan, np.inf)] == [
        False,
        True,
        True,
        True,
    ]


def test_meshes_are_judged_by_the_lengths_of_their_elements() -> None:
    structure = assemble(preset("paper", {"mesh.elements": 2}), needs_dolfinx=False)
    for ratio, is_told in ((0.99e4, False), (1.02e4, True)):
        x = np.array([0.0, 0.5 / ratio, 0.5 / ratio + 1e-13, 0.5, 0.5 + 0.5 / ratio])
        layout = SimpleNamespace(x=x)
        texts = quality._graded_mesh(SimpleNamespace(layout=layout))  # type: ignore[arg-type]
        assert bool(texts) == is_told
    [text] = texts
    assert text == (
        "the lengths of the elements differ by a factor of 1e+04, their stiffnesses by its cube, "
        "and digits are lost; try a factor below 10000"
    )
    assert structure.layout.x.size == 3


@pytest.mark.parametrize("n", [3 * STEPS, 3 * STEPS + 40])
def test_contacts_begin_in_their_period(n: int) -> None:
    """Closed steps less than a twentieth of a period apart belong together."""
    first = n % STEPS
    closed = np.zeros(n, bool)
    closed[[0, 5, first + 3, first + 12, first + 22, first + 31, first + STEPS + 199]] = True
    closed[first + 2 * STEPS] = True  # goes on from the period before
    motion = ProbeMotion(np.zeros((2, n)), np.zeros((2, 3)), np.array([1.0]), closed[None], 0)
    assert contacts_by_period(motion, STEPS).tolist() == [2.0, 1.0, 0.0]


def test_a_run_that_was_to_settle_says_what_it_may_need() -> None:
    case = preset("paper", {"time.periods": "settled", "time.most_periods": 77})
    summary = {"settled": "not settled", "settling": {"periods_needed": None}}
    text = "not settled after 77 periods, the limit time.most_periods"
    assert quality.limit_warning(case, summary) == text
    summary["settling"] = {"periods_needed": 12}
    assert quality.limit_warning(case, summary) == f"{text}; it may need 12 further periods"
    assert quality.limit_warning(case, summary | {"settled": "irregular"}) is None
    assert quality.limit_warning(preset("paper"), summary) is None

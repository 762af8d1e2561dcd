"""The script behind docs/convergence.md, on made-up results: tables, and the document itself."""

from __future__ import annotations

import dataclasses
import importlib
import math
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from delam_fem.studies.convergence.ladder import FREE, Ladder, Rung
from delam_fem.studies.convergence.run import Convergence
from delam_fem.studies.convergence.rung import RungResult
from delam_fem.studies.convergence.statistics import EXTREMA
from delam_fem.studies.convergence.tables import Table

ROOT = Path(__file__).parents[3]
LIMITS = dict(zip((q.name for q in EXTREMA), (-0.020, 0.015, 0.002, 0.032), strict=True))


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> dict[str, ModuleType]:
    """Import the scripts that import one another."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    names = ("convergence_ladders", "convergence_document", "convergence_study")
    return {name: importlib.import_module(name) for name in names}


def made_up(rung: Rung) -> RungResult:
    """Return extremes that approach a limit as the square root of the time step."""
    if rung.method == FREE.name:
        return RungResult(rung.key, "completed", "", {}, 0.3, 100)
    excess = 1.0 + 1.0 / math.sqrt(rung.steps)
    found = {name: (excess * value, 1e-9) for name, value in LIMITS.items()}
    found |= {"blocks": (30.0, 0.0), "periodicity": (1.0, 0.0), "impact_gain": (1e-5, 0.0)}
    found |= {"contact_work": (9.9e-4, 1e-9)}
    if rung.method == "newton/lumped" and rung.elements == 160:
        return RungResult(rung.key, "diverged", "diverged in period 77", {}, 0.3, 77)
    return RungResult(rung.key, "completed", "", found, 0.3, 60)


@pytest.fixture
def tables(scripts: dict[str, ModuleType]) -> dict[str, Table]:
    ladders: dict[str, Ladder] = scripts["convergence_ladders"].ladders()
    found = {
        name: Convergence(ladder, {rung.key: made_up(rung) for rung in ladder.rungs()})
        for name, ladder in ladders.items()
    }
    result: dict[str, Table] = scripts["convergence_document"].document(found).tables
    return result


def test_tables_of_the_document(tables: dict[str, Table]) -> None:
    laws = {row[0]: row[1:] for row in tables["what converges"].rows}
    assert laws["moreau"] == tuple(
        f"{-20.0 * (1.0 + 1.0 / math.sqrt(n)):.2f}" for n in (1000, 4000, 16000, 64000, 256000)
    )
    assert "penalty k = 100000 N/m" in laws
    last = 1.0 + 1.0 / math.sqrt(256000)
    change = 20.0 * (1.0 / math.sqrt(64000) - 1.0 / math.sqrt(256000))
    assert tables["motions"].rows[2][:2] == ("3.25", f"{-20.0 * last:.4g} ± {change:.2g}")
    literal = {row[:3]: row[3:] for row in tables["literal"].rows}
    assert literal["mass", "newton", "1000"][-2:] == ("1 %", "**diverged in period 77**")
    for table in tables.values():
        assert {len(row) for row in table.rows} == {len(table.heading)}


def test_the_document_is_filled(scripts: dict[str, ModuleType], tables: dict[str, Table]) -> None:
    fill = scripts["convergence_document"].fill
    text = "before\n\n<!-- table default -->\nold\n<!-- end -->\n\nafter\n"
    some = {"default": tables["default"]}
    filled = fill(text, some)
    assert "old" not in filled
    assert filled.startswith("before\n\n<!-- table default -->\n| damping | law | N | 10 elements")
    assert filled.endswith("<!-- end -->\n\nafter\n")
    assert fill(filled, some) == filled
    with pytest.raises(KeyError, match="default: expected one place in the document, found 0"):
        fill("before\n", some)


def test_the_document_asks_for_what_there_is(
    scripts: dict[str, ModuleType], tables: dict[str, Table]
) -> None:
    text = (ROOT / "docs" / "convergence.md").read_text("utf-8")
    asked = set(re.findall(r"<!-- table ([\w. -]+?) -->", text))
    assert asked == {*tables, "trials"}
    pictures = re.findall(r"\]\((figures/[\w.]+)\)", text)
    assert pictures
    assert [name for name in pictures if not (ROOT / "docs" / name).is_file()] == []


# -- the trials -------------------------------------------------------------------------------


@pytest.fixture
def trials(monkeypatch: pytest.MonkeyPatch) -> dict[str, ModuleType]:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    return {name: importlib.import_module(name) for name in ("contact_trials", "trial_schemes")}


SAME = 1e-9  # m: round-off of the first periods, which impacts raise to 1e-11


def test_dense_steps_are_those_of_the_package(trials: dict[str, ModuleType]) -> None:
    script, ts = trials["contact_trials"], trials["trial_schemes"]
    case = script.case_of(250, 4)
    operators = script.closed_form.assemble(case).operators
    for law, name in ((ts.MOREAU, "moreau"), (ts.BOUNDED, "moreau-recovery")):
        dense = script.densely(ts.theta_step, ts.theta_matrices, (law, script.E), case, operators)
        own = script.trials()[name](case, operators)
        np.testing.assert_allclose(dense, own, rtol=0.0, atol=SAME)


@pytest.mark.parametrize("arguments", [(0.1, False), (0.1, True)])
def test_exact_steps_are_exact_without_contact(
    trials: dict[str, ModuleType], arguments: tuple[float, bool]
) -> None:
    script, ts = trials["contact_trials"], trials["trial_schemes"]
    found = []
    for steps in (100, 200):
        case = script.case_of(steps, 2)
        operators = script.closed_form.assemble(case).operators
        operators = dataclasses.replace(operators, gap0=np.full(operators.n_pairs, 5.0))
        bases = script.motion_of(case)(0)
        m = ts.exact_matrices(ts.Problem.of(operators), case.time_step, *arguments)
        u, v, a = np.zeros((3, operators.n_dofs))
        W = m.of.H @ m.push
        for j in range(1, steps + 1):
            ts.exact_step(m, W, u, v, a, bases[j - 1], bases[j])
        found.append(u)
    np.testing.assert_allclose(*found, rtol=0.0, atol=1e-5)  # the load is linear within a step


def test_all_modes_are_the_whole_problem(trials: dict[str, ModuleType]) -> None:
    script = trials["contact_trials"]
    case = script.case_of(250, 2)
    operators = script.closed_form.assemble(case).operators
    np.testing.assert_allclose(
        script.by_modes("moreau", operators.n_dofs // 2, case, operators),
        script.trials()["moreau"](case, operators),
        rtol=0.0,
        atol=1e-8,
    )


def test_errors_of_trials_are_relative_to_the_amplitude(trials: dict[str, ModuleType]) -> None:
    script = trials["contact_trials"]
    limit = np.array([[-0.02, 0.0], [0.02, 0.03]])
    found = {"way": script.Found({1000: limit + np.array([[0.0, 0.0], [0.0, 0.0015]])})}
    assert script.table(found, limit).rows == (("way", "-20.00", "10.0"),)


@pytest.mark.slow
def test_trials_in_a_short_form(
    trials: dict[str, ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    script = trials["contact_trials"]
    chosen = {name: script.trials()[name] for name in ("moreau-recovery", "moreau")}
    monkeypatch.setattr(script, "trials", lambda: chosen)
    found, limit = script.measure((500,), 8000, 40, 1)
    assert limit[:, 0] == pytest.approx([-0.020, 0.015], abs=0.002)
    errors = {name: one.error(500, limit) for name, one in found.items()}
    assert errors["moreau-recovery"] < 0.5 * errors["moreau"]
    figure = script.figure(found, limit)
    assert len(figure.axes[0].lines) == 2

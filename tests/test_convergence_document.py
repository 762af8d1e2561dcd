"""The script behind docs/convergence.md, on made-up results: tables, and the document itself."""

from __future__ import annotations

import importlib
import math
import re
from pathlib import Path
from types import ModuleType

import pytest

from delam_fem.convergence import Convergence
from delam_fem.convergence_tables import Table
from delam_fem.ladder import FREE, Ladder, Rung
from delam_fem.ladder_rung import RungResult
from delam_fem.ladder_statistics import EXTREMA

ROOT = Path(__file__).parents[1]
LIMITS = dict(zip((q.name for q in EXTREMA), (-0.020, 0.015, 0.002, 0.032), strict=True))


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> dict[str, ModuleType]:
    """Import the scripts that import one another."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    names = ("convergence_ladders", "convergence_document", "convergence_study")
    return {name: importlib.import_module(name) for name in names}


def made_up(rung: Rung) -> RungResult:
    """Return extremes that approach a limit as the square root of the time step."""
    if rung.scheme == FREE.name:
        return RungResult(rung.key, "completed", "", {}, 0.3, 100)
    excess = 1.0 + 1.0 / math.sqrt(rung.steps)
    found = {name: (excess * value, 1e-9) for name, value in LIMITS.items()}
    found |= {"blocks": (30.0, 0.0), "periodicity": (1.0, 0.0), "impact_gain": (1e-5, 0.0)}
    found |= {"contact_work": (9.9e-4, 1e-9)}
    if rung.scheme == "newton/lumped" and rung.elements == 160:
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
    filled = fill(text, tables)
    assert "old" not in filled
    assert filled.startswith("before\n\n<!-- table default -->\n| damping | law | N | 10 elements")
    assert filled.endswith("<!-- end -->\n\nafter\n")
    assert fill(filled, tables) == filled
    with pytest.raises(KeyError, match="no such"):
        fill("<!-- table no such -->\n<!-- end -->", tables)


def test_the_document_asks_for_what_there_is(
    scripts: dict[str, ModuleType], tables: dict[str, Table]
) -> None:
    text = (ROOT / "docs" / "convergence.md").read_text("utf-8")
    asked = set(re.findall(r"<!-- table ([\w. -]+?) -->", text))
    assert asked == set(tables)
    pictures = re.findall(r"\]\((figures/[\w.]+)\)", text)
    assert pictures
    assert [name for name in pictures if not (ROOT / "docs" / name).is_file()] == []

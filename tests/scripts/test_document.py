"""docs/evidence/convergence.md on made-up results: tables, text, and the script behind it."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from project import ROOT, script
from refinements import document as document_module
from refinements.document import document, fill
from refinements.study import refinements

from delam_fem.studies.convergence.analysis import Convergence, Table, exact_free_motion
from delam_fem.studies.convergence.level import LevelResult, extrema
from delam_fem.studies.convergence.refinement import FREE, Level, RefinementStudy

LIMITS = dict(zip((q.name for q in extrema(2)), (-0.020, 0.015, 0.002, 0.032), strict=True))


def made_up(level: Level) -> LevelResult:
    """Return extremes that approach a limit as the square root of the time step."""
    if level.method == FREE.name:
        error = 4.0 / level.steps**2 + 3.0 / level.elements**4
        names = ("frequency", "amplitude")
        free = {
            f"{name}_{i + 1}": (exact * (1.0 + error), 0.0)
            for name, both in zip(names, exact_free_motion(level.case), strict=True)
            for i, exact in enumerate(both)
        }
        return LevelResult(level.key, "completed", "", free, 0.3, 100)
    excess = 1.0 + 1.0 / math.sqrt(level.steps)
    values = {name: (excess * value, 1e-9) for name, value in LIMITS.items()}
    values |= {"blocks": (30.0, 0.0), "periodicity": (1.0, 0.0), "impact_gain": (1e-5, 0.0)}
    values |= {"contact_work": (9.9e-4, 1e-9), "steps": (1234.0, 0.0)}
    if level.method == "newton@newmark/lumped" and level.elements == 160:
        return LevelResult(level.key, "diverged", "diverged in period 77", {}, 0.3, 77)
    return LevelResult(level.key, "completed", "", values, 0.3, 60)


def whole(refinement: RefinementStudy) -> Convergence:
    return Convergence(refinement, {level.key: made_up(level) for level in refinement.levels()})


@pytest.fixture(scope="module")
def tables() -> dict[str, Table]:
    return document({name: whole(refinement) for name, refinement in refinements().items()}).tables


def test_tables_of_the_document(tables: dict[str, Table]) -> None:
    laws = {row[0]: row[1:] for row in tables["what converges"].rows}
    assert laws["newton@moreau-jean"] == tuple(
        f"{-20.0 * (1.0 + 1.0 / math.sqrt(n)):.2f}" for n in (1000, 4000, 16000, 64000, 256000)
    )
    assert "penalty@newmark k = 100000 N/m" in laws
    last = 1.0 + 1.0 / math.sqrt(256000)
    text = f"{-20.0 * last:.2f}"
    assert tables["motions"].rows[2][:3] == ("stiffness", "3.25", text)
    assert tables["limits"].rows[0][:3] == ("stiffness", "10", "10")
    assert tables["refined"].rows[1][0] == "4"
    literal = {row[:3]: row[3:] for row in tables["literal"].rows}
    assert literal["mass", "newton@newmark", "1000"][-2:] == ("1 %", "**diverged in period 77**")
    for table in tables.values():
        assert {len(row) for row in table.rows} == {len(table.heading)}


def test_the_document_is_filled(tables: dict[str, Table], tmp_path: Path) -> None:
    text = "before\n\n<!-- table refined -->\nold\n<!-- end -->\n\nafter\n"
    some = {"refined": tables["refined"]}
    filled = fill(text, some)
    assert "old" not in filled
    assert filled.startswith("before\n\n<!-- table refined -->\n| r | stiffness: y1 [mm] | PETSc |")
    assert filled.endswith("<!-- end -->\n\nafter\n")
    assert fill(filled, some) == filled
    assert (
        fill("<!-- table refined in a.csv -->", some, tmp_path) == "<!-- table refined in a.csv -->"
    )
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    assert (tuple(heading), len(rows)) == (some["refined"].heading, len(some["refined"].rows))
    with pytest.raises(KeyError, match="refined: expected one place in the document, found 0"):
        fill("before\n", some)


def test_the_document_asks_for_what_there_is(tables: dict[str, Table]) -> None:
    text = (ROOT / "docs" / "evidence" / "convergence.md").read_text("utf-8")
    asked = re.findall(r"<!-- table ([\w. -]+?)(?: in (\S+))? -->", text)
    assert {name for name, _ in asked} == {*tables}
    for name, file in asked:
        if file:
            assert f"]({file})" in text
            with (ROOT / "docs" / "evidence" / file).open(encoding="utf-8", newline="") as stored:
                assert tuple(next(csv.reader(stored))) == tables[name].heading
    pictures = re.findall(r"\]\(\.\./(figures/[\w.]+)\)", text)
    assert pictures
    assert [name for name in pictures if not (ROOT / "docs" / name).is_file()] == []


def test_the_script_writes_tables_and_figures(
    tmp_path: Path, tables: dict[str, Table], monkeypatch: pytest.MonkeyPatch
) -> None:
    study = script("convergence_study")
    page, figures, folders = tmp_path / "page.md", tmp_path / "figures", []

    def run_refinement(
        refinement: RefinementStudy, folder: Path, **settings: object
    ) -> Convergence:
        assert (settings["workers"], settings["resume"]) == (2, True)
        folders.append(folder)
        return whole(refinement)

    monkeypatch.setattr(study, "run_refinement", run_refinement)
    monkeypatch.setattr(study, "DOCUMENT", page)
    monkeypatch.setattr(study, "FIGURES", figures)
    monkeypatch.setattr(document_module, "literal_figure", Figure)  # it computes for minutes
    page.write_text("".join(f"<!-- table {name} -->\nold\n<!-- end -->\n" for name in tables))
    assert study.main(["--folder", str(tmp_path / "runs"), "--workers", "2"]) == 0
    assert folders == [tmp_path / "runs" / name for name in refinements()]
    text = page.read_text("utf-8")
    assert "old" not in text
    assert "| newton@moreau-jean | -20.63 | -20.32 |" in text
    pictures = re.findall(
        r"\]\(\.\./figures/(convergence_\w+\.png)\)",
        (ROOT / "docs" / "evidence" / "convergence.md").read_text("utf-8"),
    )
    assert {*pictures} - {"convergence_trials.png"} <= {path.name for path in figures.iterdir()}

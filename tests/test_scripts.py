"""The scripts in a short form; each is checked by a number that it gives."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from project import EVIDENCE, ROOT, script


def test_reference_motions_are_those_of_the_paper(capsys: pytest.CaptureFixture[str]) -> None:
    assert script("reference_motions").main(["--periods", "300", "--engine", "compiled"]) == 0
    table = capsys.readouterr().out
    assert table.count("yes") == 4
    assert "0.50" in table  # one contact in two periods


@pytest.mark.nightly
def test_benchmark_measures_ratios(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EVIDENCE))  # its worker processes import it
    module = script("benchmark")
    figures = module.main(["--short", "-o", str(tmp_path)])
    rows = figures["rows"]
    assert [row["dofs"] for row in rows] == [20, 80, 200]
    for row in rows:
        assert row["bare"] > 0.0
        for name in module.SCHEMES:
            for engine in ("petsc", "compiled"):
                assert row[name][engine] > 0.0
    assert json.loads((tmp_path / "performance.json").read_text())["rows"] == rows
    page = (tmp_path / "performance.md").read_text()
    assert all(f"## {name}" in page for name in module.ON_PAGE)
    assert (tmp_path / "figures" / "performance.png").stat().st_size > 1000


@pytest.mark.nightly
def test_cost_of_plates_is_measured_over_steps_and_pairs() -> None:
    plates = script("plate_cost").main(["--short"])
    assert [row["scheme"] for row in plates["steps"]] == ["moreau-jean", "newmark"]
    assert all(row["step"] > row["solves"] > 0.0 for row in plates["steps"])
    (row,) = plates["pairs"]
    assert row["coordinates"] > row["pairs"] > 0


def test_page_of_performance_is_that_of_its_numbers() -> None:
    numbers = json.loads((ROOT / "docs" / "evidence" / "performance.json").read_text("utf-8"))
    page = (ROOT / "docs" / "evidence" / "performance.md").read_text("utf-8")
    assert page == script("benchmark").markdown(numbers)


def test_reduced_study_finds_limits_and_smoothness(tmp_path: Path) -> None:
    short = "--modes 4 --points 6 --refine 8 --settle 20 --periods 5".split()
    assert script("reduced_study").main([*short, "-o", str(tmp_path)]) == 0
    content = json.loads((tmp_path / "reduced.json").read_text())
    (limit,) = content["limits"]["stiffness"]
    assert limit["y1_min"] == pytest.approx(-19.7, abs=0.3)
    names = ("finite elements, r = 64", "4 modes, r = 8")
    rough, smooth = (max(content["growth"][name]) for name in names)
    assert smooth < 1.5 < rough
    assert (tmp_path / "figures" / "reduced.png").stat().st_size > 1000


@pytest.mark.mpi
@pytest.mark.nightly
def test_cost_of_solids_is_measured_on_ranks_of_their_own(tmp_path: Path) -> None:
    rows = script("continuum_cost").main(["--short", "-o", str(tmp_path)])
    assert [(row["kind"], row["ranks"]) for row in rows] == [
        ("plane-stress", 1),
        ("solid", 1),
        ("solid", 2),
    ]
    assert rows[0]["dofs"] == 4 * 24
    for row in rows:
        assert 0.0 < row["solve_ms"] < row["step_ms"]
        assert len(row["peak_mb"]) == row["ranks"]
    assert json.loads((tmp_path / "continuum_cost.json").read_text()) == rows
    assert (tmp_path / "figures" / "continuum_cost.png").stat().st_size > 1000

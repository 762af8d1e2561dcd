"""The measurement of how many faults the tests notice."""

from __future__ import annotations

from pathlib import Path

import pytest
from project import ROOT, script

mutation = script("mutation")

TEXT = """
@dataclass(frozen=True)
class A:
    pass


@cache
def f(a: int | None, b: float = 1.0) -> list[float] | None:
    c: int | bool = a | 2
    return [b + c]
"""
LAWS = "delam_fem/contact/laws.py"


def test_the_configuration_has_reasons_for_equivalent_mutants() -> None:
    config = mutation.config()
    assert len(config["operators"]) > 5
    assert all(" → " in change for change in config["equivalent"])
    assert all(len(reason) > 10 for reason in config["equivalent"].values())


def test_annotations_and_decorators_are_found() -> None:
    lines = TEXT.splitlines()
    places = {lines[a[0] - 1][a[1] : b[1]] for a, b in mutation.annotations(TEXT)}
    types = {"int | None", "float", "list[float] | None", "int | bool"}
    assert places == types | {"dataclass(frozen=True)", "cache"}


def test_a_change_shows_its_lines() -> None:
    assert mutation.change("a\n  b = 1\nc", "a\n  b = 2\nc") == "b = 1 → b = 2"


@pytest.mark.parametrize(
    ("killed", "n", "expected"),
    [(90, 100, (0.8256, 0.9448)), (0, 10, (0.0, 0.2775))],  # as tabulated
)
def test_intervals_of_a_share(killed: int, n: int, expected: tuple[float, float]) -> None:
    assert mutation.wilson(killed, n) == pytest.approx(expected, abs=1e-4)


def test_the_page_tells_survivors_with_their_reasons() -> None:
    drawn = [mutation.Mutant(f"delam_fem/{name}.py", "core/X", 0, 1) for name in ("a/x", "a/y")] * 5
    results = [f"killed: test_{k}" for k in range(7)] + ["timeout", "x → y", "u → v"]
    page = mutation.page(drawn, results, 400, {"x → y": "the same number"}, {"u → v": "test_v"})
    assert "**8 of 10 mutants, drawn at random from the 400 of all modules, are killed:" in page
    assert "80.0 %** (95 % interval 49 to 94 %). 1 of the 2 survivors" in page
    assert "without them 88.9 % are" in page
    assert "| `a` | 10 | 8 |" in page
    assert "x → y" not in page
    assert "Tests that were written since notice 1 of them." in page
    assert "u → v" not in page
    assert "No test notices" not in page
    assert "- `a/x.py`: `x → y`\n" in mutation.page(drawn, results, 400, {}, {})


def test_mutants_of_a_module_know_their_lines() -> None:
    pytest.importorskip("cosmic_ray")
    text = (ROOT / LAWS).read_text(encoding="utf-8").splitlines()
    mutants = mutation.mutants_of(LAWS, [r"ReplaceComparisonOperator_Gt_GtE", "NumberReplacer"])
    assert {mutant.operator.rpartition("/")[2] for mutant in mutants} >= {"NumberReplacer"}
    assert all(any(c.isdigit() or c == ">" for c in text[m.line - 1]) for m in mutants)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "limit", "expected"),
    [("pass", 60, "passed"), ("assert 0", 60, "failed"), ("while True: pass", 2, "timeout")],
)
def test_tests_run_in_a_fork(tmp_path: Path, body: str, limit: int, expected: str) -> None:
    path = tmp_path / "test_made.py"
    path.write_text(f"def test_made():\n    {body}\n")
    assert mutation.outcome([str(path)], limit=limit)[0] == expected


@pytest.mark.slow
def test_a_test_that_fails_is_named(tmp_path: Path) -> None:
    path = tmp_path / "test_made.py"
    path.write_text(
        "import pytest\n"
        "@pytest.mark.parametrize('text', ['x - y', 'z'])\n"
        "def test_made(text):\n    assert text == 'z'\n"
    )
    result, name = mutation.outcome([str(path)])
    assert result == "failed"
    assert name.endswith("test_made.py::test_made[x - y]")
    assert mutation.outcome([f"{path}::test_made[z]"]) == ("passed", "")

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
    assert "- `a/x.py`: `x → y` – the same number" in page
    assert "Tests that were written since notice 1 of them." in page
    assert "u → v" not in page
    assert "– **open" in mutation.page(drawn, results, 400, {}, {})


def test_a_line_is_judged_by_the_tests_that_run_it_the_mirror_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    alike = staticmethod(lambda mutant, files: dict.fromkeys(files, 0.0))
    monkeypatch.setattr(mutation.Lines, "mentions", alike)
    seconds = {
        "tests/cli/test_run.py::test_quick": 0.1,
        "tests/cli/test_run.py::test_long": 90.0,
        "tests/cli/test_run.py::test_beside": 0.2,
        "tests/contact/test_laws.py::test_own": 3.0,
        "tests/contact/test_rules.py::test_near": 2.0,
        "tests/numerics/test_beams.py::test_far": 0.1,
    }
    near = set(list(seconds)[:2]) | set(list(seconds)[3:5])
    tests = {(LAWS, 7): near, (LAWS, 0): near | {"tests/numerics/test_beams.py::test_far"}}
    lines = mutation.Lines(tests, seconds)
    expected = [
        *("tests/contact/test_laws.py::test_own", "tests/contact/test_rules.py::test_near"),
        *("tests/cli/test_run.py::test_quick", "tests/cli/test_run.py::test_beside"),
    ]  # what takes longer than the budget is left out
    assert lines.of(mutation.Mutant(LAWS, "core/X", 0, 7)) == expected
    at_import = lines.of(mutation.Mutant(LAWS, "core/X", 0, 8))
    assert at_import == [*expected[:3], "tests/numerics/test_beams.py::test_far", expected[3]]
    compiled = "delam_fem/engines/compiled/contact.py"
    lines = mutation.Lines({("delam_fem/engines/compiled/steps.py", 0): near}, seconds)
    assert lines.of(mutation.Mutant(compiled, "core/X", 0, 8))[0] == expected[2]
    monkeypatch.setattr(mutation, "AT_MOST", 1)
    assert len(lines.of(mutation.Mutant(compiled, "core/X", 0, 8))) == 1


def test_files_that_mention_the_words_of_a_line_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mutation, "ROOT", tmp_path)
    (tmp_path / "m.py").write_text("a = 1\nadd(data, envelope_min)\n")
    (tmp_path / "t.py").write_text("assert envelope_min; data")
    (tmp_path / "u.py").write_text("data = 2")
    weights = mutation.Lines.mentions(mutation.Mutant("m.py", "core/X", 0, 2), ["t.py", "u.py"])
    assert weights == {"t.py": 1.0, "u.py": pytest.approx(0.5 / 1.5)}


def test_what_coverage_and_pytest_say_is_read_back(tmp_path: Path) -> None:
    from coverage import CoverageData

    name = "tests/contact/test_laws.py::test_a[x.y]"
    data = CoverageData(str(tmp_path / "coverage.db"))
    data.set_context(f"{name}|run")
    data.add_lines({str(ROOT / LAWS): [7, 9]})
    data.set_context("")
    data.add_lines({str(ROOT / LAWS): [1]})
    data.write()
    (tmp_path / "tests.xml").write_text(
        '<testsuite><testcase classname="tests.contact.test_laws" name="test_a[x.y]" time="0.5"/>'
        '<testcase classname="tests.contact.test_laws" name="b"><skipped/></testcase></testsuite>'
    )
    lines = mutation.Lines.read(tmp_path)
    assert lines.seconds == {name: 0.5}
    assert lines.tests[LAWS, 7] == lines.tests[LAWS, 0] == {name}
    assert not lines.tests[LAWS, 1]


def test_mutants_of_a_module_know_their_lines() -> None:
    pytest.importorskip("cosmic_ray")
    text = (ROOT / LAWS).read_text(encoding="utf-8").splitlines()
    mutants = mutation.mutants_of(LAWS, [r"ReplaceComparisonOperator_Gt_GtE", "NumberReplacer"])
    assert {mutant.operator.rpartition("/")[2] for mutant in mutants} >= {"NumberReplacer"}
    assert all(any(c.isdigit() or c == ">" for c in text[m.line - 1]) for m in mutants)


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

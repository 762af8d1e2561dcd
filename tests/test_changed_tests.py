"""Which tests run what was changed."""

from __future__ import annotations

from pathlib import Path

import changed_tests
import pytest
from changed_tests import Lines, by_folder, changed_lines, mentions
from project import ROOT

LAWS = "delam_fem/contact/laws.py"
COMPILED = "delam_fem/engines/compiled/contact.py"
SECONDS = {
    "tests/cli/test_run.py::test_quick": 0.1,
    "tests/cli/test_run.py::test_long": 90.0,
    "tests/cli/test_run.py::test_beside": 0.2,
    "tests/contact/test_laws.py::test_own": 3.0,
    "tests/contact/test_rules.py::test_near": 2.0,
    "tests/numerics/test_beams.py::test_far": 0.1,
}


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> Lines:
    alike = lambda line, files: dict.fromkeys(files, 0.0)  # noqa: E731
    monkeypatch.setattr(changed_tests, "mentions", alike)
    near = set(list(SECONDS)[:2]) | set(list(SECONDS)[3:5])
    far = {"tests/numerics/test_beams.py::test_far"}
    return Lines({(LAWS, 7): near, (LAWS, 0): near | far}, SECONDS)


def judging(lines: Lines, module: str, line: int, at_most: int = 9) -> list[str]:
    return lines.judging(module, [line], "", seconds=40.0, at_most=at_most)


def test_a_line_is_judged_by_the_tests_that_run_it_the_mirror_first(lines: Lines) -> None:
    expected = [
        *("tests/contact/test_laws.py::test_own", "tests/contact/test_rules.py::test_near"),
        *("tests/cli/test_run.py::test_quick", "tests/cli/test_run.py::test_beside"),
    ]  # what takes longer than the budget is left out
    assert judging(lines, LAWS, 7) == expected
    far = "tests/numerics/test_beams.py::test_far"
    assert judging(lines, LAWS, 8) == [*expected[:3], far, expected[3]]  # run at import


def test_machine_code_is_judged_by_the_tests_of_its_users(lines: Lines) -> None:
    near = lines.tests[LAWS, 7]
    lines = Lines({("delam_fem/engines/compiled/steps.py", 0): near}, SECONDS)
    assert judging(lines, COMPILED, 8, at_most=1) == ["tests/cli/test_run.py::test_quick"]


def test_files_that_mention_the_words_of_a_line_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(changed_tests, "ROOT", tmp_path)
    (tmp_path / "t.py").write_text("assert envelope_min; data")
    (tmp_path / "u.py").write_text("data = 2")
    weights = mentions("add(data, envelope_min)", ["t.py", "u.py"])
    assert weights == {"t.py": 1.0, "u.py": pytest.approx(0.5 / 1.5)}


def test_what_coverage_and_pytest_say_is_read_back(tmp_path: Path) -> None:
    from coverage import CoverageData

    name = "tests/contact/test_laws.py::test_a[x.y]"
    data = CoverageData(str(tmp_path / "coverage0.db"))
    data.set_context(f"{name}|run")
    data.add_lines({str(ROOT / LAWS): [7, 9]})
    data.set_context("")
    data.add_lines({str(ROOT / LAWS): [1]})
    data.write()
    case = '<testcase classname="tests.contact.test_laws"'
    clock = '<properties><property name="processor_seconds" value="0.25"/></properties>'
    (tmp_path / "tests0.xml").write_text(
        f'<testsuite>{case} name="test_a[x.y]" time="0.5">{clock}</testcase>'
        f'{case} name="b"><skipped/></testcase></testsuite>'
    )
    lines = Lines.read(tmp_path)
    assert lines.seconds == {name: 0.25}
    assert lines.tests[LAWS, 7] == lines.tests[LAWS, 0] == {name}
    assert not lines.tests[LAWS, 1]


@pytest.mark.slow
def test_a_record_is_made_and_read(tmp_path: Path) -> None:
    changed_tests.record(tmp_path, ["tests/contact/test_laws.py"], "-n", "0", "-k", "law")
    lines = Lines.read(tmp_path)
    assert lines.seconds and set(lines.seconds) >= lines.tests[LAWS, 0] != set()
    assert (tmp_path / "revision").read_text() == changed_tests._git("rev-parse", "HEAD").strip()


def test_lines_of_the_older_file_are_those_that_differ() -> None:
    diff = "@@ -3 +3 @@\n-a\n+b\n@@ -10,2 +10 @@\n-c\n-d\n+e\n@@ -20,0 +20,3 @@\n+f\n+g\n+h\n"
    assert changed_lines(diff) == [3, 10, 11, 20, 21]


def test_without_a_record_the_table_of_the_page_is_taken() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    folders = [
        path.name for path in (ROOT / "delam_fem").iterdir() if (path / "__init__.py").is_file()
    ]
    for folder in folders:
        names = by_folder([f"delam_fem/{folder}/x.py"], page)
        assert names and all((ROOT / name).exists() for name in names), folder
    assert by_folder(["delam_fem/api.py", "docs/index.md"], page) == []

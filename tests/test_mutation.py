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


def test_the_configuration_names_modules_and_tests_that_exist() -> None:
    config = mutation.config()
    assert len(config["tests"]) > 20
    for module, tests in config["tests"].items():
        assert (ROOT / module).is_file(), module
        for name in tests:
            file = name.split("::")[0]
            assert file.startswith("--") or (ROOT / file).exists(), f"{module}: {file}"
    assert all(len(reason) > 10 for reason in config["equivalent"].values())


@pytest.mark.parametrize("folder", ["numerics", "contact"])
def test_every_module_of_the_pure_folders_is_measured(folder: str) -> None:
    measured = mutation.config()["tests"]
    for path in (ROOT / "delam_fem" / folder).glob("*.py"):
        has_logic = path.name not in ("__init__.py", "types.py")
        assert not has_logic or f"delam_fem/{folder}/{path.name}" in measured, path


def test_annotations_and_decorators_are_found() -> None:
    lines = TEXT.splitlines()
    types, decorators = (
        {lines[start[0] - 1][start[1] : end[1]] for start, end in places}
        for places in mutation.annotations(TEXT)
    )
    assert types == {"int | None", "float", "list[float] | None", "int | bool"}
    assert decorators == {"dataclass(frozen=True)", "cache"}


def test_samples_are_drawn_once_and_the_same_each_time() -> None:
    mutants = [mutation.Mutant("m.py", "core/X", k) for k in range(100)]
    drawn = mutation.sampled(mutants, 20, seed=1)
    assert len(set(drawn)) == 20
    assert drawn == sorted(drawn) == mutation.sampled(mutants, 20, seed=1)
    assert drawn != mutation.sampled(mutants, 20, seed=2)
    assert mutation.sampled(mutants, 100, seed=1) == mutants


def test_a_change_shows_its_lines() -> None:
    assert mutation.change("a\n  b = 1\nc", "a\n  b = 2\nc") == "b = 1 → b = 2"


@pytest.mark.parametrize(
    ("killed", "n", "total", "expected"),
    [
        (90, 100, 10**9, (0.8256, 0.9448)),  # as tabulated for a large population
        (0, 10, 10**9, (0.0, 0.2775)),
        (9, 10, 10, (0.9, 0.9)),  # all of them are known
    ],
)
def test_intervals_of_a_share(
    killed: int, n: int, total: int, expected: tuple[float, float]
) -> None:
    assert mutation.wilson(killed, n, total) == pytest.approx(expected, abs=1e-4)


def measured(module: str, n_mutants: int, killed: int, survivors: list[str]) -> object:
    results = {f"core/X {k}": "killed" for k in range(killed - 1)} | {"core/Y 0": "timeout"}
    results |= {f"core/Z {k}": text for k, text in enumerate(survivors)}
    return mutation.Measured(module, "", n_mutants, results)


def test_the_score_weighs_modules_by_their_mutants() -> None:
    whole = measured("delam_fem/a.py", 10, 9, ["x → y"])
    part = measured("delam_fem/b.py", 90, 5, ["u → v"] * 5)
    share, half = mutation.overall([whole, part])
    assert share == pytest.approx(0.1 * 0.9 + 0.9 * 0.5)
    assert half == pytest.approx(1.96 * 0.9 * (0.25 / 10 * (1.0 - 10 / 90)) ** 0.5)
    assert mutation.overall([whole])[1] == 0.0


def test_the_page_tells_survivors_with_their_reasons() -> None:
    page = mutation.page(
        [measured("delam_fem/a.py", 40, 9, ["x → y", "u → v"])], {"x → y": "the same number"}
    )
    assert "**81.8 % ± " in page
    assert "40 mutants are killed** (95 % interval; 11 were" in page
    assert "2 of them survived). 1 of the survivors" in page
    assert "| `a` | 40 | 11 | 9 | 82 |" in page
    assert "- `a.py`: `x → y` – the same number" in page
    assert "- `a.py`: `u → v` – **open" in page


@pytest.mark.parametrize(
    ("body", "limit", "expected"),
    [("pass", 60.0, "passed"), ("assert 0", 60.0, "failed"), ("while True: pass", 2.0, "timeout")],
)
def test_tests_run_in_a_fork(tmp_path: Path, body: str, limit: float, expected: str) -> None:
    path = tmp_path / "test_made.py"
    path.write_text(f"def test_made():\n    {body}\n")
    assert mutation.run_tests([str(path)], limit) == expected


def test_tests_of_a_module_come_from_near_to_far(tmp_path: Path) -> None:
    for name, text in {
        "delam_fem/a/b.py": "x = 1",
        "delam_fem/a/c.py": "from delam_fem.a.b import x",
        "delam_fem/d.py": "from delam_fem.a import c",
        "tests/a/test_b.py": "import delam_fem.a.b",
        "tests/a/test_near.py": "",
        "tests/test_user.py": "from delam_fem.a import b",
        "tests/test_indirect.py": "from delam_fem.a.c import x",
        "tests/test_far.py": "import delam_fem.d",
        "tests/kit.py": "import delam_fem.a.b",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert mutation.rounds("delam_fem/a/b.py", tmp_path) == [
        ["tests/a/test_b.py"],
        ["tests/test_user.py"],
        ["tests/a/test_near.py", "tests/test_indirect.py"],
    ]
    assert mutation.rounds("delam_fem/d.py", tmp_path) == [
        ["tests/test_far.py"],
        ["tests/test_indirect.py", "tests/test_user.py"],
    ]


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

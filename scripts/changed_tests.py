"""Name the tests that run what was changed, the most telling first.

    .venv/bin/python scripts/changed_tests.py --record [PLACE …]    # all tests, or those of places
    scripts/test.sh --changed                                       # runs them, at most 2 minutes

`--record` runs tests once with coverage, which says which tests run which line, and keeps this with
the processor time of each test and the commit in runs/coverage. A later change is compared with
that commit, so that the record serves until most lines are others.

Chosen are tests that are changed themselves, then tests that run a changed line: those of the file
that mirrors its module first, then those of each file in turn, more of files that mention the words
of the line, as long as they take `--seconds` of a processor together. Lines that run at import and
machine code belong to no test: for these, tests that run any line of the module, or else of the
modules that import it. Without a record, the tests that CONTRIBUTING.md names for the folder.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "runs" / "coverage"
PAGE = ROOT / "CONTRIBUTING.md"
SECONDS = 120.0
"""Processor time of the chosen tests, as recorded [s]."""
AT_MOST = 400
"""Largest number of tests that are chosen."""
SHARE = 20
"""So many times as many tests of a file are taken that mentions all rare words of a line."""
HUNK = re.compile(r"^@@ -(\d+)(?:,(\d+))? \+", re.MULTILINE)


# -- which tests run a line ------------------------------------------------------------------------


def record(directory: Path, places: Iterable[str] = (), *options: str) -> None:
    """Run tests once, and keep which of them run which line, and their times.

    Args:
        directory: folder of the record; records of other places there stay.
        places: files or folders of tests; none: all.
        options: of pytest.
    """
    directory.mkdir(parents=True, exist_ok=True)
    number = len([*directory.glob("tests*.xml")])
    command = [
        sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "changed_tests",
        *options, "--cov=delam_fem", "--cov-context=test", "--cov-report=", "--cov-fail-under=0",
        f"--junit-xml={directory / f'tests{number}.xml'}", *places,
    ]  # fmt: skip
    paths = os.pathsep.join([str(ROOT / "scripts"), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {
        "COVERAGE_FILE": str(directory / f"coverage{number}.db"),
        "PYTHONPATH": paths.rstrip(os.pathsep),
    }
    subprocess.run(command, cwd=ROOT, env=environment, check=False)
    (directory / "revision").write_text(_git("rev-parse", "HEAD").strip())


_begun: dict[str, float] = {}
"""Clock at the start of tests, by their names."""


def pytest_runtest_logstart(nodeid: str) -> None:
    """Look at the clock of the processor: this module is a plugin of pytest while it records."""
    _begun[nodeid] = _clock()


def pytest_runtest_teardown(item: Any) -> None:
    """Keep the processor time of a test and of what it has started and waited for [s]."""
    seconds = _clock() - _begun.pop(item.nodeid, _clock())
    item.user_properties.append(("processor_seconds", f"{seconds:.4f}"))


def _clock() -> float:
    """Return the processor time of this process and of those that it has started [s]."""
    return sum(os.times()[:4])


class Lines:
    """Which tests run which lines, and how long each test takes.

    Attributes:
        tests: by module and line, the names of the tests that run it; line 0: any of its lines.
        seconds: by test.
    """

    def __init__(self, tests: Mapping[tuple[str, int], set[str]], seconds: Mapping[str, float]):
        """Store both."""
        self.tests = tests
        self.seconds = seconds

    @classmethod
    def read(cls, directory: Path) -> Lines:
        """Read what `record` kept."""
        from coverage import CoverageData

        seconds = {}
        for path in sorted(directory.glob("tests*.xml")):
            for case in ElementTree.parse(path).iter("testcase"):
                if case.find("failure") is None and case.find("skipped") is None:
                    file, _, inner = _file_of(case.get("classname", ""))
                    name = "::".join(filter(None, (file, inner, case.get("name", ""))))
                    seconds[name] = _seconds(case)
        tests: dict[tuple[str, int], set[str]] = {}
        for path in sorted(directory.glob("coverage*.db")):
            data = CoverageData(str(path))
            data.read()
            for measured in data.measured_files():
                module = "delam_fem/" + measured.rpartition("/delam_fem/")[2]
                for line, contexts in data.contexts_by_lineno(measured).items():
                    names = {context.rpartition("|")[0] for context in contexts}
                    names = {name for name in names if name in seconds}
                    tests.setdefault((module, line), set()).update(names)
                    tests.setdefault((module, 0), set()).update(names)
        return cls(tests, seconds)

    def running(self, module: str, lines: Iterable[int]) -> set[str]:
        """Return the tests that run any of some lines of a module; lines of no test: see above."""
        names = set[str]()
        for line in lines:
            names |= self.tests.get((module, line)) or self.tests.get((module, 0), set())
        if names:
            return names
        users = sorted((ROOT / "delam_fem").rglob("*.py"))
        dotted = module.removesuffix(".py").replace("/", ".")
        near = [path.relative_to(ROOT).as_posix() for path in users if dotted in imports(path)]
        return set().union(*(self.tests.get((path, 0), set()) for path in near))

    def ordered(self, module: str, names: set[str], words: str) -> list[str]:
        """Return tests in the order in which they should run for a change of a module.

        Args:
            module: path of the module.
            names: the tests.
            words: text of the changed lines.
        """
        mirror = f"tests/{module.removeprefix('delam_fem/').rpartition('/')[0]}"
        stem = f"test_{Path(module).stem}.py"
        files = {test.partition("::")[0] for test in names}
        weights = mentions(words, files)
        ranks = {}
        counts = Counter[str]()
        for test in sorted(names, key=lambda test: (self.seconds[test], test)):
            file = test.partition("::")[0]
            is_mirror = file.startswith(mirror) and file.endswith(stem)
            turn = counts[file] // (1 + round(SHARE * weights[file]))
            is_near = file.startswith(mirror)
            ranks[test] = not is_mirror, turn, not is_near, self.seconds[test], test
            counts[file] += 1
        return sorted(names, key=ranks.__getitem__)

    def judging(
        self, module: str, lines: Iterable[int], words: str, *, seconds: float, at_most: int
    ) -> list[str]:
        """Return the tests of some lines, then others of their files, within a time.

        Args:
            module: path of the module.
            lines: numbers of the lines; 0: any.
            words: text of these lines.
            seconds: processor time of all together [s].
            at_most: largest number of tests.
        """
        names = self.running(module, lines)
        files = {test.partition("::")[0] for test in names}
        siblings = {test for test in self.seconds if test.partition("::")[0] in files} - names
        chosen: list[str] = []
        ordered = (*self.ordered(module, names, words), *self.ordered(module, siblings, words))
        for test in ordered:
            if self.seconds[test] <= seconds and len(chosen) < at_most:
                chosen.append(test)
                seconds -= self.seconds[test]
        return chosen


def mentions(line: str, files: Iterable[str]) -> dict[str, float]:
    """Return how many words of a line test files have; rare ones count more, at most 1."""
    words = set(re.findall(r"[A-Za-z_]{4,}", line))
    texts = {f: set(re.findall(r"[A-Za-z_]{4,}", (ROOT / f).read_text("utf-8"))) for f in files}
    counts = Counter(word for text in texts.values() for word in words & text)
    scores = {file: sum(1.0 / counts[w] for w in words & text) for file, text in texts.items()}
    largest = max(scores.values(), default=0.0) or 1.0
    return {file: score / largest for file, score in scores.items()}


@cache
def imports(path: Path) -> set[str]:
    """Return the modules that a file imports; a name from a module counts as a module, too."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def _file_of(classname: str) -> tuple[str, str, str]:
    """Return the file, and the class in it, of a test whose class JUnit writes with dots."""
    parts = classname.split(".")
    for n in range(len(parts), 0, -1):
        file = "/".join(parts[:n]) + ".py"
        if (ROOT / file).is_file():
            return file, ".", "::".join(parts[n:])
    return "", "", ""


def _seconds(case: ElementTree.Element) -> float:
    """Return the processor time of a test of a record [s], or else its time."""
    for entry in case.iter("property"):
        if entry.get("name") == "processor_seconds":
            return float(entry.get("value", 0.0))
    return float(case.get("time", 0.0))


# -- what was changed ------------------------------------------------------------------------------


def _git(*arguments: str) -> str:
    """Return what git says; nothing if it fails."""
    run = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    return run.stdout if run.returncode == 0 else ""


def changed_files(revision: str) -> list[str]:
    """Return the files that differ from a revision, with new ones."""
    names = _git("diff", "--name-only", "--no-renames", revision).split("\n")
    return sorted({*names, *_git("ls-files", "-o", "--exclude-standard").split("\n")} - {""})


def changed_lines(diff: str) -> list[int]:
    """Return the lines of the older file that a diff without context changes.

    Where lines are added only, they are the two between which they are added.
    """
    lines: list[int] = []
    for hunk in HUNK.finditer(diff):
        first = int(hunk[1])
        count = 1 if hunk[2] is None else int(hunk[2])
        lines += range(first, first + count) if count else (first, first + 1)
    return [line for line in lines if line > 0]


def by_folder(files: Iterable[str], page: str) -> list[str]:
    """Return the tests that the table of CONTRIBUTING.md names for the folders of some files."""
    names: list[str] = []
    for folder in sorted({file.split("/")[1] for file in files if file.count("/") > 1}):
        for row in page.splitlines():
            cells = row.split("|")
            if len(cells) > 3 and f"`{folder}`" in cells[1]:
                names += " ".join(re.findall(r"`(tests[^`]*)`", cells[2])).split()
                if "folder of the same name" in cells[2]:
                    names.append(f"tests/{folder}")
    return list(dict.fromkeys(names))


def chosen(revision: str, lines: Lines, *, seconds: float) -> Iterator[str]:
    """Yield the tests for all that differs from a revision, changed tests first."""
    files = changed_files(revision)
    yield from (f for f in files if re.match(r"tests/.*test_\w+\.py$", f) and (ROOT / f).is_file())
    modules = [file for file in files if re.match(r"delam_fem/.*\.py$", file)]
    for module in modules:
        diff = _git("diff", "-U0", "--no-renames", revision, "--", module)
        words = " ".join(re.findall(r"^[-+](?![-+]{2} )(.*)", diff, re.MULTILINE))
        yield from lines.judging(
            module,
            changed_lines(diff) or [0],
            words,
            seconds=seconds / len(modules),
            at_most=AT_MOST,
        )


def main(arguments: list[str] | None = None) -> None:
    """Record, or print the names of tests, one a line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--record", nargs="*", metavar="PLACE", help="run tests with coverage")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="time of all together")
    options = parser.parse_args(arguments)
    if options.record is not None:
        parallel = ("--numprocesses=auto", "--dist=worksteal")
        record(FOLDER, options.record, "-m", "not slow and not nightly and not once", *parallel)
        return
    revision = FOLDER / "revision"
    at = revision.read_text().strip() if revision.is_file() else ""
    if _git("cat-file", "-t", at or "none").strip() == "commit":
        names = list(dict.fromkeys(chosen(at, Lines.read(FOLDER), seconds=options.seconds)))
        source = f"recorded at {at[:8]}"
    else:
        names = by_folder(changed_files("HEAD"), PAGE.read_text(encoding="utf-8"))
        source = "by folder, because nothing is recorded (scripts/changed_tests.py --record)"
    sys.stderr.write(f"{len(names)} tests or files of tests, {source}\n")
    sys.stdout.write("".join(f"{name}\n" for name in names))


if __name__ == "__main__":
    main()

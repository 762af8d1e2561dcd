"""Measure how many small faults, anywhere in the package, the tests notice (mutation score).

    .venv/bin/pip install -c .venv/constraints.txt -e .[mutation]
    nice -n 10 .venv/bin/python scripts/evidence/mutation.py    # 200 mutants; writes the page
    .venv/bin/python scripts/evidence/mutation.py --modules contact/rules --sample 999 --page x.md

Cosmic Ray makes the faults: a sign, a factor, a comparison or a number changed in one place of a
copy of the checkout. A mutant is killed if a test fails that passes without it.

First all tests run once with coverage, which says which tests run which line, and how long each
takes. A mutant is judged by the tests that `scripts/changed_tests.py` names for its line, up to
`BUDGET` seconds. Results are kept, and a measurement that was broken off goes on there.
"""

from __future__ import annotations

import argparse
import ast
import gc
import importlib
import io
import json
import math
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable, Mapping
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from changed_tests import Lines, record

Place = tuple[tuple[int, int], tuple[int, int]]
"""Line and column where something begins and after its end."""

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "scripts" / "evidence" / "mutation.toml"
ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""A fork must find no threads."""
OPTIONS = (
    "-x", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=0", "-m", "not nightly and not once",
    "-W", "ignore::pytest.PytestAssertRewriteWarning",
)  # fmt: skip
"""Options of pytest; hypothesis is imported before pytest could rewrite it."""
BUDGET = 150.0
"""Tests that judge a mutant may take so many seconds without it."""
AT_MOST = 200
"""Largest number of tests that judge a mutant."""
CPU_SECONDS = 180
"""Processor time of a mutant: its tests, imports, and what it compiles."""
OVERTIME = (signal.SIGXCPU, signal.SIGKILL, signal.SIGALRM)
"""Signals that end what takes longer."""

PAGE_HEAD = """# How many faults the tests notice

[Cosmic Ray](https://cosmic-ray.readthedocs.io) changes one place of the package (a mutant), and the
tests that run this place judge it. A mutant is killed if a test fails that passes without it.
`scripts/evidence/mutation.py` writes this page; `scripts/evidence/mutation.toml` has the kinds of
changes, and why a mutant computes the same.

**{killed} of {n} mutants, drawn at random from the {total} of all modules, are killed:
{share:.1f} %** (95 % interval {low:.0f} to {high:.0f} %). {equivalent} of the {survived} survivors
compute the same as the original, so that no test can notice them; without them {without:.1f} % are
killed. A mutant is judged by tests that take at most {budget:.0f} s together, and not by all of
`scripts/test.sh`.
"""


@dataclass(frozen=True, order=True)
class Mutant:
    """One fault: the operator of Cosmic Ray, the number of its place, and its line."""

    module: str
    operator: str
    occurrence: int
    line: int

    @property
    def key(self) -> str:
        """Operator and occurrence: its name within the module."""
        return f"{self.operator} {self.occurrence}"


def config() -> dict[str, Any]:
    """Return the content of mutation.toml."""
    return tomllib.loads(CONFIG.read_text(encoding="utf-8"))


# -- mutants ---------------------------------------------------------------------------------------


def mutants_of(module: str, operators: Iterable[str]) -> list[Mutant]:
    """Return the mutants of a module in a fixed order.

    Annotations have none: they are never evaluated. Decorators (a class frozen or not) and the star
    of a signature change no number.
    """
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    pattern = re.compile("|".join(f"core/{name}$" for name in operators))
    text = (ROOT / module).read_text(encoding="utf-8")
    nodes = list(ast_nodes(get_ast(text)))
    idle = annotations(text)
    lines = text.splitlines()
    mutants = []
    for name in filter(pattern.match, operator_names()):
        operator = get_operator(name)()
        places = (place for node in nodes for place in operator.mutation_positions(node))
        for occurrence, (start, _) in enumerate(places):
            is_idle = any(begin <= start < end for begin, end in idle)
            if not is_idle and not lines[start[0] - 1][start[1] :].startswith("*,"):
                mutants.append(Mutant(module, name, occurrence, start[0]))
    return sorted(mutants)


def annotations(text: str) -> list[Place]:
    """Return the places of annotations and of decorators."""
    nodes: list[ast.expr | None] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            nodes += node.decorator_list
        if isinstance(node, ast.FunctionDef):
            nodes.append(node.returns)
        elif isinstance(node, (ast.arg, ast.AnnAssign)):
            nodes.append(node.annotation)
    return [
        ((n.lineno, n.col_offset), (n.end_lineno or 0, n.end_col_offset or 0)) for n in nodes if n
    ]


def all_mutants(parts: Iterable[str], operators: list[str]) -> list[Mutant]:
    """Return the mutants of the modules whose path contains one of `parts`."""
    modules = (p.relative_to(ROOT).as_posix() for p in sorted((ROOT / "delam_fem").rglob("*.py")))
    chosen = (module for module in modules if any(part in module for part in parts))
    return [mutant for module in chosen for mutant in mutants_of(module, operators)]


def change(text: str, mutated: str) -> str:
    """Return the changed lines of a mutant, before and after."""
    differ = [
        (old.strip(), new.strip())
        for old, new in zip_longest(text.splitlines(), mutated.splitlines(), fillvalue="")
        if old != new
    ]
    return " ".join(old for old, _ in differ) + " → " + " ".join(new for _, new in differ)


# -- which tests run a line ------------------------------------------------------------------------


def copy_of_checkout(place: Path) -> None:
    """Copy the files that git knows, with the changes of the working tree, and machine code."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )  # fmt: skip
    machine_code = (p.relative_to(ROOT).as_posix() for p in ROOT.glob("delam_fem/**/*.nb[ci]"))
    for name in (*filter(None, listed.stdout.split("\0")), *machine_code):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place / name)


def judges(mutant: Mutant, tests: Lines) -> list[str]:
    """Return the tests that judge a mutant, in the order in which they run."""
    line = (ROOT / mutant.module).read_text(encoding="utf-8").splitlines()[mutant.line - 1]
    return tests.judging(mutant.module, [mutant.line], line, seconds=BUDGET, at_most=AT_MOST)


# -- tests of mutants ------------------------------------------------------------------------------


class _Failures:
    """A plugin of pytest that writes the names of tests and files that fail."""

    def __init__(self, file: Any) -> None:
        """Store the open file."""
        self.file = file

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Look at one phase of a test."""
        if report.failed:
            print(report.nodeid, file=self.file, flush=True)

    pytest_collectreport = pytest_runtest_logreport


def outcome(tests: list[str], cache: str = "", limit: int = CPU_SECONDS) -> tuple[str, str]:
    """Run tests to the first failure; return "passed", "failed" or "timeout", and what failed.

    They run in a fork of this process, which has all libraries imported.
    """
    with tempfile.TemporaryFile("w+") as names, open(os.devnull, "w") as nothing:
        child = os.fork()
        if not child:
            os.setpgid(0, 0)
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            signal.alarm(10 * limit)  # a mutant may wait for ever
            status = 70
            try:
                os.dup2(nothing.fileno(), 1)
                os.dup2(nothing.fileno(), 2)
                import pytest
                from numba.core import config as of_numba

                if cache:  # what a mutant compiles must not take the place of what is kept
                    of_numba.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"] = cache
                status = int(pytest.main([*OPTIONS, *tests], [_Failures(names)]))
            finally:
                os._exit(status)
        _, status = os.waitpid(child, 0)
        with suppress(ProcessLookupError):  # what it has started, if it was killed
            os.killpg(child, signal.SIGKILL)
        names.seek(0)
        failed = names.readline().rstrip("\n")
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) in OVERTIME:
        return "timeout", ""
    return ("passed" if status == 0 else "failed"), failed


def judged(mutant: Mutant, tests: list[str], broken: set[str]) -> str:
    """Return "killed: TEST", "timeout" or the change that survived, for a mutant in this folder.

    Tests that fail without the mutant, too, kill nothing; they are added to `broken` and left out.
    """
    from cosmic_ray.mutating import use_mutation
    from cosmic_ray.plugins import get_operator

    operator = get_operator(mutant.operator)()
    path = Path(mutant.module)
    sys.dont_write_bytecode = True
    times = path.stat()
    while True:
        asked = [test for test in tests if test not in broken]
        with (
            tempfile.TemporaryDirectory() as cache,
            use_mutation(path, operator, mutant.occurrence) as (text, mutated),
        ):
            is_compiled = any(word in text for word in ("njit", "numba", "NamedTuple"))
            result, name = outcome(asked, cache if is_compiled else "") if asked else ("passed", "")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # Numba's cache looks at them
        if result == "passed":
            return change(text, mutated)
        if outcome([name] if "::" in name else asked)[0] == "passed":
            return "timeout" if result == "timeout" else f"killed: {name}"
        if name not in asked:
            return f"{change(text, mutated)} (not judged: its tests fail or last without it)"
        broken.add(name)


def sample(drawn: list[Mutant], directory: Path) -> list[str]:
    """Judge mutants one after the other; return the results, which are kept as they come."""
    file = directory / "results.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    known = {(row["module"], row["key"]): row["result"] for row in map(json.loads, lines)}
    tests_of = Lines.read(directory)
    broken = set[str]()
    with tempfile.TemporaryDirectory() as place:
        copy_of_checkout(Path(place))
        os.chdir(place)
        sys.path.insert(0, place)
        for name in config()["preload"]:
            importlib.import_module(name)
        with redirect_stdout(io.StringIO()), tempfile.TemporaryDirectory() as empty:
            import pytest

            pytest.main([*OPTIONS, "--collect-only", empty])  # the plugins, nothing of the checkout
        gc.freeze()  # pytest collects garbage often, and most objects are those of the libraries
        for n, mutant in enumerate(drawn, 1):
            if (mutant.module, mutant.key) in known:
                continue
            begin = time.monotonic()
            tests = judges(mutant, tests_of)
            result = known[mutant.module, mutant.key] = judged(mutant, tests, broken)
            row = {"module": mutant.module, "key": mutant.key, "result": result}
            row |= {"line": mutant.line, "tests": len(tests)}
            with file.open("a", encoding="utf-8") as output:
                output.write(json.dumps(row, ensure_ascii=False) + "\n")
            taken = time.monotonic() - begin
            print(f"{n}/{len(drawn)}, {taken:.0f} s, {mutant.module}: {result}", flush=True)
        os.chdir(ROOT)
    return [known[mutant.module, mutant.key] for mutant in drawn]


# -- the score -------------------------------------------------------------------------------------


def is_killed(result: str) -> bool:
    """Return whether a test noticed a mutant with this result."""
    return result.startswith(("killed: ", "timeout"))


def wilson(killed: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a share of which `killed` of n are known.

    Source: E. B. Wilson (1927).
    """
    share = killed / n
    z = 1.96
    middle = (share + z**2 / (2.0 * n)) / (1.0 + z**2 / n)
    half = z / (1.0 + z**2 / n) * math.sqrt(share * (1.0 - share) / n + (z / n / 2.0) ** 2)
    return max(0.0, middle - half), min(1.0, middle + half)


def page(
    drawn: list[Mutant],
    results: list[str],
    total: int,
    reasons: Mapping[str, str],
    since: Mapping[str, str],
) -> str:
    """Return docs/evidence/mutation.md.

    Args:
        drawn: mutants.
        results: of each of them.
        total: number of mutants of which they were drawn.
        reasons: why a mutant is equivalent, by its changed line as `change` writes it.
        since: the test that was written because of a survivor, by its changed line.
    """
    folders: dict[str, list[bool]] = {}
    left = []
    for mutant, result in zip(drawn, results, strict=True):
        inner = mutant.module.removeprefix("delam_fem/")
        folders.setdefault(inner.partition("/")[0], []).append(is_killed(result))
        if not is_killed(result):
            left.append((inner, result))
    n = len(results)
    killed = len(results) - len(left)
    same = sum(result in reasons for _, result in left)
    low, high = wilson(killed, n)
    head = PAGE_HEAD.format(
        killed=killed, n=n, total=total, share=100 * killed / n, low=100 * low, high=100 * high,
        equivalent=same, survived=len(left), without=100 * killed / (n - same), budget=BUDGET,
    )  # fmt: skip
    rows = [f"| `{name}` | {len(of)} | {sum(of)} |" for name, of in sorted(folders.items())]
    table = ["| folder | drawn | killed |", "|---|---|---|", *rows, "", "## Survivors", ""]
    noticed = sum(text in since for _, text in left)
    table += [f"Tests that were written since notice {noticed} of them.", ""]
    opened = [pair for pair in sorted(left) if pair[1] not in since and pair[1] not in reasons]
    table += ["No test notices:", ""] * bool(opened)
    survivors = [f"- `{where}`: `{text}`" for where, text in opened]
    return "\n".join([head, *table, *survivors, *[""] * bool(opened)])


def main(arguments: list[str] | None = None) -> None:
    """Draw, judge, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--modules", nargs="*", default=[""], help="parts of their paths")
    parser.add_argument("--sample", type=int, default=200, help="number of mutants")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument("-o", "--directory", type=Path, default=ROOT / "runs" / "mutation")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "evidence" / "mutation.md")
    options = parser.parse_args(arguments)
    os.environ |= ENVIRONMENT
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    settings = config()
    directory = options.directory.resolve()
    if not [*directory.glob("tests*.xml")]:
        parallel = ("--numprocesses=auto", "--dist=worksteal")
        record(directory, (), "-m", "not nightly and not once", *parallel)
    mutants = all_mutants(options.modules, settings["operators"])
    drawn = random.Random(options.seed).sample(mutants, min(options.sample, len(mutants)))
    results = sample(drawn, directory)
    text = page(drawn, results, len(mutants), settings["equivalent"], settings["since"])
    options.page.write_text(text, encoding="utf-8")
    print(text.split("\n\n")[2])


if __name__ == "__main__":
    main()

"""Measure how many small faults in the pure core the tests notice (mutation score).

    .venv/bin/pip install -c .venv/constraints.txt -e .[mutation]
    nice -n 10 .venv/bin/python scripts/mutation.py                 # all modules
    .venv/bin/python scripts/mutation.py --modules contact/newton   # one module, every mutant
    .venv/bin/python scripts/mutation.py --anywhere --sample 200 --seed 1

Cosmic Ray makes the faults: a sign, a factor, a comparison or a number changed in one place. The
tests of the module then run on a copy of the checkout. A mutant is killed if a test fails. Modules,
tests, kinds of faults and the size of the samples are in scripts/mutation.toml.

A sample from anywhere in the package needs no list of tests, and Numba compiles: first run the test
file that mirrors the module, then those that import it, then those that reach it through one other
module. A test that kills a mutant must pass without it. Results are kept in anywhere.jsonl, and a
measurement that was broken off goes on there.
"""

from __future__ import annotations

import argparse
import ast
import gc
import importlib
import io
import json
import math
import multiprocessing
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
from collections.abc import Iterable
from contextlib import redirect_stdout, suppress
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from itertools import zip_longest
from pathlib import Path
from typing import Any

Place = tuple[tuple[int, int], tuple[int, int]]
"""Line and column where something begins and after its end."""

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "scripts" / "mutation.toml"
TIMES = 5.0
"""A mutant may take so many times as long as the unchanged module."""
ENVIRONMENT = {"NUMBA_DISABLE_JIT": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Nothing is compiled, and a fork must find no threads."""
OPTIONS = (
    "-x", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=0",
    "-W", "ignore::pytest.PytestAssertRewriteWarning",
)  # fmt: skip
"""Options of pytest; hypothesis is imported before pytest could rewrite it."""
STAGE_SECONDS = 300
"""CPU time that each of the three rounds of tests of a mutant may take."""
OVERTIME = (signal.SIGXCPU, signal.SIGKILL, signal.SIGALRM)
"""Signals that end what takes longer."""


PAGE_HEAD = """# How many faults the tests notice

Line coverage says which lines run, not whether a wrong sign or a factor in them is noticed. So
[Cosmic Ray](https://cosmic-ray.readthedocs.io) changes one place of the pure core at a time (a
mutant), and the tests of that module run. A mutant is killed if a test fails.
`scripts/mutation.py` writes this page; modules, tests, kinds of changes, the size of the samples
and their seed are in `scripts/mutation.toml`.

**{share:.1f} % ± {half:.1f} % of the {total} mutants are killed** (95 % interval; {drawn} were
drawn and tested, {survived} of them survived). {equivalent} of the survivors compute the same as
the original, so that no test can notice them; they count as survivors in all numbers.

Only the quick tests of each module count here, without Numba's compiler and without the engines;
other tests of `scripts/test.sh` notice more.
"""


@dataclass(frozen=True, order=True)
class Mutant:
    """One fault: the operator of Cosmic Ray and the number of the place where it acts."""

    module: str
    operator: str
    occurrence: int

    @property
    def key(self) -> str:
        """Operator and occurrence: its name within the module."""
        return f"{self.operator} {self.occurrence}"


@dataclass
class Measured:
    """What the tests made of the mutants of a module.

    Attributes:
        module: path of the module.
        digest: of the module's text.
        n_mutants: number of all mutants.
        results: by operator and occurrence "killed", "timeout" or the change that survived.
    """

    module: str
    digest: str
    n_mutants: int
    results: dict[str, str] = field(default_factory=dict)

    @property
    def survivors(self) -> list[str]:
        """The changes that no test noticed."""
        return sorted(r for r in self.results.values() if r not in ("killed", "timeout"))


def config() -> dict[str, Any]:
    """Return the content of mutation.toml."""
    return tomllib.loads(CONFIG.read_text(encoding="utf-8"))


# -- mutants ---------------------------------------------------------------------------------------


def mutants_of(module: str, operators: Iterable[str]) -> tuple[list[Mutant], set[Mutant]]:
    """Return the mutants of a module in a fixed order, and those of them that change no number.

    These are in decorators (a class frozen or not), or at the star of a signature. Annotations have
    none: they are never evaluated.
    """
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    pattern = re.compile("|".join(f"core/{name}$" for name in operators))
    text = (ROOT / module).read_text(encoding="utf-8")
    nodes, (types, decorators) = list(ast_nodes(get_ast(text))), annotations(text)
    lines = text.splitlines()
    found, idle = [], set()
    for name in filter(pattern.match, operator_names()):
        operator = get_operator(name)()
        places = (place for node in nodes for place in operator.mutation_positions(node))
        for occurrence, (start, _) in enumerate(places):
            if not any(begin <= start < end for begin, end in types):
                found.append(Mutant(module, name, occurrence))
            if any(begin <= start < end for begin, end in decorators):
                idle.add(found[-1])
            if lines[start[0] - 1][start[1] :].startswith("*,"):
                idle.add(found[-1])
    return sorted(found), idle


def annotations(text: str) -> tuple[list[Place], list[Place]]:
    """Return the places of annotations and of decorators."""
    types: list[ast.expr | None] = []
    decorators: list[ast.expr] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            decorators += node.decorator_list
        if isinstance(node, ast.FunctionDef):
            types.append(node.returns)
        elif isinstance(node, (ast.arg, ast.AnnAssign)):
            types.append(node.annotation)
    return [_place(node) for node in types if node], [_place(node) for node in decorators]


def _place(node: ast.expr) -> Place:
    """Return the first line and column of a node, and those after its end."""
    return (node.lineno, node.col_offset), (node.end_lineno or 0, node.end_col_offset or 0)


def sampled(mutants: list[Mutant], size: int, seed: int) -> list[Mutant]:
    """Return a sample without repetition, or all mutants if there are not more than `size`."""
    if len(mutants) <= size:
        return mutants
    return sorted(random.Random(f"{seed} {mutants[0].module}").sample(mutants, size))


def change(text: str, mutated: str) -> str:
    """Return the changed lines of a mutant, before and after."""
    differ = [
        (old.strip(), new.strip())
        for old, new in zip_longest(text.splitlines(), mutated.splitlines(), fillvalue="")
        if old != new
    ]
    return " ".join(old for old, _ in differ) + " → " + " ".join(new for _, new in differ)


# -- tests of mutants ------------------------------------------------------------------------------


def copy_of_checkout(place: Path) -> None:
    """Copy the files that git knows, with the changes of the working tree."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )  # fmt: skip
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place / name)


def _enter(place: str) -> None:
    """Give a worker its own copy of the checkout, and import what tests need from elsewhere."""
    own = Path(tempfile.mkdtemp(dir=place))
    copy_of_checkout(own)
    os.chdir(own)
    sys.path.insert(0, str(own))
    for name in config()["preload"]:
        importlib.import_module(name)
    with redirect_stdout(io.StringIO()), tempfile.TemporaryDirectory() as empty:
        _pytest(["--collect-only", empty])  # imports the plugins, and nothing of the checkout
    gc.freeze()  # pytest collects garbage often, and most objects are those of the libraries


def _pytest(arguments: list[str]) -> int:
    """Run pytest in this process until the first failure; return its exit status."""
    import pytest

    return int(pytest.main([*OPTIONS, "-k", "not compiled", *arguments]))


def run_tests(tests: list[str], limit: float) -> str:
    """Run tests in a fork of this process; return "passed", "failed" or "timeout".

    The fork has all libraries imported, which takes longer than the tests of a module.
    """
    child = os.fork()
    if not child:
        os.setpgid(0, 0)
        status = 70
        try:
            with open(os.devnull, "w") as nothing:
                os.dup2(nothing.fileno(), 1)
                os.dup2(nothing.fileno(), 2)
            status = _pytest(tests)
        finally:
            os._exit(status)
    end = time.monotonic() + limit
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return "passed" if status == 0 else "failed"
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "timeout"


def _baseline(task: tuple[str, list[str]]) -> float:
    """Return how long the tests of a module take [s].

    Raises:
        RuntimeError: they fail on the unchanged module, or do not notice that it is broken.
    """
    module, tests = task
    begin = time.monotonic()
    if run_tests(tests, math.inf) != "passed":
        raise RuntimeError(f"{module}: the tests fail without a mutation: {' '.join(tests)}")
    seconds = time.monotonic() - begin
    path = Path(module)
    text = path.read_text(encoding="utf-8")
    path.write_text(f"{text}\nraise RuntimeError\n", encoding="utf-8")
    if run_tests(tests, math.inf) != "failed":
        raise RuntimeError(f"{module}: the tests do not import the module that is mutated")
    path.write_text(text, encoding="utf-8")
    return seconds


def _test(task: tuple[Mutant, list[str], float]) -> tuple[Mutant, str]:
    """Run the tests of one mutant."""
    from cosmic_ray.mutating import use_mutation
    from cosmic_ray.plugins import get_operator

    mutant, tests, limit = task
    operator = get_operator(mutant.operator)()
    sys.dont_write_bytecode = True
    with use_mutation(Path(mutant.module), operator, mutant.occurrence) as (text, mutated):
        result = run_tests(tests, limit)
    words = {"failed": "killed", "timeout": "timeout", "passed": change(text, mutated)}
    return mutant, words[result]


def measure(
    chosen: dict[str, list[str]], given: dict[str, Any], file: Path, workers: int, *, again: bool
) -> list[Measured]:
    """Test the mutants of the chosen modules; write the results to a file as they come.

    Args:
        chosen: tests by module.
        given: the content of mutation.toml.
        file: JSON with the results; those of other modules stay.
        workers: number of processes.
        again: test only mutants that survived before, if their module has not changed.
    """
    known = {m.module: m for m in read(file)}
    todo: list[Mutant] = []
    for module in chosen:
        mutants, idle = mutants_of(module, given["operators"])
        digest = sha256((ROOT / module).read_bytes()).hexdigest()[:16]
        before = known.get(module)
        drawn = sampled(mutants, given["sample"], given["seed"])
        drawn = [m for m in drawn if m not in idle]  # after drawing: samples stay
        kept: dict[str, str] = {}
        if again and before is not None and before.digest == digest:
            kept = {m.key: before.results[m.key] for m in drawn if m.key in before.results}
            drawn = [m for m in drawn if kept.get(m.key) not in ("killed", "timeout")]
        known[module] = Measured(module, digest, len(mutants) - len(idle), kept)
        todo += drawn
    with (
        tempfile.TemporaryDirectory() as place,
        multiprocessing.get_context("spawn").Pool(workers, _enter, (place,)) as pool,
    ):
        modules = sorted({m.module for m in todo})
        seconds = pool.map(_baseline, [(module, chosen[module]) for module in modules], 1)
        limits = {
            module: TIMES * taken + given["slack_seconds"]
            for module, taken in zip(modules, seconds, strict=True)
        }
        random.Random(given["seed"]).shuffle(todo)  # a run that is stopped has a fair sample
        tasks = [(m, chosen[m.module], limits[m.module]) for m in todo]
        for n, (mutant, result) in enumerate(pool.imap_unordered(_test, tasks), 1):
            known[mutant.module].results[mutant.key] = result
            if result != "killed":
                print(f"{n}/{len(tasks)} {mutant.module}: {result}", flush=True)
            if n % 20 == 0 or n == len(tasks):
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(json.dumps([asdict(m) for m in known.values()], indent=1))
    return [known[module] for module in sorted(known)]


def read(file: Path) -> list[Measured]:
    """Return the results of a file, none if it is missing."""
    return [Measured(**entry) for entry in json.loads(file.read_text())] if file.is_file() else []


# -- a sample over the whole package ---------------------------------------------------------------


def anywhere(size: int, seed: int, operators: list[str]) -> list[Mutant]:
    """Return a random sample of the mutants of all modules, in random order."""
    found = []
    for path in sorted((ROOT / "delam_fem").rglob("*.py")):
        mutants, idle = mutants_of(path.relative_to(ROOT).as_posix(), operators)
        found += [mutant for mutant in mutants if mutant not in idle]
    return random.Random(seed).sample(found, min(size, len(found)))


def rounds(module: str, root: Path = ROOT) -> list[list[str]]:
    """Return the test files of a module: its mirror, those that import it, those that reach it."""
    uses = {
        path: imports(path)
        for folder in ("tests", "delam_fem")
        for path in sorted((root / folder).rglob("*.py"))
    }
    name = _dotted(Path(module))
    near = {_dotted(p.relative_to(root)) for p in uses if name in uses[p]} | {name}
    tests = [path for path in uses if path.stem.startswith("test_")]
    mirror = root / "tests" / Path(module).relative_to("delam_fem").parent
    first = [path for path in tests if path == mirror / f"test_{Path(module).stem}.py"]
    second = [path for path in tests if name in uses[path]]
    third = [path for path in tests if near & uses[path] or path.parent == mirror]
    seen: set[Path] = set()
    found = []
    for stage in (first, second, third):
        found.append([path.relative_to(root).as_posix() for path in stage if path not in seen])
        seen |= set(stage)
    return [stage for stage in found if stage]


def imports(path: Path) -> set[str]:
    """Return the modules that a file imports; a name from a module counts as a module, too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def _dotted(path: Path) -> str:
    """Return the name by which a file is imported."""
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


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


def outcome(tests: list[str], cache: str = "") -> tuple[str, str]:
    """Run tests to the first failure; return "passed", "failed" or "timeout", and what failed."""
    with tempfile.TemporaryFile("w+") as names, open(os.devnull, "w") as nothing:
        child = os.fork()
        if not child:
            os.setpgid(0, 0)
            resource.setrlimit(resource.RLIMIT_CPU, (STAGE_SECONDS, STAGE_SECONDS))
            signal.alarm(10 * STAGE_SECONDS)  # a mutant may wait for ever
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


def judged(mutant: Mutant) -> str:
    """Return "killed: TEST", "timeout" or the change that survived, for a mutant in this folder."""
    from cosmic_ray.mutating import use_mutation
    from cosmic_ray.plugins import get_operator

    operator, path = get_operator(mutant.operator)(), Path(mutant.module)
    sys.dont_write_bytecode = True
    times = path.stat()
    for tests in rounds(mutant.module, Path.cwd()):
        with (
            tempfile.TemporaryDirectory() as cache,
            use_mutation(path, operator, mutant.occurrence) as (text, mutated),
        ):
            result, name = outcome(tests, cache if "@njit" in text else "")
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # Numba's cache looks at them
        if result == "passed":
            continue
        alone = [name] if "::" in name else tests
        if outcome(alone)[0] == "passed":  # a test that fails anyhow kills nothing
            return "timeout" if result == "timeout" else f"killed: {name}"
    return change(text, mutated)


def sample(size: int, seed: int, file: Path) -> None:
    """Judge a sample over the whole package, one mutant after the other, and say the score."""
    drawn = anywhere(size, seed, config()["operators"])
    file.parent.mkdir(parents=True, exist_ok=True)
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    known = {(row["module"], row["key"]): row["result"] for row in map(json.loads, lines)}
    with tempfile.TemporaryDirectory() as place:
        _enter(place)
        for path in ROOT.glob("delam_fem/**/__pycache__/*.nb[ci]"):  # machine code
            copied = Path(path.relative_to(ROOT))
            copied.parent.mkdir(exist_ok=True)
            shutil.copy2(path, copied)
        for mutant in drawn:
            if (mutant.module, mutant.key) in known:
                continue
            begin = time.monotonic()
            result = known[mutant.module, mutant.key] = judged(mutant)
            row = {"module": mutant.module, "key": mutant.key, "result": result}
            with file.open("a", encoding="utf-8") as output:
                output.write(json.dumps(row, ensure_ascii=False) + "\n")
            print(f"{time.monotonic() - begin:.0f} s {mutant.module}: {result}", flush=True)
    results = [known[mutant.module, mutant.key] for mutant in drawn]
    killed = sum(result.startswith(("killed", "timeout")) for result in results)
    low, high = wilson(killed, len(results), 10**9)
    print(f"{killed} of {len(results)} killed: {killed / len(results):.1%}")
    print(f"95 % interval {low:.1%} to {high:.1%}")


# -- the score -------------------------------------------------------------------------------------


def wilson(killed: int, n: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a share of which `killed` of n drawn from `total` are known.

    Source: E. B. Wilson (1927), with the sample's size scaled for a finite population.
    """
    if n >= total:
        return killed / n, killed / n
    size = n * (total - 1.0) / (total - n)
    share, z = killed / n, 1.96
    middle = (share + z**2 / (2.0 * size)) / (1.0 + z**2 / size)
    half = z / (1.0 + z**2 / size) * math.sqrt(share * (1.0 - share) / size + (z / size / 2.0) ** 2)
    return max(0.0, middle - half), min(1.0, middle + half)


def overall(measured: list[Measured]) -> tuple[float, float]:
    """Return the share of all mutants that is killed, and half its 95 % interval.

    Each module counts with all its mutants; the variances of the samples add up.
    """
    total = sum(m.n_mutants for m in measured)
    share = variance = 0.0
    for m in measured:
        n, weight = len(m.results), m.n_mutants / total
        killed = n - len(m.survivors)
        share += weight * killed / n
        p = (killed + 1.0) / (n + 2.0)
        variance += weight**2 * p * (1.0 - p) / n * (1.0 - n / m.n_mutants)
    return share, 1.96 * math.sqrt(variance)


def page(measured: list[Measured], reasons: dict[str, str], missing: Iterable[str] = ()) -> str:
    """Return docs/mutation.md.

    Args:
        measured: what was measured.
        reasons: why a mutant is equivalent, by its changed line as `change` writes it.
        missing: modules that were not measured.
    """
    names = ", ".join(f"`{_short(module)}`" for module in missing)
    share, half = overall(measured)
    drawn = sum(len(m.results) for m in measured)
    rows = []
    for m in measured:
        n, killed = len(m.results), len(m.results) - len(m.survivors)
        low, high = wilson(killed, n, m.n_mutants)
        rows.append(
            f"| `{_short(m.module)}` | {m.n_mutants} | {n} | {killed} | {100 * killed / n:.0f} "
            f"| {100 * low:.0f} to {100 * high:.0f} |"
        )
    left = [
        f"- `{m.module.removeprefix('delam_fem/')}`: `{text}`"
        f" – {reasons.get(text, '**open: no test notices it**')}"
        for m in measured
        for text in m.survivors
    ]
    n_equivalent = sum(text in reasons for m in measured for text in m.survivors)
    return "\n".join(
        (
            PAGE_HEAD.format(
                share=100 * share, half=100 * half, drawn=drawn,
                total=sum(m.n_mutants for m in measured),
                survived=sum(len(m.survivors) for m in measured), equivalent=n_equivalent,
            ),
            "| module | mutants | tested | killed | score [%] | 95 % interval [%] |",
            "|---|---|---|---|---|---|",
            *rows,
            "",
            *([f"Not measured yet: {names}.", ""] if names else []),
            "## Survivors",
            "",
            *left,
            "",
        )
    )  # fmt: skip


def _short(module: str) -> str:
    """Return the name of a module in the page."""
    return module.removeprefix("delam_fem/").removesuffix(".py")


def main(arguments: list[str] | None = None) -> None:
    """Measure, print the score, and write docs/mutation.md once all modules were measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--modules", nargs="*", default=[""], help="parts of their paths; none: only write the page"
    )
    parser.add_argument("--sample", type=int, help="mutants per module")
    parser.add_argument(
        "--anywhere", action="store_true", help="draw --sample mutants from the whole package"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the draw from the whole package")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--again", action="store_true", help="only those that survived before")
    parser.add_argument("-o", "--directory", type=Path, default=ROOT / "runs" / "mutation")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "mutation.md")
    given = parser.parse_args(arguments)
    if given.anywhere:
        sample(given.sample or 200, given.seed, given.directory / "anywhere.jsonl")
        return
    settings = config()
    settings["sample"] = given.sample or settings["sample"]
    chosen = {m: t for m, t in settings["tests"].items() if any(p in m for p in given.modules)}
    os.environ |= ENVIRONMENT
    file = given.directory / "mutation.json"
    measured = measure(chosen, settings, file, given.workers, again=given.again) if chosen else []
    measured = [m for m in measured or read(file) if m.results]
    for m in measured:
        n, survived = len(m.results), len(m.survivors)
        print(f"{m.module}: {n - survived} of {n} killed, {m.n_mutants} mutants in all")
    share, half = overall(measured)
    print(f"score {100 * share:.1f} % ± {100 * half:.1f} %")
    missing = sorted(set(settings["tests"]) - {m.module for m in measured})
    if not chosen or not missing:
        text = page(measured, settings["equivalent"], missing)
        given.page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

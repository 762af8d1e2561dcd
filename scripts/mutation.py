"""Measure how many small faults in the pure core the tests notice (mutation score).

    .venv/bin/pip install -c .venv/constraints.txt -e .[mutation]
    nice -n 10 .venv/bin/python scripts/mutation.py                 # all modules
    .venv/bin/python scripts/mutation.py --modules contact/newton   # one module, every mutant

Cosmic Ray makes the faults: a sign, a factor, a comparison or a number changed in one place. The
tests of the module then run on a copy of the checkout. A mutant is killed if a test fails. Modules,
tests, kinds of faults and the size of the samples are in scripts/mutation.toml.
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
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from itertools import zip_longest
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "scripts" / "mutation.toml"
TIMES = 5.0
"""A mutant may take so many times as long as the unchanged module."""
ENVIRONMENT = {"NUMBA_DISABLE_JIT": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Nothing is compiled, and a fork must find no threads."""
OPTIONS = (
    "-x", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=0", "-k", "not compiled",
    "-W", "ignore::pytest.PytestAssertRewriteWarning",
)  # fmt: skip
"""Options of pytest; hypothesis is imported before pytest could rewrite it."""


@dataclass(frozen=True, order=True)
class Mutant:
    """One fault: the operator of Cosmic Ray and the number of the place where it acts."""

    module: str
    operator: str
    occurrence: int


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


def mutants_of(module: str, operators: Iterable[str]) -> list[Mutant]:
    """Return the mutants of a module, without those of annotations, in a fixed order."""
    from cosmic_ray.commands.init import init
    from cosmic_ray.work_db import use_db

    pattern = re.compile("|".join(f"core/{name}$" for name in operators))
    types = annotations((ROOT / module).read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder, use_db(f"{folder}/mutants.sqlite") as database:
        init([ROOT / module], database, {})
        specs = [spec for item in database.work_items for spec in item.mutations]
    return sorted(
        Mutant(module, spec.operator_name, spec.occurrence)
        for spec in specs
        if pattern.match(spec.operator_name)
        and not any(start <= spec.start_pos < end for start, end in types)
    )


def annotations(text: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return the places (line, column) of annotations, which are never evaluated."""
    found: list[ast.expr | None] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            found.append(node.returns)
        elif isinstance(node, (ast.arg, ast.AnnAssign)):
            found.append(node.annotation)
    return [
        ((a.lineno, a.col_offset), (a.end_lineno or 0, a.end_col_offset or 0)) for a in found if a
    ]


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

    return int(pytest.main([*OPTIONS, *arguments]))


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
        mutants = mutants_of(module, given["operators"])
        digest = sha256((ROOT / module).read_bytes()).hexdigest()[:16]
        before = known.get(module)
        drawn = sampled(mutants, given["sample"], given["seed"])
        if again and before is not None and before.digest == digest:
            kept = {k: r for k, r in before.results.items() if r in ("killed", "timeout")}
            drawn = [m for m in drawn if f"{m.operator} {m.occurrence}" not in kept]
        else:
            kept = {}
        known[module] = Measured(module, digest, len(mutants), kept)
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
        tasks = [(m, chosen[m.module], limits[m.module]) for m in todo]
        for n, (mutant, result) in enumerate(pool.imap_unordered(_test, tasks), 1):
            known[mutant.module].results[f"{mutant.operator} {mutant.occurrence}"] = result
            if result != "killed":
                print(f"{n}/{len(tasks)} {mutant.module}: {result}", flush=True)
            if n % 20 == 0 or n == len(tasks):
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(json.dumps([asdict(m) for m in known.values()], indent=1))
    return [known[module] for module in sorted(known)]


def read(file: Path) -> list[Measured]:
    """Return the results of a file, none if it is missing."""
    return [Measured(**entry) for entry in json.loads(file.read_text())] if file.is_file() else []


def main(arguments: list[str] | None = None) -> None:
    """Measure, and print the score."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--modules", nargs="*", default=[""], help="parts of their paths")
    parser.add_argument("--sample", type=int, help="mutants per module")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--again", action="store_true", help="only those that survived before")
    parser.add_argument("-o", "--directory", type=Path, default=ROOT / "runs" / "mutation")
    given = parser.parse_args(arguments)
    settings = config()
    settings["sample"] = given.sample or settings["sample"]
    chosen = {m: t for m, t in settings["tests"].items() if any(p in m for p in given.modules)}
    os.environ |= ENVIRONMENT
    file = given.directory / "mutation.json"
    for m in measure(chosen, settings, file, given.workers, again=given.again):
        n, survived = len(m.results), len(m.survivors)
        print(f"{m.module}: {n - survived} of {n} killed, {m.n_mutants} mutants in all")


if __name__ == "__main__":
    main()

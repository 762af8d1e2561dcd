"""Measure how near runs and sweeps are to a bare loop, and what has changed since another checkout.

    .venv/bin/python scripts/evidence/near_limit.py --limit SOURCE.cpp [--before CHECKOUT] [--short]

All figures are of one sitting, in processor time: single runs beside the bare loop in C++ of two
laminae, once alone and once with a copy beside it; the plane of docs/examples/plane.toml and its
start, beside two bare loops with as many steps, once at the contact numbers of the bare loop and
once at those of the plane, where pairs at rest take more time; points of a basin of attraction,
simulations of a table for `detect infer`, and a closed delamination. With `--before` sweeps are
also measured with the package of another checkout, in turn. About 5 minutes on two processors with
nothing else to do.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

import delam_fem as df

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
SIZES = (20, 50, 200, 2000)
LARGEST = 200
"""Elements beyond which the bare loop is not measured: it prepares for minutes."""
MASSES = {
    "lumped": ("lump=1", "imass=0"),
    "consistent": ("lump=0", "imass=1"),
}
STEPS_PER_PERIOD = 1000
EVERY = 8
"""Of the points of the plane, each so many-th one is computed by bare loops."""
SLOPE = """
import sys, time
import delam_fem as df
from delam_fem.api import assemble, session_of
elements, mass, short, long, repeats = sys.argv[1:]
keys = {"mesh.elements": int(elements), "damping.rayleigh": "stiffness"}
keys |= {"output.fields_per_period": 0, "output.window_periods": 1}
keys |= {"time.mass": "lumped"} if mass == "lumped" else {"contact.impulse": "consistent"}
cases = [df.preset("paper", keys | {"time.periods": int(n)}) for n in (short, long)]
least = [9e9, 9e9]
operators = assemble(cases[0], needs_dolfinx=False).operators
for _ in range(int(repeats)):
    for k, case in enumerate(cases):
        with session_of(case, operators) as opened:
            begin = time.thread_time()
            opened.run()
            least[k] = min(least[k], time.thread_time() - begin)
n_steps = (cases[1].n_periods - cases[0].n_periods) * cases[0].steps_per_period
print(f"{1e9 * (least[1] - least[0]) / n_steps:.1f} ns/step")
"""
"""Program: the time of a step of the preset `paper`, from runs of two lengths."""
SWEEP = """
import sys, tempfile
import delam_fem as df
if __name__ == "__main__":
    file, *settings = sys.argv[1:]
    sweep = df.load_sweep(file, {"time.periods": int(n) for n in settings})
    with tempfile.TemporaryDirectory() as folder:
        data = df.run_sweep(sweep, folder, workers=2)
        assert data.attrs["outcome"] == "completed"
        data.close()
"""
"""Program: a sweep with two workers."""
SIMULATIONS = """
import sys, tempfile
import numpy as np
import delam_fem as df
from delam_fem.studies.detection.infer import prior_of, specimens_of
from delam_fem.studies.detection.population import population
if __name__ == "__main__":
    case = df.preset("embedded")
    low, high = prior_of(case).T
    drawn = low + (high - low) * np.random.default_rng(0).random((int(sys.argv[1]), 3))
    specimens = specimens_of(drawn, "clamped", (case.excitation.frequency,))
    with tempfile.TemporaryDirectory() as folder:
        population(case, specimens, folder, workers=2)
"""
"""Program: part of the table of simulations of `detect infer`."""
CLOSED = """
import sys, time
import delam_fem as df
from delam_fem.api import assemble, session_of
keys = {"mesh.elements": 80, "time.periods": int(sys.argv[1]), "output.fields_per_period": 0}
case = df.preset("embedded", keys)
operators = assemble(case, needs_dolfinx=False).operators
least = 9e9
for _ in range(3):
    with session_of(case, operators) as opened:
        begin = time.thread_time()
        opened.run()
        least = min(least, time.thread_time() - begin)
print(f"{1e9 * least / (case.n_periods * case.steps_per_period):.0f} ns/step")
"""
"""Program: the time of a step of a closed delamination."""
KEYS = {
    "plane": ("contact.restitution", 0.0, 0.5, "contact.penalty_stiffness", 10.0, 1000.0),
    "basin": ("initial.thin.displacement", -0.05, 0.05, "initial.thin.velocity", -1.0, 1.0),
}
"""Axes of docs/examples/plane.toml and of basins.toml: key, first and last value."""
FREQUENCIES = {"plane": 3.25, "basin": 3.55}
NUMBER = re.compile(r"([\d.]+) ns/step")


class Checkout:
    """A checkout of the package, whose programs run in processes of their own."""

    def __init__(self, path: Path, folder: Path) -> None:
        """Take the package from a path; programs are written to a folder."""
        self.environment = os.environ | {"PYTHONPATH": str(path), "OMP_NUM_THREADS": "1"}
        self._folder = folder

    def _command(self, program: str, arguments: tuple[object, ...]) -> list[str]:
        """Return the command of a program in a file; `-c` would find the working folder first."""
        file = self._folder / "program.py"
        file.write_text(program)
        return [sys.executable, str(file), *map(str, arguments)]

    def seconds(self, program: str, *arguments: object) -> float:
        """Return the processor time of a program and of what it starts [s]."""
        command = self._command(program, arguments)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=self.environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def nanoseconds(self, n_copies: int, program: str, *arguments: object) -> float:
        """Return the time of a step that copies of a program print, their mean [ns]."""
        return printed(n_copies, self._command(program, arguments), self.environment)


def printed(n_copies: int, command: list[str], environment: dict[str, str]) -> float:
    """Return the mean of the times of a step that copies of a command print [ns].

    Raises:
        RuntimeError: a copy failed, or printed none.
    """
    copies = [
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        for _ in range(n_copies)
    ]
    matches = [NUMBER.search(copy.communicate()[0]) for copy in copies]
    if not all(matches):
        raise RuntimeError(f"{' '.join(command[:2])}: no time of a step")
    return sum(float(match[1]) for match in matches if match) / n_copies


def bare_loop(limit: Path, n_copies: int, elements: int, mass: str, periods: int) -> float:
    """Return the time of a step of copies of the bare loop, from runs of two lengths [ns]."""
    spent = []
    lengths = (periods // 4, periods)
    for length in lengths:
        flags = [f"n={elements}", f"per={length}", "f=3.25", "k=100", *MASSES[mass]]
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        copies = [
            subprocess.Popen([str(limit), *flags], stdout=subprocess.DEVNULL)
            for _ in range(n_copies)
        ]
        for copy in copies:
            copy.wait()
        spent.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before)
    n_steps = n_copies * (lengths[1] - lengths[0]) * STEPS_PER_PERIOD
    return 1e9 * (spent[1] - spent[0]) / n_steps


def bare_plane(limit: Path, n_periods: int) -> float:
    """Return the time of bare loops at the contact numbers of the plane, two at a time [s].

    It follows from runs of two lengths, without the set-up of the loops.
    """
    sweep = df.load_sweep(EXAMPLES / "plane.toml")
    points = range(0, sweep.n_points, EVERY)
    lengths = (n_periods // 4, n_periods)
    spent = []
    for length in lengths:
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        for first, second in zip(points[::2], points[1::2], strict=True):
            copies = []
            for index in (first, second):
                contact = sweep.case(index).contact
                flags = [f"e={contact.restitution}", f"k={contact.penalty_stiffness}", "f=3.25"]
                command = [str(limit), "n=20", f"per={length}", *flags, *MASSES["consistent"]]
                copies.append(subprocess.Popen(command, stdout=subprocess.DEVNULL))
            for copy in copies:
                copy.wait()
        spent.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before)
    return EVERY * (spent[1] - spent[0]) * n_periods / (lengths[1] - lengths[0])


def singles(limit: Path, now: Checkout, short: bool) -> Table:
    """Return the table of single runs beside the bare loop."""
    columns = ("elements", "mass", "copies", "bare loop [ns]", "compiled [ns]", "ratio")
    table = Table(*columns, title="a step of one run")
    repeats = 1 if short else 2
    for elements in SIZES[: 2 if short else None]:
        for mass in MASSES:
            periods = max((12_000 if short else 60_000) // elements, 12) // 4 * 4
            for n_copies in (1, 2):
                of_run = min(
                    now.nanoseconds(n_copies, SLOPE, elements, mass, periods // 4, periods, 2)
                    for _ in range(repeats)
                )
                words = ("–", "–")
                if elements <= LARGEST:
                    bare = min(
                        bare_loop(limit, n_copies, elements, mass, periods) for _ in range(repeats)
                    )
                    words = (f"{bare:.0f}", f"{of_run / bare:.2f}")
                table.add_row(
                    str(elements), mass, str(n_copies), words[0], f"{of_run:.0f}", words[1]
                )
    return table


def sweep_file(folder: Path, kind: str, count: int) -> Path:
    """Write a plane or a basin of count × count points to a file; return its place."""
    first, low, high, second, least, most = KEYS[kind]
    text = f'''base = "paper"
[set]
excitation.frequency = {FREQUENCIES[kind]}
[[axis]]
key = "{first}"
start = {low}
stop = {high}
count = {count}
[[axis]]
key = "{second}"
start = {least}
stop = {most}
count = {count}
[record]
strobes = 128
'''
    file = folder / f"{kind}_{count}.toml"
    file.write_text(text)
    return file


def many(limit: Path, checkouts: dict[str, Checkout], folder: Path, short: bool) -> Table:
    """Return the table of sweeps and of the closed delamination."""
    table = Table("what", "unit", *checkouts, "now / before", title="many runs")
    repeats = 1 if short else 2
    few, many_cells, simulations, n_periods = (4, 6, 30, 20) if short else (4, 12, 150, 200)
    # of each: two sizes, whose difference is without the start, and a program
    planes = {count: (SWEEP, sweep_file(folder, "plane", count), 1) for count in (10, 30)}
    basins = {
        count: (SWEEP, sweep_file(folder, "basin", count), 600) for count in (few, many_cells)
    }
    tables = {count: (SIMULATIONS, count) for count in (10, simulations)}
    parts: dict[str, dict[int, tuple[object, ...]]] = {
        "plane, a point with a single period": {n**2: run for n, run in planes.items()},
        "basin, a point of 600 periods": {n**2: run for n, run in basins.items()},
        "table of infer, a simulation": tables,
    }
    of_plane = dict.fromkeys(checkouts, float("inf"))
    for _ in range(repeats):
        for name, checkout in checkouts.items():
            seconds = checkout.seconds(SWEEP, EXAMPLES / "plane.toml", n_periods)
            of_plane[name] = min(of_plane[name], seconds)
    add(table, f"plane, 20 × 20 points, {n_periods} periods, with its start", "s", of_plane)
    start = {
        name: min(checkout.seconds(SWEEP, sweep_file(folder, "plane", 2), 1) for _ in range(2))
        for name, checkout in checkouts.items()
    }
    add(table, "its start: three processes, 2 × 2 points of a single period", "s", start)
    for what, runs in parts.items():
        (small, small_run), (large, large_run) = runs.items()
        times = dict.fromkeys(checkouts, float("inf"))
        for _ in range(repeats):
            for name, checkout in checkouts.items():
                spent = checkout.seconds(*large_run) - checkout.seconds(*small_run)
                times[name] = min(times[name], 1e3 * spent / (large - small))
        add(table, what, "ms", times)
    closed = {
        name: checkout.nanoseconds(1, CLOSED, 5 if short else 20) / 1e3
        for name, checkout in checkouts.items()
    }
    add(table, "closed delamination, 80 elements, a step", "µs", closed)
    n_steps = 400 * n_periods * STEPS_PER_PERIOD
    bare = bare_loop(limit, 2, 20, "consistent", 50 * n_periods)
    blank = [""] * (len(checkouts) - 1)
    seconds = f"{n_steps * bare / 1e9:.2f}"
    table.add_row("two bare loops with the steps of the plane", "s", *blank, seconds)
    seconds = f"{bare_plane(limit, n_periods):.2f}"
    table.add_row("the same at the contact numbers of the plane", "s", *blank, seconds)
    return table


def add(table: Table, what: str, unit: str, times: dict[str, float]) -> None:
    """Add a row of times, and the ratio of the last to the first."""
    ratio = f"{times['now'] / times['before']:.2f}" if "before" in times else ""
    table.add_row(what, unit, *(f"{time:.2f}" for time in times.values()), ratio)


def main() -> None:
    """Measure everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--limit", type=Path, required=True, help="source of the bare loop")
    parser.add_argument("--before", type=Path, help="another checkout of the package")
    parser.add_argument("--short", action="store_true", help="fewer sizes, periods and points")
    options = parser.parse_args()
    console = Console(width=120)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        before = {"before": Checkout(options.before.resolve(), folder)} if options.before else {}
        checkouts = before | {"now": Checkout(ROOT, folder)}
        limit = folder / "limit"
        flags = ["-O3", "-march=native", "-ffp-contract=fast"]
        subprocess.run(["g++", *flags, "-o", str(limit), str(options.limit)], check=True)
        for checkout in checkouts.values():  # compiles where that has not been done
            checkout.nanoseconds(1, SLOPE, 4, "lumped", 1, 2, 1)
        console.print(many(limit, checkouts, folder, options.short))
        console.print(singles(limit, checkouts["now"], options.short))


if __name__ == "__main__":
    main()

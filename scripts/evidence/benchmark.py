"""Measure the cost of a time step for all engines, schemes and mesh sizes in one run.

    .venv/bin/python scripts/evidence/benchmark.py [--short] [--limit PROGRAM] [-o docs/evidence]

All numbers come from one run on one machine, so that their ratios are meaningful. Each time is the
fastest of several repeats, because machines are noisy. The script prints tables; with -o it also
writes performance.json, performance.md and figures/performance.png to that folder.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numba
import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI
from petsc4py import PETSc
from rich.console import Console
from rich.table import Table

import delam_fem as df
from delam_fem.api import N_SIZES, EngineName, assemble, session_of
from delam_fem.engines.petsc import linear_algebra
from delam_fem.model.operators import matrix
from delam_fem.reference.loop import simulate_reference

COMM = PETSc.COMM_SELF
SCHEMES: dict[str, dict[str, Any]] = {
    "newton-penalty, lumped mass and impulses": {"time.mass": "lumped"},
    "newton-penalty, consistent mass and impulses": {"contact.impulse": "consistent"},
    "newton@moreau-jean": {"contact.law": "newton@moreau-jean"},
    "no contact, lumped mass": {"contact.law": "none", "time.mass": "lumped"},
}
BASELINE = "newton-penalty, lumped mass and impulses"
_STIFF = {"damping.rayleigh": "stiffness"}
LIMITED: list[tuple[str, int, str, str, dict[str, Any]]] = [
    *(("paper, lumped", n, "lumped", "paper", _STIFF | {"time.mass": "lumped"})
      for n in (20, 50, 200)),
    *(("paper, consistent", n, "consistent", "paper", _STIFF | {"contact.impulse": "consistent"})
      for n in (20, 50, 200)),
    ("default, by step taken", 20, "consistent", "default", {}),
    ("paper, refined 16 times, by step taken", 20, "consistent", "paper", {"time.refine": 16}),
]  # fmt: skip
"""Rows beside a bare loop: name, elements, mass of that loop, preset, settings."""
SIZES = (5, 20, 50, 200, 500, 1000, 2000)
LASTING = (20, 40, 80)
"""Numbers of elements of the preset `embedded`."""
COUPLED_UP_TO = 200
"""Largest number of elements with consistent impulses between two steps; beyond it, simultaneous
impacts of hundreds of pairs would take all the time."""
PLANE = Path(__file__).parents[2] / "docs" / "examples" / "plane.toml"
POINTS = (1, 2, 4, 8)
"""Numbers of contact points per element."""
REFINED = (
    ("4000 equal: error 3.0 %", 4000, 1, 0.0),
    ("64000 equal: 0.5 %", 64000, 1, 0.0),
    ("1000, refined 64 times: 0.5 %", 1000, 64, 0.0),
    ("1000, refined 64 times above 20 mm/s (default): 0.6 %", 1000, 64, 0.02),
    ("256000 equal: the limit", 256000, 1, 0.0),
    ("2000, refined 64 times: below 0.1 %", 2000, 64, 0.0),
)
"""Steps of the section on refined steps: name, N, r, refine_velocity [m/s]."""
REPEATS = 3
"""Number of repeats of measurements that take seconds; the fastest counts."""
PLAIN_UP_TO = 50
"""Largest number of elements for which the plain loop is measured."""


def fastest(
    action: Callable[[], object],
    repeats: int,
    per_call: int = 1,
    clock: Callable[[], float] = time.thread_time,
) -> float:
    """Return the shortest time of a call [µs]; each measurement makes `per_call` calls."""
    times = []
    for _ in range(repeats):
        begin = clock()
        for _ in range(per_call):
            action()
        times.append((clock() - begin) / per_call)
    return 1e6 * min(times)


def bare_operations(case: df.Case, repeats: int) -> float:
    """Return the time of one MatSolve and two MatMult with the matrices of a case [µs]."""
    o = assemble(case, needs_dolfinx=False).operators
    dt = case.time_step
    rows = o.mass + dt / 2 * o.damping + dt**2 / 4 * o.stiffness
    A = linear_algebra.PetscFactor(matrix(rows, COMM), "benchmark_")
    C = matrix(o.damping, COMM)
    K = matrix(o.stiffness, COMM)
    x, y = K.createVecs()
    x.set(1.0)

    def operations() -> None:
        K.mult(x, y)
        C.mult(x, y)
        A.solve(x, y)

    return fastest(operations, repeats, max(20, 200_000 // o.n_dofs))


def case_of(elements: int, periods: int, **settings: Any) -> df.Case:
    """Return the preset `paper` with a number of elements and of periods, without fields."""
    keys: dict[str, Any] = {"mesh.elements": elements, "time.periods": periods}
    keys |= {"output.window_periods": 1, "output.fields_per_period": 0}
    return df.preset("paper", keys | settings)


def step(case: df.Case, repeats: int, engine: EngineName) -> float:
    """Return the time of a step with its record, after loading and set-up [µs]."""
    operators = assemble(case, needs_dolfinx=False).operators
    times = []
    for _ in range(repeats):
        with session_of(case, operators, engine=engine, comm=MPI.COMM_SELF) as opened:
            begin = time.thread_time()
            outcome = opened.run()
            times.append(time.thread_time() - begin)
        if outcome != "completed":
            raise RuntimeError(f"{case.name} with {case.mesh.elements} elements {outcome}")
    return 1e6 * min(times) / (case.n_periods * case.time.steps_per_period)


def slope(
    elements: int, repeats: int, settings: dict[str, Any], preset: str, engine: EngineName
) -> float:
    """Return the time of a step from runs of two lengths [µs]; fewer by PETSc."""
    shortest = max(20, 20_000 // elements) if engine == "compiled" else max(5, 400 // elements)
    lengths = [shortest * factor for factor in (1, 3)]
    keys = {"mesh.elements": elements, "output.fields_per_period": 0, **settings}
    seconds = []
    steps = []
    for periods in lengths:
        case = df.preset(preset, keys | {"time.periods": periods})
        operators = assemble(case, needs_dolfinx=False).operators
        times = []
        for _ in range(repeats):
            with session_of(case, operators, engine=engine, comm=MPI.COMM_SELF) as opened:
                begin = time.thread_time()
                opened.run()
                times.append(time.thread_time() - begin)
                taken = opened.recorder.effort[:, :N_SIZES].sum()
        seconds.append(min(times))
        steps.append(int(taken))
    return 1e6 * (seconds[1] - seconds[0]) / (steps[1] - steps[0])


def beside_limit(limit: Path, repeats: int) -> list[dict[str, Any]]:
    """Return the times of a step of both engines beside those of a bare loop in C++ [µs].

    Args:
        limit: program that computes `paper` in steps of T/1000; it takes f=, per=, n=, lump= and
            imass=.
        repeats: number of repeats; the fastest counts.
    """
    rows = []
    for name, elements, mass, preset, settings in LIMITED:
        flags = ["lump=1", "imass=0"] if mass == "lumped" else ["lump=0", "imass=1"]
        command = [str(limit), "f=3.25", f"per={30_000 // elements}", f"n={elements}", *flags]
        bare = []
        for _ in range(repeats):
            before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
            subprocess.run(command, capture_output=True, check=True)
            spent = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
            bare.append(1e6 * spent / (30_000 // elements * 1000))
        row = {"name": name, "elements": elements, "limit": min(bare)}
        for engine in ("compiled", "petsc"):
            row[engine] = slope(elements, repeats, settings, preset, engine)
        rows.append(row)
    return rows


def plain_loop(case: df.Case, repeats: int) -> float:
    """Return the time of a step in the plain NumPy and SciPy loop of the reference [µs]."""
    model = assemble(case, needs_dolfinx=False)
    steps = case.n_periods * case.time.steps_per_period
    loop = fastest(
        lambda: simulate_reference(model.operators, case, periods=case.n_periods), repeats
    )
    return loop / steps


def _one_run(periods: int) -> int:
    """Compute some periods in a worker; return the number of steps."""
    case = case_of(20, periods, **SCHEMES[BASELINE])
    operators = assemble(case, needs_dolfinx=False).operators
    with session_of(case, operators) as opened:
        opened.run()
    return periods * case.time.steps_per_period


def lasting_contact(n: int, repeats: int) -> dict[str, Any]:
    """Return the times of a step of the preset `embedded` with n elements [µs].

    Contact fills half of the time there, at nearly all pairs at once. "paper" is the preset `paper`
    with as many elements and the same law.
    """
    keys = {"mesh.elements": n, "output.window_periods": 1, "output.fields_per_period": 0}
    case = df.preset("embedded", keys | {"time.periods": 10})
    paper = case_of(n, 5, **SCHEMES["newton@moreau-jean"])
    operators = assemble(case, needs_dolfinx=False).operators
    return {
        "elements": n,
        "dofs": operators.n_dofs,
        "pairs": operators.n_pairs,
        "petsc": step(case.with_overrides({"time.periods": 4}), repeats, "petsc"),
        "compiled": step(case, 5 * repeats, "compiled"),
        "paper": step(paper, 5 * repeats, "compiled"),
    }


def contact_points(repeats: int, periods: int) -> list[dict[str, Any]]:
    """Return the times of a step of 20 elements with contact points inside them [µs]."""
    keys = {"contact.law": "newton@moreau-jean", "time.steps_per_period": 4000}
    rows = []
    for p in POINTS:
        case = case_of(20, periods, **keys, **{"contact.points_per_element": p})
        nodes = case_of(20 * p, periods, **keys)
        times = [step(one, repeats, "compiled") for one in (case, nodes)]
        rows.append({"per_element": p, "points": times[0], "nodes": times[1]})
    return rows


def near_contact(repeats: int, periods: int) -> list[dict[str, Any]]:
    """Return the times of a period with equal small steps and with refined steps [ms]."""
    rows = []
    for name, steps, refine, velocity in REFINED:
        keys = {"time.steps_per_period": steps, "time.refine": refine}
        case = df.preset(
            "default",
            {**keys, "time.refine_velocity": velocity, "damping.rayleigh": "stiffness",
             "time.periods": periods, "output.window_periods": 1, "output.fields_per_period": 0},
        )  # fmt: skip
        microseconds = step(case, repeats, "compiled")
        rows.append({"name": name, "ms": 1e-3 * microseconds * steps})
    return rows


def throughput(workers: int, periods: int) -> float:
    """Return steps per second of several processes, each with its own runs [1/s]."""
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        list(pool.map(_one_run, [2] * workers))  # this loads the compiled code
        rates = []
        for _ in range(REPEATS):
            begin = time.perf_counter()
            steps = sum(pool.map(_one_run, [periods] * (4 * workers)))
            rates.append(steps / (time.perf_counter() - begin))
        return max(rates)


@numba.njit(cache=True, fastmath=True)
def _arithmetic(values, rounds):  # type: ignore[no-untyped-def]
    """Do arithmetic that keeps the vector units of a core busy."""
    for _ in range(rounds):
        for i in range(values.size):
            values[i] = 0.999 * values[i] + 0.001
    return values[0]


def _spin(rounds: int) -> float:
    return float(_arithmetic(np.ones(1024), rounds))


def machine_scaling(workers: int, rounds: int) -> float:
    """Return the speed-up by several processes that share nothing but the machine [-].

    Two processors may be threads of one core; then dense arithmetic gains nothing from the second.
    """
    times = []
    for n in (1, workers):
        with ProcessPoolExecutor(n, mp_context=get_context("spawn")) as pool:
            list(pool.map(_spin, [1] * n))
            times.append(
                fastest(
                    lambda n=n, pool=pool: list(pool.map(_spin, [rounds] * n)),
                    REPEATS,
                    clock=time.perf_counter,
                )
            )
    return workers * times[0] / times[1]


PLANE_RUN = """
import sys, tempfile, time
import delam_fem as df
file, workers, periods = sys.argv[1:]
sweep = df.load_sweep(file, {"time.periods": int(periods)})
with tempfile.TemporaryDirectory() as folder:
    begin = time.perf_counter()
    data = df.run_sweep(sweep, folder, workers=int(workers))
    print(time.perf_counter() - begin, data.attrs["outcome"])
    data.close()
"""
"""A sweep in a process of its own, whose workers import nothing for the script that started it."""


def plane_seconds(workers: int, periods: int) -> float:
    """Return the time of the sweep for the paper's Fig. 15 with 20 × 20 points [s]."""
    command = [sys.executable, "-c", PLANE_RUN, str(PLANE), str(workers), str(periods)]
    process = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds, outcome = process.stdout.split()
    if outcome != "completed":
        raise RuntimeError(f"sweep of {PLANE}: {outcome}")
    return float(seconds)


FIRST_STEPS = """
from delam_fem import preset, run
from delam_fem.api import assemble
case = preset("default", {"time.periods": 1})
run(case, "compiled", structure=assemble(case, needs_dolfinx=False))
"""
"""Program of a first run: imports, loading of compiled code, one period."""


def start_seconds() -> float:
    """Return the time of a first period in a new process [s]."""

    def start() -> None:
        subprocess.run([sys.executable, "-c", FIRST_STEPS], check=True)

    start()  # this fills the cache
    return fastest(start, REPEATS, clock=time.perf_counter) / 1e6


PEAK = """
import sys
from pathlib import Path
from delam_fem import preset, run
elements, engine = int(sys.argv[1]), sys.argv[2]
keys = {"mesh.elements": elements, "time.periods": 2, "output.fields_per_period": 0}
run(preset("paper", keys), engine)
lines = Path("/proc/self/status").read_text().splitlines()
print(next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")))
"""
"""Program of a run of which the memory counts: ru_maxrss would hold that of the parent, too."""


def peak_memory(elements: Sequence[int]) -> list[dict[str, float]]:
    """Return the peak memory of a process with a run, by number of elements and engine [MB]."""
    rows = []
    for n in elements:
        row: dict[str, float] = {"elements": n}
        for engine in ("petsc", "compiled"):
            command = [sys.executable, "-c", PEAK, str(n), engine]
            row[engine] = float(subprocess.run(command, capture_output=True, check=True).stdout)
        rows.append(row)
    return rows


def memory_growth(periods: tuple[int, int]) -> float:
    """Return the growth of the peak memory from a short to a long run [MB]."""
    peaks = []
    for n in periods:
        df.run(case_of(20, n))
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return peaks[1] - peaks[0]


def measure(short: bool, limit: Path | None = None) -> dict[str, Any]:
    """Measure everything and return the numbers; for `limit` see `beside_limit`."""
    repeats = 2 if short else 4
    load = os.getloadavg()[0]
    rows = []
    for n in (5, 20, 50) if short else SIZES:
        periods = 2 if short else max(4, min(40, 2000 // n))
        row: dict[str, Any] = {"elements": n, "dofs": 4 * n}
        row["bare"] = bare_operations(case_of(n, 1), repeats)
        for name, settings in SCHEMES.items():
            if "consistent" in settings.values() and n > COUPLED_UP_TO:
                continue
            case = case_of(n, periods, **settings)
            row[name] = {engine: step(case, repeats, engine) for engine in ("petsc", "compiled")}
        if n <= PLAIN_UP_TO:
            row["plain"] = plain_loop(case_of(n, 1, **SCHEMES[BASELINE]), 1)
        rows.append(row)
    spans = (3, 6) if short else (20, 200)
    cores = os.cpu_count() or 1
    workers = sorted({1, cores})
    return {
        "rows": rows,
        "limit": [] if limit is None else beside_limit(limit, repeats),
        "embedded": [lasting_contact(n, repeats) for n in ((20,) if short else LASTING)],
        "points": contact_points(repeats, 2 if short else 40),
        "refined": near_contact(2, 2 if short else 40),
        "throughput": {str(n): throughput(n, 20 if short else 300) for n in workers},
        "plane": {str(n): plane_seconds(n, 3 if short else 200) for n in workers},
        "start": start_seconds(),
        "machine_scaling": machine_scaling(cores, 1000 if short else 4_000_000),
        "memory_growth_mb": memory_growth(spans),
        "memory": peak_memory((5,) if short else (20, 200, 2000)),
        "periods": spans,
        "load": load,
        "cores": cores,
    }


ON_PAGE = (BASELINE, "newton@moreau-jean")
"""Schemes whose tables are on the page; performance.json has all."""
ELEMENTS_ON_PAGE = ("20", "200", "2000")
"""Meshes in these tables; the figure has all."""
HEADINGS = (
    *("elements", "dofs", "MatSolve + 2 MatMult", "plain loop", "PETSc", "PETSc / bare"),
    *("compiled", "PETSc / compiled"),
)


def cells(row: dict[str, Any], scheme: str) -> list[str]:
    """Return the cells of a table row: times [µs] and ratios for a mesh and a scheme."""
    by_petsc, by_compiled = row[scheme]["petsc"], row[scheme]["compiled"]
    plain = f"{row['plain']:.0f}" if scheme == BASELINE and "plain" in row else "–"
    return [
        str(row["elements"]),
        str(row["dofs"]),
        f"{row['bare']:.2f}",
        plain,
        f"{by_petsc:.2f}",
        f"{by_petsc / row['bare']:.1f}",
        f"{by_compiled:.3f}",
        f"{by_petsc / by_compiled:.0f}",
    ]


def tables(figures: dict[str, Any]) -> dict[str, list[list[str]]]:
    """Return the rows of the table of each scheme by name."""
    return {name: [cells(row, name) for row in figures["rows"] if name in row] for name in SCHEMES}


def closing_lines(figures: dict[str, Any]) -> list[str]:
    """Return the lines below the tables."""
    short, long = figures["periods"]
    lines = [
        f"{workers} process(es): {rate / 1e6:.2f} million steps/s"
        for workers, rate in figures["throughput"].items()
    ]
    runs, planes = (list(figures[name].values()) for name in ("throughput", "plane"))
    lines += [
        f"sweep of 20 × 20 points by {workers} process(es): {seconds:.1f} s"
        for workers, seconds in figures["plane"].items()
    ]
    possible = figures["machine_scaling"]
    lines.append(
        f"gain by all processes: {runs[-1] / runs[0]:.2f} in steps/s, {planes[0] / planes[-1]:.2f} "
        f"in the sweep; a loop of nothing but arithmetic gains {possible:.2f} here"
    )
    lines.append(f"a first period in a new process, imports included: {figures['start']:.1f} s")
    small, *_, large = (row for row in figures["rows"] if row["elements"] >= 20)
    for engine in ("petsc", "compiled"):
        costs = (
            f"{1e3 * row[BASELINE][engine] / row['dofs']:.1f} ns with {row['elements']}"
            for row in (small, large)
        )
        lines.append(f"{engine}, time of a step by dof: {', '.join(costs)} elements")
    last = figures["memory"][-1]
    lines.append(
        f"peak memory of a process with {last['elements']} elements, imports included: "
        f"PETSc {last['petsc']:.0f} MB, compiled {last['compiled']:.0f} MB"
    )
    growth = figures["memory_growth_mb"]
    return [*lines, f"peak memory from {short} to {long} periods: {growth:+.1f} MB"]


def _rows_of(lines: Sequence[Sequence[str]]) -> str:
    """Return a table as text, its headings and the line below them included."""
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def limit_section(rows: list[dict[str, Any]]) -> str:
    """Return the section on a bare loop."""
    lines = [("", "elements", "bare loop", "compiled", "ratio", "PETSc", "ratio"), ("---",) * 7]
    for row in rows:
        bare, ours, by_petsc = row["limit"], row["compiled"], row["petsc"]
        times = f"{bare:.3f}", f"{ours:.3f}", f"{ours / bare:.2f}"
        petsc = f"{by_petsc:.1f}", f"{by_petsc / bare:.0f}"
        lines.append((row["name"], str(row["elements"]), *times, *petsc))
    return (
        "## Beside a bare loop in C++\n\n"
        "The bare loop computes the preset `paper` (Newmark) without ledger, record and probes, "
        "which both engines have. Times are slopes between two lengths of run.\n\n"
        + _rows_of(lines)
    )


def embedded_section(rows: list[dict[str, Any]]) -> str:
    """Return the section on contact that lasts."""
    headings = (
        *("elements", "dofs", "pairs", "PETSc", "compiled", "PETSc / compiled"),
        *("paper's laminae, compiled", "embedded / paper"),
    )
    lines = [headings, ("---",) * len(headings)]
    for row in rows:
        by_petsc, by_compiled, paper = row["petsc"], row["compiled"], row["paper"]
        counts = (str(row[key]) for key in ("elements", "dofs", "pairs"))
        times = (f"{by_petsc:.2f}", f"{by_compiled:.2f}", f"{by_petsc / by_compiled:.0f}")
        lines.append((*counts, *times, f"{paper:.2f}", f"{by_compiled / paper:.1f}"))
    return (
        "## A closed delamination that claps\n\n"
        "The preset `embedded` at its first opening frequency, newton@moreau-jean, 500 steps per "
        "period: contact fills half of the time, at nearly all pairs at once. Beside it, the "
        "preset `paper` with as many elements and the same law. The rows of the gap matrix are "
        "full in modes; contact reads them three times a step, an open delamination once.\n\n"
        + _rows_of(lines)
    )


def points_section(rows: list[dict[str, Any]]) -> str:
    """Return the section on contact points inside the elements."""
    headings = (
        *("points per element", "20 elements", "ratio to 1 point"),
        *("as many nodes instead", "nodes / points"),
    )
    lines = [headings, ("---",) * len(headings)]
    for row in rows:
        points, nodes = row["points"], row["nodes"]
        ratios = f"{points / rows[0]['points']:.2f}", f"{nodes / points:.1f}"
        lines.append(
            (str(row["per_element"]), f"{points:.3f}", ratios[0], f"{nodes:.3f}", ratios[1])
        )
    return (
        "## Contact points inside the elements\n\n"
        "Compiled, newton@moreau-jean, 4000 steps per period.\n\n" + _rows_of(lines)
    )


def plates_section(plates: dict[str, Any]) -> str:
    """Return the section on plates, whose numbers `plate_cost.py` measures."""
    steps = [
        ("dofs", "scheme", "two solves", "product with M", "step", "ratio", "before", "ratio"),
        ("---",) * 8,
    ]
    for row in plates["steps"]:
        step = row["step"]
        before, bare = row["before"]
        steps.append(
            (
                *(str(row["dofs"]), row["scheme"], f"{row['solves']:.1f}", f"{row['M']:.1f}"),
                *(f"{step:.1f}", f"{step / row['solves and M']:.2f}"),
                *(f"{before:.1f}", f"{before / bare:.2f}"),
            )
        )
    pairs = [
        ("pairs", "coordinates", "assembly", "reduction", "compiled", "PETSc"),
        ("---",) * 6,
    ]
    for row in plates["pairs"]:
        cells = [f"{row[name]:.0f}" for name in ("pairs", "coordinates", "assembly", "reduction")]
        for engine in ("compiled", "petsc"):
            laws = "newton", "none"
            times = (row[f"{engine} {law}@moreau-jean"] for law in laws)
            cells.append(" / ".join(f"{time:.1f}" for time in times))
        pairs.append(tuple(cells))
    parts = (
        "## Plates\n",
        "`scripts/evidence/plate_cost.py` measures a plate of 200 × 150 × 2 mm with a patch that "
        "is closed at rest. Steps without contact on the full mesh, in ms, beside the triangular "
        "solves and the product with M that each needs (*ratio*: over both together, in turns); "
        "*before*: with the product with K, which now follows from the solution. The machine was "
        "full, which makes the solves two to four times as long; with less beside it the first "
        "row took 3.9 ms, before 13.8 ms, its solves 2.7 ms:\n",
        _rows_of(steps),
        "Dampers of supports, impactors and schemes other than average acceleration and "
        "`moreau-jean` still make the product with K.\n",
        "Reduced to 60 modes (about 40,000 dofs; assembly and reduction in s), µs per step that "
        "claps / without contact:\n",
        _rows_of(pairs),
        "A step of a reduced plate reads pairs × coordinates numbers, three times in contact. "
        "Of 400 pairs about 50 are closed at once; their impulses take 0.2 ms in PETSc, whether "
        "the search begins with those of the last step or not, and the bound of round-off 0.6 "
        "ms.\n",
    )
    return "\n".join(parts)


def refined_section(rows: list[dict[str, Any]]) -> str:
    """Return the section on steps refined near contact."""
    lines = [("steps per period", "ms per period", "ratio to 4000 equal steps"), ("---",) * 3]
    for row in rows:
        lines.append((row["name"], f"{row['ms']:.2f}", f"{row['ms'] / rows[0]['ms']:.2f}"))
    return (
        "## Steps refined near contact\n\n"
        "Compiled, newton@moreau-jean, 20 elements, 3.25 Hz, stiffness damping, 40 periods from "
        "rest. Errors against the rigid limit of the mesh are those of "
        "[convergence.md](convergence.md).\n\n" + _rows_of(lines)
    )


def markdown(figures: dict[str, Any]) -> str:
    """Return the text of docs/evidence/performance.md."""
    parts = [
        "# Performance\n",
        "For those who ask how long a step takes. [Solids](solids.md#cost) have a table of their "
        "own.\n",
        "`scripts/evidence/benchmark.py -o docs/evidence` writes this page; `--limit PROGRAM` adds "
        "the table beside a bare loop. Times are in µs per step of processor time, the fastest of "
        "several repeats, at 1000 steps per period and 3.25 Hz from rest, with ledger and record. "
        f"When the run began, {figures['load']:.1f} other processes were at work on the machine's "
        f"{figures['cores']} cores: where that is not nearly 0, times are too long, and steps/s "
        "and sweeps say little.\n",
        "*MatSolve + 2 MatMult* is what PETSc needs for the bare linear algebra of a step, *plain "
        "loop* is `delam_fem/reference/loop.py`, and *PETSc / bare* is the time of PETSc's steps "
        "over that of its linear algebra.\n",
        "![Cost of a step](figures/performance.png)\n",
    ]
    parts += [limit_section(figures["limit"])] if figures["limit"] else []
    for name, rows in tables(figures).items():
        if name not in ON_PAGE:
            continue
        parts.append(f"## {name}\n")
        on_page = [row for row in rows if row[0] in ELEMENTS_ON_PAGE]
        lines = [HEADINGS, ("---",) * len(HEADINGS), *on_page]
        parts.append(_rows_of(lines))
    parts.append(embedded_section(figures["embedded"]))
    parts.append(points_section(figures["points"]))
    parts.append(refined_section(figures["refined"]))
    if "plates" in figures:
        parts.append(plates_section(figures["plates"]))
    parts.append("## Cores and memory\n")
    parts.append("\n".join(f"- {line}" for line in closing_lines(figures)) + "\n")
    return "\n".join(parts)


def figure(figures: dict[str, Any]) -> Figure:
    """Draw the time of a step over the number of dofs, log–log."""
    result = Figure(figsize=(9.0, 4.8), layout="constrained")
    axes = result.add_subplot(
        xscale="log", yscale="log", xlabel="degrees of freedom [–]", ylabel="time of a step [µs]"
    )
    rows = figures["rows"]
    dofs = [row["dofs"] for row in rows]
    axes.plot(dofs, [row["bare"] for row in rows], "k:", label="MatSolve + 2 MatMult")
    plain = [row for row in rows if "plain" in row]
    axes.plot([r["dofs"] for r in plain], [r["plain"] for r in plain], "ks-", label="plain loop")
    for name, colour in zip(SCHEMES, ("#0072B2", "#D55E00", "#E69F00", "#CC79A7"), strict=True):
        engine_rows = [row for row in rows if name in row]
        x = [row["dofs"] for row in engine_rows]
        for engine, line in (("petsc", "o-"), ("compiled", "^--")):
            y = [row[name][engine] for row in engine_rows]
            axes.plot(x, y, line, color=colour, label=f"{engine}: {name}")
    axes.grid(alpha=0.3)
    result.legend(loc="outside right center", fontsize=8)
    return result


def write(figures: dict[str, Any], folder: Path) -> None:
    """Write the numbers, the page and the figure to a folder."""
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    numbers = folder / "performance.json"
    if numbers.exists():  # those of plates stay
        before = json.loads(numbers.read_text("utf-8"))
        figures = figures | {name: before[name] for name in ("plates",) if name in before}
    numbers.write_text(json.dumps(figures, indent=2) + "\n")
    (folder / "performance.md").write_text(markdown(figures), encoding="utf-8")
    figure(figures).savefig(folder / "figures" / "performance.png", dpi=110)


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measure, print the tables, and write the files if a folder is given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="small meshes, few repeats")
    parser.add_argument("-o", "--output", type=Path, help="folder for numbers, page and figure")
    parser.add_argument("--limit", type=Path, help="compiled bare loop to measure beside")
    options = parser.parse_args(arguments)
    figures = measure(options.short, options.limit)
    console = Console(width=120)
    for name, rows in tables(figures).items():
        table = Table(*HEADINGS, title=f"{name}: µs per step")
        for row in rows:
            table.add_row(*row)
        console.print(table)
    console.print("\n".join(closing_lines(figures)))
    if options.output is not None:
        write(figures, options.output)
    return figures


if __name__ == "__main__":
    main(sys.argv[1:])

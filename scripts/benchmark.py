"""Measure what a step costs, all in one run, so that the ratios mean something.

    .venv/bin/python scripts/benchmark.py [--short] [-o docs]

Machines are noisy: each figure is the fastest of several runs. Prints a table; with -o also writes
performance.json there.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from petsc4py import PETSc
from rich.console import Console
from rich.table import Table

import delam_fem as df
from delam_fem import petsc, reference
from delam_fem.engines import petsc_engine
from delam_fem.run import motion_of, recorder_of
from delam_fem.simulate import simulate

COMM = PETSc.COMM_SELF


def fastest(action: Callable[[], object], repeats: int, per_call: int = 1) -> float:
    """Return the least time of a call [µs], each measurement being `per_call` calls."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        for _ in range(per_call):
            action()
        times.append((time.perf_counter() - begin) / per_call)
    return 1e6 * min(times)


def bare_operations(case: df.Case, repeats: int) -> float:
    """Return the time of one MatSolve and two MatMult of the matrices of a case [µs]."""
    o = reference.assemble(case).operators
    dt = case.time_step
    A = petsc.Factor(o.mass + dt / 2 * o.damping + dt**2 / 4 * o.stiffness, COMM, "benchmark_")
    C, K = petsc.matrix(o.damping, COMM), petsc.matrix(o.stiffness, COMM)
    x, y = K.createVecs()
    x.set(1.0)
    calls = max(20, 200_000 // o.n_dofs)

    def operations() -> None:
        K.mult(x, y)
        C.mult(x, y)
        A.solve(x, y)

    return fastest(operations, repeats, calls)


def step(case: df.Case, repeats: int, engine: str = "petsc") -> float:
    """Return the time of a step with all that a run does in it [µs]."""
    operators = reference.assemble(case).operators
    times = []
    for _ in range(repeats):
        computing = make_engine(engine, case, operators)
        recorder, motion = recorder_of(case, operators), motion_of(case)
        computing.start(None, motion(0)[0])
        begin = time.perf_counter()
        outcome = simulate(computing, recorder, motion)
        times.append(time.perf_counter() - begin)
        computing.destroy()
        if outcome != "completed":
            raise RuntimeError(f"{case.name} with {case.mesh.elements} elements {outcome}")
    return 1e6 * min(times) / (case.n_periods * case.time.steps_per_period)


def make_engine(name: str, case: df.Case, operators: Any) -> Any:
    """Return an engine by its name."""
    if name == "petsc":
        from mpi4py import MPI

        return petsc_engine(case, operators, MPI.COMM_SELF)
    raise ValueError(name)


def case_of(elements: int, periods: int, **settings: Any) -> df.Case:
    """Return the preset at 3.25 Hz on a mesh; fine meshes need a scheme that loses energy."""
    keys: dict[str, Any] = {"mesh.elements": elements, "time.periods": periods}
    keys |= {"output.window_periods": 1, "output.fields_per_period": 0}
    if elements > 50:
        keys["time.mass"] = "lumped"
    return df.preset("paper", keys | settings)


def memory_growth(periods: tuple[int, int]) -> float:
    """Return by how much the peak memory grows from a short to a long run [MB]."""
    peaks = []
    for n in periods:
        df.run(case_of(20, n))
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return peaks[1] - peaks[0]


def measure(short: bool) -> dict[str, Any]:
    """Return all figures."""
    repeats = 2 if short else 5
    sizes = (5, 20, 50) if short else (5, 20, 50, 200, 500, 1000, 2000)
    rows = []
    for n in sizes:
        periods = max(1, min(40, 2000 // n)) if not short else 3
        case = case_of(n, periods)
        bare = bare_operations(case, repeats)
        times = {"with contact": step(case, repeats)}
        times["without contact"] = step(case.with_overrides({"contact.law": "none"}), repeats)
        rows.append({"elements": n, "dofs": 4 * n, "bare": bare, **times})
    spans = (3, 6) if short else (20, 200)
    return {"rows": rows, "memory_growth_mb": memory_growth(spans), "periods": spans}


def table(figures: dict[str, Any]) -> Table:
    """Return the figures as a table."""
    headings = ("elements", "dofs", "MatSolve + 2 MatMult", "step", "step with contact", "ratio",
                "ns per dof")  # fmt: skip
    result = Table(*headings, title="PETSc engine, µs")
    for row in figures["rows"]:
        ratio = row["with contact"] / row["bare"]
        result.add_row(
            str(row["elements"]),
            str(row["dofs"]),
            f"{row['bare']:.2f}",
            f"{row['without contact']:.2f}",
            f"{row['with contact']:.2f}",
            f"{ratio:.1f}",
            f"{1e3 * row['with contact'] / row['dofs']:.0f}",
        )
    return result


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="small meshes, few repeats")
    parser.add_argument("-o", "--output", type=Path, help="folder for performance.json")
    given = parser.parse_args(arguments)
    figures = measure(given.short)
    console = Console()
    console.print(table(figures))
    short, long = figures["periods"]
    growth = figures["memory_growth_mb"]
    console.print(f"peak memory from {short} to {long} periods: {growth:+.1f} MB")
    if given.output is not None:
        given.output.mkdir(parents=True, exist_ok=True)
        (given.output / "performance.json").write_text(json.dumps(figures, indent=2) + "\n")
    return figures


if __name__ == "__main__":
    main(sys.argv[1:])

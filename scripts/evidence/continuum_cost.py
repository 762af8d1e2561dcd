"""Measure what a step of laminae as solids costs, against the number of dofs and of ranks.

    .venv/bin/python scripts/evidence/continuum_cost.py [--short] [-o docs/evidence]

Each measurement is a process (or several, by mpirun) of its own, so that its memory is known. Times
are those of the processor, because machines are shared; beside runs on several ranks stands the
time of the clock. With -o the script writes continuum_cost.json and figures/continuum_cost.png.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

PLANE = tuple(round(10**power / 24) for power in (3.0, 3.58, 4.0, 4.5, 5.0, 5.5, 6.0))
"""Elements along the laminae of the preset "paper" in plane stress; 24 dofs each."""
SOLID = ((3, 4), (9, 4), (31, 4), (97, 4), (309, 4), (617, 4))
"""Elements along the laminae and strips across them, in 3D; 36 (2 strips + 1) dofs each."""
SHARED = (617, 4)
"""The case that several ranks share."""
RANKS = (1, 2, 3)
STEPS_PER_PERIOD = 4000
LEAST_SECONDS, TURN_SECONDS, TURNS = 2.0, 0.003, 40
"""Time for which steps are repeated, and of one of the turns, of which the best counts [s]."""
MOST_STEPS = 2000


def measured(kind: str, elements: int, strips: int) -> dict[str, Any]:
    """Measure one structure on all ranks of this process's launcher (collective)."""
    from delam_fem.api import MPI, Operators, assemble, motion_of, preset
    from delam_fem.engines.petsc import linear_algebra
    from delam_fem.engines.petsc.theta import MoreauJean
    from delam_fem.model.operators import spread

    comm = MPI.COMM_WORLD
    keys = {"model.kind": kind, "model.strips": strips, "mesh.elements": elements}
    keys |= {"contact.law": "newton@moreau-jean", "contact.impulse": "consistent"}
    case = preset("paper", keys | {"time.steps_per_period": STEPS_PER_PERIOD})
    clock = Clock()
    operators = assemble(case, comm=comm).operators
    assembly, _ = clock.turn()
    o = spread(operators, comm) if isinstance(operators, Operators) else operators
    dt = case.time_step
    matrices = [linear_algebra.block(m, o.is_uncoupled) for m in (o.mass, o.damping, o.stiffness)]
    total = matrices[0].copy()
    total.axpy(dt / 2, matrices[1])
    total.axpy(dt**2 / 4, matrices[2])
    clock.turn()
    factor = linear_algebra.PetscFactor(total, "moreau_")
    factorisation, _ = clock.turn()
    factor.destroy()
    stepper = MoreauJean(operators, dt, comm=comm)
    stepper.begin(motion_of(case)(0)[: MOST_STEPS + 1])
    steps, (step, wall) = repeated(clock, comm, lambda: (stepper.advance(), stepper.finish_step()))
    solving = stepper._now.A.solve
    load, answer = stepper._residual, stepper._response
    _, (solve, _) = repeated(clock, comm, lambda: solving(load, answer))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "kind": kind,
        "elements": elements,
        "strips": strips,
        "ranks": comm.size,
        "dofs": o.n_dofs,
        "pairs": o.n_pairs,
        "is_uncoupled": o.is_uncoupled,
        "assembly_s": assembly,
        "factorisation_s": factorisation,
        "step_ms": 1e3 * step,
        "step_wall_ms": 1e3 * wall,
        "solve_ms": 1e3 * solve,
        "steps": steps,
        "peak_mb": comm.allgather(round(peak)),
        "load": os.getloadavg()[0],
    }


class Clock:
    """A stop watch of the processor and of the wall."""

    def __init__(self) -> None:
        """Start."""
        self._start = time.process_time(), time.perf_counter()

    def turn(self) -> tuple[float, float]:
        """Return the times of the processor and of the wall since the last call [s]."""
        now = time.process_time(), time.perf_counter()
        processor = now[0] - self._start[0]
        wall = now[1] - self._start[1]
        self._start = now
        return processor, wall


def repeated(clock: Clock, comm: Any, action: Any) -> tuple[int, tuple[float, float]]:
    """Repeat an action in short turns; return the repeats and the times of the best turn."""
    clock.turn()
    action()
    first = max(comm.allgather(clock.turn()[1]))
    n = max(1, min(MOST_STEPS // (2 * TURNS), round(TURN_SECONDS / max(first, 1e-9))))
    turns = max(3, min(TURNS, round(LEAST_SECONDS / (n * first))))
    best = (np.inf, np.inf)
    for _ in range(turns):
        clock.turn()
        for _ in range(n):
            action()
        processor, wall = clock.turn()
        best = min(best[0], processor / n), min(best[1], wall / n)
    return n * turns, best


def of_process(kind: str, elements: int, strips: int, ranks: int) -> dict[str, Any]:
    """Return what a new process (or several) measures."""
    command = [sys.executable, __file__, "--one", kind, str(elements), str(strips)]
    if ranks > 1:
        mpirun = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", str(ranks)]
        command = [*mpirun, *command]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
    line = next(line for line in done.stdout.splitlines() if '"dofs"' in line)
    row: dict[str, Any] = json.loads(line[line.index("{") :])
    tell(row)
    return row


def tell(row: dict[str, Any]) -> None:
    """Print a measurement."""
    print(
        f"{row['kind']:12} {row['dofs']:8} dofs, {row['ranks']} rank(s): "
        f"step {row['step_ms']:.3g} ms ({row['step_wall_ms']:.3g} by the clock), solve "
        f"{row['solve_ms']:.3g} ms, factorisation {row['factorisation_s']:.3g} s, "
        f"{row['peak_mb']} MB, load {row['load']:.1f}",
        flush=True,
    )


def table(rows: list[dict[str, Any]]) -> str:
    """Return the measurements as a table for a page."""
    lines = [
        "| model | dofs | pairs | ranks | step [ms] | by the clock [ms] | share of the solve "
        "| factorisation [s] | peak of each rank [MB] |",
        "|" + "---|" * 9,
    ]
    for row in rows:
        peak = ", ".join(str(mb) for mb in row["peak_mb"])
        lines.append(
            f"| {row['kind']} | {row['dofs']} | {row['pairs']} | {row['ranks']} "
            f"| {row['step_ms']:.3g} | {row['step_wall_ms']:.3g} "
            f"| {100 * row['solve_ms'] / row['step_ms']:.0f} % | {row['factorisation_s']:.2g} "
            f"| {peak} |"
        )
    return "\n".join(lines)


def figure(rows: list[dict[str, Any]]) -> Figure:
    """Draw the times of a step, of its solve and of the factorisation over the number of dofs."""
    result = Figure(figsize=(7.5, 4.6), layout="constrained")
    axes = result.add_subplot(
        xscale="log", yscale="log", xlabel="degrees of freedom [–]", ylabel="time [ms]"
    )
    for kind, colour in (("plane-stress", "#0072B2"), ("solid", "#D55E00")):
        kind_rows = [row for row in rows if row["kind"] == kind and row["ranks"] == 1]
        dofs = [row["dofs"] for row in kind_rows]
        for name, factor, line, words in (
            ("factorisation_s", 1e3, "^:", "factorisation"),
            ("step_ms", 1.0, "o-", "step"),
            ("solve_ms", 1.0, "s--", "its solve"),
        ):
            values = [factor * row[name] for row in kind_rows]
            axes.plot(dofs, values, line, color=colour, ms=5, label=f"{kind}: {words}")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return result


def main(arguments: list[str] | None = None) -> list[dict[str, Any]]:
    """Measure, print, and write the files if a folder is given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="small meshes only")
    parser.add_argument("--one", nargs=3, metavar=("KIND", "ELEMENTS", "STRIPS"))
    parser.add_argument("-o", "--output", type=Path, help="folder for numbers and figure")
    options = parser.parse_args(arguments)
    if options.one:
        from delam_fem.api import MPI

        row = measured(options.one[0], int(options.one[1]), int(options.one[2]))
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(row))
        return [row]
    plane, solid, shared = ((4,), ((2, 1),), (2, 1)) if options.short else (PLANE, SOLID, SHARED)
    ranks = RANKS[1 : 2 if options.short else None]
    todo: list[tuple[str, int, int, int]] = [("plane-stress", elements, 1, 1) for elements in plane]
    todo += [("solid", *mesh, 1) for mesh in solid] + [("solid", *shared, n) for n in ranks]
    rows = []
    for one in todo:
        try:
            rows.append(of_process(*one))
        except RuntimeError as error:  # the machine has too little memory
            print(error, flush=True)
    print(table(rows))
    if options.output is not None:
        (options.output / "figures").mkdir(parents=True, exist_ok=True)
        numbers = json.dumps(rows, indent=2) + "\n"
        (options.output / "continuum_cost.json").write_text(numbers, encoding="utf-8")
        figure(rows).savefig(options.output / "figures" / "continuum_cost.png", dpi=110)
    return rows


if __name__ == "__main__":
    main(sys.argv[1:])

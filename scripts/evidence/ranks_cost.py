"""Measure what `modes`, `reduce`, the first step and a step of solids take on one and two ranks.

    .venv/bin/python scripts/evidence/ranks_cost.py --two-ranks     # by the clock, a quiet machine
    .venv/bin/python scripts/evidence/ranks_cost.py [--most DOFS] [-o docs/evidence]

Each measurement is a process (or two, by mpirun) of its own, so that its memory is known. Seconds
are those of the processor of each rank, because machines are shared; ranks that wait for each other
inside a solution count as busy. Beside them stands the time of the clock. With -o the script writes
ranks_cost.json after each measurement and goes on where that file ends. --two-ranks measures the
smallest meshes and ends after `LIMIT` seconds with what it has.
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

FOLDER = "ranks_cost.json"
BODIES: dict[str, dict[str, Any]] = {
    "plate": {"length": 0.4, "width": 0.02, "thickness": (0.0014, 0.0006), "apart": (0.18, 0.22)},
    "block": {"length": 0.1, "width": 0.05, "thickness": (0.025, 0.025), "apart": (0.04, 0.06)},
}
"""Sizes of two bonded laminae, and where they are apart along x [m]."""
MESHES: dict[str, tuple[tuple[int, int, int], ...]] = {
    "plate": ((58, 20, 1), (100, 31, 1), (210, 60, 1)),
    "block": ((25, 10, 5), (38, 14, 7), (50, 20, 10)),
}
"""Cells along x, across the width, and through each lamina."""
JOBS = ("modes", "reduce", "steps")
N_MODES = 10
LIMIT = 350.0
"""Time after which --two-ranks ends [s]."""
STEPS = 20
SHORT = 8
"""Cells along x with --short, for the tests."""


def case_of(body: str, mesh: tuple[int, int, int]) -> Any:
    """Return a body, clamped at both ends, on a mesh."""
    from delam_fem.api import preset

    sizes = BODIES[body]
    elements, strips, layers = mesh
    keys: dict[str, Any] = {
        "model.kind": "solid",
        "mesh.elements": elements,
        "model.strips": strips,
        "model.layers": layers,
        "delamination.1.start": sizes["apart"][0],
        "delamination.1.end": sizes["apart"][1],
    }
    for number, thickness in enumerate(sizes["thickness"], start=1):
        keys |= {
            f"lamina.{number}.length": sizes["length"],
            f"lamina.{number}.width": sizes["width"],
            f"lamina.{number}.thickness": thickness,
        }
    return preset("embedded", keys)


def measured(body: str, mesh: tuple[int, int, int], job: str) -> dict[str, Any]:
    """Do one job on all ranks of this process's launcher, and measure it (collective)."""
    from delam_fem.api import MPI, blas
    from delam_fem.model.sharing import shared

    comm = MPI.COMM_WORLD
    case = case_of(body, mesh)
    parts: dict[str, float] = {}
    begin = time.process_time(), time.perf_counter()
    if job == "steps":
        parts = stepped(case, comm)
    else:
        parts = shared(comm, lambda: of_modes(case) if job == "modes" else of_reduction(case)) or {}
    seconds = time.process_time() - begin[0]
    wall = time.perf_counter() - begin[1]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "body": body,
        "mesh": mesh,
        "job": job,
        "ranks": comm.size,
        **comm.bcast(parts),
        "cpu_s": comm.gather(round(seconds, 2)),
        "wall_s": round(wall, 2),
        "peak_mb": comm.gather(round(peak)),
        "load": os.getloadavg()[0],
        "blas": blas(),
    }


def of_modes(case: Any) -> dict[str, float]:
    """Compute the lowest modes, free and closed, as the command `modes` does."""
    from delam_fem import modes

    natural = modes(case, N_MODES)
    return {"first_hz": float(natural.frequencies[0])}


def of_reduction(case: Any) -> dict[str, float]:
    """Reduce a body, as the command `reduce` does."""
    from delam_fem.api import reduced_case

    reduction = reduced_case(case, N_MODES)
    o = reduction.full.operators
    return {
        "dofs": o.n_dofs,
        "pairs": o.n_pairs,
        "coordinates": int(reduction.basis.squares.size),
        "first_hz": float(reduction.frequencies[0, 0]),
    }


def stepped(case: Any, comm: Any) -> dict[str, float]:
    """Set a run up and compute steps without contact; return processor times of the first rank."""
    from delam_fem.api import assemble, motion_of
    from delam_fem.engines.petsc.theta import MoreauJean

    start = time.process_time()
    o = assemble(case, comm=comm).operators
    assembled = time.process_time()
    stepper = MoreauJean(o, case.time_step, comm=comm)
    stepper.begin(motion_of(case)(0)[: STEPS + 2])
    stepper.advance()
    stepper.finish_step()
    first = time.process_time()
    wall = time.perf_counter()
    for _ in range(STEPS):
        stepper.advance()
        stepper.finish_step()
    return {
        "dofs": o.n_dofs,
        "pairs": o.n_pairs,
        "assembly_s": round(assembled - start, 2),
        "first_step_s": round(first - assembled, 2),
        "step_ms": round(1e3 * (time.process_time() - first) / STEPS, 2),
        "step_wall_ms": round(1e3 * (time.perf_counter() - wall) / STEPS, 2),
    }


def bytes_per_dof(case: Any) -> dict[str, float]:
    """Return the memory of a body for each dof: of matrices, and of what every rank has whole."""
    from delam_fem.api import assemble

    structure = assemble(case)
    o, body = structure.operators, structure.body
    assert body is not None

    def size(*arrays: Any) -> float:
        return round(sum(array.nbytes for array in arrays) / o.n_dofs, 1)

    mesh = [value for value in vars(body.mesh).values() if hasattr(value, "nbytes")]
    return {
        "dofs": o.n_dofs,
        **{
            name: size(A.data, A.indices, A.indptr)
            for name, A in (("M", o.mass), ("C", o.damping), ("K", o.stiffness))
        },
        "mesh": size(*mesh),
        "numbers of nodes": 2.0 * size(body.solid.place),  # places and references
        "motion of the base": size(body.base),
        "rows of free dofs": size(body.free.indptr),
    }


def of_processes(
    body: str, mesh: tuple[int, int, int], job: str, ranks: int, seconds: float | None = None
) -> dict[str, Any]:
    """Return what a new process, or several, measure.

    Raises:
        subprocess.TimeoutExpired: they take longer than some seconds.
    """
    command = [sys.executable, __file__, "--one", body, job, *map(str, mesh)]
    if ranks > 1:
        mpirun = ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", str(ranks)]
        command = [*mpirun, *command]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=environment, **pipes) as process:
        try:
            output, errors = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            process.terminate()  # mpirun ends its processes
            raise
    lines = [line for line in output.splitlines() if '"peak_mb"' in line]
    if process.returncode or not lines:
        raise RuntimeError(f"{' '.join(command)}: {errors}")
    row: dict[str, Any] = json.loads(lines[0][lines[0].index("{") :])
    print(line_of(row), flush=True)
    return row


HEADING = f"{'body':6} {'mesh':14} {'job':7} ranks  cpu of each rank [s]  clock [s]  peak [MB]"


def line_of(row: dict[str, Any]) -> str:
    """Return a measurement as a line of the table below `HEADING`."""
    mesh = " x ".join(map(str, row["mesh"]))
    seconds = ", ".join(f"{value:.1f}" for value in row["cpu_s"])
    peaks = ", ".join(map(str, row["peak_mb"]))
    beside = f"  load {row['load']:.0f}"
    if row["job"] == "steps":
        beside += (
            f"; assembly {row['assembly_s']:.1f} s, first step {row['first_step_s']:.1f} s, step "
            f"{row['step_ms']:.1f} ms ({row['step_wall_ms']:.1f} by the clock)"
        )
    return (
        f"{row['body']:6} {mesh:14} {row['job']:7} {row['ranks']:5}  {seconds:20}  "
        f"{row['wall_s']:9.1f}  {peaks}{beside}"
    )


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--one", nargs=5, metavar=("BODY", "JOB", "CELLS", "STRIPS", "LAYERS"))
    parser.add_argument("--two-ranks", action="store_true", help="smallest meshes, 1 and 2 ranks")
    parser.add_argument("--bytes", action="store_true", help="memory for each dof of the plate")
    parser.add_argument("--short", action="store_true", help="tiny meshes")
    parser.add_argument("--only", nargs="*", default=[], metavar="BODY/NUMBER/JOB/RANKS")
    parser.add_argument("-o", dest="folder", type=Path)
    arguments = parser.parse_args()
    if arguments.one:
        body, job, *numbers = arguments.one
        cells, strips, layers = map(int, numbers)
        row = measured(body, (cells, strips, layers), job)
        from delam_fem.api import MPI

        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(row), flush=True)
        return
    if arguments.bytes:
        mesh = (SHORT, 2, 1) if arguments.short else MESHES["plate"][0]
        print(json.dumps(bytes_per_dof(case_of("plate", mesh)), indent=1))
        return
    plan = [
        (body, number, job, ranks)
        for number in range(1 if arguments.two_ranks or arguments.short else 3)
        for body in BODIES
        for job in JOBS
        for ranks in (1, 2)
    ]
    path = None if arguments.folder is None else arguments.folder / FOLDER
    rows = json.loads(path.read_text()) if path is not None and path.exists() else []
    there = {(row["body"], tuple(row["mesh"]), row["job"], row["ranks"]) for row in rows}
    print(HEADING, flush=True)
    end = time.perf_counter() + LIMIT if arguments.two_ranks else None
    for body, number, job, ranks in plan:
        mesh = (SHORT, 2, 1) if arguments.short else MESHES[body][number]
        is_asked = not arguments.only or f"{body}/{number}/{job}/{ranks}" in arguments.only
        if not is_asked or (body, mesh, job, ranks) in there:
            continue
        left = None if end is None else max(end - time.perf_counter(), 0.0)
        try:
            rows.append(of_processes(body, mesh, job, ranks, left))
        except subprocess.TimeoutExpired:
            print(f"{body} {job} on {ranks}: not measured within {LIMIT:g} s", flush=True)
            break
        if path is not None:
            path.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()

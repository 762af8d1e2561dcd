"""Measure what a step of a plate costs: on its full mesh beside its solves, and over its pairs.

    .venv/bin/python scripts/evidence/plate_cost.py [--before CHECKOUT] [--short] [-o docs/evidence]

All figures are processor times. Steps on the full mesh are without contact, beside the two
triangular solves and the product with M that each of them needs; with --before also those of
another checkout. Steps over the number of pairs are with contact that opens and closes. With -o the
table of plates in performance.json and performance.md is written anew. About 5 minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

CELLS = ((16, 14), (32, 28))
"""Cells along x and across of the full meshes."""
PATCHES = {
    50: (0.028, 0.026),
    100: (0.0365, 0.034),
    200: (0.055, 0.05),
    400: (0.092, 0.069),
}
"""Half sizes of patches [m] that have about so many pairs on a mesh of 26 x 24 cells."""
MODES = 60
LAYERS = {"lower": 0.0014, "upper": 0.0006}
STEPS = 400
REPEATS, SECONDS = 4, 6.0
"""Calls in a turn, and the time for which turns are repeated [s]."""
LENGTHS = {"compiled": (4, 24), "petsc": (2, 6)}
"""Periods of two runs, whose difference has no set-up in it."""


def plate(cells: tuple[int, int], half: tuple[float, float] = (0.03, 0.02), **sections: Any) -> Any:
    """Return the case of a plate of 200 x 150 x 2 mm with a patch in the middle."""
    from delam_fem.api import Case

    lamina = [
        {
            "name": name, "length": 0.2, "width": 0.15, "thickness": thickness, "density": 2700.0,
            "young_modulus": 70e9, "damping_ratio": 0.005,
        }
        for name, thickness in LAYERS.items()
    ]  # fmt: skip
    x, z = half
    data = {
        "name": "plate",
        "lamina": lamina,
        "model": {"kind": "solid", "poisson": 0.33},
        "mesh": {"elements": cells[0], "across": cells[1]},
        "support": [{"side": side, "kind": "clamped"} for side in ("start", "end")],
        "delamination": [
            {"between": list(LAYERS), "start": 0.1 - x, "end": 0.1 + x, "across": [-z, z]}
        ],
        "excitation": {
            "kind": "force", "lamina": "lower", "position": 0.06, "amplitude": 10.0,
            "frequency": 700.0,
        },
        "contact": {"law": "newton@moreau-jean", "restitution": 0.3},
        "time": {"steps_per_period": STEPS, "periods": 1},
        "output": {"window_periods": 1, "fields_per_period": 0},
    }  # fmt: skip
    return Case.checked(data | sections, "plate")


def stepped(cells: tuple[int, int], scheme: str) -> dict[str, Any]:
    """Measure steps without contact on the full mesh, their solves and their products with M."""
    from delam_fem.api import assemble, motion_of
    from delam_fem.engines.petsc.newmark import Newmark
    from delam_fem.engines.petsc.theta import MoreauJean

    case = plate(cells)
    o = assemble(case).operators
    stepper: Any
    if scheme == "newmark":
        stepper = Newmark(o, case.time_step, coupled_impulses=True)
    else:
        stepper = MoreauJean(o, case.time_step)
    base_states = motion_of(case)(0)
    stepper.begin(base_states)

    def step() -> None:
        if stepper._step == STEPS:
            stepper.begin(base_states)
        stepper.advance()
        stepper.finish_step()

    load, answer, image = stepper._residual, stepper._response, stepper._load

    def linear_algebra() -> None:
        stepper._now.A.solve(load, answer)
        stepper._M.mult(answer, image)

    of_step, of_algebra, of_solves, of_M, of_K = fastest(
        step,
        linear_algebra,
        lambda: stepper._now.A.solve(load, answer),
        lambda: stepper._M.mult(answer, image),
        lambda: stepper._K.mult(answer, image),
    )
    if getattr(stepper, "_products", None) is not None:  # the shortest turns renew nothing
        of_step += 2.0 * (of_K + of_M) / 64
    stepper.destroy()
    return {
        "dofs": o.n_dofs, "scheme": scheme, "step": of_step, "solves": of_solves,
        "solves and M": of_algebra, "M": of_M, "K": of_K,
    }  # fmt: skip


def fastest(*actions: Callable[[], None]) -> list[float]:
    """Return the shortest times of actions, whose turns alternate [ms]."""
    best = [np.inf] * len(actions)
    end = time.process_time() + SECONDS
    while time.process_time() < end:
        for k, action in enumerate(actions):
            begin = time.process_time()
            for _ in range(REPEATS):
                action()
            best[k] = min(best[k], 1e3 * (time.process_time() - begin) / REPEATS)
    return best


def over_pairs(half: tuple[float, float], cells: tuple[int, int], modes: int) -> dict[str, Any]:
    """Measure a plate with a patch: assembly, reduction, and steps of both engines."""
    import delam_fem as df
    from delam_fem.api import assemble

    case = plate(cells, half)
    begin = time.process_time()
    full = assemble(case)
    assembled = time.process_time()
    reduction = df.reduced_case(case, modes, full=full)
    reduced = time.process_time()
    o = reduction.structure.operators
    result: dict[str, Any] = {
        "pairs": o.n_pairs,
        "coordinates": o.n_dofs,
        "dofs": full.operators.n_dofs,
        "assembly": assembled - begin,
        "reduction": reduced - assembled,
    }
    for engine, lengths in LENGTHS.items():
        for law in ("newton@moreau-jean", "none@moreau-jean"):
            spent = []
            for periods in (1, *lengths):  # the first one prepares
                run = case.with_overrides({"time.periods": periods, "contact.law": law})
                begin = time.process_time()
                df.run(run, structure=reduction.structure, engine=engine)
                spent.append(time.process_time() - begin)
            of_step = (spent[2] - spent[1]) / (STEPS * (lengths[1] - lengths[0]))
            result[f"{engine} {law}"] = 1e6 * of_step
    return result


def of_process(checkout: Path | None, *words: object) -> dict[str, Any]:
    """Return what a new process measures, with the package of another checkout if one is given."""
    command = [sys.executable, __file__, "--one", *map(str, words)]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    if checkout is not None:
        environment["PYTHONPATH"] = str(checkout.resolve())
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    print(row, flush=True)
    return row


def measure_steps(short: bool, before: Path | None) -> list[dict[str, Any]]:
    """Measure steps on full meshes, each row in a process of its own."""
    steps = []
    for cells in ((6, 6),) if short else CELLS:
        for scheme in ("moreau-jean", "newmark"):
            row = of_process(None, "step", *cells, scheme)
            if before is not None:
                other = of_process(before, "step", *cells, scheme)
                row["before"] = [other["step"], other["solves and M"]]
            steps.append(row)
    return steps


def measure_pairs(short: bool) -> list[dict[str, Any]]:
    """Measure plates over their pairs, each in a process of its own."""
    cells, modes = ((8, 8), 6) if short else ((26, 24), MODES)
    patches = [PATCHES[50]] if short else PATCHES.values()
    return [of_process(None, "pairs", *half, *cells, modes) for half in patches]


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    """Measure, print, and write numbers and page if a folder is given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--one", nargs="+", metavar="WORD")
    parser.add_argument("--before", type=Path, help="another checkout of the package")
    parser.add_argument("--part", choices=("steps", "pairs"), help="one of the two tables")
    parser.add_argument("--short", action="store_true", help="small meshes")
    parser.add_argument("-o", "--output", type=Path, help="folder of performance.json")
    options = parser.parse_args(arguments)
    if options.one:
        kind, first, second, *others = options.one
        if kind == "step":
            row = stepped((int(first), int(second)), others[0])
        else:
            along, across, modes = map(int, others)
            row = over_pairs((float(first), float(second)), (along, across), modes)
        print(json.dumps(row))
        return row
    plates: dict[str, Any] = {}
    if options.part != "pairs":
        plates["steps"] = measure_steps(options.short, options.before)
    if options.part != "steps":
        plates["pairs"] = measure_pairs(options.short)
    if options.output is not None:
        import benchmark

        path = options.output / "performance.json"
        figures = json.loads(path.read_text("utf-8"))
        figures["plates"] = figures.get("plates", {}) | plates
        path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
        page = options.output / "performance.md"
        page.write_text(benchmark.markdown(figures), encoding="utf-8")
    return plates


if __name__ == "__main__":
    main(sys.argv[1:])

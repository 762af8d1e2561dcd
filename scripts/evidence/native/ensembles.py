"""Run eight points of a sweep side by side in the lanes of one register, and one by one.

    .venv/bin/python scripts/evidence/native/ensembles.py [--short]

A trial on the kernel of laminae.c (ensemble.c), for processors with AVX-512. The points are those
of docs/examples/plane.toml: 20 restitutions times 20 stiffnesses of the contact, which share
operators and time step. Printed are the processor time of a step and of the plane as a whole, and
what differs.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trial
from rich.console import Console
from rich.table import Table

import delam_fem as df
from delam_fem.api import FloatArray, Operators, Recorder, assemble, session_of
from delam_fem.engines.compiled import engine as compiled
from delam_fem.engines.compiled.state import N_EVENTS, N_HITS
from delam_fem.studies.sweeps.point import PointRunner

PLANE = Path(__file__).parents[3] / "docs" / "examples" / "plane.toml"
SOURCE = Path(__file__).with_name("ensemble.c")
RUNS = 8
SIGNATURE = (
    "int64_t run_ensemble(int64_t *, int64_t *, int64_t, int64_t, double *, int64_t *);\n"
    f"{trial.SIGNATURE}"
)
FREE: dict[str, dict[str, Any]] = {
    "no contact, consistent mass": {"contact.law": "none"},
    "no contact, lumped mass": {"contact.law": "none", "time.mass": "lumped"},
}


class Sitting(NamedTuple):
    """What was measured of some points.

    Attributes:
        seconds: of the steps, compiled, in C one by one, in lanes with shared coefficients, in
            lanes with coefficients of their own, shape (4,) [s].
        alone: share of the steps that runs of an ensemble make alone [-].
        difference: largest of tips at the ends of the first 10 periods, relative [-].
    """

    seconds: FloatArray
    alone: float
    difference: float


def one_by_one(
    cases: Sequence[df.Case], operators: Sequence[Operators], native: trial.Native | None
) -> tuple[float, list[Recorder]]:
    """Return processor time of the steps [s] and what runs record, one after the other."""
    seconds = 0.0
    recorders = []
    for case, one in zip(cases, operators, strict=True):
        with session_of(case, one) as opened:
            if native is not None:
                opened.engine._run = native
            begin = time.thread_time()
            opened.run()
            seconds += time.thread_time() - begin
            recorders.append(opened.recorder)
    return seconds, recorders


def side_by_side(
    module: Any, cases: Sequence[df.Case], operators: Sequence[Operators]
) -> tuple[float, list[Recorder], int]:
    """Return the same of an ensemble, and how many steps its runs made alone.

    Raises:
        RuntimeError: a run did not complete.
    """
    with ExitStack() as stack:
        opened = [
            stack.enter_context(session_of(case, one))
            for case, one in zip(cases, operators, strict=True)
        ]
        n = opened[0].recorder.n_periods
        begin = time.thread_time()
        blocks = []
        for one in opened:
            engine = one.engine
            block = engine._block(one.recorder, n)
            block.base_states = np.ascontiguousarray(one.motion(0))
            places = [table.ctypes.data for table in compiled.in_tables(block.base_states)]
            engine._table[compiled._OF_BLOCK] = [block.n_slots, *places, *block.addresses]
            engine.memory.counts[[N_EVENTS, N_HITS]] = 0
            blocks.append(block)
        raw = np.zeros(220 * opened[0].engine.system.size + 1024)
        work = raw[(-raw.ctypes.data % 64) // 8 :]
        problems = np.array([one.engine.address for one in opened])
        logs = np.array([one.engine._address for one in opened])
        n_alone = module.ffi.new("int64_t[1]")
        tables = [module.ffi.cast("int64_t *", table.ctypes.data) for table in (problems, logs)]
        place = module.ffi.cast("double *", work.ctypes.data)
        ending = module.lib.run_ensemble(*tables, 0, n, place, n_alone)
        if ending:
            raise RuntimeError(f"the ensemble ended with {ending}")
        for one, block in zip(opened, blocks, strict=True):
            block.end(n, one.engine._events, one.recorder)
            one.recorder.take(block)
        seconds = time.thread_time() - begin
        return seconds, [one.recorder for one in opened], int(n_alone[0])


def measured(
    modules: Sequence[Any], cases: Sequence[df.Case], operators: Sequence[Operators], repeats: int
) -> Sitting:
    """Return what eight points take, the least of some repeats, all kernels in turn."""
    native = trial.Native(modules[0])
    least = np.full(4, np.inf)
    for _ in range(repeats):
        t_compiled, _ = one_by_one(cases, operators, None)
        t_c, alone = one_by_one(cases, operators, native)
        t_shared, together, n_alone = side_by_side(modules[0], cases, operators)
        t_own, _, _ = side_by_side(modules[1], cases, operators)
        least = np.minimum(least, [t_compiled, t_c, t_shared, t_own])
    tips = np.array([[r.strobe[:10, 0] for r in recorders] for recorders in (alone, together)])
    n_steps = RUNS * alone[0].n_periods * alone[0].steps_per_period
    difference = float(np.abs(tips[1] - tips[0]).max() / np.abs(tips[0]).max())
    return Sitting(least, n_alone / n_steps, difference)


def main() -> None:
    """Print the time of steps without contact, and of the plane."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="fewer periods, points and repeats")
    short = parser.parse_args().short
    console = Console(width=100)
    periods = 20 if short else 200
    compiled.EVENTS, compiled.HITS = 1 << 15, 1 << 18
    trial.SIGNATURE = SIGNATURE
    trial.SOURCE = SOURCE
    include = f"-I{SOURCE.parent}"
    plain = list(trial.FLAGS)
    modules = []
    with tempfile.TemporaryDirectory() as name:
        for flags in ([include], [include, "-DOWN"]):
            trial.FLAGS = [*plain, *flags]
            modules.append(trial.built(Path(name)))
    table = Table("steps", "compiled", "C", "lanes", "lanes, own steps", "alone", title="[ns]")

    def add(name: str, sitting: Sitting, n_steps: int) -> None:
        numbers = [f"{1e9 * value / n_steps:.0f}" for value in sitting.seconds]
        table.add_row(name, *numbers, f"{sitting.alone:.1%}")

    for name, settings in FREE.items():
        keys = trial.COMMON | settings | {"time.periods": 60}
        cases = [df.preset("paper", keys)] * RUNS
        operators = [assemble(cases[0], needs_dolfinx=False).operators] * RUNS
        sitting = measured(modules, cases, operators, 2 if short else 5)
        add(name, sitting, RUNS * 60 * cases[0].time.steps_per_period)
    sweep = df.load_sweep(PLANE, {"time.periods": periods})
    runner = PointRunner(sweep)
    firsts = range(0, sweep.n_points, 160 if short else 40)
    sittings = []
    for first in firsts:
        cases = [
            sweep.case(index).with_overrides({"output.fields_per_period": 0})
            for index in range(first, first + RUNS)
        ]
        operators = [runner.structure(case).operators for case in cases]
        sittings.append(measured(modules, cases, operators, 1 if short else 2))
    n = len(sittings) * RUNS
    seconds = np.sum([sitting.seconds for sitting in sittings], axis=0)
    shares = float(np.mean([sitting.alone for sitting in sittings]))
    worst = max(sitting.difference for sitting in sittings)
    n_steps = n * periods * sweep.base.time.steps_per_period
    add("the plane", Sitting(seconds, shares, worst), n_steps)
    console.print(table)
    begin = time.thread_time()
    for first in firsts:
        for index in range(first, first + RUNS):
            runner.point(index, None)
    of_points = time.thread_time() - begin
    lanes = of_points - seconds[0] + seconds[2]
    console.print(
        f"a point of the plane: {1e3 * of_points / n:.1f} ms, in lanes {1e3 * lanes / n:.1f} ms "
        f"({lanes / of_points - 1.0:+.0%}); tips within 10 periods differ by {worst:.1e}"
    )


if __name__ == "__main__":
    main()

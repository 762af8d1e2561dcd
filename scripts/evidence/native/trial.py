"""Run the two laminae by a C kernel beside the compiled engine.

    .venv/bin/python scripts/evidence/native/trial.py [--short]

The kernel (laminae.c) reads the tables of the compiled engine and takes the place of its
`run_plain`. What differs is printed, the time of a step, and what the first use costs. All figures
come from one sitting; both kernels take turns, and the fastest counts.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
import time
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from mpi4py import MPI
from numba import types
from rich.console import Console
from rich.table import Table

import delam_fem as df
from delam_fem.api import FloatArray, Recorder, assemble, session_of
from delam_fem.engines.compiled.engine import Compiled
from delam_fem.engines.compiled.matrices import Problem
from delam_fem.engines.compiled.state import PeriodBuffers, View

SOURCE = Path(__file__).with_name("laminae.c")
FLAGS = [
    "-O3",
    "-march=native",
    "-ffp-contract=fast",
    "-mprefer-vector-width=256",
    "-fno-math-errno",
    "-Wno-psabi",
]
SIGNATURE = "int64_t run_block(int64_t, int64_t, int64_t, int64_t *, int64_t);"
_NAMES = {types.int64: "int64_t", types.float64: "double", types.boolean: "int64_t"}
_OF_ARRAYS = {"int64": "int64_t", "float64": "double", "uint8": "uint8_t", "int8": "int8_t"}
COMMON = {
    "output.window_periods": 1,
    "output.fields_per_period": 0,
    "damping.rayleigh": "stiffness",
}
LAWS: dict[str, dict[str, Any]] = {
    "newton, lumped": {"contact.law": "newton", "time.mass": "lumped"},
    "newton, consistent": {"contact.law": "newton", "contact.impulse": "consistent"},
    "newton-penalty, lumped": {"contact.law": "newton-penalty", "time.mass": "lumped"},
    "newton-penalty, consistent": {
        "contact.law": "newton-penalty",
        "contact.impulse": "consistent",
    },
    "penalty": {"contact.law": "penalty"},
    "newton, moreau-jean": {"contact.law": "newton", "time.scheme": "moreau-jean"},
    "none": {"contact.law": "none"},
}


def structs(kind: type) -> str:
    """Return the C structs of a class of named tuples and of those within it."""
    texts: dict[str, str] = {}

    def add(view: View) -> str:
        name = view.name.removesuffix(")").rpartition(".")[2]
        lines = []
        for member, (_, of) in view.members.items():
            if isinstance(of, View):
                lines.append(f"    {add(of)} {member};")
            elif isinstance(of, types.CPointer):
                lines.append(f"    {_OF_ARRAYS[of.dtype.name]} *{member};")
            else:
                lines.append(f"    {_NAMES[of]} {member};")
        texts.setdefault(name, "typedef struct {\n" + "\n".join(lines) + f"\n}} {name};\n")
        return name

    add(View(kind))
    return "".join(texts.values())


def header() -> str:
    """Return the text of tables.h."""
    return structs(Problem) + structs(PeriodBuffers) + SIGNATURE


def built(folder: Path) -> Any:
    """Return the library of the kernel, compiled unless this folder has it."""
    text = header()
    key = hashlib.sha256((text + SOURCE.read_text() + " ".join(FLAGS)).encode()).hexdigest()[:16]
    name = f"laminae_{key}"
    libraries = list(folder.glob(f"{name}*.so"))
    if not libraries:
        (folder / "tables.h").write_text(text)
        builder = cffi.FFI()
        builder.cdef(SIGNATURE)
        builder.set_source(
            name, SOURCE.read_text(), include_dirs=[str(folder)], extra_compile_args=FLAGS
        )
        libraries = [Path(builder.compile(tmpdir=str(folder)))]
    spec = spec_from_file_location(name, libraries[0])
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Native:
    """The kernel, called as `steps.run_plain` is."""

    def __init__(self, module: Any) -> None:
        """Take the kernel from its library."""
        self._done = module.ffi.new("int64_t[2]")
        self._run = module.lib.run_block

    def __call__(
        self, problem: int, log: int, first: int, begin: tuple[int, int], n_periods: int
    ) -> tuple[int, int, int]:
        """Compute a block of periods; see `steps.run_plain`."""
        for i, number in enumerate(begin):
            self._done[i] = number
        ending = self._run(problem, log, first, self._done, n_periods)
        return int(self._done[0]), int(self._done[1]), int(ending)


def computed(case: df.Case, native: Native | None) -> tuple[Recorder, float]:
    """Return what a run records, and the seconds of processor time of its steps.

    Raises:
        RuntimeError: the motion did not complete.
    """
    operators = assemble(case, needs_dolfinx=False).operators
    with session_of(case, operators, engine="compiled", comm=MPI.COMM_SELF) as opened:
        engine = opened.engine
        assert isinstance(engine, Compiled)
        assert engine.system.is_chained
        if native is not None:
            engine._run = native
        begin = time.thread_time()
        outcome = opened.run()
        seconds = time.thread_time() - begin
        recorder = opened.recorder
    if outcome != "completed":
        raise RuntimeError(f"{case.name}: {outcome}")
    return recorder, seconds


def case_of(elements: int, periods: int, settings: dict[str, Any]) -> df.Case:
    """Return the preset `paper` with a number of elements and of periods."""
    keys = COMMON | {"mesh.elements": elements, "time.periods": periods} | settings
    return df.preset("paper", keys)


def difference(name: str, native: Native, periods: int) -> tuple[float, float, int, int]:
    """Return the largest differences of tips and of the ledger, relative, and the hits of both."""
    case = case_of(20, periods, LAWS[name])
    compiled, _ = computed(case, None)
    in_c, _ = computed(case, native)
    tips = compiled.strobe[:, 0]
    ledger = compiled.ledger[:, :-1]
    of_tips = np.abs(in_c.strobe[:, 0] - tips).max() / np.abs(tips).max()
    of_ledger = np.abs(in_c.ledger[:, :-1] - ledger).max() / np.abs(ledger).max()
    hits = [int(one.impulse[:, 1].sum()) for one in (compiled, in_c)]
    return float(of_tips), float(of_ledger), hits[0], hits[1]


def slopes(elements: int, settings: dict[str, Any], native: Native, repeats: int) -> FloatArray:
    """Return the time of a step, compiled and in C, from runs of two lengths [ns]."""
    lengths = (100, 300) if elements < 500 else (4, 12)
    cases = [case_of(elements, n, settings) for n in lengths]
    least = np.full((2, 2), np.inf)
    for case in cases:
        computed(case, None)
    for _ in range(repeats):
        for j, kernel in enumerate((None, native)):
            for i, case in enumerate(cases):
                least[i, j] = min(least[i, j], computed(case, kernel)[1])
    n_steps = (lengths[1] - lengths[0]) * cases[0].time.steps_per_period
    return np.asarray(1e9 * (least[1] - least[0]) / n_steps)


def main() -> None:
    """Print equality, times of a step and of the first use."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="fewer repeats and sizes")
    short = parser.parse_args().short
    console = Console(width=100)
    with tempfile.TemporaryDirectory() as name:
        begin = time.perf_counter()
        module = built(Path(name))
        seconds = time.perf_counter() - begin
        size = Path(module.__file__).stat().st_size / 1024
        n_lines = len(SOURCE.read_text().splitlines())
        console.print(f"{n_lines} lines, compiled in {seconds:.2f} s to {size:.0f} kB")
        native = Native(module)
        table = Table("law", "tips", "ledger", "hits", "hits in C", title="20 elements, 20 periods")
        for law in LAWS:
            tips, ledger, *hits = difference(law, native, 20)
            table.add_row(law, f"{tips:.1e}", f"{ledger:.1e}", *map(str, hits))
        console.print(table)
        table = Table("law", "elements", "compiled [ns]", "C [ns]", "C / compiled")
        for law in LAWS:
            for elements in (20,) if short else (20, 50, 200, 2000):
                compiled, in_c = slopes(elements, LAWS[law], native, 3 if short else 7)
                numbers = f"{compiled:.0f}", f"{in_c:.0f}", f"{in_c / compiled:.3f}"
                table.add_row(law, str(elements), *numbers)
        console.print(table)


if __name__ == "__main__":
    main()

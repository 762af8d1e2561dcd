"""Compute a ladder: an executor computes the rungs, and each finished one is written to a file.

In Python:

    import delam_fem as df
    from delam_fem.studies.convergence.ladder import Ladder, method
    ladder = Ladder(df.preset("default"), (method("moreau"),), (10, 20, 40), (1000, 2000, 4000))
    found = run_ladder(ladder, "runs/ladder", workers=2)
    found.error(ladder.rungs()[-1])
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.numerics import extrapolation
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.dataset import json_ready
from delam_fem.simulation.interrupts import stop_signals
from delam_fem.studies import executors
from delam_fem.studies.convergence.ladder import Ladder, Rung
from delam_fem.studies.convergence.rung import RungResult, compute
from delam_fem.studies.convergence.statistics import EXTREMA
from delam_fem.studies.executors import ExecutorName

RESULT = "convergence.json"
"""Name of the file in the folder of a ladder."""


@dataclass(frozen=True)
class Convergence:
    """A ladder and what came of its rungs so far.

    Attributes:
        ladder: the ladder.
        results: by key.
    """

    ladder: Ladder
    results: dict[str, RungResult]

    @property
    def is_complete(self) -> bool:
        """Whether all rungs are there, whatever their outcome."""
        return all(rung.key in self.results for rung in self.ladder.rungs())

    def value(self, rung: Rung, name: str) -> float:
        """Return the mean of a statistic, NaN where the rung has none."""
        return self._entry(rung, name)[0]

    def scatter(self, rung: Rung, name: str) -> float:
        """Return the scatter of a statistic from block to block, NaN where the rung has none."""
        return self._entry(rung, name)[1]

    def standard_error(self, rung: Rung, name: str) -> float:
        """Return the standard error of the mean of a statistic."""
        blocks = self.value(rung, "blocks")
        return self.scatter(rung, name) / math.sqrt(blocks) if blocks > 0.0 else math.nan

    def limit(self, rungs: Sequence[Rung], name: str, *, by: str = "steps") -> extrapolation.Limit:
        """Return what a statistic tends to along rungs that refine `by` "steps" or "elements"."""
        sizes = [1.0 / getattr(rung, by) for rung in rungs]
        values = [self.value(rung, name) for rung in rungs]
        errors = [self.standard_error(rung, name) for rung in rungs]
        return extrapolation.limit(sizes, values, errors)

    def error(self, rung: Rung, reference: Rung | None = None) -> float:
        """Return how far the extremes of the tips are from the rigid limit.

        Args:
            rung: with contact.
            reference: what stands for the limit; default the limit of the same mesh.

        Returns:
            The largest difference of the four extremes, each in half peak-to-peak displacements of
            its tip in the limit [-]; NaN where either is missing, or the ladder has no limit.
        """
        if reference is None:
            if not self.ladder.has_limit:
                return math.nan
            reference = self.ladder.limit_of(rung.mesh)
        exact = np.array([self.value(reference, q.name) for q in EXTREMA])
        found = np.array([self.value(rung, q.name) for q in EXTREMA])
        half = np.repeat((exact[1::2] - exact[0::2]) / 2.0, 2)
        return float(np.abs((found - exact) / half).max())

    def free_errors(self, rung: Rung) -> FloatArray:
        """Return relative errors without contact.

        Returns:
            Of frequency and amplitude of tip 1, then of tip 2, against the exact cantilever,
            shape (4,) [-]; NaN where the rung is missing.
        """
        frequencies, amplitudes = exact_free_motion(rung.case)
        return np.array(
            [
                self.value(rung, f"{name}_{i + 1}") / exact[i] - 1.0
                for i in range(2)
                for name, exact in (("frequency", frequencies), ("amplitude", amplitudes))
            ]
        )

    def cost(self, rung: Rung) -> float:
        """Return the processor time of a period [s], NaN where the rung is missing."""
        result = self.results.get(rung.key)
        return math.nan if result is None else 1e-6 * result.microseconds_per_step * rung.steps

    def _entry(self, rung: Rung, name: str) -> tuple[float, float]:
        result = self.results.get(rung.key)
        missing = (math.nan, math.nan)
        return missing if result is None else result.statistics.get(name, missing)


def exact_free_motion(case: Case) -> tuple[list[float], list[float]]:
    """Return first frequencies [Hz] and tip amplitudes [m] of both laminae without contact."""
    frequencies, amplitudes = [], []
    for i, lamina in enumerate(case.lamina):
        frequencies.append(float(lamina.angular_frequencies(1)[0]) / (2.0 * math.pi))
        amplitudes.append(float(case.linear_amplitude(i, np.asarray(1.0 / case.period))))
    return frequencies, amplitudes


def run_ladder(
    ladder: Ladder,
    directory: str | Path,
    executor: ExecutorName = "process",
    *,
    workers: int | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Convergence:
    """Compute all rungs of a ladder.

    Every finished rung is in the folder's `convergence.json` before the next one counts. A rung
    that fails or diverges is a result like any other.

    Args:
        ladder: what to compute.
        directory: made where it does not exist.
        executor: "process" or "serial"; one worker computes here.
        workers: number of processes; one per core by default.
        resume: go on with what the folder holds; the ladder may have grown since.
        progress: called with the rungs done and all rungs.

    Returns:
        What came out; not complete if it was interrupted by Ctrl-C or a signal to terminate.

    Raises:
        CaseError: the folder holds another ladder, or one that `resume` does not ask for.
        OSError: the folder cannot be written.
    """
    path = Path(directory) / RESULT
    found = Convergence(ladder, _held(path, ladder, resume))
    path.parent.mkdir(parents=True, exist_ok=True)
    rungs = ladder.rungs()
    missing = [rung for rung in rungs if rung.key not in found.results]

    def take_in(futures: set[Future[RungResult]]) -> None:
        found.results.update({result.key: result for result in (f.result() for f in futures)})
        _write(path, found)
        if progress is not None:
            progress(len(rungs) - sum(r.key not in found.results for r in rungs), len(rungs))

    name: ExecutorName = "serial" if workers == 1 else executor
    take_in(set())
    if missing:
        with stop_signals() as is_stopped, executors.pool(name, workers) as pool:
            running: set[Future[RungResult]] = set()
            while (missing or running) and not is_stopped():
                while missing and len(running) < pool.n_workers:
                    running.add(pool.executor.submit(compute, missing.pop(0), ladder.engine))
                done, running = wait(running, return_when=FIRST_COMPLETED)
                take_in(done)
            take_in(wait(running).done)
    return found


def load_results(directory: str | Path) -> dict[str, RungResult]:
    """Return the rungs that a folder holds, by key; none where it holds no ladder."""
    path = Path(directory) / RESULT
    return _results(json.loads(path.read_text("utf-8"))) if path.is_file() else {}


def _held(path: Path, ladder: Ladder, resume: bool) -> dict[str, RungResult]:
    """Return the rungs that may be taken over."""
    if not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text("utf-8"))
        results, identity = _results(content), content["identity"]
    except (ValueError, KeyError, TypeError):
        raise CaseError(f"{path}: expected the results of a ladder") from None
    if not resume:
        raise CaseError(
            f"{path.parent}: holds {len(results)} rungs of a ladder; go on with --resume, choose "
            "another folder with -o DIR, or delete it"
        )
    if identity != ladder.identity:
        raise CaseError(
            f"resume: {path} belongs to another case or number of periods; run it with the "
            "settings it was begun with, or choose another folder with -o DIR"
        )
    return results


def _results(content: dict[str, list[dict[str, object]]]) -> dict[str, RungResult]:
    """Return rungs from what `_write` wrote."""
    results = {}
    for entry in content["rungs"]:
        fields: dict[str, object] = {
            name: math.nan if value is None else value for name, value in entry.items()
        }
        table = fields["statistics"]
        assert isinstance(table, dict)
        fields["statistics"] = {
            name: tuple(math.nan if x is None else float(x) for x in pair)
            for name, pair in table.items()
        }
        result = RungResult(**fields)  # type: ignore[arg-type]
        results[result.key] = result
    return results


def _write(path: Path, found: Convergence) -> None:
    """Write all results so that the file is whole whenever the machine stops."""
    entries = []
    for result in found.results.values():
        entry = asdict(result)
        entry["statistics"] = json_ready(entry["statistics"])
        entries.append(json_ready(entry))
    content = {
        "title": f"convergence of case {found.ladder.case.name}",
        "delam_fem": version("delam_fem"),
        "engine": found.ladder.engine,
        "limit_steps": found.ladder.limit_steps,
        "identity": found.ladder.identity,
        "rungs": entries,
    }
    temporary = path.with_suffix(".json.part")
    with temporary.open("w", encoding="utf-8") as file:
        json.dump(content, file, indent=1, allow_nan=False)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)

"""Compute the motions and sweeps that the figures of the paper need, each case once, on all cores.

A plan says how much is computed. A laboratory does the computing: single histories with `run`
(dolfinx assembles, compiled code computes the steps), many points with `run_sweep`. It remembers
the histories, because several figures show the same motion.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from delam_fem.case.definition import Case
from delam_fem.case.files import preset
from delam_fem.case.toml import CaseError
from delam_fem.paper.motions import FREQUENCIES
from delam_fem.studies import executors

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.results.folder import Result

EngineName = Literal["petsc", "compiled"]
PaperMethod = Literal["3.1", "3.2"]
_T = TypeVar("_T")

LAWS: dict[PaperMethod, str] = {"3.1": "newton", "3.2": "newton-penalty"}
"""Names of the contact laws, by the section of the paper that introduces the law."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Plan:
    """The amount of computation for all figures: lengths of histories, numbers of points.

    Attributes:
        periods: periods of a history; the paper needs "some hundred".
        plane_points: points per axis of a parameter plane.
        plane_periods: periods of each point of a plane.
        response_step: distance between the frequencies of a stepped sine [Hz].
        response_periods: periods at each frequency of a stepped sine; 260 last 65 s at 4 Hz, in
            which a free vibration of the thin lamina decays to 1 %.
        thresholds: number of values of γ.
        gap_exponents: exponents p of the gap g0 ~ (x/L)^p; the paper does not give the shape.
        has_long_ladders: whether the strip on the ground is computed on all meshes and with all
            time steps.
    """

    periods: int = 300
    plane_points: int = 21
    plane_periods: int = 200
    response_step: float = 0.025
    response_periods: int = 260
    thresholds: int = 13
    gap_exponents: tuple[float, ...] = (1.0, 1.5, 2.0, 2.5, 3.0)
    has_long_ladders: bool = True


FULL = Plan()
FAST = Plan(
    plane_points=8,
    response_step=0.1,
    response_periods=80,
    thresholds=5,
    gap_exponents=(1.0, 2.0, 3.0),
    has_long_ladders=False,
)
"""The plan of a quick run. Its histories have full length: the paper's motions need that time."""


@dataclass
class Laboratory:
    """Compute histories and sweeps on several processes, and remember the histories.

    A figure asks its laboratory for the results that it needs; it does not run cases itself.

    Attributes:
        plan: the amount of computation.
        executor: runs the computations.
        engine: name of the engine that computes the steps.
    """

    plan: Plan
    executor: Executor
    engine: EngineName = "compiled"
    _results: dict[str, Result] = field(default_factory=dict)
    _begun: dict[str, Future[Any]] = field(default_factory=dict)

    def begin(self, name: str, function: Callable[..., _T], **given: Any) -> Future[_T]:
        """Start a computation in the background, unless this name has been started before."""
        if name not in self._begun:
            self._begun[name] = self.executor.submit(function, **given)
        return self._begun[name]

    def motions(self, cases: Sequence[Case]) -> list[Result]:
        """Return the results of cases; compute the new ones, all at the same time.

        Raises:
            RuntimeError: a motion was not completed; the message contains the case.
        """
        keys = [case.to_toml() for case in cases]
        new = {key: case for key, case in zip(keys, cases, strict=True) if key not in self._results}
        running = {
            key: self.executor.submit(_computed, case, self.engine) for key, case in new.items()
        }
        for key, future in running.items():
            result = future.result()
            outcome = result.history.attrs["outcome"]
            if outcome != "completed":
                raise RuntimeError(f"case {result.case.name} {outcome}; the case is\n{key}")
            self._results[key] = result
        return [self._results[key] for key in keys]

    def sweep(self, description: Mapping[str, Any]) -> xr.Dataset:
        """Compute a sweep of the preset `paper`; the keys are those of a sweep file.

        Raises:
            KeyboardInterrupt: the sweep was interrupted.
        """
        from delam_fem.studies.sweeps.load import sweep_of
        from delam_fem.studies.sweeps.run import run_sweep

        sweep = sweep_of({"base": "paper", "engine": self.engine} | dict(description))
        _log.info("%s: %d points", sweep.file.name, sweep.n_points)
        with tempfile.TemporaryDirectory() as folder:
            data = run_sweep(sweep, folder, self.executor).load()
            data.close()
        if data.attrs["outcome"] == "interrupted":
            raise KeyboardInterrupt
        return data


@contextmanager
def laboratory(
    plan: Plan, *, workers: int | None = None, engine: EngineName = "compiled"
) -> Iterator[Laboratory]:
    """Open a laboratory with a number of worker processes; 1 computes in this process.

    Raises:
        CaseError: the number of workers is below 1.
    """
    if workers is not None and workers < 1:
        raise CaseError(f"workers: expected at least 1, given {workers}")
    with executors.pool("serial" if workers == 1 else "process", workers) as opened:
        yield Laboratory(plan, opened.executor, engine)


def motion_case(
    frequency: float,
    plan: Plan,
    method: PaperMethod = "3.2",
    overrides: Mapping[str, object] | None = None,
) -> Case:
    """Return the paper's case at a frequency [Hz] with one of its two methods."""
    keys: dict[str, object] = {
        "excitation.frequency": frequency,
        "contact.law": LAWS[method],
        "time.periods": plan.periods,
        "output.fields_per_period": 100,
    }
    return preset("paper", keys | dict(overrides or {}))


def both_methods(lab: Laboratory) -> dict[tuple[float, PaperMethod], Result]:
    """Compute the four reference motions by both methods; keys are frequency [Hz] and method."""
    keys: list[tuple[float, PaperMethod]] = [(f, m) for f in FREQUENCIES for m in LAWS]
    results = lab.motions([motion_case(f, lab.plan, m) for f, m in keys])
    return dict(zip(keys, results, strict=True))


def _computed(case: Case, engine: EngineName) -> Result:
    """Compute a case in a worker, without the warning that lumped impulses can add energy."""
    from delam_fem.pipeline import run

    log = logging.getLogger("delam_fem.pipeline")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        return run(case, engine)
    finally:
        log.setLevel(level)

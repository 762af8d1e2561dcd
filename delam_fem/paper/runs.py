"""Compute the motions, sweeps and swept sines that the figures of the paper need, each once.

The paper excites the laminae at four frequencies and describes the motion at each. `MOTIONS` holds
these descriptions; every other module takes frequencies and descriptions from here.

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
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from delam_fem.api import Case, FloatArray, Result, base_motion, diagnostics, preset, require
from delam_fem.studies import executors

if TYPE_CHECKING:
    import xarray as xr

    from delam_fem.api import EngineName

BEATS = 2.0
"""A lamina beats the other one if its tip is more than this factor faster."""
SAME_FREQUENCY = 0.01
"""Two frequencies count as the same if they differ by less than this [Hz]."""


def strikes(result: Result) -> diagnostics.Strikes:
    """Return the strikes of a result with two laminae; see `Strikes`."""
    return diagnostics.of_interface(result.history, result.case.time.steps_per_period, 0)


@dataclass(frozen=True)
class PaperMotion:
    """A motion that the paper describes.

    Attributes:
        frequency: frequency of the base [Hz].
        text: the paper's description, in short.
        periodicity: number of base periods after which the motion repeats.
        has_its_contacts: function that returns whether the tips of a result meet as described.
    """

    frequency: float
    text: str
    periodicity: int
    has_its_contacts: Callable[[Result], bool]

    def is_shown_by(self, result: Result) -> bool:
        """Return whether a result has the periodicity and the contacts of this motion."""
        is_periodic = result.summary["periodicity"] == self.periodicity
        return bool(is_periodic and self.has_its_contacts(result))


def contacts(result: Result) -> float:
    """Return the number of tip contacts per period; 0 if the case has no contact law."""
    return float(result.summary["tip_contacts_per_period"] or 0.0)


MOTIONS = (
    PaperMotion(
        1.25, "no tip contact, weak contact near the clamp", 1,
        lambda r: contacts(r) == 0.0 and r.summary["minimum_tip_gap"] > 0.0,
    ),
    PaperMotion(
        1.60, "the thin lamina beats the thick one", 1,
        lambda r: contacts(r) >= 1.0
        and abs(strikes(r).mean[1]) > BEATS * abs(strikes(r).mean[0]),
    ),
    PaperMotion(
        3.25, "the thick beats the thin, opposite velocities", 1,
        lambda r: contacts(r) == 1.0 and strikes(r).mean[0] > 0.0 > strikes(r).mean[1],
    ),
    PaperMotion(3.65, "one contact in two periods", 2, lambda r: contacts(r) == 0.5),
)  # fmt: skip
FREQUENCIES = tuple(motion.frequency for motion in MOTIONS)
"""The four excitation frequencies of the paper [Hz]."""
RESONANT = FREQUENCIES[2]
"""The excitation frequency of Figs. 4, 5, 8 to 11 and 13 to 15 [Hz]."""


def is_as_described(result: Result) -> bool:
    """Return whether a result shows the motion that the paper describes for its frequency.

    Return False if the paper describes no motion at this frequency.
    """
    frequency = 1.0 / result.case.period
    return any(
        motion.is_shown_by(result)
        for motion in MOTIONS
        if abs(frequency - motion.frequency) < SAME_FREQUENCY
    )


BAND = (0.5, 4.0)
"""Lowest and highest frequency of the experiment [Hz]."""
SWEEP_SECONDS = 1800.0
TRANSIENT_LEFT = 0.01
"""Share of the transient of its start that is left when the envelope of a swept sine begins [-]."""


def swept_case(spacing: str, ends: tuple[float, float], law: str, steps: int) -> Case:
    """Return the case of a 30-minute swept sine.

    Args:
        spacing: how the frequency grows: "linear" or "logarithmic".
        ends: first and last frequency [Hz].
        law: name of the contact law.
        steps: steps per period of the highest frequency.
    """
    return preset(
        "paper",
        {
            "excitation.kind": "sweep",
            "excitation.start_frequency": ends[0],
            "excitation.end_frequency": ends[1],
            "excitation.duration": SWEEP_SECONDS,
            "excitation.amplitude": 0.0025,
            "excitation.spacing": spacing,
            "contact.law": law,
            "time.steps_per_period": steps,
            "output.window_periods": 1,
            "output.fields_per_period": 0,
        },
    )


def swept_extremes(result: Result) -> tuple[FloatArray, FloatArray]:
    """Return the extremes of a swept sine, one pair per period of the highest frequency.

    Returns:
        Times, shape (n,) [s]; smallest and largest displacement of both tips, shape (2, 2, n) [m].
    """
    extremes = np.stack([result.history[f"envelope_{end}"].to_numpy() for end in ("min", "max")])
    return (np.arange(extremes.shape[-1]) + 0.5) * result.case.period, extremes


def swept_envelope(result: Result) -> tuple[FloatArray, FloatArray]:
    """Return the frequency and half the range of both tips within each cycle of a swept sine.

    The run keeps extremes per period of its highest frequency. Those within one cycle of the
    current frequency are combined.

    Returns:
        Frequencies, shape (n,) [Hz]; half ranges, shape (2, n) [m]; NaN while more than
        `TRANSIENT_LEFT` of the transient of the start is left.
    """
    middle, (low, high) = swept_extremes(result)
    f = base_motion(result.case.excitation).instantaneous_frequency(middle)
    half = np.ceil(0.5 / (f * result.case.period)).astype(np.int64)
    ranges = [slice(max(k - w, 0), k + w + 1) for k, w in enumerate(half.tolist())]
    envelope = np.stack(
        [0.5 * (high[:, r].max(axis=1) - low[:, r].min(axis=1)) for r in ranges], axis=1
    )
    rates = [lam.damping_ratio * lam.angular_frequencies(1)[0] for lam in result.case.lamina]
    envelope[:, middle < -np.log(TRANSIENT_LEFT) / min(rates)] = np.nan
    return f, envelope


def peak_frequencies(f: FloatArray, amplitude: FloatArray) -> list[float]:
    """Return the frequencies of the base at which the amplitudes of the tips are the largest [Hz].

    If the largest amplitude occurs at several times, return the mean of their frequencies. The
    arguments are those that `swept_envelope` returns.
    """
    return [float(f[row >= np.nanmax(row) * (1.0 - 1e-9)].mean()) for row in amplitude]


PaperMethod = Literal["3.1", "3.2"]
_T = TypeVar("_T")

LAWS: dict[PaperMethod, str] = {"3.1": "newton", "3.2": "newton-penalty"}
"""Names of the contact laws, by the section of the paper that introduces the law."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Effort:
    """The amount of computation for all figures: lengths of histories, numbers of points.

    Attributes:
        periods: periods of a history; the paper needs "some hundred".
        plane_points: points per axis of a parameter plane.
        plane_periods: periods of each point of a plane.
        response_step: distance between the frequencies of a stepped sine [Hz].
        response_periods: periods at each frequency of a stepped sine; 260 last 65 s at 4 Hz, in
            which a free vibration of the thin lamina decays to 1 %.
        thresholds: number of values of γ.
        gap_exponents: exponents p of the gap g0 ∝ (x/L)^p; the paper does not give the shape.
        has_long_refinements: whether the strip on the ground is computed on all meshes and with all
            time steps.
    """

    periods: int = 300
    plane_points: int = 21
    plane_periods: int = 200
    response_step: float = 0.025
    response_periods: int = 260
    thresholds: int = 13
    gap_exponents: tuple[float, ...] = (1.0, 1.5, 2.0, 2.5, 3.0)
    has_long_refinements: bool = True


FULL = Effort()
FAST = Effort(
    plane_points=8,
    response_step=0.1,
    response_periods=80,
    thresholds=5,
    gap_exponents=(1.0, 2.0, 3.0),
    has_long_refinements=False,
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

    plan: Effort
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
        from delam_fem.studies.sweeps.grid import sweep_of
        from delam_fem.studies.sweeps.run import completed

        sweep = sweep_of({"base": "paper", "engine": self.engine} | dict(description))
        _log.info("%s: %d points", sweep.file.name, sweep.n_points)
        with tempfile.TemporaryDirectory() as folder:
            return completed(sweep, Path(folder), self.executor)


@contextmanager
def laboratory(
    plan: Effort, *, workers: int | None = None, engine: EngineName = "compiled"
) -> Iterator[Laboratory]:
    """Open a laboratory with a number of worker processes; 1 computes in this process.

    Raises:
        CaseError: the number of workers is below 1.
    """
    require(workers is None or workers >= 1, "workers", "at least 1", workers)
    with executors.pool("serial" if workers == 1 else "process", workers) as opened:
        yield Laboratory(plan, opened.executor, engine)


def motion_case(
    frequency: float,
    plan: Effort,
    method: PaperMethod = "3.2",
    overrides: Mapping[str, object] | None = None,
) -> Case:
    """Return the paper's case at a frequency [Hz] with one of its two methods."""
    return preset(
        "paper",
        {
            "excitation.frequency": frequency,
            "contact.law": LAWS[method],
            "time.periods": plan.periods,
            "output.fields_per_period": 100,
            **(overrides or {}),
        },
    )


def both_methods(lab: Laboratory) -> dict[tuple[float, PaperMethod], Result]:
    """Compute the four reference motions by both methods; keys are frequency [Hz] and method."""
    keys: list[tuple[float, PaperMethod]] = [(f, m) for f in FREQUENCIES for m in LAWS]
    return dict(zip(keys, lab.motions([motion_case(f, lab.plan, m) for f, m in keys]), strict=True))


def _computed(case: Case, engine: EngineName) -> Result:
    """Compute a case in a worker, without the warning that lumped impulses can add energy."""
    from delam_fem.api import run

    log = logging.getLogger("delam_fem.pipeline")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        return run(case, engine)
    finally:
        log.setLevel(level)

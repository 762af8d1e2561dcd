"""Many structures with a delamination, computed as a sweep: each gives the shapes of a scan.

Noise is added to the shapes afterwards, so that one run serves any noise. The journal of the sweep
makes a study resumable, and any executor can compute it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.scan import surface_of
from delam_fem.studies.detection.detect import per_shape
from delam_fem.studies.detection.measurement import intact, settling_periods
from delam_fem.studies.detection.shapes import Shapes
from delam_fem.studies.executors import ExecutorName
from delam_fem.studies.sweeps.file import Axis, Record, ScanRecord, SweepFile
from delam_fem.studies.sweeps.grid import Sweep
from delam_fem.studies.sweeps.load import require_valid
from delam_fem.studies.sweeps.run import run_sweep

PERIODS, SAMPLES = 16, 50
"""Periods of a record, samples per period."""
ELEMENTS, STEPS = 20, 100
"""Mesh and steps per period of the runs; 40 and 500 mark the same intervals (docs/detection.md)."""
SETTLED = 0.05
"""Share of a free motion of the lowest mode that may be left; runs start from the closed motion."""


@dataclass(frozen=True)
class Specimen:
    """A structure with one delamination, and its excitation.

    Attributes:
        start, end: edges of the delamination [m].
        thickness: of the lamina that is measured, the depth of the delamination [m].
        support: at the end of the structure: "clamped" or "free".
        frequency: of the excitation [Hz].
    """

    start: float
    end: float
    thickness: float
    support: str
    frequency: float

    @property
    def length(self) -> float:
        """Length of the delamination [m]."""
        return self.end - self.start


@dataclass(frozen=True)
class Population:
    """The shapes of many specimens.

    Attributes:
        specimens: the structures.
        x: positions of the scan, shape (n,) [m].
        orders: of the shapes.
        values: complex shapes without noise, NaN where a run failed, shape (n_specimens, n_orders,
            n) [m/s].
        rms: overall root mean square of each field, shape (n_specimens,) [m/s].
    """

    specimens: tuple[Specimen, ...]
    x: FloatArray
    orders: tuple[float, ...]
    values: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
    rms: FloatArray

    def noise(self, index: int, noise_db: float | FloatArray) -> float | FloatArray:
        """Return the root mean square of the noise on the shapes of a specimen [m/s].

        Args:
            index: of the specimen.
            noise_db: overall root mean square of the field over that of the noise, of all points
                or of each [dB].
        """
        return per_shape(self.rms[index] * 10.0 ** (-noise_db / 20.0), PERIODS * SAMPLES)

    def shapes(
        self, index: int, noise_db: float | FloatArray, rng: np.random.Generator,
        n_lines: float = math.inf,
    ) -> Shapes:  # fmt: skip
        """Return the shapes of a specimen as a noisy sensor measures them; see `noise`."""
        frequency = self.specimens[index].frequency
        pure = Shapes(self.x, frequency, self.orders, self.values[index])
        return pure.noisy(self.noise(index, noise_db), rng, n_lines)

    def at_first(self, n: int | None) -> Population:
        """Return what a scan of the first n points sees; None: of all."""
        values = self.values[..., :n]
        rms = np.sqrt(0.5 * np.sum(np.mean(np.abs(values) ** 2, axis=-1), axis=-1))
        return self if n is None else replace(self, x=self.x[:n], values=values, rms=rms)

    def is_there(self, index: int) -> bool:
        """Return whether the run of a specimen was completed."""
        return bool(np.isfinite(self.rms[index]))


def population(
    case: Case,
    specimens: Sequence[Specimen],
    directory: str | Path,
    executor: Executor | ExecutorName | None = None,
    *,
    name: str = "population",
    spacing: float = 0.01,
    first: float = 0.0,
    also: Mapping[str, FloatArray] | None = None,
    workers: int | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Population:
    """Compute the shapes of all specimens as a sweep in a folder; see `run_sweep`.

    Args:
        case: two laminae with one delamination; the specimens replace its edges, the thicknesses,
            the support at the end and the frequency.
        specimens: the structures.
        directory: folder of the sweep.
        executor: see `run_sweep`.
        name: of the sweep.
        spacing: distance of the scanned points [m].
        first: position of the first of them [m].
        also: values of further keys of the case, one for each specimen.
        workers: see `run_sweep`.
        resume: whether to go on with what is in the folder.
        progress: see `run_sweep`.

    Raises:
        CaseError: the case is not as described, or see `run_sweep`.
        KeyboardInterrupt: it was interrupted; `resume` goes on.
    """
    scan = ScanRecord(lamina=surface_of(case, None), spacing=spacing, first=first)
    sweep = sweep_of_specimens(case, specimens, name, scan, also or {})
    data = run_sweep(
        sweep, directory, executor, workers=workers, resume=resume, progress=progress,
        is_confirmed=True,
    )  # fmt: skip
    with data:
        if data.attrs["outcome"] != "completed":
            raise KeyboardInterrupt
        return _population(data, tuple(specimens))


def sweep_of_specimens(
    case: Case, specimens: Sequence[Specimen], name: str, scan: ScanRecord,
    also: Mapping[str, FloatArray],
) -> Sweep:  # fmt: skip
    """Return the sweep whose points are the specimens."""
    if len(case.lamina) != 2 or len(case.delamination) != 1:
        raise CaseError(
            "population: expected a case with two laminae and one [[delamination]], given "
            f"{len(case.lamina)} and {len(case.delamination)}"
        )
    columns = _columns(case, specimens, surface_of(case, None))
    columns |= {key: values.tolist() for key, values in also.items()}
    axes = tuple(
        Axis(key=key, name=key.replace(".", "_"), values=tuple(values))
        for key, values in columns.items()
    )
    fast = {
        "mesh.elements": ELEMENTS,
        "time.steps_per_period": STEPS,
        "output.window_periods": PERIODS,
        "output.fields_per_period": SAMPLES,
    }
    return scans(name, case.with_overrides(fast), axes, scan)


def scans(name: str, case: Case, axes: tuple[Axis, ...], scan: ScanRecord) -> Sweep:
    """Return a sweep that keeps nothing but scans, of motions that begin in their steady state.

    Args:
        name: of the sweep.
        case: its base.
        axes: whose k-th values belong together.
        scan: the points that are kept.

    Raises:
        CaseError: a value of an axis is not valid.
    """
    record = Record(summary=False, strobes=0, scan=scan)
    file = SweepFile.model_validate(
        dict(name=name, base="case.toml", combine="zip", start="steady", axis=axes, record=record)
    )
    sweep = Sweep(file, case)
    require_valid(sweep)
    return sweep


def _columns(
    case: Case, specimens: Sequence[Specimen], surface: str
) -> dict[str, list[float | int | str]]:
    """Return the values of each key for all specimens."""
    other = next(own.name for own in case.lamina if own.name != surface)
    total = sum(own.thickness or 0.0 for own in case.lamina)
    settling = {kind: _settling(case, kind) for kind in sorted({own.support for own in specimens})}
    return {
        "delamination.0.start": [own.start for own in specimens],
        "delamination.0.end": [own.end for own in specimens],
        f"lamina.{surface}.thickness": [own.thickness for own in specimens],
        f"lamina.{other}.thickness": [total - own.thickness for own in specimens],
        "support.end": [own.support for own in specimens],
        "excitation.frequency": [own.frequency for own in specimens],
        "time.periods": [
            PERIODS + math.ceil(settling[own.support] * own.frequency) for own in specimens
        ],
    }


def _settling(case: Case, support: str) -> float:
    """Return the time after which 5 % of a free motion of an intact structure is left [s]."""
    whole = intact(case.with_overrides({"support.end": support}))
    return settling_periods(whole, SETTLED) / whole.excitation.top_frequency


def _population(data: xr.Dataset, specimens: tuple[Specimen, ...]) -> Population:
    """Return the shapes in the dataset of a sweep."""
    values = data["scan_real"].to_numpy() + 1j * data["scan_imag"].to_numpy()
    orders = tuple(float(order) for order in data["order"].to_numpy())
    kept = [k for k in range(len(orders)) if np.isfinite(values[:, k]).any()]
    return Population(
        specimens,
        data["scan_x"].to_numpy(),
        tuple(orders[k] for k in kept),
        values[:, kept],
        data["scan_rms"].to_numpy(),
    )

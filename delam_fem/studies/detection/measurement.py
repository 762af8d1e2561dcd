"""Simulate the measurement of a structure: a scan of one surface, with the noise of the sensor."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.engines.session import session_of
from delam_fem.model import discretise
from delam_fem.model.beams.bonded import n_rigid
from delam_fem.model.vibration import lowest
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.measured.reading import scan as measured_scan
from delam_fem.results.overlay.findings import SAME_RATE
from delam_fem.results.overlay.harmonics import strongest_frequency
from delam_fem.results.scan import at_points, scan_field, scan_positions, surface_of
from delam_fem.studies.detection.shapes import ORDERS, ComplexArray
from delam_fem.studies.linear import closed_motion, closed_response

SAMPLES = 50
"""Samples per period, unless a sampling rate is given."""
LEAST_STEPS = 100
"""Steps per period below which contact is not resolved."""
SLOWEST = 0.125
"""Share of the excitation's frequency below which a motion is the surroundings'."""
UNCERTAIN = 0.001
"""Periods by which a record's drive and the case's may part over the record and be the same."""
SETTLED = 0.001
"""Share of a free motion of the lowest mode that may be left when the record begins."""

Quantity = Literal["velocity", "displacement"]


@dataclass(frozen=True)
class Scan:
    """How a structure is measured. The points are measured at once, or one by one with a trigger.

    Attributes:
        lamina: name of the lamina whose surface is measured; None: the thinner outermost one.
        spacing: distance of the points [m].
        first: position of the first point [m].
        quantity: absolute velocity, or displacement, both in the fixed frame.
        sampling_rate: rate [Hz], rounded to a whole number of samples per period of the excitation;
            None: 50 per period.
        periods: length of the record of a point.
        averages: number of records that are averaged.
        noise_db: ratio of the overall root mean square of the signal to that of the noise [dB].
        noise_density: of the sensor, instead [m/s/√Hz or m/√Hz]; white up to half the sampling
            rate.
        seed: of the noise.
    """

    lamina: str | None = None
    spacing: float = 0.01
    first: float = 0.0
    quantity: Quantity = "velocity"
    sampling_rate: float | None = None
    periods: int = 16
    averages: int = 1
    noise_db: float = 40.0
    noise_density: float | None = None
    seed: int = 1

    def surface(self, case: Case) -> str:
        """Return the name of the lamina that is measured."""
        return surface_of(case, self.lamina)

    def samples(self, frequency: float) -> int:
        """Return the number of samples per period.

        Raises:
            CaseError: fewer than five, so that the second harmonic is not seen.
        """
        if self.sampling_rate is None:
            return SAMPLES
        n = round(self.sampling_rate / frequency)
        if n < 5:
            raise CaseError(
                f"sampling rate: expected at least 5 samples per period of {frequency:g} Hz, given "
                f"{self.sampling_rate:g} Hz"
            )
        return n


@dataclass(frozen=True)
class Measurement:
    """A measured field.

    Attributes:
        times: shape (k,) [s].
        x: positions, shape (n,) [m].
        field: velocity or displacement, shape (k, n) [m/s or m].
        frequency: of the excitation [Hz].
    """

    times: FloatArray
    x: FloatArray
    field: FloatArray
    frequency: float

    @property
    def rms(self) -> float:
        """Root mean square over all times and points."""
        return float(np.sqrt(np.mean(self.field**2)))

    def noise_of(self, scan: Scan) -> float:
        """Return the root mean square of the noise in an averaged sample of this field."""
        if scan.noise_density is None:
            single = self.rms * 10.0 ** (-scan.noise_db / 20.0)
        else:
            single = scan.noise_density * math.sqrt(
                0.5 * scan.samples(self.frequency) * self.frequency
            )
        return float(single / math.sqrt(scan.averages))

    def noisy(self, noise: float | FloatArray, seed: int) -> Measurement:
        """Return the measurement with white noise of a root mean square, for all or each point."""
        added = np.random.default_rng(seed).normal(scale=noise, size=self.field.shape)
        return Measurement(self.times, self.x, self.field + added, self.frequency)


def simulated(case: Case, scan: Scan, kept: Path | None = None) -> Measurement:
    """Compute the motion of a case and return the field that a sensor without noise would measure.

    The run begins with the linear motion of the closed structure, and its record begins when 0.1 %
    of a free motion of the lowest mode would be left, or after the periods of the case if these are
    more. The record has whole steps: the number of steps per period is raised to a multiple of the
    samples per period.

    Args:
        case: with a harmonic excitation.
        scan: how to measure.
        kept: folder for a checkpoint, from which the run goes on; None: none is kept.

    Raises:
        CaseError: the excitation is not harmonic, the lamina does not exist, the scan has no
            points, or the motion diverges.
    """
    if not case.is_periodic or case.excitation.length is not None:
        raise CaseError('detect: expected a harmonic excitation, given another "excitation.kind"')
    f = case.excitation.top_frequency
    samples, x = scan.samples(f), scan_positions(case.length, scan.spacing, scan.first)
    N = samples * math.ceil(max(case.time.steps_per_period, LEAST_STEPS) / samples)
    structure = discretise.assemble(case, needs_dolfinx=False)
    periods = max(case.n_periods, settling_periods(case) + scan.periods)
    changed = case.model_copy(
        update={
            "time": case.time.model_copy(update={"steps_per_period": N, "periods": periods}),
            "output": case.output.model_copy(
                update={"window_periods": scan.periods, "fields_per_period": samples}
            ),
        }
    )
    start = closed_motion(changed, structure)
    with session_of(changed, structure.operators, initial=start) as opened:
        outcome = opened.run_kept(kept, changed)
        if outcome != "completed":
            raise CaseError(f"detect: the motion of case {case.name} has {outcome}")
        times, u, v = scan_field(opened.recorder, structure, scan.surface(case), x)
    return Measurement(times, x, v if scan.quantity == "velocity" else u, f)


def drive_responses(
    case: Case, lamina: str, x: FloatArray, frequency: float, orders: Sequence[float] = ORDERS
) -> dict[float, ComplexArray]:
    """Return how points of the closed structure answer harmonics of the drive, by order."""
    structure = discretise.assemble(case, needs_dolfinx=False)
    base = np.array([1.0 if case.excitation.acts_on == "base" else 0.0, 0.0])
    found = {}
    for k in orders:
        if k > 1.0:
            U = closed_response(structure, k * frequency)
            real, imag = at_points(structure, lamina, x, np.stack([U.real, U.imag]), base)
            found[k] = real + 1j * imag
    return found


def read(data: xr.Dataset, case: Case, scan: Scan) -> Measurement:
    """Return the field in a dataset of measurements (`results.measured`).

    Its frequency is that at which the record moves most, so that a clock that is a little wrong
    does no harm.

    Args:
        data: with the histories of points along a lamina.
        case: with the excitation of the record.
        scan: gives the lamina and the quantity.

    Raises:
        CaseError: fewer than five points are measured, or the record is of another frequency.
    """
    found = measured_scan(data, scan.quantity, scan.surface(case))
    field, x = found.to_numpy(), found["position"].to_numpy()
    if x.size < 5 or not np.all(np.diff(x) > 0.0):
        raise CaseError(
            f"measured: expected {scan.quantity} at 5 or more different positions on the lamina "
            f"{scan.surface(case)!r}, given {x.tolist()}"
        )
    whole = np.isfinite(field).all(axis=1)
    times = found["time"].to_numpy()[whole]
    drive = case.excitation.top_frequency
    frequency = strongest_frequency(times, field[whole].T, SLOWEST * drive) or drive
    if abs(frequency / drive - 1.0) > SAME_RATE:
        raise CaseError(
            f"measured: expected a record of {drive:.6g} Hz, the excitation of case {case.name}, "
            f"given one of {frequency:.6g} Hz; was it --set excitation.frequency={frequency:.6g}?"
        )
    is_same = abs(frequency - drive) * (times[-1] - times[0]) < UNCERTAIN
    return Measurement(times, x, field[whole], drive if is_same else frequency)


def settling_periods(case: Case, settled: float = SETTLED) -> int:
    """Return after how many periods that share of a free motion of the lowest mode is left."""
    structure = discretise.assemble(case, needs_dolfinx=False)
    o = structure.operators
    rigid = 0 if case.is_apart else n_rigid(case)
    found, _ = lowest(o.stiffness, o.mass, rigid + 1, is_floating=rigid > 0)
    D = min(lamina.damping_ratio for lamina in case.lamina)
    decay = 2.0 * math.pi * D * float(found[rigid])
    return math.ceil(-math.log(settled) / decay * case.excitation.top_frequency) if decay else 0


def intact(case: Case) -> Case:
    """Return the case without its delaminations: one bonded beam on the same supports."""
    discretise.require_kind(case, "comparison with the intact structure")
    data = tomllib.loads(case.to_toml())
    for key in ("delamination", "gap"):
        data.pop(key, None)
    data["support"] = case.support.model_dump(exclude_none=True)
    return Case.checked(data, f"case {case.name} without delaminations")

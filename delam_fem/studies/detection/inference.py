"""Infer start, end and depth of a delamination from a noisy scan: a posterior, not a point.

Likelihood-free: one table of simulations from the prior serves every observation, by semi-automatic
summaries, rejection and regression (`numerics.inference`). The statistics of a simulation contain
noise as the observation does.

The parameters are the middle, the length and the depth, uniform within bounds; start and end
follow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.inference import UNLIKE, Posterior, Table
from delam_fem.studies.detection.detect import per_sample
from delam_fem.studies.detection.indices import curvature
from delam_fem.studies.detection.locate import mark
from delam_fem.studies.detection.population import PERIODS, SAMPLES, Population, Specimen
from delam_fem.studies.detection.shapes import ComplexArray, Shapes

FREQUENCIES = (92.0, 250.0)
"""Excitations of the scans of one structure [Hz]: a low one and one that shows short ones, too."""
COMPONENTS = 3
"""Principal components of the curvature along the beam that serve as statistics, per frequency."""
NAMES = ("start", "end", "depth")
STATISTICS = (
    *(f"component {k + 1} of the shape of the curvature" for k in range(COMPONENTS)),
    "the first marked point", "the last marked point", "the curvature over its limit",
    "the second harmonic over the first", "the size of the first harmonic",
)  # fmt: skip
"""What is compared of each scan."""


@dataclass(frozen=True)
class Prior:
    """Uniform distributions of the parameters.

    Attributes:
        middle, length, depth: lowest and highest value [m].
    """

    middle: tuple[float, float] = (0.10, 0.30)
    length: tuple[float, float] = (0.03, 0.16)
    depth: tuple[float, float] = (0.0002, 0.0009)

    @classmethod
    def of(cls, case: Case) -> Prior:
        """Return the prior in the proportions of a case; for `embedded` that of the class."""
        L, h = case.length, sum(own.thickness or 0.0 for own in case.lamina)
        return cls((0.25 * L, 0.75 * L), (0.075 * L, 0.4 * L), (0.1 * h, 0.45 * h))

    @property
    def bounds(self) -> FloatArray:
        """Shape (3, 2) [m]."""
        return np.array([self.middle, self.length, self.depth])

    def sample(self, n: int, seed: int) -> FloatArray:
        """Return parameters, shape (n, 3) [m]."""
        low, high = self.bounds.T
        return np.asarray(np.random.default_rng(seed).uniform(low, high, size=(n, 3)))


def specimens_of(
    parameters: FloatArray, support: str, frequencies: tuple[float, ...] = FREQUENCIES
) -> list[Specimen]:
    """Return the structures of parameters at the first frequency, then at the second, …."""
    return [
        Specimen(middle - 0.5 * length, middle + 0.5 * length, depth, support, frequency)
        for frequency in frequencies
        for middle, length, depth in parameters.tolist()
    ]


@dataclass(frozen=True)
class Sensor:
    """What the scan of one frequency was measured with, so that the table is measured alike.

    Attributes:
        noise_db: overall root mean square of the field over that of the noise in a sample of a
            record of the table, of all points or of each [dB].
        n_lines: frequencies from which the noise is estimated; inf: it is known.
        drive: linear responses to harmonics of the drive, by order, which are taken away.
    """

    noise_db: float | FloatArray
    n_lines: float = math.inf
    drive: Mapping[float, ComplexArray] = field(default_factory=dict)

    @classmethod
    def of(cls, scan: Shapes, rms: float, drive: Mapping[float, ComplexArray]) -> Sensor:
        """Return the sensor of a measured scan with an overall root mean square [m/s]."""
        samples = per_sample(scan.noise, PERIODS * SAMPLES)
        return cls(20.0 * np.log10(rms / np.asarray(samples)), scan.n_lines, drive)


@dataclass(frozen=True)
class Knowledge:
    """A table of simulations, and how a scan becomes the statistics of the table.

    Attributes:
        table: parameters and statistics.
        bases: mean and principal components of the curvature at each frequency, shape (1 +
            COMPONENTS, n_points).
        frequencies: of the scans of one structure [Hz].
        sensors: of each frequency.
    """

    table: Table
    bases: tuple[FloatArray, ...]
    frequencies: tuple[float, ...]
    sensors: tuple[Sensor, ...]

    def posterior(self, scans: tuple[Shapes, ...]) -> Posterior:
        """Return the posterior of middle, length and depth for noisy scans, one per frequency."""
        return self.table.posterior(self._observed(scans))

    def mismatch(self, scans: tuple[Shapes, ...]) -> str | None:
        """Return in which way scans are unlike those of all simulations; None: they are not."""
        share, number = self.table.misfit(self._observed(scans))
        if share > UNLIKE:
            return None
        frequency, statistic = divmod(number, len(STATISTICS))
        return (
            f"the scans are like those of no simulation: {STATISTICS[statistic]} at "
            f"{self.frequencies[frequency]:g} Hz fits none of the same place. The rig differs from "
            "the case by more than --uncertain says, or the delamination is another one; the "
            "intervals do not hold"
        )

    def _observed(self, scans: tuple[Shapes, ...]) -> FloatArray:
        """Return the statistics of scans."""
        every = zip(scans, self.bases, self.sensors, strict=True)
        return np.concatenate([_statistics(s.without_drive(own.drive), b) for s, b, own in every])


def knowledge(
    found: Population, parameters: FloatArray, prior: Prior, sensors: tuple[Sensor, ...],
    seed: int = 3,
) -> Knowledge:  # fmt: skip
    """Return what a population says; structures with a run that failed are left out.

    Args:
        found: the specimens of `specimens_of`.
        parameters: of the structures, shape (n, 3) [m].
        prior: from which they were drawn.
        sensors: of each frequency.
        seed: of the noise.
    """
    n = len(parameters)
    numbers = np.arange(len(found.specimens)).reshape(-1, n)
    whole = np.isfinite(found.rms[numbers]).all(axis=0)
    rng = np.random.default_rng(seed)
    columns, bases = [], []
    for row, own in zip(numbers, sensors, strict=True):
        noisy = [
            found.shapes(int(k), own.noise_db, rng, own.n_lines).without_drive(own.drive)
            for k in row[whole]
        ]
        bases.append(_basis(np.stack([_profile(shapes) for shapes in noisy])))
        columns.append(np.stack([_statistics(shapes, bases[-1]) for shapes in noisy]))
    frequencies = tuple(found.specimens[row[0]].frequency for row in numbers)
    table = Table(parameters[whole], np.concatenate(columns, axis=1), prior.bounds)
    return Knowledge(table, tuple(bases), frequencies, sensors)


def edges(parameters: FloatArray) -> FloatArray:
    """Return start, end and depth for middle, length and depth, shape (n, 3) [m]."""
    middle, length, depth = parameters.T
    return np.stack([middle - 0.5 * length, middle + 0.5 * length, depth], axis=1)


def edge_posterior(posterior: Posterior) -> Posterior:
    """Return the posterior of start, end and depth."""
    return Posterior(edges(posterior.samples), posterior.weights)


def _profile(shapes: Shapes) -> FloatArray:
    """Return the 2f-curvature over its largest value, shape (n_points,)."""
    values = curvature(shapes).values
    return np.asarray(values / values.max())


def _basis(profiles: FloatArray) -> FloatArray:
    """Return the mean and the principal components of profiles, shape (1 + COMPONENTS, n)."""
    mean = profiles.mean(axis=0)
    _, _, components = np.linalg.svd(profiles - mean, full_matrices=False)
    return np.vstack([mean, components[:COMPONENTS]])


def _statistics(shapes: Shapes, basis: FloatArray) -> FloatArray:
    """Return the statistics of one scan, shape (COMPONENTS + 5,)."""
    called = mark("curvature", shapes)
    sizes = [np.sqrt(np.mean(np.abs(shapes.order(k)) ** 2)) for k in (1.0, 2.0)]
    largest = float((called.index.values / called.index.limits).max())
    start, end = (called.start, called.end) if called.is_detected else (0.0, shapes.x[-1])
    numbers = [start, end, np.log(largest), np.log(sizes[1] / sizes[0]), np.log(sizes[0])]
    return np.concatenate([basis[1:] @ (_profile(shapes) - basis[0]), numbers])

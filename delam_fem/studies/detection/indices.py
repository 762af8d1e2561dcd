"""Damage indices along a beam or on a plate with limits of noise, and what they mark.

Each index is one number per point. Its limit is the value that noise alone exceeds anywhere on the
structure with a given probability, the false-call rate. On a beam an interval is marked, on a plate
a region (`region.py`).

`sideband_ratio` is a number of a point under two excitations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.special import fdtri

from delam_fem.api import BoolArray, FloatArray
from delam_fem.studies.detection.region import Region, marked_region
from delam_fem.studies.signals.scan import Shapes, amplitudes

FALSE_CALLS = 0.01
"""Share of intact beams that noise may call damaged. It lies below the promised 5 %, to hold with a
margin in a count of 200."""

_MANY = 1e9
"""Number of lines that is as good as infinitely many."""


SHARE = 0.3
"""Share of its largest value above which an index is marked. Chosen: healthy points beside a strong
index stay unmarked where the contrast is above 1/0.3."""
_ROUND_OFF = 1e-9
"""Relative to the last place: ends that differ by less are one."""


@dataclass(frozen=True)
class Mark:
    """Values of an index, their limits, and what they mark.

    A point is marked where the index exceeds its limit and 30 % of its largest value. On a beam an
    interval runs from the first marked point to the last: what lies between is filled.

    Attributes:
        x: positions of the points, shape (n,) [m].
        values: values of the index, shape (n,).
        limits: what noise alone seldom exceeds anywhere on the structure, shape (n,).
        z: positions across a plate, shape (n,) [m]; None: along a beam.
    """

    x: FloatArray
    values: FloatArray
    limits: FloatArray
    z: FloatArray | None = None

    @cached_property
    def region(self) -> Region:
        """The marked region of a plate, without holes.

        Raises:
            ValueError: the points are along a beam.
        """
        if self.z is None:
            raise ValueError("region: expected points on a plate")
        return marked_region(self.x, self.z, self.values / self.levels)

    @property
    def levels(self) -> FloatArray:
        """What the index of a marked point exceeds, shape (n,)."""
        return np.maximum(self.limits, SHARE * self.values.max())

    @property
    def is_over(self) -> BoolArray:
        """Whether the index of each point exceeds its limit, shape (n,)."""
        return np.asarray(self.values > self.limits)

    @property
    def is_marked(self) -> BoolArray:
        """Whether each point is marked, shape (n,)."""
        return np.asarray((self.values > SHARE * self.values.max()) & self.is_over)

    @property
    def is_detected(self) -> bool:
        """Whether the index exceeds the limit of noise somewhere."""
        return bool(self.is_marked.any())

    @property
    def start(self) -> float:
        """The first marked point [m]; NaN: there is none."""
        return float(min(self.x[self.is_marked], default=math.nan))

    @property
    def end(self) -> float:
        """The last marked point [m]; NaN: there is none."""
        return float(max(self.x[self.is_marked], default=math.nan))

    @property
    def over_limits(self) -> FloatArray:
        """The values over their limits, shape (n,)."""
        return self.values / self.limits

    def contrast(self, start: float, end: float) -> float:
        """Return the largest value within a true interval over the largest outside it [-].

        Points on the edges count as inside. NaN if there is no point outside or none inside.
        """
        slack = _ROUND_OFF * float(self.x[-1])
        return self.contrast_of((self.x >= start - slack) & (self.x <= end + slack))

    def contrast_of(self, inside: BoolArray) -> float:
        """Return the largest value within a true delamination over the largest outside it [-].

        NaN if there is no point outside or none inside.

        Args:
            inside: whether each point is within it, shape (n,).
        """
        if inside.all() or not inside.any():
            return math.nan
        return float(self.values[inside].max() / self.values[~inside].max())


def curvature(shapes: Shapes, false_calls: float = FALSE_CALLS, order: float = 2.0) -> Mark:
    """Return the index |V''| of the complex shape at twice the excitation, by second differences.

    On a plate it is the Laplacian. Its unit is that of the field over m². Points at the ends or
    edges have no value and are left out.

    Source: A. K. Pandey, M. Biswas, M. M. Samman, "Damage detection from changes in curvature mode
    shapes", J. Sound Vib. 145 (1991), for modes; here the shape is that of the second harmonic.
    """
    bending = shapes.bending
    values = np.abs(bending.matrix @ shapes.order(order))
    noise = np.broadcast_to(shapes.noise, shapes.x.shape)
    squares_of_weights = bending.matrix.power(2)
    power = squares_of_weights @ noise**2
    # a sum of estimated noises varies less than one: effective lines (Satterthwaite)
    squares = squares_of_weights.power(2) @ noise**4
    share = np.divide(power**2, squares, out=np.ones_like(power), where=squares > 0.0)
    n_lines = shapes.n_lines * share
    limits = np.sqrt(power) * _largest_of_noise(1, n_lines, values.size, false_calls)
    z = None if shapes.z is None else shapes.z[bending.points]
    return Mark(shapes.x[bending.points], values, limits, z)


def magnitude(shapes: Shapes, false_calls: float = FALSE_CALLS, order: float = 2.0) -> Mark:
    """Return the index |V_k| of an order: 2 and 3 (harmonics), ½ (subharmonic).

    Source: I. Solodov, N. Krohn, G. Busse, "CAN: an example of nonclassical acoustic nonlinearity
    in solids", Ultrasonics 40 (2002), for harmonics and subharmonics of a clapping contact.
    """
    values = np.abs(shapes.order(order))
    limit = shapes.noise * _largest_of_noise(1, shapes.n_lines, values.size, false_calls)
    return Mark(shapes.x, values, np.broadcast_to(limit, values.shape), shapes.z)


def thd(shapes: Shapes, false_calls: float = FALSE_CALLS) -> Mark:
    """Return the total harmonic distortion of each point, sqrt(Σ_{k>1} |V_k|²) / |V_1|.

    Near a node of the fundamental the index is large whatever the harmonics are.

    Source: I. Müller, "Clapping in Delaminated Sandwich-beams due to Forced Oscillations", eq. 2.
    """
    higher = [abs(shapes.order(k)) ** 2 for k in shapes.orders if k > 1.0]
    first = np.maximum(np.abs(shapes.order(1.0)), np.finfo(np.float64).tiny)
    values = np.sqrt(np.sum(higher, axis=0)) / first
    limit = shapes.noise * _largest_of_noise(len(higher), shapes.n_lines, values.size, false_calls)
    return Mark(shapes.x, values, limit / first, shapes.z)


def distortion(shapes: Shapes, false_calls: float = FALSE_CALLS) -> Mark:
    """Return the paper's distortion factor of each point, d = sqrt(1 + THD²) - 1.

    Source: I. Müller, eq. 2 (the 1 is subtracted outside the root).
    """
    thd_mark = thd(shapes, false_calls)
    values, limits = (np.sqrt(1.0 + ratio**2) - 1.0 for ratio in (thd_mark.values, thd_mark.limits))
    return Mark(thd_mark.x, values, limits, thd_mark.z)


INDICES: dict[str, Callable[[Shapes, float], Mark]] = {
    "curvature": curvature,
    "V2": magnitude,
    "V3": partial(magnitude, order=3.0),
    "V1/2": partial(magnitude, order=0.5),
    "distortion": distortion,
    "thd": thd,
}
"""The indices along the beam by name."""


def sideband_ratio(field: FloatArray, times: FloatArray, pump: float, probe: float) -> FloatArray:
    """Return the sideband ratio of each point, shape (point,).

        (|V(probe - pump)| + |V(probe + pump)|) / |V(probe)|

    Two excitations act at once. A contact that the low one (pump) opens and closes modulates the
    motion at the high one (probe): vibro-acoustic modulation.

    Args:
        field: displacement or velocity, shape (time, point).
        times: shape (time,) [s].
        pump: the lower frequency [Hz].
        probe: the higher frequency, no multiple of the lower one [Hz].

    Source: D. Donskoy, A. Sutin, A. Ekimov, "Nonlinear acoustic interaction on contact interfaces
    and its use for nondestructive testing", NDT&E Int. 34 (2001).
    """
    harmonics = [k * pump for k in range(1, 1 + math.ceil(probe / pump) + 1)]
    sizes = np.abs(amplitudes(field, times, [probe, probe - pump, probe + pump, *harmonics]))
    return np.asarray((sizes[1] + sizes[2]) / sizes[0])


def _largest_of_noise(
    n_orders: int, n_lines: float | FloatArray, n: int, false_calls: float
) -> FloatArray:
    """Return what sqrt(Σ |δ|²) / noise exceeds at some of n points at the rate of false calls.

    Σ|δ|² / (n_orders noise²) is distributed as F(2 n_orders, 2 n_lines), since the noise is
    estimated from n_lines lines. Of one order, P(|δ| > t noise) = (1 + t² / n_lines)^(-n_lines),
    with infinitely many lines exp(-t²) (Rayleigh).
    """
    lines = np.minimum(n_lines, _MANY)
    share = -math.expm1(math.log1p(-false_calls) / n)  # at each of n independent points
    if n_orders == 1:
        return np.asarray(np.sqrt(lines * np.expm1(-math.log(share) / lines)))
    return np.asarray(np.sqrt(n_orders * fdtri(2 * n_orders, 2.0 * lines, 1.0 - share)))


CONFIDENCE = 0.95
"""Share of the true ends within their bounds (docs/evidence/calibration.md)."""
_BOUNDS = (0.5 * (1.0 - CONFIDENCE), 0.5 * (1.0 + CONFIDENCE))


@dataclass(frozen=True)
class Repeated:
    """Ends and calls of an index over repeated noise.

    Attributes:
        calls: share of the repetitions that call the beam damaged [-].
        start, end: bounds of the true ends, each of shape (2,) [m]: those of the marks over all
            calls, and a spacing more, since an edge lies between two points.
        middle: medians of start and end, shape (2,) [m].
        regions: marked region of each call on a plate; none on a beam.
    """

    calls: float
    start: FloatArray
    end: FloatArray
    middle: FloatArray
    regions: tuple[Region, ...] = ()

    @property
    def area(self) -> FloatArray:
        """Bounds of the marked area of a plate over all calls, shape (2,) [m2]; NaN: no call."""
        if not self.regions:
            return np.full(2, np.nan)
        return np.asarray(np.quantile([region.area for region in self.regions], _BOUNDS))

    def overlap(self, truth: Region) -> float:
        """Return the median overlap of the marked regions with a true one [-]; NaN: no call."""
        overlaps = [region.overlap(truth, cells=100) for region in self.regions]
        return float(np.median(overlaps)) if overlaps else math.nan


def mark(name: str, shapes: Shapes, false_calls: float = FALSE_CALLS) -> Mark:
    """Return the mark of an index by its name.

    Args:
        name: an index of `INDICES`.
        shapes: shapes of the motion.
        false_calls: rate of calls by noise alone.
    """
    return INDICES[name](shapes, false_calls)


def repeated(
    name: str, shapes: Shapes, noise: float | FloatArray, *, repetitions: int = 200, seed: int = 1
) -> Repeated:
    """Mark shapes again and again with new noise, and return bounds of the ends.

    Args:
        name: an index of `INDICES`.
        shapes: shapes without noise; or measured, whose own noise then counts twice, so that the
            bounds are rather too wide.
        noise: root mean square of the noise of a shape, of all points or of each.
        repetitions: number of repetitions.
        seed: seed of the random numbers.
    """
    rng = np.random.default_rng(seed)
    marks = [
        mark(name, replace(shapes.noisy(noise, rng), noise=noise, n_lines=shapes.n_lines))
        for _ in range(repetitions)
    ]
    called = [index_mark for index_mark in marks if index_mark.is_detected]
    ends = [(index_mark.start, index_mark.end) for index_mark in called]
    shares = (_BOUNDS[0], 0.5, _BOUNDS[1])
    found_ends = np.quantile(ends, shares, axis=0) if ends else np.full((3, 2), np.nan)
    between = np.diff(np.unique(shapes.x)).max()
    bounds = found_ends[[0, 2]] + between * np.array([[-1.0], [1.0]])
    is_plate = shapes.z is not None
    regions = tuple(index_mark.region for index_mark in called) if is_plate else ()
    return Repeated(len(ends) / repetitions, bounds[:, 0], bounds[:, 1], found_ends[1], regions)

"""The motion of points as a scanning vibrometer measures it, and its complex shapes.

The points are a row along a beam, or lie on the surface of a plate, in a grid or anywhere.

A motion is split into its complex shapes at multiples of the excitation's frequency, and its noise.
A field v has shape (time, point). Its shape of order k is V_k in

    v(t, x) = c(x) + Σ_k Re( V_k(x) exp(2πi k f t) ) + noise                                   (D1)

for k = ½, 1, 2, …; it follows by least squares. With whole periods that is the Fourier sum. Noise
adds to each V a complex normal number; its mean square E|δV|² is measured between the harmonics.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from delam_fem.api import (
    Case,
    CaseError,
    FloatArray,
    IntArray,
    Layout,
    Place,
    Recorder,
    Structure,
    frames_of,
    interpolation,
    nodal,
    require,
    scanned_places,
)

_ROUND_OFF = 1e-9


def scan_positions(length: float, spacing: float, first: float = 0.0) -> FloatArray:
    """Return equidistant points from `first` to at most the length, shape (n,) [m].

    Raises:
        CaseError: there are fewer than five points, too few for a shape.
    """
    n = 1 + math.floor((length - first) / spacing + _ROUND_OFF) if spacing > 0.0 else 0
    if first < 0.0 or n < 5:
        raise CaseError(
            f"scan: expected at least 5 points on the length {length:g} m, given a first point at "
            f"{first:g} m and a spacing of {spacing:g} m"
        )
    return np.asarray(np.minimum(first + spacing * np.arange(n), length))


def surface_of(case: Case, lamina: str | None) -> str:
    """Return the name of the lamina that is scanned: the given one, or the thinner outermost."""
    return lamina or case.outer_lamina.name


def part_of(layout: Layout, lamina: str) -> int:
    """Return the number of the lamina of a given name.

    Raises:
        CaseError: there is none of this name.
    """
    require(lamina in layout.names, "scan: lamina", f"one of {', '.join(layout.names)}", lamina)
    return layout.names.index(lamina)


Points = FloatArray | tuple[Place, ...]
"""Positions along a beam, shape (n,) [m], or places on a plate."""


def points_of(case: Case, spacing: float, first: float = 0.0) -> Points:
    """Return the points of the scan of a case: of a beam equidistant, of a plate those of [scan].

    Args:
        case: the case.
        spacing: distance of the points along a beam [m].
        first: position of the first point on a beam [m].

    Raises:
        CaseError: there are too few points, or those of a plate cannot be used.
    """
    if case.scan is not None:
        return scanned_places(case)
    return scan_positions(case.length, spacing, first)


def positions_of(points: Points) -> tuple[FloatArray, FloatArray | None]:
    """Return x of points, and z on a plate, otherwise None, shape (n,) each [m]."""
    if isinstance(points, tuple):
        x, z = np.array([(place.x, place.z) for place in points]).T
        return x, z
    return points, None


def scan_field(
    recorder: Recorder, structure: Structure, lamina: str, points: Points
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the motion of points at the frames of the window, in the fixed frame.

    Args:
        recorder: recorder after a run that kept frames.
        structure: structure that moved.
        lamina: name of the lamina on whose surface the points are.
        points: the points.

    Returns:
        Times [s], shape (k,), displacements [m] and velocities [m/s], each of shape (k, n).
    """
    frames = frames_of(recorder)
    of_kinds = zip(np.array(frames.states).swapaxes(0, 1), frames.base.T, strict=True)
    u, v = (at_points(structure, lamina, points, *of_kind) for of_kind in of_kinds)
    return frames.steps * recorder.time_step, u, v


def at_points(
    structure: Structure, lamina: str, points: Points, vectors: FloatArray, base: FloatArray
) -> FloatArray:
    """Return the motion of points on a lamina, shape (k, n).

    Args:
        structure: structure that moves.
        lamina: name of the lamina; places on a plate say it themselves.
        points: the points.
        vectors: values of the free dofs, shape (k, n_dofs).
        base: values of the base, shape (k,).
    """
    if isinstance(points, tuple):
        layout = structure.layout
        return np.asarray(layout.read(vectors, base)[:, layout.numbers_of(points)])
    x = points
    number = part_of(structure.layout, lamina)
    part = structure.layout.parts[number]
    cells, weights = interpolation(part, np.interp(x, part.x, np.arange(part.x.size)))
    u, phi = (component[number] for component in nodal(structure.layout, vectors, base))
    ends = np.stack([u[:, cells], phi[:, cells], u[:, cells + 1], phi[:, cells + 1]])
    return np.asarray(np.einsum("ekn,ne->kn", ends, weights))


ComplexArray = npt.NDArray[np.complex128]

ORDERS = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Orders of the shapes: half the excitation, the excitation, its harmonics."""
LEAST_PERIODS = 4
"""Fewest periods that can tell noise from harmonics."""
_BAND = (1.5, 2.5)
"""Orders between which the noise is measured."""
_FITS = 20
"""Fits with new weights of the harmonics of the drive."""
_TINY = float(np.finfo(np.float64).tiny) ** 0.25
"""Noise of a field that has none."""


NEIGHBOURS = 9
"""Points to which the Laplacian of a plate is fitted: a point of a grid and the eight around it."""
SURROUNDED = 0.35
"""Largest distance of a point from the mean of its neighbours, in their mean distance: beyond it,
as at edges of the scan, they lie on one side, and the fit is extrapolated."""


@dataclass(frozen=True)
class Bending:
    """Second differences of values at points.

    Attributes:
        points: numbers of the points that have one, shape (m,).
        matrix: weights of all points in each of them, CSR (m, n) [1/m2].
    """

    points: IntArray
    matrix: sp.csr_matrix


def along_beam(x: FloatArray) -> Bending:
    """Return the second differences of a row of points; those at the ends have none.

        V''(x_j) = 2 (V_{j-1} / (h₁ (h₁+h₂)) - V_j / (h₁ h₂) + V_{j+1} / (h₂ (h₁+h₂)))

    Args:
        x: positions, increasing, shape (n,) [m].
    """
    h1, h2 = np.diff(x)[:-1], np.diff(x)[1:]
    weights = 2.0 / np.stack([h1 * (h1 + h2), -h1 * h2, h2 * (h1 + h2)])
    matrix = sp.diags(weights, [0, 1, 2], shape=(x.size - 2, x.size), format="csr")
    return Bending(np.arange(1, x.size - 1), matrix)


def on_plate(x: FloatArray, z: FloatArray) -> Bending:
    """Return the Laplacian of points on a plate: that of a quadratic fitted to their neighbours.

    The fit is of least squares to the point and the eight nearest to it. In a grid these are the
    points around it, and the Laplacian has a fifth of the noise power of that of five points.
    Points that neighbours do not surround have none.

    Args:
        x: positions along, shape (n,) [m].
        z: positions across, shape (n,) [m].
    """
    from scipy.spatial import cKDTree  # here: every worker of a sweep imports this module

    at = np.stack([x, z], axis=1)
    scale = _grid_steps(at)
    distance, near = cKDTree(at / scale).query(at / scale, k=min(NEIGHBOURS, x.size))
    away = at[near] - at[:, None]
    size = np.sqrt(np.mean(away**2, axis=(1, 2)))[:, None]
    u, w = np.moveaxis(away / size[..., None], -1, 0)
    columns = np.stack([np.ones_like(u), u, w, u**2, u * w, w**2], axis=-1)
    fits = np.linalg.pinv(columns)
    laplacian = 2.0 * (fits[:, 3] + fits[:, 5]) / size**2
    offset = np.linalg.norm((away / scale).mean(axis=1), axis=1)
    is_inside = offset < SURROUNDED * distance[:, 1:].mean(axis=1)
    is_inside &= np.linalg.matrix_rank(columns) == columns.shape[-1]
    chosen = np.flatnonzero(is_inside)
    rows = np.repeat(np.arange(chosen.size), near.shape[1])
    entries = laplacian[chosen].ravel(), (rows, near[chosen].ravel())
    return Bending(chosen, sp.csr_matrix(entries, shape=(chosen.size, x.size)))


@lru_cache(maxsize=4)
def _bending(x: bytes, z: bytes | None) -> Bending:
    """Return the second differences of points, which shapes with other noise share.

    Args:
        x: positions along, as bytes of an array.
        z: the same across a plate; None: along a beam.
    """
    along = np.frombuffer(x)
    return along_beam(along) if z is None else on_plate(along, np.frombuffer(z))


def _grid_steps(at: FloatArray) -> FloatArray:
    """Return the distances of points of a grid along both axes, of others 1 and 1, shape (2,) [m].

    In these units the cells of a grid are squares, so that diagonal neighbours count as near.

    Args:
        at: x and z of the points, shape (n, 2) [m].
    """
    along, across = (np.unique(np.round(values, 9)) for values in at.T)
    is_grid = 2 < along.size and 2 < across.size and along.size * across.size <= 2 * len(at)
    if not is_grid:
        return np.ones(2)
    return np.array([np.median(np.diff(along)), np.median(np.diff(across))])


@dataclass(frozen=True)
class Shapes:
    """The shapes of a motion at the points of a scan.

    Attributes:
        x: positions of the points, increasing along a beam, shape (n,) [m].
        frequency: frequency f of the excitation [Hz].
        orders: order k of each shape.
        values: V_k in the unit of the field, complex, shape (n_orders, n).
        noise: root mean square of |δV|, the same for all orders, of all points or of each, shape
            () or (n,), in the same unit.
        n_lines: number of frequencies between the orders from which the noise was estimated; inf:
            the noise is known.
        z: positions of the points across a plate, shape (n,) [m]; None: along a beam.
    """

    x: FloatArray
    frequency: float
    orders: tuple[float, ...]
    values: ComplexArray
    noise: float | FloatArray = 0.0
    n_lines: float = math.inf
    z: FloatArray | None = None

    @cached_property
    def bending(self) -> Bending:
        """Second differences of the points: along a beam, or the Laplacian on a plate."""
        return _bending(self.x.tobytes(), None if self.z is None else self.z.tobytes())

    def order(self, k: float) -> ComplexArray:
        """Return the shape V_k of order k, shape (n,).

        Raises:
            ValueError: there is no such order.
        """
        return np.asarray(self.values[self.orders.index(k)])

    def without_drive(self, responses: Mapping[float, ComplexArray]) -> Shapes:
        """Return these shapes without the linear response to harmonics of the drive itself.

        A drive that distorts adds c R_k(x) to V_k, with the linear response R_k and one unknown c.
        It is fitted to the curvature, or Laplacian, by the smallest sum of magnitudes (least
        squares with new weights in each pass): a delamination bends few points, which then hardly
        count.

        Args:
            responses: R_k, shape (n,), by order.
        """
        values = self.values.copy()
        matrix = self.bending.matrix
        noise = np.broadcast_to(self.noise, self.x.shape)
        least = np.sqrt(matrix.power(2) @ noise**2) + _TINY
        for k, response in responses.items():
            if k not in self.orders:
                continue
            row = self.orders.index(k)
            curvature = matrix @ self.values[row]
            drive_curvature = matrix @ response
            weights = 1.0 / least**2
            for _ in range(_FITS):
                c = np.sum(weights * drive_curvature.conj() * curvature) / np.sum(
                    weights * np.abs(drive_curvature) ** 2
                )
                weights = 1.0 / (least * np.maximum(np.abs(curvature - c * drive_curvature), least))
            values[row] -= c * response
        return replace(self, values=values)

    def noisy(
        self, noise: float | FloatArray, rng: np.random.Generator, n_lines: float = math.inf
    ) -> Shapes:
        """Return these shapes with more noise, whose root mean square is known or is estimated.

        Args:
            noise: root mean square of the noise that is added.
            rng: generator of random numbers.
            n_lines: number of frequencies from which the noise of each point is estimated.
        """
        parts = rng.normal(scale=noise / math.sqrt(2.0), size=(2, *self.values.shape))
        values = self.values + parts[0] + 1j * parts[1]
        known = np.hypot(self.noise, noise)
        if n_lines < math.inf:
            known = known * np.sqrt(rng.gamma(n_lines, 1.0 / n_lines, size=self.x.size))
        return replace(self, values=values, noise=known, n_lines=n_lines)


def amplitudes(field: FloatArray, times: FloatArray, frequencies: Sequence[float]) -> ComplexArray:
    """Return the complex amplitudes of a field at given frequencies, by least squares (D1).

    Args:
        field: samples, shape (time, point).
        times: times of the samples, in any spacing, shape (time,) [s].
        frequencies: frequencies above 0 and different from one another [Hz].

    Returns:
        Shape (n_frequencies, point).

    Raises:
        CaseError: a number of the field is not finite: no index would exceed a limit then.
    """
    if not (np.size(field) and np.isfinite(field).all()):
        raise CaseError(
            "shapes: expected samples that are finite numbers, given "
            f"{np.count_nonzero(~np.isfinite(field))} others among {np.size(field)}"
        )
    phases = 2.0 * math.pi * np.outer(times, frequencies)
    columns = np.concatenate([np.ones((len(times), 1)), np.cos(phases), np.sin(phases)], axis=1)
    solution = np.linalg.lstsq(columns, field, rcond=None)[0]
    n = len(frequencies)
    return np.asarray(solution[1 : n + 1] - 1j * solution[n + 1 :])


def shapes_of(
    field: FloatArray,
    times: FloatArray,
    frequency: float,
    x: FloatArray,
    orders: tuple[float, ...] = ORDERS,
    z: FloatArray | None = None,
) -> Shapes:
    """Return the complex shapes of a field at orders of the excitation, and the noise on them.

    The noise of each point is the mean at frequencies between 1.5 f and 2.5 f that belong to no
    order.

    Args:
        field: displacement or velocity, shape (time, point).
        times: times of the samples, shape (time,) [s].
        frequency: frequency f of the excitation [Hz].
        x: positions of the points, shape (point,) [m].
        orders: orders of the shapes; those above half the sampling rate are left out.
        z: positions of the points across a plate, shape (point,) [m]; None: along a beam.

    Raises:
        ValueError: the record is shorter than four periods.
    """
    step = float(np.median(np.diff(times)))
    n_periods = math.floor((times[-1] - times[0] + 1.001 * step) * frequency)
    if n_periods < LEAST_PERIODS:
        raise ValueError(
            f"shapes: expected a record of at least {LEAST_PERIODS} periods of {frequency:g} Hz, "
            f"given {n_periods}"
        )
    used_orders = tuple(k for k in orders if k * frequency < 0.5 / step)
    between = [
        j / n_periods
        for j in range(1, 4 * n_periods)
        if _BAND[0] < j / n_periods < _BAND[1] and j != 2 * n_periods
    ]
    fitted = amplitudes(field, times, [k * frequency for k in (*used_orders, *between)])
    values, noise_lines = fitted[: len(used_orders)], fitted[len(used_orders) :]
    noise = np.sqrt(np.mean(np.abs(noise_lines) ** 2, axis=0))
    return Shapes(x, frequency, used_orders, values, noise, len(between), z)

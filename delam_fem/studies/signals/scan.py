"""The motion of a row of points as a scanning vibrometer measures it, and its complex shapes.

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

import numpy as np
import numpy.typing as npt

from delam_fem.api import (
    Case,
    CaseError,
    FloatArray,
    Layout,
    Recorder,
    Structure,
    frames_of,
    interpolation,
    nodal,
    require,
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
    outermost = (case.lamina[-1], case.lamina[0])
    return lamina or min(outermost, key=lambda own: own.mean("thickness") or math.inf).name


def part_of(layout: Layout, lamina: str) -> int:
    """Return the number of the lamina of a given name.

    Raises:
        CaseError: there is none of this name.
    """
    require(lamina in layout.names, "scan: lamina", f"one of {', '.join(layout.names)}", lamina)
    return layout.names.index(lamina)


def scan_field(
    recorder: Recorder, structure: Structure, lamina: str, x: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the motion of points at the frames of the window, in the fixed frame.

    Args:
        recorder: recorder after a run that kept frames.
        structure: structure that moved.
        lamina: name of the lamina on whose surface the points are.
        x: positions of the points, shape (n,) [m].

    Returns:
        Times [s], shape (k,), displacements [m] and velocities [m/s], each of shape (k, n).
    """
    frames = frames_of(recorder)
    of_kinds = zip(np.array(frames.states).swapaxes(0, 1), frames.base.T, strict=True)
    u, v = (at_points(structure, lamina, x, *of_kind) for of_kind in of_kinds)
    return frames.steps * recorder.time_step, u, v


def at_points(
    structure: Structure, lamina: str, x: FloatArray, vectors: FloatArray, base: FloatArray
) -> FloatArray:
    """Return the motion of points on a lamina, shape (k, n).

    Args:
        structure: structure that moves.
        lamina: name of the lamina.
        x: positions of the points, shape (n,) [m].
        vectors: values of the free dofs, shape (k, n_dofs).
        base: values of the base, shape (k,).
    """
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


@dataclass(frozen=True)
class Shapes:
    """The shapes of a motion along a row of points.

    Attributes:
        x: positions of the points, increasing, shape (n,) [m].
        frequency: frequency f of the excitation [Hz].
        orders: order k of each shape.
        values: V_k in the unit of the field, complex, shape (n_orders, n).
        noise: root mean square of |δV|, the same for all orders, of all points or of each, shape
            () or (n,), in the same unit.
        n_lines: number of frequencies between the orders from which the noise was estimated; inf:
            the noise is known.
    """

    x: FloatArray
    frequency: float
    orders: tuple[float, ...]
    values: ComplexArray
    noise: float | FloatArray = 0.0
    n_lines: float = math.inf

    def order(self, k: float) -> ComplexArray:
        """Return the shape V_k of order k, shape (n,).

        Raises:
            ValueError: there is no such order.
        """
        return np.asarray(self.values[self.orders.index(k)])

    def without_drive(self, responses: Mapping[float, ComplexArray]) -> Shapes:
        """Return these shapes without the linear response to harmonics of the drive itself.

        A drive that distorts adds c R_k(x) to V_k, with the linear response R_k and one unknown c.
        It is fitted to the second differences by the smallest sum of magnitudes (least squares with
        new weights in each pass): a delamination bends few points, which then hardly count.

        Args:
            responses: R_k, shape (n,), by order.
        """
        values = self.values.copy()
        for k, response in responses.items():
            if k not in self.orders:
                continue
            row = self.orders.index(k)
            curvature = np.diff(self.values[row], 2)
            drive_curvature = np.diff(response, 2)
            noise = np.broadcast_to(self.noise, self.x.shape)
            least = np.hypot(np.hypot(noise[:-2], noise[2:]), 2.0 * noise[1:-1]) + _TINY
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
    return Shapes(x, frequency, used_orders, values, noise, len(between))

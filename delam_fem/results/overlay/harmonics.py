"""Harmonics of noisy samples by least squares: amplitudes, what repeats, what does not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.harmonics import total_harmonic_distortion

ComplexArray = npt.NDArray[np.complex128]

MOST = 40
"""Largest number of harmonics of the drive that is fitted."""
SAMPLES_PER_UNKNOWN = 4
"""Fewest samples for each fitted number."""
BELOW_NYQUIST = 0.9
"""Share of Nyquist's frequency up to which harmonics are fitted."""
NEIGHBOURHOOD = 0.1
"""Relative range about the drive's frequency in which the measured one is looked for."""
CLEAR = 2.0
"""Amplitudes of noise above which a harmonic is taken for one of the motion."""
FEWEST_PERIODS = 3.0
"""Periods of a record below which its frequency cannot be told from that of the drive."""


@dataclass(frozen=True)
class HarmonicFit:
    """The periodic part of a history.

    Attributes:
        mean: of the history.
        coefficients: complex amplitudes c_k of Re c_k exp(2 pi i k f t / p), k = 1, 2, …
        frequency: f / p, the lowest frequency [Hz].
        multiple: p, the periods of the drive after which the motion repeats.
        noise: standard deviation of what does not repeat.
        n_samples: number of samples of the fit.
    """

    mean: float
    coefficients: ComplexArray
    frequency: float
    multiple: int
    noise: float
    n_samples: int

    def at(self, time: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the periodic part, or a derivative of it, at instants."""
        orders = 1j * 2.0 * np.pi * self.frequency * np.arange(1, self.coefficients.size + 1)
        terms = self.coefficients * orders**derivative
        value: FloatArray = np.real(np.exp(np.outer(time, orders)) @ terms)
        value += 0.0 if derivative else self.mean
        return value

    def clear(self) -> HarmonicFit:
        """Return the fit without the harmonics that noise may have made."""
        is_clear = np.abs(self.coefficients) > CLEAR * self.floor
        return replace(self, coefficients=np.where(is_clear, self.coefficients, 0.0))

    @property
    def amplitudes(self) -> FloatArray:
        """Amplitudes A_1, A_2, … of the harmonics of the drive."""
        sizes: FloatArray = np.abs(self.coefficients[self.multiple - 1 :: self.multiple])
        return sizes

    @property
    def floor(self) -> float:
        """Root mean square amplitude that the noise alone gives a harmonic: 2 sigma / sqrt(n)."""
        return 2.0 * self.noise / float(np.sqrt(self.n_samples))

    def distortion(self) -> tuple[float, float]:
        """Return the distortion factor d without the noise's share, and its standard deviation.

        d = sqrt(1 + THD^2) - 1. Noise adds (2 sigma)^2 / n to each squared amplitude.
        """
        a, extra = self.amplitudes, self.floor**2
        if not a.size or a[0] <= 0.0:
            return float("nan"), float("nan")
        higher = np.sqrt(max(float((a[1:] ** 2).sum()) - extra * (a.size - 1), 0.0))
        d = np.sqrt(1.0 + float(total_harmonic_distortion(np.array([a[0], higher]))) ** 2) - 1.0
        spread = np.sqrt(2.0 * extra * higher**2 + extra**2 * (a.size - 1))
        return float(d), float(spread / (2.0 * a[0] ** 2 * (1.0 + d)))


def fitted(time: FloatArray, values: FloatArray, frequency: float, multiple: int) -> HarmonicFit:
    """Return the periodic part of a history by least squares.

    Args:
        time: of the samples [s], shape (n,).
        values: shape (n,).
        frequency: of the drive [Hz].
        multiple: periods of the drive after which the motion repeats.
    """
    lowest, n = frequency / multiple, time.size
    rate = (n - 1) / (time[-1] - time[0])
    n_orders = min(
        MOST * multiple,
        int(BELOW_NYQUIST * 0.5 * rate / lowest),
        (n // SAMPLES_PER_UNKNOWN - 1) // 2,
    )
    phase = 2.0 * np.pi * lowest * np.outer(time, np.arange(1, max(n_orders, 1) + 1))
    columns = np.hstack([np.ones((n, 1)), np.cos(phase), np.sin(phase)])
    found = np.linalg.lstsq(columns, values, rcond=None)[0]
    k = phase.shape[1]
    rest = values - columns @ found
    noise = float(np.sqrt((rest**2).sum() / max(n - 1 - 2 * k, 1)))
    return HarmonicFit(
        float(found[0]), found[1 : k + 1] - 1j * found[k + 1 :], lowest, multiple, noise, n
    )


def strongest_frequency(time: FloatArray, values: FloatArray, lowest: float) -> float | None:
    """Return the frequency at which a measurement moves most.

    Args:
        time: of the samples [s], shape (n,).
        values: histories in one unit, shape (n_channels, n).
        lowest: frequency below which motions are not looked at [Hz].

    Returns:
        The frequency [Hz]; None: the record is too short to tell it.
    """
    even = np.linspace(time[0], time[-1], time.size)
    rows = np.array([np.interp(even, time, row - row.mean()) for row in values])
    power = (np.abs(np.fft.rfft(np.hanning(time.size) * rows)) ** 2).sum(axis=0)
    frequency = np.fft.rfftfreq(time.size, even[1] - even[0])
    strongest = float(frequency[np.argmax(np.where(frequency < lowest, 0.0, power))])
    return drive_frequency(time, values, strongest, 2.0 * frequency[1])


def drive_frequency(
    time: FloatArray, values: FloatArray, expected: float, reach: float | None = None
) -> float | None:
    """Return the frequency near the drive's at which a measurement has its line.

    Args:
        time: of the samples [s], shape (n,).
        values: histories, shape (n_channels, n).
        expected: frequency of the drive [Hz].
        reach: how far from it the line may be [Hz]; None: `NEIGHBOURHOOD`.

    Returns:
        The frequency [Hz]; None: the record is too short, or there is no line near the drive's.
    """
    duration = float(time[-1] - time[0])
    if duration * expected < FEWEST_PERIODS:
        return None
    window = np.hanning(time.size)
    scaled = window * (values - values.mean(axis=1, keepdims=True))
    scaled /= np.maximum(np.abs(scaled).max(axis=1, keepdims=True), np.finfo(float).tiny)

    def power(f: float) -> float:
        return float((np.abs(scaled @ np.exp(-2j * np.pi * f * time)) ** 2).sum())

    reach = reach or min(max(NEIGHBOURHOOD * expected, 2.0 / duration), 0.45 * expected)
    grid = np.arange(expected - reach, expected + reach, 0.25 / duration)
    powers = [power(float(f)) for f in grid]
    k = int(np.argmax(powers))
    if k in (0, len(grid) - 1):
        return None
    best = minimize_scalar(
        lambda f: -power(f), bounds=(grid[k - 1], grid[k + 1]), method="bounded",
        options={"xatol": 1e-7 * expected},
    )  # fmt: skip
    return float(best.x)

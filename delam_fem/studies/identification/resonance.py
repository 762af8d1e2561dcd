"""Identify the first mode of a lamina from a stepped or a swept sine.

A sweep that rises passes the resonance before the amplitude has grown, so its peak comes late; one
that falls is late on the other side. The frequency that is read off the peak is biased by that. The
fit compares the measured amplitudes with the response of the same sweep, so that the bias is gone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares

from delam_fem.case.motion.excitation import BaseMotion
from delam_fem.case.sections import Lamina
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.cantilever import cantilever_roots
from delam_fem.numerics.oscillator import stationary, swept

FIRST_DAMPING = (0.003, 0.01, 0.03)
"""Damping ratios from which the fit starts; the best end counts."""
BAND = 0.3
"""Only frequencies within this share of the peak are fitted: the first mode alone is meant."""
STEPS_OF_DECAY = 20.0
"""Number of steps of the solved response in the time in which the motion decays by e."""
FEWEST = 8
"""Smallest number of amplitudes that can be fitted."""


@dataclass(frozen=True)
class Amplitudes:
    """Amplitudes of a point of a lamina under a base motion of known frequency.

    Attributes:
        frequency: of the base, shape (k,) [Hz].
        amplitude: of the absolute displacement per amplitude of the base, shape (k,) [-].
        time: of each value, increasing, shape (k,) [s]; None: the motions are stationary.
    """

    frequency: FloatArray
    amplitude: FloatArray
    time: FloatArray | None = None

    @property
    def peak(self) -> float:
        """Frequency with the largest amplitude, which is biased in a sweep [Hz]."""
        return float(self.frequency[np.argmax(self.amplitude)])


@dataclass(frozen=True)
class Resonance:
    """A natural frequency with its damping.

    Attributes:
        frequency, frequency_error: undamped natural frequency and its standard error [Hz].
        damping_ratio, damping_error: D and its standard error [-].
        participation: Γ of the point, 1.566 at the tip of a uniform cantilever [-].
        peak: frequency with the largest amplitude, as one reads it off [Hz].
        residual: rms of the differences over the largest amplitude [-].
    """

    frequency: float
    frequency_error: float
    damping_ratio: float
    damping_error: float
    participation: float
    peak: float
    residual: float

    def bending_stiffness(self, lamina: Lamina) -> tuple[float, float]:
        """Return EI of a uniform cantilever with this frequency and its standard error [N m2].

        EI = ρA (2π f L² / B₁²)²
        """
        B = float(cantilever_roots(1)[0])
        rotation = 2.0 * math.pi * self.frequency * lamina.length**2 / B**2
        EI = lamina.mass_per_length * rotation**2
        return EI, 2.0 * EI * self.frequency_error / self.frequency


def demodulated(
    time: FloatArray, displacement: FloatArray, motion: BaseMotion, amplitude: float
) -> Amplitudes:
    """Return the amplitudes of a swept sine, one for each cycle of the base.

    In each cycle a constant and a sine of the phase of the base are fitted. A wrong origin of time
    of some cycles does no harm, since phases are not used.

    Args:
        time: times of the samples since the sweep began, shape (n,) [s].
        displacement: absolute displacement of the point, shape (n,) [m].
        motion: of the base; gives its frequency.
        amplitude: of the base [m].

    Raises:
        CaseError: there are fewer than eight cycles with samples enough.
    """
    frequency = motion.instantaneous_frequency(time)
    step = np.diff(time)
    turns = np.concatenate([[0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1]) * step)])
    edges = np.searchsorted(turns, np.arange(math.floor(turns[-1]) + 1))
    rows = []
    for first, last in pairwise(edges.tolist()):
        if last - first < FEWEST:
            continue
        own = slice(first, last)
        angle = 2.0 * math.pi * turns[own]
        columns = np.stack([np.cos(angle), np.sin(angle), np.ones(last - first)], axis=1)
        cosine, sine, _ = np.linalg.lstsq(columns, displacement[own], rcond=None)[0]
        rows.append((time[own].mean(), frequency[own].mean(), math.hypot(cosine, sine) / amplitude))
    if len(rows) < FEWEST:
        raise CaseError(
            f"swept sine: expected at least {FEWEST} cycles with {FEWEST} samples or more, "
            f"given {len(rows)}"
        )
    t, f, a = np.array(rows).T
    return Amplitudes(f, a, t)


def fit(measured: Amplitudes) -> Resonance:
    """Fit natural frequency, damping ratio and participation to measured amplitudes.

    The standard errors are those of least squares with independent errors of equal size.

    Raises:
        CaseError: there are fewer than eight amplitudes near the peak.
    """
    near = np.abs(measured.frequency - measured.peak) <= BAND * measured.peak
    if np.count_nonzero(near) < FEWEST:
        raise CaseError(
            f"resonance: expected at least {FEWEST} amplitudes within {100 * BAND:.0f} % of the "
            f"peak at {measured.peak:g} Hz, given {np.count_nonzero(near)}"
        )
    amplitude = measured.amplitude[near]

    def difference(p: FloatArray) -> FloatArray:
        return np.asarray(_response(measured, p)[near] - amplitude)

    top = float(amplitude.max())
    found = min(
        (
            least_squares(
                difference, [measured.peak, D, 2.0 * D * top], x_scale=[measured.peak, D, 1.0],
                bounds=([0.0, 1e-5, 0.0], [np.inf, 0.5, np.inf]),
            )
            for D in FIRST_DAMPING
        ),
        key=lambda end: float(end.cost),
    )  # fmt: skip
    variance = 2.0 * found.cost / (amplitude.size - 3)
    error = np.sqrt(variance * np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    f, D, participation = found.x.tolist()
    rms = math.sqrt(2.0 * found.cost / amplitude.size)
    return Resonance(
        f, float(error[0]), D, float(error[1]), participation, measured.peak, rms / top
    )


def response(measured: Amplitudes, found: Resonance) -> FloatArray:
    """Return the amplitudes of a fitted resonance at the measured ones, shape (k,) [-]."""
    return _response(
        measured, np.array([found.frequency, found.damping_ratio, found.participation])
    )


def _response(measured: Amplitudes, p: FloatArray) -> FloatArray:
    """Return the amplitudes of the model, shape (k,), for (frequency [Hz], D, participation)."""
    natural, omega = 2.0 * math.pi * p[0], 2.0 * math.pi * measured.frequency
    if measured.time is None:
        return np.asarray(np.abs(1.0 + stationary(omega, natural, p[1], p[2])))
    t = measured.time
    step = 1.0 / (STEPS_OF_DECAY * p[1] * natural)
    fine = np.linspace(t[0], t[-1], max(t.size, math.ceil((t[-1] - t[0]) / step)))
    relative = swept(fine, np.interp(fine, t, omega), natural, p[1], p[2])
    return np.asarray(np.interp(t, fine, np.abs(1.0 + relative)))

"""`detect scan`: healthy plates.

Exact motions of uniform beams at 40 to 400 Hz, scanned at 39 points with 40 dB.

Bonded plates without a delamination, scanned at 39 points with 40 dB, 16 periods, 50 samples each.
Their motion is the exact one of a uniform beam on (soft) clamps, at frequencies drawn from 40 to
400 Hz. The shaker adds a second harmonic of 1 % of its acceleration, with any phase.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from calibration.row import OWN, Row

import delam_fem as df
from delam_fem.api import FloatArray
from delam_fem.studies.detection.detect import drive_responses, intact
from delam_fem.studies.detection.indices import FALSE_CALLS, mark
from delam_fem.studies.signals.scan import scan_positions, shapes_of, surface_of

PERIODS, SAMPLES, NOISE_DB = 16, 50, 40.0


@dataclass(frozen=True)
class Rig:
    """How a rig differs from the case.

    Attributes:
        stiffness: factor of EI.
        damping: factor of the damping ratio.
        clamp: rotational stiffness of the clamps times L/EI; infinite: rigid.
        speckle: standard deviation of the logarithm of the noise from point to point.
        shaker: second harmonic of the base acceleration over the first.
    """

    stiffness: float = 1.0
    damping: float = 1.0
    clamp: float = np.inf
    speckle: float = 0.0
    shaker: float = 0.0


SHAKING = Rig(shaker=0.01)
RIGS = {
    OWN: Rig(),
    "noise per point (log-normal, σ 0.7)": Rig(speckle=0.7),
    "shaker with 1 % of second harmonic": SHAKING,
    "shaker, EI + 5 %": replace(SHAKING, stiffness=1.05),
    "shaker, EI − 5 %": replace(SHAKING, stiffness=0.95),
    "shaker, soft clamps (k L/EI = 100)": replace(SHAKING, clamp=100.0),
    "shaker, damping × 2": replace(SHAKING, damping=2.0),
    "shaker, damping × ½": replace(SHAKING, damping=0.5),
}


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    truths = 1000 if is_long else 15
    result = []
    for number, (name, rig) in enumerate(RIGS.items()):
        rng = np.random.default_rng([5, number])
        calls = sum(is_called(rig, rng) for _ in range(truths))
        promise = "healthy plate not called (2f-curvature)"
        result.append(Row(promise, name, 1.0 - FALSE_CALLS, truths - calls, truths))
    return result


def is_called(rig: Rig, rng: np.random.Generator) -> bool:
    """Return whether a healthy plate on a rig is called at a random frequency."""
    f = float(rng.uniform(40.0, 400.0))
    x = scan_positions(0.4, 0.01)
    times = np.arange(PERIODS * SAMPLES) / (SAMPLES * f)
    turn = 2.0j * np.pi * np.outer(times, [f, 2.0 * f])
    second = rig.shaker * np.exp(2j * np.pi * rng.uniform())
    shapes = np.stack([velocity(x, f, rig), second * velocity(x, 2.0 * f, rig)])
    field = np.real(np.exp(turn) @ shapes)
    noise = 10.0 ** (-NOISE_DB / 20.0) * np.sqrt(np.mean(field**2))
    noise = noise * np.exp(rig.speckle * rng.normal(size=x.size))
    field += rng.normal(scale=noise, size=field.shape)
    case = intact(df.preset("embedded", {"excitation.frequency": f, "mesh.elements": 20}))
    responses = drive_responses(case, surface_of(case, None), x, f)
    fitted = shapes_of(field, times, f, x).without_drive(responses)
    return mark("curvature", fitted).is_detected


def velocity(x: FloatArray, frequency: float, rig: Rig) -> npt.NDArray[np.complex128]:
    """Return the absolute velocity per acceleration of the ends of a uniform beam on clamps.

    Between the clamps EI w'''' = m ω² w; at both ends w = w₀ and EI w'' = ± k w'.
    """
    case = df.preset("embedded")
    h = sum(lamina.thickness for lamina in case.lamina)
    L = case.length
    b = case.lamina[0].width
    omega = 2.0 * np.pi * frequency
    mass = case.lamina[0].density * b * h
    damping = 2.0 * case.lamina[0].damping_ratio * rig.damping
    EI = rig.stiffness * case.lamina[0].young_modulus * b * h**3 / 12.0 * (1.0 + 1j * damping)
    k = (mass * omega**2 / EI) ** 0.25
    soft = 0.0 if np.isinf(rig.clamp) else L / rig.clamp  # EI / k_rot

    def terms(s: FloatArray, order: int) -> npt.NDArray[np.complex128]:
        """Return a derivative of cos, sin and of exponentials that decay from both ends."""
        phase = k * s + 0.5 * np.pi * order
        grown = [(-k) ** order * np.exp(-k * s), k**order * np.exp(-k * (L - s))]
        return np.stack([k**order * np.cos(phase), k**order * np.sin(phase), *grown], axis=-1)

    start = np.zeros(1)
    end = np.full(1, L)
    matrix = np.concatenate(
        [
            terms(start, 0), terms(start, 1) - soft * terms(start, 2),
            terms(end, 0), terms(end, 1) + soft * terms(end, 2),
        ]
    )  # fmt: skip
    unit = np.array([1.0, 0.0, 1.0, 0.0]) / -(omega**2)
    return 1j * omega * terms(x, 0) @ np.linalg.solve(matrix, unit)

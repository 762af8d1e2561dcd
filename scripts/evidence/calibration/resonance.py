"""`identify resonance`.

Records of one mode under a swept base, solved exactly: 1.2 … 3.5 Hz, damping ratio 0.004 … 0.02.

Records of one mode of a cantilever (with the quasi-static part of two higher ones) under a swept
base. Each step of each mode is solved exactly by the matrix exponential. Frequency (1.2 … 3.5 Hz),
damping ratio (0.004 … 0.02), the sweep (linear or logarithmic, up or down, 60 … 150 s), its
range, the rate of samples and their noise (0.05 … 0.5 mm) are drawn for each truth. An interval is
the number ± two of its stated errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from calibration.row import OWN, Row
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter, ss2tf

from delam_fem.api import FloatArray, SweptMotion
from delam_fem.studies.identification.resonance import ResonanceFit, fit

AMPLITUDE = 0.0025
TRUTHS = 200
TWO_ERRORS = 0.9545
MODES = ((1.0, 1.0, 1.566), (6.267, 2.0, -0.868), (17.55, 4.0, 0.509))
"""Frequency and damping ratio over those of the first mode, and participation, at the tip."""


@dataclass(frozen=True)
class Rig:
    """How a rig differs from the case.

    Attributes:
        damping: factor of the damping ratio.
        late: largest time by which the record begins after the sweep [s].
        clock: seconds of the sweep in one of the record.
        growing: whether the noise of a sample grows with the motion, up to five times.
        shaker: second harmonic of the base displacement over the first.
        air: whether the damping acts against the absolute velocity.
        second: participation of a second mode 8 % above the first.
    """

    damping: float = 1.0
    late: float = 0.0
    clock: float = 1.0
    growing: bool = False
    shaker: float = 0.0
    air: bool = False
    second: float = 0.0


RIGS = {
    OWN: Rig(),
    "damping × 2": Rig(damping=2.0),
    "damping × ½": Rig(damping=0.5),
    "record begins up to 2 s late": Rig(late=2.0),
    "clock of the record 1 % slow": Rig(clock=1.01),
    "noise grows with the motion": Rig(growing=True),
    "shaker with 1 % of second harmonic": Rig(shaker=0.01),
    "damping against the air": Rig(air=True),
    "two modes 8 % apart": Rig(second=0.4),
}


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    truths = TRUTHS if is_long else 2
    result = []
    for number, (name, rig) in enumerate(RIGS.items()):
        rng = np.random.default_rng([9, number])
        ends = [_trial(rig, rng) for _ in range(truths)]
        warned = sum(bool(one.remarks) for one, _, _ in ends)
        for what, key, k in (("frequency", "frequency", 1), ("damping ratio", "damping_ratio", 2)):
            errors = [getattr(end[0], f"{key.split('_')[0]}_error") for end in ends]
            away = [abs(getattr(end[0], key) - end[k]) for end in ends]
            inside = sum(bool(a < 2.0 * e) for a, e in zip(away, errors, strict=True))
            width = float(np.median([e / end[k] for e, end in zip(errors, ends, strict=True)]))
            result.append(
                Row(f"{what} ± 2 errors", name, TWO_ERRORS, inside, truths, 0, warned,
                    f"median error {width:.1g} of it; something named in {warned}")
            )  # fmt: skip
    return result


def _trial(rig: Rig, rng: np.random.Generator) -> tuple[ResonanceFit, float, float]:
    """Return what is found in a record, and the true frequency [Hz] and damping ratio."""
    f = rng.uniform(1.2, 3.5)
    D = rig.damping * np.exp(rng.uniform(*np.log([0.004, 0.02])))
    ends = f * np.array([rng.uniform(0.5, 0.85), rng.uniform(1.2, 1.6)])
    motion = SweptMotion(
        *(ends if rng.random() < 0.5 else ends[::-1]), rng.uniform(60.0, 150.0), AMPLITUDE,
        logarithmic=rng.random() < 0.5,
    )  # fmt: skip
    late = rng.uniform(0.0, rig.late)
    t = np.arange(0.0, (motion.duration - late) / rig.clock, 1.0 / rng.uniform(60.0, 100.0))
    x = tip(motion, f, D, rig, late + rig.clock * t)
    noise = np.exp(rng.uniform(*np.log([5e-5, 5e-4])))
    sizes = noise * (1.0 + 4.0 * abs(x) / abs(x).max() if rig.growing else 1.0)
    return fit(t, x + sizes * rng.standard_normal(t.size), motion), f, D


def tip(motion: SweptMotion, f: float, D: float, rig: Rig, at: FloatArray) -> FloatArray:
    """Return the absolute displacement of a tip that was at rest before the sweep [m]."""
    h = 1.0 / (300.0 * max(motion.start_frequency, motion.end_frequency))
    t = h * np.arange(int(motion.duration / h) + 2)
    z, speed, acceleration = motion.states(t).T
    second = rig.shaker * motion.amplitude * np.cos(4.0 * np.pi * motion.turns(t))
    z = z + second
    acceleration = acceleration + np.gradient(np.gradient(second, h), h)
    x = z.copy()
    for ratio, more, share in (*MODES, (1.08, 1.0, rig.second)):
        w = 2.0 * np.pi * f * ratio
        d = D * more
        air = 2.0 * d * w if rig.air else 0.0
        force = -acceleration - air * (speed + np.gradient(second, h))
        matrices = (np.array([[0, 1], [-w * w, -2 * d * w]]), np.array([[0.0], [1.0]]))
        exact = cont2discrete((*matrices, np.array([[1.0, 0.0]]), np.zeros((1, 1))), h, "foh")
        b, a = ss2tf(*exact[:4])
        damped = w * np.sqrt(1.0 - d * d)
        jump = motion.states([0.0])[0, 1]  # of the base's velocity as the sweep begins
        x += share * lfilter(b[0], a, force)
        x -= share * jump * np.exp(-d * w * t) * np.sin(damped * t) / damped
    return np.asarray(CubicSpline(t, x)(at))

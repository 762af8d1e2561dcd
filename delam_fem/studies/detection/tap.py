"""Tap along a beam with an impactor, and mark where taps last longer: the coin-tap test.

A defect is a spring k_d behind that of the contact, k_c. A tap then lasts longer than a sound one,

    (T / T₀)² - 1 = k_c / k_d                                                            (tap-1)

which is the index. T₀ is the length of a tap on the structure without delaminations at the same
place, times the median of all T / T₀: what taps differ in everywhere, such as another contact, is
no defect.

T is the effective length (∫F dt)² / ∫F² dt of the main pulse, which ends where the force has fallen
to a tenth of its largest value. Of half a sine it is 8/π² of its length.

Source: P. Cawley, R. D. Adams, "The mechanics of the coin-tap method of non-destructive testing",
J. Sound Vib. 122 (1988).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from delam_fem.api import (
    Case,
    CaseError,
    Finding,
    FloatArray,
    Report,
    RunContext,
    assemble,
    require,
    run,
)
from delam_fem.studies.detection.detect import beside_intact, intact, read_field
from delam_fem.studies.detection.indices import FALSE_CALLS, Mark
from delam_fem.studies.detection.study import Tap
from delam_fem.studies.signals.scan import scan_positions, surface_of

FALLEN = 0.1
"""Share of the largest force at which the main pulse ends: above noise of 20 dB, and before the
rebound that may follow."""
LEAST = 0.015
"""Index that a model whose stiffness is wrong by 10 % explains on sound places (seen: 0.014)."""
_REPETITIONS = 200


def lengths(force: FloatArray, times: FloatArray) -> FloatArray:
    """Return the effective length of the main pulse of each tap, shape (point,) [s].

    Args:
        force: forces of the taps, shape (time, point) [N].
        times: equidistant times, shape (time,) [s].
    """
    step = float(times[1] - times[0])
    durations = np.empty(force.shape[1])
    for k, tap in enumerate(force.T):
        peak = int(tap.argmax())
        # the pulse lies between the last low sample before the peak and the first one after it
        fallen = np.flatnonzero(tap < FALLEN * tap[peak])
        first = fallen[fallen < peak].max(initial=-1) + 1
        last = fallen[fallen > peak].min(initial=tap.size)
        pulse = tap[first:last]
        durations[k] = step * pulse.sum() ** 2 / np.sum(pulse**2)
    return durations


def index(lengths: FloatArray, sound: FloatArray) -> FloatArray:
    """Return the index k_c / k_d of each tap by tap-1, shape (…, point)."""
    ratios = lengths / sound
    return np.asarray((ratios / np.median(ratios, axis=-1, keepdims=True)) ** 2 - 1.0)


def noisy(forces: FloatArray, noise_db: float, rng: np.random.Generator) -> FloatArray:
    """Return forces with white noise, `noise_db` [dB] below the largest force of each tap."""
    scale = 10.0 ** (-noise_db / 20.0) * forces.max(axis=0)
    return np.asarray(forces + rng.normal(scale=scale, size=forces.shape))


def limits(
    sound: FloatArray, times: FloatArray, noise_db: float, rng: np.random.Generator
) -> FloatArray:
    """Return the limits that noise on sound taps exceeds at some point in 1 % of beams.

    `LEAST` is added to them.

    Args:
        sound: forces of taps without delaminations and noise, shape (time, point) [N].
        times: shape (time,) [s].
        noise_db: see `noisy`.
        rng: random numbers of the repetitions.

    Returns:
        Shape (point,) [-].
    """
    again = [lengths(noisy(sound, noise_db, rng), times) for _ in range(_REPETITIONS)]
    values = index(np.array(again), lengths(sound, times))
    typical = values.std(axis=0)
    maxima = (values / typical).max(axis=1)
    return np.asarray(LEAST + typical * np.quantile(maxima, 1.0 - FALSE_CALLS, method="weibull"))


@dataclass(frozen=True)
class Taps(Finding):
    """Taps along a beam, and their index.

    Attributes:
        case: the case that was tapped.
        lamina: name of the lamina that was tapped.
        is_measured: whether the taps come from files.
        lengths: effective lengths of the taps, shape (point,) [s].
        sound: those on the structure without delaminations, without noise, shape (point,) [s].
        mark: index of each tap [-], with its limits on sound places, see `limits`.
        intact_mark: the same without delaminations, with noise of its own.
    """

    case: Case
    lamina: str
    is_measured: bool
    lengths: FloatArray
    sound: FloatArray
    mark: Mark
    intact_mark: Mark

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        x, marked = self.mark.x, self.mark.x[self.mark.is_over]
        start = min(marked, default=math.nan)
        end = max(marked, default=math.nan)
        called = f"marks {start:.4g} to {end:.4g} m" if marked.size else "calls nothing"
        is_intact_called = bool(self.intact_mark.is_over.any())
        verdict = (
            f"{x.size} taps on {self.lamina}: the index {called}; the same structure without "
            f"delamination {'is' if is_intact_called else 'is not'} called."
        )
        numbers = {
            "case": self.case.name,
            "lamina": self.lamina,
            "is_measured": self.is_measured,
            "detected": bool(marked.size),
            "start": float(start),
            "end": float(end),
            "intact_called": is_intact_called,
            "false_call_rate": FALSE_CALLS,
            "x": x.tolist(),
            "length": self.lengths.tolist(),
            "sound_length": self.sound.tolist(),
            "index": self.mark.values.tolist(),
            "intact_index": self.intact_mark.values.tolist(),
            "limits": self.mark.limits.tolist(),
        }
        draw = partial(
            beside_intact, self.case, self.mark, self.intact_mark,
            title=f"{self.case.name}, taps on {self.lamina}", ylabel="added softness k_c / k_d [-]",
        )  # fmt: skip
        return Report(
            name="tap",
            numbers=numbers,
            case=self.case,
            title=f"Taps on {self.case.name}",
            sentences=[verdict],
            pictures={
                "figures/tap": (
                    draw,
                    "Index of each tap, k_c / k_d, and what noise alone exceeds in 1 of 100 beams.",
                )
            },
        )


def taps(case: Case, lamina: str, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return times and forces of taps of the impactor of a case at points, without noise.

    Shapes (time,) [s] and (time, point) [N].

    Raises:
        CaseError: the case has no impactor or several, or a rigid one, or one of the taps never
            touches.
    """
    require(len(case.impactor) == 1, "impactor: tap", "one", len(case.impactor))
    how = "a stiffness or a radius, as rigid blows last no time"
    require(bool(case.impactor[0].elastic_by), "impactor.1: tap", how, "neither")
    sensor = {"name": "tap", "quantity": "contact force", "impactor": 1}
    keys: dict[str, object] = {"sensor": [sensor], "impactor.1.lamina": lamina}
    if case.is_periodic:
        keys |= {"output.window_periods": case.n_periods, "output.fields_per_period": 0}
    forces = []
    times = np.zeros(0)
    for place in x.tolist():
        tapped = case.with_overrides({**keys, "impactor.1.position": place})
        structure = assemble(tapped, needs_dolfinx=False)
        history = run(tapped, engine="compiled", structure=structure).history
        times = history["time"].to_numpy()
        forces.append(history[f"sensor_{sensor['name']}"].to_numpy())
        if not forces[-1].any():
            raise CaseError(
                f"impactor: tap: expected a blow within the run, given none at {place:g} m"
            )
    return times, np.stack(forces, axis=1)


def tap(case: Case, options: Tap, context: RunContext | None = None) -> Taps:
    """Tap a case along a lamina, or read taps, and mark where they last too long.

    Args:
        case: case with delaminations and one impactor.
        options: where to tap, with which noise, or files to read.
        context: not used, because nothing is kept.

    Raises:
        CaseError: the case has not one impactor, or the points do not fit.
    """
    lamina = surface_of(case, options.lamina)
    intact_case = intact(case)
    if options.measured:
        field = read_field(options.measured, options, "force", lamina)
        x = field["position"].to_numpy()
        when = field["time"].to_numpy()
        force = field.to_numpy()
    else:
        x = scan_positions(case.length, options.spacing, options.first)
        x = x[(x > 0.0) & (x < case.length)]
        when, force = taps(case, lamina, x)
    times, without = taps(intact_case, lamina, x)
    sound = lengths(without, times)
    rng = np.random.default_rng(options.seed)
    limit = limits(without, times, options.noise_db, rng)
    if not options.measured:
        force = noisy(force, options.noise_db, rng)
    durations = lengths(force, when)
    one_more = lengths(noisy(without, options.noise_db, rng), times)
    return Taps(
        case,
        lamina,
        bool(options.measured),
        durations,
        sound,
        Mark(x, index(durations, sound), limit),
        Mark(x, index(one_more, sound), limit),
    )

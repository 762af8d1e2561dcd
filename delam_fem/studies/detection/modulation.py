"""Simulate vibro-acoustic modulation: a test along the beam with two excitations at once.

The case gives the high frequency (probe). A low one (pump) of the same kind is added to it. Where
the pump opens and closes a contact, the motion at the probe's frequency is modulated.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.case.excitation import drive
from delam_fem.engines.session import by_period, law_of, modes_of, scheme_of, session, span_of
from delam_fem.model import discretise
from delam_fem.model.layout import Structure
from delam_fem.numerics.types import FloatArray
from delam_fem.results.scan import scan_field, scan_positions, surface_of
from delam_fem.simulation.loop import State
from delam_fem.studies.detection.detect import (
    LEAST_STEPS,
    Measurement,
    beside_intact,
    intact,
    samples_of,
)
from delam_fem.studies.detection.indices import FALSE_CALLS, sideband_ratio
from delam_fem.studies.linear import settling_periods, steady_motion
from delam_fem.studies.options import Modulate, Scan
from delam_fem.studies.study import Finding, Place, Report, Study
from delam_fem.system.errors import CaseError

MOST_TURNS = 1000
"""Largest number of periods of the probe in a common period of both frequencies."""
_REPETITIONS = 200
_INTACT_SEED = 1_000_003


@dataclass(frozen=True)
class Tones:
    """A pump beside the harmonic excitation of a case.

    Attributes:
        probe: case with the high frequency.
        pump: the same case with the low frequency and its amplitude.
    """

    probe: Case
    pump: Case

    @classmethod
    def of(cls, case: Case, frequency: float, amplitude: float) -> Tones:
        """Return the excitation of a case together with a pump.

        Args:
            case: case whose harmonic excitation is the probe.
            frequency: frequency of the pump [Hz].
            amplitude: amplitude of the pump in the unit of that of the case: m, m/s2 or N.

        Raises:
            CaseError: the excitation is not harmonic, or the frequencies do not go together.
        """
        if not case.is_periodic or case.excitation.length is not None:
            raise CaseError("modulate: expected a harmonic excitation, given another kind")
        probe = case.excitation.top_frequency
        if not 0.0 < frequency < probe or (probe / frequency).is_integer():
            raise CaseError(
                f"pump frequency: expected one below the excitation's {probe:g} Hz that does not "
                f"divide it, given {frequency:g} Hz"
            )
        is_shaken = getattr(case.excitation, "acceleration", None) is not None
        size = "acceleration" if is_shaken else "amplitude"
        keys = {"excitation.frequency": frequency, f"excitation.{size}": amplitude}
        tones = cls(case, case.with_overrides(keys))
        if tones.turns > MOST_TURNS:
            raise CaseError(
                f"pump frequency: expected a common period with {probe:g} Hz of at most "
                f"{MOST_TURNS} of its periods, given {tones.turns}; choose rounder frequencies"
            )
        return tones

    @property
    def frequencies(self) -> tuple[float, float]:
        """Frequencies of pump and probe [Hz]."""
        return self.pump.excitation.top_frequency, self.probe.excitation.top_frequency

    @property
    def turns(self) -> int:
        """Number of periods of the probe in a common period of both excitations."""
        pump, probe = (Fraction(str(f)) for f in self.frequencies)
        return (probe / pump).numerator

    def states(self, times: FloatArray) -> FloatArray:
        """Return the sum of both excitations with two derivatives, shape (k, 3)."""
        return drive(self.pump).states(times) + drive(self.probe).states(times)

    def intact(self) -> Tones:
        """Return the same excitations of the structure without delaminations."""
        return Tones(intact(self.probe), intact(self.pump))

    def start(self, structure: Structure) -> State | None:
        """Return the steady motion of the closed structure under both excitations at t = 0."""
        parts = [steady_motion(case, structure) for case in (self.pump, self.probe)]
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        return replace(known[0], motion=known[0].motion + known[1].motion)


@dataclass(frozen=True)
class Modulation(Finding):
    """Sideband ratios of a test with two excitations.

    Attributes:
        case: the case that was measured; its excitation is the probe.
        pump: frequency of the pump [Hz].
        pump_amplitude: amplitude of the pump in the unit of that of the case.
        scan: how it was measured; its periods are common periods of both frequencies.
        x: positions of the points, shape (n,) [m].
        ratio: sideband ratio of each point [-].
        intact_ratio: the same without delaminations, with noise of its own [-].
        limits: what noise on the intact structure exceeds at some point in 1 % of beams [-].
    """

    case: Case
    pump: float
    pump_amplitude: float
    scan: Scan
    x: FloatArray
    ratio: FloatArray
    intact_ratio: FloatArray
    limits: FloatArray

    @property
    def gain(self) -> float:
        """Median along the beam of the ratio over the median of that of the intact structure."""
        return float(np.median(self.ratio) / np.median(self.intact_ratio))

    @property
    def is_called(self) -> bool:
        """Whether some point exceeds its limit."""
        return bool(np.any(self.ratio > self.limits))

    @property
    def is_intact_called(self) -> bool:
        """Whether some point of the intact structure exceeds its limit."""
        return bool(np.any(self.intact_ratio > self.limits))

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        f = self.case.excitation.top_frequency
        verdict = (
            f"Sidebands of {f:g} Hz at ±{self.pump:g} Hz: "
            f"{'above' if self.is_called else 'not above'} the limit of noise; median ratio "
            f"{np.median(self.ratio):.3g}, {self.gain:.3g} times that of the intact structure."
        )
        numbers = {
            "case": self.case.name,
            "pump_frequency": self.pump,
            "pump_amplitude": self.pump_amplitude,
            "probe_frequency": f,
            "called": self.is_called,
            "intact_called": self.is_intact_called,
            "false_call_rate": FALSE_CALLS,
            "median": float(np.median(self.ratio)),
            "intact_median": float(np.median(self.intact_ratio)),
            "gain": self.gain,
            "x": self.x.tolist(),
            "sideband_ratio": self.ratio.tolist(),
            "intact_sideband_ratio": self.intact_ratio.tolist(),
            "ratio_to_intact": (self.ratio / self.intact_ratio).tolist(),
            "limits": self.limits.tolist(),
            "scan": asdict(self.scan) | {"lamina": surface_of(self.case, self.scan.lamina)},
        }
        caption = "Sideband ratio of each point, and what noise alone exceeds."
        return Report(
            name="modulation",
            numbers=numbers,
            case=self.case,
            title=f"Modulation of {self.case.name}",
            sentences=[verdict],
            pictures={"figures/modulation": (lambda: modulation_figure(self), caption)},
        )


def modulation(tones: Tones, scan: Scan | None = None, *, kept: Path | None = None) -> Modulation:
    """Measure a case under two excitations, with and without its delaminations.

    Args:
        tones: the case with its pump.
        scan: how it is measured, at least one common period of both frequencies.
        kept: folder for checkpoints, from which the runs go on; None: none are kept.

    Raises:
        CaseError: the scan does not fit the case, or a motion diverges.
    """
    scan = scan or Scan(periods=4)
    pump, probe = tones.frequencies
    pure, bare = two_tone(tones, scan, kept), two_tone(tones.intact(), scan, kept)
    noise = pure.noise_of(scan)
    inside = np.ptp(pure.field, axis=0) > 1e-9 * np.ptp(pure.field)  # a clamp may be at rest

    def ratio(measured: Measurement, seed: int) -> FloatArray:
        own = measured.noisy(noise, seed)
        return sideband_ratio(own.field[:, inside], own.times, pump, probe)

    again = [ratio(bare, scan.seed + _INTACT_SEED + 1 + k) for k in range(_REPETITIONS)]
    typical = np.median(again, axis=0)
    maxima = [np.max(one / typical) for one in again]
    largest = np.quantile(maxima, 1.0 - FALSE_CALLS, method="weibull")  # of one more record
    size = getattr(tones.pump.excitation, "acceleration", None)
    return Modulation(
        tones.probe,
        pump,
        size if size is not None else getattr(tones.pump.excitation, "amplitude", math.nan),
        scan,
        pure.x[inside],
        ratio(pure, scan.seed),
        ratio(bare, scan.seed + _INTACT_SEED),
        typical * largest,
    )


def two_tone(tones: Tones, scan: Scan, kept: Path | None = None) -> Measurement:
    """Return the field that a sensor without noise would measure under two excitations.

    The run begins with the linear motion of the closed structure under both excitations, and the
    record begins when 0.1 % of a free motion is left. The record has whole common periods, so that
    no spectral line leaks.

    Args:
        tones: the case with its pump.
        scan: how to measure.
        kept: folder for a checkpoint, from which the run goes on; None: none is kept.

    Raises:
        CaseError: the scan does not fit the case, or the motion diverges.
    """
    case, turns = tones.probe, tones.turns
    f = case.excitation.top_frequency
    samples, x = samples_of(scan, f), scan_positions(case.length, scan.spacing, scan.first)
    steps = samples * math.ceil(max(case.time.steps_per_period, LEAST_STEPS) / samples)
    settling = math.ceil(settling_periods(case) / turns)
    structure = discretise.assemble(case, needs_dolfinx=False)
    span = replace(
        span_of(case),
        time_step=1.0 / (f * steps),
        steps_per_period=steps * turns,
        periods=settling + scan.periods,
        window_periods=scan.periods,
        frames_per_period=samples * turns,
    )
    motion = by_period(tones, span, is_periodic=True)
    with session(
        structure.operators, law_of(case), scheme_of(case), motion, span,
        initial=tones.start(structure), modes=modes_of(case),
    ) as opened:  # fmt: skip
        outcome = opened.run_kept(kept, case, f"compiled, {span}, beside {tones.pump.to_toml()}")
        if outcome != "completed":
            raise CaseError(f"modulate: the motion of case {case.name} has {outcome}")
        times, u, v = scan_field(opened.recorder, structure, surface_of(case, scan.lamina), x)
    return Measurement(times, x, v if scan.quantity == "velocity" else u, f)


def modulation_figure(found: Modulation) -> Figure:
    """Draw the sideband ratio of each point, that of the intact structure, and its limit."""
    figure = beside_intact(found.case, found.x, found.ratio, found.intact_ratio, found.limits)
    probe = found.case.excitation.top_frequency
    title = f"{found.case.name}, {probe:g} Hz ± {found.pump:g} Hz"
    figure.axes[0].set(yscale="log", ylabel="sideband ratio [-]")
    figure.axes[0].set_title(title, loc="left")
    return figure


def _modulate(case: Case, options: Modulate, place: Place) -> Modulation:
    """Simulate the test with options of a user."""
    scan = Scan(
        spacing=options.spacing, periods=options.periods, noise_db=options.noise_db,
        seed=options.seed,
    )  # fmt: skip
    tones = Tones.of(case, options.pump_frequency, options.pump_amplitude)
    return modulation(tones, scan, kept=place.kept)


STUDY = Study(Modulate, _modulate)

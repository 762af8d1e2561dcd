"""Simulate vibro-acoustic modulation: a test along the beam with two excitations at once.

The case gives the high frequency (probe). A low one (pump) of the same kind is added to it. Where
the pump opens and closes a contact, the motion at the probe's frequency is modulated.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from delam_fem.api import Case, CaseError, Finding, FloatArray, Report, RunContext
from delam_fem.studies.detection.detect import (
    INTACT_SEED,
    Measurement,
    beside_intact,
    common_turns,
    intact,
    simulated,
)
from delam_fem.studies.detection.indices import FALSE_CALLS, Mark, sideband_ratio
from delam_fem.studies.detection.study import Modulate, Scan
from delam_fem.studies.signals.scan import surface_of

MOST_TURNS = 1000
"""Largest number of periods of the probe in a common period of both frequencies: all of them are
computed, with steps that resolve the probe."""
_REPETITIONS = 200


def pump_of(case: Case, frequency: float, amplitude: float) -> Case:
    """Return a case with the pump in context of its excitation, which is the probe.

    Args:
        case: case whose harmonic excitation is the probe.
        frequency: frequency of the pump [Hz].
        amplitude: amplitude of the pump in the unit of that of the case: m, m/s2 or N.

    Raises:
        CaseError: the excitation is not harmonic, or the frequencies do not go together.
    """
    if not case.is_harmonic or case.excitation.length is not None:
        raise CaseError("modulate: expected a harmonic excitation, given another kind")
    probe = case.excitation.top_frequency
    if not 0.0 < frequency < probe or (probe / frequency).is_integer():
        raise CaseError(
            f"pump frequency: expected one below the excitation's {probe:g} Hz that does not "
            f"divide it, given {frequency:g} Hz"
        )
    if (turns := common_turns(frequency, probe)) > MOST_TURNS:
        raise CaseError(
            f"pump frequency: expected a common period with {probe:g} Hz of at most "
            f"{MOST_TURNS} of its periods, given {turns}; choose rounder frequencies"
        )
    is_shaken = getattr(case.excitation, "acceleration", None) is not None
    size = "acceleration" if is_shaken else "amplitude"
    return case.with_overrides({"excitation.frequency": frequency, f"excitation.{size}": amplitude})


@dataclass(frozen=True)
class Modulation(Finding):
    """Sideband ratios of a test with two excitations.

    Attributes:
        case: the case that was measured; its excitation is the probe.
        pump: frequency of the pump [Hz].
        pump_amplitude: amplitude of the pump in the unit of that of the case.
        scan: how it was measured; its periods are common periods of both frequencies.
        mark: sideband ratio of each point [-], with the limits that noise on the intact structure
            exceeds at some point in 1 % of beams.
        intact_mark: the same without delaminations, with noise of its own.
    """

    case: Case
    pump: float
    pump_amplitude: float
    scan: Scan
    mark: Mark
    intact_mark: Mark

    @property
    def gain(self) -> float:
        """Median along the beam of the ratio over the median of that of the intact structure."""
        return float(np.median(self.mark.values) / np.median(self.intact_mark.values))

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        f = self.case.excitation.top_frequency
        mark = self.mark
        intact_mark = self.intact_mark
        verdict = (
            f"Sidebands of {f:g} Hz at ±{self.pump:g} Hz: "
            f"{'above' if mark.is_over.any() else 'not above'} the limit of noise; median ratio "
            f"{np.median(mark.values):.3g}, {self.gain:.3g} times that of the intact structure."
        )
        numbers = {
            "case": self.case.name,
            "pump_frequency": self.pump,
            "pump_amplitude": self.pump_amplitude,
            "probe_frequency": f,
            "called": bool(mark.is_over.any()),
            "intact_called": bool(intact_mark.is_over.any()),
            "false_call_rate": FALSE_CALLS,
            "median": float(np.median(mark.values)),
            "intact_median": float(np.median(intact_mark.values)),
            "gain": self.gain,
            "x": mark.x.tolist(),
            "sideband_ratio": mark.values.tolist(),
            "intact_sideband_ratio": intact_mark.values.tolist(),
            "ratio_to_intact": (mark.values / intact_mark.values).tolist(),
            "limits": mark.limits.tolist(),
            "scan": asdict(self.scan) | {"lamina": surface_of(self.case, self.scan.lamina)},
        }
        draw = partial(
            beside_intact, self.case, mark, intact_mark,
            title=f"{self.case.name}, {f:g} Hz ± {self.pump:g} Hz", ylabel="sideband ratio [-]",
            yscale="log",
        )  # fmt: skip
        caption = "Sideband ratio of each point, and what noise alone exceeds."
        return Report(
            name="modulation",
            numbers=numbers,
            case=self.case,
            title=f"Modulation of {self.case.name}",
            sentences=[verdict],
            pictures={"figures/modulation": (draw, caption)},
        )


def modulation(case: Case, options: Modulate, context: RunContext | None = None) -> Modulation:
    """Measure a case under two excitations, with and without its delaminations.

    Args:
        case: the case, whose excitation is the probe.
        options: the pump, and how the motion is measured.
        context: folder for checkpoints, from which the runs go on; None: none are kept.

    Raises:
        CaseError: the pump or the scan does not fit the case, or a motion diverges.
    """
    scan = Scan(
        spacing=options.spacing, periods=options.periods, noise_db=options.noise_db,
        seed=options.seed,
    )  # fmt: skip
    frequency, amplitude = options.pump_frequency, options.pump_amplitude
    intact_case = intact(case)
    pump = pump_of(case, frequency, amplitude)
    checkpoint_folder = None if context is None else context.checkpoints
    pure = simulated(case, scan, checkpoint_folder, pump=pump)
    bare = simulated(intact_case, scan, checkpoint_folder, pump=intact(pump))
    noise = pure.noise_of(scan)
    inside = np.ptp(pure.field, axis=0) > 1e-9 * np.ptp(pure.field)  # a clamp may be at rest

    def ratio(measured: Measurement, seed: int) -> FloatArray:
        noisy_scan = measured.noisy(noise, seed)
        return sideband_ratio(
            noisy_scan.field[:, inside], noisy_scan.times, frequency, noisy_scan.frequency
        )

    again = [ratio(bare, scan.seed + INTACT_SEED + 1 + k) for k in range(_REPETITIONS)]
    typical = np.median(again, axis=0)
    maxima = [np.max(one / typical) for one in again]
    largest = np.quantile(maxima, 1.0 - FALSE_CALLS, method="weibull")  # of one more record
    x = pure.x[inside]
    limits = typical * largest
    return Modulation(
        case,
        frequency,
        amplitude,
        scan,
        Mark(x, ratio(pure, scan.seed), limits),
        Mark(x, ratio(bare, scan.seed + INTACT_SEED), limits),
    )

"""Identify the first mode of each lamina from a measured or simulated swept sine of the base."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from delam_fem.case.atomic import atomic, write_text
from delam_fem.case.definition import Case
from delam_fem.case.motion.drive import SweepExcitation
from delam_fem.case.motion.excitation import swept_motion
from delam_fem.case.toml import CaseError
from delam_fem.engines.session import session_of
from delam_fem.model import discretise
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.oscillator import pole
from delam_fem.simulation.initial import first_mode
from delam_fem.studies.identification import resonance
from delam_fem.studies.identification.resonance import Resonance
from delam_fem.studies.identification.tips import tips_of
from delam_fem.studies.linear import first_frequencies
from delam_fem.studies.sweeps.reduction import probe_motion

HEADING = ("lamina", "peak read off", "frequency", "damping ratio", "EI", "EI of the case")


@dataclass(frozen=True)
class Found:
    """The resonances of the laminae of a case.

    Attributes:
        case: the case.
        resonances: fitted, by lamina.
    """

    case: Case
    resonances: tuple[Resonance, ...]

    def rows(self) -> list[tuple[str, ...]]:
        """Return the rows of a table under `HEADING`."""
        rows: list[tuple[str, ...]] = []
        for lamina, one in zip(self.case.lamina, self.resonances, strict=True):
            EI, error = one.bending_stiffness(lamina)
            rows.append(
                (
                    lamina.name,
                    f"{one.peak:.4f} Hz",
                    f"{one.frequency:.4f} ± {one.frequency_error:.1g} Hz",
                    f"{one.damping_ratio:.5f} ± {one.damping_error:.1g}",
                    f"{EI:.4g} ± {error:.1g} N m2",
                    f"{lamina.flexural_rigidity:.4g} N m2",
                )
            )
        return rows

    def remarks(self) -> list[str]:
        """Return what is not as it was said to be, in sentences."""
        pairs = zip(self.case.lamina, self.resonances, strict=True)
        return [f"{lamina.name}: {text}" for lamina, one in pairs for text in one.remarks]

    def save(self, directory: Path) -> list[Path]:
        """Write resonance.json and a figure for each lamina; return their paths."""
        from delam_fem.studies.identification.figures import resonance_figure

        numbers = {}
        for lamina, one in zip(self.case.lamina, self.resonances, strict=True):
            EI, error = one.bending_stiffness(lamina)
            numbers[lamina.name] = {
                "peak_hz": one.peak,
                "frequency_hz": one.frequency,
                "frequency_error_hz": one.frequency_error,
                "damping_ratio": one.damping_ratio,
                "damping_ratio_error": one.damping_error,
                "participation": one.participation,
                "begins_after_sweep_s": one.late,
                "begins_after_sweep_error_s": one.late_error,
                "clock": one.clock,
                "clock_error": one.clock_error,
                "remarks": one.remarks,
                "bending_stiffness_N_m2": EI,
                "bending_stiffness_error_N_m2": error,
                "relative_rms": one.residual,
            }
        paths = [write_text(directory / "resonance.json", json.dumps(numbers, indent=2) + "\n")]
        for lamina, one in zip(self.case.lamina, self.resonances, strict=True):
            image = directory / f"resonance-{lamina.name}.png"
            with atomic(image) as temporary:
                resonance_figure(one).savefig(temporary)
            paths.append(image)
        return paths


def identified(
    case: Case,
    measured: Path | None = None,
    *,
    noise: float = 0.0,
    seed: int = 1,
    kept: Path | None = None,
) -> Found:
    """Identify the resonances of all laminae.

    Args:
        case: a case whose base moves as a swept sine of given amplitude.
        measured: file with the tips, whose times count from the start of the sweep; None: the case
            is simulated without contact.
        noise: standard deviation of a sample of the simulated tips [m].
        seed: of the noise.
        kept: folder for a checkpoint, from which the run goes on; None: none is kept.

    Raises:
        CaseError: the excitation is no such sweep, or the file has not the tips of all laminae.
    """
    given = case.excitation
    if not isinstance(given, SweepExcitation) or given.amplitude is None:
        raise CaseError(
            'excitation.kind: expected "sweep" with an amplitude for a resonance, given '
            f'"{given.kind}"'
        )
    ratios: list[float] = []
    if measured is None:
        time, tips, ratios = _simulated(case, kept)
    else:
        time, tips = tips_of(case, measured)
    tips = tips + noise * np.random.default_rng(seed).standard_normal(tips.shape)
    motion = swept_motion(given, given.amplitude)
    found = (resonance.fit(time, tip, motion) for tip in tips)
    if measured is None:
        pairs = zip(found, ratios, strict=True)
        found = (_exact(one, case.time_step, ratio) for one, ratio in pairs)
    return Found(case, tuple(found))


def _exact(found: Resonance, step: float, ratio: float) -> Resonance:
    """Return a simulated resonance without what steps and elements change in it.

    The damping is changed by elements about as much, but not known: its error grows by that.

    e^{μ Δt} = (1 + λ Δt/2)/(1 - λ Δt/2) for the pole μ of average acceleration and λ of the mode.

    Args:
        found: in a simulated record.
        step: Δt [s].
        ratio: of the frequency of the elements over the exact one.
    """
    seen = pole(2.0 * np.pi * found.frequency, found.damping_ratio)
    exact = 2.0 / step * np.tanh(0.5 * step * seen) / ratio
    frequency, damping = abs(exact) / (2.0 * np.pi), -exact.real / abs(exact)
    error = math.hypot(found.damping_error, damping * (ratio - 1.0))
    return replace(
        found, frequency=float(frequency), damping_ratio=float(damping), damping_error=error
    )


def _simulated(case: Case, kept: Path | None) -> tuple[FloatArray, FloatArray, list[float]]:
    """Return times and tips without contact, absolute, with the ratios of `_exact`."""
    free = case.with_overrides(
        {
            "contact.law": "none",
            "output.window_periods": case.n_periods,
            "output.fields_per_period": 0,
        }
    )
    structure = discretise.assemble(free, needs_dolfinx=False)
    with session_of(free, structure.operators, engine="compiled") as opened:
        opened.run_kept(kept, free)
        tips = probe_motion(opened.recorder, structure).displacement
    modes = (first_mode(structure, i) for i in range(len(case.lamina)))
    o = structure.operators
    own = [math.sqrt((u @ o.stiffness @ u) / (u @ o.mass @ u)) for u in modes]
    ratios = [a / b for a, b in zip(own, first_frequencies(case), strict=True)]
    return np.arange(1, tips.shape[1] + 1) * free.time_step, tips, ratios

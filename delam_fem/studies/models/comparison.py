"""Models of one case side by side: numbers, tables, files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.studies.findings import save_findings
from delam_fem.studies.models import figure
from delam_fem.studies.models.measures import Measured, Motion, measure
from delam_fem.studies.models.variants import variants

MODES, PERIODS = 3, 20
"""Natural frequencies of each lamina, and periods of each motion, unless others are asked for."""
Rows = list[tuple[str, ...]]


@dataclass(frozen=True)
class ModelComparison:
    """What several models make of one case; the first one is what the others are compared with.

    Attributes:
        case: the case.
        models: what is measured of each.
    """

    case: Case
    models: tuple[Measured, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the models."""
        return tuple(own.name for own in self.models)

    def linear_rows(self) -> Rows:
        """Return rows with a column for each model: sizes, frequencies, compliance."""
        first = self.models[0]
        sizes = (
            ("unknowns", [str(own.dofs) for own in self.models]),
            ("contact pairs", [str(own.pairs) for own in self.models]),
            ("assembly [s]", [f"{own.seconds:.2g}" for own in self.models]),
        )
        rows = [(name, *values) for name, values in sizes]
        for k, label in enumerate(first.labels):
            values = [own.frequencies[k] for own in self.models]
            rows.append((f"{label} [Hz]", *_relative(values, 6)))
        for k, lamina in enumerate(self.case.lamina):
            values = [own.compliance[k] for own in self.models]
            rows.append((f"compliance, {lamina.name} [m/N]", *_relative(values, 5)))
        return rows

    def motion_rows(self, number: int) -> Rows:
        """Return rows of one motion with a column for each model.

        "Difference until then" is the largest one of the tips from those of the first model before
        the first strike near the tips, relative to their largest displacement.

        Args:
            number: number of the frequency.
        """
        first = self.models[0].motions[number]
        columns = [_column(own.motions[number], first, self.case) for own in self.models]
        return [(name, *(column[name] for column in columns)) for name in columns[0]]

    def save(self, directory: Path | str) -> list[Path]:
        """Write models.json and models.png.

        Raises:
            OSError: the folder cannot be written.
        """
        numbers: list[dict[str, object]] = [
            {
                "name": own.name,
                "dofs": own.dofs,
                "pairs": own.pairs,
                "assembly_seconds": own.seconds,
                "frequencies": own.frequencies.tolist(),
                "compliance": own.compliance.tolist(),
                "motions": [
                    _numbers(motion, first)
                    for motion, first in zip(own.motions, self.models[0].motions, strict=True)
                ],
            }
            for own in self.models
        ]
        return save_findings(directory, "models", {"models": numbers}, self.figure)

    def figure(self) -> Figure:
        """Return tip histories and impulses along the contact line of all models."""
        return figure.draw(self.case, self.models)


def compare_models(
    case: Case,
    names: Sequence[str],
    *,
    frequencies: Sequence[float] = (),
    periods: int = PERIODS,
    natural: int = MODES,
    modes: int = 20,
    progress: Callable[[str], None] = lambda name: None,
) -> ModelComparison:
    """Compute one case as several models.

    Args:
        case: the case.
        names: "beam", "plane-stress", "solid"; "reduced" reduces the one before it.
        frequencies: of the excitation [Hz]; none: that of the case.
        periods: number of periods of each motion, which begins at rest.
        natural: number of natural frequencies of each lamina, or of a bonded stack.
        modes: number of modes of a reduced model.
        progress: called with the name of each model before it is computed.

    Raises:
        CaseError: a model or a motion cannot be computed.
    """
    if periods < 2:
        raise CaseError(f"periods: expected at least 2, given {periods}")
    if not case.is_periodic:
        raise CaseError(
            "compare: models are compared by periodic motions; expected a harmonic excitation or a "
            f"harmonic force, given kind {case.excitation.kind!r}"
        )
    at = tuple(frequencies) or (case.excitation.top_frequency,)
    found = []
    for model in variants(case, names, modes):
        progress(model.name)
        found.append(measure(model, at, periods, natural))
    return ModelComparison(case, tuple(found))


def difference_until(motion: Motion, first: Motion) -> tuple[float, float]:
    """Return the first strike of either motion [s], and the difference of the tips until then.

    The difference is that of the largest of all tips and steps, relative to the largest
    displacement of the same tip in the first motion.
    """
    end = min(motion.strike, first.strike)
    n = min(motion.time.size, first.time.size)
    before = first.time[:n] < end
    a, b = (m.tips[:, :n][:, before] for m in (motion, first))
    if not a.size:
        return end, 0.0
    return end, float((np.abs(a - b).max(axis=1) / np.abs(b).max(axis=1)).max())


def _column(motion: Motion, first: Motion, case: Case) -> dict[str, str]:
    """Return the numbers of a motion by their names."""
    period, (end, apart) = 1.0 / motion.frequency, difference_until(motion, first)
    s, energies = motion.summary, motion.energies
    low, high = (1e3 * np.array(s[key]) for key in ("tip_min", "tip_max"))
    names = [lamina.name for lamina in case.lamina]
    d, scatter = s["distortion_factor"], s["strobe_scatter"]
    work = energies["base_work"] + energies["force_work"]
    damping = energies["damping_loss"] + energies["contact_damping_loss"]
    return {
        "first strike [T]": "–" if np.isinf(end) else f"{end / period:.3f}",
        "difference until then": f"{apart:.2%}",
        **{f"tip, {name} [mm]": f"{low[k]:.2f} … {high[k]:.2f}" for k, name in enumerate(names)},
        "contacts per period": f"{s['tip_contacts_per_period'] or 0.0:.2f}",
        "motion": (s["periodicity_class"] or "–"),
        "scatter": "–" if scatter is None else f"{scatter:.2%}",
        **{f"d, {name}": "–" if d is None else f"{d[k]:.2%}" for k, name in enumerate(names)},
        "work [mJ per period]": f"{1e3 * work:.3g}",
        "damping": f"{1e3 * damping:.3g}",
        "impacts": f"{1e3 * energies['impact_loss']:.3g}",
        "ledger's residual": f"{motion.residual:.0e}",
        "steps per period": f"{motion.cost[1]:.0f}",
        "cost of a step [µs]": f"{motion.cost[0]:.3g}",
    }


def _numbers(motion: Motion, first: Motion) -> dict[str, object]:
    """Return the numbers of a motion for models.json."""
    end, apart = difference_until(motion, first)
    kept = ("tip_min", "tip_max", "tip_contacts_per_period", "periodicity_class", "strobe_scatter",
            "distortion_factor", "minimum_tip_gap")  # fmt: skip
    return {
        "frequency": motion.frequency,
        "first_strike": None if np.isinf(end) else end,
        "difference_until_then": apart,
        **{key: motion.summary[key] for key in kept},
        "energies": motion.energies,
        "energy_residual": motion.residual,
        "impulse_x": motion.x.tolist(),
        "impulse_per_length": motion.impulse.tolist(),
        "microseconds_per_step": motion.cost[0],
        "steps_per_period": motion.cost[1],
    }


def _relative(values: Sequence[float], digits: int) -> list[str]:
    """Return numbers, each with its relative difference from the first."""
    first = values[0]
    changes = ["", *(f" ({round(value / first - 1.0, 4) + 0.0:+.2%})" for value in values[1:])]
    return [f"{v:.{digits}g}{change}" for v, change in zip(values, changes, strict=True)]

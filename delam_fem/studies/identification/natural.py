"""Identify keys of a case from a natural frequency that was followed over time.

What changes, such as the place of a support, is sought anew at each time. Natural frequencies of
cases with parameters drawn from the prior are interpolated to many more draws. Noise is added to
them, with the errors of the measured frequency and of the interpolation. The draws whose noisy
frequencies are nearest to the measured one are accepted, and corrected to it by a straight line.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import RBFInterpolator

from delam_fem.api import (
    Case,
    CaseError,
    Finding,
    FloatArray,
    Report,
    RunContext,
    Table,
    assemble,
    elastic,
    style,
)
from delam_fem.studies.identification.study import Natural
from delam_fem.studies.identification.unknowns import (
    Unknown,
    drawn,
    require_values,
    uncertain_keys,
)
from delam_fem.studies.signals.reading import read_measured

QUANTILES = (0.05, 0.5, 0.95)
"""Ends of the 90 % interval and the median."""
DRAWS, NEAREST = 20_000, 400
"""Number of draws at which the frequency is interpolated, and of those that are accepted."""


@dataclass(frozen=True)
class Followed(Finding):
    """Posterior of the unknowns over time from a natural frequency.

    Attributes:
        case: the case whose keys are sought.
        unknowns: keys that are sought.
        uncertain: keys in which the rig may differ from the case.
        time: times of the measured frequencies, shape (n,) [s].
        frequency: measured frequencies, shape (n,) [Hz].
        error: their standard errors, shape (n,) [Hz].
        quantiles: those of the posterior at each time, in the order of `QUANTILES`, shape (n, 3,
            n_unknowns).
    """

    case: Case
    unknowns: tuple[Unknown, ...]
    uncertain: tuple[Unknown, ...]
    time: FloatArray
    frequency: FloatArray
    error: FloatArray
    quantiles: FloatArray

    @property
    def report(self) -> Report:
        """Report of the finding in files and on the terminal."""
        keys = [unknown.key for unknown in self.unknowns]
        numbers = {
            "time_s": self.time,
            "frequency_hz": self.frequency,
            "frequency_error_hz": self.error,
            "unknowns": {
                key: dict(zip(("low", "median", "high"), quantiles.T, strict=True))
                for key, quantiles in zip(keys, self.quantiles.T.swapaxes(1, 2), strict=True)
            },
            "uncertain": [asdict(unknown) for unknown in self.uncertain],
        }
        rows = []
        for t, f, e, quantiles in zip(
            self.time, self.frequency, self.error, self.quantiles, strict=True
        ):
            spans = [f"{middle:.4g} ({low:.4g} … {high:.4g})" for low, middle, high in quantiles.T]
            rows.append((f"{t:.4g}", f"{f:.6g} ± {e:.1g}", *spans))
        heading = ("time [s]", "frequency [Hz]", *(f"{key} (90 %)" for key in keys))
        return Report(
            name="natural",
            numbers=numbers,
            tables=[Table(f"{self.case.name}, from a natural frequency", heading, rows)],
            pictures={"natural": (self.figure, "")},
        )

    def figure(self) -> Figure:
        """Draw the frequency over time, and below it median and interval of each unknown."""
        n = 1 + len(self.unknowns)
        figure, panels = style.stacked(n, 1.0 + 2.2 * n, sharex=True)
        panels[0].errorbar(
            self.time, self.frequency, 2.0 * self.error, fmt=".", color=style.VERMILLION
        )
        panels[0].set_ylabel("frequency [Hz]\n± two errors")
        for axes, unknown, (low, middle, high) in zip(
            panels[1:], self.unknowns, self.quantiles.T, strict=True
        ):
            axes.fill_between(self.time, low, high, color=style.BLUE, alpha=0.3, linewidth=0.0)
            axes.plot(self.time, middle, ".", color=style.BLUE)
            axes.set(ylabel=f"{unknown.key}\nmedian, 90 %", ylim=(unknown.low, unknown.high))
        style.label_x(panels, "time [s]")
        return figure


def compute(case: Case, options: Natural, context: RunContext) -> Followed:
    """Identify keys over time with options of a user."""
    data = read_measured(options.measured)
    n = options.simulations
    if "free_frequency" in data:
        data = data.isel(free_time=np.flatnonzero(np.isfinite(data["free_frequency_error"])))
    if not data.sizes.get("free_time"):
        raise CaseError(
            f"{options.measured}: expected a frequency over time; delam-fem measure response FILE "
            "--free CHANNEL LOW HIGH makes it"
        )
    unknowns = tuple(map(Unknown.parse, options.unknown))
    require_values(unknowns)
    uncertain = uncertain_keys(case, options.uncertain)
    columns, places = _prior(case, unknowns, uncertain, n, options.seed)
    simulated = np.empty(n)
    for j in range(n):
        changed = case.with_overrides({key: float(column[j]) for key, column in columns.items()})
        o = assemble(changed, needs_dolfinx=False).operators
        simulated[j] = elastic(o.stiffness, o.mass, options.mode, changed.n_rigid)[0][-1]
        if context.progress is not None:
            context.progress(j + 1, n)
    columns, many = _prior(case, unknowns, uncertain, DRAWS, options.seed + 1)
    many, places = (points / np.ptp(places, axis=0) for points in (many, places))
    interpolated = RBFInterpolator(places, simulated, kernel="cubic")(many)
    # error of the interpolation: every other simulation is interpolated from the rest
    half = RBFInterpolator(places[::2], simulated[::2], kernel="cubic")(places[1::2])
    rough = float(np.sqrt(np.mean((half - simulated[1::2]) ** 2)))  # all together have less
    sought = np.array([columns[unknown.keys(case)[0]] for unknown in unknowns]).T
    names = "time", "frequency", "frequency_error"
    time, frequency, error = (data[f"free_{name}"].to_numpy() for name in names)
    rng = np.random.default_rng(options.seed)
    quantiles = []
    for f, e in zip(frequency, error, strict=True):
        off = interpolated - f + np.hypot(e, rough) * rng.standard_normal(DRAWS)
        near = np.argsort(np.abs(off))[:NEAREST]  # then a regression moves them to off = 0
        line = np.column_stack([np.ones(NEAREST), off[near]])
        slope = np.linalg.lstsq(line, sought[near], rcond=None)[0][1]
        limits = np.quantile(sought[near] - np.outer(off[near], slope), QUANTILES, axis=0)
        quantiles.append(
            np.clip(limits, [key.low for key in unknowns], [key.high for key in unknowns])
        )
    return Followed(case, unknowns, uncertain, time, frequency, error, np.array(quantiles))


def _prior(
    case: Case, unknowns: tuple[Unknown, ...], uncertain: tuple[Unknown, ...], n: int, seed: int
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return n values of each key, and what varies (doubts in logarithms), shape (n, n_varied)."""
    rng = np.random.default_rng(seed)
    columns = drawn(uncertain, case, n, seed + 3)
    logs = [np.log(columns[unknown.keys(case)[0]]) for unknown in uncertain]
    for unknown in unknowns:
        columns |= dict.fromkeys(unknown.keys(case), rng.uniform(unknown.low, unknown.high, n))
    return columns, np.array([*(columns[unknown.keys(case)[0]] for unknown in unknowns), *logs]).T

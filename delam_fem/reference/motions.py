"""Two motions of one case, from dolfinx and PETSc and from the reference: how they differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.figures.style import label_x


@dataclass(frozen=True)
class Motions:
    """The tip histories of both.

    Attributes:
        names: names of the laminae.
        times: ends of the steps, shape (n,) [s].
        tips: tip displacement of the dolfinx/PETSc run, shape (n_laminae, n) [m].
        reference_tips: tip displacement of the reference, shape (n_laminae, n) [m].
        impacts: number of impacts of the dolfinx/PETSc run and of the reference.
        impact_limit: the number of the last impact that `until_impact` covers.
        impact_time: its time in the reference, the end if there was no impact [s].
    """

    names: tuple[str, ...]
    times: FloatArray
    tips: FloatArray
    reference_tips: FloatArray
    impacts: tuple[int, int]
    impact_limit: int
    impact_time: float

    @property
    def differences(self) -> FloatArray:
        """Largest difference of all tips at each step, shape (n,) [m]."""
        largest: FloatArray = np.abs(self.tips - self.reference_tips).max(axis=0)
        return largest

    @property
    def until_impact(self) -> float:
        """Largest difference of the tip histories up to impact `impact_limit` [m]."""
        return float(self.differences[self.times <= self.impact_time].max())

    @property
    def overall(self) -> float:
        """Largest difference of the tip histories over the whole run [m]."""
        return float(self.differences.max())

    def rows(self) -> list[tuple[str, str]]:
        """Return the rows of a table."""
        return [
            *self._impact_row(),
            (f"tip histories up to {self.times[-1]:.4g} s", f"{self.overall:.1e} m"),
            ("impacts, dolfinx and reference", f"{self.impacts[0]} and {self.impacts[1]}"),
        ]

    def _impact_row(self) -> list[tuple[str, str]]:
        if not self.impact_limit:
            return []
        return [(f"tip histories up to impact {self.impact_limit}", f"{self.until_impact:.1e} m")]

    def numbers(self) -> dict[str, object]:
        """Return the differences for a JSON file."""
        return {
            "impact_limit": self.impact_limit,
            "impact_time_s": self.impact_time,
            "tips_until_impact_m": self.until_impact,
            "tips_overall_m": self.overall,
            "end_time_s": float(self.times[-1]),
            "impacts": {"dolfinx": self.impacts[0], "reference": self.impacts[1]},
        }

    def figure(self) -> Figure:
        """Draw the tip histories of both runs, and their difference on a logarithmic axis."""
        figure = Figure(figsize=(9.0, 6.0), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True)
        for i, name in enumerate(self.names):
            top.plot(self.times, 1e3 * self.tips[i], color=f"C{i}", label=f"{name}, dolfinx")
            top.plot(self.times, 1e3 * self.reference_tips[i], "k:", label=f"{name}, reference")
        top.set(ylabel="tip displacement [mm]")
        top.legend(ncols=2, fontsize=8)
        seen = np.maximum(self.differences, np.finfo(np.float64).tiny)
        bottom.semilogy(self.times, seen, color="C3", linewidth=0.8)
        if self.impact_limit:
            bottom.axvline(self.impact_time, color="0.5", linestyle="--")
            label = f" impact {self.impact_limit}"
            bottom.annotate(label, (self.impact_time, seen.max()), fontsize=8, va="top")
        floor = max(float(seen[seen > np.finfo(np.float64).tiny].min(initial=1e-18)), 1e-20)
        label_x((top, bottom), "time [s]")
        bottom.set(ylabel="largest difference [m]", ylim=(floor, None))
        figure.suptitle("dolfinx and PETSc beside the independent reference")
        return figure

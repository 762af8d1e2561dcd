"""The posterior of a case's own delamination: its scans, the table of simulations, the picture."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from delam_fem.case.atomic import write_text
from delam_fem.case.definition import Case
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.inference import Posterior
from delam_fem.results.figures.style import BLUE, VERMILLION, WIDTH
from delam_fem.results.scan import surface_of
from delam_fem.studies.detection.inference import NAMES, Prior, edges
from delam_fem.studies.detection.population import Specimen


@dataclass(frozen=True)
class Inferred:
    """What scans of a case say of its delamination.

    Attributes:
        case: with one delamination.
        posterior: of start, end and depth [m].
        n_structures: in the table of simulations.
        noise_db: of the sensor.
    """

    case: Case
    posterior: Posterior
    n_structures: int
    noise_db: float

    @property
    def truth(self) -> FloatArray:
        """Start, end and depth of the case, shape (3,) [m]."""
        return truth_of(self.case)

    def rows(self) -> list[tuple[str, ...]]:
        """Return table rows: parameter, truth, median, interval of 90 %, all in mm."""
        middle, bounds = self.posterior.quantile(0.5), self.posterior.interval()
        return [
            (name, f"{1e3 * true:.4g}", f"{1e3 * m:.4g}", f"{1e3 * low:.4g} … {1e3 * high:.4g}")
            for name, true, m, (low, high) in zip(
                NAMES, self.truth, middle, bounds.tolist(), strict=True
            )
        ]

    def save(self, directory: Path) -> Path:
        """Write inference.json (lengths in m) into an existing folder and return its path."""
        found = {
            "case": self.case.name,
            "noise_db": self.noise_db,
            "structures": self.n_structures,
            "parameter": list(NAMES),
            "truth": self.truth.tolist(),
            "median": self.posterior.quantile(0.5).tolist(),
            "interval_90": self.posterior.interval().tolist(),
            "correlation": self.posterior.correlation().tolist(),
        }
        return write_text(directory / "inference.json", json.dumps(found, indent=2) + "\n")

    def figure(self) -> Figure:
        """Draw the marginal distributions within the prior, and start against end."""
        figure = Figure(figsize=(WIDTH, 6.0), layout="constrained")
        panels = figure.subplots(2, 2).ravel()
        samples, weights = 1e3 * self.posterior.samples, self.posterior.weights
        prior = 1e3 * edges(Prior.of(self.case).sample(20_000, 1))
        for k, (axes, name) in enumerate(zip(panels, NAMES, strict=False)):
            bins = np.linspace(prior[:, k].min(), prior[:, k].max(), 60)
            axes.hist(prior[:, k], bins=bins, density=True, color="0.85", label="prior")
            axes.hist(
                samples[:, k], bins=bins, weights=weights, density=True, color=BLUE,
                label="posterior",
            )  # fmt: skip
            axes.axvline(1e3 * self.truth[k], color=VERMILLION, label="truth")
            axes.set(xlabel=f"{name} [mm]", ylabel="density [1/mm]")
        panels[0].legend()
        panels[3].scatter(samples[:, 0], samples[:, 1], s=2000.0 * weights, color=BLUE, alpha=0.5)
        panels[3].plot(*(1e3 * self.truth[:2]), "+", color=VERMILLION, markersize=14)
        panels[3].set(xlabel="start [mm]", ylabel="end [mm]")
        return figure


def truth_of(case: Case) -> FloatArray:
    """Return start, end and depth of the delamination of a case, shape (3,) [m]."""
    own, surface = case.delamination[0], surface_of(case, None)
    depth = next(lamina.thickness for lamina in case.lamina if lamina.name == surface)
    return np.array([own.start, own.end, depth], dtype=np.float64)


def observed(case: Case, frequencies: tuple[float, ...]) -> list[Specimen]:
    """Return the case itself as specimens, one for each frequency."""
    start, end, depth = truth_of(case).tolist()
    return [Specimen(start, end, depth, case.support.end, f) for f in frequencies]

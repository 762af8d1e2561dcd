"""The posterior of a case's own delamination: its scans, the table of simulations, the picture."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from delam_fem.case.atomic import write_text
from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.inference import Posterior
from delam_fem.results.figures.style import BLUE, VERMILLION, WIDTH
from delam_fem.results.scan import surface_of
from delam_fem.studies.detection.inference import (
    FREQUENCIES,
    NAMES,
    Prior,
    Sensor,
    edge_posterior,
    edges,
    knowledge,
    specimens_of,
)
from delam_fem.studies.detection.measurement import Measurement, drive_responses, intact
from delam_fem.studies.detection.population import Specimen, population
from delam_fem.studies.detection.shapes import shapes_of
from delam_fem.studies.unknown import Unknown, drawn, of_rig

SAME_PLACE = 0.05
"""Share of the spacing by which a scanned point may be elsewhere than on the grid."""


@dataclass(frozen=True)
class Inferred:
    """What scans of a case say of its delamination.

    Attributes:
        case: with one delamination.
        posterior: of start, end and depth [m].
        n_structures: in the table of simulations.
        uncertain: in what the rig may differ from the case.
        is_measured: whether the scans come from files.
        mismatch: in which way the scans are unlike those of all simulations; None: they are not.
    """

    case: Case
    posterior: Posterior
    n_structures: int
    uncertain: tuple[Unknown, ...] = ()
    is_measured: bool = False
    mismatch: str | None = None

    @property
    def truth(self) -> FloatArray:
        """Start, end and depth of the case, shape (3,) [m]; NaN if the scans come from files."""
        return np.full(3, np.nan) if self.is_measured else truth_of(self.case)

    def rows(self) -> list[tuple[str, ...]]:
        """Return table rows: parameter, truth, median, interval of 90 %, all in mm."""
        middle, bounds = self.posterior.quantile(0.5), self.posterior.interval()
        every = zip(NAMES, self.truth, middle, bounds.tolist(), strict=True)
        return [
            (
                name,
                "" if np.isnan(true) else f"{1e3 * true:.4g}",
                f"{1e3 * m:.4g}",
                f"{1e3 * low:.4g} … {1e3 * high:.4g}",
            )
            for name, true, m, (low, high) in every
        ]

    def save(self, directory: Path) -> Path:
        """Write inference.json (lengths in m) into an existing folder and return its path."""
        found = {
            "case": self.case.name,
            "structures": self.n_structures,
            "uncertain": [asdict(own) for own in self.uncertain],
            "is_measured": self.is_measured,
            "mismatch": self.mismatch,
            "parameter": list(NAMES),
            "truth": None if self.is_measured else self.truth.tolist(),
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
            if not self.is_measured:
                axes.axvline(1e3 * self.truth[k], color=VERMILLION, label="truth")
            axes.set(xlabel=f"{name} [mm]", ylabel="density [1/mm]")
        panels[0].legend()
        panels[3].scatter(samples[:, 0], samples[:, 1], s=2000.0 * weights, color=BLUE, alpha=0.5)
        panels[3].plot(*(1e3 * self.truth[:2]), "+", color=VERMILLION, markersize=14)
        panels[3].set(xlabel="start [mm]", ylabel="end [mm]")
        return figure


def infer(
    case: Case,
    directory: Path,
    *,
    number: int = 5000,
    frequencies: tuple[float, ...] = FREQUENCIES,
    noise_db: float = 40.0,
    measured: Sequence[Measurement] | None = None,
    uncertain: Sequence[Unknown] | None = None,
    workers: int | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Inferred:
    """Infer start, end and depth of a delamination from scans at some frequencies.

    Args:
        case: two laminae with one delamination, whose place is that of simulated scans only.
        directory: folder of the simulations.
        number: of structures in the table.
        frequencies: of the scans [Hz].
        noise_db: of simulated scans: overall root mean square of the signal over the noise [dB].
        measured: scans at these frequencies; None: the case simulates them.
        uncertain: in what the rig may differ from the case, drawn for each structure; None: see
            `of_rig`.
        workers: see `run_sweep`.
        resume: whether to go on with what is in the folder.
        progress: see `run_sweep`.

    Raises:
        CaseError: the case or the scans do not allow it.
        KeyboardInterrupt: it was interrupted; `resume` goes on.
    """
    prior, doubts = Prior.of(case), of_rig(case) if uncertain is None else tuple(uncertain)
    parameters = prior.sample(number, 7)
    drawn_keys = drawn(doubts, case, number, 8)
    also = {key: np.tile(values, len(frequencies)) for key, values in drawn_keys.items()}
    specimens = specimens_of(parameters, case.support.end, frequencies)
    spacing, first, n_points = _grid(measured)
    runs = population(
        case, specimens, directory, spacing=spacing, first=first, also=also, workers=workers,
        resume=resume, progress=progress,
    ).at_first(n_points)  # fmt: skip
    whole, surface = intact(case), surface_of(case, None)
    drives = [drive_responses(whole, surface, runs.x, f, (2.0,)) for f in frequencies]
    if measured is None:
        own = population(case, observed(case, frequencies), directory / "observation", "serial",
                         resume=resume)  # fmt: skip
        rng = np.random.default_rng(1)
        scans = tuple(own.shapes(k, noise_db, rng) for k in range(len(frequencies)))
        sensors = tuple(Sensor(noise_db, drive=drive) for drive in drives)
    else:
        scans = tuple(shapes_of(m.field, m.times, m.frequency, m.x) for m in measured)
        every = zip(scans, measured, drives, strict=True)
        sensors = tuple(Sensor.of(scan, m.rms, drive) for scan, m, drive in every)
    known = knowledge(runs, parameters, prior, sensors)
    posterior = edge_posterior(known.posterior(scans))
    return Inferred(
        case, posterior, number, doubts, measured is not None, known.mismatch(scans)
    )  # fmt: skip


def _grid(measured: Sequence[Measurement] | None) -> tuple[float, float, int | None]:
    """Return spacing and first position [m] and number of points of the scans.

    Raises:
        CaseError: the positions are not equidistant, or differ from scan to scan.
    """
    if measured is None:
        return 0.01, 0.0, None
    x = measured[0].x
    spacing = float(np.diff(x).mean())
    expected = x[0] + spacing * np.arange(x.size)
    for own in measured:
        if own.x.size != x.size or np.abs(own.x - expected).max() > SAME_PLACE * spacing:
            raise CaseError(
                "measured: expected equidistant points, the same in every scan, given "
                f"{own.x.tolist()}"
            )
    return spacing, float(x[0]), int(x.size)


def truth_of(case: Case) -> FloatArray:
    """Return start, end and depth of the delamination of a case, shape (3,) [m]."""
    own, surface = case.delamination[0], surface_of(case, None)
    depth = next(lamina.thickness for lamina in case.lamina if lamina.name == surface)
    return np.array([own.start, own.end, depth], dtype=np.float64)


def observed(case: Case, frequencies: tuple[float, ...]) -> list[Specimen]:
    """Return the case itself as specimens, one for each frequency."""
    start, end, depth = truth_of(case).tolist()
    return [Specimen(start, end, depth, case.support.end, f) for f in frequencies]

"""The study of the probability of detection: a grid of delaminations, two noises, intact beams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from delam_fem.case.definition import Case
from delam_fem.numerics.types import BoolArray, FloatArray
from delam_fem.results.figures.style import BASE_COLOUR, WIDTH, label_x, lamina_colours
from delam_fem.studies.detection.population import (
    Curve,
    Population,
    Trials,
    grid,
    intact_scores,
    logistic,
    population,
    roc,
    trials,
)
from delam_fem.studies.options import Pod
from delam_fem.studies.study import Finding, Place, Report, Study, Table

_WORDS = {"clamped": "clamped at both ends", "free": "cantilever", "pinned": "clamped and pinned"}


@dataclass(frozen=True)
class Line:
    """The result for one support, noise and frequency.

    Attributes:
        support: at the end of the structure.
        frequency: of the excitation [Hz].
        trials: hits and misses at one noise.
        curve: POD over the length [m].
        intact: scores of intact beams; empty where it was not computed.
    """

    support: str
    frequency: float
    trials: Trials
    curve: Curve
    intact: FloatArray

    @property
    def a90(self) -> float:
        """Length with a POD of 0.9 [m]; NaN: none."""
        return self.curve.length(0.9)

    @property
    def a90_95(self) -> float:
        """Length at which the lower 95 % bound of the POD is 0.9 [m]; NaN: none."""
        return self.curve.length(0.9, 0.95)


@dataclass(frozen=True)
class PodStudy(Finding):
    """The study.

    Attributes:
        case: whose structure carries the delaminations.
        lines: one for each support, noise and frequency.
        recommended: frequency by support and noise: that with the most hits [Hz].
    """

    case: Case
    lines: tuple[Line, ...]
    recommended: dict[tuple[str, float], float]

    def best(self, support: str, noise_db: float) -> Line:
        """Return the result at the recommended frequency."""
        return next(
            line
            for line in self.lines
            if (line.support, line.trials.noise_db) == (support, noise_db)
            and line.frequency == self.recommended[support, noise_db]
        )

    @property
    def numbers(self) -> dict[str, object]:
        """The content of pod.json; lengths in m."""
        return {
            "case": self.case.name,
            "recommended": [
                {"support": support, "noise_db": noise, "frequency": frequency}
                for (support, noise), frequency in self.recommended.items()
            ],
            "lines": [_numbers(line) for line in self.lines],
        }

    @property
    def report(self) -> Report:
        """What it says in files and on the terminal; lengths over the length of the beam."""
        rows = [_row(self.best(*key), self.case.length) for key in self.recommended]
        return Report(
            name="pod",
            numbers=self.numbers,
            case=self.case,
            is_sweep=True,
            title=f"POD of {self.case.name}",
            tables=[Table(f"probability of detection, {self.case.name}", HEADING, rows)],
            pictures={
                "figures/pod": (
                    self.pod_figure,
                    "Hits over length, the logistic regression on ln a, and its lower 95 % bound. "
                    "Each support and noise at its best frequency.",
                ),
                "figures/roc": (
                    self.roc_figure,
                    "Rates of detection and of false calls for every threshold, in classes of "
                    "length.",
                ),
            },
        )

    def pod_figure(self) -> Figure:
        """Draw POD curves with their bounds and the hits, for each support and noise."""
        figure = Figure(figsize=(WIDTH, 6.5), layout="constrained")
        keys, panels = self._panels(figure)
        L = self.case.length
        a = np.linspace(0.01, 0.45, 200) * L
        for axes, key in zip(panels, keys, strict=True):
            line = self.best(*key)
            own = line.trials
            lengths = np.unique(own.lengths.round(9))
            rates = [own.hit[np.isclose(own.lengths, length)].mean() for length in lengths]
            axes.plot(lengths / L, rates, "o", color=lamina_colours(1)[0], label="share of hits")
            axes.plot(a / L, line.curve.pod(a), color="black", label="POD")
            axes.plot(a / L, line.curve.lower(a), "--", color="black", label="lower 95 % bound")
            axes.axhline(0.9, color=BASE_COLOUR, linewidth=0.8)
            axes.set(ylim=(-0.03, 1.03), ylabel="probability of detection")
            axes.set_title(
                f"{_WORDS[line.support]}, {own.noise_db:g} dB, {line.frequency:g} Hz", loc="left"
            )
        label_x(panels, "length of the delamination a/L")
        panels[0].legend(loc="lower right")
        return figure

    def roc_figure(self) -> Figure:
        """Draw ROC curves for each support and noise, in classes of length."""
        figure = Figure(figsize=(WIDTH, 6.5), layout="constrained")
        keys, panels = self._panels(figure)
        L = self.case.length
        classes = ((0.0, 0.075), (0.075, 0.175), (0.175, 0.5))
        for axes, key in zip(panels, keys, strict=True):
            line = self.best(*key)
            share = line.trials.lengths / L
            for (low, high), colour in zip(classes, lamina_colours(3), strict=True):
                chosen = (share >= low) & (share < high)
                false, true = roc(line.trials.score[chosen], line.intact)
                text = f"a/L {share[chosen].min():.2g} to {share[chosen].max():.2g}"
                axes.step(false, true, where="post", color=colour, label=text)
            axes.set(xlim=(-0.01, 1.01), ylim=(-0.01, 1.03), ylabel="rate of detection")
            axes.set_title(
                f"{_WORDS[line.support]}, {key[1]:g} dB, {line.frequency:g} Hz", loc="left"
            )
        label_x(panels, "rate of false calls")
        panels[-1].legend(loc="lower right")
        return figure

    def _panels(self, figure: Figure) -> tuple[list[tuple[str, float]], list[Axes]]:
        """Return supports and noises with a panel for each."""
        keys = list(self.recommended)
        panels = figure.subplots(-(-len(keys) // 2), 2, sharey=True, squeeze=False).ravel()
        for axes in panels[len(keys) :]:
            axes.remove()
        return keys, panels[: len(keys)].tolist()


HEADING = (
    "support", "noise [dB]", "frequency [Hz]", "hits", "a90/L", "a90/95 /L", "error of ends /L",
    "false calls",
)  # fmt: skip
"""Heading of the table of a study."""


def pod(case: Case, found: Population, noises: Sequence[float]) -> PodStudy:
    """Judge a population and intact beams at each noise.

    The recommended frequency of a support and a noise is that with the most hits; of equal ones the
    lowest. False calls are counted there.
    """
    lines, recommended = [], {}
    supports = sorted({own.support for own in found.specimens})
    frequencies = sorted({own.frequency for own in found.specimens})
    for noise in noises:
        whole = trials(case, found, noise)
        for support in supports:
            own = {f: whole.of(_chosen(found, support, f)) for f in frequencies}
            best = max(frequencies, key=lambda f: (int(own[f].hit.sum()), -f))
            recommended[support, noise] = best
            for f, judged in own.items():
                scores = intact_scores(case, support, f, noise) if f == best else np.empty(0)
                curve = logistic(judged.lengths, judged.hit)
                lines.append(Line(support, f, judged, curve, scores))
    order = {key: recommended[key] for key in sorted(recommended, key=lambda k: (k[0], -k[1]))}
    return PodStudy(case, tuple(lines), order)


def _chosen(found: Population, support: str, frequency: float) -> BoolArray:
    """Return which specimens have a support and a frequency."""
    return np.array(
        [(own.support, own.frequency) == (support, frequency) for own in found.specimens]
    )


def _row(line: Line, L: float) -> tuple[str, ...]:
    """Return the table row of a result."""
    own = line.trials
    return (
        line.support,
        f"{own.noise_db:g}",
        f"{line.frequency:g}",
        f"{int(own.hit.sum())} of {own.hit.size}",
        f"{line.a90 / L:.3f}",
        f"{line.a90_95 / L:.3f}",
        f"{own.error / L:.4f}",
        f"{int((line.intact > 1.0).sum())} of {line.intact.size}",
    )


def _numbers(line: Line) -> dict[str, object]:
    """Return the numbers of a result."""
    own = line.trials
    return {
        "support": line.support,
        "frequency": line.frequency,
        "noise_db": own.noise_db,
        "hits": int(own.hit.sum()),
        "specimens": own.hit.size,
        "beta": line.curve.beta,
        "a90": line.a90,
        "a90_95": line.a90_95,
        "median_end_error": own.error,
        "false_calls": int((line.intact > 1.0).sum()) if line.intact.size else None,
        "intact_beams": line.intact.size,
        "length": own.lengths,
        "depth": [specimen.thickness for specimen in own.specimens],
        "middle": [0.5 * (specimen.start + specimen.end) for specimen in own.specimens],
        "hit": own.hit,
    }


def _pod(case: Case, options: Pod, place: Place) -> PodStudy:
    """Compute the structures of a grid, and judge them."""
    specimens = grid(case, options.supports, options.frequencies)
    found = population(case, specimens, place.folder, name="pod", **place.sweeping)
    return pod(case, found, options.noise_db)


STUDY = Study(Pod, _pod)

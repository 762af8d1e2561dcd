"""Detect a delamination: measure a case with and without it, and mark where the indices are large.

In Python:

    from delam_fem.studies.detection.detect import detect
    found = detect(df.preset("embedded"))
    found.marks["curvature"].start
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from delam_fem.case.atomic import write_text
from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.studies.detection.indices import FALSE_CALLS, INDICES
from delam_fem.studies.detection.locate import Mark, Repeated, mark, repeated
from delam_fem.studies.detection.measurement import (
    Measurement,
    Scan,
    drive_responses,
    intact,
    simulated,
)
from delam_fem.studies.detection.shapes import Shapes, shapes_of

RESULT = "detection.json"
"""Name of the file with the numbers."""
MAIN = "curvature"
"""The index that calls and locates, unless another is asked for."""
_INTACT_SEED = 1_000_003
"""Added to the seed, so that the intact beam has noise of its own."""


@dataclass(frozen=True)
class Detection:
    """A measurement and what the indices say of it.

    Attributes:
        case: that was measured.
        scan: how it was measured.
        is_measured: whether the field comes from a file.
        name: index that calls and locates.
        shapes: of the measurement, with its noise.
        intact_shapes: of the same structure without delaminations, with as much noise.
        marks: what each index says, by name.
        intact_marks: the same of the intact structure.
        repeated: ends and calls over repeated noise.
        sample_noise: root mean square of the noise in a sample [m/s or m].
    """

    case: Case
    scan: Scan
    is_measured: bool
    name: str
    shapes: Shapes
    intact_shapes: Shapes
    marks: Mapping[str, Mark]
    intact_marks: Mapping[str, Mark]
    repeated: Repeated
    sample_noise: float

    @property
    def mark(self) -> Mark:
        """What the index says that calls and locates."""
        return self.marks[self.name]

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Start and end of each delamination of the case [m]."""
        if self.case.gap is not None:
            return [(0.0, self.case.length)]
        return [(own.start, own.end) for own in self.case.delamination]

    def contrast(self, name: str) -> float:
        """Return the largest value within the delaminations over that outside; NaN without any."""
        if not self.spans:
            return math.nan
        starts, ends = zip(*self.spans, strict=True)
        return self.marks[name].contrast(min(starts), max(ends))

    def numbers(self) -> dict[str, object]:
        """Return the content of detection.json; lengths in m."""
        main, again = self.mark, self.repeated
        return {
            "case": self.case.name,
            "frequency": self.shapes.frequency,
            "index": self.name,
            "detected": main.is_detected,
            "start": _number(main.start),
            "end": _number(main.end),
            "start_bounds": [_number(value) for value in again.start],
            "end_bounds": [_number(value) for value in again.end],
            "call_rate": again.calls,
            "contrast": _number(self.contrast(self.name)),
            "intact_called": self.intact_marks[self.name].is_detected,
            "false_call_rate": FALSE_CALLS,
            "is_measured": self.is_measured,
            "delaminations": [list(span) for span in self.spans],
            "sample_noise": self.sample_noise,
            "shape_noise": _rms(self.shapes.noise),
            "scan": asdict(self.scan) | {"lamina": self.scan.surface(self.case)},
            "indices": {name: self._of_index(name) for name in self.marks},
        }

    def _of_index(self, name: str) -> dict[str, object]:
        """Return the numbers of an index."""
        found = self.marks[name]
        return {
            "detected": found.is_detected,
            "start": _number(found.start),
            "end": _number(found.end),
            "contrast": _number(self.contrast(name)),
            "intact_called": self.intact_marks[name].is_detected,
            "x": found.index.x.tolist(),
            "values": found.index.values.tolist(),
            "limits": found.index.limits.tolist(),
        }

    def rows(self) -> list[tuple[str, ...]]:
        """Return a table row for each index: detected, start, end, contrast, intact called."""
        return [
            (
                name,
                "yes" if found.is_detected else "no",
                _shown(found.start),
                _shown(found.end),
                _shown(self.contrast(name), ".1f"),
                "yes" if self.intact_marks[name].is_detected else "no",
            )
            for name, found in self.marks.items()
        ]

    def save(self, directory: Path) -> Path:
        """Write detection.json into an existing folder and return its path."""
        text = json.dumps(self.numbers(), indent=2, allow_nan=False)
        return write_text(directory / RESULT, text + "\n")


HEADING = ("index", "detected", "start [m]", "end [m]", "contrast", "intact called")
"""Heading of the table of `Detection.rows`."""


def detect(
    case: Case,
    scan: Scan | None = None,
    *,
    index: str = MAIN,
    measured: Measurement | None = None,
    repetitions: int = 200,
    kept: Path | None = None,
) -> Detection:
    """Measure a case with and without its delaminations, and compute all indices.

    Args:
        case: with a harmonic excitation.
        scan: how it is measured; None: as `Scan` has it.
        index: name of the index that calls and locates.
        measured: a measured field in place of a simulated one. The intact structure is still
            simulated, with the noise that the field shows between its harmonics.
        repetitions: number of repetitions of the noise, for the bounds.
        kept: folder for checkpoints, from which the runs go on; None: none are kept.

    Raises:
        CaseError: the case, the scan or the record does not allow it.
    """
    scan = scan or Scan()
    if index not in INDICES:
        raise CaseError(f"index: expected one of {', '.join(INDICES)}, given {index!r}")
    if case.is_apart:
        raise CaseError("detect: expected a case with [[delamination]], given laminae apart")
    whole, surface = intact(case), scan.surface(case)
    without = simulated(whole, scan, kept)

    def shapes(own: Measurement) -> Shapes:
        responses = drive_responses(whole, surface, own.x, own.frequency)
        return _shapes(own).without_drive(responses)

    noise: float | FloatArray
    if measured is None:
        pure = simulated(case, scan, kept)
        noise = pure.noise_of(scan)
        found = shapes(pure.noisy(noise, scan.seed))
        clean = replace(shapes(pure), noise=per_shape(noise, pure.times.size))
    else:
        clean = found = shapes(measured)
        noise = per_sample(found.noise, measured.times.size)
    there = np.interp(without.x, found.x, np.broadcast_to(noise, found.x.shape))
    reference = shapes(without.noisy(there, scan.seed + _INTACT_SEED))
    return Detection(
        case,
        scan,
        measured is not None,
        index,
        found,
        reference,
        _marks(found),
        _marks(reference),
        repeated(index, clean, clean.noise, repetitions=repetitions, seed=scan.seed),
        _rms(noise),
    )


def _rms(noise: float | FloatArray) -> float:
    """Return the root mean square over all points."""
    return float(np.sqrt(np.mean(np.square(noise))))


def per_shape(sample_noise: float | FloatArray, n_samples: int) -> float | FloatArray:
    """Return the root mean square of |δV| that white noise in n samples leads to.

    V = 2/n Σ v exp(-iωt), so E|δV|² = 4 σ²/n.
    """
    return 2.0 * sample_noise / math.sqrt(n_samples)


def per_sample(shape_noise: float | FloatArray, n_samples: int) -> float | FloatArray:
    """Return the noise σ in a sample that belongs to a noise of the shapes; see `per_shape`."""
    return 0.5 * shape_noise * math.sqrt(n_samples)


def _shapes(measurement: Measurement) -> Shapes:
    """Return the shapes of a measurement.

    Raises:
        CaseError: the record is too short.
    """
    try:
        return shapes_of(measurement.field, measurement.times, measurement.frequency, measurement.x)
    except ValueError as error:
        raise CaseError(str(error)) from None


def _marks(shapes: Shapes) -> dict[str, Mark]:
    """Return what each index says; those whose orders were not sampled are left out."""
    needed = {"V3": 3.0, "V1/2": 0.5}
    names = [name for name in INDICES if needed.get(name, 2.0) in shapes.orders]
    return {name: mark(name, shapes) for name in names}


def _number(value: float) -> float | None:
    """Return a number without digits of round-off, or None in place of NaN."""
    return None if not np.isfinite(value) else float(f"{value:.10g}")


def _shown(value: float, form: str = ".4g") -> str:
    """Return a number as text, or a dash in place of NaN."""
    return format(value, form) if np.isfinite(value) else "–"

"""A detection as one page: what was called, the indices, the figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from delam_fem.results.pages.html import Link, Section, Table
from delam_fem.studies.detection.detect import HEADING, RESULT, Detection
from delam_fem.studies.detection.locate import CONFIDENCE
from delam_fem.studies.detection.saving import save_page

_CAPTIONS = {
    "detection": "The index that calls, with its limit of noise and 30 % of its largest value. "
    "Grey: the delamination of the case. Red bars above: bounds of the true ends.",
    "indices": "All indices. The limit is what noise alone exceeds anywhere in 1 of 100 beams.",
    "shapes": "Complex shapes at the excitation and at twice its frequency.",
}


def write_page(found: Detection, figures: Sequence[Path], directory: Path) -> Path:
    """Write the page of a detection into its folder and return its path."""
    more = (
        Section("Indices", [Table(HEADING, found.rows())]),
        Section("Files", [Table(("file", "content"), [(Link(RESULT, RESULT), "all numbers")])]),
    )
    captions = {path: _CAPTIONS[path.stem] for path in figures}
    title = f"Detection in {found.case.name}"
    return save_page(title, verdict(found), captions, found.case, directory, more)


def verdict(found: Detection) -> str:
    """Return in words what was called, where, and with what uncertainty."""
    main, again = found.mark, found.repeated
    at = f"At {found.shapes.frequency:g} Hz the index {found.name}"
    if not main.is_detected:
        return (
            f"{at} calls nothing; it does so in {100.0 * (1.0 - again.calls):.0f} % of repetitions."
        )
    intact = "is called, too" if found.intact_marks[found.name].is_detected else "is not called"
    return (
        f"{at} marks {main.start:.4g} to {main.end:.4g} m. Over repeated noise it calls "
        f"{100.0 * again.calls:.0f} %. With {100.0 * CONFIDENCE:.0f} % each, the true start lies "
        f"within {again.start[0]:.4g}…{again.start[1]:.4g} m and the end within "
        f"{again.end[0]:.4g}…{again.end[1]:.4g} m (noise and spacing of the points). "
        f"The same structure without delamination {intact}."
    )

"""The figures of the paper by name, computed, drawn and written with their claims.

What each figure shows stands in the other `paper_…` modules; the page over all of them in
`paper_page.py`.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from delam_fem.case.atomic import atomic, write_text
from delam_fem.case.toml import CaseError
from delam_fem.paper.claims import Piece
from delam_fem.paper.figures import (
    chart,
    detail,
    lateral,
    linear,
    mesh,
    motion,
    plane,
    response,
    shapes,
    spectra,
    strikes,
    system,
    threshold,
)
from delam_fem.paper.lab import Laboratory
from delam_fem.results.style import styled

FIGURES: dict[str, Callable[[Laboratory], Piece]] = {
    "1": system.system,
    "2a": linear.without_contact,
    "2b": response.with_contact,
    "3": motion.histories,
    "4": shapes.shapes,
    "5": spectra.spectra,
    "6": lateral.rolling_strip,
    "7": lateral.struck_tip,
    "8": strikes.velocities,
    "9": detail.portrait_of_impacts,
    "10": detail.impacts_in_detail,
    "11": chart.chart,
    "12": motion.portraits,
    "13": detail.contact_in_detail,
    "14": mesh.finer_mesh,
    "15": plane.planes,
    "gamma": threshold.threshold,
}
"""The figures by their short names, in the order of the page."""

_log = logging.getLogger(__name__)


def file_stem(name: str) -> str:
    """Return the name of a figure's files: fig01, fig02a, …, or the word itself."""
    digits = name.rstrip("abcdefghijklmnopqrstuvwxyz")
    return f"fig{int(digits):02d}{name[len(digits) :]}" if digits else name


def chosen(names: Sequence[str]) -> list[str]:
    """Return the known names among figures as users write them ("2a", "fig02a", "2" for all of 2).

    Raises:
        CaseError: there is no such figure.
    """
    found: list[str] = []
    for given in names or list(FIGURES):
        short = given.lower().removeprefix("fig").lstrip("0.")
        fits = [name for name in FIGURES if name == short or name.rstrip("ab") == short]
        if not fits:
            raise CaseError(
                f"figure {given!r}: expected one of {', '.join(FIGURES)}; without names all are "
                "made"
            )
        found += [name for name in fits if name not in found]
    return [name for name in FIGURES if name in found]


def reproduce(lab: Laboratory, directory: Path, names: Sequence[str]) -> list[Path]:
    """Compute and write figures.

    Args:
        lab: computes.
        directory: gets figNN.png and figNN.json, and GIFs; made where it does not exist.
        names: as `chosen` returns them.

    Returns:
        The files.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    directory.mkdir(parents=True, exist_ok=True)
    paths: list[Path] = []
    for name in names:
        begin = time.perf_counter()
        with styled():
            piece = FIGURES[name](lab)
            paths += _written(piece, directory, begin)
        _log.info("figure %s: %.1f s", name, time.perf_counter() - begin)
    return paths


def _written(piece: Piece, directory: Path, begin: float) -> list[Path]:
    """Write a piece; files appear under their names when complete."""
    picture, numbers = (directory / f"{file_stem(piece.name)}.{end}" for end in ("png", "json"))
    with atomic(picture) as temporary:
        piece.figure.savefig(temporary, format="png")
    paths = [picture, numbers]
    if piece.animation is not None:
        film = picture.with_suffix(".gif")
        with atomic(film) as temporary:
            piece.animation(temporary)
        paths.append(film)
    content = {
        "name": piece.name,
        "title": piece.title,
        "caption": piece.caption,
        "claims": [asdict(claim) for claim in piece.claims],
        "animation": None if piece.animation is None else f"{file_stem(piece.name)}.gif",
        "seconds": round(time.perf_counter() - begin, 2),
        "numbers": plain(piece.numbers),
    }
    write_text(numbers, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return paths


def plain(value: Any) -> Any:
    """Return numbers as JSON knows them: lists, seven digits, None for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return float(f"{value:.7g}") if np.isfinite(value) else None
    return value

"""Reproduce the figures of the paper: measure each once, judge it, draw it, and write its files.

Each figure is described by a `Piece` in one of the modules of `figures`; page.py writes the page
that shows all figures.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from delam_fem.case.atomic import atomic, write_text
from delam_fem.case.toml import CaseError
from delam_fem.paper.figures import (
    chart,
    detail,
    histories,
    impact_portraits,
    linear,
    mesh,
    plane,
    portraits,
    response,
    rolling_strip,
    shapes,
    spectra,
    strikes,
    struck_tip,
    system,
    threshold,
)
from delam_fem.paper.lab import Laboratory
from delam_fem.paper.piece import Piece
from delam_fem.results.figures.style import styled

FIGURES: dict[str, Piece[Any]] = {
    piece.name: piece
    for piece in (
        system.SYSTEM,
        linear.WITHOUT_CONTACT,
        response.WITH_CONTACT,
        histories.HISTORIES,
        shapes.SHAPES,
        spectra.SPECTRA,
        rolling_strip.ROLLING_STRIP,
        struck_tip.STRUCK_TIP,
        strikes.VELOCITIES,
        impact_portraits.IMPACT_PORTRAITS,
        detail.IMPACTS,
        chart.CHART,
        portraits.PORTRAITS,
        detail.CONTACT,
        mesh.FINER_MESH,
        plane.PLANES,
        threshold.THRESHOLD,
    )
}
"""The figures by their short names, in the order of the page."""

_log = logging.getLogger(__name__)


def file_stem(name: str) -> str:
    """Return the stem of a figure's file names: fig01, fig02a, …, or the name itself."""
    digits = name.rstrip("abcdefghijklmnopqrstuvwxyz")
    return f"fig{int(digits):02d}{name[len(digits) :]}" if digits else name


def chosen(names: Sequence[str]) -> list[str]:
    """Return the known names for figure names given by a user ("2a", "fig02a", "2" for all of 2).

    Raises:
        CaseError: there is no such figure; the message lists the names.
    """
    found: list[str] = []
    for given in names or list(FIGURES):
        short = given.lower().removeprefix("fig").lstrip("0.")
        fits = [name for name in FIGURES if name == short or name.rstrip("ab") == short]
        if not fits:
            raise CaseError(
                f"figure {given!r}: expected one of {', '.join(FIGURES)}; give no names to make "
                "all figures"
            )
        found += [name for name in fits if name not in found]
    return [name for name in FIGURES if name in found]


def reproduce(lab: Laboratory, directory: Path, names: Sequence[str]) -> list[Path]:
    """Compute figures and write their pictures, numbers and films.

    Args:
        lab: laboratory that computes.
        directory: folder for figNN.png, figNN.json and GIFs; it is created if it does not exist.
        names: figure names from `chosen`.

    Returns:
        Paths of the written files.

    Raises:
        OSError: the folder cannot be written or the disk is full.
    """
    directory.mkdir(parents=True, exist_ok=True)
    paths: list[Path] = []
    for name in names:
        begin = time.perf_counter()
        paths += _write(FIGURES[name], lab, directory, begin)
        _log.info("figure %s: %.1f s", name, time.perf_counter() - begin)
    return paths


def _write(piece: Piece[Any], lab: Laboratory, directory: Path, begin: float) -> list[Path]:
    """Write picture, numbers and film of a piece; each file appears only when it is complete."""
    picture, kept = (directory / f"{file_stem(piece.name)}.{end}" for end in ("png", "json"))
    numbers = piece.measure(lab)
    with styled(), atomic(picture) as temporary:
        piece.draw(numbers).savefig(temporary, format="png")
    paths = [picture, kept]
    if piece.film is not None:
        film = picture.with_suffix(".gif")
        with styled(), atomic(film) as temporary:
            piece.film(numbers, temporary)
        paths.append(film)
    content = {
        "name": piece.name,
        "title": piece.title,
        "caption": piece.caption.format(numbers),
        "claims": [asdict(claim) for claim in piece.judge(numbers)],
        "animation": None if piece.film is None else f"{file_stem(piece.name)}.gif",
        "seconds": round(time.perf_counter() - begin, 2),
        "numbers": plain(numbers.to_json()),
    }
    write_text(kept, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    return paths


def plain(value: Any) -> Any:
    """Return numbers in the form of JSON: lists, seven digits, None instead of NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return float(f"{value:.7g}") if np.isfinite(value) else None
    return value

"""A piece: one figure of the paper, described by three functions.

    measure (laboratory → numbers)    draw (numbers → picture)    judge (numbers → claims)

The numbers are a frozen dataclass, so that a test can check a verdict with any numbers. Only `draw`
and `film` import matplotlib, and only when they are called.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from delam_fem.paper.claims import Claim

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from delam_fem.paper.lab import Laboratory

NOT_IN_JSON: Mapping[str, Any] = {"is_in_json": False}
"""Metadata of a `Numbers` field that is not written to figNN.json, often a curve of the picture:
`x: FloatArray = field(metadata=NOT_IN_JSON)`."""


@dataclass(frozen=True)
class Numbers:
    """The measured numbers of a figure; each figure has its own subclass."""

    def to_json(self) -> Mapping[str, Any]:
        """Return the fields of figNN.json by name: all fields except those with `NOT_IN_JSON`."""
        kept = [entry for entry in fields(self) if entry.metadata.get("is_in_json", True)]
        return {entry.name: getattr(self, entry.name) for entry in kept}


N = TypeVar("N", bound=Numbers)


@dataclass(frozen=True)
class Piece(Generic[N]):
    """A figure of the paper with everything that belongs to it.

    Attributes:
        name: short name, for example "2a".
        title: subject of the figure.
        caption: explanation of the comparison; {0.name} stands for a field of the numbers.
        measure: function that computes everything the figure needs and returns its numbers.
        draw: function that returns the picture of the numbers.
        judge: function that returns the claims that the numbers decide.
        film: function that writes a GIF of the numbers to a path; None: there is no film.
    """

    name: str
    title: str
    caption: str
    measure: Callable[[Laboratory], N]
    draw: Callable[[N], Figure]
    judge: Callable[[N], tuple[Claim, ...]]
    film: Callable[[N, Path], None] | None = None

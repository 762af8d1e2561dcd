"""A piece: the description of one figure of the paper by three functions.

    measure (laboratory → numbers)    draw (numbers → picture)    judge (numbers → claims)

The numbers are a frozen dataclass, so that a verdict can be tested with any numbers. Only `draw`
and `film` import matplotlib, and they do so when they are called.
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
"""Metadata of a field of `Numbers` that figNN.json leaves out, often a curve of the picture:
`x: FloatArray = field(metadata=NOT_IN_JSON)`."""


@dataclass(frozen=True)
class Numbers:
    """The numbers of a figure, measured once; each figure has its own subclass."""

    def to_json(self) -> Mapping[str, Any]:
        """Return the fields by their names as figNN.json has them, without `NOT_IN_JSON`."""
        kept = [entry for entry in fields(self) if entry.metadata.get("is_in_json", True)]
        return {entry.name: getattr(self, entry.name) for entry in kept}


N = TypeVar("N", bound=Numbers)


@dataclass(frozen=True)
class Piece(Generic[N]):
    """A figure of the paper with all that belongs to it.

    Attributes:
        name: short name, "2a".
        title: what the figure shows.
        caption: what is compared with what; {0.name} stands for a field of the numbers.
        measure: computes what the figure needs and returns its numbers.
        draw: returns the picture of the numbers.
        judge: returns the claims that the numbers decide.
        film: writes a GIF of the numbers to a path, if there is one.
    """

    name: str
    title: str
    caption: str
    measure: Callable[[Laboratory], N]
    draw: Callable[[N], Figure]
    judge: Callable[[N], tuple[Claim, ...]]
    film: Callable[[N, Path], None] | None = None

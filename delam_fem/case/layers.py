"""Define the sections of bonded stacks: supports and delaminations."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import model_validator

from delam_fem.case.fields import (
    FileName,
    Label,
    NotNegative,
    Positive,
    Section,
    expected,
    inconsistent,
)
from delam_fem.case.units import Unit

SupportKind = Literal["clamped", "pinned", "free"]

EDGE_TOLERANCE = 1e-9
"""Tolerance relative to the length within which an edge is at an end of the structure."""

Neighbours = Annotated[
    tuple[Label, Label], expected("the names of two neighbouring laminae, the lower one first")
]


class Support(Section):
    """The supports of the structure; held points move with the base.

    Attributes:
        start: support at x = 0: "clamped", "pinned" or "free".
        end: support at x = length: the same words.
        rotational_stiffness: moment over slope of each clamped end of a bonded beam [N m]; rigid
            if not given.
    """

    start: SupportKind = "clamped"
    end: SupportKind = "free"
    rotational_stiffness: Annotated[Positive | None, Unit("N m")] = None


class Delamination(Section):
    """A stretch over which two neighbouring laminae are not bonded.

    Attributes:
        between: names of the lower and the upper lamina.
        start: where it begins [m].
        end: where it ends [m].
        opening: largest gap at rest [m]; 0: closed.
        shape: "half-cosine" (zero at both ends) or "power" (zero at the bonded end, largest at the
            end that is open); "half-cosine" if neither shape nor file is given.
        exponent: exponent of the shape "power" [-]; 2 if it is not given.
        file: CSV table with the columns x [m], gap [m] over the delamination; a relative name
            counts from the case file.
    """

    between: Neighbours
    start: Annotated[NotNegative, Unit("m")]
    end: Annotated[Positive, Unit("m")]
    opening: Annotated[NotNegative, Unit("m")] = 0.0
    shape: Literal["half-cosine", "power"] | None = None
    exponent: Positive | None = None
    file: FileName | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Check the order of the edges, and that one shape is given."""
        if not self.start < self.end:
            raise inconsistent(
                "end", f"expected a place beyond start = {self.start!r} m, given {self.end!r}"
            )
        if self.file is not None and (self.shape is not None or self.opening):
            raise inconsistent("file", "expected no shape and no opening beside the table")
        if self.exponent is not None and self.shape != "power":
            raise inconsistent("exponent", 'expected only with shape = "power"')
        return self

    def spans(self, length: float) -> bool:
        """Return whether it reaches from one end of the structure to the other."""
        return self.reaches(0.0, length) and self.reaches(length, length)

    def reaches(self, end: float, length: float) -> bool:
        """Return whether one of its edges is at `end` (0 or the length) of the structure."""
        edge = self.start if end == 0.0 else self.end
        return abs(edge - end) <= EDGE_TOLERANCE * length


def require_fitting(
    delaminations: tuple[Delamination, ...],
    names: tuple[str, ...],
    length: float,
    support: Support,
) -> None:
    """Check delaminations beside the laminae of their case.

    Args:
        delaminations: of the case.
        names: names of the laminae from bottom to top.
        length: length of the laminae [m].
        support: the supports of the case.

    Raises:
        PydanticCustomError: a delamination does not fit; the error names its key.
    """
    before: dict[tuple[str, str], list[tuple[int, Delamination]]] = {}
    for number, own in enumerate(delaminations):
        lower, upper = own.between
        key = f"delamination.{number}"
        neighbours = [*pairwise(names)]
        if (lower, upper) not in neighbours:
            choices = " or ".join(f'["{a}", "{b}"]' for a, b in neighbours)
            raise inconsistent(
                f"{key}.between",
                f'expected neighbours from bottom to top, {choices}, given ["{lower}", "{upper}"]',
            )
        if own.end > length * (1.0 + EDGE_TOLERANCE):
            raise inconsistent(
                f"{key}.end", f"expected at most the length {length!r} m, given {own.end!r}"
            )
        for other_number, other in before.setdefault((lower, upper), []):
            if own.start <= other.end and other.start <= own.end:
                raise inconsistent(
                    f"{key}.start",
                    f"expected a place apart from delamination.{other_number} between the same "
                    f"laminae, {other.start!r} to {other.end!r} m, given {own.start!r}",
                )
        before[lower, upper].append((number, own))
        if own.shape == "power" and len(open_ends(own, length, support)) != 1:
            raise inconsistent(
                f"{key}.shape",
                'expected "half-cosine" or a file: "power" needs one edge at a free end of the '
                "structure",
            )


def open_ends(delamination: Delamination, length: float, support: Support) -> tuple[str, ...]:
    """Return at which ends of the structure a delamination is open: "start", "end"."""
    ends = (("start", 0.0, support.start), ("end", length, support.end))
    return tuple(
        name for name, x, kind in ends if kind == "free" and delamination.reaches(x, length)
    )

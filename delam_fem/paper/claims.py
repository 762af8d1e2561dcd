"""The claims of the paper, and the table that compares them with the computation.

A claim is one statement of the paper that a number can decide. It holds the paper's words, the
computed result, and a verdict.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["holds", "does not hold", "open"]
"""`open`: the paper's text does not allow a verdict."""

HEADING = ("figure", "the paper says", "where", "what came out", "verdict")


@dataclass(frozen=True)
class Claim:
    """One statement of the paper with the computed result.

    Attributes:
        figure: short name of the figure that measures it.
        text: the paper's statement.
        source: section of the paper that makes the statement.
        measured: the computed result, in words and numbers.
        verdict: whether the result agrees with the statement.
    """

    figure: str
    text: str
    source: str
    measured: str
    verdict: Verdict

    @property
    def row(self) -> tuple[str, str, str, str, str]:
        """The claim as a row below `HEADING`."""
        return self.figure, self.text, self.source, self.measured, self.verdict


def judged(is_true: bool) -> Verdict:
    """Return the verdict "holds" or "does not hold"."""
    return "holds" if is_true else "does not hold"


def markdown_table(claims: Iterable[Claim], *, with_source: bool = True) -> str:
    """Return claims as a Markdown table."""
    keep = [k for k in range(len(HEADING)) if with_source or HEADING[k] != "where"]
    rows = [HEADING, *(claim.row for claim in claims)]
    lines = ["| " + " | ".join(row[k].replace("|", "\\|") for k in keep) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(keep), *lines[1:]]) + "\n"

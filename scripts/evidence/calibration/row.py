"""A row of the calibration page: a promise, and how often it held on held-out truths."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.stats import binom

OWN = "as modelled"
"""Rig of the rows whose truths come from the very model that judges them."""
BAND = 0.95
"""Part of the binomial distribution within which the own rig must be."""
LOSS = 2.0
"""How many times as often as promised a verdict may be wrong on another rig."""
NAMED = 0.90
"""Share of the truths at which a warning must name the mismatch to make up for a low share."""


@dataclass(frozen=True)
class Row:
    """How often one verdict or interval of the program was right.

    Attributes:
        verdict: what is printed, such as "`infer`: start, 90 % interval".
        rig: what the truths come from: `OWN`, or in which way they differ from the model.
        nominal: promised share of the decided truths for which it is right, 0 to 1.
        contained: number of decided truths for which it was right.
        truths: number of truths, with the undecided ones.
        undecided: number of truths for which the program said that it cannot tell.
        warned: number of truths at which the program named the mismatch.
        at_least: whether more than the nominal share is promised, as of bounds.
        note: a number or a few words beside it, such as the median width.
    """

    verdict: str
    rig: str
    nominal: float
    contained: int
    truths: int
    undecided: int = 0
    warned: int = 0
    at_least: bool = False
    note: str = ""

    @property
    def decided(self) -> int:
        """Number of truths for which the program gave an answer."""
        return self.truths - self.undecided

    @property
    def band(self) -> tuple[int, int]:
        """Fewest and most contained truths that the promise allows.

        For the own rig this is the binomial band about the nominal share. For others it begins
        where twice as many are wrong as promised, and has no upper end.
        """
        tail = 0.5 * (1.0 - BAND)
        n = self.decided
        if self.rig == OWN:
            most = n if self.at_least else int(binom.isf(tail, n, self.nominal))
            return int(binom.ppf(tail, n, self.nominal)), most
        # few truths scatter: the share that is allowed has a band, too, when the form is short
        least = max(1.0 - LOSS * (1.0 - self.nominal), 0.0)
        if n >= 40 or least == 1.0:
            return round(least * n), n
        return int(binom.ppf(tail, n, least)), n

    @property
    def judgement(self) -> str:
        """The verdict on this verdict, in words."""
        low, high = self.band
        if not self.decided:
            return "undecided"
        if self.contained > high:
            return "wider than promised"
        if self.contained >= low:
            return "holds"
        return "mismatch named" if self.warned >= NAMED * self.truths else "**falls short**"

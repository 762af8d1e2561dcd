"""The four reference motions of the paper.

The paper excites the laminae at four frequencies and describes the motion at each. `MOTIONS` holds
these descriptions; every other module takes frequencies and descriptions from here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from delam_fem.results.strikes import Strikes, of_interface

if TYPE_CHECKING:
    from delam_fem.results.folder import Result

BEATS = 2.0
"""A lamina beats the other one if its tip is more than this factor faster."""
SAME_FREQUENCY = 0.01
"""Two frequencies count as the same if they differ by less than this [Hz]."""


def strikes(result: Result) -> Strikes:
    """Return the strikes of a result with two laminae; see `Strikes`."""
    return of_interface(result.history, result.case.time.steps_per_period, 0)


@dataclass(frozen=True)
class Motion:
    """A motion that the paper describes.

    Attributes:
        frequency: frequency of the base [Hz].
        text: the paper's description, in short.
        periodicity: number of base periods after which the motion repeats.
        has_its_contacts: function that returns whether the tips of a result meet as described.
    """

    frequency: float
    text: str
    periodicity: int
    has_its_contacts: Callable[[Result], bool]

    def is_shown_by(self, result: Result) -> bool:
        """Return whether a result has the periodicity and the contacts of this motion."""
        is_periodic = result.summary["periodicity"] == self.periodicity
        return bool(is_periodic and self.has_its_contacts(result))


def contacts(result: Result) -> float:
    """Return the tip contacts per period; 0 if the case has no contact law."""
    return float(result.summary["tip_contacts_per_period"] or 0.0)


def _no_tip_contact(result: Result) -> bool:
    """Return whether the tips never meet (1.25 Hz)."""
    return contacts(result) == 0.0 and result.summary["minimum_tip_gap"] > 0.0


def _thin_beats_thick(result: Result) -> bool:
    """Return whether the thin tip is much faster than the thick one before a strike (1.60 Hz)."""
    thick, thin = strikes(result).mean
    return contacts(result) >= 1.0 and abs(thin) > BEATS * abs(thick)


def _opposite_velocities(result: Result) -> bool:
    """Return whether the tips meet once a period with opposite velocities (3.25 Hz)."""
    thick, thin = strikes(result).mean
    return contacts(result) == 1.0 and thick > 0.0 > thin


def _one_contact_in_two(result: Result) -> bool:
    """Return whether the tips meet once in two periods (3.65 Hz)."""
    return contacts(result) == 0.5


MOTIONS = (
    Motion(1.25, "no tip contact, weak contact near the clamp", 1, _no_tip_contact),
    Motion(1.60, "the thin lamina beats the thick one", 1, _thin_beats_thick),
    Motion(3.25, "the thick beats the thin, opposite velocities", 1, _opposite_velocities),
    Motion(3.65, "one contact in two periods", 2, _one_contact_in_two),
)
FREQUENCIES = tuple(motion.frequency for motion in MOTIONS)
"""The four excitation frequencies of the paper [Hz]."""
RESONANT = FREQUENCIES[2]
"""The excitation frequency of Figs. 4, 5, 8 to 11 and 13 to 15 [Hz]."""


def is_as_described(result: Result) -> bool:
    """Return whether a result shows the motion that the paper describes for its frequency.

    Return False if the paper describes no motion at this frequency.
    """
    frequency = 1.0 / result.case.period
    return any(
        motion.is_shown_by(result)
        for motion in MOTIONS
        if abs(frequency - motion.frequency) < SAME_FREQUENCY
    )

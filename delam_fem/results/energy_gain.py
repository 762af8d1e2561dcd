"""What impacts have added to the energy of a run, and what helps.

An impulse that acts through another mass matrix than that of the time integration may do work on
the motion instead of taking from it; see docs/convergence.md.
"""

from __future__ import annotations

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.simulation.recorder import EXCHANGED, LEDGER, Recorder

ROUND_OFF = 1e-9
"""Of the energy exchanged in a run: a gain below is no gain. What impacts take is no scale: with
e = 1 that is round-off itself."""
REMEDY = (
    'contact.impulse = "consistent" or time.mass = "lumped": with the consistent mass, lumped '
    "impulses can add energy"
)


def may_add_energy(case: Case) -> bool:
    """Return whether impulses act through another mass matrix than the time integration has."""
    contact = case.contact
    is_mixed = contact.impulse == "lumped" and case.time.mass == "consistent"
    has_jumps = contact.law in ("newton", "newton-penalty")
    return has_jumps and is_mixed and case.time.scheme != "moreau-jean"


def gain_of(recorder: Recorder) -> float:
    """Return the energy that single instants of impact have added in a run [J]."""
    return float(np.nansum(recorder.impulse[: recorder.n_closed, 2]))


def gain_warning(case: Case, recorder: Recorder) -> str | None:
    """Return what to say of a run whose impacts added energy; None where they did not.

    Instants that gain count where impulses act through another mass matrix; the Moreau–Jean laws
    may push pairs that part already and gain by it at an instant, and count by whole periods.
    """
    rows = recorder.ledger[: recorder.n_closed]
    periods = -rows[:, LEDGER.index("impact_loss")]
    least = ROUND_OFF * float(np.nansum(np.abs(rows[:, EXCHANGED])))
    gain = gain_of(recorder)
    taken = gain - float(np.nansum(periods))
    n_gaining = int((periods > least).sum())
    if not n_gaining and not (may_add_energy(case) and gain > least):
        return None
    share = f", {100.0 * gain / taken:.2g} % of what they took" if taken > least else ""
    periods_text = f"; in {n_gaining} periods they added more than they took" if n_gaining else ""
    remedy = REMEDY if may_add_energy(case) else "more steps per period"
    return f"impacts added {gain:.3g} J to the motion{share}{periods_text}; try {remedy}"

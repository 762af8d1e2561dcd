"""Say why the numbers of a run are not good, where they are not."""

from __future__ import annotations

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.model.layout import Structure
from delam_fem.model.mesh import NODE_TOLERANCE
from delam_fem.numerics.arrays import FloatArray
from delam_fem.numerics.schemes import SCHEMES

CLOSED = 1e-6
"""Largest residual of the energy ledger, relative to the energy exchanged, of a good run."""
LOST = 1e-2
"""Residual at which the motion is not that of the equations any more."""
OPEN = "diverged: the energy balance does not close, so that this is not the motion of the case"
STIFF = 1e3
"""Largest product of the angular frequency of a contact spring and the time step."""
GRADED = 1e4
"""Largest ratio of element lengths; stiffnesses differ by its cube, of the 16 digits there are."""


def quality_warnings(case: Case, structure: Structure, residual: float) -> list[str]:
    """Return what may be wrong with the numbers of a run, with the reason; [] if nothing is.

    Args:
        case: the case.
        structure: its discretisation.
        residual: residual of the energy ledger, relative to the energy exchanged [-].
    """
    reasons = [*_stiff_springs(case, structure), *_graded_mesh(structure)]
    if residual <= CLOSED:
        return reasons
    if not np.isfinite(residual):
        return [*reasons, "the energies of a period are not finite: this is no motion of the case"]
    if not reasons:
        reasons = [_known(case, structure)]
    return [
        f"the energy balance of a period is open by {residual:.2g} of what is exchanged "
        f"(good: below {CLOSED:g}): {'; '.join(reasons)}"
    ]


def is_lost(residual: float) -> bool:
    """Return whether a residual is so large that the run counts as diverged; NaN is."""
    return not residual < LOST


def _known(case: Case, structure: Structure) -> str:
    """Return what is known of a balance that no warning explains: the scheme's share, the sizes."""
    scheme, dt = case.time.scheme, case.time_step
    if SCHEMES[scheme].is_explicit:
        return (
            f"{scheme} balances energy only for small steps, given {dt:.3g} s; try more steps per "
            "period"
        )
    o = structure.operators
    return (
        f"the steps of {scheme} balance to round-off, so that these do not say why; known are "
        f"steps of {dt:.3g} s, time.refine = {case.time.refine}, {o.n_dofs} dofs and {o.n_pairs} "
        "contact pairs. Compare with the other --engine, time.refine = 1 and fewer elements, to "
        "see what opens it"
    )


def _stiff_springs(case: Case, structure: Structure) -> list[str]:
    """Return a text if contact springs are far stiffer than the time step can resolve."""
    contact, dt = case.contact, case.time_step
    if contact.law not in ("penalty", "newton-penalty"):
        return []
    lengths = _lengths(structure)
    mass = min(lamina.mass_per_length for lamina in case.lamina) * float(lengths.mean())
    turn = dt * np.sqrt(contact.penalty_stiffness / mass)
    if turn <= STIFF:
        return []
    best = mass * (STIFF / dt) ** 2
    return [
        f"contact.penalty_stiffness = {contact.penalty_stiffness:g} N/m turns a node "
        f"{turn / (2.0 * np.pi):.2g} times within a step, so that the motion in contact is "
        f"arbitrary; try below {best:.1g} N/m, or a rigid law"
    ]


def _graded_mesh(structure: Structure) -> list[str]:
    """Return a text if element lengths differ so much that digits are lost."""
    lengths = _lengths(structure)
    ratio = float(lengths.max() / lengths.min())
    if ratio <= GRADED:
        return []
    return [
        f"the lengths of the elements differ by a factor of {ratio:.2g}, their stiffnesses by its "
        f"cube, and digits are lost; try a factor below {GRADED:g}"
    ]


def _lengths(structure: Structure) -> FloatArray:
    """Return the distances of neighbouring points along x [m]; equal points count once."""
    x = np.unique(structure.layout.x)
    distances = np.diff(x)
    apart: FloatArray = distances[distances > NODE_TOLERANCE * x[-1]]
    return apart

"""What compiled code of the modal engine works on, and the places of its numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from delam_fem.model.reduced import Reduced
from delam_fem.numerics.arrays import FloatArray, IntArray

DRIVE_WORK, MODAL_LOSS, CREEP_LOSS, CONTACT_LOSS = range(4)
"""Indices into `Memory.totals`."""
N_COARSE, N_FINE = range(2)
"""Indices into `Memory.effort`."""
COMPLETED, DIVERGED, UNSOLVED = range(3)
"""How a period ends."""


class Problem(NamedTuple):
    """A reduced problem, see `model.reduced`; m modes, n pairs, c parts.

    Attributes:
        squares: ω², shape (m,).
        damping: shape (m,).
        creep: β, shape (c,).
        gap_columns: Gᵀ, shape (m, n).
        compliance: W of each part, shape (c, n, n).
        gap0: shape (n,).
        gap_drive: h, shape (n,).
    """

    squares: FloatArray
    damping: FloatArray
    creep: FloatArray
    gap_columns: FloatArray
    compliance: FloatArray
    gap0: FloatArray
    gap_drive: FloatArray


class Memory(NamedTuple):
    """The state and the work space.

    Attributes:
        q, v: amplitudes and velocities of the modes, shape (m,).
        s: late contact forces of each part, shape (c, n) [N].
        r: W s, shape (c, n) [m].
        force: contact forces of the last step, shape (n,) [N].
        gap, rate: gaps [m] and their rates [m/s] at the present instant, shape (n,).
        next_q, next_v: amplitudes at the end of a step without contact, shape (m,).
        push: modal contact loads, shape (m,).
        next_gap: gaps at the end of a step, shape (n,).
        bent: W λ of a part, shape (n,).
        totals: energies of the period [J]; shape (4,).
        effort: numbers of coarse and fine steps, shape (2,).
        lowest: smallest gap of each pair, shape (n,) [m].
        pairs, was_active, factor, members, active, trial, is_wrong: memory of the complementarity
            problem; see `complementarity.solve_again`.
    """

    q: FloatArray
    v: FloatArray
    s: FloatArray
    r: FloatArray
    force: FloatArray
    gap: FloatArray
    rate: FloatArray
    next_q: FloatArray
    next_v: FloatArray
    push: FloatArray
    next_gap: FloatArray
    bent: FloatArray
    totals: FloatArray
    effort: IntArray
    lowest: FloatArray
    pairs: IntArray
    was_active: npt.NDArray[np.uint8]
    factor: FloatArray
    members: IntArray
    active: IntArray
    trial: FloatArray
    is_wrong: npt.NDArray[np.uint8]


class Drive(NamedTuple):
    """The drive in a period of N steps.

    Attributes:
        loads: modal loads at each step, shape (N + 1, m).
        motion: q of the drive at each step, shape (N + 1,).
        refine: r, the number of fine steps in a coarse one; 1: contact in coarse steps.
    """

    loads: FloatArray
    motion: FloatArray
    refine: int


class Trace(NamedTuple):
    """What is kept of a period.

    Attributes:
        q, v: amplitudes and velocities of the modes at each step, shape (N + 1, m).
        s: late contact forces at each step, shape (N + 1, c, n) [N].
        impulse: integral of the contact forces over each step, 0 at the start, shape (N + 1, n)
            [N s].
    """

    q: FloatArray
    v: FloatArray
    s: FloatArray
    impulse: FloatArray


def problem_of(reduced: Reduced) -> Problem:
    """Return a reduced problem as arrays of compiled code."""
    return Problem(
        reduced.squares,
        reduced.damping,
        reduced.creep,
        np.ascontiguousarray(reduced.gap_modes.T),
        np.ascontiguousarray(reduced.compliance),
        reduced.gap0,
        reduced.gap_drive,
    )


def memory(m: int, n: int, c: int) -> Memory:
    """Allocate the memory of a problem, at rest."""
    return Memory(
        q=np.zeros(m),
        v=np.zeros(m),
        s=np.zeros((c, n)),
        r=np.zeros((c, n)),
        force=np.zeros(n),
        gap=np.zeros(n),
        rate=np.zeros(n),
        next_q=np.zeros(m),
        next_v=np.zeros(m),
        push=np.zeros(m),
        next_gap=np.zeros(n),
        bent=np.zeros(n),
        totals=np.zeros(4),
        effort=np.zeros(2, dtype=np.int64),
        lowest=np.zeros(n),
        pairs=np.arange(n),
        was_active=np.zeros(n, dtype=np.uint8),
        factor=np.zeros(n**2),
        members=np.full(n + 1, -1),
        active=np.zeros(n, dtype=np.int64),
        trial=np.zeros(n),
        is_wrong=np.zeros(n, dtype=np.uint8),
    )


def trace(n_steps: int, m: int, n: int, c: int) -> Trace:
    """Allocate the record of a period."""
    rows = n_steps + 1
    return Trace(
        np.zeros((rows, m)), np.zeros((rows, m)), np.zeros((rows, c, n)), np.zeros((rows, n))
    )

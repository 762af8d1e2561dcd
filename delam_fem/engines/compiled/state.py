"""What compiled code changes while it runs, and the contact law as numbers.

Arrays are made once; compiled functions get them as members of these tuples.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from delam_fem.engines.compiled.lane_kernels import N_FIELDS
from delam_fem.engines.compiled.simd import aligned_zeros
from delam_fem.numerics.arrays import FloatArray, IntArray

NONE, IMPACTS, PENALTY, MOREAU, RECOVERY = range(5)
"""Kinds of laws; "newton" is IMPACTS without a threshold, the last two go with the θ-scheme."""
DISSIPATED, CONTACT_DAMPED, IMPACT, RELEASED = range(4)
"""Places in `Memory.totals`."""
KINETIC, STRAIN, SPRING, MOMENTUM, ATTACHMENT = range(5)
"""Places in `Memory.stored`."""
N_SPRINGS, N_EVENTS, N_HITS, N_FRAMES, N_RESTING = range(5)
"""Places in `Memory.counts`."""


class LawNumbers(NamedTuple):
    """A contact law as compiled code reads it.

    Attributes:
        kind: NONE, IMPACTS, PENALTY, MOREAU or RECOVERY.
        is_coupled: simultaneous impacts feel one another ("consistent").
        restitution: e [-].
        stiffness: of the springs [N/m].
        damping: of the springs [N s/m].
        threshold: rate after an impact below which a pair rests on a spring, -inf: never; MOREAU
            and RECOVERY: approach slower than this counts as resting [m/s].
    """

    kind: int
    is_coupled: bool = False
    restitution: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    threshold: float = -np.inf


class Memory(NamedTuple):
    """State and work space.

    Attributes:
        X: fields of lane_kernels.py one after the other, shape (8 size,).
        base: q, q', q'' of the base now, shape (3,).
        totals: dissipated, damped in contacts, by impacts, released by springs so far [J].
        stored: kinetic, strain and spring energy of the free dofs [J], m_b·v and k_b·u when last
            asked for, or when a period ended.
        counts: springs, what is filled of the event buffers, pairs at rest under the θ-scheme.
        resting: pairs at rest; they carry a spring but under the θ-scheme, shape (n_pairs,).
        pairs: those with a spring as a list, its first counts[N_SPRINGS].
        compliance: W = H B⁻¹ Hᵀ, columns as far as known, shape (n_pairs, n_pairs).
        is_known: which, shape (n_pairs,).
        gap, rate: of all pairs at the examined instant, each of shape (n_pairs,).
        hit: pairs that are hit now, a list.
        impulse, rate_pre, rate_post: of these.
        change: W p of the hit pairs [m/s].
        forces, residual, direction, image: work space of springs and impulses.
    """

    X: FloatArray
    base: FloatArray
    totals: FloatArray
    stored: FloatArray
    counts: IntArray
    resting: npt.NDArray[np.uint8]
    pairs: IntArray
    compliance: FloatArray
    is_known: npt.NDArray[np.uint8]
    gap: FloatArray
    rate: FloatArray
    hit: IntArray
    impulse: FloatArray
    rate_pre: FloatArray
    rate_post: FloatArray
    change: FloatArray
    forces: FloatArray
    residual: FloatArray
    direction: FloatArray
    image: FloatArray


class Log(NamedTuple):
    """Where a period is written.

    Attributes:
        n_steps: N.
        n_frames: frames to keep.
        n_events, n_hits: room in the event buffers.
        base_states: q, q', q'' of the base at each step, shape (N + 1, 3).
        u: m_b·u, c_b·u, k_b·u and the probes of u at each step, shape (N + 1, 3 + n_probes).
        v: probes of v, shape (N + 1, n_probes).
        frame_steps: steps whose state is kept.
        frames: u and v of these in internal order, shape (n_frames, 2, size).
        contact: 0 open, 1 hit, 2 resting, shape (n_frames, n_pairs).
        event_step, event_size, event_energy: step, number of hits, energy change of each impact.
        hit, impulse, rate_pre, rate_post: of the hits of all impacts one after the other.
    """

    n_steps: int
    n_frames: int
    n_events: int
    n_hits: int
    base_states: FloatArray
    u: FloatArray
    v: FloatArray
    frame_steps: IntArray
    frames: FloatArray
    contact: npt.NDArray[np.int8]
    event_step: IntArray
    event_size: IntArray
    event_energy: FloatArray
    hit: IntArray
    impulse: FloatArray
    rate_pre: FloatArray
    rate_post: FloatArray


def memory(size: int, n_pairs: int) -> Memory:
    """Return a state at rest."""
    return Memory(
        X=aligned_zeros(N_FIELDS * size),
        base=np.zeros(3),
        totals=np.zeros(4),
        stored=np.zeros(5),
        counts=np.zeros(5, dtype=np.int64),
        resting=np.zeros(n_pairs, dtype=np.uint8),
        pairs=np.zeros(n_pairs, dtype=np.int64),
        compliance=np.zeros((n_pairs, n_pairs)),
        is_known=np.zeros(n_pairs, dtype=np.uint8),
        gap=np.zeros(n_pairs),
        rate=np.zeros(n_pairs),
        hit=np.zeros(n_pairs, dtype=np.int64),
        impulse=np.zeros(n_pairs),
        rate_pre=np.zeros(n_pairs),
        rate_post=np.zeros(n_pairs),
        change=np.zeros(n_pairs),
        forces=np.zeros(n_pairs),
        residual=np.zeros(n_pairs),
        direction=np.zeros(n_pairs),
        image=np.zeros(n_pairs),
    )

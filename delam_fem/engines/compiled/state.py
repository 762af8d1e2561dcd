"""The arrays that compiled code changes while it runs, and how it gets them as one address.

Numba takes a named tuple apart leaf by leaf in each call, and passes the leaves on one by one: with
some 250 of them a call costs 70 µs, and compiling takes minutes. `packed` writes the leaves once
into a table: numbers as they are, arrays as their addresses. Compiled code reads the members of a
`View` of that table by the names of the tuple.

The arrays are allocated once; compiled functions get them through a `View`.
"""

from __future__ import annotations

import struct
from functools import cache, lru_cache
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model
from numba.np.numpy_support import from_dtype

from delam_fem.contact.complementarity import WarmStart, nothing_known
from delam_fem.contact.decisions import HitPairs, PairState
from delam_fem.engines.compiled.simd_chains import N_FIELDS, aligned_zeros
from delam_fem.numerics.types import FloatArray, IntArray

_NUMBERS = {int: types.int64, float: types.float64, bool: types.boolean}
_WORD = 8
"""Bytes of a leaf."""


@cache
def _members(kind: Any) -> tuple[tuple[str, type, np.dtype[Any] | None], ...]:
    """Return name and class of each member of a class of tuples, and the type of its numbers.

    The last is None if the member is no array.
    """
    hints = get_type_hints(kind).items()
    arrays = [get_args(hint) for _, hint in hints]  # of numpy.ndarray[shape, numpy.dtype[number]]
    numbers = [np.dtype(get_args(arguments[1])[0]) if arguments else None for arguments in arrays]
    return tuple((name, hint, of) for (name, hint), of in zip(hints, numbers, strict=True))


class View(types.Type):  # type: ignore[misc]
    """Numba's type for the table of a class of named tuples; nested ones lie within it."""

    def __init__(self, kind: type) -> None:
        """Find the place and the type of each member."""
        self.members: dict[str, tuple[int, types.Type]] = {}
        self.length = 0
        for name, hint, of in _members(kind):
            if of is not None:  # Numba stores no booleans at pointers
                number = from_dtype(np.dtype(np.uint8) if of == np.bool_ else of)
                member = types.CPointer(number)
            else:
                member = _NUMBERS[hint] if hint in _NUMBERS else View(hint)
            self.members[name] = self.length, member
            self.length += member.length if isinstance(member, View) else 1
        super().__init__(name=f"View({kind.__module__}.{kind.__qualname__})")


@register_model(View)
class _ViewModel(models.PrimitiveModel):  # type: ignore[misc]
    """Stores a view as the address of its table."""

    def __init__(self, manager, kind):  # type: ignore[no-untyped-def]
        super().__init__(manager, kind, ir.IntType(8).as_pointer())


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    """Tells Numba the types of the members."""

    key = View

    def generic_resolve(self, kind, name):  # type: ignore[no-untyped-def]
        """Return the type of a member."""
        return kind.members[name][1] if name in kind.members else None


@lower_getattr_generic(View)
def _member(context, builder, kind, value, name):  # type: ignore[no-untyped-def]
    """Read a member; no code changes a table, so that LLVM may keep what it has read."""
    place, member = kind.members[name]
    at = cgutils.gep_inbounds(builder, value, _WORD * place)
    if isinstance(member, View):
        return at
    stored = context.get_value_type(types.int64 if member is types.boolean else member)
    leaf = builder.load(builder.bitcast(at, stored.as_pointer()))
    leaf.set_metadata("invariant.load", builder.module.add_metadata([]))
    return builder.trunc(leaf, ir.IntType(1)) if member is types.boolean else leaf


@cache
def view_at(kind: type) -> Any:
    """Return the compiled function that turns an address into a view of a class of tuples."""
    view = View(kind)

    @intrinsic
    def function(typing, address):  # type: ignore[no-untyped-def]
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
            return builder.inttoptr(values[0], ir.IntType(8).as_pointer())

        return view(types.int64), code

    return function


def packed(values: Any, lasting: tuple[type, ...] = ()) -> IntArray:
    """Return the table of a named tuple; who keeps it must keep the tuple's arrays too.

    Args:
        values: the named tuple.
        lasting: classes of nested tuples that several tables share; the leaves of the last ones are
            kept.

    Raises:
        TypeError: an array is not what the tuple's class says, or not in one piece.
    """
    return np.array(_leaves(values, lasting), dtype=np.int64)


def _leaves(values: Any, lasting: tuple[type, ...] = ()) -> list[int]:
    """Return the numbers in the table of a named tuple."""
    kind: Any = type(values)
    leaves: list[int] = []
    for (name, hint, of), value in zip(_members(kind), values, strict=True):
        if of is not None:
            if value.dtype != of or not value.flags.c_contiguous:
                raise TypeError(f"{name}: expected {of} in one piece, given {value.dtype}")
            leaves.append(value.ctypes.data)
        elif hint is float:
            leaves += struct.unpack("q", struct.pack("d", value))
        elif hint in _NUMBERS:
            leaves.append(int(value))
        else:
            leaves += _lasting_leaves(_Same(value)) if hint in lasting else _leaves(value)
    return leaves


class _Same:
    """A tuple as a key that equals itself alone."""

    def __init__(self, value: Any) -> None:
        """Keep the tuple, so that no other one gets its number."""
        self.value = value

    def __hash__(self) -> int:
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.value is self.value


@lru_cache(maxsize=8)
def _lasting_leaves(key: _Same) -> list[int]:
    """Return the leaves of a tuple; neither they nor its arrays change places."""
    return _leaves(key.value)


DISSIPATED, CONTACT_DAMPED, IMPACT, RELEASED = range(4)
"""Indices into `Memory.totals`."""
N_SPRINGS, N_EVENTS, N_HITS, N_FRAMES, N_RESTING, IS_SEEN, SLOT, OLD_EVENTS, OLD_HITS = range(9)
"""Indices into `Memory.counts`."""
COMPLETED, DIVERGED, FULL = 0, 1, 2
"""Results of a loop, besides failures, which are negative (`contact.examine`)."""


class Memory(NamedTuple):
    """The state and the work space of compiled code.

    Attributes:
        X: the fields of simd_chains.py one after the other, shape (N_FIELDS size,).
        base: current q, q', q'' of the base, shape (3,).
        kept: u, v, a before a step that may be undone, shape (3 size,).
        near: whether a gap is small according to a coarse step, shape (n_pairs,).
        seen: m_b·u, c_b·u, k_b·u at the end of the last step, shape (3,).
        flows: sums over divided steps for the work of the base (`recorder.add_flows`), shape (4,).
        effort: numbers of steps and contacts (`recorder.EFFORT`), shape (5,).
        totals: energies so far: dissipated, damped in contacts, by impacts, released by springs,
            shape (4,) [J].
        force: present further forces, shape (n_forces,) [N].
        ahead: the same at the end of the step, shape (n_forces,) [N].
        undone_force: the same before a step that may be undone, shape (n_forces,) [N].
        load: constant loads and those of further forces within the step, shape (size,).
        reading: further forces and what they moved at the end of the last small step, shape
            (2 n_forces,).
        force_flows: works of further forces over divided steps, shape (n_forces,) [J].
        counts: numbers of springs, of filled entries in the buffers for events, hits and frames,
            and of pairs at rest with the θ-scheme; in modes, whether `present_gap` and
            `present_rate` are those of the state; slot of the period, and numbers of events and
            hits before it; shape (9,).
        pair_state: what is remembered of the pairs; those at rest carry a spring, except with the
            θ-scheme.
        pairs: the first counts[N_SPRINGS] entries list the pairs with a spring, shape (n_pairs,).
        compliance: W = H B⁻¹ Hᵀ for fine, middle and coarse steps, column after column, of which
            the known ones are filled, shape (3, n_pairs, n_pairs).
        is_known: whether a column of W is known, for each size of steps, shape (3 n_pairs,).
        gap, rate: gaps and gap rates of all pairs at the examined instant, each shape (n_pairs,).
        present_gap, present_rate: gaps and gap rates of the state, in modes, or of
            `steps._mark_points`, each of shape (n_pairs,).
        hits: the pairs that are hit now, with room for all pairs.
        free: gap rates of all pairs at the end of the step without impulses, if pairs touch at
            rest, shape (n_pairs,) [m/s].
        again: memory of the complementarity problem.
        forces, residual, direction, image, softness: work space for springs.
    """

    X: FloatArray
    base: FloatArray
    kept: FloatArray
    near: npt.NDArray[np.uint8]
    seen: FloatArray
    flows: FloatArray
    force: FloatArray
    ahead: FloatArray
    undone_force: FloatArray
    load: FloatArray
    reading: FloatArray
    force_flows: FloatArray
    effort: IntArray
    totals: FloatArray
    counts: IntArray
    pair_state: PairState
    pairs: IntArray
    compliance: FloatArray
    is_known: npt.NDArray[np.uint8]
    gap: FloatArray
    rate: FloatArray
    present_gap: FloatArray
    present_rate: FloatArray
    hits: HitPairs
    forces: FloatArray
    residual: FloatArray
    direction: FloatArray
    image: FloatArray
    softness: FloatArray
    free: FloatArray
    again: WarmStart


class PeriodBuffers(NamedTuple):
    """The buffers into which a block of periods is written.

    A block has as many slots as the window may need periods; period j of the block is in slot
    j mod n_slots.

    Attributes:
        n_steps: N.
        refine: r, the number of fine steps (ticks) in a step.
        middle: number of middle steps in a step.
        slow: gap rate up to which a pair does not divide a step [m/s].
        n_slots: number of slots.
        n_frames: number of frames to keep in a period.
        n_probes: number of probes, without sensors.
        n_events, n_hits: sizes of the event buffers.
        time_step: Δt of a coarse step [s].
        limit: gap or displacement beyond which a motion counts as diverged [m].
        coupling: see `recorder.write_ledger`, shape (4 + n_forces,).
        frame_steps: steps whose state is kept, shape (n_frames,).
        base_states: q, q', q'' of the base at each step, shape (N + 1, 3).
        forces: values and two derivatives of further forces at each step, shape (N + 1,
            3 n_forces).
        u: m_b·u, c_b·u, k_b·u and the probes of u at each step, shape (n_slots, N + 1, 3 +
            n_observed).
        v: the probes of v at each step, shape (n_slots, N + 1, n_observed).
        is_divided: whether a step was divided near contact, shape (n_slots, N + 1).
        frames: u and v at the frames in internal order, shape (n_slots, n_frames, 2, size).
        contact: 0 open, 1 hit, 2 resting, shape (n_slots, n_frames, n_pairs).
        resting: pairs at rest when each period began, shape (n_slots, n_pairs).
        damped: energy that the damper of each pair has taken in the period, shape (n_slots,
            n_pairs) [J].
        levels: energies (`recorder.LEVEL`) at the start of the first period and the end of each,
            shape (n_periods + 1, 6).
        ends: at the end of each period of the block its number of steps, and the numbers of events
            and hits in the buffers, shape (n_periods, 3).
        event_tick, event_size, event_energy: tick, number of hits, energy change of each impact,
            each of shape (n_events,).
        hit, impulse, rate_pre, rate_post: values of the hits of all impacts one after the other,
            each of shape (n_hits,).
        strobe, envelope, ledger, works, impulses, effort: the rows of all periods of the run; see
            `simulation.recorder.Recorder`.
    """

    n_steps: int
    refine: int
    middle: int
    slow: float
    n_slots: int
    n_frames: int
    n_probes: int
    n_events: int
    n_hits: int
    time_step: float
    limit: float
    coupling: FloatArray
    frame_steps: IntArray
    base_states: FloatArray
    forces: FloatArray
    u: FloatArray
    v: FloatArray
    is_divided: npt.NDArray[np.uint8]
    frames: FloatArray
    contact: npt.NDArray[np.int8]
    resting: npt.NDArray[np.uint8]
    damped: FloatArray
    levels: FloatArray
    ends: IntArray
    event_tick: IntArray
    event_size: IntArray
    event_energy: FloatArray
    hit: IntArray
    impulse: FloatArray
    rate_pre: FloatArray
    rate_post: FloatArray
    strobe: FloatArray
    envelope: FloatArray
    ledger: FloatArray
    works: FloatArray
    impulses: FloatArray
    effort: IntArray


def memory(size: int, n_pairs: int, n_forces: int = 0) -> Memory:
    """Allocate the memory of a problem; the state is at rest."""
    return Memory(
        X=aligned_zeros(N_FIELDS * size),
        base=np.zeros(3),
        kept=np.zeros(3 * size),
        near=np.zeros(n_pairs, dtype=np.uint8),
        seen=np.zeros(3),
        flows=np.zeros(4),
        force=np.zeros(n_forces),
        ahead=np.zeros(n_forces),
        undone_force=np.zeros(n_forces),
        load=aligned_zeros(size),
        reading=np.zeros(2 * n_forces),
        force_flows=np.zeros(n_forces),
        effort=np.zeros(5, dtype=np.int64),
        totals=np.zeros(4),
        counts=np.zeros(9, dtype=np.int64),
        pair_state=PairState.at_start(n_pairs),
        pairs=np.zeros(n_pairs, dtype=np.int64),
        compliance=np.zeros((3, n_pairs, n_pairs)),
        is_known=np.zeros(3 * n_pairs, dtype=np.uint8),
        gap=np.zeros(n_pairs),
        rate=np.zeros(n_pairs),
        present_gap=np.zeros(n_pairs),
        present_rate=np.zeros(n_pairs),
        hits=HitPairs.room(n_pairs),
        forces=np.zeros(n_pairs),
        residual=np.zeros(n_pairs),
        direction=np.zeros(n_pairs),
        image=np.zeros(n_pairs),
        softness=np.zeros(n_pairs),
        free=np.zeros(n_pairs),
        again=nothing_known(n_pairs),
    )

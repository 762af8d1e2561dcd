"""Hand named tuples of numbers and arrays to compiled code as one address.

Numba takes a named tuple apart leaf by leaf in each call, and passes the leaves on one by one: with
some 250 of them a call costs 70 µs, and compiling takes minutes. `packed` writes the leaves once
into a table: numbers as they are, arrays as their addresses. Compiled code reads the members of a
`View` of that table by the names of the tuple.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any, get_args, get_type_hints

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
)
from numba.np.numpy_support import from_dtype

from delam_fem.numerics.arrays import IntArray

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
    numbers = [np.dtype(get_args(given[1])[0]) if given else None for given in arrays]
    return tuple((name, hint, of) for (name, hint), of in zip(hints, numbers, strict=True))


class View(types.Type):  # type: ignore[misc]
    """Numba's type for the table of a class of named tuples; nested ones lie within it."""

    def __init__(self, kind: type) -> None:
        """Find the place and the type of each member."""
        self.members: dict[str, tuple[int, types.Type]] = {}
        self.length = 0
        for name, hint, of in _members(kind):
            if of is not None:
                member = types.CPointer(from_dtype(of))
            else:
                member = _NUMBERS[hint] if hint in _NUMBERS else View(hint)
            self.members[name] = self.length, member
            self.length += member.length if isinstance(member, View) else 1
        super().__init__(name=f"View({kind.__module__}.{kind.__qualname__})")


@register_model(View)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
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


def packed(values: Any) -> IntArray:
    """Return the table of a named tuple; who keeps it must keep the tuple's arrays too.

    Raises:
        TypeError: an array is not what the tuple's class says, or not in one piece.
    """
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
            leaves += packed(value).tolist()
    return np.array(leaves, dtype=np.int64)

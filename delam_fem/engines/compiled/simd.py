"""Vectors of four doubles in compiled code, so that one instruction works on four chains.

Numba by itself leaves loops over four lanes scalar: they are too short for its loop vectoriser, and
vectorisation of straight code is off. `float64x4` is LLVM's <4 x double>. On a machine without
registers of that width it takes two or four instructions.
"""

from __future__ import annotations

import operator

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

from delam_fem.numerics.arrays import FloatArray

WIDTH = 4
"""Number of doubles in a vector."""
_ALIGNMENT = 64
"""Bytes of a cache line; arrays aligned to it have no vector that lies in two cache lines."""
_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_LANES = ir.VectorType(ir.IntType(32), WIDTH)


class _Float64x4(types.Type):  # type: ignore[misc]
    """Numba's type for a vector of four doubles."""

    def __init__(self) -> None:
        super().__init__(name="float64x4")


float64x4 = _Float64x4()


@register_model(_Float64x4)
class _Model(models.PrimitiveModel):  # type: ignore[misc]
    """Stores the type as LLVM's own vector."""

    def __init__(self, manager, kind):  # type: ignore[no-untyped-def]
        super().__init__(manager, kind, _VECTOR)


def aligned_zeros(size: int) -> FloatArray:
    """Return an array of zeros that begins at a cache line, shape (size,)."""
    raw = np.zeros(size + _ALIGNMENT // 8)
    first = (-raw.ctypes.data % _ALIGNMENT) // 8
    return raw[first : first + size]


def _address(context, builder, signature, values):  # type: ignore[no-untyped-def]
    """Return the address of a vector at pointer + index."""
    index = context.cast(builder, values[1], signature.args[1], types.intp)
    return builder.bitcast(builder.gep(values[0], [index]), _VECTOR.as_pointer())


@intrinsic
def load(typing, pointer, index):  # type: ignore[no-untyped-def]
    """Return the four numbers that begin at an index of a pointer."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        place = _address(context, builder, signature, values)  # type: ignore[no-untyped-call]
        return builder.load(place, align=8)

    return float64x4(pointer, index), code


@intrinsic
def store(typing, pointer, index, value):  # type: ignore[no-untyped-def]
    """Write four numbers that begin at an index of a pointer."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        place = _address(context, builder, signature, values)  # type: ignore[no-untyped-call]
        builder.store(values[2], place, align=8)
        return context.get_dummy_value()

    return types.none(pointer, index, value), code


@intrinsic
def splat(typing, x):  # type: ignore[no-untyped-def]
    """Return the vector (x, x, x, x)."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        scalar = context.cast(builder, values[0], signature.args[0], types.float64)
        one = builder.insert_element(
            ir.Constant(_VECTOR, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0)
        )
        zeros = ir.Constant(_LANES, [0] * WIDTH)
        return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), zeros)

    return float64x4(x), code


@intrinsic
def fma(typing, a, b, c):  # type: ignore[no-untyped-def]
    """Return a b + c, rounded once if the machine has such an instruction."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.fmuladd.v4f64")
        return builder.call(function, values)

    return float64x4(a, b, c), code


def _elementwise(name: str):  # type: ignore[no-untyped-def]
    """Return an intrinsic that applies an LLVM instruction to two vectors."""

    @intrinsic
    def function(typing, a, b):  # type: ignore[no-untyped-def]
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
            return getattr(builder, name)(*values)

        return float64x4(a, b), code

    return function


def _shuffled(order: tuple[int, ...]):  # type: ignore[no-untyped-def]
    """Return an intrinsic that reorders the lanes of a vector."""

    @intrinsic
    def function(typing, a):  # type: ignore[no-untyped-def]
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
            mask = ir.Constant(_LANES, list(order))
            return builder.shuffle_vector(values[0], values[0], mask)

        return float64x4(a), code

    return function


_add, _sub, _mul = (_elementwise(name) for name in ("fadd", "fsub", "fmul"))
swap_neighbours = _shuffled((1, 0, 3, 2))
swap_halves = _shuffled((2, 3, 0, 1))


@intrinsic
def smaller(typing, a, b):  # type: ignore[no-untyped-def]
    """Return the smaller number in each lane; where a is NaN, return b."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        return builder.select(builder.fcmp_ordered("<", *values), *values)

    return float64x4(a, b), code


@intrinsic
def lane(typing, a, index):  # type: ignore[no-untyped-def]
    """Return one of the four doubles of a vector."""

    def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
        index = context.cast(builder, values[1], signature.args[1], types.int32)
        return builder.extract_element(values[0], index)

    return types.float64(a, index), code


@overload(operator.add)
def _overload_add(a, b):  # type: ignore[no-untyped-def]
    if a == float64x4 and b == float64x4:
        return lambda a, b: _add(a, b)
    return None


@overload(operator.sub)
def _overload_sub(a, b):  # type: ignore[no-untyped-def]
    if a == float64x4 and b == float64x4:
        return lambda a, b: _sub(a, b)
    return None


@overload(operator.mul)
def _overload_mul(a, b):  # type: ignore[no-untyped-def]
    if a == float64x4 and b == float64x4:
        return lambda a, b: _mul(a, b)
    return None

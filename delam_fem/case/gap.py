"""Compute the gap at rest between laminae: a power, a mode, an arch, or a measured table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy  # loads its parts when they are used

from delam_fem.case.sections import Delamination, InitialGap, Stop
from delam_fem.case.tables import in_si_units, read_columns
from delam_fem.numerics.beams import cantilever_mode
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError, require

_END_TOLERANCE = 1e-9
"""Tolerance relative to L, so that a table written with nine digits still reaches the free end."""
_LONGER = 2e-3
"""Share of L by which a measured table may go beyond the free end."""


def initial_gap(gap: InitialGap, x: npt.ArrayLike, length: float) -> FloatArray:
    """Return the gap at rest g0(x) of laminae that are apart.

        exponent:  root + (tip - root) (x/L)^p
        mode:      root + (tip - root) w1(x/L), the exact first cantilever mode with w1(1) = 1
        file:      the table, interpolated by PCHIP: no overshoot between the rows, and a
                   continuous slope

    Args:
        gap: the section `gap` of the case.
        x: positions from the clamp, shape (n,) [m].
        length: length L of the laminae [m].

    Returns:
        Gap at x, shape (n,) [m]; positive is open.

    Raises:
        CaseError: the table cannot be used, or the gap is closed at some x > 0.

    Source: the paper gives only the gap at the tip (12 mm).
    """
    x = np.asarray(x, dtype=np.float64)
    root = gap.root or 0.0
    xi = np.clip(x / length, 0.0, 1.0)
    if gap.file is not None:
        table = read_gap_table(gap.file, length)
        g0: FloatArray = scipy.interpolate.PchipInterpolator(*table)(np.clip(x, 0.0, table[0][-1]))
        source = f"gap.file {gap.file}"
    elif gap.tip is None:
        raise CaseError("gap.tip: missing, but required unless gap.file is given")
    elif gap.exponent is not None:
        rise = xi**gap.exponent
        source = f"gap.exponent {gap.exponent!r}"
        g0 = root + (gap.tip - root) * rise
    else:
        g0 = root + (gap.tip - root) * cantilever_mode(1, xi)
        source = "gap.shape"
    closed = np.flatnonzero((x > 0.0) & ~(g0 > 0.0))
    if closed.size:
        k = closed[0]
        raise CaseError(
            f"{source}: the gap starts closed beyond the clamp: expected a positive gap at every "
            f"node with x > 0, given {g0[k]:.6g} m at x = {x[k]:.6g} m"
        )
    return g0


def opening_at_rest(
    own: Delamination | Stop,
    x: FloatArray,
    length: float,
    *,
    opens_at_start: bool = False,
    z: FloatArray | None = None,
) -> FloatArray:
    """Return the gap at rest at places within a delamination or a stop, shape of x [m].

        half-cosine:  opening cos(pi (s - 1/2)),  s = (x - start)/(end - start)
        of a patch:   opening cos(pi r/2) of an ellipse, r from 0 in its middle to 1 at its edge;
                      of a rectangle the product of both half-cosines
        power:        opening s^p, s from the bonded end to the open end; of a stop to its end
        file:         the table, interpolated by PCHIP

    Args:
        own: the delamination or the stop, with edges, opening and shape.
        x: places from start to end [m].
        length: length of the laminae [m].
        opens_at_start: whether the open end of the shape "power" is the start.
        z: places across the width, shape of x [m]; None: the middle.

    Raises:
        CaseError: the table cannot be used.
    """
    if own.start is None or own.end is None:  # of a stop at a point
        return np.zeros_like(x)
    if own.file is not None:
        table = read_table(own.file, own.start, own.end, length)
        return np.asarray(
            scipy.interpolate.PchipInterpolator(*table)(np.clip(x, table[0][0], table[0][-1]))
        )
    if isinstance(own, Delamination) and own.across is not None:
        along, over = own.local(x, np.zeros_like(x) if z is None else z)
        if own.is_ellipse:
            r = np.minimum(np.hypot(along, over), 1.0)
            return np.asarray(own.opening * np.cos(0.5 * np.pi * r))
        half_cosines = [np.cos(0.5 * np.pi * np.clip(s, -1.0, 1.0)) for s in (along, over)]
        return np.asarray(own.opening * half_cosines[0] * half_cosines[1])
    s = np.clip((x - own.start) / (own.end - own.start), 0.0, 1.0)
    if own.shape == "power":
        s = 1.0 - s if opens_at_start else s
        return np.asarray(own.opening * s ** (2.0 if own.exponent is None else own.exponent))
    return np.asarray(own.opening * np.sin(np.pi * s))


def read_gap_table(path: Path, length: float) -> tuple[FloatArray, FloatArray]:
    """Read the gap from a CSV table and check it.

    Args:
        path: table with the columns x [m], gap [m]; see `tables.read_columns`.
        length: length L of the laminae, which x must cover [m].

    Returns:
        Positions x, increasing from 0, shape (rows,) [m]; gap, at least 0 at x = 0, positive beyond
        it, shape (rows,) [m].

    Raises:
        CaseError: the table cannot be used (`_columns`); x does not cover [0, L]; or the gap is
            negative at the clamp or not positive beyond it.
    """
    lines, x, gap = _columns(path, length)
    margin = _END_TOLERANCE * length
    if abs(x[0]) > margin or x[-1] < length - margin:
        raise CaseError(
            f"gap file {path}: expected x from 0 to the length {length!r} m, given {x[0]} to "
            f"{x[-1]}"
        )
    if gap[0] < -margin:
        raise CaseError(
            f"gap file {path}, line {lines[0]}: expected a gap of at least 0 at the clamp, given "
            f"{gap[0]}"
        )
    for k in np.flatnonzero(gap[1:] <= 0.0):
        raise CaseError(
            f"gap file {path}, line {lines[k + 1]}: the gap starts closed beyond the clamp: "
            f"expected a positive gap, given {gap[k + 1]} m"
        )
    x[0] = 0.0
    gap[0] = gap[0] if gap[0] > margin else 0.0
    return x, gap


def read_table(
    path: Path, start: float, end: float, length: float
) -> tuple[FloatArray, FloatArray]:
    """Read the opening of a delamination from a CSV table and check it.

    Args:
        path: table with the columns x [m], gap [m]; see `tables.read_columns`.
        start: where the delamination begins [m].
        end: where it ends [m].
        length: length of the laminae, beyond which x must not go [m].

    Returns:
        Positions x, increasing, shape (rows,) [m]; gap, at least 0, shape (rows,) [m].

    Raises:
        CaseError: the table cannot be used (`_columns`); x does not cover the delamination; or a
            gap is negative.
    """
    lines, x, gap = _columns(path, length)
    margin = _END_TOLERANCE * end
    if x[0] > start + margin or x[-1] < end - margin:
        raise CaseError(
            f"gap file {path}: expected x from {start!r} to {end!r} m, given {x[0]} to {x[-1]}"
        )
    for k in np.flatnonzero(gap < 0.0):
        raise CaseError(
            f"gap file {path}, line {lines[k]}: expected a gap of at least 0, given {gap[k]} m"
        )
    return x, gap


def _columns(path: Path, length: float) -> tuple[tuple[int, ...], FloatArray, FloatArray]:
    """Return line numbers, x (increasing) [m] and gap [m] of a table.

    Raises:
        CaseError: see `read_columns`; a heading names a unit of no length; there are less than two
            rows; x does not increase, or goes beyond the length of the lamina.
    """
    label = f"gap file {path}"
    table = read_columns(path, label, ("x", "gap"))
    (x, gap), _ = in_si_units(table, ("x", "gap"), (("m",), ("m",)), label)
    require(x.size >= 2, label, "at least two rows of x, gap", x.size)
    for k in np.flatnonzero(~(np.diff(x) > 0.0)):
        raise CaseError(
            f"{label}, line {table.lines[k + 1]}: expected x to increase, given {x[k + 1]} "
            f"after {x[k]}"
        )
    if x[-1] > length * (1.0 + _LONGER):
        raise CaseError(
            f"{label}, line {table.lines[-1]}: expected x up to the length {length!r} m of the "
            f"lamina, given {x[-1]} m"
        )
    return table.lines, x, gap

"""Compute observed orders of convergence and extrapolate a refined sequence to its limit.

If a value depends on a size h as f(h) = f* + C h^p, three members of the sequence give p and f*:

    (f_1 - f_2) / (f_2 - f_3) = (h_1^p - h_2^p) / (h_2^p - h_3^p)                      (X1)
    f* = f_3 - (f_2 - f_3) h_3^p / (h_2^p - h_3^p)                                      (X2)

Statistics of an impacting motion scatter, and their asymptotic range may be out of reach. X2 is
therefore applied only if successive orders agree and the differences exceed the scatter.

Source: Roache, "Verification and Validation in Computational Science and Engineering", ch. 5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from delam_fem.numerics.arrays import FloatArray

LOWEST_ORDER, HIGHEST_ORDER = 0.2, 8.0
"""Range of credible orders: below it a sequence hardly converges, above it the order is chance."""
ORDERS_AGREE = 0.35
"""Largest difference of two successive orders in the asymptotic range."""
STANDS_OUT = 2.0
"""A difference must exceed this many standard errors before an order is computed from it."""


@dataclass(frozen=True)
class Limit:
    """The estimated limit of a sequence, or the reason why there is none.

    Attributes:
        orders: observed order of each three successive members, shape (n - 2,); NaN if the
            differences change sign or grow.
        value: the limit; NaN if it cannot be estimated.
        uncertainty: uncertainty of the limit; NaN if it cannot be estimated.
        reason: "Richardson", "within scatter", or why there is no limit.
    """

    orders: FloatArray
    value: float
    uncertainty: float
    reason: str


def orders_of_errors(sizes: npt.ArrayLike, errors: npt.ArrayLike) -> FloatArray:
    """Return the order of convergence between each two successive members with known errors.

    Args:
        sizes: h, decreasing, shape (n,).
        errors: known errors of either sign, shape (n,).

    Returns:
        log(e_k / e_{k+1}) / log(h_k / h_{k+1}), shape (n - 1,); NaN if an error is 0 or unknown.
    """
    h, e = np.asarray(sizes, dtype=float), np.abs(np.asarray(errors, dtype=float))
    with np.errstate(divide="ignore", invalid="ignore"):
        orders = np.log(e[:-1] / e[1:]) / np.log(h[:-1] / h[1:])
    result: FloatArray = np.where(np.isfinite(orders), orders, np.nan)
    return result


def observed_orders(sizes: npt.ArrayLike, values: npt.ArrayLike) -> FloatArray:
    """Return the order p from X1 for each three successive members.

    Args:
        sizes: h, decreasing, shape (n,).
        values: f(h), shape (n,).

    Returns:
        Orders, shape (max(n - 2, 0),); NaN if X1 has no solution between 0 and `HIGHEST_ORDER`.
    """
    h, f = np.asarray(sizes, dtype=float), np.asarray(values, dtype=float)
    return np.array([_order(h[k : k + 3], f[k : k + 3]) for k in range(max(h.size - 2, 0))])


def limit(
    sizes: npt.ArrayLike, values: npt.ArrayLike, errors: npt.ArrayLike | None = None
) -> Limit:
    """Estimate the limit of a sequence.

    Args:
        sizes: h, decreasing, shape (n,).
        values: f(h), shape (n,).
        errors: standard errors of the values, from their scatter, shape (n,); None: exact values.

    Returns:
        The limit from X2 if the last two orders agree; the last value if the last differences lie
        within the scatter; otherwise NaN with the reason.
    """
    h, f = np.asarray(sizes, dtype=float), np.asarray(values, dtype=float)
    s = np.zeros_like(f) if errors is None else np.asarray(errors, dtype=float)
    orders = observed_orders(h, f)
    if f.size < 4:
        return Limit(orders, np.nan, np.nan, "fewer than four members")
    if not np.isfinite([f[-4:], s[-4:]]).all():
        return Limit(orders, np.nan, np.nan, "members are missing")
    spread = STANDS_OUT * np.hypot(s[1:], s[:-1])[-3:]
    differences = np.abs(np.diff(f))[-3:]
    if (differences <= spread).all():
        uncertainty = float(max(spread[-1], np.ptp(f[-4:])))
        return Limit(orders, float(f[-1]), uncertainty, "within scatter")
    return _richardson(h, f, orders, (differences > spread).all(), float(spread[-1]))


def _richardson(
    h: FloatArray, f: FloatArray, orders: FloatArray, stands_out: np.bool_, spread: float
) -> Limit:
    """Return the limit from X2, or NaN with the reason if the last two orders do not allow it."""
    reason = None
    if not stands_out:
        reason = "differences of the size of the scatter"
    elif not np.isfinite(orders[-2:]).all():
        reason = "not monotone"
    elif orders[-2:].min() < LOWEST_ORDER:
        reason = "orders near 0"
    elif abs(orders[-1] - orders[-2]) > ORDERS_AGREE:
        reason = "orders differ"
    if reason is not None:
        return Limit(orders, np.nan, np.nan, reason)
    last, before = (_extrapolated(h[k - 3 : k], f[k - 3 : k]) for k in (h.size, h.size - 1))
    uncertainty = max(abs(last - before), spread)
    return Limit(orders, last, uncertainty, "Richardson")


def _ratio(h: FloatArray, p: float) -> float:
    """Return the right-hand side of X1."""
    a, b = (h[:2] / h[2]) ** p
    return float((a - b) / (b - 1.0))


def _order(h: FloatArray, f: FloatArray) -> float:
    """Return the solution p of X1; NaN if there is none."""
    below = f[1] - f[2]
    if below == 0.0 or not np.isfinite(f).all():
        return math.nan
    ratio = float((f[0] - f[1]) / below)
    smallest = 1e-6
    if not _ratio(h, smallest) < ratio < _ratio(h, HIGHEST_ORDER):
        return math.nan
    return float(brentq(lambda p: _ratio(h, p) - ratio, smallest, HIGHEST_ORDER, xtol=1e-10))


def _extrapolated(h: FloatArray, f: FloatArray) -> float:
    """Return f* from X2 for three members."""
    p = _order(h, f)
    return float(f[2] - (f[1] - f[2]) / ((h[1] / h[2]) ** p - 1.0))

"""Observed orders and limits on sequences whose limit is known."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.numerics.statistics import limit, observed_orders, orders_of_errors

SIZES = 1.0 / np.array([10.0, 20.0, 40.0, 80.0, 160.0])
UNEVEN = 1.0 / np.array([1000.0, 4000.0, 16000.0, 64000.0, 128000.0])
EXACT = 1e-8
"""The root of X1 is found to 1e-10; a difference of values of order 1 loses the rest."""


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("sizes", [SIZES, UNEVEN], ids=["halved", "uneven"])
def test_order_and_limit_of_a_power(sizes: np.ndarray, order: float) -> None:
    values = 3.0 - 2.0 * (sizes / sizes[0]) ** order
    extrapolation = limit(sizes, values)
    assert extrapolation.orders == pytest.approx(np.full(3, order), abs=1e-5)
    assert extrapolation.reason == "Richardson"
    assert extrapolation.value == pytest.approx(3.0, abs=EXACT)
    assert extrapolation.uncertainty < EXACT


def test_uncertainty_covers_a_second_term() -> None:
    values = 3.0 - 2.0 * SIZES - 5.0 * SIZES**2
    extrapolation = limit(SIZES, values)
    assert extrapolation.reason == "Richardson"
    assert abs(extrapolation.value - 3.0) < extrapolation.uncertainty < 0.01


def test_alternating_values_have_no_order() -> None:
    assert np.isnan(observed_orders(SIZES, [1.0, 2.0, 1.2, 1.8, 1.4])).all()
    assert limit(SIZES, [1.0, 2.0, 1.2, 1.8, 1.4]).reason == "not monotone"


def test_diverging_values_have_no_order() -> None:
    assert np.isnan(observed_orders(SIZES, [1.0, 2.0, 4.0, 8.0, 16.0])).all()


def test_a_drift_as_of_logarithms_is_not_extrapolated() -> None:
    extrapolation = limit(SIZES, 1.0 + 0.1 * np.log(SIZES) + 0.002 * np.log(SIZES) ** 2)
    assert extrapolation.reason == "orders near 0"
    assert np.isnan(extrapolation.value)


def test_orders_that_change_are_not_extrapolated() -> None:
    values = [4.0, 3.0, 2.2, 1.9, 1.89]
    assert limit(SIZES, values).reason == "orders differ"


def test_scatter_decides() -> None:
    values = np.array([1.0, 1.5, 1.75, 1.875, 1.9375])
    assert limit(SIZES, values, np.full(5, 1e-4)).reason == "Richardson"
    assert limit(SIZES, values, np.full(5, 0.03)).reason == "differences of the size of the scatter"
    within = limit(SIZES, values, np.full(5, 0.3))
    assert within.reason == "within scatter"
    assert within.value == values[-1]
    assert within.uncertainty >= 0.3


def test_three_members_have_an_order_but_no_limit() -> None:
    extrapolation = limit(SIZES[:3], 1.0 + SIZES[:3] ** 2)
    assert extrapolation.orders == pytest.approx([2.0])
    assert extrapolation.reason == "fewer than four members"


def test_missing_members() -> None:
    extrapolation = limit(SIZES, [1.0, 2.0, 2.5, np.nan, 2.9])
    assert extrapolation.reason == "members are missing"
    assert np.isnan(extrapolation.orders[1:]).all()


def test_orders_of_known_errors() -> None:
    errors = -3.0 * SIZES**4
    assert orders_of_errors(SIZES, errors) == pytest.approx(np.full(4, 4.0))
    assert np.isnan(orders_of_errors(SIZES[:2], [0.0, 0.0])).all()


HALVES = 1.0 / 2.0 ** np.arange(6)


def geometric(*orders: float) -> np.ndarray:
    """Return values on halved sizes whose three-member orders are the given ones."""
    differences = np.cumprod([1.0, *(2.0**-p for p in orders)])
    return np.concatenate([[0.0], np.cumsum(differences)])


@pytest.mark.parametrize(
    ("orders", "reason"),
    [
        ((0.21, 0.21), "Richardson"),
        ((0.19, 0.21), "orders near 0"),
        ((0.21, 0.19), "orders near 0"),
        ((1.0, 1.34), "Richardson"),
        ((1.34, 1.0), "Richardson"),
        ((1.0, 1.36), "orders differ"),
        ((1.36, 1.0), "orders differ"),
        ((7.9, 7.9), "Richardson"),
        ((7.9, 8.1), "not monotone"),
        ((0.3, 2.0, 2.0), "Richardson"),  # only the last two orders count
    ],
)
def test_bounds_of_credible_orders(orders: tuple[float, ...], reason: str) -> None:
    values = geometric(*orders)
    extrapolation = limit(HALVES[: values.size], values)
    assert extrapolation.reason == reason
    assert (
        np.isnan(extrapolation.value)
        == np.isnan(extrapolation.uncertainty)
        == (reason != "Richardson")
    )


def test_the_limit_and_its_uncertainty_by_hand() -> None:
    """Differences 1, 1/2, 1/5: f* = 1.7 + 0.2/(2.5 - 1) and, one member before, 1.5 + 0.5/(2 - 1).

    f_3 - (f_2 - f_3)/(2^p - 1) with 2^p the ratio of the differences.
    """
    values = np.cumsum([0.0, 1.0, 0.5, 0.2])
    extrapolation = limit(HALVES[:4], values)
    assert extrapolation.value == pytest.approx(1.7 + 0.2 / 1.5, abs=EXACT)
    assert extrapolation.uncertainty == pytest.approx(2.0 - (1.7 + 0.2 / 1.5), abs=EXACT)
    noisy = limit(HALVES[:4], values, np.array([0.0, 0.0, 0.06, 0.05]))
    assert noisy.reason == "Richardson"
    assert noisy.uncertainty == pytest.approx(2.0 - (1.7 + 0.2 / 1.5), abs=EXACT)


def test_the_scatter_of_the_last_two_members_bounds_the_uncertainty() -> None:
    values = geometric(2.0, 2.0)
    spread = 2.0 * np.hypot(0.01, 0.02)
    assert limit(HALVES[:4], values, [0.5, 0.2, 0.01, 0.02]).reason != "Richardson"
    extrapolation = limit(HALVES[:4], values, [0.01, 0.01, 0.01, 0.02])
    assert extrapolation.reason == "Richardson"
    assert extrapolation.uncertainty == pytest.approx(spread, rel=1e-12)


@pytest.mark.parametrize(
    ("error", "reason"),
    [(0.124, "Richardson"), (0.126, "differences of the size of the scatter")],
)
def test_a_difference_stands_out_beyond_two_standard_errors(error: float, reason: str) -> None:
    """The last difference is 1/4; with an error in one member alone it must exceed twice that."""
    errors = [0.0, 0.0, 0.0, error]
    assert limit(HALVES[:4], geometric(1.0, 1.0), errors).reason == reason


def test_within_scatter_needs_all_of_the_last_differences() -> None:
    """Differences 1, 1/2, 1/4; the error of the first member decides about the first of them."""
    values = geometric(1.0, 1.0)
    extrapolation = limit(HALVES[:4], values, [0.51, 0.0, 1.0, 0.0])
    assert extrapolation.reason == "within scatter"
    assert extrapolation.value == 1.75
    assert extrapolation.uncertainty == 2.0  # the error of the last difference exceeds the range
    assert limit(HALVES[:4], values, [0.51, 0.0, 0.3, 0.0]).uncertainty == 1.75  # the range
    beyond = limit(HALVES[:4], values, [0.49, 0.0, 1.0, 0.0])
    assert beyond.reason == "differences of the size of the scatter"


def test_equal_values_are_their_limit() -> None:
    extrapolation = limit(HALVES[:4], [3.0] * 4)
    assert (extrapolation.value, extrapolation.uncertainty, extrapolation.reason) == (
        3.0,
        0.0,
        "within scatter",
    )


def test_orders_on_uneven_sizes_by_definition() -> None:
    """Values 1 + h² on sizes 3, 2, 1: X1 is (9 - 4)/(4 - 1)."""
    assert observed_orders([3.0, 2.0, 1.0], [10.0, 5.0, 2.0]) == pytest.approx([2.0], abs=1e-9)
    assert observed_orders([2.0, 1.0], [2.0, 1.0]).size == 0
    assert orders_of_errors([4.0, 2.0, 1.0], [16.0, -2.0, 1.0]) == pytest.approx([3.0, 1.0])
    assert np.isnan(orders_of_errors([4.0, 2.0, 1.0], [1.0, 0.0, 1.0])).tolist() == [True, True]

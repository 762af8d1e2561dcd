"""Observed orders and limits on sequences whose limit is known."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.numerics.extrapolation import limit, observed_orders, orders_of_errors

SIZES = 1.0 / np.array([10.0, 20.0, 40.0, 80.0, 160.0])
UNEVEN = 1.0 / np.array([1000.0, 4000.0, 16000.0, 64000.0, 128000.0])
EXACT = 1e-8
"""The root of X1 is found to 1e-10; a difference of values of order 1 loses the rest."""


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("sizes", [SIZES, UNEVEN], ids=["halved", "uneven"])
def test_order_and_limit_of_a_power(sizes: np.ndarray, order: float) -> None:
    values = 3.0 - 2.0 * (sizes / sizes[0]) ** order
    found = limit(sizes, values)
    assert found.orders == pytest.approx(np.full(3, order), abs=1e-5)
    assert found.reason == "Richardson"
    assert found.value == pytest.approx(3.0, abs=EXACT)
    assert found.uncertainty < EXACT


def test_uncertainty_covers_a_second_term() -> None:
    values = 3.0 - 2.0 * SIZES - 5.0 * SIZES**2
    found = limit(SIZES, values)
    assert found.reason == "Richardson"
    assert abs(found.value - 3.0) < found.uncertainty < 0.01


def test_alternating_values_have_no_order() -> None:
    assert np.isnan(observed_orders(SIZES, [1.0, 2.0, 1.2, 1.8, 1.4])).all()
    assert limit(SIZES, [1.0, 2.0, 1.2, 1.8, 1.4]).reason == "not monotone"


def test_diverging_values_have_no_order() -> None:
    assert np.isnan(observed_orders(SIZES, [1.0, 2.0, 4.0, 8.0, 16.0])).all()


def test_a_drift_as_of_logarithms_is_not_extrapolated() -> None:
    found = limit(SIZES, 1.0 + 0.1 * np.log(SIZES) + 0.002 * np.log(SIZES) ** 2)
    assert found.reason == "orders near 0"
    assert np.isnan(found.value)


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
    found = limit(SIZES[:3], 1.0 + SIZES[:3] ** 2)
    assert found.orders == pytest.approx([2.0])
    assert found.reason == "fewer than four members"


def test_missing_members() -> None:
    found = limit(SIZES, [1.0, 2.0, 2.5, np.nan, 2.9])
    assert found.reason == "members are missing"
    assert np.isnan(found.orders[1:]).all()


def test_orders_of_known_errors() -> None:
    errors = -3.0 * SIZES**4
    assert orders_of_errors(SIZES, errors) == pytest.approx(np.full(4, 4.0))
    assert np.isnan(orders_of_errors(SIZES[:2], [0.0, 0.0])).all()

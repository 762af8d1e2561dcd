"""Fields along the parts: values at the points, bending moments of exact shapes."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.api import Layout, Part
from delam_fem.model import layout
from delam_fem.model.layout import BASE, FIXED

X = np.array([0.0, 0.1, 0.25, 0.3, 0.6])
"""Uneven, so that a wrong power of h shows."""
LOWER = np.array([2.0, 2.0, 5.0, 0.5])
UPPER = np.array([1.0, 3.0, 3.0, 4.0])
"""EI of the cells [N m2]."""
ROUND_OFF = 1e-12
"""Relative to the largest moment."""


def part(name: str, first: int, rigidity: np.ndarray) -> Part:
    """Return a part that is clamped at its first point; its dofs start at `first`."""
    free = first + np.arange(2 * (X.size - 1)).reshape(-1, 2)
    return Part(name, X, np.vstack([[BASE, FIXED], free]), rigidity, np.ones(X.size - 1))


LAYOUT = Layout((part("lower", 0, LOWER), part("upper", 8, UPPER)), ())


def test_dofs_come_to_their_parts_and_points_and_the_base_to_the_clamps() -> None:
    vectors = np.stack([np.arange(16.0), 100.0 + np.arange(16.0)])
    u, phi = layout.nodal(LAYOUT, vectors, np.array([-7.0, -8.0]))
    assert u[0].tolist() == [[-7.0, 0.0, 2.0, 4.0, 6.0], [-8.0, 100.0, 102.0, 104.0, 106.0]]
    assert u[1, 0].tolist() == [-7.0, 8.0, 10.0, 12.0, 14.0]
    assert phi[0, 1].tolist() == [0.0, 101.0, 103.0, 105.0, 107.0]
    assert phi[1, 1].tolist() == [0.0, 109.0, 111.0, 113.0, 115.0]


@pytest.mark.parametrize("coefficients", [(0.0, 0.0, 1.0, 0.0), (1.0, -2.0, 3.0, -5.0)])
def test_the_moment_of_a_cubic_is_exact_and_the_mean_of_both_cells_at_a_point(
    coefficients: tuple[float, ...],
) -> None:
    """The moment jumps where E I does; a point between two cells has the mean of both."""
    cubic = np.polynomial.Polynomial(coefficients)
    u, phi, curvature = (cubic.deriv(k)(X) if k else cubic(X) for k in range(3))
    states = np.stack([u, 2.0 * u]), np.stack([phi, 2.0 * phi])
    bending_moments = layout.bending_moment(LAYOUT, *(np.stack([s, -s]) for s in states))
    for sign, rigidity, moments in (
        (1.0, LOWER, bending_moments[0]),
        (-1.0, UPPER, bending_moments[1]),
    ):
        at_point = np.empty(X.size)
        at_point[0], at_point[-1] = rigidity[0], rigidity[-1]
        at_point[1:-1] = 0.5 * (rigidity[1:] + rigidity[:-1])
        expected = sign * at_point * curvature
        scale = ROUND_OFF * np.abs(expected).max()
        assert moments[0] == pytest.approx(expected, abs=scale)
        assert moments[1] == pytest.approx(2.0 * expected, abs=2.0 * scale)


def test_the_moment_of_a_kink_is_the_mean_of_what_both_cells_have() -> None:
    """Parabolas of different curvature left and right of the third point, joined smoothly."""
    joint = X[2]
    u = np.where(X < joint, 1.0, 4.0) * (X - joint) ** 2
    phi = np.where(X < joint, 2.0, 8.0) * (X - joint)
    bending_moments = layout.bending_moment(
        LAYOUT, np.stack([u, u])[:, None], np.stack([phi, phi])[:, None]
    )
    assert bending_moments[0, 0] == pytest.approx(
        [4.0, 4.0, 0.5 * (2.0 * 2.0 + 5.0 * 8.0), 22.0, 4.0]
    )

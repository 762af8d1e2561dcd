"""The region of a plate that an index marks, and the Laplacian of points on a plate."""

import numpy as np
import pytest

from delam_fem.studies.detection.indices import FALSE_CALLS, curvature, magnitude
from delam_fem.studies.detection.region import Region, area_of, marked_region
from delam_fem.studies.signals.scan import Shapes, on_plate

AXES = np.linspace(0.0, 0.2, 41), np.linspace(-0.075, 0.075, 31)
GRID = [axis.ravel() for axis in np.meshgrid(*AXES)]
RADIUS = np.hypot(GRID[0] - 0.1, GRID[1] - 0.01)
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_a_disk_has_its_area_and_its_middle():
    region = marked_region(*GRID, 2.0 - RADIUS / 0.04)
    (outline,) = region.outlines
    assert region.area == pytest.approx(np.pi * 0.04**2, rel=0.01)
    np.testing.assert_allclose(outline.mean(axis=0), [0.1, 0.01], atol=1e-3)


def test_what_lies_between_marked_points_is_filled():
    ring = marked_region(*GRID, 2.0 - np.abs(RADIUS - 0.04) / 0.01)
    assert ring.area == pytest.approx(np.pi * 0.05**2, rel=0.01)


def test_pieces_that_are_apart_stay_apart_and_those_at_the_edge_end_there():
    x, z = GRID
    near_corners = np.minimum(np.hypot(x, z + 0.075), np.hypot(x - 0.2, z - 0.075))
    region = marked_region(x, z, 2.0 - near_corners / 0.03)
    assert len(region.outlines) == 2
    assert region.area == pytest.approx(2 * 0.25 * np.pi * 0.03**2, rel=0.02)


def test_nothing_is_marked_where_nothing_exceeds():
    assert marked_region(*GRID, np.ones(RADIUS.size)).outlines == ()


def test_overlap_of_squares_is_exact():
    moved = Region((SQUARE + np.array([0.5, 0.0]),))
    assert area_of(SQUARE) == 1.0 == -area_of(SQUARE[::-1])
    assert Region((SQUARE,)).overlap(moved) == pytest.approx(1.0 / 3.0, abs=0.01)
    assert Region((SQUARE,)).overlap(Region((SQUARE,))) == 1.0
    assert Region((SQUARE,)).overlap(Region()) == 0.0


@pytest.mark.parametrize("is_grid", [True, False])
def test_the_laplacian_of_a_quadratic_is_exact(is_grid):
    rng = np.random.default_rng(1)
    x, z = GRID if is_grid else (rng.uniform(0.0, 0.2, 300), rng.uniform(-0.07, 0.07, 300))
    bending = on_plate(x, z)
    values = 3.0 * x**2 - 5.0 * z**2 + 2.0 * x * z + 7.0 * x - 1.0
    np.testing.assert_allclose(bending.matrix @ values, 2.0 * (3.0 - 5.0), atol=1e-7)
    if is_grid:  # all points but those of the edges
        assert bending.points.size == 39 * 29
    else:
        assert bending.points.size > 100


def test_cells_of_a_grid_need_not_be_squares():
    x, z = np.meshgrid(np.arange(9) * 0.02, np.arange(7) * 0.005)
    bending = on_plate(x.ravel(), z.ravel())
    assert bending.points.size == 7 * 5
    np.testing.assert_allclose(bending.matrix @ x.ravel() ** 2, 2.0, rtol=1e-9)
    np.testing.assert_allclose(bending.matrix @ z.ravel() ** 2, 2.0, rtol=1e-9)


@pytest.mark.parametrize("index", [curvature, magnitude])
def test_noise_alone_is_called_as_seldom_as_promised(index):
    """Stencils of the Laplacian overlap, so that fewer are called than of independent points."""
    x, z = (axis.ravel() for axis in np.meshgrid(np.arange(12) * 0.01, np.arange(10) * 0.01))
    empty = Shapes(x, 10.0, (1.0, 2.0), np.zeros((2, x.size), dtype=complex), z=z)
    rng = np.random.default_rng(4)
    calls = sum(index(empty.noisy(1.0, rng, 15)).is_detected for _ in range(2000))
    assert 0 < calls <= 2000 * FALSE_CALLS + 3.0 * np.sqrt(2000 * FALSE_CALLS)


def test_the_harmonics_of_a_drive_are_taken_away_on_a_plate():
    x, z = GRID
    response = np.cos(20.0 * x) * np.cos(15.0 * z) * (1.0 + 0.3j)
    blister = np.where(RADIUS < 0.02, (1.0 - (RADIUS / 0.02) ** 2) ** 2, 0.0)
    values = np.stack([np.ones(x.size), blister + 0.7j * response])
    shapes = Shapes(x, 10.0, (1.0, 2.0), values.astype(complex), 1e-4, z=z)
    left = shapes.without_drive({2.0: response}).order(2.0)
    np.testing.assert_allclose(left, blister, atol=0.02)

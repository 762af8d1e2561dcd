"""Hertz's contact from meshes of gmsh to forces: radius, pressure, orders."""

import importlib.util

import numpy as np
import pytest

pytestmark = [
    pytest.mark.once,
    pytest.mark.skipif(
        importlib.util.find_spec("gmsh") is None, reason="gmsh's Python module is not installed"
    ),
]
CYLINDER, SPHERE = 0.02, 0.05  # radius of contact over R: Hertz's theory is for small ones
APPROACH = 0.03  # round bodies are no half-spaces: their approach differs in the second order


def contact(*args: object, **further: object):  # type: ignore[no-untyped-def]
    """Return a contact, with what needs gmsh imported late."""
    from hertz import contact

    return contact(*args, **further)


@pytest.mark.parametrize("cells", [8, 16])
def test_cylinder_on_a_rigid_plane(cells: int) -> None:
    result, stiffness = contact(2, CYLINDER, cells)
    radius, largest, profile = result.errors(stiffness, 2)
    assert abs(radius) < 0.005
    assert abs(largest) < 0.02
    assert profile < 0.015
    assert result.radius == pytest.approx(CYLINDER, rel=APPROACH)


@pytest.mark.slow
def test_vertices_converge_in_the_first_order() -> None:
    """A force at a vertex makes a dent as large as a cell, so the body seems softer there."""
    errors = [contact(2, CYLINDER, cells, "vertices") for cells in (8, 16, 32)]
    table = np.array([result.errors(stiffness, 2) for result, stiffness in errors])
    radius, profile = table[:, 0], table[:, 2]
    assert np.all(radius > 0.0)
    assert radius[-1] < 0.01
    assert profile[-1] < 0.02
    order = 0.5 * np.log2(radius[0] / radius[-1])
    assert 0.8 < order < 1.6


@pytest.mark.parametrize("upper", [0.8, 2.0])
def test_elastic_bodies_whose_meshes_do_not_match(upper: float) -> None:
    """The radius of contact is right; single pressures scatter, as of any collocation."""
    result, stiffness = contact(2, CYLINDER, 8, upper=upper)
    radius, _, profile = result.errors(stiffness, 2)
    assert abs(radius) < 0.01
    assert profile < 0.04
    assert result.radius == pytest.approx(CYLINDER, rel=APPROACH)


def test_sphere_on_a_rigid_plane() -> None:
    result, stiffness = contact(3, SPHERE, 4)
    radius, largest, profile = result.errors(stiffness, 3)
    assert abs(radius) < 0.01
    assert abs(largest) < 0.04
    assert profile < 0.05
    assert result.radius == pytest.approx(SPHERE, rel=APPROACH)


@pytest.mark.nightly
def test_sphere_on_a_finer_mesh() -> None:
    result, stiffness = contact(3, SPHERE, 8)
    radius, largest, profile = result.errors(stiffness, 3)
    assert abs(radius) < 0.002
    assert abs(largest) < 0.015
    assert profile < 0.02


@pytest.mark.nightly
def test_difference_to_hertz_vanishes_with_the_size_of_the_contact() -> None:
    """Normals of the round body lean outwards, which Hertz leaves out: an error of order a/R."""
    for size in (0.04, 0.08, 0.16):
        result, stiffness = contact(2, size, 64)
        assert -0.15 * size < result.errors(stiffness, 2)[0] < -0.1 * size

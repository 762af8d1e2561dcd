"""Modes of plates: the local defect resonance is a row with a name; maps of the surface."""

from __future__ import annotations

import numpy as np
import pytest
from plates import bending, plate

from delam_fem.api import Structure, assemble
from delam_fem.studies.modes.frequencies import StructureModes, structure_modes
from delam_fem.studies.modes.plates import LOCAL

BASE, SKIN = 0.004, 0.0005  # m
RADIUS = 0.04  # m
PATCH = {
    "between": ["lower", "upper"], "start": 0.06, "end": 0.14, "across": [-0.04, 0.04],
    "shape_in_plane": "ellipse",
}  # fmt: skip
CLAMPED = dict.fromkeys(("start", "end", "left", "right"), "clamped")


@pytest.fixture(scope="module")
def case_and_modes() -> tuple[object, Structure, StructureModes]:
    """Return a thick clamped plate with a thin skin over a round patch, and its modes."""
    case = plate(CLAMPED, 12, 12, thicknesses=(BASE, SKIN), delamination=[PATCH])
    structure = assemble(case)
    return case, structure, structure_modes(structure, case, 3)


def test_the_defect_resonance_has_a_name_and_the_frequency_of_a_clamped_skin(
    case_and_modes: tuple[object, Structure, StructureModes],
) -> None:
    """Of a round plate 10.216/(2π a²) √(D/ρh); four cells of degree 2 are 5 % too stiff."""
    *_, modes = case_and_modes
    assert modes.plate is not None
    local = [k for k, motion in enumerate(modes.motions) if "defect resonance" in motion]
    assert len(local) == 1
    D, m = bending(SKIN)
    exact = 10.2158 / (2.0 * np.pi * RADIUS**2) * np.sqrt(D / m)
    assert 0.95 * exact < modes.frequencies[local[0]] < 1.06 * exact
    assert modes.motions[local[0]] == "defect resonance of lower-upper 1"
    share = modes.plate.shares[:, 0]
    is_local = np.array([" of lower-upper 1" in motion for motion in modes.motions])
    np.testing.assert_array_equal(share >= LOCAL, is_local)  # further local modes are no resonance
    assert share[local[0]] > 0.8 and not is_local.all()
    assert modes.report.numbers["defect_share"] is modes.plate.shares


def test_shares_are_those_of_the_mass_in_a_rigid_motion() -> None:
    """In a translation each part has its share of the mass."""
    case = plate({}, 6, 6, thicknesses=(BASE, SKIN), delamination=[PATCH])
    modes = structure_modes(assemble(case), case, 3)  # three of six rigid motions, mixed
    assert modes.plate is not None
    patch = np.pi * RADIUS**2 * SKIN / (0.2**2 * (BASE + SKIN))
    # of turns about the middle the patch, which is in the middle, has less
    assert np.all(modes.plate.shares[:, 0] <= patch * 1.01)
    assert np.all(modes.plate.shares[:, 0] > 0.0)


def test_the_map_of_a_mode_is_the_deflection_of_the_surface(
    case_and_modes: tuple[object, Structure, StructureModes],
) -> None:
    *_, modes = case_and_modes
    assert modes.plate is not None
    plan, maps = modes.plate.plan, modes.plate.maps
    assert np.abs(maps).max() <= 1.0 + 1e-9
    edge = np.abs(plan - [0.1, 0.0]).max(axis=1) > 0.1 - 1e-9
    np.testing.assert_allclose(maps[:, edge], 0.0, atol=1e-12)
    local = next(k for k, motion in enumerate(modes.motions) if "defect" in motion)
    r = np.hypot(*(plan - [0.1, 0.0]).T)
    centre = maps[local][r < 0.01].min()
    assert centre > 0.8  # a skin that moves on its own, largest in the middle
    # the shape of a clamped round plate falls to less than a tenth at its edge
    assert np.abs(maps[local][(r > 0.95 * RADIUS) & (r < 1.05 * RADIUS)]).max() < 0.3
    figure = modes.figure()
    assert len(figure.axes) == 4  # three maps and the scale


def test_outlines() -> None:
    case = plate(CLAMPED, 8, 8, thicknesses=(BASE, SKIN), delamination=[PATCH])
    np.testing.assert_allclose(
        np.hypot(*(case.delamination[0].outline(case.half_width) - [0.1, 0.0]).T), RADIUS
    )

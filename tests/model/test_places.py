"""Places on surfaces of plates: forces, masses, sensors, stops, impactors, reference points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plates import EDGES, LENGTH, bending, plate

from delam_fem.api import Case, CaseError, assemble, load_case, reduced_case
from delam_fem.model.places import places_of_case
from delam_fem.model.solids.body import place_rows

LAYERS = (0.0014, 0.0006)
PATCH = {"between": ["lower", "upper"], "start": 0.06, "end": 0.12, "across": [-0.06, -0.02]}
PINNED = dict.fromkeys(EDGES, "pinned")
SIZES = {"degree": 3, "width": 0.2}


def pushed(position: list[float], **sections: object) -> Case:
    """Return a simply supported plate with a force at a place."""
    force = {
        "kind": "force", "lamina": "sheet", "position": position, "amplitude": 1.0,
        "frequency": 50.0,
    }  # fmt: skip
    return plate(PINNED, 6, 6, excitation=force, **SIZES, **sections)  # type: ignore[arg-type]


def navier(x: float, z: float, at: tuple[float, float]) -> float:
    """Return the deflection at `at` of a square thin plate under 1 N at (x, z), z from an edge [m].

    Source: S. Timoshenko, S. Woinowsky-Krieger, "Theory of Plates and Shells" (1959), eq. 133.
    """
    D, _ = bending()
    m = np.arange(1, 200)
    waves = [np.sin(np.outer([a, b], m * np.pi / LENGTH)) for a, b in ((x, at[0]), (z, at[1]))]
    squares = (m[:, None] ** 2 + m**2) ** 2
    terms = (waves[0][0] * waves[0][1])[:, None] * (waves[1][0] * waves[1][1]) / squares
    return float(4.0 * LENGTH**2 / (np.pi**4 * D) * terms.sum())


def test_a_force_and_a_sensor_on_a_plate_are_at_their_places() -> None:
    """The static deflection of Navier; exchanged places give the same one (Betti)."""
    sensors = [
        {"name": "there", "quantity": "displacement", "lamina": "sheet",
         "position": [0.07, 0.02], "surface": "top"},
        {"name": "line", "quantity": "displacement", "lamina": "sheet", "position": 0.07},
        {"name": "middle", "quantity": "displacement", "lamina": "sheet", "position": [0.07, 0.0]},
    ]  # fmt: skip
    o = assemble(pushed([0.12, -0.05], sensor=sensors)).operators
    u = np.linalg.solve(o.stiffness.toarray(), -o.base.stiffness)
    read = o.sensors @ u
    exact = navier(0.12, 0.05, (0.07, 0.12))
    assert read[0] == pytest.approx(exact, rel=0.01)  # shear adds
    assert read[1] == pytest.approx(read[2], rel=1e-3)
    assert read[1] == pytest.approx(navier(0.12, 0.05, (0.07, 0.10)), rel=0.01)


def test_a_strain_gauge_reads_at_its_place() -> None:
    """ε_xx = -y w_xx; under a force at the centre it is the same at z and -z, and falls beyond."""
    sensors = [
        {"name": f"s{k}", "quantity": "strain", "lamina": "sheet", "position": [0.05, z],
         "surface": surface}
        for k, (z, surface) in enumerate([(0.03, "top"), (-0.03, "top"), (0.03, "bottom"),
                                          (0.09, "top")])
    ]  # fmt: skip
    o = assemble(pushed([0.1, 0.0], sensor=sensors)).operators
    u = np.linalg.solve(o.stiffness.toarray(), -o.base.stiffness)
    left, right, below, beyond = o.sensors @ u
    assert left == pytest.approx(right, rel=1e-6)
    assert below == pytest.approx(-left, rel=0.01)
    assert 0.0 < abs(beyond) < 0.5 * abs(left)


def test_masses_and_stops_act_at_their_places() -> None:
    """A stop above a plate strikes its top; a mass there adds m rᵀ r with the same row r."""
    mass = {"lamina": "sheet", "mass": 1e-4, "position": [0.1, 0.05], "surface": "top"}
    stop = {"lamina": "sheet", "side": "above", "gap": 1e-4, "position": [0.1, 0.05]}
    plain = assemble(plate(PINNED, 4, 4)).operators
    structure = assemble(plate(PINNED, 4, 4, point_mass=[mass], stop=[stop],
                               contact={"law": "newton"}))  # fmt: skip
    o = structure.operators
    added = (o.mass - plain.mass).toarray()
    row = -o.gap_matrix.toarray()[0]
    assert o.gap0 == pytest.approx([1e-4])
    np.testing.assert_allclose(added, 1e-4 * np.outer(row, row), atol=1e-15)


def test_reference_points_are_in_the_middle_of_the_largest_patch() -> None:
    small = {**PATCH, "start": 0.15, "end": 0.17, "across": [0.02, 0.04]}
    case = plate({"start": "clamped"}, 12, 12, thicknesses=LAYERS, delamination=[small, PATCH])
    assert case.reference_point == pytest.approx((0.09, -0.04))
    structure = assemble(case)
    probes = structure.layout.probes
    names = [probe.name for probe in probes]
    assert names == ["middle", "middle", "delamination-1-lower", "delamination-1-upper"]
    assert [probe.place[1:3] for probe in probes if probe.place] == [
        pytest.approx(at) for at in ((0.09, -0.04),) * 2 + ((0.16, 0.03),) * 2
    ]
    places = [probe.place for probe in probes if probe.place is not None]
    body = structure.body
    assert body is not None
    at = body.solid.coordinates
    field = np.zeros_like(at)
    field[:, 1] = at[:, 0] + 2.0 * at[:, 2]
    rows = place_rows(body.solid, places)
    np.testing.assert_allclose(
        rows @ field.ravel(), [place.x + 2.0 * place.z for place in places], rtol=1e-9
    )
    assert plate(PINNED).reference_point == (0.1, 0.0)
    assert len(places_of_case(case)) == 4


def test_a_reduced_plate_has_the_places_of_its_case(tmp_path: Path) -> None:
    sensor = {"name": "a", "quantity": "displacement", "lamina": "upper", "position": [0.05, 0.03]}
    case = plate(
        {"start": "clamped"}, 6, 6, thicknesses=LAYERS, delamination=[PATCH], sensor=[sensor]
    )
    reduction = reduced_case(case, 8)
    reduction.save(tmp_path)
    read_back = load_case(tmp_path / "case.toml")
    full, reduced = assemble(case), assemble(read_back)
    assert reduced.layout.places == full.layout.places
    V = reduction.basis.vectors
    np.testing.assert_allclose(
        reduced.operators.sensors.toarray(), full.operators.sensors @ V, atol=1e-9
    )
    np.testing.assert_allclose(
        reduced.operators.probes.toarray(), full.operators.probes @ V, atol=1e-9
    )
    other = read_back.model_copy(
        update={"sensor": (read_back.sensor[0].model_copy(update={"position": (0.05, 0.04)}),)}
    )
    with pytest.raises(CaseError, match=r"position: expected one of the .* places .* reduce"):
        assemble(other)


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"sensor": [{"name": "a", "quantity": "velocity", "lamina": "sheet",
                      "position": [0.1, 0.2]}]}, r"sensor\.a\.position: expected z from"),
        ({"sensor": [{"name": "a", "quantity": "velocity", "lamina": "sheet",
                      "position": [0.3, 0.0]}]}, r"sensor\.a\.position: expected at most"),
        ({"model": {"kind": "beam"}, "mesh": {"elements": 4},
          "point_mass": [{"lamina": "sheet", "mass": 1.0, "position": [0.1, 0.0]}]},
         r"point_mass\.1\.position: expected a number but on a plate"),
        ({"model": {"kind": "beam"}, "mesh": {"elements": 4},
          "point_mass": [{"lamina": "sheet", "mass": 1.0, "position": 0.1, "surface": "top"}]},
         r"point_mass\.1\.surface: expected none but on a plate"),
    ],
)  # fmt: skip
def test_places_that_do_not_exist_are_refused(sections: dict[str, object], words: str) -> None:
    with pytest.raises(CaseError, match=words):
        plate({"start": "clamped"}, **sections)  # type: ignore[arg-type]

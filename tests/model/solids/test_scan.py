"""The scan of a plate: its points, and what they read of the full and of the reduced plate."""

import numpy as np
import pytest
import scipy.sparse.linalg
from plates import patched

import delam_fem as df
from delam_fem.api import CaseError, assemble, reduced_case, scanned_places
from delam_fem.case.surface_scan import scan_points

SECTIONS = {
    "time": {"steps_per_period": 100, "periods": 2},
    "output": {"window_periods": 1, "fields_per_period": 20},
}


def plate(**sections):
    return patched(**{**SECTIONS, **sections})


def test_a_grid_is_in_the_middle_of_the_plate():
    points = scan_points(plate(scan={"spacing": [0.03, "20 mm"]}))
    x, z = np.unique(points[:, 0]), np.unique(points[:, 1])
    np.testing.assert_allclose(x, 0.03 * np.arange(5), atol=1e-12)
    np.testing.assert_allclose(z, 0.02 * np.arange(-2.5, 3.0), atol=1e-12)
    assert len(points) == 5 * 6


def test_points_of_a_file_keep_their_order_and_units(tmp_path):
    places = [(10.0 * k, (-1) ** k * 4.0 * k) for k in range(1, 11)]
    path = tmp_path / "points.csv"
    path.write_text("x [mm],z [mm]\n" + "\n".join(f"{x},{z}" for x, z in places) + "\n")
    points = scan_points(plate(scan={"file": str(path)}))
    np.testing.assert_allclose(points, 1e-3 * np.array(places))


@pytest.mark.parametrize(
    ("scan", "key"),
    [
        ({}, "spacing"),
        ({"spacing": 0.01, "points": [[0.1, 0.0]]}, "points"),
        ({"spacing": 0.01, "lamina": "middle"}, "scan.lamina"),
    ],
)
def test_a_scan_that_is_none_is_refused(scan, key):
    with pytest.raises(CaseError, match=key):
        plate(scan=scan)


def test_a_scan_needs_frames_and_a_plate():
    with pytest.raises(CaseError, match="fields_per_period"):
        plate(scan={"spacing": 0.01}, output={"fields_per_period": 0})
    with pytest.raises(CaseError, match="scan"):
        df.preset("embedded").with_overrides({"scan.spacing": 0.01})


@pytest.mark.parametrize(
    "points", [[[0.3, 0.0]] + [[0.01 * k, 0.0] for k in range(8)], [[0.1, 0.0]] * 9, [[0.1, 0.0]]]
)
def test_points_beside_the_plate_twice_or_too_few_are_refused(points):
    with pytest.raises(CaseError, match=r"scan\.points"):
        scan_points(plate(scan={"points": points}))


def test_the_full_and_the_reduced_plate_read_the_same_at_rest_on_a_moved_base():
    case = plate(scan={"spacing": 0.02})
    structure = assemble(case)
    layout = structure.layout
    rows = layout.numbers_of(scanned_places(case))
    # a base that is moved takes everything along
    o = structure.operators
    u = scipy.sparse.linalg.spsolve(o.stiffness.tocsc(), -o.base.stiffness)
    read = layout.read(u[None], np.ones(1))[0, rows]
    reduced = reduced_case(case, 8, full=structure).structure
    q = -reduced.operators.base.stiffness / reduced.operators.stiffness.diagonal()
    again = reduced.layout.read(q[None], np.ones(1))[0]
    np.testing.assert_allclose(
        again[reduced.layout.numbers_of(scanned_places(case))], read, rtol=1e-5
    )
    assert read.shape == (len(scan_points(case)),)


@pytest.mark.slow
def test_a_run_reads_what_sensors_read(tmp_path):
    """On the full plate, and on the reduced one; a scan is a record with places."""
    sensor = {
        "name": "laser", "quantity": "velocity", "lamina": "upper", "surface": "top",
        "position": [0.1, 0.01],
    }  # fmt: skip
    case = plate(scan={"spacing": 0.02}, sensor=[sensor])
    reduced_case(case, 20).save(tmp_path)
    for one in (case, df.load_case(tmp_path / "case.toml")):
        result = df.run(one)
        history = result.history
        at = np.hypot(history["scan_x"] - 0.1, history["scan_z"] - 0.01).to_numpy()
        number = int(at.argmin())
        assert at[number] < 1e-9
        frames, every = history["frame"].to_numpy(), history["time"].to_numpy()
        laser = np.interp(frames, every, history["sensor_laser"].to_numpy())
        scanned = history["scan_velocity"].to_numpy()[:, number]
        inside = frames >= every[0]
        np.testing.assert_allclose(
            scanned[inside], laser[inside], rtol=1e-9, atol=1e-9 * abs(laser).max()
        )
        channel = result.scan[f"scan_{number + 1}"]
        assert (channel.attrs["x"], channel.attrs["units"]) == (pytest.approx(0.1), "m/s")
        np.testing.assert_array_equal(channel.to_numpy(), scanned)

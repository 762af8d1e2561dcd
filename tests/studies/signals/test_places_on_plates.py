"""Places of channels on a plate: in headings, on the command line, in records."""

import numpy as np
import pytest

from delam_fem import write_record
from delam_fem.api import CaseError
from delam_fem.results.record import SCHEMA
from delam_fem.studies.signals import reading
from delam_fem.studies.signals.channels import assignment


def test_a_heading_and_an_option_say_x_and_z(tmp_path):
    path = tmp_path / "scan.csv"
    times = np.arange(20) * 1e-3
    rows = "\n".join(f"{t},{np.sin(t)},{2.0 * np.sin(t)}" for t in times)
    path.write_text(f"time [s],p1@0.02:-0.03/upper [mm/s],second [mm/s]\n{rows}\n")
    data = reading.read_measured(path, channels={"p2": "second:mm/s@10 mm:5mm/upper"})
    field = reading.scan(data, "velocity", "upper")
    np.testing.assert_allclose(field["position"], [0.01, 0.02])
    np.testing.assert_allclose(field["across"], [0.005, -0.03])
    np.testing.assert_allclose(field[:, 0], 2e-3 * np.sin(times), atol=1e-12)


def test_a_place_along_a_beam_has_none_across(tmp_path):
    assert assignment("P1:m/s@0.1/upper", "test")[1] == {
        "unit": "m/s", "position": 0.1, "lamina": "upper",
    }  # fmt: skip
    with pytest.raises(CaseError, match="position"):
        assignment("P1:m/s@0.1:left", "test")


def test_a_record_of_a_scan_is_read_with_its_places(tmp_path):
    import xarray as xr

    about = {"units": "m/s", "quantity": "velocity", "lamina": "upper", "place": "there"}
    channels = {
        f"scan_{k}": ("time", np.full(10, float(k)), {**about, "x": 0.01 * k, "z": -0.02 * k})
        for k in (1, 2)
    }
    times = ("time", np.arange(10) * 1e-3, {"units": "s"})
    record = xr.Dataset(channels, coords={"time": times}, attrs={"schema": SCHEMA})
    field = reading.scan(
        reading.read_measured(write_record(record, tmp_path / "scan.nc")), "velocity"
    )
    np.testing.assert_allclose(field["position"], [0.01, 0.02])
    np.testing.assert_allclose(field["across"], [-0.02, -0.04])
    np.testing.assert_allclose(field[0], [1.0, 2.0])


def test_a_file_of_positions_places_the_columns_in_their_order(tmp_path):
    path = tmp_path / "scan.csv"
    rows = "\n".join(f"{t},{1.0},{2.0},{3.0}" for t in np.arange(20) * 1e-3)
    path.write_text(f"time [s],a [m/s],b [m/s],c [mm]\n{rows}\n")
    data = reading.read_measured(path)
    places = np.array([[0.02, 0.01], [0.01, -0.03]])
    field = reading.scan(reading.placed(data, "velocity", "upper", places), "velocity", "upper")
    np.testing.assert_allclose(field["position"], [0.01, 0.02])
    np.testing.assert_allclose(field["across"], [-0.03, 0.01])
    np.testing.assert_allclose(field[0], [2.0, 1.0])
    with pytest.raises(CaseError, match="positions: expected"):
        reading.placed(data, "velocity", "upper", places[:1])

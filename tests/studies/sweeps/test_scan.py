"""Sweeps that record the shapes of a scan, started from the closed motion."""

from pathlib import Path

import numpy as np
import pytest

from delam_fem import Sweep, run_sweep
from delam_fem.api import CaseError, preset
from delam_fem.studies.detection.detect import simulated
from delam_fem.studies.detection.study import Scan
from delam_fem.studies.signals.scan import ORDERS, shapes_of
from delam_fem.studies.sweeps.grid import sweep_of

SMALL = {"mesh.elements": 20, "time.steps_per_period": 100, "output.window_periods": 16}


def scanned(**changes: object) -> Sweep:
    data: dict[str, object] = {
        "name": "s",
        "base": "embedded",
        "start": "steady",
        "set": SMALL | {"time.periods": 260},
        "record": {"summary": False, "strobes": 0, "scan": {"spacing": 0.01}},
        "axis": [{"key": "excitation.frequency", "values": [80.0]}],
    }
    return sweep_of(data | changes)


def test_a_sweep_records_the_shapes_of_a_measurement(tmp_path: Path) -> None:
    data = run_sweep(scanned(), tmp_path, "serial").load()
    case = preset("embedded", SMALL | {"time.periods": 260, "excitation.frequency": 80.0})
    measurement = simulated(case, Scan())
    shapes = shapes_of(measurement.field, measurement.times, 80.0, measurement.x)
    np.testing.assert_allclose(data.scan_x, measurement.x)
    np.testing.assert_array_equal(data.order, ORDERS)
    recorded = (data.scan_real + 1j * data.scan_imag).isel(frequency=0).to_numpy()
    for order in (1.0, 2.0):
        k, expected = ORDERS.index(order), shapes.order(order)
        np.testing.assert_allclose(recorded[k], expected, atol=0.02 * np.abs(expected).max())
    assert float(data.scan_rms[0]) == pytest.approx(measurement.rms, rel=1e-2)
    assert data.scan_real.attrs["units"] == "m/s"


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"set": SMALL | {"output.window_periods": 3}}, "window_periods of at least 4.*given 3"),
        ({"set": SMALL | {"output.fields_per_period": 7}}, "divides time.steps_per_period = 100"),
        ({"record": {"scan": {"spacing": 0.3}}}, "at least 5 points on the length 0.4 m"),
        ({"initial": {"lower.velocity": 1.0}}, "start: "),
        ({"start": "moving"}, "start"),
    ],
)
def test_scans_that_are_refused(changes: dict[str, object], text: str) -> None:
    with pytest.raises(CaseError, match=text):
        scanned(**changes)

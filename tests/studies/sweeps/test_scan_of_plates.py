"""Sweeps that record the scan of a reduced plate."""

from pathlib import Path

import numpy as np
import pytest
from plates import FORCE, patched

import delam_fem as df
from delam_fem import CaseError, Sweep, run_sweep
from delam_fem.api import WITHOUT_FRAMES, reduced_case
from delam_fem.studies.convergence.refinement import RefinementStudy, method
from delam_fem.studies.signals.scan import shapes_of
from delam_fem.studies.sweeps.grid import sweep_of, units_of

SCAN = {"scan": {"spacing": 0.02}}
SECTIONS = {
    "time": {"steps_per_period": 100, "periods": 20},
    "output": {"window_periods": 8, "fields_per_period": 20},
}


def swept(folder: Path, case: df.Case, key: str = "excitation.frequency", **scan: object) -> Sweep:
    df.save_case(case, folder)
    return sweep_of({
        "name": "plates",
        "base": str(folder / "case.toml"),
        "record": {"summary": False, "strobes": 0, "scan": scan},
        "axis": [{"key": key, "values": [2500.0, 3000.0]}],
    })  # fmt: skip


def test_the_points_of_a_plate_are_said_once(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"record\.scan\.spacing"):
        swept(tmp_path, patched(**SECTIONS, **SCAN), spacing=0.01)
    with pytest.raises(CaseError, match=r"record\.scan: expected a plate with \[scan\]"):
        swept(tmp_path, patched(**SECTIONS))


def test_a_drive_that_does_not_repeat_is_refused(tmp_path: Path) -> None:
    tap = {
        "excitation": {
            "kind": "hammer",
            "lamina": "lower",
            "position": 0.03,
            "amplitude": 1.0,
            "duration": 1e-4,
        },
        "time": {"step": 1e-5, "duration": 1e-3},
        "output": {},
    }
    with pytest.raises(CaseError, match=r"record\.scan: expected a harmonic excitation"):
        swept(tmp_path, patched(**SCAN, **tap), "excitation.amplitude")


def test_studies_that_read_signals_alone_need_no_frames_for_the_scan() -> None:
    case = patched(**SECTIONS, **SCAN).with_overrides(WITHOUT_FRAMES)
    assert case.scan is None
    law = method("newton-penalty@newmark")
    study = RefinementStudy(patched(**SECTIONS, **SCAN), (law,), (6,), (100, 200), 2, 0)
    levels = study.along_steps(law, 6)
    assert [level.case.scan for level in levels] == [None, None]


@pytest.mark.slow
def test_a_sweep_keeps_the_shapes_of_each_run(tmp_path: Path) -> None:
    reduced_case(patched(**SECTIONS, **SCAN), 12).save(tmp_path)
    case = df.load_case(tmp_path / "case.toml")
    data = run_sweep(swept(tmp_path / "base", case), tmp_path / "sweep", "serial").load()
    history = df.run(case, "compiled").history
    np.testing.assert_allclose(data["scan_x"], history["scan_x"])
    np.testing.assert_allclose(data["scan_z"], history["scan_z"])
    x, times = history["scan_x"].to_numpy(), history["frame"].to_numpy()
    alone = shapes_of(history["scan_velocity"].to_numpy(), times, 3000.0, x)
    recorded = (data["scan_real"] + 1j * data["scan_imag"]).isel(frequency=1).to_numpy()
    for k in (1.0, 2.0):
        row = data["order"].to_numpy().tolist().index(k)
        largest = np.abs(alone.order(1.0)).max()
        np.testing.assert_allclose(recorded[row], alone.order(k), atol=1e-6 * largest)


@pytest.mark.parametrize(
    "key", ["delamination.1.across.2", "sensor.laser.position.1", "excitation.position.2"]
)
def test_numbers_of_lists_are_lengths(key: str) -> None:
    assert units_of(key) == ["m"]
    laser = {"name": "laser", "quantity": "velocity", "lamina": "upper", "position": [0.1, 0.01]}
    case = patched(excitation=FORCE, sensor=[laser])
    changed = case.with_overrides({key: 0.025})
    assert changed != case
    assert 0.025 in (
        *(changed.delamination[0].across or ()),
        *changed.sensor[0].position,
        *changed.excitation.position,
    )
    with pytest.raises(CaseError, match="from 1 to 2"):
        case.with_overrides({f"{key[:-1]}3": 0.025})

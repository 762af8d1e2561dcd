"""Detection on plates: the scan of a patch, its region and verdict, and measured scans."""

import json

import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import CaseError
from delam_fem.studies.detection.detect import in_modes, intact, simulated, with_scan
from delam_fem.studies.detection.maps import patches_of
from delam_fem.studies.detection.study import Scan
from delam_fem.studies.signals.scan import shapes_of

LAMINA = {
    "length": 0.12, "width": 0.1, "density": 2700.0, "young_modulus": 70e9, "damping_ratio": 0.02,
}  # fmt: skip
PATCH = {"between": ["lower", "upper"], "start": 0.04, "end": 0.09, "across": [-0.03, 0.02]}


def plate(**more):
    return df.Case(**{
        "name": "plate",
        "lamina": [
            {"name": "lower", "thickness": 0.0014, **LAMINA},
            {"name": "upper", "thickness": 0.0006, **LAMINA},
        ],
        "model": {"kind": "solid", "poisson": 0.33},
        "mesh": {"elements": 8, "across": 8},
        "delamination": [PATCH],
        "support": [{"side": "start", "kind": "clamped"}, {"side": "end", "kind": "clamped"}],
        "excitation": {
            "kind": "force", "lamina": "lower", "position": [0.02, 0.03], "amplitude": 1.0,
            "frequency": 3000.0,
        },
        "contact": {"law": "newton-penalty", "impulse": "consistent"},
        "time": {"steps_per_period": 100, "periods": 1},
        **more,
    })  # fmt: skip


def test_outlines_of_patches_have_their_areas():
    rectangle, ellipse = plate(), plate(delamination=[PATCH | {"shape_in_plane": "ellipse"}])
    assert patches_of(rectangle).area == pytest.approx(0.05 * 0.05)
    assert patches_of(ellipse).area == pytest.approx(np.pi * 0.025**2, rel=3e-3)
    (outline,) = patches_of(rectangle).outlines
    np.testing.assert_allclose(outline.min(axis=0), [0.04, -0.03])
    through = plate(delamination=[{key: PATCH[key] for key in ("between", "start", "end")}])
    assert patches_of(through).area == pytest.approx(0.05 * 0.1)


def test_the_intact_plate_keeps_edges_and_scan():
    bonded = intact(plate(scan={"spacing": 0.02}))
    assert not bonded.delamination
    assert bonded.is_plate
    assert bonded.support.holds("end")
    assert bonded.scan == plate(scan={"spacing": 0.02}).scan


def test_options_and_the_case_do_not_both_say_the_points():
    assert with_scan(plate(), Scan(spacing=0.02)).scan.spacing == 0.02
    scanned = plate(scan={"spacing": 0.015})
    assert with_scan(scanned, Scan()) == scanned
    with pytest.raises(CaseError, match="spacing"):
        with_scan(scanned, Scan(spacing=0.02))
    with pytest.raises(CaseError, match="first"):
        with_scan(plate(), Scan(first=0.01))


def test_studies_that_know_no_plates_refuse_them():
    for study in (df.excite, df.pod, df.infer):
        with pytest.raises(CaseError, match="plate"):
            study(plate())


@pytest.mark.slow
def test_a_patch_is_found_and_a_scan_of_it_is_judged_alike(tmp_path):
    """The simulated scan, and the record of a run that is read as a measurement."""
    case = plate()
    detection = df.detect(case, tmp_path / "scan", modes=30)
    assert detection.mark.is_detected
    assert not detection.intact_marks["curvature"].is_detected
    numbers = json.loads((tmp_path / "scan" / "detection.json").read_text())
    assert numbers["detected"]
    assert not numbers["intact_called"]
    assert numbers["overlap"] > 0.3
    region = detection.mark.region
    assert numbers["area"] == pytest.approx(region.area)
    # most of what is marked lies in the patch, and its middle does
    assert patches_of(case).contains(*np.mean(region.outlines[0], axis=0)).all()
    assert detection.contrast("curvature") > 3.0
    for name in ("detection", "indices", "shapes"):
        assert (tmp_path / "scan" / "figures" / f"{name}.png").stat().st_size > 10_000
    # the same plate as a rig: its record has x and z of each point
    periods = {"time.periods": 60, "output.window_periods": 16, "output.fields_per_period": 50}
    rig = in_modes(with_scan(case, Scan()).with_overrides(periods), 30, tmp_path / "rig")
    result = df.run(rig)
    df.write_record(result.scan, tmp_path / "record.nc")
    judged = df.detect(case, tmp_path / "judged", measured=[tmp_path / "record.nc"], modes=30)
    assert judged.is_measured
    assert judged.mark.is_detected
    assert judged.mark.region.overlap(region) > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("has_patch", [True, False])
def test_a_linear_plate_has_no_harmonics(has_patch, tmp_path):
    """Without contact, or without a patch: below -120 dB of the first, at all points."""
    case = plate(contact={"law": "none"}, scan={"spacing": 0.02})
    model = in_modes(case if has_patch else intact(plate(scan=case.scan)), 20, tmp_path)
    field = simulated(model, Scan(periods=4), left=1e-10)
    shapes = shapes_of(field.field, field.times, 3000.0, field.x, z=field.z)
    largest = {k: np.abs(shapes.order(k)).max() for k in (1.0, 2.0, 3.0)}
    assert largest[1.0] > 0.0
    assert max(largest[2.0], largest[3.0]) < 1e-6 * largest[1.0]

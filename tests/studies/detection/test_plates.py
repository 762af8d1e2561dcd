"""Detection on plates: the scan of a patch, its region and verdict, and measured scans."""

import json

import numpy as np
import pytest
from plates import FORCE, PATCH, patched

import delam_fem as df
from delam_fem.api import CaseError
from delam_fem.studies.detection import detect, excitation
from delam_fem.studies.detection.detect import in_modes, intact, simulated, with_scan
from delam_fem.studies.detection.excitation import excitation_map
from delam_fem.studies.detection.maps import patches_of
from delam_fem.studies.detection.population import plate_grid, pod, population
from delam_fem.studies.detection.study import Scan
from delam_fem.studies.signals.scan import shapes_of

ENDS = [{"side": "start", "kind": "clamped"}, {"side": "end", "kind": "clamped"}]


def plate(**sections):
    """A plate with a patch, clamped at both ends, with a shaker."""
    return patched(8, **{"support": ENDS, "excitation": FORCE, **sections})


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
    for study in (df.infer, df.modulate):
        options = {"pump_frequency": 50.0, "pump_amplitude": 1.0} if study is df.modulate else {}
        with pytest.raises(CaseError, match="plate"):
            study(plate(), **options)


@pytest.mark.slow
def test_a_patch_is_found_and_a_scan_of_it_is_judged_alike(tmp_path):
    """The simulated scan, and the record of a run that is read as a measurement."""
    case = plate().with_overrides({"excitation.frequency": 4000.0})
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


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """The map of a plate around half of its defect resonance, and its folder."""
    folder = tmp_path_factory.mktemp("map")
    f = df.modes(plate(), 12)
    (local,) = (k for k, name in enumerate(f.motions) if name.startswith("defect resonance"))
    frequencies = np.array([0.8, 0.9, 1.0, 1.1]) * f.frequencies[local]
    return excitation_map(plate(), frequencies, folder, "serial", modes=30), f, folder


@pytest.mark.slow
def test_excite_marks_the_defect_resonance_that_modes_names(mapped):
    map_, f, folder = mapped
    (local,) = (k for k, name in enumerate(f.motions) if name.startswith("defect resonance"))
    assert map_.defect_resonances == {"lower-upper 1": pytest.approx(f.frequencies[local])}
    assert map_.loudest == map_.frequencies[map_.second[0].argmax()]
    assert ((map_.overlap > 0.0) & (map_.overlap < 1.0)).all()
    assert "defect resonance: lower-upper 1" in map_.reason
    map_.save(folder)
    numbers = json.loads((folder / "excitation.json").read_text())
    assert numbers["largest_2f_at"] == map_.loudest
    assert (folder / "figures" / "excitation.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_resumed_map_reduces_only_another_plate(mapped, monkeypatch):
    map_, _, folder = mapped

    def no_reduction(*_, **__):
        raise AssertionError("reduced again")

    for module in (detect, excitation):
        monkeypatch.setattr(module, "reduced_case", no_reduction)
    again = excitation_map(plate(), map_.frequencies, folder, "serial", modes=30, resume=True)
    np.testing.assert_array_equal(again.visibility, map_.visibility)
    assert again.defect_resonances == map_.defect_resonances
    other = plate(delamination=[PATCH | {"end": 0.08}])
    with pytest.raises(AssertionError, match="reduced again"):
        excitation_map(other, map_.frequencies, folder, "serial", modes=30, resume=True)


@pytest.mark.slow
def test_an_excitation_is_judged_as_a_scan_there(mapped):
    map_, *_ = mapped
    f = float(map_.frequencies[0])
    detection = df.detect(plate().with_overrides({"excitation.frequency": f}), modes=30)
    assert detection.mark.over_limits.max() == pytest.approx(map_.visibility[0, 0], rel=0.3)
    second = np.abs(detection.shapes.order(2.0)).max()
    assert second == pytest.approx(map_.second[0, 0], rel=0.05)
    assert detection.repeated.overlap(detection.patches) == pytest.approx(
        map_.overlap[0, 0], abs=0.1
    )


@pytest.mark.slow
def test_larger_patches_are_found_more_often(tmp_path):
    """Of three sizes, at a noise between those that find all and none; no intact plate is."""
    specimens = plate_grid(plate(), (3000.0,), (0.15, 0.3, 0.5), (0.3,))
    runs = population(plate(), specimens, tmp_path, "serial", modes=30)
    study = pod(plate(), runs, (0.0,))
    trials_ = study.lines[0].trials
    scores = [trials_["score"].to_numpy()[k : k + 2].max() for k in (0, 2, 4)]
    assert scores[0] < scores[1] < scores[2]
    hits = [trials_["hit"].to_numpy()[k : k + 2].sum() for k in (0, 2, 4)]
    assert hits[0] < hits[2]
    assert (study.lines[0].intact > 1.0).mean() < 0.05
    for path in study.save(tmp_path):
        assert path.is_file()


def test_the_grid_of_patches_fits_the_plate():
    specimens = plate_grid(plate(), (3000.0,))
    assert len({(round(s.length, 9), s.thickness) for s in specimens}) == 5 * 3
    for specimen in specimens:
        case = plate().with_overrides(specimen.keys(plate()))
        assert patches_of(case).area == pytest.approx(specimen.length**2)
        assert case.lamina[1].thickness == pytest.approx(specimen.thickness)
        assert case.lamina[0].thickness + case.lamina[1].thickness == pytest.approx(0.002)


def test_supports_of_plates_are_those_of_the_case():
    with pytest.raises(CaseError, match="supports"):
        df.pod(plate(), supports=("clamped",))

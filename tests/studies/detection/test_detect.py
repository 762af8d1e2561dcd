"""The preset `embedded`: exactly where it is delaminated, and nowhere when it is not."""

import json
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import Case, CaseError, json_ready, preset
from delam_fem.studies.detection.detect import detect, intact, per_sample, per_shape, simulated
from delam_fem.studies.detection.indices import mark
from delam_fem.studies.detection.study import Detect, Scan
from delam_fem.studies.signals.scan import shapes_of


def embedded(frequency: float, **keys: object) -> Case:
    return preset("embedded", {"excitation.frequency": frequency, **keys})


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [57.0, 92.0, 135.0])
def test_a_delamination_is_marked_exactly_at_40_db(frequency: float) -> None:
    detection = detect(embedded(frequency))
    assert (detection.mark.start, detection.mark.end) == pytest.approx((0.12, 0.28))
    assert not detection.intact_marks["curvature"].is_detected
    assert detection.repeated.calls == 1.0
    if frequency < 100.0:
        assert detection.contrast("curvature") > 10.0  # 17 to 23 without noise
        assert 5.0 < detection.contrast("V2") < 9.0
    np.testing.assert_allclose(detection.repeated.start, 0.12, atol=0.011)


def test_thd_points_to_the_wrong_places_near_resonance() -> None:
    detection = detect(embedded(63.7))
    assert detection.contrast("thd") < 1.0 < detection.contrast("V2")


def test_a_shifted_grid_marks_its_nearest_points() -> None:
    detection = detect(embedded(80.0), Detect(first=0.005))
    assert (detection.mark.start, detection.mark.end) == pytest.approx((0.125, 0.275))


def test_the_index_depends_neither_on_the_amplitude_nor_much_on_the_steps() -> None:
    clean = []
    for keys in ({}, {"excitation.acceleration": 7.0}, {"time.steps_per_period": 1000}):
        m = simulated(embedded(80.0, **keys), Scan())
        values = mark("curvature", shapes_of(m.field, m.times, 80.0, m.x)).values
        clean.append(values / values.max())
    np.testing.assert_allclose(clean[1], clean[0], atol=1e-6)  # closed at rest: homogeneous
    np.testing.assert_allclose(clean[2], clean[0], atol=0.15)


def test_intact_beams_are_called_at_most_in_5_percent() -> None:
    """200 intact beams with noise of their own."""
    case = intact(embedded(63.7, **{"mesh.elements": 20}))
    scan = Scan()
    pure = simulated(case, scan)
    names = ("curvature", "V2", "V3", "V1/2", "distortion", "thd")
    called = dict.fromkeys(names, 0)
    for seed in range(200):
        noisy = pure.noisy(pure.noise_of(scan), seed)
        shapes = shapes_of(noisy.field, noisy.times, noisy.frequency, noisy.x)
        for name in names:
            called[name] += mark(name, shapes).is_detected
    assert max(called.values()) <= 10, called


@pytest.mark.slow
def test_what_is_written(tmp_path: Path) -> None:
    detection = detect(embedded(80.0), repetitions=20)
    detection.save(tmp_path)
    numbers = json.loads((tmp_path / "detection.json").read_text("utf-8"))
    assert {"frequency", "index", "start", "end", "detected", "intact_called"} <= set(numbers)
    assert (numbers["frequency"], numbers["index"]) == (80.0, "curvature")
    assert (numbers["start"], numbers["end"]) == (0.12, 0.28)
    assert (numbers["detected"], numbers["intact_called"]) == (True, False)
    assert len(numbers["indices"]["curvature"]["x"]) == 39


def test_a_beam_without_delamination_is_not_called() -> None:
    detection = detect(intact(embedded(80.0)), repetitions=50)
    numbers = json_ready(detection.report.numbers)
    assert (numbers["detected"], numbers["start"], numbers["contrast"]) == (False, None, None)
    assert detection.repeated.calls <= 0.06


def test_a_measured_field_is_judged_like_a_simulated_one() -> None:
    case, scan = embedded(80.0), Scan()
    simulated_one = simulated(case, scan)
    noise = simulated_one.noise_of(scan)
    detection = detect(case, measured=simulated_one.noisy(noise, 9), repetitions=50)
    assert detection.is_measured
    assert (detection.mark.start, detection.mark.end) == pytest.approx((0.12, 0.28))
    assert detection.sample_noise == pytest.approx(noise, rel=0.6)
    assert not detection.intact_marks["curvature"].is_detected


@pytest.mark.slow
@pytest.mark.parametrize("start", [0.02, 0.12])
def test_the_contrast_of_a_measured_field_is_that_of_the_find(start: float) -> None:
    """The case's delamination is no truth of a measurement, wherever it is."""
    rig, scan = embedded(80.0), Scan()
    pure = simulated(rig, scan)
    case = embedded(80.0, **{"delamination.1.start": start, "delamination.1.end": start + 0.08})
    # the noise of the simulated scan: with another seed the largest noise outside makes 8 to 19 of
    # a contrast
    measured = pure.noisy(pure.noise_of(scan), scan.seed)
    detection = detect(case, measured=measured, repetitions=20)
    marked = (detection.mark.x >= detection.mark.start) & (detection.mark.x <= detection.mark.end)
    exact = detection.mark.values[marked].max() / detection.mark.values[~marked].max()
    assert detection.report.numbers["contrast"] == pytest.approx(exact, rel=1e-9)
    of_rig = detect(rig, repetitions=20).contrast("curvature")
    assert exact == pytest.approx(of_rig, rel=1e-9)


def test_the_noise_of_samples_and_of_shapes() -> None:
    assert per_shape(0.5, 400) == pytest.approx(0.05)
    assert per_sample(per_shape(0.3, 17), 17) == pytest.approx(0.3)


def test_an_unknown_index_is_refused() -> None:
    with pytest.raises(CaseError, match="index: "):
        detect(embedded(80.0), Detect(index="V9"))

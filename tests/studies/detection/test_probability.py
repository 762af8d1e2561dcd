"""POD curves of known hits, ROC curves, and intact beams that are not called."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import CaseError, preset
from delam_fem.studies.detection.detect import drive_responses, intact
from delam_fem.studies.detection.population import (
    ELEMENTS,
    Specimen,
    end_error,
    grid,
    intact_scores,
    logistic,
    pod,
    population,
    roc,
    trials,
)


def test_the_regression_finds_the_curve_that_made_the_hits() -> None:
    rng = np.random.default_rng(1)
    a = np.exp(rng.uniform(np.log(0.01), np.log(1.0), 20_000))
    truth = 1.0 / (1.0 + np.exp(-(6.0 + 3.0 * np.log(a))))
    curve = logistic(a, rng.uniform(size=a.size) < truth)
    np.testing.assert_allclose(curve.beta, [6.0, 3.0], rtol=0.05)
    a90 = np.exp((np.log(9.0) - 6.0) / 3.0)
    assert curve.length(0.9) == pytest.approx(a90, rel=0.03)
    assert a90 < curve.length(0.9, 0.95) < 1.1 * a90  # few data make it larger
    few = logistic(a[:200], rng.uniform(size=200) < truth[:200])
    assert few.length(0.9, 0.95) / few.length(0.9) > curve.length(0.9, 0.95) / curve.length(0.9)


def test_bounds_cover_the_true_a90() -> None:
    """The lower bound of the curve makes a90/95 exceed the true a90 in about 95 %."""
    rng, above = np.random.default_rng(2), 0
    a90 = np.exp((np.log(9.0) - 6.0) / 3.0)
    for _ in range(200):
        a = np.exp(rng.uniform(np.log(0.02), np.log(1.0), 120))
        hit = rng.uniform(size=120) < 1.0 / (1.0 + np.exp(-(6.0 + 3.0 * np.log(a))))
        above += logistic(a, hit).length(0.9, 0.95) > a90
    assert 180 <= above <= 198


@pytest.mark.parametrize("hits", [[0, 0, 0, 0], [1, 1, 1, 1], [0, 0, 1, 1]])
def test_without_overlap_there_is_no_regression(hits: list[int]) -> None:
    curve = logistic(np.array([0.1, 0.2, 0.3, 0.4]), np.array(hits, dtype=bool))
    assert np.isnan(curve.length(0.9))


def test_roc_of_known_scores() -> None:
    false, true = roc(np.array([3.0, 1.5, np.nan]), np.array([1.0, 2.0]))
    np.testing.assert_allclose(false, [0.0, 0.0, 0.5, 0.5, 1.0])
    np.testing.assert_allclose(true, [0.0, 1 / 3, 1 / 3, 2 / 3, 2 / 3])


@pytest.mark.slow
@pytest.mark.parametrize("noise", [40.0, 20.0])
@pytest.mark.parametrize("support", ["clamped", "free"])
def test_200_intact_beams_are_called_in_at_most_5_percent(support: str, noise: float) -> None:
    scores = intact_scores(preset("embedded"), support, 92.0, noise)
    assert scores.size == 200
    assert (scores > 1.0).sum() <= 10


@pytest.mark.slow
def test_a_small_study(tmp_path: Path) -> None:
    case = preset("embedded")
    specimens = [
        Specimen(0.2 - half, 0.2 + half, depth, "clamped", 250.0)
        for half in (0.01, 0.02, 0.04, 0.08)
        for depth in (0.0003, 0.0009)
    ]
    runs = population(case, specimens, tmp_path, "serial")
    judged = trials(case, runs, 40.0)
    assert judged.hit[-2:].all() and not judged.hit[1]  # long ones; short and deep
    assert end_error(judged) <= 0.03 * case.length
    assert not trials(case, runs, -40.0).hit.any()
    # what a shaker adds that distorts is taken away, as detect does
    beam = intact(case.with_overrides({"excitation.frequency": 250.0, "mesh.elements": ELEMENTS}))
    added = np.zeros_like(runs.values)
    added[:, runs.orders.index(2.0)] = drive_responses(beam, "upper", runs.x, 250.0)[2.0]
    shaken = replace(runs, values=runs.values + added * abs(runs.values).max())
    np.testing.assert_allclose(trials(case, shaken, 40.0).score, judged.score, rtol=1e-6)
    study = pod(case, runs, (40.0,))
    assert study.recommended == {("clamped", 40.0): 250.0}
    assert tuple(study.report.tables[0].rows[0][:3]) == ("clamped", "40", "250")
    assert all(path.is_file() for path in study.save(tmp_path))
    again = population(case, specimens, tmp_path, "serial", resume=True)
    np.testing.assert_array_equal(again.values, runs.values)


def test_the_grid_is_the_promised_one() -> None:
    specimens = grid(preset("embedded"), ("clamped", "free"), (92.0,))
    assert len(specimens) == 2 * 8 * 3 * 5
    assert min(specimen.start for specimen in specimens) > 0.0
    assert max(specimen.end for specimen in specimens) < 0.4
    shares = sorted({round(specimen.length / 0.4, 6) for specimen in specimens})
    assert (shares[0], shares[-1]) == (0.05, 0.4)


def test_a_case_without_a_delamination_makes_no_population(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match=r"two laminae and one \[\[delamination\]\], given 2 and 0"):
        population(
            intact(preset("embedded")), grid(preset("embedded"), ("free",), (92.0,)), tmp_path
        )

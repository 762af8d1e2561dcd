"""What is written and drawn of a posterior."""

import json
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import preset
from delam_fem.numerics.statistics import Posterior
from delam_fem.studies.detection.infer import Inferred, observed, prior_of, truth_of

CASE = preset("embedded")


def test_the_prior_of_a_case_has_its_proportions() -> None:
    np.testing.assert_allclose(prior_of(CASE), [[0.1, 0.3], [0.03, 0.16], [0.0002, 0.0009]])


def test_the_case_itself_is_observed_at_each_frequency() -> None:
    np.testing.assert_allclose(truth_of(CASE), [0.12, 0.28, 0.0006])
    both = observed(CASE, (92.0, 250.0))
    assert [specimen.frequency for specimen in both] == [92.0, 250.0]
    assert both[0].length == pytest.approx(0.16)
    assert both[0].support == "clamped"


def test_a_posterior_is_written_and_drawn(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    samples = truth_of(CASE) * rng.normal(1.0, 0.02, size=(400, 3))
    inference = Inferred(CASE, Posterior(samples, np.full(400, 1 / 400)), 400)
    path, picture, _ = inference.save(tmp_path)
    numbers = json.loads(path.read_text("utf-8"))
    np.testing.assert_allclose(numbers["median"], truth_of(CASE), rtol=0.01)
    low, high = np.array(numbers["interval_90"]).T
    np.testing.assert_allclose((high - low) / truth_of(CASE), 2 * 1.645 * 0.02, rtol=0.2)
    assert inference.report.tables[0].rows[0][:2] == ("start", "120")
    assert numbers["identified"] == [True] * 3
    assert picture == tmp_path / "figures" / "posterior.png" and picture.is_file()


def test_what_the_scans_do_not_tell_is_named() -> None:
    """The depth is drawn from its prior, start and end are known: only the depth is named."""
    rng = np.random.default_rng(2)
    samples = truth_of(CASE) * rng.normal(1.0, 0.02, size=(400, 3))
    samples[:, 2] = rng.uniform(*prior_of(CASE)[2], 400)
    report = Inferred(CASE, Posterior(samples, np.full(400, 1 / 400)), 400).report
    assert report.numbers["identified"] == [True, True, False]
    (text,) = report.sentences
    assert "depth" in text and "start" not in text

"""Posteriors of start, end and depth: near the truth, and calibrated on made-up scans."""

from dataclasses import replace

import numpy as np
import pytest

from delam_fem.api import preset
from delam_fem.numerics.statistics import Posterior, uniform
from delam_fem.studies.detection.indices import curvature
from delam_fem.studies.detection.infer import (
    COMPONENTS,
    ScanNoise,
    SimulationTable,
    _statistics,
    edge_posterior,
    edges,
    prior_of,
    simulation_table,
    specimens_of,
)
from delam_fem.studies.detection.population import Population
from delam_fem.studies.signals.scan import Shapes

X = np.linspace(0.0, 0.4, 41)
N = 700
PRIOR = prior_of(preset("embedded"))


@pytest.fixture(scope="module")
def made_up() -> tuple[Population, np.ndarray, SimulationTable]:
    """Second harmonics that are arches over the delamination, larger for thinner laminae."""
    parameters = uniform(PRIOR, N, 5)
    specimens = specimens_of(parameters, "clamped", (92.0,))
    values = np.zeros((N, 2, X.size), dtype=complex)
    values[:, 0] = np.sin(np.pi * X / 0.4)
    for specimen, V, (middle, length, depth) in zip(specimens, values, parameters, strict=True):
        assert specimen.length == pytest.approx(length)
        s = np.clip((X - middle + 0.5 * length) / length, 0.0, 1.0)
        V[1] = 3e-5 / depth * np.sin(np.pi * s) ** 2
    population = Population(tuple(specimens), X, (1.0, 2.0), values, np.full(N, 0.7))
    return (
        population,
        parameters,
        simulation_table(population, parameters, PRIOR, (ScanNoise(40.0),)),
    )


def test_edges_follow_from_middle_and_length() -> None:
    bounds = edges(np.array([[0.2, 0.1, 0.0005]]))
    np.testing.assert_allclose(bounds, [[0.15, 0.25, 0.0005]])
    posterior = edge_posterior(Posterior(np.array([[0.2, 0.1, 0.0005]]), np.ones(1)))
    np.testing.assert_allclose(posterior.samples, bounds)


def test_a_posterior_is_near_the_truth_and_narrower_than_the_prior(
    made_up: tuple[Population, np.ndarray, SimulationTable],
) -> None:
    population, parameters, known = made_up
    scan = population.shapes(7, 40.0, np.random.default_rng(8))
    posterior = edge_posterior(known.posterior((scan,)))
    truth = edges(parameters[7:8])[0]
    np.testing.assert_allclose(posterior.quantile(0.5)[:2], truth[:2], atol=0.02)
    assert posterior.quantile(0.5)[2] == pytest.approx(truth[2], rel=0.2)
    widths = np.diff(posterior.interval(), axis=1).ravel()
    assert (widths < [0.06, 0.06, 0.0003]).all()


def test_90_percent_intervals_cover_the_truth(
    made_up: tuple[Population, np.ndarray, SimulationTable],
) -> None:
    *_, known = made_up
    share = known.table.coverage(np.arange(100))
    assert (share >= 0.82).all(), share  # 0.9, less 2.7 standard deviations


def test_the_statistic_of_a_scan_that_no_simulation_has_is_named(
    made_up: tuple[Population, np.ndarray, SimulationTable],
) -> None:
    population, _, known = made_up
    scan = population.shapes(7, 40.0, np.random.default_rng(8))
    assert known.mismatch((scan,)) is None
    tripled = replace(scan, values=np.array([3.0, 1.0])[:, None] * scan.values)
    assert "the size of the first harmonic at 92 Hz" in str(known.mismatch((tripled,)))


def test_the_sizes_of_both_orders_are_told_apart() -> None:
    """Ten times the second harmonic changes its ratio to the first alone, by log 10."""
    first, second = np.sin(np.pi * X / 0.4), np.clip(0.05 - np.abs(X - 0.2), 0.0, None)
    summaries = []
    for size in (1.0, 10.0):
        values = np.array([2.0 * first, size * second], dtype=complex)
        shapes = Shapes(X, 92.0, (1.0, 2.0), values, 1e-6)
        n = curvature(shapes).values.size
        summaries.append(_statistics(shapes, np.vstack([np.zeros(n), np.eye(COMPONENTS, n)])))
    change = summaries[1] - summaries[0]
    assert change[-2:] == pytest.approx([np.log(10.0), 0.0], abs=1e-12)
    assert change[:COMPONENTS] == pytest.approx(np.zeros(COMPONENTS), abs=1e-12)
    rms = np.sqrt(np.mean(first**2))
    assert summaries[0][-1] == pytest.approx(np.log(2.0 * rms))

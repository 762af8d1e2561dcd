import numpy as np
import pytest

from delam_fem.api import statistics
from delam_fem.numerics.statistics import Posterior, Simulations

NOISE = 0.05
BOX = np.array([[-1.0, 1.0], [-1.0, 1.0]])


def table(n: int = 3000, *, noise: float = NOISE) -> Simulations:
    """Return simulations whose posterior is known: sum and difference of two parameters."""
    rng = np.random.default_rng(1)
    parameters = rng.uniform(-1.0, 1.0, (n, 2))
    exact = np.stack([parameters.sum(axis=1), parameters[:, 0] - parameters[:, 1]], axis=1)
    return Simulations(parameters, exact + noise * rng.standard_normal((n, 2)), BOX)


def test_the_posterior_of_a_linear_model_is_the_normal_distribution() -> None:
    posterior = table().posterior(np.array([0.3, 0.1]))
    deviation = NOISE / np.sqrt(2.0)
    np.testing.assert_allclose(posterior.quantile(0.5), [0.2, 0.1], atol=0.4 * deviation)
    width = np.diff(posterior.interval(0.9), axis=1)[:, 0]
    np.testing.assert_allclose(width, 2.0 * 1.645 * deviation, rtol=0.25)
    assert abs(posterior.correlation()[0, 1]) < 0.25


def test_parameters_that_one_statistic_cannot_separate_are_correlated() -> None:
    both = table()
    one = Simulations(both.parameters, both.statistics[:, :1], BOX)
    posterior = one.posterior(np.array([0.3]))
    assert posterior.correlation()[0, 1] < -0.8
    assert np.all(np.diff(posterior.interval(0.9), axis=1) > 0.8)


def test_a_single_parameter_is_correlated_with_itself_alone() -> None:
    alone = Posterior(np.linspace(0.0, 1.0, 9)[:, None], np.full(9, 1.0 / 9.0))
    np.testing.assert_allclose(alone.correlation(), [[1.0]])


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(2)
    parameters = rng.uniform(0.0, 1.0, (3000, 2))
    a, b = parameters.T
    exact = np.stack([np.sin(3.0 * a) + b**2, a * b, np.exp(b) * a], axis=1)
    bent = Simulations(
        parameters, exact + NOISE * rng.standard_normal(exact.shape), np.array([[0.0, 1.0]] * 2)
    )
    coverage = bent.coverage(np.arange(200))
    assert np.all((coverage > 0.84) & (coverage < 0.96))  # 0.90 ± 2.8 standard errors
    assert np.all(bent.coverage(np.arange(200), level=0.5) < 0.65)


def test_many_useless_statistics_of_few_simulations_leave_the_intervals_honest() -> None:
    few = table(300)
    rng = np.random.default_rng(5)
    crowd = np.concatenate([few.statistics, rng.standard_normal((300, 17))], axis=1)
    coverage = Simulations(few.parameters, crowd, BOX).coverage(np.arange(200))
    assert np.all(coverage > 0.84)


def test_samples_stay_within_the_prior() -> None:
    posterior = table().posterior(np.array([2.0, 0.0]))
    assert np.abs(posterior.samples).max() <= 1.0


def test_few_simulations_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 100 simulations, given 20"):
        table(20).posterior(np.zeros(2))


def test_of_many_simulations_a_share_is_accepted() -> None:
    many = table(1500)
    observed = np.array([0.3, 0.1])
    assert len(many.posterior(observed).samples) == round(0.08 * 1500)
    assert len(many.posterior(observed, accepted=0.2).samples) == round(0.2 * 1500)


def test_what_the_model_made_is_seldom_doubted_and_a_statistic_that_is_off_is() -> None:
    """The third statistic is noise alone."""
    rng = np.random.default_rng(3)

    def observed(parameters: np.ndarray) -> np.ndarray:
        a, b = parameters.T
        exact = np.stack([a + b, a - b, 0.0 * a], axis=1)
        return exact + NOISE * rng.standard_normal(exact.shape)

    parameters = rng.uniform(-1.0, 1.0, (2000, 2))
    simulations = Simulations(parameters, observed(parameters), BOX)
    observations = observed(rng.uniform(-0.9, 0.9, (60, 2)))
    shares = np.array([simulations.misfit(row) for row in observations])
    assert ((shares >= 0.0) & (shares <= 1.0)).all()
    assert np.mean(shares < 0.1) < 0.25  # at most 0.1, and 4 standard errors
    assert simulations.misfit(np.array([0.3, 0.1, 8.0 * NOISE])) < 1e-6


def test_the_statistic_that_alone_is_off_is_named() -> None:
    """Six statistics of two parameters. The largest residual would name 4 of 9 rightly."""
    rng = np.random.default_rng(4)
    slopes = np.array([[1.0, 1.0, 0.0, 1.0, 2.0, 0.5], [1.0, -1.0, 1.0, 0.0, 1.0, -2.0]])

    def observed(parameters: np.ndarray) -> np.ndarray:
        exact = parameters @ slopes + 0.3 * np.sin(parameters @ slopes)
        return exact + NOISE * rng.standard_normal(exact.shape)

    parameters = rng.uniform(-1.0, 1.0, (1000, 2))
    simulations = Simulations(parameters, observed(parameters), BOX)
    for number, shift in enumerate([0.8, -0.8, 0.8, -0.8, 0.8, -0.8]):
        observation = observed(rng.uniform(-0.5, 0.5, (1, 2)))[0]
        observation[number] += shift
        assert simulations.misfit(observation) < statistics.UNLIKE
        assert simulations.outlier(observation) == number


def left_out(columns: np.ndarray, targets: np.ndarray, penalty: float) -> float:
    """Return the mean square error of rows, each predicted by a ridge regression of all others."""
    errors = []
    for k in range(len(columns)):
        others = np.arange(len(columns)) != k
        x, y = columns[others], targets[others]
        centred, middle = x - x.mean(axis=0), y.mean(axis=0)
        normal = centred.T @ centred + penalty * np.eye(x.shape[1])
        slopes = np.linalg.solve(normal, centred.T @ (y - middle))
        errors.append(targets[k] - middle - (columns[k] - x.mean(axis=0)) @ slopes)
    return float(np.mean(np.square(errors)))


@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
def test_the_penalty_has_the_smallest_errors_of_what_is_left_out(noise: float) -> None:
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((24, 12))
    columns -= columns.mean(axis=0)
    targets = columns[:, :2] + noise * rng.standard_normal((24, 2))
    targets -= targets.mean(axis=0)
    chosen = statistics._penalty(columns, targets, columns.T @ columns, columns.T @ targets)
    sizes = [left_out(columns, targets, penalty) for penalty in 24 * statistics.PENALTIES]
    assert chosen == 24 * statistics.PENALTIES[int(np.argmin(sizes))]
    assert 0 < int(np.argmin(sizes)) < len(sizes) - 1

"""Each index on a synthetic field with a known answer, and what noise alone makes of it."""

import math

import numpy as np
import pytest
from scipy.stats import binom

from delam_fem.studies.detection.indices import (
    FALSE_CALLS,
    INDICES,
    curvature,
    mark,
    sideband_ratio,
)
from delam_fem.studies.signals.scan import Shapes, shapes_of

F = 5.0
X = np.linspace(0.0, 0.4, 41)
TIMES = np.arange(16 * 40) / (40 * F)


def field_of(known: dict[float, np.ndarray], x: np.ndarray = X) -> np.ndarray:
    """Return Σ Re(V_k exp(2πi k f t)), shape (time, point)."""
    phases = {k: np.exp(2j * math.pi * k * F * TIMES)[:, None] for k in known}
    return np.asarray(sum((phases[k] * (V + 0.0 * x)).real for k, V in known.items()))


@pytest.mark.parametrize("x", [X, np.array([0.0, 0.1, 0.12, 0.2, 0.31, 0.4])])
def test_the_curvature_of_a_parabola_is_its_second_derivative(x: np.ndarray) -> None:
    V2 = (3.0 - 4.0j) * (x**2 - 0.3 * x + 1.0)  # V'' = 2 (3 - 4i), of magnitude 10
    index_mark = mark("curvature", shapes_of(field_of({1.0: 1.0, 2.0: V2}, x), TIMES, F, x))
    np.testing.assert_array_equal(index_mark.x, x[1:-1])
    np.testing.assert_allclose(index_mark.values, 10.0, rtol=1e-8)


def test_phase_matters_to_the_curvature() -> None:
    """A kink in the phase alone is a kink of the complex shape; |V2| is flat there."""
    V2 = np.where(X < 0.2, 1.0, 1j)
    index_mark = mark("curvature", shapes_of(field_of({1.0: 1.0, 2.0: V2}), TIMES, F, X))
    assert np.flatnonzero(index_mark.values > 1.0).tolist() == [18, 19]  # beside 0.2 m
    assert index_mark.values[18] == pytest.approx(math.sqrt(2.0) / 0.01**2)


@pytest.mark.parametrize(("name", "order"), [("V2", 2.0), ("V3", 3.0), ("V1/2", 0.5)])
def test_magnitudes_are_those_of_their_order(name: str, order: float) -> None:
    V = (0.6 + 0.8j) * X
    index_mark = mark(name, shapes_of(field_of({1.0: 1.0, order: V}), TIMES, F, X))
    np.testing.assert_allclose(index_mark.values, X, atol=1e-12)


def test_distortion_and_thd_are_the_paper_s() -> None:
    field = field_of({0.5: 9.0, 1.0: 2.0 + X, 2.0: 0.3 * (2.0 + X), 3.0: 0.4j * (2.0 + X)})
    thd = mark("thd", shapes_of(field, TIMES, F, X))
    np.testing.assert_allclose(thd.values, 0.5, rtol=1e-10)  # sqrt(0.3² + 0.4²)
    d = mark("distortion", shapes_of(field, TIMES, F, X))
    np.testing.assert_allclose(d.values, math.sqrt(1.25) - 1.0, rtol=1e-9)


def test_the_sideband_ratio_of_a_modulated_tone_is_its_depth() -> None:
    pump, probe, depth = 5.0, 61.3, np.array([0.0, 0.1, 0.4])
    wt, Wt = 2 * math.pi * pump * TIMES, 2 * math.pi * probe * TIMES
    field = (1.0 + depth * np.cos(wt)[:, None]) * np.cos(Wt)[:, None] + 3.0 * np.sin(wt)[:, None]
    np.testing.assert_allclose(sideband_ratio(field, TIMES, pump, probe), depth, atol=1e-10)


@pytest.mark.parametrize("n", [1000, pytest.param(4000, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("name", list(INDICES))
def test_noise_alone_exceeds_the_limits_as_rarely_as_promised(name: str, n: int) -> None:
    """Intact beams: a linear fundamental with noise on all orders."""
    rng = np.random.default_rng(5)
    orders = (0.5, 1.0, 2.0, 3.0, 4.0)
    values = np.zeros((len(orders), X.size), dtype=complex)
    values[1] = 1.0 + np.sin(math.pi * X / 0.4)
    clean = Shapes(X, F, orders, values)
    called = 0
    for _ in range(n):
        index_mark = INDICES[name](clean.noisy(1e-3, rng), FALSE_CALLS)
        called += bool((index_mark.values > index_mark.limits).any())
    spread = 3.0 * math.sqrt(FALSE_CALLS / n)
    assert called / n < FALSE_CALLS + spread
    assert called / n > 0.5 * FALSE_CALLS - spread  # and the limit is not needlessly high


@pytest.mark.slow
@pytest.mark.parametrize("n", [400, pytest.param(4000, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("spread", ["equal", "speckle", "few"])
def test_healthy_beams_are_called_as_rarely_whatever_the_noise_of_their_points(
    spread: str, n: int
) -> None:
    """Noise is estimated for each point: one level for all called half of the last two."""
    rng, called = np.random.default_rng(7), np.zeros(2)
    times = np.arange(16 * 20) / (20 * F)
    still = np.sin(2.0 * np.pi * F * times)[:, None] * (1.0 + np.sin(math.pi * X / 0.4))
    for _ in range(n):
        noise = {"equal": np.ones(X.size), "speckle": np.exp(rng.normal(size=X.size)),
                 "few": np.where(rng.random(X.size) < 0.1, 10.0, 1.0)}[spread]  # fmt: skip
        field = still + 1e-3 * noise * rng.normal(size=still.shape)
        shapes = shapes_of(field, times, F, X)
        for k, name in enumerate(("curvature", "V2")):
            index_mark = INDICES[name](shapes, FALSE_CALLS)
            called[k] += (index_mark.values > index_mark.limits).any()
    assert (called <= binom.ppf(0.999, n, FALSE_CALLS)).all(), called / n
    assert (called >= binom.ppf(0.001, n, 0.5 * FALSE_CALLS)).all(), called / n


def test_the_limit_grows_with_the_noise_and_falls_with_the_spacing() -> None:
    orders, values = (1.0, 2.0), np.zeros((2, X.size), dtype=complex)
    limit = curvature(Shapes(X, F, orders, values, 1.0)).limits[0]
    assert curvature(Shapes(X, F, orders, values, 2.0)).limits[0] == pytest.approx(2.0 * limit)
    assert curvature(Shapes(2.0 * X, F, orders, values, 1.0)).limits[0] == pytest.approx(limit / 4)
    per_point = 1.0 - (1.0 - FALSE_CALLS) ** (1.0 / 39.0)
    spread = math.sqrt(6.0) / 0.01**2  # weights 1, -2, 1
    assert limit == pytest.approx(spread * math.sqrt(-math.log(per_point)), rel=1e-6)


def test_noise_is_measured_on_the_field_itself() -> None:
    rng = np.random.default_rng(2)
    field = field_of({1.0: 1.0 + X}) + rng.normal(scale=0.01, size=(TIMES.size, X.size))
    index_mark = mark("curvature", shapes_of(field, TIMES, F, X))
    again = curvature(shapes_of(field, TIMES, F, X))
    np.testing.assert_array_equal(index_mark.limits, again.limits)
    assert not (index_mark.values > index_mark.limits).any()

"""The mean of a map and its derivative: exact for smooth maps, with fair errors for rough ones."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_maps import Henon

from delam_fem.api import FloatArray
from delam_fem.studies.orbits.newton import Ensemble, Perturbations


def test_perturbations_come_in_antithetic_pairs() -> None:
    perturbations = Perturbations(copies=10, size=0.02, seed=3)
    for values in (perturbations.offsets(4), perturbations.shifts()):
        assert np.array_equal(values[:5], -values[5:])
    spread = np.sqrt((Perturbations(copies=4000, size=0.02).offsets(4) ** 2).sum(axis=1).mean())
    assert spread == pytest.approx(0.02, rel=0.05)
    shifts = np.sort(perturbations.shifts())
    assert np.diff(shifts) == pytest.approx(0.1) and np.abs(shifts).max() == pytest.approx(0.45)


def test_the_derivative_of_a_smooth_map_is_exact() -> None:
    """Two-sided kicks and antithetic pairs leave no error of a quadratic map."""
    map_, a = Henon(), 0.3
    z: FloatArray = map_.fixed(a)
    derivatives = Ensemble(map_, 1, Perturbations()).derivatives(z, a, 1.0)
    assert derivatives.mean(axis=0) == pytest.approx(map_.derivative(z[0], a), abs=1e-12)


def test_the_error_of_the_mean_is_that_of_the_roughness() -> None:
    rough, a = 1e-2, 0.3
    z = Henon().fixed(a)
    smooth = Ensemble(Henon(), 1, Perturbations(size=1e-3)).mean(z, a, 1.0)
    means = [
        Ensemble(Henon(rough), 1, Perturbations(size=1e-3, seed=seed)).mean(z, a, 1.0)
        for seed in range(40)
    ]
    scatter = np.sqrt(np.mean([(mean.slow - smooth.slow) ** 2 for mean in means], axis=0))
    claimed = np.mean([np.sqrt(np.diag(mean.covariance)) for mean in means], axis=0)
    assert scatter == pytest.approx(claimed, rel=0.35)
    # random signs have the variance 1, and 24 pairs average 48 of them
    assert claimed.mean() == pytest.approx(rough / np.sqrt(48.0), rel=0.35)


def test_a_motion_that_diverges_is_told() -> None:
    with pytest.raises(ArithmeticError, match="diverges"):
        Ensemble(Henon()).mean(np.array([np.inf, 0.0]), 0.3, 1.0)

"""Newton's method on the map itself: quadratic where it is smooth, honest where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_maps import Henon

import delam_fem as df
from delam_fem.studies.orbits.maps import FREQUENCY, CaseFamily
from delam_fem.studies.orbits.newton import Powered, derivative, newton
from delam_fem.studies.orbits.search import settled


def test_newton_finds_the_fixed_point_and_its_derivative() -> None:
    map_, a = Henon(), 0.6
    exact = map_.fixed(a)  # unstable there
    root = newton(map_, exact + 0.05, a)
    assert root.is_exact and root.iterations <= 5
    assert root.state == pytest.approx(exact, rel=1e-9)
    D = derivative(Powered(map_, a), root.state)
    assert np.sort(np.linalg.eigvals(D)) == pytest.approx(
        np.sort(np.linalg.eigvals(map_.derivative(exact[0], a))), abs=1e-6
    )


def test_a_rough_map_has_no_exact_orbit() -> None:
    root = newton(Henon(1e-3), Henon().fixed(0.3), 0.3)
    assert not root.is_exact and root.residual > 1e-8


def test_soft_contact_has_an_exact_orbit() -> None:
    """Weak contact near the clamp at 1.25 Hz on springs: two steps, multipliers below 1."""
    case = df.preset("paper", {
        "excitation.frequency": 1.25, "contact.law": "penalty", "mesh.elements": 8,
        "time.steps_per_period": 400,
    })  # fmt: skip
    map_ = CaseFamily(case, FREQUENCY).map()
    state = settled(map_, 1.25, np.zeros(map_.slow.basis.shape[0]), 150)
    root = newton(map_, state, 1.25)
    assert root.is_exact and root.iterations <= 3
    largest = np.abs(np.linalg.eigvals(root.derivative)).max()
    assert largest == pytest.approx(0.94, abs=0.03)

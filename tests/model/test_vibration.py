"""The slowest decay of a structure beside that of exact cantilevers and of single masses."""

import numpy as np
import pytest
import scipy.sparse as sp

import delam_fem as df
from delam_fem.model.beams import closed_form
from delam_fem.model.linear import slowest_decay
from delam_fem.model.operators import BaseCoupling, Operators

DISCRETE = 1e-3
"""Ten cubic elements: the lowest frequencies are within 1e-4 of the exact ones."""


@pytest.mark.parametrize("kind", ["two-mode", "stiffness", "mass"])
def test_the_slowest_mode_of_two_laminae_is_the_lowest_of_the_thin_one(kind: str) -> None:
    case = df.preset("paper", {"damping.rayleigh": kind, "mesh.elements": 10})
    omega = case.lamina[1].angular_frequencies(1)[0]
    found = slowest_decay(closed_form.assemble(case).operators)
    assert found == pytest.approx(0.008 * omega, rel=DISCRETE)


def test_the_less_damped_lamina_decides() -> None:
    keys = {"lamina.thick.damping_ratio": 0.001, "mesh.elements": 10}
    case = df.preset("paper", keys)
    omega = case.lamina[0].angular_frequencies(1)[0]
    found = slowest_decay(closed_form.assemble(case).operators)
    assert found == pytest.approx(0.001 * omega, rel=DISCRETE)


def masses(damping: list[float], stiffness: list[float]) -> Operators:
    """Return unit masses that do not know one another."""
    n = len(damping)
    return Operators(
        sp.identity(n, format="csr"),
        sp.csr_matrix(np.diag(damping)),
        sp.csr_matrix(np.diag(stiffness)),
        BaseCoupling.none(n),
        sp.csr_matrix((0, n)),
        np.zeros(0),
    )


@pytest.mark.parametrize(
    ("damping", "stiffness", "expected"),
    [
        ([0.2, 0.6], [4.0, 9.0], 0.1),  # s = c/2
        ([5.0, 0.6], [4.0, 9.0], 0.3),
        ([10.0, 8.0], [16.0, 9.0], 4.0 - 7.0**0.5),  # s - sqrt(s^2 - omega^2), 2 and 1.35
        ([0.0, 1.0], [4.0, 9.0], 0.0),
    ],
)
def test_masses(damping: list[float], stiffness: list[float], expected: float) -> None:
    assert slowest_decay(masses(damping, stiffness)) == pytest.approx(expected, abs=1e-12)


def test_a_mass_that_nothing_holds_never_stops() -> None:
    found = slowest_decay(masses([0.0, 0.5, 0.5], [0.0, 4.0, 9.0]), is_floating=True)
    assert found == pytest.approx(0.0, abs=1e-7)

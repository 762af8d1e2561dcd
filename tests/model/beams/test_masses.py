"""Point masses: the exact cantilever with a mass, the judge, the weak forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from delam_fem.api import Case, Operators, assemble, preset
from delam_fem.reference import matrices
from delam_fem.reference.compare import operator_differences

ROUND_OFF = 1e-9
MASSES = [
    {"lamina": "thin", "mass": 0.04},
    {"lamina": "thin", "mass": 0.01, "position": 0.25},  # inside an element of 20 and of 7
    {"lamina": "thick", "mass": 0.03, "position": 0.3425},
]


def frequencies(operators: Operators, own: slice) -> list[float]:
    """Return the three lowest frequencies of some dofs [Hz]."""
    K, M = operators.stiffness.toarray()[own, own], operators.mass.toarray()[own, own]
    return [float(np.sqrt(x) / (2.0 * np.pi)) for x in eigh(K, M, eigvals_only=True)[:3]]


@pytest.mark.parametrize("ratio", [0.1, 1.0, 5.0])
def test_exact_cantilever_with_a_tip_mass(ratio: float) -> None:
    """1 + cos B cosh B + µ B (cos B sinh B - sin B cosh B) = 0; Blevins, table 8-8."""
    thin = preset("paper").lamina[1]
    lamina_mass = thin.mass_per_length * thin.length
    case = preset("paper", {"point_mass": [{"lamina": "thin", "mass": ratio * lamina_mass}]})

    def equation(B: float) -> float:
        with_mass = np.cos(B) * np.sinh(B) - np.sin(B) * np.cosh(B)
        return float(1.0 + np.cos(B) * np.cosh(B) + ratio * B * with_mass)

    grid = np.linspace(0.3, 9.0, 400)
    values = [equation(B) for B in grid]
    roots = [
        brentq(equation, a, b)
        for a, b, f, g in zip(grid, grid[1:], values, values[1:], strict=False)
        if f * g < 0.0
    ][:3]
    speed = np.sqrt(thin.flexural_rigidity / thin.mass_per_length)
    exact = [B**2 / thin.length**2 * speed / (2.0 * np.pi) for B in roots]
    operators = assemble(case, needs_dolfinx=False).operators
    assert frequencies(operators, slice(40, 80)) == pytest.approx(exact, rel=2e-5)  # of 20 elements
    assert frequencies(operators, slice(0, 40))[0] == pytest.approx(3.1649, rel=1e-4)


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_the_judge_has_the_same_matrices(mass: str) -> None:
    case = preset("paper", {"point_mass": MASSES, "time.mass": mass})
    structure = assemble(case, needs_dolfinx=False)
    expected = matrices.assemble(case, structure.layout.x)
    assert max(operator_differences(structure.operators, expected).values()) < ROUND_OFF
    plain = matrices.assemble(preset("paper", {"time.mass": mass}), structure.layout.x)
    assert max(operator_differences(structure.operators, plain).values()) > 0.01


@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_the_judge_has_the_same_matrices_of_a_bonded_stack(mass: str) -> None:
    keys = {"lamina": "upper", "mass": 0.005}
    masses = [{**keys, "position": 0.2}, {**keys, "position": 0.033}]
    case = preset("embedded", {"point_mass": masses, "time.mass": mass})
    structure = assemble(case, needs_dolfinx=False)
    expected = matrices.assemble(case, structure.layout.x, structure.layout.probes[0].point)
    assert max(operator_differences(structure.operators, expected).values()) < 1e-6


def test_the_weak_forms_have_the_same_matrices() -> None:
    pytest.importorskip("dolfinx")
    from delam_fem.model.beams import forms

    case: Case = preset("paper", {"point_mass": MASSES, "mesh.elements": 7})
    operators, expected = (
        forms.assemble(case).operators,
        assemble(case, needs_dolfinx=False).operators,
    )
    assert max(operator_differences(operators, expected).values()) < ROUND_OFF

"""Properties of the laminae that vary along x."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from delam_fem.api import preset
from delam_fem.model.beams import forms

WEDGE_ROOT = 5.3151
"""ω L² sqrt(ρA0/EI0) of the wedge whose thickness falls linearly to a point: Kirchhoff 1879."""
FOUR_DIGITS = 1e-4


def test_constant_profiles_are_the_case_itself() -> None:
    case = preset("paper", {"mesh.elements": 4})
    structure = forms.assemble(
        case,
        flexural_rigidity=lambda i, x: np.full_like(x, (1.51, 0.16)[i]),
        mass_per_length=lambda i, x: case.lamina[i].mass_per_length,
    )
    expected = forms.assemble(case)
    for name in ("mass", "damping", "stiffness"):
        difference = getattr(structure.operators, name) - getattr(expected.operators, name)
        assert abs(difference).max() <= 1e-14 * abs(getattr(expected.operators, name)).max()


def test_frequency_of_a_wedge() -> None:
    case = preset("paper", {"mesh.elements": 40})
    L = case.lamina[0].length

    def thickness(x: np.ndarray) -> np.ndarray:
        return 1.0 - x / L

    model = forms.assemble(
        case,
        flexural_rigidity=lambda i, x: thickness(x) ** 3,
        mass_per_length=lambda i, x: thickness(x),
    )
    n = model.operators.n_dofs // 2
    K, M = (m[:n, :n].toarray() for m in (model.operators.stiffness, model.operators.mass))
    omega = np.sqrt(eigh(K, M, eigvals_only=True, subset_by_index=[0, 0])[0])
    assert omega * L**2 == pytest.approx(WEDGE_ROOT, rel=FOUR_DIGITS)


def test_a_softer_stretch_lowers_one_lamina_only() -> None:
    case = preset("paper", {"mesh.elements": 20})

    def damaged(i: int, x: np.ndarray) -> np.ndarray:
        inside = (x > 0.2) & (x < 0.4)
        return case.lamina[i].flexural_rigidity * np.where((i == 1) & inside, 0.5, 1.0)

    damaged_stiffness = forms.assemble(case, flexural_rigidity=damaged).operators.stiffness
    sound = forms.assemble(case).operators.stiffness
    n = sound.shape[0] // 2
    assert abs(damaged_stiffness - sound)[:n].max() == 0.0
    assert damaged_stiffness.diagonal()[n:].sum() < sound.diagonal()[n:].sum()

"""The reduced model: its flexibility is complete, its parts are found, what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from delam_fem.api import Operators, assemble, preset, reduce


def operators(**overrides: object) -> Operators:
    """Return the operators of the preset "default" with five elements."""
    keys = {"mesh.elements": 5, **{k.replace("__", "."): v for k, v in overrides.items()}}
    return assemble(preset("default", keys), needs_dolfinx=False).operators


@pytest.mark.parametrize("modes", [1, 3, 5])
def test_modes_and_the_rest_make_the_whole_static_flexibility(modes: int) -> None:
    o = operators()
    reduced = reduce(o, modes)
    H, K = o.gap_matrix.toarray(), o.stiffness.toarray()
    G = reduced.gap_modes
    flexibility = (G / reduced.squares) @ G.T + reduced.compliance.sum(axis=0)
    np.testing.assert_allclose(flexibility, H @ np.linalg.solve(K, H.T), rtol=1e-9)


def test_each_lamina_has_its_modes_and_its_creep() -> None:
    case = preset("default", {"mesh.elements": 5, "damping.rayleigh": "stiffness"})
    reduced = reduce(assemble(case, needs_dolfinx=False).operators, 3)
    for i, lamina in enumerate(case.lamina):
        alpha, beta = case.rayleigh(i)
        of_lamina = slice(3 * i, 3 * i + 3)
        omega = lamina.angular_frequencies(2)
        np.testing.assert_allclose(np.sqrt(reduced.squares[of_lamina][:2]), omega, rtol=2e-3)
        np.testing.assert_allclose(
            reduced.damping[of_lamina], alpha + beta * reduced.squares[of_lamina]
        )
        assert reduced.creep[i] == pytest.approx(beta, rel=1e-6)


def test_mass_damping_does_not_creep() -> None:
    assert reduce(operators(damping__rayleigh="mass"), 3).creep.tolist() == [0.0, 0.0]


def test_a_shift_of_the_base_moves_everything() -> None:
    reduced = reduce(operators(), 3)
    still = np.zeros((1, 6)), np.zeros((1, 2, 5))
    moved = reduced.displacement(*still, np.array([0.01]))
    np.testing.assert_allclose(moved[0, ::2], 0.01, rtol=1e-9)  # displacements
    np.testing.assert_allclose(moved[0, 1::2], 0.0, atol=1e-9)  # slopes
    np.testing.assert_allclose(reduced.gap_drive, 0.0, atol=1e-9)
    mass = sum(e.mass_per_length * e.length for e in preset("default").lamina)
    assert reduced.base_mass == pytest.approx(mass)


def test_a_bonded_structure_is_one_part() -> None:
    case = preset("embedded", {"mesh.elements": 20})
    reduced = reduce(assemble(case, needs_dolfinx=False).operators, 6)
    assert reduced.n_parts == 1
    assert reduced.n_modes == 6


def test_too_many_modes_for_the_contact_points_are_refused() -> None:
    with pytest.raises(ValueError, match="beyond the lowest 10"):
        reduce(operators(), 10)
    with pytest.raises(ValueError, match="at least 1"):
        reduce(operators(), 0)


def test_other_damping_is_refused() -> None:
    o = operators()
    C = o.damping.copy()
    C[0, 0] *= 2.0
    with pytest.raises(ValueError, match="alpha M"):
        reduce(replace(o, damping=C), 3)

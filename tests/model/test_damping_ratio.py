"""The damping ratio holds at the modes of the structure itself, whatever it is and carries."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

import delam_fem as df
from delam_fem.api import assemble, node_coordinates
from delam_fem.reference import matrices

D, L = 0.01, 0.5
LAMINA = {
    "name": "one", "length": L, "width": 0.02, "thickness": 0.002, "density": 7800.0,
    "young_modulus": 2.1e11, "damping_ratio": D,
}  # fmt: skip
BAR, POINT = LAMINA | {"motion": "axial"}, {"name": "one", "mass": 2.0, "stiffness": 800.0}
MASSES = [{"lamina": "one", "mass": 0.05}, {"lamina": "one", "mass": 0.02, "position": 0.2}]
HELD = {"start": "clamped", "end": "free"}


def case_of(lamina: dict[str, Any], rayleigh: str, **sections: Any) -> df.Case:
    return df.Case.model_validate(
        {
            "name": "damped", "lamina": [lamina], "damping": {"rayleigh": rayleigh},
            "excitation": {"kind": "harmonic", "amplitude": 1e-3, "frequency": 5.0},
            "mesh": {"elements": 40}, "contact": {"law": "none"},
        }
        | sections
    )  # fmt: skip


def ratios(case: df.Case) -> np.ndarray:
    """Return the damping ratios of the modes that are not rigid, by φᵀ C φ = 2 D ω φᵀ M φ."""
    o = assemble(case, needs_dolfinx=False).operators
    squares, shapes = eigh(o.stiffness.toarray(), o.mass.toarray())
    omega = np.sqrt(np.maximum(squares, 0.0))
    elastic = squares > 1e-12 * squares[-1]
    of_modes = np.einsum("ij,ij->j", shapes, o.damping @ shapes)
    return np.asarray((of_modes / (2.0 * np.where(elastic, omega, 1.0)))[elastic])


STRUCTURES = {
    "cantilever": (LAMINA, HELD),
    "clamped beam": (LAMINA, {"start": "clamped", "end": "clamped"}),
    "pinned beam": (LAMINA, {"start": "pinned", "end": "pinned"}),
    "free beam": (LAMINA, {"start": "free", "end": "free"}),
    "bar": (BAR, HELD),
    "bar held at its end": (BAR, {"start": "free", "end": "clamped"}),
    "clamped bar": (BAR, {"start": "clamped", "end": "clamped"}),
    "free bar": (BAR, {"start": "free", "end": "free"}),
}


@pytest.mark.parametrize("masses", [[], MASSES], ids=["bare", "with masses"])
@pytest.mark.parametrize(
    ("name", "rayleigh"),
    [
        (name, rayleigh)
        for name, (lamina, _) in STRUCTURES.items()
        for rayleigh in ("two-mode", "stiffness", "mass", "every mode")
        if rayleigh != "every mode" or lamina is BAR  # beams have no such damping
    ],
)
def test_the_modes_that_are_named_have_the_ratio(
    name: str, rayleigh: str, masses: list[dict[str, Any]]
) -> None:
    lamina, support = STRUCTURES[name]
    damping_ratios = ratios(case_of(lamina, rayleigh, support=support, point_mass=masses))
    n = {"two-mode": 2, "every mode": damping_ratios.size}.get(rayleigh, 1)
    # linear elements of a bar are too stiff by (π/n)²/24 in mode 1, four times that in mode 2
    np.testing.assert_allclose(damping_ratios[:n], D, rtol=2e-3)


def test_a_point_with_a_mass_has_the_ratio_at_its_own_frequency() -> None:
    point = POINT | {"damping_ratio": D}
    mass = [{"lamina": "one", "mass": 1.0}]
    case = case_of(point, "two-mode", mesh={"elements": 1}, point_mass=mass)
    np.testing.assert_allclose(ratios(case), D, rtol=1e-12)


def test_laminae_that_are_apart_have_the_modes_of_each_alone() -> None:
    """The paper's: α and β of each lamina from the exact cantilever, whatever its neighbour is."""
    case = df.preset("paper")
    o = assemble(case, needs_dolfinx=False).operators
    parts = assemble(case, needs_dolfinx=False).layout.parts
    for i, part in enumerate(parts):
        alpha, beta = case.rayleigh(i)
        omega = case.lamina[i].angular_frequencies(2)
        np.testing.assert_allclose(
            0.5 * alpha / omega + 0.5 * beta * omega, case.lamina[i].damping_ratio, rtol=1e-12
        )
        dofs = part.own_dofs
        C = alpha * o.mass[dofs][:, dofs] + beta * o.stiffness[dofs][:, dofs]
        assert abs(o.damping[dofs][:, dofs] - C).max() <= 1e-12 * abs(C).max()


@pytest.mark.parametrize("needs_dolfinx", [True, False])
def test_all_assemble_the_damping_of_a_lamina_with_a_mass_alike(needs_dolfinx: bool) -> None:
    case = df.preset("paper", {"point_mass": [{"lamina": "thin", "mass": 0.02, "position": 0.5}]})
    ours = assemble(case, needs_dolfinx=needs_dolfinx).operators
    theirs = matrices.assemble(case, node_coordinates(case))
    largest = abs(theirs.damping).max()
    assert abs(ours.damping - theirs.damping).max() <= 1e-7 * largest
    assert np.abs(ours.base.damping - theirs.base.damping).max() <= 1e-7 * largest

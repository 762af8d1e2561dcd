"""Laminae as solids beside exact beams: frequencies, orders of convergence, statics."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.sparse.linalg import spsolve
from split_beam import SplitBeam

from delam_fem.api import MPI, Case, Structure, lowest, preset
from delam_fem.model.layout import DISPLACEMENT
from delam_fem.model.solids.assembly import assemble
from delam_fem.model.solids.forms import Elasticity, Solid
from delam_fem.model.solids.meshing import lattice
from delam_fem.model.solids.unknowns import Unknowns, held

Array = npt.NDArray[np.float64]
THICK, THIN = 0, 1
"""The laminae of the preset "default": their lengths are 342 and 685 thicknesses."""


def plane(name: str, elements: int, **model: object) -> Case:
    """Return a preset in plane stress."""
    keys = {f"model.{key}": value for key, value in model.items()}
    return preset(name, {"model.kind": "plane-stress", "mesh.elements": elements, **keys})


def frequencies(structure: Structure, lamina: int, n: int) -> Array:
    """Return the lowest frequencies of a lamina that is apart [Hz]."""
    o, dofs = structure.operators, structure.layout.own_dofs(lamina)
    return lowest(o.stiffness[dofs][:, dofs], o.mass[dofs][:, dofs], n)[0]


def errors(case: Case, lamina: int, n: int) -> Array:
    """Return the relative differences to the exact cantilever."""
    exact = case.lamina[lamina].angular_frequencies(n) / (2.0 * np.pi)
    return np.asarray(frequencies(assemble(case), lamina, n) / exact - 1.0)


@pytest.mark.parametrize("lamina", [THICK, THIN])
def test_first_frequencies_of_slender_cantilevers(lamina: int) -> None:
    assert np.abs(errors(plane("default", 80), lamina, 2)).max() < 1e-3
    assert np.abs(errors(plane("default", 20, degree=3), lamina, 2)).max() < 1e-3


@pytest.mark.parametrize(("degree", "elements", "order"), [(2, (8, 16, 32), 2.0), (3, (3, 6), 4.0)])
def test_frequencies_converge_with_the_order_of_thin_elements(
    degree: int, elements: tuple[int, ...], order: float
) -> None:
    """Shear ties the rotation to the slope, so bending is one degree lower: order 2 (p - 1)."""
    deviations = [errors(plane("default", n, degree=degree), THICK, 2)[1] for n in elements]
    assert min(deviations) > 0.0
    rates = np.log2(np.array(deviations[:-1]) / np.array(deviations[1:]))
    assert np.all(np.abs(rates - order) < 0.35), rates


def test_degree_one_locks() -> None:
    """Full integration at degree 1: the reason why the key `degree` begins at 2."""
    case = plane("default", 20)
    mesh = lattice(case)
    solid = Solid.on(mesh, MPI.COMM_SELF, 1)
    modulus = np.array(
        [lamina.flexural_rigidity * 12.0 / lamina.thickness**3 for lamina in case.lamina]
    )
    rho = np.array([lamina.density * lamina.width for lamina in case.lamina])
    unknowns = Unknowns.of(solid, held(case, solid, modulus[mesh.lamina]))
    K = unknowns.restricted(
        solid.stiffness(modulus[mesh.lamina], Elasticity.isotropic(solid.mesh, 0.0))
    ).rows
    M = unknowns.restricted(solid.mass(rho[mesh.lamina])).rows
    is_thin = unknowns.parts == THIN
    frequency = lowest(K[is_thin][:, is_thin], M[is_thin][:, is_thin], 1)[0][0]
    exact = case.lamina[THIN].angular_frequencies(1)[0] / (2.0 * np.pi)
    assert frequency > 20.0 * exact


def test_layers_add_little() -> None:
    one, two = (errors(plane("default", 40, layers=n), THICK, 2) for n in (1, 2))
    np.testing.assert_allclose(one, two, atol=2e-5)


def split(case: Case) -> Array:
    """Return the five lowest exact frequencies of the split beam of a case [Hz]."""
    lower, upper = (
        (lamina.young_modulus, lamina.density, lamina.thickness) for lamina in case.lamina
    )
    delamination, ends = case.delamination[0], (case.support.start, case.support.end)
    width = case.lamina[0].width
    return SplitBeam(
        case.length, width, delamination.start, delamination.end, lower, upper, ends
    ).frequencies(5)


@pytest.mark.parametrize(
    "ends", [("clamped", "clamped"), ("clamped", "free"), ("pinned", "pinned")]
)
@pytest.mark.parametrize(("start", "end"), [(0.12, 0.28), (0.05, 0.2)])
def test_embedded_delaminations_have_the_frequencies_of_split_beams(
    ends: tuple[str, str], start: float, end: float
) -> None:
    keys = {
        "model.kind": "plane-stress", "mesh.elements": 80, "support.start": ends[0],
        "support.end": ends[1], "delamination.1.start": start, "delamination.1.end": end,
    }  # fmt: skip
    case = preset("embedded", keys)
    o = assemble(case).operators
    computed = lowest(o.stiffness, o.mass, 5)[0]
    np.testing.assert_allclose(computed, split(case), rtol=0.01)


@pytest.mark.nightly
def test_what_split_beams_leave_out_grows_with_the_thickness_of_the_halves() -> None:
    """The edges of a delamination give way, as if it were longer by about h/2 at both ends.

    The mode in which equal halves open has f ∝ 1/a², so its change is -4 χ h/a, χ about 0.4 to 0.7.
    """
    changes = []
    for h, elements in ((0.0005, 400), (0.001, 200)):
        keys = {
            "model.kind": "plane-stress", "mesh.elements": elements, "model.degree": 3,
            "lamina.lower.thickness": h, "lamina.upper.thickness": h,
        }  # fmt: skip
        case = preset("embedded", keys)
        o = assemble(case).operators
        computed, exact = lowest(o.stiffness, o.mass, 5)[0], split(case)
        changes.append(float((computed / exact - 1.0).min()))
    assert changes[1] / changes[0] == pytest.approx(2.0, rel=0.15)
    assert 0.4 < -changes[1] / (4.0 * 0.001 / 0.16) < 0.7


def test_a_bonded_stack_of_two_materials_pinned_at_both_ends() -> None:
    """f_k = (k π)²/(2 π L²) √(EI/ρA), EI about the neutral axis of the stack."""
    text = preset("embedded", {"support.start": "pinned", "support.end": "pinned"}).to_toml()
    text = text[: text.index("[[delamination]]")] + text[text.index("[mesh]") :]
    case = Case.from_toml(text)
    keys = {"kind": "plane-stress", "degree": 3}
    upper = case.lamina[1].model_copy(update={"young_modulus": 210e9, "density": 7800.0})
    model = case.model.model_copy(update=keys)
    case = case.model_copy(update={"lamina": (case.lamina[0], upper), "model": model})
    o = assemble(case).operators
    E, h, z = (70e9, 210e9), (0.0014, 0.0006), (0.0007, 0.0017)
    EA = [E[i] * 0.02 * h[i] for i in (0, 1)]
    axis = (EA[0] * z[0] + EA[1] * z[1]) / sum(EA)
    EI = sum(EA[i] * (h[i] ** 2 / 12.0 + (z[i] - axis) ** 2) for i in (0, 1))
    rhoA = 0.02 * (2700.0 * h[0] + 7800.0 * h[1])
    exact = (np.arange(1, 4) * np.pi / 0.4) ** 2 * np.sqrt(EI / rhoA) / (2.0 * np.pi)
    np.testing.assert_allclose(lowest(o.stiffness, o.mass, 3)[0], exact, rtol=1e-3)


def test_solids_without_poisson_agree_with_plane_stress_and_beams() -> None:
    case = preset("default", {"model.kind": "solid", "mesh.elements": 40})
    solid, flat = assemble(case), assemble(plane("default", 40))
    for lamina in (THICK, THIN):
        computed, expected = (frequencies(structure, lamina, 2) for structure in (solid, flat))
        np.testing.assert_allclose(computed, expected, rtol=1e-5)
        exact = case.lamina[lamina].angular_frequencies(2) / (2.0 * np.pi)
        np.testing.assert_allclose(computed, exact, rtol=1e-3)


def test_poissons_ratio_stiffens_a_clamped_sheet_a_little() -> None:
    """Between the beam and the plate in cylindrical bending, 1/√(1 - ν²) = 1.048."""
    rises = []
    for nu in (0.0, 0.3):
        keys = {"model.kind": "solid", "mesh.elements": 20, "model.poisson": nu}
        rises.append(frequencies(assemble(preset("default", keys)), THIN, 1)[0])
    assert 1.001 < rises[1] / rises[0] < 1.02
    flat = [frequencies(assemble(plane("default", 20, poisson=nu)), THIN, 1) for nu in (0.0, 0.3)]
    np.testing.assert_allclose(flat[1], flat[0], rtol=2e-3)  # plane stress: at the clamp alone


@pytest.mark.parametrize("kind", ["plane-stress", "solid"])
def test_the_tip_gives_way_as_of_a_beam_with_shear(kind: str) -> None:
    """u = F L³/(3 EI) + 6/5 F L/(G A), here with a lamina of 20 thicknesses."""
    keys = {"model.kind": kind, "mesh.elements": 40, "lamina.thin.thickness": 0.685 / 20.0}
    case = preset("default", keys | {"lamina.thin.bending_stiffness": 1000.0})
    structure = assemble(case)
    o, lamina = structure.operators, case.lamina[THIN]
    u = spsolve(o.stiffness.tocsc(), o.probes[THIN].toarray().ravel())
    read = structure.layout.read(u[None], np.zeros(1))[0]
    tip = read[structure.layout.parts[THIN].dofs[-1, DISPLACEMENT]]
    L, h, EI = lamina.length, lamina.thickness, lamina.flexural_rigidity
    G = 12.0 * EI / (lamina.width * h**3) / 2.0
    exact = L**3 / (3.0 * EI) + 1.2 * L / (G * lamina.width * h)
    assert tip == pytest.approx(exact, rel=1e-3)
    without = L**3 / (3.0 * EI)
    assert tip > without * 1.001

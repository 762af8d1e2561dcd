"""Solids of orthotropic layers: plates and beams beside exact ones, layers turned, what is refused.

Source of the plate: S. G. Lekhnitskii, "Anisotropic Plates" (1968), section 81; of shear in layered
beams: J. M. Whitney, "Structural Analysis of Laminated Anisotropic Plates" (1987), section 7.5.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from box_meshes import two_bricks
from plates import EDGES, LENGTH, RHO, plate

from delam_fem.api import MPI, Body, Case, CaseError, assemble, lowest
from delam_fem.model.solids.forms import Elasticity, Solid
from delam_fem.model.solids.unknowns import NodeColumns
from delam_fem.numerics.elasticity import compliance, stiffness, turned

Array = npt.NDArray[np.float64]

LAYER = {
    "E1": 140e9, "E2": 10e9, "E3": 10e9, "G12": 5e9, "G13": 5e9, "G23": 3.4e9, "nu12": 0.3,
    "nu13": 0.3, "nu23": 0.45,
}  # fmt: skip
S_LAYER = compliance((140e9, 10e9, 10e9), (5e9, 5e9, 3.4e9), (0.3, 0.3, 0.45))
ROUND_OFF = 1e-9


def sheet(**keys: object) -> dict[str, object]:
    """Return a lamina of the layer."""
    return {
        "name": "sheet", "length": LENGTH, "density": RHO, "damping_ratio": 0.01,
        "material": LAYER, **keys,
    }  # fmt: skip


def frequencies(case: Case, n: int) -> Array:
    """Return the lowest frequencies of a case [Hz]."""
    o = assemble(case).operators
    return lowest(o.stiffness, o.mass, n, is_floating=case.n_rigid > 0)[0]


@pytest.mark.slow
def test_a_simply_supported_plate_has_the_frequencies_of_lekhnitskii() -> None:
    width, h = 0.15, 0.001
    case = plate(
        dict.fromkeys(EDGES, "pinned"), 8, 6, width=width, degree=3,
        lamina=[sheet(width=width, thickness=h)],
    )  # fmt: skip
    Q11, Q22, Q12 = np.array([140e9, 10e9, 3e9]) / (1.0 - 0.3**2 * 10.0 / 140.0)
    m, n = np.meshgrid(np.arange(1, 6) / LENGTH, np.arange(1, 6) / width)
    D = h**3 / 12.0
    stiff = D * (Q11 * m**4 + 2.0 * (Q12 + 2.0 * 5e9) * m**2 * n**2 + Q22 * n**4)
    exact = np.sort(0.5 * np.pi * np.sqrt(stiff / (RHO * h)).ravel())[:4]
    computed = frequencies(case, 4)
    np.testing.assert_allclose(computed, exact, rtol=0.005)
    assert computed[0] < exact[0]  # shear, which thin plates do not know


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_turning_layers_with_the_edges_turns_the_plate(angle: float) -> None:
    edges = {"start": "clamped", "left": "pinned"}
    turned_edges = {"left": "clamped", "start": "pinned"}
    size = {"width": LENGTH, "thickness": 0.002}
    upright = plate(edges, 4, 4, lamina=[sheet(**size, angle=angle)])
    # x and z change places, which turns the fibres to 90 degrees less the angle
    other = plate(turned_edges, 4, 4, lamina=[sheet(**size, angle=90.0 - angle)])
    np.testing.assert_allclose(frequencies(upright, 4), frequencies(other, 4), rtol=1e-8)


def test_the_sign_of_an_angle_is_that_of_z() -> None:
    size = {"width": LENGTH, "thickness": 0.002}
    kinds = ({"start": "clamped", "left": "clamped"}, {"start": "clamped", "right": "clamped"})
    left, mirrored = (
        frequencies(plate(edges, 4, 4, lamina=[sheet(**size, angle=angle)]), 4)
        for edges, angle in zip(kinds, (35.0, -35.0), strict=True)
    )
    np.testing.assert_allclose(left, mirrored, rtol=1e-8)
    same = frequencies(plate(kinds[0], 4, 4, lamina=[sheet(**size, angle=-35.0)]), 4)
    assert abs(same[0] / left[0] - 1.0) > 0.01


def beam(plies: list[float], kind: str, end: str, width: float = 0.02) -> Case:
    """Return a strip of plies, 4 mm thick."""
    model = {"beam": {}, "plane-stress": {"degree": 3}, "solid": {"degree": 3, "strips": 2}}[kind]
    data: dict[str, object] = {
        "name": "strip",
        "lamina": [sheet(width=width, thickness=0.004, plies=plies)],
        "mesh": {"elements": 8},
        "model": {"kind": kind, **model},
        "support": {"start": "pinned" if end == "pinned" else "clamped", "end": end},
        "excitation": {"kind": "harmonic", "frequency": 100.0, "amplitude": 1e-5},
        "contact": {"law": "none"},
    }
    return Case.checked(data, "strip")


def shear_flexibility(plies: list[float], h: float, width: float) -> float:
    """Return γ over the shear force, from the energy of the shear that equilibrium asks for [1/N].

    τ b = Q/(EI) ∫ E y b dy from a surface, 1/(G A)_s = ∫ τ²/G b dy / Q² (Whitney, 7.5).
    """
    count = 400 * len(plies)
    t = h / count
    y = (np.arange(count) + 0.5) * t - 0.5 * h
    layers = [turned(S_LAYER, angle) for angle in plies]
    E = np.repeat([1.0 / S[0, 0] for S in layers], 400)
    G = np.repeat([1.0 / S[3, 3] for S in layers], 400)
    EI = width * t * float(E @ y**2)
    moment = width * (np.cumsum(E * y * t) - 0.5 * E * y * t)
    return float((moment**2 / G).sum() * t / width / EI**2)


CROSS_PLIES = ([0.0, 90.0, 90.0, 0.0], [90.0, 0.0, 0.0, 90.0])


def fall(EI: float, plies: list[float], width: float) -> float:
    """Return the share by which shear and rotary inertia lower the first frequency.

    ω falls by the factor (1 + (π/L)² (EI/(GA)_s + h²/12))^(-1/2): S. Timoshenko's beam, pinned.
    """
    sheared = EI * shear_flexibility(plies, 0.004, width)
    return float(1.0 - (1.0 + (np.pi / LENGTH) ** 2 * (sheared + 0.004**2 / 12.0)) ** -0.5)


def pinned(EI: float, case: Case) -> float:
    """Return the first frequency of a pinned beam [Hz]."""
    return float(0.5 * np.pi / LENGTH**2 * np.sqrt(EI / case.lamina[0].mass_per_length))


@pytest.mark.slow
@pytest.mark.parametrize("plies", CROSS_PLIES)
def test_a_cross_ply_beam_is_that_of_laminate_theory_less_shear(plies: list[float]) -> None:
    """Five times as wide as thick, plies keep one another from contracting, as in the theory."""
    case = beam(plies, "solid", "pinned")
    EI = case.lamina[0].flexural_rigidity
    lowering = fall(EI, plies, 0.02)
    assert lowering > 0.0015
    near = frequencies(case, 4) / pinned(EI, case) - 1.0
    assert near[np.abs(near).argmin()] == pytest.approx(-lowering, abs=7e-4)


@pytest.mark.parametrize("plies", CROSS_PLIES)
def test_plane_stress_leaves_each_ply_free_across(plies: list[float]) -> None:
    """EI is Σ E_x I, 0.4 % below that of laminate theory, whose plies hold one another."""
    case = beam(plies, "plane-stress", "pinned")
    y3 = np.diff((np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) * 1e-3) ** 3) / 3.0
    EI = 0.02 * float(y3 @ [1.0 / turned(S_LAYER, angle)[0, 0] for angle in plies])
    assert EI / case.lamina[0].flexural_rigidity == pytest.approx(0.99633, abs=1e-4)
    near = frequencies(case, 2)[0] / pinned(EI, case) - 1.0
    assert near == pytest.approx(-fall(EI, plies, 0.02), abs=1e-4)


@pytest.mark.slow
def test_two_plies_of_unlike_angles_bend_and_stretch() -> None:
    """A cantilever of [0, 90] has EI = b / d_11 of the laminate, less than half of b D_11."""
    case = beam([0.0, 90.0], "solid", "free")
    lamina = case.lamina[0]
    exact = 1.8751040687**2 / (2.0 * np.pi * LENGTH**2)
    exact *= np.sqrt(lamina.flexural_rigidity / lamina.mass_per_length)
    computed = frequencies(case, 4)
    assert np.abs(computed / exact - 1.0).min() < 0.006
    with pytest.raises(CaseError, match=r"lamina\.sheet\.plies: .* no coupling of bending"):
        beam([0.0, 90.0], "beam", "free")


def of_two_kinds(mesh: object) -> Elasticity:
    """Return another turned layer for each of two bricks."""
    layers = [turned(S_LAYER, angle) for angle in (25.0, -60.0)]
    matrices = np.array([stiffness(S, mesh.dim) * S[0, 0] for S in layers])  # type: ignore[attr-defined]
    return Elasticity(matrices, mesh.lamina)  # type: ignore[attr-defined]


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron", "tetrahedron"])
def test_the_stress_is_that_of_the_stiffness(cell: str) -> None:
    """Strain energy of a linear field, from the form and from recovered stresses."""
    counts = (2, 2) if cell == "quadrilateral" else (2, 2, 1)
    mesh = two_bricks(cell, counts, counts, gap=0.1)
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    E = np.array([2.0, 3.0])[mesh.lamina]
    n = mesh.dim * solid.n_nodes
    shape = Body(solid, None, np.zeros(n), E, of_two_kinds(mesh), np.ones(2)).shape()
    A = np.random.default_rng(2).normal(size=(mesh.dim, mesh.dim))
    u = np.empty((solid.n_nodes, mesh.dim))
    u[shape.node] = shape.points @ A.T
    matrix = solid.stiffness(E, shape.material)
    vector = matrix.createVecRight()
    vector.array = u.ravel()
    energy = 0.5 * vector.dot(matrix * vector)
    sigma = shape.recovery.stress(u)
    eps = A + A.T
    order = [(0, 1)] if mesh.dim == 2 else [(0, 1), (1, 2), (0, 2)]
    strains = np.array([*(0.5 * np.diag(eps)), *(eps[i, j] for i, j in order)])
    volume = np.ptp(mesh.points[:, 2]) if mesh.dim == 3 else 1.0  # 2 long, 0.5 high
    both = [0.5 * volume * float(sigma[shape.lamina == k][0] @ strains) for k in (0, 1)]
    assert energy == pytest.approx(sum(both), rel=ROUND_OFF)


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_columns_have_the_stiffness_of_the_solid(cell: str) -> None:
    counts = (2, 2) if cell == "quadrilateral" else (2, 2, 1)
    mesh = two_bricks(cell, counts, counts, gap=0.1)
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    columns = NodeColumns.of(solid, np.zeros(0, dtype=np.int64))
    E = np.array([2.0, 3.0])[mesh.lamina]
    T = columns.transformation(np.arange(solid.n_nodes)).toarray()
    dense = [  # arrays that PETSc shares last as long as their matrices
        matrix.convert("dense")
        for matrix in (
            solid.stiffness(E, of_two_kinds(mesh)), columns.stiffness(E, of_two_kinds(mesh))
        )
    ]  # fmt: skip
    K, K_d = (matrix.getDenseArray().copy() for matrix in dense)
    np.testing.assert_allclose(K, K.T, atol=1e-12 * np.abs(K).max())
    np.testing.assert_allclose(K_d, T.T @ K @ T, atol=1e-11 * np.abs(K).max())


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"material": "cfrp"}, r"lamina\.sheet\.material: expected one of .*cfrp-ud.*given 'cfrp'"),
        ({"material": {**LAYER, "nu12": 4.0}}, r"material\.nu12: .*sqrt\(E1/E2\) = 3\.742"),
        ({"material": {**LAYER, "nu13": 0.95, "nu23": 0.95, "nu12": 0.9}},
         r"material\.nu12: expected Poisson's ratios that together"),
        ({"material": {k: v for k, v in LAYER.items() if k != "G23"}}, r"material\.G23: missing"),
        ({"young_modulus": 1e9}, r"young_modulus: expected none beside an orthotropic material"),
        ({"angle": 10.0, "plies": [0.0]}, r"plies: expected angle or plies, not both"),
        ({"plies": []}, r"plies: expected 1 to 200 angles"),
        ({"material": "steel", "density": 7850.0, "angle": 1.0}, r"angle: expected only beside"),
        ({"material": "foam", "density": 90.0}, r"density: expected 100 kg/m3 of material = 'foam"),
    ],
)  # fmt: skip
def test_what_laminae_refuse(keys: dict[str, object], words: str) -> None:
    with pytest.raises(CaseError, match=words):
        plate({"start": "clamped"}, lamina=[sheet(width=LENGTH, thickness=0.002) | keys])


def test_beams_refuse_cores_that_shear() -> None:
    faces = {"material": "aluminium", "length": 0.2, "width": 0.02, "damping_ratio": 0.01}
    core = faces | {"name": "core", "thickness": 0.01, "material": "foam"}
    laminae = [
        {**faces, "name": "lower", "thickness": 0.001}, core,
        {**faces, "name": "upper", "thickness": 0.001},
    ]  # fmt: skip
    data = {
        "name": "sandwich", "lamina": laminae, "mesh": {"elements": 8},
        "delamination": [{"between": ["core", "upper"], "start": 0.05, "end": 0.1}],
        "excitation": {"kind": "harmonic", "frequency": 100.0, "amplitude": 1e-5},
        "contact": {"law": "newton"},
    }  # fmt: skip
    with pytest.raises(CaseError, match=r"lamina\.core\.material: .* beams, which know no shear"):
        Case.checked(data, "sandwich")
    assert Case.checked(data | {"model": {"kind": "plane-stress"}}, "sandwich")


def test_a_written_case_says_what_its_user_said() -> None:
    case = beam([0.0, 90.0, 90.0, 0.0], "beam", "free")
    again = Case.checked(case.model_dump(mode="json", exclude_none=True), "again")
    assert again.lamina == case.lamina
    assert {"young_modulus", "bending_stiffness"}.isdisjoint(case.lamina[0].model_dump())

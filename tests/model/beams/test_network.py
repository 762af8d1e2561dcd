"""Bonded stacks: unknowns, plane sections, and what a stack becomes in simple cases."""

from __future__ import annotations

import math

import numpy as np
import pytest

from delam_fem.api import Case, CaseError, Operators, Structure, lowest, network, preset
from delam_fem.model.beams import closed_form, forms
from delam_fem.model.beams.network import joined
from delam_fem.model.layout import BASE, DISPLACEMENT, FIXED
from delam_fem.model.linear import kept_closed

ROUND_OFF = 1e-11
"""Relative to the largest entry; assembled, transformed and condensed in another order."""

LAMINA = {"length": 0.4, "width": 0.02, "damping_ratio": 0.005}
THREE = [
    {"name": "a", "thickness": 0.001, "material": "steel", **LAMINA},
    {"name": "b", "thickness": 0.002, "material": "glass-epoxy", **LAMINA},
    {"name": "c", "thickness": 0.0005, "material": "aluminium", **LAMINA},
]
CROSSING = [
    {"between": ["a", "b"], "start": 0.1, "end": 0.25},
    {"between": ["b", "c"], "start": 0.2, "end": 0.4},
]
TOUCHING = [
    {"between": ["a", "b"], "start": 0.0, "end": 0.2},
    {"between": ["b", "c"], "start": 0.2, "end": 0.3},
]


def stack(delaminations: list[dict[str, object]], **overrides: object) -> Case:
    """Return a case of three materials with given delaminations."""
    data: dict[str, object] = {
        "lamina": THREE,
        "delamination": delaminations,
        "mesh.elements": 16,
        **{key.replace("__", "."): value for key, value in overrides.items()},
    }
    return preset("embedded", data)


def intact(**overrides: object) -> Case:
    """Return the stack of three materials without delaminations."""
    return stack([], **overrides)


def whole_section() -> tuple[float, float]:
    """Return EI about the neutral axis and ρA of the bonded stack, by integration over z."""
    E, rho, z = [], [], []
    bottom = 0.0
    for lamina, (modulus, density) in zip(
        THREE, [(210e9, 7850.0), (38.6e9, 1800.0), (70e9, 2700.0)], strict=True
    ):
        thickness = float(str(lamina["thickness"]))
        points = bottom + thickness * (np.arange(2000) + 0.5) / 2000
        z.append(points)
        E.append(np.full(2000, modulus * thickness / 2000))
        rho.append(density * thickness)
        bottom += thickness
    stiff, height = np.concatenate(E), np.concatenate(z)
    axis = stiff @ height / stiff.sum()
    return 0.02 * float(stiff @ (height - axis) ** 2), 0.02 * sum(rho)


def largest_difference(a: Operators, b: Operators) -> float:
    """Return the largest relative difference of matrices, base coupling and gap operator."""
    differences = []
    for name in ("mass", "damping", "stiffness"):
        A, B = getattr(a, name), getattr(b, name)
        differences.append(abs(A - B).max() / abs(A).max())
        u, v = getattr(a.base, name), getattr(b.base, name)
        scale = abs(A).max()
        differences.append(np.abs(u - v).max() / scale)
    differences.append(np.abs(a.lumped_mass - b.lumped_mass).max() / a.lumped_mass.max())
    differences += [np.abs((a.gap_matrix - b.gap_matrix).toarray()).max(initial=0.0)]
    differences += [np.abs(a.gap0 - b.gap0).max(initial=0.0)]
    corners = zip(a.base.corner, b.base.corner, strict=True)
    return max(*differences, *(abs(p - q) / max(abs(p), 1e-300) for p, q in corners))


def frequencies(structure: Structure, n: int = 4, *, closed: bool = False) -> np.ndarray:
    o = structure.operators
    S = kept_closed(structure.layout, o.n_dofs)
    K, M = (S.T @ m @ S if closed else m for m in (o.stiffness, o.mass))
    return lowest(K, M, n)[0]


def test_groups_join_where_any_side_is_bonded() -> None:
    assert joined([((0, 1), (2,), (3,)), ((0,), (1,), (2, 3))]) == ((0, 1), (2, 3))
    assert joined([((0, 1), (2,)), ((0,), (1, 2))]) == ((0, 1, 2),)
    assert joined([((0,), (1,))]) == ((0,), (1,))


def test_bonded_laminae_share_their_dofs() -> None:
    case = stack(CROSSING)
    structure = closed_form.assemble(case)
    a, b, c = (part.dofs for part in structure.layout.parts)
    x = structure.layout.x
    apart_below = np.flatnonzero(a[:, 0] != b[:, 0])
    apart_above = np.flatnonzero(b[:, 0] != c[:, 0])
    assert (x[apart_below] > 0.1 + 1e-9).all() and (x[apart_below] < 0.25 - 1e-9).all()
    assert (x[apart_above] > 0.2 + 1e-9).all()
    assert x[apart_above][-1] < 0.4  # both are clamped at the end
    assert a[0].tolist() == [BASE, FIXED]
    points = [interface.places.tolist() for interface in structure.layout.interfaces]
    assert points == [apart_below.tolist(), apart_above.tolist()]


@pytest.mark.parametrize("delaminations", [CROSSING, TOUCHING, CROSSING[:1], []])
@pytest.mark.parametrize("supports", ["clamped clamped", "clamped free", "pinned pinned"])
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_weak_forms_by_laminae_equal_closed_forms_by_groups(
    delaminations: list[dict[str, object]], supports: str, mass: str
) -> None:
    start, end = supports.split()
    case = stack(delaminations, support__start=start, support__end=end, time__mass=mass)
    a, b = closed_form.assemble(case), forms.assemble(case)
    assert largest_difference(a.operators, b.operators) < ROUND_OFF
    assert [part.dofs.tolist() for part in a.layout.parts] == [
        part.dofs.tolist() for part in b.layout.parts
    ]


@pytest.mark.parametrize(
    ("supports", "roots"),
    [
        ("clamped clamped", [4.730040744862704, 7.853204624095838]),
        ("clamped free", [1.8751040687119611, 4.694091132974175]),
        ("pinned pinned", [math.pi, 2.0 * math.pi]),
    ],
)
def test_an_intact_stack_of_three_materials_is_one_beam(supports: str, roots: list[float]) -> None:
    start, end = supports.split()
    case = intact(support__start=start, support__end=end, mesh__elements=40)
    EI, rhoA = whole_section()
    exact = np.array(roots) ** 2 / 0.4**2 * math.sqrt(EI / rhoA) / (2.0 * math.pi)
    for assemble in (closed_form.assemble, forms.assemble):
        deviations = frequencies(assemble(case), 2) / exact - 1.0
        assert np.abs(deviations) == pytest.approx([0.0, 0.0], abs=2e-6)
        assert abs(deviations[0]) < 1e-6


def test_stiffness_of_an_intact_stack_is_exact_to_round_off() -> None:
    case = intact(support__end="free")
    EI, _ = whole_section()
    for assemble in (closed_form.assemble, forms.assemble):
        o = assemble(case).operators
        load = np.zeros(o.n_dofs)
        load[-2] = 1.0  # a force at the tip
        deflection = np.linalg.solve(o.stiffness.toarray(), load)[-2]
        assert deflection == pytest.approx(0.4**3 / (3.0 * EI), rel=1e-6)
        assert deflection == pytest.approx(
            np.linalg.solve(closed_form.assemble(case).operators.stiffness.toarray(), load)[-2],
            rel=1e-10,
        )


def test_a_short_delamination_tends_to_the_intact_stack() -> None:
    n = 80
    intact_frequency = frequencies(closed_form.assemble(intact(mesh__elements=n)), 1)[0]
    changes = []
    for half in (0.02, 0.01, 0.005):
        gone = [{"between": ["a", "b"], "start": 0.1 - half, "end": 0.1 + half}]
        frequency = frequencies(closed_form.assemble(stack(gone, mesh__elements=n)), 1)[0]
        changes.append(1.0 - frequency / intact_frequency)
    assert all(change > 0.0 for change in changes)
    assert changes[2] < changes[1] / 3 < changes[0] / 9
    assert changes[2] < 1e-3


def test_a_rigid_motion_strains_nothing() -> None:
    case = stack(CROSSING, support__start="free", support__end="free")
    structure = closed_form.assemble(case)
    o = structure.operators
    for shift, turn in ((1.0, 0.0), (0.0, 1.0)):
        u = np.zeros(o.n_dofs)
        for part in structure.layout.parts:
            u[part.dofs[:, 0]], u[part.dofs[:, 1]] = shift + turn * part.x, turn
        assert np.abs(o.stiffness @ u).max() < 1e-9 * abs(o.stiffness).max()
        assert np.abs(o.gap_matrix @ u).max() < 1e-12
    mass = 0.4 * whole_section()[1]
    ones = np.zeros(o.n_dofs)
    for part in structure.layout.parts:
        ones[part.dofs[:, 0]] = 1.0
    assert ones @ o.mass @ ones == pytest.approx(mass, rel=1e-12)


def test_the_base_carries_the_whole_structure() -> None:
    o = closed_form.assemble(stack(CROSSING)).operators
    structure = closed_form.assemble(stack(CROSSING))
    u = np.zeros(o.n_dofs)
    for part in structure.layout.parts:
        free = part.dofs[:, DISPLACEMENT] >= 0
        u[part.dofs[free, DISPLACEMENT]] = 1.0
    force = o.stiffness @ u + o.base.stiffness
    assert np.abs(force).max() < 1e-9 * abs(o.stiffness).max()
    total = u @ o.mass @ u + 2.0 * u @ o.base.mass + o.base.corner[0]
    assert total == pytest.approx(0.4 * whole_section()[1], rel=1e-12)


def test_a_delamination_over_the_whole_length_is_the_paper_bit_for_bit() -> None:
    paper = preset("paper")
    layered = {
        "gap": None,
        "delamination": [
            {
                "between": ["thick", "thin"],
                "start": 0.0,
                "end": 0.685,
                "opening": 0.012,
                "shape": "power",
                "exponent": 2.0,
            }
        ],
    }
    case = preset("paper", layered)
    assert case.is_apart
    for assemble in (closed_form.assemble, forms.assemble):
        a, b = assemble(paper), assemble(case)
        for name in ("mass", "damping", "stiffness", "gap_matrix", "probes"):
            A, B = getattr(a.operators, name), getattr(b.operators, name)
            assert A.data.tobytes() == B.data.tobytes()
            assert A.indices.tobytes() == B.indices.tobytes()
        assert a.operators.gap0.tobytes() == b.operators.gap0.tobytes()
        assert a.layout.probes == b.layout.probes


def test_damping_has_its_ratio_at_the_modes_of_the_closed_structure() -> None:
    structure = closed_form.assemble(stack(CROSSING))
    o = structure.operators
    S = kept_closed(structure.layout, o.n_dofs)
    K, C, M = (S.T @ m @ S for m in (o.stiffness, o.damping, o.mass))
    lowest_frequencies, vectors = lowest(K, M, 2)
    for frequency, v in zip(lowest_frequencies, vectors.T, strict=True):
        ratio = (v @ C @ v) / (v @ M @ v) / (2.0 * 2.0 * math.pi * frequency)
        assert ratio == pytest.approx(0.005, rel=1e-6)


def test_a_structure_kept_closed_has_no_gap_anywhere() -> None:
    case = stack(CROSSING, contact__points_per_element=3)
    structure = closed_form.assemble(case)
    o = structure.operators
    S = kept_closed(structure.layout, o.n_dofs)
    assert o.n_pairs == 3 * 6 + 2 * 0 + 3 * 8 - 2  # 6 and 8 elements, no pair at bonded ends
    assert abs(o.gap_matrix @ S).max() < 1e-15


def test_nodes_are_at_every_edge_and_elements_keep_their_number() -> None:
    odd = {"delamination": [{"between": ["lower", "upper"], "start": 0.1234, "end": 0.2871}]}
    structure = closed_form.assemble(preset("embedded", odd))
    x = structure.layout.x
    assert x.size == 41
    assert np.abs(x[:, None] - [0.1234, 0.2871]).min(axis=0).max() == 0.0
    assert np.diff(x).max() / np.diff(x).min() < 1.1


def test_too_few_elements_are_told() -> None:
    with pytest.raises(CaseError, match=r"mesh.elements: "):
        closed_form.assemble(preset("embedded", {"mesh.elements": 5}))


def test_unknowns_run_node_by_node_and_from_the_bottom() -> None:
    case = preset("embedded", {"mesh.elements": 10})
    unknowns = network(case, np.linspace(0.0, 0.4, 11))
    assert unknowns.dofs[:, 3].tolist() == [[4, 5], [4, 5]]
    assert unknowns.dofs[:, 4].tolist() == [[6, 7], [8, 9]]
    assert (unknowns.n_free, unknowns.n_axial) == (2 * 9 + 2 * 3, 2)

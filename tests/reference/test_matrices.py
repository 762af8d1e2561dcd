"""The judge's matrices: tabulated numbers, rigid motions, exact frequencies, both assemblers."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from delam_fem.api import Case, InitialGap, Operators, initial_gap, preset
from delam_fem.model.beams import closed_form
from delam_fem.reference import matrices
from delam_fem.reference.compare import operator_differences

ROUND_OFF = 1e-13
"""Relative to the diagonal; the sums of integrals lose two of sixteen digits."""
H, EI, RHO_A, LENGTH = 0.37, 1.7, 0.23, 0.685
STIFFNESS = [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
MASS = [[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]
"""Przemieniecki, "Theory of Matrix Structural Analysis", ch. 5 and 11, for h = 1."""
GRADED = LENGTH * np.array([0.0, 0.05, 0.15, 0.4, 0.62, 1.0])
UNIFORM = np.linspace(0.0, LENGTH, 6)
WAVE_NUMBERS = [1.87510407, 4.69409113, 7.85475744]
"""Blevins, "Formulas for Natural Frequency and Mode Shape", table 8-1, clamped and free."""
SLOPES = np.array([1.0, H, 1.0, H])
KEYS: list[dict[str, object]] = [
    {},
    {"time.mass": "lumped"},
    {"damping.rayleigh": "stiffness", "gap.shape": "mode"},
    {"damping.rayleigh": "mass", "gap.exponent": 1.3},
    {"lamina.thin.bending_stiffness": None},
]


@pytest.fixture
def ops() -> Operators:
    return matrices.assemble(preset("paper"), GRADED)


def test_shape_functions_are_one_in_their_own_end_condition() -> None:
    for k, N in enumerate(matrices.shape_functions(H)):
        ends = [N(0.0), N.deriv()(0.0), N(H), N.deriv()(H)]
        assert ends == pytest.approx(np.eye(4)[k], abs=ROUND_OFF)
        assert N.degree() == 3


def test_element_matrices_are_the_tabulated_ones() -> None:
    tabulated = np.outer(SLOPES, SLOPES) * STIFFNESS
    K, M = matrices.element_stiffness(EI, H), matrices.element_mass(RHO_A, H)
    np.testing.assert_allclose(K, EI / H**3 * tabulated, rtol=10.0 * ROUND_OFF)
    tabulated = np.outer(SLOPES, SLOPES) * MASS
    np.testing.assert_allclose(M, RHO_A * H / 420.0 * tabulated, rtol=10.0 * ROUND_OFF)


def test_lumped_mass_is_the_scaled_diagonal() -> None:
    end = [RHO_A * H / 2.0, RHO_A * H**3 / 78.0]
    assert matrices.lumped_mass(RHO_A, H) == pytest.approx(end + end, rel=ROUND_OFF)


def test_matrices_are_symmetric(ops: Operators) -> None:
    for matrix in (ops.mass, ops.damping, ops.stiffness):
        assert abs(matrix - matrix.T).max() <= ROUND_OFF * matrix.max()


def test_moving_with_the_base_needs_no_force_and_has_all_the_mass(ops: Operators) -> None:
    translation = np.tile([1.0, 0.0], ops.n_dofs // 2)
    scale = ROUND_OFF * ops.stiffness.max()
    assert np.abs(ops.stiffness @ translation + ops.base.stiffness).max() < scale
    assert abs(ops.base.corner[2] + translation @ ops.base.stiffness) < scale
    total = translation @ (ops.mass @ translation + 2.0 * ops.base.mass) + ops.base.corner[0]
    expected = sum(LENGTH * lamina.mass_per_length for lamina in preset("paper").lamina)
    assert total == pytest.approx(expected, rel=ROUND_OFF)


def test_turning_about_the_clamp_needs_moments_at_the_clamp_alone(ops: Operators) -> None:
    rigid_turn = np.column_stack([GRADED[1:], np.ones(5)]).ravel()  # u = x, phi = 1
    force = ops.stiffness @ np.concatenate([rigid_turn, rigid_turn])
    near = [0, 1, 10, 11]  # the first node of each lamina, which the clamp holds
    assert np.abs(np.delete(force, near)).max() < ROUND_OFF * ops.stiffness.max()


def test_wave_numbers_are_the_tabulated_ones() -> None:
    assert matrices.wave_numbers(3) == pytest.approx(WAVE_NUMBERS, abs=5e-9)


def test_frequencies_are_those_of_the_cantilever() -> None:
    case = preset("paper")
    frequencies = matrices.natural_frequencies(
        matrices.assemble(case, np.linspace(0.0, LENGTH, 17)), len(WAVE_NUMBERS)
    )
    for lamina_frequencies, lamina in zip(frequencies, case.lamina, strict=True):
        rhoA, EI = matrices.section(lamina)
        exact = (np.array(WAVE_NUMBERS) / LENGTH) ** 2 * np.sqrt(EI / rhoA) / (2.0 * np.pi)
        assert np.all(
            lamina_frequencies > exact * (1.0 - 1e-8)
        )  # conforming elements are too stiff
        assert lamina_frequencies == pytest.approx(exact, rel=2e-4)
        assert lamina_frequencies[0] == pytest.approx(exact[0], rel=5e-7)


@pytest.mark.parametrize(
    ("kind", "modes"), [("two-mode", [0, 1]), ("stiffness", [0]), ("mass", [0])]
)
def test_damping_has_its_ratio_at_the_modes_of_the_model(kind: str, modes: list[int]) -> None:
    case = preset("paper", {"damping.rayleigh": kind, "lamina.thin.damping_ratio": 0.03})
    nodes = np.linspace(0.0, LENGTH, 17)
    ops = matrices.assemble(case, nodes)
    omega = 2.0 * np.pi * matrices.natural_frequencies(ops, 2)
    for i, lamina in enumerate(case.lamina):
        alpha, beta = matrices.rayleigh(case, lamina)
        ratios = 0.5 * (alpha / omega[i] + beta * omega[i])
        assert ratios[modes] == pytest.approx(lamina.damping_ratio, rel=1e-4)
        assert (alpha > 0.0, beta > 0.0) == (kind != "stiffness", kind != "mass")


def test_gap_opens_when_the_second_lamina_leaves(ops: Operators) -> None:
    q = np.zeros(ops.n_dofs)
    q[4], q[10 + 4], q[5] = 3.0, 10.0, 99.0  # third free node: u1, u2, phi1
    np.testing.assert_array_equal(ops.gap_matrix @ q, [0.0, 0.0, 7.0, 0.0, 0.0])
    np.testing.assert_array_equal(ops.probes @ np.arange(20), [8, 18])


def cases(folder: Path) -> Iterator[Case]:
    """Yield cases that differ in all that enters the operators."""
    yield from (preset("paper", keys) for keys in KEYS)
    table = folder / "gap.csv"
    table.write_text(
        "\ufeffx [m], gap [m]\n# measured\n0, 0\n0.2, 0.001 # soft\n0.4, 4e-3\n0.685, 0.012\n"
    )
    yield preset("paper", {"gap.file": str(table)})


@pytest.mark.parametrize("x", [UNIFORM, GRADED], ids=["uniform", "graded"])
def test_closed_form_is_the_same(x: np.ndarray, tmp_path: Path) -> None:
    for case in cases(tmp_path):
        operators = closed_form.assemble(case, x).operators
        differences = operator_differences(operators, matrices.assemble(case, x))
        assert max(differences.values()) < ROUND_OFF, differences
        assert abs(operators.probes - matrices.assemble(case, x).probes).max() == 0.0


@pytest.mark.parametrize("mesh", [{"mesh.elements": 7}, {"mesh.file": "graded"}])
def test_dolfinx_is_the_same(mesh: dict[str, object], tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    from delam_fem.model.beams import forms

    if "mesh.file" in mesh:
        mesh = {"mesh.file": str(Path(__file__).parents[2] / "meshes" / "laminae_graded.msh")}
    for case in cases(tmp_path):
        model = forms.assemble(case.with_overrides(mesh))
        differences = operator_differences(model.operators, matrices.assemble(case, model.layout.x))
        assert max(differences.values()) < ROUND_OFF, differences


def test_gap_of_a_table_keeps_its_shape(tmp_path: Path) -> None:
    *_, case = cases(tmp_path)
    x = np.linspace(0.0, LENGTH, 30)
    gap = matrices.gap_at_rest(case.gap, x, LENGTH)
    assert gap == pytest.approx(initial_gap(case.gap, x, LENGTH), abs=ROUND_OFF)
    assert np.all(np.diff(gap) > 0.0)


@pytest.mark.parametrize(
    "text",
    [
        "x;gap\n0;0,0005\n0,3;0,002\n0,685;0,001\n",
        "x gap\n0 0,0005\n0,3 0,002\n0,685 0,001\n",
        "# x [m], gap [m]\n0, 5e-4\n0.3, 0.002\n0.685, 1e-3 # tip\n",
    ],
)
def test_tables_of_any_separator(tmp_path: Path, text: str) -> None:
    (tmp_path / "gap.csv").write_text(text)
    gap, x = InitialGap(file=tmp_path / "gap.csv"), np.linspace(0.0, LENGTH, 30)
    expected = initial_gap(gap, x, LENGTH)
    assert expected[[0, -1]] == pytest.approx([0.0005, 0.001])
    assert matrices.gap_at_rest(gap, x, LENGTH) == pytest.approx(expected, abs=ROUND_OFF)


@pytest.mark.parametrize("shape", [{"exponent": 1.5}, {"shape": "mode"}])
def test_gap_at_the_root(shape: dict[str, object]) -> None:
    gap, x = InitialGap(tip=0.003, root=0.0005, **shape), np.linspace(0.0, LENGTH, 30)
    expected = initial_gap(gap, x, LENGTH)
    assert matrices.gap_at_rest(gap, x, LENGTH) == pytest.approx(expected, abs=ROUND_OFF)


@pytest.mark.parametrize("points", [1, 2, 3])
def test_several_points_of_an_element_share_its_spring(points: int) -> None:
    keys = {"contact.points_per_element": points, "contact.impulse": "consistent"}
    shares = matrices.assemble(preset("paper", keys), UNIFORM).pair_weights
    assert (shares is None) == (points == 1)
    assert points == 1 or (shares is not None and (shares < 1.0).any())

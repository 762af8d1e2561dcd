"""Functionals of sensors: strains of bent beams and bonded stacks, the equation of motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from delam_fem.case.files import preset
from delam_fem.model.beams import closed_form
from delam_fem.model.layout import Structure
from delam_fem.system.errors import CaseError

AT = {"lamina": "thin", "position": 0.3}
STRAIN = {"name": "e", "quantity": "strain"}


def static(structure: Structure, load: np.ndarray) -> np.ndarray:
    """Return the deflection under a load."""
    return np.asarray(splu(structure.operators.stiffness.tocsc()).solve(load))


@pytest.mark.parametrize(("surface", "sign"), [("top", -1.0), ("bottom", 1.0)])
@pytest.mark.parametrize("x", [0.0, 0.1, 0.3425, 0.685])
def test_strain_of_a_cantilever_under_a_tip_force(x: float, surface: str, sign: float) -> None:
    """w'' = F (L - x) / EI, and the top of a beam that bends upwards is compressed."""
    own = {**STRAIN, "lamina": "thin", "position": x, "surface": surface}
    case = preset("paper", {"sensor": [own]})
    structure = closed_form.assemble(case)
    part, thin = structure.layout.parts[1], case.lamina[1]
    load = np.zeros(structure.operators.n_dofs)
    load[part.dofs[-1, 0]] = 0.2
    exact = sign * 0.5 * thin.thickness * 0.2 * (0.685 - x) / thin.flexural_rigidity
    found = (structure.operators.sensors @ static(structure, load))[0]
    assert found == pytest.approx(exact, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("lamina", "surface", "z"), [("lower", "bottom", -1e-3), ("upper", "top", 1e-3)]
)
def test_strain_of_a_bonded_stack_is_that_of_one_thick_beam(
    lamina: str, surface: str, z: float
) -> None:
    """1.4 and 0.6 mm of one metal are a beam of 2 mm before the delamination: -z M / EI."""
    own = {**STRAIN, "lamina": lamina, "position": 0.1, "surface": surface}
    structure = closed_form.assemble(preset("edge", {"sensor": [own]}))
    load = np.zeros(structure.operators.n_dofs)
    for part in structure.layout.parts:  # where they are apart, each carries its share
        load[part.dofs[-1, 0]] += 0.1
    EI = 70e9 * 0.02 * 0.002**3 / 12.0
    found = (structure.operators.sensors @ static(structure, load))[0]
    assert found == pytest.approx(-z * 0.2 * (0.4 - 0.1) / EI, rel=1e-6)


def test_rigid_motion_has_no_strain() -> None:
    sensors = [{**STRAIN, "name": f"e{k}", **AT, "position": 0.02 * k} for k in range(3)]
    structure = closed_form.assemble(preset("paper", {"sensor": sensors}))
    part = structure.layout.parts[1]
    u = np.zeros(structure.operators.n_dofs)
    u[part.dofs[1:, 0]] = 0.01
    of_base = [sensor.of_base[0] for sensor in structure.layout.sensors]
    found = structure.operators.sensors @ u + 0.01 * np.array(of_base)
    assert np.abs(found).max() < 1e-15


def test_acceleration_is_that_of_the_equation_of_motion() -> None:
    own = {"name": "a", "quantity": "acceleration", **AT}
    structure = closed_form.assemble(preset("paper", {"sensor": [own]}))
    o, (sensor,) = structure.operators, structure.layout.sensors
    rng = np.random.default_rng(1)
    u, v = rng.normal(size=(2, o.n_dofs)) * 1e-6
    q, dq, ddq = 1e-6, -2e-3, 3.0
    p = rng.normal(size=o.n_pairs)
    rest = o.stiffness @ u + o.damping @ v - o.gap_matrix.T @ p
    rest += o.base.mass * ddq + o.base.damping * dq + o.base.stiffness * q
    a = splu(o.mass.tocsc()).solve(-rest)
    from delam_fem.model.layout import interpolation_rows, place_of

    part = structure.layout.parts[1]
    row = interpolation_rows(part, np.array([place_of(part, 0.3)]), o.n_dofs)
    expected = float((row @ a)[0])
    found = (o.sensors @ u)[sensor.of_u] + (o.sensors @ v)[sensor.of_v]
    found += np.array(sensor.of_base) @ [q, dq, ddq] + sensor.of_forces @ p
    assert found == pytest.approx(expected, rel=1e-8)


def test_impulses_act_through_the_matrix_of_the_law() -> None:
    own = {"name": "a", "quantity": "acceleration", "lamina": "thin", "position": 0.3425}
    structure = closed_form.assemble(preset("paper", {"sensor": [own]}))
    o, (sensor,) = structure.operators, structure.layout.sensors
    p = np.linspace(0.1, 2.0, o.n_pairs)
    dof = structure.layout.parts[1].dofs[10, 0]
    change = splu(o.mass.tocsc()).solve(o.gap_matrix.T @ p)
    assert sensor.of_forces @ p == pytest.approx(change[dof], rel=1e-8)
    lumped = (o.gap_matrix.T @ p) / o.lumped_mass
    assert sensor.of_lumped_impulses @ p == pytest.approx(lumped[dof], rel=1e-8)
    assert (sensor.unit, sensor.words) == ("m/s2", "acceleration of thin at 0.3425 m")


def test_probes_and_layout_do_not_change() -> None:
    own = {"name": "d", "quantity": "displacement", **AT}
    plain = closed_form.assemble(preset("paper"))
    found = closed_form.assemble(preset("paper", {"sensor": [own]}))
    assert (found.operators.probes != plain.operators.probes).nnz == 0
    assert found.layout.probes == plain.layout.probes
    assert found.operators.observed.shape[0] == 3


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"lamina": "top"}, r"sensor\.s\.lamina: expected one of thick, thin, given 'top'"),
        ({"position": 0.7}, r"sensor\.s\.position: expected at most the length 0\.685 m"),
        ({"position": None}, r"sensor\.s\.position: missing, but required"),
        ({"surface": "top"}, r"sensor\.s\.surface: expected only with quantity = .strain"),
        ({"quantity": "force"}, r"sensor\.s\.quantity: expected 'displacement'"),
        ({"between": ["thick", "thin"]}, r"sensor\.s\.between: expected none"),
        ({"sampling_rate": 1e6}, r"sensor\.s\.sampling_rate: expected at most 3250 Hz"),
    ],
)
def test_bad_sensor(keys: dict[str, object], expected: str) -> None:
    own = {"name": "s", "quantity": "velocity", **AT, **keys}
    with pytest.raises(CaseError, match=expected):
        preset("paper", {"sensor": [{k: v for k, v in own.items() if v is not None}]})


def test_contact_force_needs_neighbours() -> None:
    own = {"name": "f", "quantity": "contact force"}
    with pytest.raises(CaseError, match=r"sensor\.f\.between: missing"):
        preset("paper", {"sensor": [own]})
    with pytest.raises(CaseError, match=r"between: expected neighbours .* given \[.thin., .thick"):
        preset("paper", {"sensor": [{**own, "between": ["thin", "thick"]}]})


def test_seed_without_noise_is_not_read() -> None:
    own = {"name": "s", "quantity": "velocity", **AT, "seed": 3}
    assert preset("paper", {"sensor": [own]}).unread == ("sensor.s.seed",)
    assert preset("paper", {"sensor": [{**own, "noise": 0.1}]}).unread == ()

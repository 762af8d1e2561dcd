"""Functionals of sensors: strains of bent beams and bonded stacks, the equation of motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from delam_fem.api import CaseError, Structure, assemble, preset

AT = {"lamina": "thin", "position": 0.3}
STRAIN = {"name": "e", "quantity": "strain"}


def static(structure: Structure, load: np.ndarray) -> np.ndarray:
    """Return the deflection under a load."""
    return np.asarray(splu(structure.operators.stiffness.tocsc()).solve(load))


@pytest.mark.parametrize(("surface", "sign"), [("top", -1.0), ("bottom", 1.0)])
@pytest.mark.parametrize("x", [0.0, 0.1, 0.3425, 0.685])
def test_strain_of_a_cantilever_under_a_tip_force(x: float, surface: str, sign: float) -> None:
    """w'' = F (L - x) / EI, and the top of a beam that bends upwards is compressed."""
    sensor = {**STRAIN, "lamina": "thin", "position": x, "surface": surface}
    case = preset("paper", {"sensor": [sensor]})
    structure = assemble(case, needs_dolfinx=False)
    part, thin = structure.layout.parts[1], case.lamina[1]
    load = np.zeros(structure.operators.n_dofs)
    load[part.dofs[-1, 0]] = 0.2
    exact = sign * 0.5 * thin.thickness * 0.2 * (0.685 - x) / thin.flexural_rigidity
    strain = (structure.operators.sensors @ static(structure, load))[0]
    assert strain == pytest.approx(exact, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("lamina", "surface", "z"), [("lower", "bottom", -1e-3), ("upper", "top", 1e-3)]
)
def test_strain_of_a_bonded_stack_is_that_of_one_thick_beam(
    lamina: str, surface: str, z: float
) -> None:
    """1.4 and 0.6 mm of one metal are a beam of 2 mm before the delamination: -z M / EI."""
    sensor = {**STRAIN, "lamina": lamina, "position": 0.1, "surface": surface}
    structure = assemble(preset("edge", {"sensor": [sensor]}), needs_dolfinx=False)
    load = np.zeros(structure.operators.n_dofs)
    for part in structure.layout.parts:  # where they are apart, each carries its share
        load[part.dofs[-1, 0]] += 0.1
    EI = 70e9 * 0.02 * 0.002**3 / 12.0
    strain = (structure.operators.sensors @ static(structure, load))[0]
    assert strain == pytest.approx(-z * 0.2 * (0.4 - 0.1) / EI, rel=1e-6)


def test_rigid_motion_has_no_strain() -> None:
    sensors = [{**STRAIN, "name": f"e{k}", **AT, "position": 0.02 * k} for k in range(3)]
    structure = assemble(preset("paper", {"sensor": sensors}), needs_dolfinx=False)
    part = structure.layout.parts[1]
    u = np.zeros(structure.operators.n_dofs)
    u[part.dofs[1:, 0]] = 0.01
    of_base = [sensor.of_base[0] for sensor in structure.layout.sensors]
    strains = structure.operators.sensors @ u + 0.01 * np.array(of_base)
    assert np.abs(strains).max() < 1e-15


def test_probes_and_layout_do_not_change() -> None:
    sensor = {"name": "d", "quantity": "displacement", **AT}
    plain = assemble(preset("paper"), needs_dolfinx=False)
    structure = assemble(preset("paper", {"sensor": [sensor]}), needs_dolfinx=False)
    assert (structure.operators.probes != plain.operators.probes).nnz == 0
    assert structure.layout.probes == plain.layout.probes
    assert structure.operators.observed.shape[0] == 3


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"lamina": "top"}, r"sensor\.s\.lamina: .*given 'top'"),
        ({"position": 0.7}, r"sensor\.s\.position: "),
        ({"position": None}, r"sensor\.s\.position: missing, but required"),
        ({"surface": "top"}, r"sensor\.s\.surface: "),
        ({"quantity": "force"}, r"sensor\.s\.quantity: "),
        ({"between": ["thick", "thin"]}, r"sensor\.s\.between: "),
        ({"sampling_rate": 1e6}, r"sensor\.s\.sampling_rate: "),
    ],
)
def test_bad_sensor(keys: dict[str, object], expected: str) -> None:
    sensor = {"name": "s", "quantity": "velocity", **AT, **keys}
    with pytest.raises(CaseError, match=expected):
        preset("paper", {"sensor": [{k: v for k, v in sensor.items() if v is not None}]})


def test_contact_force_needs_neighbours() -> None:
    sensor = {"name": "f", "quantity": "contact force"}
    with pytest.raises(CaseError, match=r"sensor\.f\.between: missing"):
        preset("paper", {"sensor": [sensor]})
    with pytest.raises(CaseError, match=r"between: .*given \[.thin., .thick"):
        preset("paper", {"sensor": [{**sensor, "between": ["thin", "thick"]}]})


def test_seed_without_noise_is_not_read() -> None:
    sensor = {"name": "s", "quantity": "velocity", **AT, "seed": 3}
    assert preset("paper", {"sensor": [sensor]}).unread == ("sensor.s.seed",)
    assert preset("paper", {"sensor": [{**sensor, "noise": 0.1}]}).unread == ()

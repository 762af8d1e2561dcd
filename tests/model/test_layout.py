"""What does not fit together is told when a problem is put together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from delam_fem.api import Layout, Part, Structure, assemble, preset
from delam_fem.model.layout import BASE, FIXED, Interface, Probe

X = np.array([0.0, 0.1, 0.3])


@pytest.fixture(scope="module")
def structure() -> Structure:
    return assemble(preset("paper", {"mesh.elements": 3}), needs_dolfinx=False)


def part(name: str = "a", x: np.ndarray = X, **changed: np.ndarray) -> Part:
    n = x.size
    arrays: dict[str, np.ndarray] = {
        "dofs": np.arange(2 * n).reshape(n, 2),
        "flexural_rigidity": np.ones(n - 1),
        "mass_per_length": np.ones(n - 1),
    }
    return Part(name, x, **(arrays | changed))


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"x": np.array([0.0, 0.2, 0.2])}, "part a: x must increase over at least two points"),
        ({"x": np.array([0.0])}, "part a: x must increase over at least two points"),
        ({"flexural_rigidity": np.ones(4)}, r"flexural_rigidity has shape \(4,\), expected \(2,\)"),
        ({"mass_per_length": np.ones(3)}, r"mass_per_length has shape \(3,\), expected \(2,\)"),
        ({"dofs": np.arange(6)}, r"dofs has shape \(6,\), expected \(3, 2\)"),
    ],
)
def test_arrays_of_a_part_fit_its_points(changed: dict[str, np.ndarray], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        part(**changed)


def test_laminae_are_clamped_at_the_base_and_free_at_the_tip(structure: Structure) -> None:
    thick, thin = structure.layout.parts
    assert structure.layout.names == ("thick", "thin")
    assert thick.dofs.tolist() == [[BASE, FIXED], [0, 1], [2, 3], [4, 5]]
    assert thin.own_dofs.tolist() == [6, 7, 8, 9, 10, 11]
    (interface,) = structure.layout.interfaces
    assert interface.name == "thick-thin"
    assert interface.places.tolist() == [1, 2, 3]
    assert [(probe.name, probe.part, probe.point) for probe in structure.layout.probes] == [
        ("tip", 0, 3),
        ("tip", 1, 3),
    ]


def test_a_layout_fits_its_operators(structure: Structure) -> None:
    fewer = assemble(preset("paper", {"mesh.elements": 2}), needs_dolfinx=False).operators
    with pytest.raises(ValueError, match="dof 11, expected below 8"):
        replace(structure, operators=fewer)
    without = replace(structure.layout, interfaces=())
    with pytest.raises(ValueError, match="0 pairs, the operators have 3"):
        replace(structure, layout=without)
    probed = replace(structure.layout, probes=(Probe("tip", 0, 3),))
    with pytest.raises(ValueError, match="1 probes, the operators have 2"):
        replace(structure, layout=probed)


def test_parts_with_points_of_their_own_have_no_common_x() -> None:
    layout = Layout((part("a"), part("b", x=np.array([0.0, 0.2, 0.3]))), ())
    with pytest.raises(ValueError, match="expected the same points"):
        _ = layout.x


def test_values_of_pairs_stand_at_their_points() -> None:
    delaminated = Interface("a-b", (0, 1), np.array([1.0]), first_pair=2)
    layout = Layout((part("a"), part("b")), (delaminated,))
    spread = layout.at_stations(delaminated, np.array([[5, 6, 7], [8, 9, 10]], dtype=np.int8))
    assert spread.tolist() == [[0, 7, 0], [0, 10, 0]]
    assert spread.dtype == np.int8


def test_pairs_of_one_station_are_combined() -> None:
    """Pairs across a width: the largest of their states, the sum of their impulses."""
    across = Interface("a-b", (0, 1), np.array([1.0, 1.0, 2.0]))
    layout = Layout((part("a"), part("b")), (across,))
    states = layout.at_stations(across, np.array([[2, 1, 0], [0, 1, 3]], dtype=np.int8))
    assert states.tolist() == [[0, 2, 0], [0, 1, 3]]
    assert layout.at_stations(across, np.array([2.0, 1.0, 0.5])).tolist() == [0.0, 3.0, 0.5]


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("lumped_mass", np.ones(11), r"lumped_mass has shape \(11,\), expected \(12,\)"),
        ("gap0", np.ones(2), r"gap_matrix has shape \(3, 12\), expected \(2, 12\)"),
        ("pair_weights", np.ones(4), r"pair_weights has shape \(4,\), expected \(3,\)"),
        ("probes", sp.csr_matrix((1, 11)), r"probes has shape \(1, 11\), expected \(1, 12\)"),
    ],
)
def test_operators_fit_together(structure: Structure, name: str, value: object, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        replace(structure.operators, **{name: value})


def test_operators_without_probes_record_nothing(structure: Structure) -> None:
    assert replace(structure.operators, probes=None).probes.shape == (0, 12)


def test_a_missing_lumped_mass_is_told(structure: Structure) -> None:
    with pytest.raises(ValueError, match='impulse = "lumped" acts on it'):
        replace(structure.operators, lumped_mass=None).require_lumped_mass()

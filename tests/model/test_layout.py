"""What does not fit together is told when a problem is put together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delam_fem.case.files import preset
from delam_fem.model import closed_form
from delam_fem.model.layout import Model


@pytest.fixture(scope="module")
def model() -> Model:
    return closed_form.assemble(preset("paper", {"mesh.elements": 3}))


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"x": np.array([0.0, 0.2, 0.2, 0.6])}, "x must increase over at least two nodes"),
        ({"x": np.array([0.0])}, "x must increase over at least two nodes"),
        ({"flexural_rigidity": np.ones((2, 4))}, r"flexural_rigidity has shape \(2, 4\)"),
        ({"mass_per_length": np.ones(3)}, r"mass_per_length has shape \(3,\), expected \(2, 3\)"),
    ],
)
def test_arrays_of_a_model_fit_its_nodes(
    model: Model, changed: dict[str, np.ndarray], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        replace(model, **changed)


def test_dofs_of_a_model_fit_its_nodes(model: Model) -> None:
    fewer = closed_form.assemble(preset("paper", {"mesh.elements": 2})).operators
    with pytest.raises(ValueError, match="8 dofs, expected 12 for 3 elements"):
        replace(model, operators=fewer)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("lumped_mass", np.ones(11), r"lumped_mass has shape \(11,\), expected \(12,\)"),
        ("gap0", np.ones(2), r"gap_matrix has shape \(3, 12\), expected \(2, 12\)"),
        ("observed", np.array([0, 12]), r"observed dofs must lie in 0\.\.11"),
        ("observed", np.array([-1]), r"observed dofs must lie in 0\.\.11"),
    ],
)
def test_operators_fit_together(model: Model, name: str, value: np.ndarray, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        replace(model.operators, **{name: value})

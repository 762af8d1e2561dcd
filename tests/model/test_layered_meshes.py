"""Bonded stacks on meshes from files."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from delam_fem.api import CaseError, preset
from delam_fem.model.beams import closed_form, forms

X = np.array([0.0, 0.05, 0.12, 0.15, 0.21, 0.28, 0.33, 0.4])


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    """Return a mesh of two graded laminae, side by side."""
    n = X.size
    points = np.concatenate([np.column_stack([X, y * np.ones(n), np.zeros(n)]) for y in (0, 1)])
    line = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    tags = np.repeat([1, 2], n - 1)
    groups = {"lower": np.array([1, 1]), "upper": np.array([2, 1])}
    path = tmp_path / "stack.msh"
    meshio.Mesh(
        points,
        [("line", np.vstack([line, line + n]))],
        cell_data={"gmsh:physical": [tags], "gmsh:geometrical": [tags]},
        field_data=groups,
    ).write(path, file_format="gmsh22")
    return path


def test_nodes_come_from_the_file(mesh: Path) -> None:
    structure = forms.assemble(preset("embedded", {"mesh.file": str(mesh)}))
    assert structure.layout.x.tolist() == X.tolist()
    assert structure.layout.interfaces[0].places.tolist() == [3, 4]
    for more in ((), (X,)):
        same = closed_form.assemble(preset("embedded", {"mesh.file": str(mesh)}), *more)
        difference = abs(structure.operators.stiffness - same.operators.stiffness).max()
        assert difference < 1e-11 * abs(same.operators.stiffness).max()


def test_an_edge_between_nodes_is_told(mesh: Path) -> None:
    case = preset("embedded", {"mesh.file": str(mesh), "delamination.1.end": 0.3})
    with pytest.raises(CaseError, match=r"expected a node at the edge x = 0.3 m of a delamination"):
        forms.assemble(case)

"""Cells divided between their nodes: all of the cell, nothing twice, no cell inside out."""

import numpy as np
import pytest
import pyvista as pv

from delam_fem.model._dolfinx import reference_nodes
from delam_fem.results.fields.vtkhdf import CELL_TYPES, subcells

VOLUME = {"triangle": 1 / 2, "quadrilateral": 1.0, "tetrahedron": 1 / 6, "hexahedron": 1.0}


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("cell", VOLUME)
def test_the_parts_of_a_cell_fill_it(cell: str, degree: int) -> None:
    """VTK's own integrals of the volumes; its sign would be negative for a wrong order."""
    nodes = reference_nodes(cell, degree)
    cells = subcells(cell, degree, nodes)
    assert cells.shape == (degree ** nodes.shape[1], len(reference_nodes(cell, 1)))
    points = np.zeros((len(nodes), 3))
    points[:, : nodes.shape[1]] = nodes
    grid = pv.UnstructuredGrid({CELL_TYPES[cell]: cells}, points)
    sizes = grid.compute_cell_sizes()["Area" if nodes.shape[1] == 2 else "Volume"]
    assert sizes.min() > 0.01 * VOLUME[cell]
    assert sizes.sum() == pytest.approx(VOLUME[cell], rel=1e-12)
    if nodes.shape[1] == 2:  # VTK does not sign areas
        first, second, last = (points[cells[:, k]] for k in (0, 1, -1))
        assert np.cross(second - first, last - first)[:, 2].min() > 0.0
    assert np.unique(cells).size == len(nodes)

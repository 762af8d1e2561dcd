"""Solids on meshes of one's own are refined and judged as those that are built in."""

import math
import re
from pathlib import Path

import meshio
import numpy as np
import pytest

import delam_fem as df
from delam_fem.api import Case, CaseError
from delam_fem.model.solids.meshing import lattice
from delam_fem.studies.convergence.analysis import Convergence, verdict
from delam_fem.studies.convergence.level import compute
from delam_fem.studies.convergence.refinement import FREE, RefinementStudy, method

FILE_ORDER = {2: [0, 1], 4: [0, 1, 3, 2], 8: [0, 1, 3, 2, 4, 5, 7, 6]}
"""Vertices of facets and cells in the order of gmsh."""
TYPES = {"quadrilateral": ("quad", "line"), "hexahedron": ("hexahedron", "quad")}


def written(case: Case, path: Path) -> Path:
    """Write the built-in mesh of a case with the groups that a file must have."""
    mesh = lattice(case)
    cell, facet = TYPES[mesh.cell]
    groups = {lamina.name: mesh.cells[mesh.lamina == i] for i, lamina in enumerate(case.lamina)}
    groups |= {**mesh.supports, "thick-thin lower": mesh.sides[0].lower}
    groups["thick-thin upper"] = mesh.sides[0].upper
    kinds = [cell] * 2 + [facet] * (len(groups) - 2)
    blocks = [
        (kind, members[:, FILE_ORDER[members.shape[1]]])
        for kind, members in zip(kinds, groups.values(), strict=True)
    ]
    number = [np.full(len(members), k + 1) for k, (_, members) in enumerate(blocks)]
    meshio.Mesh(
        np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim))),
        blocks,
        cell_data={"gmsh:physical": number, "gmsh:geometrical": number},
        field_data={name: np.array([k + 1, mesh.dim - (k > 1)]) for k, name in enumerate(groups)},
    ).write(path, file_format="gmsh22", binary=False)
    return path


SIZES, LAW = (2, 4, 8), method("newton@moreau-jean")


def files(case: Case, folder: Path) -> tuple[Path, ...]:
    """Write the built-in meshes of a case with the numbers of elements of the study."""
    return tuple(
        written(case.with_overrides({"mesh.elements": n}), folder / f"{n}.msh") for n in SIZES
    )


@pytest.mark.parametrize("kind", ["plane-stress", "solid"])
def test_size_of_a_mesh_of_ones_own_is_its_cells_along_the_laminae(
    kind: str, tmp_path: Path
) -> None:
    case = df.preset("default", {"model.kind": kind, "mesh.elements": 2})
    refinement = RefinementStudy(case, (LAW,), files(case, tmp_path), (100,), 2, 0)
    assert [level.elements for level in refinement.along_meshes(LAW, 100)] == list(SIZES)
    with pytest.raises(CaseError, match="elements: "):
        RefinementStudy(case, (LAW,), refinement.meshes[::-1], (100,), 2, 0)


@pytest.mark.slow
def test_meshes_of_ones_own_are_judged_as_those_that_are_built_in(tmp_path: Path) -> None:
    case = df.preset("default", {"model.kind": "plane-stress", "mesh.elements": 2})
    errors = []
    for meshes in (SIZES, files(case, tmp_path)):
        refinement = RefinementStudy(case, (LAW,), meshes, (100,), 2, 0)
        free, line = (refinement.along_meshes(law, 100) for law in (FREE, LAW))
        convergence = Convergence(
            refinement, {level.key: compute(level, "compiled") for level in (*free, *line)}
        )
        assert all(math.isfinite(part) for part in convergence.interval(line[0], line, "elements"))
        assert re.search("[248] elements, 100 steps per period", verdict(convergence))
        errors.append([convergence.free_errors(level) for level in free])
    np.testing.assert_allclose(*errors, rtol=1e-6, atol=1e-9)
    # cells that are too long are too stiff by as much in both laminae, each beside its own
    # frequency; the finest is compared with itself, in space
    coarse, _, finest = errors[0]
    assert coarse[0] == pytest.approx(coarse[2], rel=0.1) and 0.01 < coarse[0] < 0.1
    assert abs(finest[[0, 2]]).max() < 0.1 * coarse[0]

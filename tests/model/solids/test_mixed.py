"""Geometry, forms and surfaces of crooked cells of every kind, in full."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import golden
import numpy as np
import pytest
from bricks import MESHES, case_of, two_bricks

from delam_fem.case.definition import Case
from delam_fem.case.files import preset
from delam_fem.model.layout import Part
from delam_fem.model.solids import forms, meshing
from delam_fem.model.solids import mesh as meshes
from delam_fem.model.solids.assembly import assemble
from delam_fem.model.solids.facing import (
    at_middles,
    at_places,
    at_vertices,
    corner_shares,
    gap_rows,
    interface,
    pressure,
    project,
)
from delam_fem.model.solids.forms import Solid, evaluate, sampled, von_mises
from delam_fem.model.solids.mesh import FACET_OF, FACETS, SolidMesh
from delam_fem.model.solids.unknowns import Columns, elasticity, neutral_axis
from delam_fem.system.errors import CaseError
from delam_fem.system.mpi import MPI

Check = Callable[..., None]
COUNTS = {
    "triangle": ((3, 2), (4, 1)), "quadrilateral": ((3, 2), (4, 1)),
    "tetrahedron": ((2, 2, 1), (3, 1, 2)), "hexahedron": ((2, 2, 1), (3, 1, 2)),
}  # fmt: skip


def waves(*shape: int) -> np.ndarray:
    """Return numbers without a pattern."""
    return np.cos(np.arange(np.prod(shape)) ** 1.3 + 0.2).reshape(shape)


def crooked(cell: str) -> SolidMesh:
    """Return two boxes, one upon the other with a gap, all cells of which are bent."""
    plain = two_bricks(cell, *COUNTS[cell], gap=0.07, ends=(0.1, 1.9))
    x, y = plain.points[:, 0], plain.points[:, 1]
    z = plain.points[:, 2] if plain.dim == 3 else 0.0 * x
    bent = [x + 0.05 * np.sin(2.0 * y + z), y + 0.04 * x**2 - 0.03 * x * z + 0.02 * np.cos(5.0 * x)]
    if plain.dim == 3:
        bent.append(z + 0.06 * np.sin(x + y))
    points = np.column_stack(bent)
    return SolidMesh(points, plain.cells, cell, plain.lamina, plain.supports, plain.sides)


def inner(mesh: SolidMesh) -> tuple[np.ndarray, np.ndarray]:
    """Return a point in each cell, and reference coordinates of it."""
    X = 0.2 + 0.1 * (1.0 + waves(len(mesh.cells), mesh.dim)) / mesh.dim
    N, _ = meshes.shape_functions(mesh.cell, X)
    return np.einsum("kv,kvi->ki", N, mesh.points[mesh.cells]), X


@pytest.mark.parametrize("cell", COUNTS)
def test_cells_are_the_stored_ones(cell: str, stored: Check) -> None:
    mesh = crooked(cell)
    points, X = inner(mesh)
    corners = mesh.points[mesh.cells]
    facets = np.concatenate([mesh.cells[1:2, list(own)] for own in FACETS[cell]])
    (sides,) = mesh.sides
    found: dict[str, Any] = {
        "points": mesh.points, "cells": mesh.cells, "bodies": mesh.bodies, "dim": mesh.dim,
        "volumes": meshes.volumes(mesh), "functions": list(meshes.shape_functions(cell, X)),
        "X": meshes.reference_coordinates(cell, corners, points),
        "outside": meshes.reference_coordinates(cell, corners, points + 0.3),
        "jacobians": meshes.jacobians_of(cell, corners, X),
        "overshoot": [meshes.overshoot(cell, X), meshes.overshoot(cell, 1.4 * X - 0.2)],
        "located": [meshes.locate(mesh, points, mesh.lamina),
                    meshes.locate(mesh, mesh.points[mesh.cells[:, 1]], mesh.lamina)],
        "of facets": list(mesh.cells_with(sides.lower)),
        "upper": list(mesh.cells_with(sides.upper[:, ::-1])),
        "shares": list(corner_shares(mesh, sides.lower, mesh.cells_with(sides.lower)[0])),
    }  # fmt: skip
    lines = [golden.of_object(found)]
    for asked in (facets, np.full_like(sides.lower[:1], 0)):
        try:
            lines.append(str(mesh.cells_with(asked)))
        except ValueError as error:
            lines.append(str(error))
    try:
        meshes.locate(mesh, points + 3.0, 0)
    except ValueError as error:
        lines.append(str(error))
    up = np.zeros((len(points), mesh.dim))
    up[:, 1] = 1.0
    tilted = up + 0.2 * waves(*up.shape)
    tilted /= np.linalg.norm(tilted, axis=1)[:, None]
    for name, way in (("parallel", up), ("tilted", tilted)):
        for side in (sides.lower, sides.upper):
            hits = meshes.meetings(mesh.points[side], points, way, FACET_OF[cell])
            lines.append(golden.of_object(hits, name))
    stored("\n".join(lines))


@pytest.mark.parametrize("cell", COUNTS)
def test_surfaces_are_the_stored_ones(cell: str, stored: Check) -> None:
    mesh = crooked(cell)
    (sides,) = mesh.sides
    z = np.array([-0.2, 0.05, 0.3]) if mesh.dim == 3 else None
    x = np.array([0.25, 0.6, 1.1, 1.62])
    ways = {
        "vertices": at_vertices(mesh, sides), "middles": at_middles(mesh, sides),
        "places": at_places(mesh, sides, x, z),
    }  # fmt: skip
    places = _reference(cell)
    solid = Solid.on(mesh, MPI.COMM_SELF, 2)
    lines = []
    for name, points in ways.items():
        pairs = project(mesh, sides, points)
        lines += [golden.of_object(points, name), golden.of_object(pairs, f"{name} pairs")]
        rows = gap_rows(solid, pairs)
        told = {"x": pairs.x, "weights": pairs.weights, "rates": rows @ waves(rows.shape[1])}
        told["some"] = pairs.chosen(np.arange(len(pairs.gap)) % 2 == 0).gap
        for side, at in ((sides.lower, pairs.lower.x), (sides.upper, pairs.upper)):
            n = int(mesh.cells.max()) + 1
            told[f"pressure {len(side)}"] = pressure(
                mesh, side, at, pairs.lower.normals, 0.7, places=places, cells=mesh.cells, n=n
            )
        lines.append(golden.of_object(told, name))
    with pytest.raises(ValueError, match="lower side above") as raised:
        at_places(mesh, sides, np.array([0.3, 7.0]), z)
    stored("\n".join([*lines, str(raised.value)]))


def _reference(cell: str) -> np.ndarray:
    """Return the vertices of the reference cell."""
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    if cell in ("triangle", "tetrahedron"):
        return np.vstack([np.zeros(dim), np.eye(dim)])
    return ((np.arange(2**dim)[:, None] >> np.arange(dim)) & 1).astype(np.float64)


@pytest.mark.parametrize("cell", COUNTS)
def test_forms_are_the_stored_ones(cell: str, stored: Check) -> None:
    mesh, degree = crooked(cell), 3 if cell == "quadrilateral" else 2
    points, _ = inner(mesh)
    solid = Solid.on(mesh, MPI.COMM_SELF, degree)
    rho, E = 2.0 + waves(len(mesh.cells)), 3.0 + waves(len(mesh.cells))
    cells = np.arange(len(mesh.cells))
    found = evaluate(solid, points, cells)
    (sides,) = mesh.sides
    u = np.column_stack([waves(solid.n_nodes), *waves(mesh.dim - 1, solid.n_nodes) ** 2])
    told: dict[str, Any] = {
        "n": [solid.dim, solid.n_nodes, solid.n_own_nodes, solid.first_node, solid.n_own_cells],
        "nodes": solid.nodes_of(cells), "coordinates": solid.coordinates,
        "on": solid.nodes_on(sides.lower), "local": solid.local_nodes,
        "values": found.values, "gradients": found.gradients,
        "derivative": found.derivative(1, 0) @ u.ravel(),
        "deflection": found.displacement(1) @ u.ravel(),
        "along": found.along(waves(len(points), mesh.dim)) @ u.ravel(),
    }  # fmt: skip
    for name, make in (
        ("mass", lambda: solid.mass(rho)), ("stiffness", lambda: solid.stiffness(E, 0.23)),
        ("columns", lambda: Columns.none(solid).stiffness(E, 0.23)),
    ):  # fmt: skip
        matrix = make()
        x, y = matrix.createVecs()
        x.array = u.ravel()
        matrix.mult(x, y)
        told[name] = y.array.copy()
        matrix.destroy()
    recovery = forms.Recovery.of(
        mesh, degree, solid.nodes_of(cells), solid.nodes_of(cells), E, 0.23
    )
    sigma = recovery.stress(u)
    told |= {"stress": sigma, "mises": von_mises(sigma)}
    told |= {"sampled": list(sampled(cell, degree, _reference(cell)))}
    told |= {"axis": neutral_axis(mesh, sides.lower, E), "D": elasticity(mesh.dim, 0.23)}
    stored(golden.of_object(told))


def test_interfaces_are_the_stored_ones(stored: Check) -> None:
    x = np.array([0.0, 0.1, 0.25, 0.45])
    parts = [Part(name, x, np.arange(8).reshape(4, 2), np.ones(3), np.ones(3)) for name in "abc"]
    at = np.array([0.03, 0.1, 0.1 + 1e-13, 0.2, 0.31, 0.45])
    found = {
        "between": replace(interface(parts, (0, 1), at), first_pair=7),
        "at points": interface(parts, (1, 2), at, at_points=True),
    }
    stored(golden.of_object(found))


def of_file(name: str, path: Path | None = None, **more: object) -> Case:
    """Return the case of a mesh of the folder."""
    keys: dict[str, object] = {"model.poisson": 0.3}
    if not name.endswith("delaminated"):
        keys["contact.impulse"] = "consistent"
    return case_of(name, path, **keys | more)


@pytest.mark.parametrize("name", ["plane_strips", "plane_delaminated", "solid_delaminated"])
def test_meshes_of_files_are_the_stored_ones(name: str, stored: Check) -> None:
    case = of_file(name)
    mesh = meshing.solid_mesh(case)
    told = {"mesh": mesh, "along": meshing.cells_along(case, mesh)}
    if name != "solid_delaminated":
        structure = assemble(case)
        told |= {"operators": structure.operators, "layout": structure.layout}
        told |= {"touching": structure.body.touching if structure.body else None}
    stored(golden.of_object(told))


def test_sizes_that_are_too_large_are_told_as_stored(
    stored: Check, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The number of unknowns stands in the message."""
    monkeypatch.setattr(meshing, "MOST_DOFS", 3)
    lines = []
    for case in (
        preset("embedded", {"model.kind": "plane-stress", "model.layers": 3}),
        preset("embedded", {"model.kind": "plane-stress", "model.degree": 3}),
        preset("embedded", {"model.kind": "solid", "model.strips": 4, "model.layers": 2}),
        preset("embedded", {"model.kind": "solid", "model.degree": 3}),
        *(of_file(name) for name in ("plane_strips", "plane_delaminated", "solid_strips",
                                     "solid_delaminated")),
    ):  # fmt: skip
        with pytest.raises(CaseError) as raised:
            (meshing.solid_mesh if case.mesh.file else meshing.lattice)(case)
        lines.append(str(raised.value).replace(str(MESHES), "meshes"))
    stored("\n".join(lines))

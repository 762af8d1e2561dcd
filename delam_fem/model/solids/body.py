"""The body of a solid structure, and the readings that stand for its laminae.

A body says what its free dofs move, what it is made of, and where it may touch. Output needs the
body; operators and layout know dofs, pairs and readings alone. The first rank gets the
displacements of all nodes, state by state; nothing else of a state is gathered.

The readings of a solid lamina are deflection and slope of its middle line, as of a beam. The middle
line lies at half of the height and half of the width. Reading 2 (p n + k) is the deflection u_y of
part p at its point k, of n points; the next one is the slope ∂u_y/∂x there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.model import _dolfinx
from delam_fem.model.beams.network import network
from delam_fem.model.layout import Place, Sheets, Structure
from delam_fem.model.mesh import edges, placed
from delam_fem.model.solids.facing import Pairs, pressure
from delam_fem.model.solids.forms import SAME, Elasticity, Recovery, Solid, evaluate, gathered
from delam_fem.model.solids.mesh import (
    FACET_OF,
    FACETS,
    SolidMesh,
    locate,
    meetings,
    shape_functions,
)
from delam_fem.model.solids.meshing import cells_along
from delam_fem.numerics.types import BoolArray, FloatArray, IntArray
from delam_fem.system.errors import CaseError


@dataclass(frozen=True)
class Body:
    """A solid with its material, and the meaning of its free dofs.

    All dofs of the solid are `free @ u + base q`, u of the free dofs and q of the base; on several
    ranks each one has the columns of its own free dofs, and the sum over all ranks counts.

    Attributes:
        solid: the solid.
        free: CSR (n_dofs, n_own); see above.
        base: shape (n_dofs,); see above.
        young_modulus: Young's modulus of each cell of the mesh, shape (n_cells,) [Pa].
        material: of the cells.
        width: width of each lamina, and of its surfaces in two dimensions, shape (n_laminae,) [m].
        touching: pairs that can move, in the order of the layout's interfaces; they follow one
            another in the gap matrix.
    """

    solid: Solid
    free: sp.csr_matrix
    base: FloatArray
    young_modulus: FloatArray
    material: Elasticity
    width: FloatArray
    touching: tuple[Pairs, ...] = ()

    @property
    def mesh(self) -> SolidMesh:
        """The mesh."""
        return self.solid.mesh

    @property
    def is_first(self) -> bool:
        """Whether this rank is the one that gets gathered displacements."""
        return self.solid.comm.rank == 0

    def gathered(self, vectors: FloatArray, base: FloatArray) -> FloatArray:
        """Return the displacements of all nodes on the first rank (collective).

        Args:
            vectors: values of the free dofs of this rank, shape (k, n_own).
            base: values of the base, shape (k,).

        Returns:
            Shape (k, n_nodes, dim) [m]; on the other ranks without nodes.
        """
        values = np.ascontiguousarray((self.free @ vectors.T).T)
        comm = self.solid.comm
        dim = self.mesh.dim
        if comm.size > 1:
            total = np.empty_like(values) if self.is_first else None
            comm.Reduce(values, total, root=0)
            if total is None:
                return np.empty((len(vectors), 0, dim))
            values = total
        return np.asarray(values + base[:, None] * self.base).reshape(len(vectors), -1, dim)

    def largest(self, vectors: FloatArray) -> FloatArray:
        """Return the largest displacement of all nodes in each direction (collective).

        Args:
            vectors: values of the free dofs of this rank, shape (n_own, k).

        Returns:
            Shape (k, dim) [m].
        """
        result = [
            np.abs(self.gathered(vector[None], np.zeros(1))).max(axis=(0, 1), initial=0.0)
            for vector in vectors.T
        ]
        return np.asarray(self.solid.comm.bcast(np.array(result)))

    def moving(self, case: Case, laminae: Sequence[int]) -> IntArray:
        """Return own dofs that move laminae and what is bonded to them (collective), (n,)."""
        mesh = self.mesh
        at = edges(case)
        middles = mesh.points[mesh.cells].mean(axis=1)[:, 0]
        chosen = np.isin(mesh.lamina, laminae)
        if case.is_plate:
            for number in laminae:
                chosen |= self._bonded(case, number)
        for segment, group in () if case.is_apart or case.is_plate else network(case, at).groups():
            if not set(group).isdisjoint(laminae):
                is_there = (middles > at[segment.first]) & (middles < at[segment.last])
                chosen |= is_there & np.isin(mesh.lamina, group)
        nodes = self._nodes_of(np.flatnonzero(chosen))
        rows = mesh.dim * nodes[:, None] + np.arange(mesh.dim)
        return np.asarray(np.unique(self.free[rows.ravel()].indices))

    def _nodes_of(self, cells: IntArray) -> IntArray:
        """Return the global nodes of input cells on every rank (collective), increasing, (n,)."""
        local_nodes = np.unique(self.solid.nodes_of(cells))
        every = self.solid.comm.allgather(local_nodes[local_nodes >= 0])
        return np.asarray(np.unique(np.concatenate(every)))

    def raised(self, vector: FloatArray, laminae: Sequence[int]) -> FloatArray:
        """Return this rank's share of the deflections of all nodes of laminae, (n_nodes,) [m].

        The call is collective.

        Args:
            vector: values of the own free dofs, shape (n_own,).
            laminae: their numbers.
        """
        nodes = self._nodes_of(np.flatnonzero(np.isin(self.mesh.lamina, laminae)))
        return np.asarray(self.free[self.mesh.dim * nodes + UP] @ vector)

    def _bonded(self, case: Case, lamina: int) -> BoolArray:
        """Return which cells of a plate are bonded to a lamina above or below them, (n_cells,)."""
        mesh = self.mesh
        x, _, z = mesh.points[mesh.cells].mean(axis=1).T
        names = [entry.name for entry in case.lamina]
        result = np.zeros(len(x), dtype=np.bool_)
        for others in (range(lamina + 1, len(names)), range(lamina - 1, -1, -1)):
            is_reached = np.ones(len(x), dtype=np.bool_)
            for other in others:
                lower = other - 1 if other > lamina else other
                between = (names[lower], names[lower + 1])
                for patch in case.delamination:
                    if patch.between == between:
                        is_reached &= ~patch.contains(x, z)
                result |= is_reached & (mesh.lamina == other)
        return result

    def shape(self) -> Shape:
        """Return the points and cells for output (collective)."""
        solid = self.solid
        cells = np.arange(len(self.mesh.cells))
        local_nodes = solid.nodes_of(cells)
        parts = solid.comm.allgather(
            (np.flatnonzero(local_nodes[:, 0] >= 0), local_nodes[local_nodes[:, 0] >= 0])
        )
        nodes = np.empty(
            (cells.size, max(numbers.shape[1] for _, numbers in parts)), dtype=np.int64
        )
        for where, of_rank in parts:
            nodes[where] = of_rank
        stiffness = self.young_modulus, self.material
        return Shape(self.mesh, solid.degree, nodes, *stiffness, self.width, self.touching)


@dataclass(frozen=True)
class Shape:
    """The laminae as points and cells for output, each lamina and layer with points of its own.

    A shape holds arrays alone, nothing that ranks share.

    Attributes:
        mesh: the mesh.
        degree: of the displacements.
        nodes: global nodes of all cells, shape (n_cells, k).
        young_modulus: of each cell, shape (n_cells,) [Pa].
        material: of the cells.
        width: of each lamina, shape (n_laminae,) [m].
        touching: pairs of surfaces that may touch.
    """

    mesh: SolidMesh
    degree: int
    nodes: IntArray
    young_modulus: FloatArray
    material: Elasticity
    width: FloatArray
    touching: tuple[Pairs, ...]

    @cached_property
    def _numbering(self) -> tuple[IntArray, IntArray, IntArray]:
        lamina = np.repeat(self.mesh.lamina, self.nodes.shape[1])
        kind = np.repeat(self.material.kind, self.nodes.shape[1])  # stresses jump between them
        layer = lamina * len(self.material.matrices) + kind
        keys = layer * (int(self.nodes.max()) + 1) + self.nodes.ravel()
        _, first, number = np.unique(keys, return_index=True, return_inverse=True)
        return first, number.reshape(self.nodes.shape), lamina[first]

    @property
    def cells(self) -> IntArray:
        """Points of the cells in the order of basix, shape (n_cells, k)."""
        return self._numbering[1]

    @cached_property
    def node(self) -> IntArray:
        """Global node of each point, shape (n_points,)."""
        return np.asarray(self.nodes.ravel()[self._numbering[0]])

    @property
    def lamina(self) -> IntArray:
        """Lamina of each point, shape (n_points,)."""
        return self._numbering[2]

    @property
    def reference_nodes(self) -> FloatArray:
        """Reference coordinates of the nodes of a cell, shape (k, dim)."""
        return _dolfinx.reference_nodes(self.mesh.cell, self.degree)

    @cached_property
    def points(self) -> FloatArray:
        """Positions of the points in the mesh, shape (n_points, dim) [m]."""
        mesh = self.mesh
        N, _ = shape_functions(mesh.cell, self.reference_nodes)
        every = np.einsum("bv,cvi->cbi", N, mesh.points[mesh.cells])
        return np.asarray(every.reshape(-1, mesh.dim)[self._numbering[0]])

    @cached_property
    def recovery(self) -> Recovery:
        """What recovers stresses at the points."""
        stiffness = self.young_modulus, self.material
        return Recovery.of(self.mesh, self.degree, self.nodes, self.cells, *stiffness)

    @cached_property
    def pressing(self) -> tuple[sp.csr_matrix, ...]:
        """Pressure at the points per unit force of each pair, by interface, (n, n_pairs) each.

        Both surfaces of an interface have the pressure.
        """
        mesh = self.mesh
        places = self.reference_nodes
        n = len(self.node)
        result = []
        for pairs in self.touching:
            width = float(self.width[list(pairs.facing.parts)].min()) if mesh.dim == 2 else 1.0
            total = sp.csr_matrix((n, len(pairs.gap)))
            for facets, at in (
                (pairs.facing.lower, pairs.lower.x),
                (pairs.facing.upper, pairs.upper),
            ):
                total = total + pressure(
                    mesh, facets, at, pairs.lower.normals, width, places=places, cells=self.cells,
                    n=n,
                )  # fmt: skip
            result.append(total)
        return tuple(result)


_INSIDE = 1e-7
"""Depth below the surface at which places are read, in thicknesses."""
UP = 1
"""Number of the component that is the deflection."""
_BESIDE = 1e-5
"""How far beside a point slopes are taken, in lengths of the structure; far below a cell."""
FEWEST, MOST = 20, 400
"""Bounds for the number of cells between the points of a part on a mesh from a file."""


def points_along(case: Case, mesh: SolidMesh) -> FloatArray:
    """Return the points of the parts of a mesh from a file, shape (n,) [m].

    The points are about as dense as the cells are on the average, with one at each edge of a
    delamination.
    """
    fewest = max(FEWEST, 2 * edges(case).size)
    return placed(case, int(np.clip(cells_along(case, mesh), fewest, MOST)))


def reading_rows(solid: Solid, x: FloatArray) -> sp.csr_matrix:
    """Return the readings of all laminae, this rank's share, shape (2 n_parts n, n_dofs).

    A slope at the boundary of two cells is the mean of theirs.

    Args:
        solid: the solid.
        x: points along the laminae, shape (n,) [m].

    Raises:
        CaseError: a lamina does not reach a point, or has a hole there.
    """
    mesh = solid.mesh
    count = int(mesh.lamina.max()) + 1
    line = np.concatenate([middle_line(mesh, number, x) for number in range(count)])
    lamina = np.repeat(np.arange(count), x.size)
    step = np.zeros(mesh.dim)
    step[0] = _BESIDE * (x[-1] - x[0])
    first = line[:, 0] == x[0]
    last = line[:, 0] == x[-1]
    try:
        before = locate(mesh, line - step * ~first[:, None], lamina)
        behind = locate(mesh, line + step * ~last[:, None], lamina)
    except ValueError as error:
        raise CaseError(
            f"mesh.file: expected laminae without holes at half of their height; {error}"
        ) from error
    sides = [evaluate(solid, line, cells) for cells in (before, behind)]
    deflection = 0.5 * sum(side.displacement(UP) for side in sides)
    slope = 0.5 * sum(side.derivative(UP, 0) for side in sides)
    n = len(line)
    order = np.arange(2 * n).reshape(2, n).T.ravel()
    return sp.vstack([deflection, slope], format="csr")[order]


def height_of(side: int) -> float:
    """Return the share of the thickness below a place: on the top (1), the bottom (-1), halfway."""
    return 0.5 + side * (0.5 - _INSIDE)


def place_rows(solid: Solid, places: Sequence[Place]) -> sp.csr_matrix:
    """Return the deflections at places of a plate, this rank's share, shape (k, n_dofs).

    Raises:
        CaseError: a place is outside of its lamina.
    """
    mesh = solid.mesh
    if not places:
        return sp.csr_matrix((0, mesh.dim * solid.n_nodes))
    table = np.array(places)
    points = np.empty((len(places), mesh.dim))
    for part, side in np.unique(table[:, [0, 3]].astype(np.int64), axis=0).tolist():
        chosen = (table[:, 0] == part) & (table[:, 3] == side)
        x, z = table[chosen, 1:3].T
        points[chosen] = middle_line(mesh, part, x, z, height_of(side))
    cells = locate(mesh, points, table[:, 0].astype(np.int64))
    return evaluate(solid, points, cells).displacement(UP)


def with_places(structure: Structure, places: Sequence[Place]) -> Structure:
    """Return the structure of a plate with readings of further places, after its own (collective).

    Raises:
        CaseError: a place is outside of its lamina.
    """
    layout = structure.layout
    body = structure.body
    further = tuple(place for place in places if place not in layout.places)
    if not further:
        return structure
    assert body is not None and layout.reading is not None
    rows = gathered(place_rows(body.solid, further), body.solid.comm)
    reading = replace(
        layout.reading,
        matrix=sp.vstack([layout.reading.matrix, rows @ body.free], format="csr"),
        base=np.append(layout.reading.base, rows @ body.base),
    )
    layout = replace(layout, reading=reading, places=(*layout.places, *further))
    return replace(structure, layout=layout)


def sheets_of(body: Body) -> Sheets | None:
    """Return the middle surfaces of the laminae of a plate, with the own columns (collective).

    Returns:
        The surfaces; None if cells are no hexahedra with upright edges.
    """
    mesh = body.mesh
    if mesh.cell != "hexahedron":
        return None
    middle = 0.5 * (mesh.points[:, 2].min() + mesh.points[:, 2].max())
    tables: dict[str, list[Any]] = {"points": [], "thickness": [], "part": [], "cells": []}
    first = 0
    for number in range(int(mesh.lamina.max()) + 1):
        cells = mesh.cells[mesh.lamina == number]
        corners = mesh.points[cells]
        size = np.ptp(mesh.points[:, [0, 2]], axis=0).max()
        keys = np.round(corners[..., [0, 2]].reshape(-1, 2) / (SAME * size)).astype(np.int64)
        _, where, vertex = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        plan = corners.reshape(-1, 3)[where]
        heights = corners[..., UP].ravel()
        low = np.full(where.size, np.inf)
        high = np.full(where.size, -np.inf)
        np.minimum.at(low, vertex.ravel(), heights)
        np.maximum.at(high, vertex.ravel(), heights)
        of_cells = np.sort(vertex.reshape(len(cells), -1), axis=1)
        if (of_cells[:, ::2] != of_cells[:, 1::2]).any():
            return None
        quads = np.unique(of_cells[:, ::2], axis=0)
        at = plan[quads][..., [0, 2]]
        away = at - at.mean(axis=1, keepdims=True)
        order = np.argsort(-np.arctan2(away[..., 1], away[..., 0]), axis=1)
        plan[:, UP] = 0.5 * (low + high)
        plan[:, 2] -= middle
        tables["points"].append(plan)
        tables["thickness"].append(high - low)
        tables["part"].append(np.full(where.size, number))
        tables["cells"].append(first + np.take_along_axis(quads, order, axis=1))
        first += where.size
    points, thickness, part, cells = (np.concatenate(values) for values in tables.values())
    places = [Place(int(k), x, z, 0) for k, (x, _, z) in zip(part, points.tolist(), strict=True)]
    rows = gathered(place_rows(body.solid, places), body.solid.comm)
    return Sheets(points, thickness, part, cells, rows @ body.free, rows @ body.base)


def middle_line(
    mesh: SolidMesh,
    lamina: int,
    x: FloatArray,
    z: float | FloatArray = 0.0,
    height: float = 0.5,
) -> FloatArray:
    """Return the points at half of the height and width of a lamina, shape (n, dim) [m].

    Args:
        mesh: the mesh.
        lamina: number of the lamina.
        x: positions along the lamina, shape (n,) [m].
        z: distance from the middle of the width, of all positions or of each, shape (n,) [m].
        height: share of the thickness that is below the points.

    Raises:
        CaseError: the lamina does not reach one of the positions.
    """
    corners = mesh.points[surface(mesh, mesh.lamina == lamina)]
    origins = np.zeros((x.size, mesh.dim))
    origins[:, 0] = x
    if mesh.dim == 3:
        origins[:, 2] = z + 0.5 * (corners[..., 2].min() + corners[..., 2].max())
    upwards = np.zeros_like(origins)
    upwards[:, UP] = 1.0
    hits = meetings(corners, origins, upwards, FACET_OF[mesh.cell])
    low = np.full(x.size, np.inf)
    high = np.full(x.size, -np.inf)
    np.minimum.at(low, hits.line, hits.distance)
    np.maximum.at(high, hits.line, hits.distance)
    if not np.all(high > low):
        missing = np.flatnonzero(~(high > low))[0]
        at = float(x[missing])
        across = float(np.broadcast_to(z, x.shape)[missing])
        raise CaseError(
            f"mesh.file: expected lamina {lamina + 1} (counted from 1 at the bottom) to reach from "
            f"x = {x[0]:g} m to {x[-1]:g} m, there is nothing of it at {at:g} m"
            + f", z = {across:g} m"
            * bool(across)
        )
    origins[:, UP] = (1.0 - height) * low + height * high
    return origins


def surface(mesh: SolidMesh, chosen: IntArray) -> IntArray:
    """Return the facets that belong to only one of the chosen cells, as vertices, (n, m)."""
    cells = mesh.cells[chosen]
    facets = np.concatenate([cells[:, list(facet)] for facet in FACETS[mesh.cell]])
    _, first, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    return np.asarray(facets[first[count == 1]])

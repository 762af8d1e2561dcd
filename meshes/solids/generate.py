"""Generate meshes of laminae as solids with gmsh, with the physical groups that delam_fem reads.

    python meshes/solids/generate.py [-o FOLDER]

Groups: a lamina's name (its cells), "start" and "end" (the faces of the ends), and for each
interface "LOWER-UPPER lower" and "LOWER-UPPER upper" (its two sides). Where laminae are apart they
touch, but have vertices of their own; where they are bonded they share them.
"""

from __future__ import annotations

import argparse
from collections.abc import Hashable
from dataclasses import dataclass, field
from pathlib import Path

import gmsh

PAPER = {"thick": 0.002, "thin": 0.001}  # m, thicknesses of the paper's laminae
BEAM = {"lower": 0.004, "upper": 0.002}  # m, thicknesses of the delaminated beam


@dataclass(frozen=True)
class Stack:
    """Laminae one upon another, from bottom to top.

    Attributes:
        length: of all laminae [m].
        thickness: of each lamina, by its name, from the bottom [m].
        width: of all laminae [m]; None: a mesh in two dimensions.
        delaminations: lower lamina (from 0), beginning and end [m] of each place where laminae are
            apart; None: all laminae are apart over their whole length.
        cells: of each lamina along its length; empty: triangles or tetrahedra of the size `size`.
        layers: cells through each thickness, if `cells` is given.
        strips: cells across the width, if `cells` is given.
        size: of triangles or tetrahedra [m].
    """

    length: float
    thickness: dict[str, float]
    width: float | None = None
    delaminations: tuple[tuple[int, float, float], ...] | None = None
    cells: tuple[int, ...] = ()
    layers: int = 1
    strips: int = 2
    size: float = 0.0


MESHES = {
    "plane_strips": Stack(0.685, PAPER, cells=(40, 50)),
    "solid_strips": Stack(0.685, PAPER, width=0.04, cells=(40, 50)),
    "plane_delaminated": Stack(0.2, BEAM, delaminations=((0, 0.06, 0.14),), size=0.002),
    "solid_delaminated": Stack(0.2, BEAM, 0.02, delaminations=((0, 0.06, 0.14),), size=0.006),
}
"""Stacks by the name of the mesh file. Along strips the cells do not match."""


@dataclass
class _Geometry:
    """The geometry of a stack in the current model of gmsh.

    Attributes:
        stack: the stack.
        at: ends of the laminae and edges of delaminations, increasing [m].
        made: entities that are there already, by their place.
    """

    stack: Stack
    at: list[float] = field(default_factory=list)
    made: dict[Hashable, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        edges = {edge for opening in self.stack.delaminations or () for edge in opening[1:]}
        self.at = sorted({0.0, self.stack.length} | edges)

    def build(self) -> None:
        """Add all laminae and their groups."""
        names = list(self.stack.thickness)
        dim = 2 if self.stack.width is None else 3
        groups: dict[str, list[int]] = {}
        ends = ("start", 0), ("end", len(self.at) - 1)
        for lamina, name in enumerate(names):
            body = self._lamina(lamina)
            gmsh.model.geo.synchronize()
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [body]), name)
            for end, place in ends:
                groups.setdefault(end, []).append(self._swept(("end", lamina, place)))
        for level in range(1, len(names)):
            for segment in range(len(self.at) - 1):
                if self._is_apart(level, segment):
                    for side in ("lower", "upper"):
                        name = f"{names[level - 1]}-{names[level]} {side}"
                        facet = self._swept(("along", level, segment, side))
                        groups.setdefault(name, []).append(facet)
        for name, facets in groups.items():
            group = gmsh.model.addPhysicalGroup(dim - 1, facets)
            gmsh.model.setPhysicalName(dim - 1, group, name)

    def _is_apart(self, level: int, segment: int) -> bool:
        """Return whether the laminae below and above a level are apart in a segment."""
        if self.stack.delaminations is None:
            return True
        middle = 0.5 * (self.at[segment] + self.at[segment + 1])
        return any(
            lower == level - 1 and start < middle < end
            for lower, start, end in self.stack.delaminations
        )

    def _lamina(self, lamina: int) -> int:
        """Add a lamina; return its surface, or its volume in three dimensions."""
        last = len(self.at) - 1
        bottom = [("along", lamina, j, "upper") for j in range(last)]
        top = [("along", lamina + 1, j, "lower") for j in range(last)]
        around = [*bottom, ("end", lamina, last), *top[::-1], ("end", lamina, 0)]
        corners = [(lamina, j, "upper") for j in (0, last)]
        corners += [(lamina + 1, j, "lower") for j in (last, 0)]
        faces = [self._face(around, corners, z) for z in range(1 if self._is_flat else 2)]
        if self._is_flat:
            return faces[0]
        loop = gmsh.model.geo.addSurfaceLoop([*faces, *(self._swept(key) for key in around)])
        volume = gmsh.model.geo.addVolume([loop])
        if self.stack.cells:
            gmsh.model.geo.mesh.setTransfiniteVolume(volume)
            gmsh.model.geo.mesh.setRecombine(3, volume)
        return volume

    @property
    def _is_flat(self) -> bool:
        return self.stack.width is None

    def _face(self, around: list[tuple[Hashable, ...]], corners: list[object], z: int) -> int:
        """Add a lamina's surface at one edge of the width."""
        lines = [self._line(key, z) for key in around]
        n = len(self.at) - 1
        signs = [1] * (n + 1) + [-1] * (n + 1)
        return self._surface(lines, signs, [self._point(*corner, z) for corner in corners])

    def _surface(self, lines: list[int], signs: list[int], corners: list[int]) -> int:
        geometry = gmsh.model.geo
        loop = geometry.addCurveLoop([a * b for a, b in zip(lines, signs, strict=True)])
        surface = geometry.addPlaneSurface([loop])
        if self.stack.cells:
            geometry.mesh.setTransfiniteSurface(surface, cornerTags=corners)
            geometry.mesh.setRecombine(2, surface)
        return int(surface)

    def _swept(self, key: tuple[Hashable, ...]) -> int:
        """Return a line in two dimensions; in three the face that it sweeps across the width."""
        if self._is_flat:
            return self._line(key, 0)
        key = self._merged(key)
        if ("face", key) not in self.made:
            a, b = self._ends(key)
            across = [self._across(end) for end in (b, a)]
            lines = [self._line(key, 0), across[0], self._line(key, 1), across[1]]
            corners = [
                self._point(*a, 0),
                self._point(*b, 0),
                self._point(*b, 1),
                self._point(*a, 1),
            ]
            self.made["face", key] = self._surface(lines, [1, 1, -1, -1], corners)
        return self.made["face", key]

    def _merged(self, key: tuple[Hashable, ...]) -> tuple[Hashable, ...]:
        """Return the key of the line that both sides of a bond share."""
        if key[0] == "along" and not (
            0 < key[1] < len(self.stack.thickness) and self._is_apart(key[1], key[2])
        ):
            return (*key[:3], "both")
        return key

    def _ends(self, key: tuple[Hashable, ...]) -> list[tuple[int, int, str]]:
        """Return the two ends of a line."""
        if key[0] == "end":
            _, lamina, place = key
            return [(lamina, place, "upper"), (lamina + 1, place, "lower")]
        _, level, segment, side = key
        return [(level, segment, side), (level, segment + 1, side)]

    def _line(self, key: tuple[Hashable, ...], z: int) -> int:
        key = self._merged(key)
        if ("line", key, z) not in self.made:
            a, b = self._ends(key)
            line = gmsh.model.geo.addLine(self._point(*a, z), self._point(*b, z))
            self.made["line", key, z] = line
            if self.stack.cells:
                count = self.stack.layers
                if key[0] == "along":
                    lamina = key[1] - (key[3] == "lower" or key[1] == len(self.stack.thickness))
                    count = self.stack.cells[lamina]
                gmsh.model.geo.mesh.setTransfiniteCurve(line, count + 1)
        return self.made["line", key, z]

    def _across(self, point: tuple[int, int, str]) -> int:
        key = self._point_key(*point)
        if ("across", key) not in self.made:
            line = gmsh.model.geo.addLine(self._point(*point, 0), self._point(*point, 1))
            self.made["across", key] = line
            if self.stack.cells:
                gmsh.model.geo.mesh.setTransfiniteCurve(line, self.stack.strips + 1)
        return self.made["across", key]

    def _point_key(self, level: int, place: int, side: str) -> tuple[int, int, str]:
        """Return the key of a point, the same on both sides beside a bond."""
        beside = [j for j in (place - 1, place) if 0 <= j < len(self.at) - 1]
        is_outer = level in (0, len(self.stack.thickness))
        is_one = is_outer or not all(self._is_apart(level, j) for j in beside)
        return level, place, "both" if is_one else side

    def _point(self, level: int, place: int, side: str, z: int) -> int:
        key = self._point_key(level, place, side)
        if ("point", key, z) not in self.made:
            height = sum(list(self.stack.thickness.values())[:level])
            across = 0.0 if self._is_flat else (z - 0.5) * self.stack.width
            point = gmsh.model.geo.addPoint(self.at[place], height, across, self.stack.size)
            self.made["point", key, z] = point
        return self.made["point", key, z]


def write(stack: Stack, path: Path) -> None:
    """Write the mesh of a stack to a file."""
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        _Geometry(stack).build()
        gmsh.model.mesh.generate(2)
        gmsh.option.setNumber("Mesh.MeshOnlyVisible", 1)
        volumes = gmsh.model.getEntities(3)
        for volume in volumes:  # one by one: gmsh refuses sides that touch within one mesh
            gmsh.model.setVisibility(volumes, 0)
            gmsh.model.setVisibility([volume], 1)
            gmsh.model.mesh.generate(3)
        gmsh.model.setVisibility(volumes, 1)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def main() -> None:
    """Write all mesh files to a folder."""
    parser = argparse.ArgumentParser(description="Generate meshes of solid laminae with gmsh.")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent)
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    for name, stack in MESHES.items():
        write(stack, folder / f"{name}.msh")


if __name__ == "__main__":
    main()

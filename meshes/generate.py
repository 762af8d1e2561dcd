"""Generate the mesh files of this folder with gmsh: two straight lines, one for each lamina.

    python meshes/generate.py [-o FOLDER]

Each lamina is a physical group of lines, "thick" or "thin". The lines lie at a distance only to
make them visible in pictures; the gap of a run comes from the section `gap` of its case.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import gmsh

LENGTH = 0.685  # m, length of the paper's laminae
DISTANCE = 0.012  # m, distance of the two lines in the file


@dataclass(frozen=True)
class Division:
    """The division of a lamina into elements, whose lengths form a geometric progression.

    Attributes:
        elements: number of elements.
        tip_ratio: length of the element at the tip over the length of the element at the clamp.
    """

    elements: int
    tip_ratio: float = 1.0


MESHES = {
    "laminae_20": (Division(20), Division(20)),
    "laminae_50": (Division(50), Division(50)),
    "laminae_graded": (Division(24, tip_ratio=0.25), Division(24, tip_ratio=0.25)),
}
"""Divisions of the thick and the thin lamina by the name of the mesh file."""


def write(thick: Division, thin: Division, path: Path) -> None:
    """Write the mesh of both laminae to a file; the suffix of the file selects the format.

    Args:
        thick: division of the thick lamina.
        thin: division of the thin lamina; equal to `thick` if the nodes must be opposite.
        path: file to write.
    """
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        _add_line("thick", 0.0, thick)
        _add_line("thin", DISTANCE, thin)
        gmsh.model.mesh.generate(1)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def _add_line(name: str, y: float, division: Division) -> None:
    """Add a lamina at the height y [m] to the current model of gmsh."""
    geometry = gmsh.model.geo
    line = geometry.addLine(geometry.addPoint(0.0, y, 0.0), geometry.addPoint(LENGTH, y, 0.0))
    growth = division.tip_ratio ** (1.0 / max(division.elements - 1, 1))
    geometry.mesh.setTransfiniteCurve(line, division.elements + 1, "Progression", growth)
    geometry.synchronize()
    gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, [line]), name)


def main() -> None:
    """Write all mesh files to a folder."""
    parser = argparse.ArgumentParser(description="Generate the meshes of the laminae with gmsh.")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent)
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    for name, divisions in MESHES.items():
        write(*divisions, folder / f"{name}.msh")


if __name__ == "__main__":
    main()

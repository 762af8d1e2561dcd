"""Modes of plates: how much of each lies in the sublaminate at a patch, and a map of its surface.

The part of a plate above or below a patch vibrates by itself at the local defect resonance. Of a
mode, the share of the kinetic energy that is in the thinner of both parts says whether it is one:

    share = ∫_part ρ u² dV / ∫_plate ρ u² dV

The integrals take Gauss's rule with three points in each direction of hexahedra, and the mean of
the nodes of tetrahedra.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from delam_fem.api import Case, FloatArray, IntArray, style, volumes

if TYPE_CHECKING:
    from delam_fem.api import Body  # it needs dolfinx

LOCAL = 0.5
"""Share of the energy in a sublaminate from which a mode is local to its patch."""
DEFECT_RESONANCE = "defect resonance of "
"""Beginning of the name of the lowest local mode of a patch, whose name follows."""
HEIGHT = 3.0
"""Height of a map [in]."""


@dataclass(frozen=True)
class PlateModes:
    """What modes of a plate are besides their frequencies.

    Attributes:
        patches: names of the patches.
        shares: share of the kinetic energy of each mode in the thinner sublaminate at each patch,
            shape (n, n_patches) [-].
        plan: x and z of points of the surface, shape (n_points, 2) [m].
        maps: deflections there, the largest of each mode is 1, shape (n, n_points) [-].
        outlines: of the patches, x and z each of shape (k, 2) [m].
    """

    patches: tuple[str, ...]
    shares: FloatArray
    plan: FloatArray
    maps: FloatArray
    outlines: tuple[FloatArray, ...]

    def named(self, motions: tuple[str, ...]) -> tuple[str, ...]:
        """Return what each mode is; the lowest local one of each patch is its defect resonance."""
        result = list(motions)
        for number, name in enumerate(self.patches):
            local = np.flatnonzero(self.shares[:, number] >= LOCAL)
            for order, mode in enumerate(local.tolist()):
                result[mode] = f"local of {name}" if order else f"{DEFECT_RESONANCE}{name}"
        return tuple(result)

    def figure(self, titles: Sequence[str], heading: str) -> Figure:
        """Draw the deflection of the surface in each mode, with the outlines of patches."""
        figure, panels = style.side_by_side(
            len(titles), HEIGHT, above=0.7, sharex=True, sharey=True
        )
        triangles = Triangulation(*self.plan.T)
        for axes, title, values in zip(panels, titles, self.maps, strict=True):
            image = axes.tripcolor(
                triangles, values, shading="gouraud", cmap=mpl.colormaps["RdBu_r"], vmin=-1.0,
                vmax=1.0,
            )  # fmt: skip
            for outline in self.outlines:
                axes.fill(*outline.T, facecolor="none", edgecolor="black", linewidth=1.0)
            axes.set_aspect("equal")
            axes.set_title(title, loc="left", fontsize=9)
            axes.set_ylabel("z [m]")
        style.label_x(panels, "x [m]")
        figure.colorbar(image, ax=list(panels), label="deflection over the largest [-]", shrink=0.6)
        figure.suptitle(heading, x=0.02, ha="left")
        return figure


def plate_modes(body: Body, case: Case, vectors: FloatArray) -> PlateModes | None:
    """Return shares and maps of modes of a plate on the first rank (collective), None on others.

    Args:
        body: the plate.
        case: its case.
        vectors: the modes, shape (n_dofs, n); rows behind those of the body are impactors.
    """
    n = vectors.shape[1]
    motion = body.gathered(vectors[: body.free.shape[1]].T, np.zeros(n))
    shape = body.shape()
    if not body.is_first:
        return None
    mesh = body.mesh
    density = np.array([lamina.mean("density") for lamina in case.lamina])[mesh.lamina]
    energy = density * np.abs(volumes(mesh)) * _mean_squares(body, shape.nodes, motion)
    middle = mesh.points[mesh.cells].mean(axis=1)
    names = [lamina.name for lamina in case.lamina]
    heights = np.array([lamina.mean("thickness") for lamina in case.lamina])
    shares = []
    for patch in case.delamination:
        lower = names.index(patch.between[0])
        is_above = heights[lower + 1 :].sum() <= heights[: lower + 1].sum()
        is_part = mesh.lamina > lower if is_above else mesh.lamina <= lower
        chosen = is_part & patch.contains(middle[:, 0], middle[:, 2])
        shares.append(energy[:, chosen].sum(axis=1) / energy.sum(axis=1))
    # the surface of the lamina that moves most, the uppermost or the lowest one
    points = shape.points
    tops = [points[:, 1] >= points[:, 1].max() - _ON_SURFACE * np.ptp(points[:, 1])]
    tops.append(points[:, 1] <= points[:, 1].min() + _ON_SURFACE * np.ptp(points[:, 1]))
    sizes = [np.abs(motion[:, shape.node[top], 1]).max() for top in tops]
    top = tops[int(np.argmax(sizes))]
    deflection = motion[:, shape.node[top], 1]
    largest = np.abs(motion).max(axis=(1, 2))
    upwards = np.sign(deflection[np.arange(n), np.abs(deflection).argmax(axis=1)])
    scale = np.where(upwards == 0.0, 1.0, upwards) * largest
    return PlateModes(
        tuple(f"{'-'.join(patch.between)} {k}" for k, patch in enumerate(case.delamination, 1)),
        np.array(shares).reshape(-1, n).T,
        points[top][:, [0, 2]],
        deflection / scale[:, None],
        tuple(patch.outline(case.half_width) for patch in case.delamination),
    )


_ON_SURFACE = 1e-6
"""Distance from the surface, in thicknesses, within which a point is on it."""


def _mean_squares(body: Body, nodes: IntArray, motion: FloatArray) -> FloatArray:
    """Return the mean of u² over each cell, of each mode, shape (n, n_cells) [m2]."""
    if body.mesh.cell != "hexahedron":
        return np.asarray((motion[:, nodes] ** 2).sum(axis=3).mean(axis=2))
    roots, weights = np.polynomial.legendre.leggauss(3)  # type: ignore[no-untyped-call]
    result = np.zeros((len(motion), len(nodes)))
    for i, j, k in product(range(3), repeat=3):
        at = 0.5 + 0.5 * np.array([[roots[i], roots[j], roots[k]]])
        basis = body.solid.tabulate(0, at)[0, 0]
        values = np.einsum("mcbi,b->mci", motion[:, nodes], basis)
        result += 0.125 * weights[i] * weights[j] * weights[k] * (values**2).sum(axis=2)
    return result

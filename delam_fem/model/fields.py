"""Fields along the parts from vectors of free dofs: displacement, slope, bending moment."""

from __future__ import annotations

import numpy as np

from delam_fem.model.layout import BASE, Layout
from delam_fem.numerics.arrays import FloatArray


def nodal(layout: Layout, vectors: FloatArray, base: FloatArray) -> FloatArray:
    """Arrange free dofs by part and point, held points added.

    Args:
        layout: of the structure, whose parts share their points.
        vectors: free dofs, shape (k, n).
        base: what the base does, shape (k,); its slope is zero.

    Returns:
        Values and slopes, shape (2 components, n_parts, k, n_points).
    """
    result = np.zeros((2, len(layout.parts), vectors.shape[0], layout.x.size))
    for number, part in enumerate(layout.parts):
        for component, dofs in enumerate(part.dofs.T):
            free = dofs >= 0
            result[component, number][:, free] = vectors[:, dofs[free]]
            result[component, number][:, dofs == BASE] = base[:, None]
    return result


def bending_moment(layout: Layout, u: FloatArray, phi: FloatArray) -> FloatArray:
    """Return the bending moment E I u'' at the points, the mean of the two cells that meet there.

    Args:
        layout: gives the points and E I of the cells.
        u: displacements, shape (n_parts, k, n_points) [m].
        phi: slopes, same shape [-].

    Returns:
        Moments, same shape [N m]; the ends have one cell only.
    """
    h = np.diff(layout.x)
    EI = np.stack([part.flexural_rigidity for part in layout.parts])[:, None, :]
    chord = 6.0 * (u[..., 1:] - u[..., :-1]) / h**2
    at_start = EI * (chord - (4.0 * phi[..., :-1] + 2.0 * phi[..., 1:]) / h)
    at_end = EI * (-chord + (2.0 * phi[..., :-1] + 4.0 * phi[..., 1:]) / h)
    moment = np.zeros_like(u)
    moment[..., :-1] += at_start
    moment[..., 1:] += at_end
    moment[..., 1:-1] *= 0.5
    return moment

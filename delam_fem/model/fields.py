"""Fields along the laminae from vectors of free dofs: displacement, slope, bending moment."""

from __future__ import annotations

import numpy as np

from delam_fem.model.layout import Model
from delam_fem.numerics.arrays import FloatArray


def nodal(vectors: FloatArray, base: FloatArray) -> FloatArray:
    """Arrange free dofs by lamina and node, the clamped node added.

    Args:
        vectors: dofs in canonical order, shape (k, 4 n).
        base: what the clamped node does, shape (k,); its slope is zero.

    Returns:
        Values and slopes, shape (2 components, 2 laminae, k, n + 1).
    """
    k, n = vectors.shape[0], vectors.shape[1] // 4
    result = np.zeros((2, 2, k, n + 1))
    result[..., 1:] = vectors.reshape(k, 2, n, 2).transpose(3, 1, 0, 2)
    result[0, :, :, 0] = base
    return result


def bending_moment(model: Model, u: FloatArray, phi: FloatArray) -> FloatArray:
    """Return the bending moment E I u'' at the nodes, the mean of the two cells that meet there.

    Args:
        model: gives node positions and E I of the cells.
        u: displacements, shape (2, k, n_nodes) [m].
        phi: slopes, same shape [-].

    Returns:
        Moments, same shape [N m]; the ends have one cell only.
    """
    h = np.diff(model.x)
    EI = model.flexural_rigidity[:, None, :]
    chord = 6.0 * (u[..., 1:] - u[..., :-1]) / h**2
    at_start = EI * (chord - (4.0 * phi[..., :-1] + 2.0 * phi[..., 1:]) / h)
    at_end = EI * (-chord + (2.0 * phi[..., :-1] + 4.0 * phi[..., 1:]) / h)
    moment = np.zeros_like(u)
    moment[..., :-1] += at_start
    moment[..., 1:] += at_end
    moment[..., 1:-1] *= 0.5
    return moment

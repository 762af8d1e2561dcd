"""Fields along the parts, computed from the free dofs: displacement, slope, bending moment."""

from __future__ import annotations

import numpy as np

from delam_fem.model.layout import BASE, DISPLACEMENT, SLOPE, Layout
from delam_fem.model.pairing import interpolation
from delam_fem.numerics.arrays import FloatArray


def nodal(layout: Layout, vectors: FloatArray, base: FloatArray) -> FloatArray:
    """Arrange free dofs by part and point, and add the points that are held.

    Args:
        layout: layout of a structure whose parts share their points.
        vectors: values of the free dofs, shape (k, n).
        base: values of the base, shape (k,); the slope of the base is zero.

    Returns:
        Values and slopes at the points, shape (2 components, n_parts, k, n_points). Of a solid:
        those of the middle lines of its parts.
    """
    vectors = layout.read(vectors, base)
    result = np.zeros((2, len(layout.parts), vectors.shape[0], layout.x.size))
    for number, part in enumerate(layout.parts):
        for component, dofs in enumerate(part.dofs.T):
            free = dofs >= 0
            result[component, number][:, free] = vectors[:, dofs[free]]
            result[component, number][:, dofs == BASE] = base[:, None]
    return result


def at_stations(layout: Layout, u: FloatArray, phi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return displacements and slopes at the stations: those of the Hermite interpolants.

    Args:
        layout: gives the stations.
        u: displacements at the points, shape (n_parts, k, n_points) [m].
        phi: slopes at the points, shape (n_parts, k, n_points) [-].

    Returns:
        Displacements and slopes, each of shape (n_parts, k, n_stations).
    """
    part, places = layout.parts[0], layout.stations
    if places.size == part.x.size:
        return u, phi
    found = []
    for component in (DISPLACEMENT, SLOPE):
        cells, weights = interpolation(part, places, component)
        ends = np.stack([u[..., cells], phi[..., cells], u[..., cells + 1], phi[..., cells + 1]])
        found.append(np.asarray(np.einsum("e...s,se->...s", ends, weights)))
    return found[0], found[1]


def bending_moment(layout: Layout, u: FloatArray, phi: FloatArray) -> FloatArray:
    """Return the bending moment E I u'' at the stations.

    Within a cell it is linear. At a point between two cells it is the mean of both cells; an end
    has one cell only.

    Args:
        layout: gives the points and E I of the cells.
        u: displacements, shape (n_parts, k, n_points) [m].
        phi: slopes, shape (n_parts, k, n_points) [-].

    Returns:
        Moments, shape (n_parts, k, n_stations) [N m].
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
    places = layout.stations
    if places.size == layout.x.size:
        return moment
    cells = np.clip(np.ceil(places).astype(np.int64) - 1, 0, h.size - 1)
    X, is_point = places - cells, places == np.round(places)
    result = (1.0 - X) * at_start[..., cells] + X * at_end[..., cells]
    result[..., is_point] = moment
    return np.asarray(result)

"""Gaps and contacts along the laminae: positions at rest, gap fields, contact lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.schema import by_interface

if TYPE_CHECKING:  # the workers of a sweep use the arrays alone
    import xarray as xr


def between(gap_at_rest: FloatArray, u: FloatArray) -> FloatArray:
    """Return the gaps g0 + u of the upper lamina - u of the lower one.

    Args:
        gap_at_rest: shape (n_interfaces, …) [m]; its further axes fit those of `u`.
        u: displacements of the laminae from bottom to top, shape (n_interfaces + 1, …) [m].

    Returns:
        Gaps, NaN where a diverged motion is infinite, shape (n_interfaces, …) [m].
    """
    with np.errstate(invalid="ignore"):
        gaps: FloatArray = gap_at_rest + u[1:] - u[:-1]
    return gaps


def rest_positions(history: xr.Dataset) -> FloatArray:
    """Return the positions of the laminae at rest: the sum of the gaps below each of them.

    Returns:
        0 for the lowest lamina, shape (n_laminae, n_nodes) [m].
    """
    gap0 = by_interface(history["gap0"])
    return np.vstack([np.zeros_like(gap0[:1]), np.cumsum(gap0, axis=0)])


def gap_field(history: xr.Dataset) -> FloatArray:
    """Return the gaps of all frames and nodes, shape (n_interfaces, n_frames, n_nodes) [m]."""
    return between(by_interface(history["gap0"])[:, None], history["displacement"].to_numpy())


def contact_line(history: xr.Dataset) -> FloatArray:
    """Return the largest x at which the laminae touch in each frame.

    Returns:
        Positions, NaN where there is no contact, shape (n_interfaces, n_frames) [m].
    """
    x = history["x"].to_numpy()
    touching = np.where(by_interface(history["contact_state"]) > 0, x, -np.inf)
    farthest = touching.max(axis=-1, initial=-np.inf)
    return np.where(np.isfinite(farthest), farthest, np.nan)


def of_laminae(states: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the contact states of the laminae, the larger one of a lamina with two interfaces.

    Args:
        states: of the interfaces, 0 open, 1 hit, 2 resting, shape (n_interfaces, …).

    Returns:
        States of the laminae from bottom to top, shape (n_interfaces + 1, …).
    """
    none = np.zeros_like(states[:1])
    above, below = np.concatenate([states, none]), np.concatenate([none, states])
    larger: npt.NDArray[Any] = np.maximum(above, below)
    return larger

"""Fields that follow from the dataset: gaps, impulses, contact forces and curvatures of laminae.

A lamina between two others has two interfaces: it shows the smaller of both gaps, and the sums of
impulses and of forces.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.contact.laws import LAWS
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.gaps import gap_field
from delam_fem.results.schema import by_interface, event_interfaces
from delam_fem.simulation.recorder import HIT, RESTING


def gap_of_laminae(history: xr.Dataset) -> FloatArray:
    """Return the smaller gap of each lamina to its neighbours.

    Returns:
        Gaps, shape (n_laminae, n_frames, n_nodes) [m].
    """
    gaps = gap_field(history)
    far = np.full_like(gaps[:1], np.inf)
    smaller: FloatArray = np.minimum(np.concatenate([gaps, far]), np.concatenate([far, gaps]))
    return smaller


def impulse_of_laminae(history: xr.Dataset) -> FloatArray:
    """Return the impulses on each lamina since the frame before.

    Returns:
        Sums of impulses of its interfaces, shape (n_laminae, n_frames, n_nodes) [N s].
    """
    return _on_both_sides(impulse_of_interfaces(history))


def impulse_of_interfaces(history: xr.Dataset) -> FloatArray:
    """Return the impulses on each interface since the frame before.

    Returns:
        Sums of impulses that part the laminae, shape (n_interfaces, n_frames, n_nodes) [N s].
    """
    frames = history["frame"].to_numpy()
    n_interfaces = by_interface(history["gap0"]).shape[0]
    sums = np.zeros((n_interfaces, frames.size + 1, history.sizes["node"]))
    if frames.size > 1:
        spacing = frames[1] - frames[0]
        # the last row takes what follows the last frame; round-off must not move an impact
        row = np.searchsorted(frames + 1e-9 * spacing, history["event_time"].to_numpy())
        place = event_interfaces(history), row, history["event_node"].to_numpy()
        np.add.at(sums, place, history["event_impulse"].to_numpy())
    return sums[:, :-1]


def contact_lights(history: xr.Dataset) -> npt.NDArray[np.uint8]:
    """Return which pairs to light in a film: 0 apart, 1 hit since the frame before, 2 resting.

    Returns:
        Shape (n_frames, n_interfaces, n_nodes).
    """
    state = by_interface(history["contact_state"])
    is_hit = impulse_of_interfaces(history) > 0.0
    lights = np.where(is_hit, HIT, np.where(state == RESTING, RESTING, state))
    return lights.transpose(1, 0, 2).astype(np.uint8)


def contact_force_of_laminae(history: xr.Dataset, case: Case) -> FloatArray:
    """Return the forces of contact springs: -(k U + c U') at resting pairs, compression positive.

    Laws without springs act by impulses alone; their forces are 0.

    Returns:
        Sums of forces at the points, shape (n_laminae, n_frames, n_nodes) [N].
    """
    gaps = gap_field(history)
    if not LAWS[case.contact.law].spring:
        return _on_both_sides(np.zeros_like(gaps))
    share = by_interface(history["spring_share"])[:, None]
    force = -case.contact.penalty_stiffness * share * gaps
    if "penalty_damping" in LAWS[case.contact.law].spring:
        velocity = history["velocity"].to_numpy()
        force -= case.contact.penalty_damping * share * (velocity[1:] - velocity[:-1])
    is_resting = by_interface(history["contact_state"]) == RESTING
    return _on_both_sides(np.where(is_resting, force, 0.0))


def curvature(history: xr.Dataset) -> FloatArray:
    """Return u'' of the cubic through displacements and slopes at the ends of each cell.

    At a node between two cells it is the mean of both cells, as for the bending moment.

    Returns:
        Curvatures, shape (n_laminae, n_frames, n_nodes) [1/m].
    """
    u, phi = history["displacement"].to_numpy(), history["slope"].to_numpy()
    h = np.diff(history["x"].to_numpy())
    chord = 6.0 * (u[..., 1:] - u[..., :-1]) / h**2
    result = np.zeros_like(u)
    result[..., :-1] += chord - (4.0 * phi[..., :-1] + 2.0 * phi[..., 1:]) / h
    result[..., 1:] += -chord + (2.0 * phi[..., :-1] + 4.0 * phi[..., 1:]) / h
    result[..., 1:-1] *= 0.5
    return result


def held_ends(case: Case) -> list[bool]:
    """Return for both ends whether a support holds them, so that they move with the base."""
    return [kind != "free" for kind in (case.support.start, case.support.end)]


def _on_both_sides(values: FloatArray) -> FloatArray:
    """Return values of the interfaces, summed over the interfaces of each lamina."""
    none = np.zeros_like(values[:1])
    sums: FloatArray = np.concatenate([values, none]) + np.concatenate([none, values])
    return sums

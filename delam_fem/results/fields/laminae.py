"""Compute the fields of laminae: contact, forces and curvature, from the dataset of a run.

A lamina between two others has two interfaces: it shows the smaller of both gaps, and the sums of
impulses and of forces.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from delam_fem.case.definition import Case
from delam_fem.contact.laws import LAWS
from delam_fem.model.contacts import damping_at
from delam_fem.numerics.types import FloatArray
from delam_fem.results.diagnostics import between, gap_field, heat, of_laminae
from delam_fem.results.schema import by_interface, event_interfaces
from delam_fem.simulation.recorder import HIT, RESTING
from delam_fem.simulation.signals import contact_forces


def scalars_of(history: xr.Dataset, case: Case) -> dict[str, npt.NDArray[Any]]:
    """Return the scalar fields of the laminae at the frames.

    They are moment [N m], curvature [1/m], the smaller gap to the neighbours [m], contact_state,
    the impulses of all interfaces since the frame before [N s], heat (the mean power that contact
    takes over the window, of interfaces and stops) [W], and contact_force [N].

    Returns:
        By name, each of shape (n_laminae, n_frames, n_nodes).
    """
    of_interfaces, of_stops = heat(history)
    power = of_laminae(of_interfaces, np.add) + of_stops
    return {
        "moment": history["moment"].to_numpy(),
        "curvature": curvature(history),
        "gap": of_laminae(gap_field(history), np.fmin, np.inf),
        "contact_state": of_laminae(by_interface(history["contact_state"])),
        "impulse": of_laminae(impulse_of_interfaces(history), np.add),
        "heat": np.repeat(power[:, None], history.sizes["frame"], axis=1),
        "contact_force": contact_force_of_laminae(history, case),
    }


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
        interface = event_interfaces(history)
        place = np.array([interface, row, history["event_node"].to_numpy()])[:, interface >= 0]
        np.add.at(sums, tuple(place), history["event_impulse"].to_numpy()[interface >= 0])
    return sums[:, :-1]


def contact_lights(history: xr.Dataset) -> npt.NDArray[np.uint8]:
    """Return which pairs to light in a film: 0 apart, 1 hit since the frame before, 2 resting.

    Returns:
        Shape (n_frames, n_interfaces, n_nodes).
    """
    state = by_interface(history["contact_state"])
    lights = np.where(
        impulse_of_interfaces(history) > 0.0, HIT, np.where(state == RESTING, RESTING, state)
    )
    return lights.transpose(1, 0, 2).astype(np.uint8)


def contact_force_of_laminae(history: xr.Dataset, case: Case) -> FloatArray:
    """Return the forces of contact springs of resting pairs; see `contact_forces`.

    Returns:
        Sums of forces at the points, shape (n_laminae, n_frames, n_nodes) [N].
    """
    rates = between(np.zeros(1), history["velocity"].to_numpy())
    is_resting = by_interface(history["contact_state"]) == RESTING
    share = by_interface(history["spring_share"])[:, None]
    x = history["x"].to_numpy()
    neighbours = pairwise(lamina.name for lamina in case.lamina)
    damping = np.array([damping_at(case, pair, x) for pair in neighbours])
    law = case.contact.law
    has_springs = LAWS[law].spring or (law != "none" and case.is_elastic)
    spring = case.spring[0] if has_springs else 0.0, damping.reshape(-1, 1, x.size)
    forces = contact_forces(spring, gap_field(history), rates, is_resting, share)
    return of_laminae(forces, np.add)


def curvature(history: xr.Dataset) -> FloatArray:
    """Return u'' of the cubic through displacements and slopes at the ends of each cell.

    At a node between two cells it is the mean of both cells, as for the bending moment.

    Returns:
        Curvatures, shape (n_laminae, n_frames, n_nodes) [1/m].
    """
    u = history["displacement"].to_numpy()
    phi = history["slope"].to_numpy()
    h = np.diff(history["x"].to_numpy())
    chord = 6.0 * (u[..., 1:] - u[..., :-1]) / h**2
    result = np.zeros_like(u)
    result[..., :-1] += chord - (4.0 * phi[..., :-1] + 2.0 * phi[..., 1:]) / h
    result[..., 1:] += -chord + (2.0 * phi[..., :-1] + 4.0 * phi[..., 1:]) / h
    result[..., 1:-1] *= 0.5
    if "end" in history:
        x = history["x"].to_numpy()
        result[(x >= history["end"].to_numpy()[:, None])[:, None].repeat(u.shape[1], axis=1)] = 0.0
    return result


def held_ends(case: Case) -> list[bool]:
    """Return whether a support holds the start and the end, so that they move with the base."""
    return [case.support.holds("start"), case.support.holds("end")]

"""The motion of a row of points on one lamina, as a scanning vibrometer measures it."""

from __future__ import annotations

import math

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.model import fields
from delam_fem.model.layout import Layout, Structure
from delam_fem.model.pairing import interpolation
from delam_fem.numerics.arrays import FloatArray
from delam_fem.simulation.recorder import Recorder

_ROUND_OFF = 1e-9


def scan_positions(length: float, spacing: float, first: float = 0.0) -> FloatArray:
    """Return equidistant points from `first` to at most the length, shape (n,) [m].

    Raises:
        CaseError: there are fewer than five points, too few for a shape.
    """
    n = 1 + math.floor((length - first) / spacing + _ROUND_OFF) if spacing > 0.0 else 0
    if first < 0.0 or n < 5:
        raise CaseError(
            f"scan: expected at least 5 points on the length {length:g} m, given a first point at "
            f"{first:g} m and a spacing of {spacing:g} m"
        )
    return np.asarray(np.minimum(first + spacing * np.arange(n), length))


def surface_of(case: Case, lamina: str | None) -> str:
    """Return the name of the lamina that is scanned: the given one, or the thinner outermost."""
    first, *_, last = case.lamina
    return lamina or min(last, first, key=lambda own: own.thickness or math.inf).name


def part_of(layout: Layout, lamina: str) -> int:
    """Return the number of a lamina.

    Raises:
        CaseError: there is none of this name.
    """
    if lamina not in layout.names:
        raise CaseError(
            f"scan: lamina: expected one of {', '.join(layout.names)}, given {lamina!r}"
        )
    return layout.names.index(lamina)


def scan_field(
    recorder: Recorder, structure: Structure, lamina: str, x: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the motion of points at the frames of the window, in the fixed frame.

    Args:
        recorder: after a run that kept frames.
        structure: that moved.
        lamina: name of the lamina on whose surface the points are.
        x: positions of the points, shape (n,) [m].

    Returns:
        Times [s], shape (k,), displacements [m] and velocities [m/s], each of shape (k, n).
    """
    found = []
    for kind in (0, 1):
        vectors = np.concatenate([np.array(record.frames)[:, kind] for record in recorder.window])
        base = np.concatenate([r.base_states[r.frame_steps, kind] for r in recorder.window])
        fixed = 0.0 * base if recorder.is_forced else base
        found.append(at_points(structure, lamina, x, vectors, fixed))
    steps = [
        number * recorder.steps_per_period + record.frame_steps
        for number, record in enumerate(recorder.window)
    ]
    return np.concatenate(steps) * recorder.time_step, found[0], found[1]


def at_points(
    structure: Structure, lamina: str, x: FloatArray, vectors: FloatArray, base: FloatArray
) -> FloatArray:
    """Return the motion of points on a lamina, shape (k, n).

    Args:
        structure: that moves.
        lamina: its name.
        x: positions of the points, shape (n,) [m].
        vectors: values of the free dofs, shape (k, n_dofs).
        base: values of the base, shape (k,).
    """
    number = part_of(structure.layout, lamina)
    part = structure.layout.parts[number]
    cells, weights = interpolation(part, np.interp(x, part.x, np.arange(part.x.size)))
    u, phi = (own[number] for own in fields.nodal(structure.layout, vectors, base))
    ends = np.stack([u[:, cells], phi[:, cells], u[:, cells + 1], phi[:, cells + 1]])
    return np.asarray(np.einsum("ekn,ne->kn", ends, weights))

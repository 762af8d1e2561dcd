"""Compute the fields of solids, motion and stress, from the states that the recorder kept.

The dataset of a run has only what the middle lines read. The fields are written to
fields/solid.vtkhdf for ParaView, all frames on one mesh: the laminae at rest, each with points of
its own, every cell divided into linear ones between its nodes. "Warp By Vector" with the
displacement shows the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from delam_fem.case.definition import Case
from delam_fem.model.layout import Structure
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.results.fields import vtkhdf
from delam_fem.results.fields.vtkhdf import subcells
from delam_fem.results.reading import SOLID
from delam_fem.simulation.recorder import RESTING, Recorder
from delam_fem.simulation.signals import contact_forces, frames_of, law_numbers

if TYPE_CHECKING:
    from delam_fem.model.solids.body import Body, Shape


AT_ONCE = 2**22
"""How many numbers of the states are sent to the first rank in one go."""

Fields = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Frames:
    """The states of a solid at the frames of a run.

    Attributes:
        shape: the points of the laminae.
        times: times of the frames, shape (n_frames,) [s].
        motion: function that returns displacements and velocities of all nodes at a frame, shape
            (2, n_nodes, dim) [m, m/s].
        impulses: impulses on the pairs since the frame before, shape (n_frames, n_pairs) [N s].
        spans: time since the frame before, shape (n_frames,) [s].
        forces: spring forces at the pairs, shape (n_frames, n_pairs) [N].
        rise: how far the gap at rest lifts each point out of the mesh, shape (n_points,) [m].
    """

    shape: Shape
    times: FloatArray
    motion: Callable[[int], FloatArray]
    impulses: FloatArray
    spans: FloatArray
    forces: FloatArray
    rise: FloatArray

    def fields(self, frame: int) -> Fields:
        """Return the fields at the points; vectors have shape (n_points, 3), scalars (n_points,).

        displacement [m] and velocity [m/s]; stress_xx, the stress along the laminae, and von_mises
        [Pa]; contact_impulse, the impulse per area since the frame before [N s/m2];
        contact_pressure [Pa], compression positive: the mean of these impulses over the time since
        the frame before, and the springs.
        """
        from delam_fem.model.solids.forms import von_mises

        u, v = self.motion(frame)
        sigma = self.shape.recovery.stress(u)
        impulse = self._spread(self.impulses[frame])
        pressure = impulse / self.spans[frame] + self._spread(self.forces[frame])
        arrays = {
            "displacement": _vectors(u[self.shape.node]),
            "velocity": _vectors(v[self.shape.node]),
            "stress_xx": sigma[:, 0],
            "von_mises": von_mises(sigma),
            "contact_pressure": pressure,
            "contact_impulse": impulse,
        }
        return {name: values.astype(np.float32) for name, values in arrays.items()}

    def _spread(self, of_pairs: FloatArray) -> FloatArray:
        """Return values of pairs (forces or impulses) as values per area at the points."""
        pressing = self.shape.pressing
        result = np.zeros(self.shape.node.size)
        ends = np.cumsum([by_forces.shape[1] for by_forces in pressing])
        for by_forces, forces in zip(pressing, np.split(of_pairs, ends), strict=False):
            result += by_forces @ forces
        return result

    @property
    def grid(self) -> vtkhdf.Grid:
        """The laminae at rest; the field rise [m] is the height by which the gaps lift them."""
        shape, mesh = self.shape, self.shape.mesh
        points = _vectors(shape.points)
        top = mesh.points[mesh.cells[mesh.lamina == 0], 1].max()  # at y = 0, as of beams
        points[:, 1] += self.rise - top
        corners = subcells(mesh.cell, shape.degree, shape.reference_nodes)
        cells = shape.cells[:, corners].reshape(-1, corners.shape[1])
        lamina = np.repeat(mesh.lamina + 1, len(corners)).astype(np.int8)
        return vtkhdf.Grid(points, cells, mesh.cell, {"lamina": lamina}, {"rise": self.rise})


def write_solid(frames: Frames, directory: Path) -> Path:
    """Write solid.vtkhdf in a folder, which is made where it does not exist.

    Raises:
        OSError: the file cannot be written.
    """
    return vtkhdf.write(frames.grid, frames.times, frames.fields, directory / SOLID)


def collected(structure: Structure, recorder: Recorder, case: Case) -> Frames | None:
    """Return the frames of a run whose structure is a solid (collective).

    On several ranks the first one gets the displacements and velocities of all nodes.

    Returns:
        The frames; None if no finite frame was kept, or on a rank that is not the first.
    """
    body = structure.body
    steps, states, contact, base = frames_of(recorder)
    assert body is not None
    if not states:
        return None
    flags = body.solid.comm.allgather([bool(np.isfinite(state).all()) for state in states])
    finite = np.flatnonzero(np.all(flags, axis=0))  # a diverged run ends without numbers
    if not finite.size:
        return None
    finite_states = [states[k] for k in finite]
    ticks = steps[finite] * recorder.refine
    forces = _spring_forces(structure, case, finite_states, contact[finite] == RESTING)
    motion = _motion(body, finite_states, base[finite])
    shape = body.shape()
    if motion is None:
        return None
    dt = recorder.time_step / recorder.refine
    first = (recorder.n_closed - len(recorder.window)) * recorder.steps_per_period
    return Frames(
        shape,
        dt * (first * recorder.refine + ticks),
        motion,
        _impulses(recorder, ticks, structure.operators.n_pairs),
        dt * np.diff(ticks, prepend=0),
        forces,
        _rise(structure, shape),
    )


def _impulses(recorder: Recorder, ticks: IntArray, n_pairs: int) -> FloatArray:
    """Return the impulses on all pairs since the frame before, shape (n_frames, n_pairs) [N s]."""
    impacts = recorder.impacts()
    sums = np.zeros((ticks.size + 1, n_pairs))  # the last row: after the last frame
    row = np.repeat(np.searchsorted(ticks, impacts.ticks), impacts.sizes)
    np.add.at(sums, (row, impacts.hit), impacts.impulses)
    return sums[:-1]


def _spring_forces(
    structure: Structure, case: Case, states: list[FloatArray], resting: npt.NDArray[np.bool_]
) -> FloatArray:
    """Return -(k U + c U') of resting pairs at the frames (collective), (n_frames, n_pairs) [N]."""
    o, body = structure.operators, structure.body
    numbers = law_numbers(case, o)
    if body is None or not numbers.has_springs(o.n_pairs).any():
        return np.zeros(resting.shape)
    both = np.array([(o.gap_matrix @ state.T).T for state in states])
    u, v = np.sum(body.solid.comm.allgather(both), axis=0).swapaxes(0, 1)
    spring = numbers.stiffness, numbers.dampings(o.n_pairs)
    return contact_forces(spring, u + o.gap0, v, resting, o.pair_weights)


def _motion(
    body: Body, states: list[FloatArray], base: FloatArray
) -> Callable[[int], FloatArray] | None:
    """Return `Frames.motion` (collective), on several ranks on the first; None on the others."""
    if body.solid.comm.size == 1:
        return lambda frame: body.gathered(states[frame], base[frame])
    step = max(1, AT_ONCE // (2 * body.free.shape[0]))
    motions: list[FloatArray] = []
    for start in range(0, len(states), step):
        some = slice(start, start + step)
        values = body.gathered(np.concatenate(states[some]), base[some].ravel())
        motions.extend(values.reshape(len(values) // 2, 2, *values.shape[1:]))
    return motions.__getitem__ if body.is_first else None


def _rise(structure: Structure, shape: Shape) -> FloatArray:
    """Return how far the gaps at rest lift each point out of the mesh, shape (n_points,) [m]."""
    x = shape.points[:, 0]
    first = 0
    lift: dict[tuple[int, int], FloatArray] = {}
    for pairs in shape.touching:
        places, one = np.unique(pairs.x, return_index=True)
        gap0 = structure.operators.gap0[first : first + pairs.gap.size]
        first += pairs.gap.size
        beyond = (gap0 - pairs.gap)[one]  # the mesh has its own distance at the pairs
        ends = shape.mesh.points[pairs.facing.lower.ravel(), 0]
        if ends.min() < places[0]:  # held or bonded: no pair
            places = np.append(ends.min(), places)
            beyond = np.append(0.0, beyond)
        if ends.max() > places[-1]:
            places = np.append(places, ends.max())
            beyond = np.append(beyond, 0.0)
        lift[pairs.facing.parts] = np.interp(x, places, beyond)
    rise = np.zeros(x.size)
    for lower in range(int(shape.lamina.max(initial=0))):
        above = shape.lamina > lower
        rise[above] += lift.get((lower, lower + 1), np.zeros(x.size))[above]
    return rise


def _vectors(values: FloatArray) -> FloatArray:
    """Return vectors with three components, shape (n, 3)."""
    return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))

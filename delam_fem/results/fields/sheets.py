"""Show a reduced plate: the laminae as sheets of their thickness, and how far patches are open.

A reduced plate has no body, but keeps the deflection of its middle surfaces (`layout.Sheets`). The
fields are written to fields/surface.vtkhdf, all frames on one mesh: in ParaView "Warp By Vector"
with the displacement shows the motion. There are no stresses: they take the whole body.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delam_fem.model.layout import Sheets, Structure
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.results.fields import vtkhdf
from delam_fem.results.fields.solids import Fields
from delam_fem.results.reading import SURFACE
from delam_fem.simulation.recorder import Recorder
from delam_fem.simulation.signals import frames_of

_SAME = 1e-6
"""Distance within which a pair is at a point, over the length of the plate."""


@dataclass(frozen=True)
class SheetFrames:
    """The motion of a reduced plate at the frames of a run.

    Attributes:
        sheets: the middle surfaces.
        times: times of the frames, shape (n_frames,) [s].
        motion: deflections [m] and velocities [m/s], shape (n_frames, 2, n_points).
        openings: gaps of all pairs, shape (n_frames, n_pairs) [m].
        pairs: points at each pair, on the lower and the upper lamina, shape (n_pairs, 2); -1: none.
        rise: how far gaps at rest lift the points, shape (n_points,) [m].
    """

    sheets: Sheets
    times: FloatArray
    motion: FloatArray
    openings: FloatArray
    pairs: IntArray
    rise: FloatArray

    def fields(self, frame: int) -> Fields:
        """Return the fields at the points: displacement [m], velocity [m/s], opening [m].

        The opening is the gap at the pairs, on both laminae, and 0 elsewhere. Points are those at
        the bottoms of the sheets, then those at their tops.
        """
        n = len(self.sheets.points)
        vectors = np.zeros((2, n, 3))
        vectors[..., 1] = self.motion[frame]
        opening = np.zeros(n)
        for side in self.pairs.T:
            opening[side[side >= 0]] = self.openings[frame][side >= 0]
        both = np.tile(vectors, (1, 2, 1)).astype(np.float32)
        return {
            "displacement": both[0],
            "velocity": both[1],
            "opening": np.tile(opening, 2).astype(np.float32),
        }

    @property
    def grid(self) -> vtkhdf.Grid:
        """The sheets at rest, as hexahedra as thick as the laminae."""
        sheets = self.sheets
        n = len(sheets.points)
        half = np.zeros((n, 3))
        half[:, 1] = 0.5 * sheets.thickness
        middle = sheets.points.copy()
        middle[:, 1] += self.rise - sheets.points[sheets.part == 0, 1].max()
        points = np.concatenate([middle - half, middle + half])
        cells = np.concatenate([sheets.cells, sheets.cells + n], axis=1)
        lamina = (sheets.part[sheets.cells[:, 0]] + 1).astype(np.int8)
        return vtkhdf.Grid(
            points, cells, "hexahedron", {"lamina": lamina}, {"rise": np.tile(self.rise, 2)}
        )


def write_sheets(frames: SheetFrames, directory: Path) -> Path:
    """Write surface.vtkhdf in a folder, which is made where it does not exist.

    Raises:
        OSError: the file cannot be written.
    """
    return vtkhdf.write(frames.grid, frames.times, frames.fields, directory / SURFACE)


def collected(structure: Structure, recorder: Recorder) -> SheetFrames | None:
    """Return the frames of a run of a reduced plate; None: there is none, or no frames."""
    layout = structure.layout
    sheets = layout.sheets
    steps, states, _, base = frames_of(recorder)
    is_finite = [bool(np.isfinite(state).all()) for state in states]
    if sheets is None or not any(is_finite):
        return None
    chosen = np.flatnonzero(is_finite)
    motions = np.array(states)[chosen]
    drives = base[chosen]
    o = structure.operators
    pairs = np.full((o.n_pairs, 2), -1)
    rise = np.zeros(len(sheets.points))
    near = _SAME * np.ptp(sheets.points[:, 0])
    for interface in layout.interfaces:
        places = np.stack(layout.positions_of(interface), axis=1)
        for column, part in enumerate(interface.parts):
            chosen_points = np.flatnonzero(sheets.part == part)
            plan = sheets.points[chosen_points][:, [0, 2]]
            distance = np.linalg.norm(plan[None] - places[:, None], axis=2)
            at = np.where(distance.min(axis=1) <= near, chosen_points[distance.argmin(axis=1)], -1)
            pairs[interface.pairs, column] = at
            if column:
                gap0 = o.gap0[interface.pairs]
                above = sheets.part >= part
                for (x, z), gap in zip(places[gap0 > 0.0], gap0[gap0 > 0.0], strict=True):
                    away = np.hypot(sheets.points[:, 0] - x, sheets.points[:, 2] - z)
                    rise[above & (away <= near)] += gap
    read = [sheets.of(motions[:, k], drives[:, k]) for k in (0, 1)]
    first = (recorder.n_closed - len(recorder.window)) * recorder.steps_per_period
    return SheetFrames(
        sheets,
        (first + steps[chosen]) * recorder.time_step,
        np.stack(read, axis=1),
        (o.gap_matrix @ motions[:, 0].T).T + o.gap0,
        pairs,
        rise,
    )

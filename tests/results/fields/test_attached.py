"""Pictures of solids show stops, supports and masses where they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from plates import THICKNESS, plate

from delam_fem import run
from delam_fem.results.fields import animation
from delam_fem.results.fields.vtkhdf import Series

GAP, AMPLITUDE, LENGTH, WIDTH = 1e-4, 1e-3, 0.2, 0.1
THICK, FACTOR = 5.0, 10.0


class Meshes:
    """Stands for a plotter and keeps the meshes by their names."""

    def __init__(self) -> None:
        self.bounds: dict[str, np.ndarray] = {}

    def add_mesh(self, mesh: pv.PolyData, *, name: str, **_: object) -> None:
        self.bounds[name] = np.reshape(mesh.bounds, (3, 2))


def test_blocks_and_balls_are_at_their_places_on_a_plate(tmp_path: Path) -> None:
    """They move with the base, stand on the ground, or ride on the plate."""
    case = plate(
        {}, 6, 6, width=WIDTH, support=[
            {"side": "start", "kind": "clamped"},
            {"position": 0.15, "kind": "pinned"},
            {"position": [0.1, 0.025], "kind": "pinned"},
        ],
        stop=[
            {"lamina": "sheet", "position": [0.05, -0.025], "side": "above", "gap": GAP},
            {
                "lamina": "sheet", "position": [0.05, 0.025], "side": "below", "gap": GAP,
                "on": "ground",
            },
        ],
        point_mass=[
            {"lamina": "sheet", "mass": 0.01, "position": [0.2, 0.05], "surface": "top"},
        ],
        excitation={"kind": "harmonic", "frequency": 50.0, "amplitude": AMPLITUDE},
        contact={"law": "newton", "impulse": "consistent"},
        time={"steps_per_period": 8, "periods": 1},
        output={"window_periods": 1, "fields_per_period": 4},
    )  # fmt: skip
    result = run(case)
    result.save(tmp_path, figures=False)
    series = Series.read(tmp_path / "fields" / "solid.vtkhdf")
    attached = animation._Attached(series, result.history, case, THICK, FACTOR)
    frame = 0
    points = series.drawn(series.field("displacement", frame), THICK, FACTOR)
    plotter = Meshes()
    attached.show(plotter, points, frame)  # type: ignore[arg-type]
    base = AMPLITUDE * np.sin(2.0 * np.pi * 50.0 * series.times[frame])
    assert abs(base) > 0.5 * AMPLITUDE
    bottom, top = -THICK * THICKNESS, 0.0
    for number, (x, z, side, face) in enumerate(
        [
            (0.05, -0.025, 1, top + FACTOR * (GAP + base)),
            (0.05, 0.025, -1, bottom - FACTOR * GAP),
            (0.15, 0.0, -1, bottom + FACTOR * base),
            (0.1, 0.025, -1, bottom + FACTOR * base),
        ]
    ):
        block = plotter.bounds[f"mark {number}"]
        np.testing.assert_allclose(block[[0, 2]].mean(axis=1), [x, z], atol=1e-5)
        assert block[1, 0 if side > 0 else 1] == pytest.approx(face, abs=1e-7)
        is_whole = number == 2
        assert np.ptp(block[2]) == pytest.approx(WIDTH if is_whole else 0.02 * LENGTH, abs=1e-5)
    ball = plotter.bounds["mass 0"]
    corner = np.flatnonzero(np.all(np.isclose(series.points, [LENGTH, 0.0, 0.05]), axis=1))
    assert ball[1].mean() - 0.5 * np.ptp(ball[0]) == pytest.approx(points[corner[0], 1], abs=1e-4)
    np.testing.assert_allclose(ball[[0, 2]].mean(axis=1), points[corner[0], [0, 2]], atol=1e-5)

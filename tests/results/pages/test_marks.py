"""Films and ParaView show stops, impactors and supports inside the span where their faces are."""

from __future__ import annotations

import numpy as np

from delam_fem import run
from delam_fem.api import Case
from delam_fem.results.fields.pictures import CORNERS, Ribbons
from delam_fem.results.figures.run import contact_line
from delam_fem.results.pages.report import film

T, GAP = 0.002, 1e-3
LAMINA = {
    "name": "one", "length": 0.5, "width": 0.02, "thickness": T, "mass_per_length": 0.1,
    "bending_stiffness": 10.0, "damping_ratio": 0.01,
}  # fmt: skip


def test_stops_and_supports_are_marked() -> None:
    """Above or below by half a thickness and the gap; those on the base move with it."""
    stops = [
        {"lamina": "one", "position": 0.5, "side": "both", "gap": GAP, "on": "ground"},
        {"lamina": "one", "position": 0.375, "side": "above", "gap": GAP},
    ]
    case = Case(
        name="marks", lamina=[LAMINA], mesh={"elements": 8}, stop=stops,
        support=[{"position": 0.26, "kind": "pinned"}],  # inside an element
        excitation={"kind": "harmonic", "amplitude": 2e-3, "frequency": 20.0},
        contact={"law": "newton"}, time={"steps_per_period": 400, "periods": 2},
        output={"window_periods": 2},
    )  # fmt: skip
    history = run(case, engine="compiled").history
    scene = film(history, case)
    assert scene is not None
    above, below, carried, pin = scene.data["stops"]
    factor = scene.data["factor"]
    base = history["base_displacement"].sel(time=history["frame"], method="nearest").to_numpy()
    middle = -T / 2.0
    for mark, x, y in (
        (above, 0.5, middle + T / 2.0 + factor * GAP),
        (below, 0.5, middle - T / 2.0 - factor * GAP),
        (carried, 0.375, middle + T / 2.0 + factor * (GAP + base)),
        (pin, 0.26, middle - T / 2.0 + factor * base),
    ):
        np.testing.assert_allclose(mark["x"], 1e3 * x)
        np.testing.assert_allclose(mark["y"], 1e3 * y * np.ones(base.size), atol=1e-5)
    assert [mark["side"] for mark in (above, below, carried, pin)] == [1, -1, 1, -1]
    states = history["stop_state"].to_numpy()
    assert states[:, :2].any() and not states[:, :2].all()
    for mark, state in zip((above, below, carried), states.T, strict=True):
        np.testing.assert_array_equal(mark["lit"], state)
    assert not any(pin["lit"])


def test_blocks_stand_for_them_in_paraview() -> None:
    """At rest a gap from the lamina; then at rest, with the base, or as the impactor moves."""
    stops = [
        {"lamina": "one", "position": 0.5, "side": "below", "gap": GAP, "on": "ground"},
        {"lamina": "one", "position": 0.375, "side": "above", "gap": 2.0 * GAP},
    ]
    blow = {"lamina": "one", "position": 0.3, "mass": 0.02, "gap": 0.5 * GAP, "spring": 500.0}
    case = Case(
        name="marks", lamina=[LAMINA], mesh={"elements": 8}, stop=stops, impactor=[blow],
        support=[{"position": 0.13, "kind": "pinned"}],  # inside an element
        excitation={"kind": "harmonic", "amplitude": 2e-3, "frequency": 20.0},
        contact={"law": "newton"}, time={"steps_per_period": 400, "periods": 2},
        output={"window_periods": 2},
    )  # fmt: skip
    history = run(case, engine="compiled").history
    bodies = Ribbons.of(history, case)
    mesh, n = bodies.mesh, bodies.rest.size // 3
    assert mesh.cell_data["lamina"].tolist() == [1] * (history.sizes["node"] - 1) + [0] * 4
    blocks = mesh.points[n:].reshape(4, 2 * CORNERS, 3)
    np.testing.assert_allclose(blocks[:, :, 0].mean(axis=1), [0.5, 0.375, 0.3, 0.13])
    low, high = blocks[:, :, 1].min(axis=1), blocks[:, :, 1].max(axis=1)
    np.testing.assert_allclose(high - low, T)
    np.testing.assert_allclose(
        [high[0], low[1], low[2], high[3]], [-T - GAP, 2.0 * GAP, 0.5 * GAP, -T]
    )
    cells = mesh.points[mesh.cells[-4:]]
    edges = cells[:, [1, 3, 4]] - cells[:, :1]
    assert (np.linalg.det(edges) > 0.0).all()
    frame = 30
    data = bodies.point_data(frame)
    moved = data["displacement"][n:].reshape(4, 2 * CORNERS, 3)
    at = {"time": history["frame"][frame], "method": "nearest"}
    base, mass = (
        float(history[name].sel(**at).squeeze())
        for name in ("base_displacement", "impactor_displacement")
    )
    assert abs(base) > 1e-5
    assert abs(mass) > 1e-6
    for points, y in zip(moved, (0.0, base, mass, base), strict=True):
        np.testing.assert_allclose(points, np.tile([0.0, y, 0.0], (2 * CORNERS, 1)), atol=1e-12)
    states = np.array([bodies.point_data(k)["contact_state"][n :: 2 * CORNERS] for k in (0, frame)])
    np.testing.assert_array_equal(states[:, :3], history["stop_state"].to_numpy()[[0, frame]])
    assert all(len(values) == len(mesh.points) for values in data.values())
    labels = contact_line(history, case).axes[0].get_legend_handles_labels()[1]
    assert labels[:2] == ["stop", "impactor"]

"""A film marks stops where their faces are, and supports inside the span."""

from __future__ import annotations

import numpy as np

from delam_fem import run
from delam_fem.case.definition import Case
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
        support=[{"position": 0.25, "kind": "pinned"}],
        excitation={"kind": "harmonic", "amplitude": 2e-3, "frequency": 20.0},
        contact={"law": "newton"}, time={"steps_per_period": 400, "periods": 2},
        output={"window_periods": 2},
    )  # fmt: skip
    history = run(case, engine="compiled").history
    found = film(history, case)
    assert found is not None
    above, below, carried, pin = found.data["stops"]
    factor = found.data["factor"]
    base = history["base_displacement"].sel(time=history["frame"], method="nearest").to_numpy()
    middle = -T / 2.0
    for mark, x, y in (
        (above, 0.5, middle + T / 2.0 + factor * GAP),
        (below, 0.5, middle - T / 2.0 - factor * GAP),
        (carried, 0.375, middle + T / 2.0 + factor * (GAP + base)),
        (pin, 0.25, middle - T / 2.0 + factor * base),
    ):
        np.testing.assert_allclose(mark["x"], 1e3 * x)
        np.testing.assert_allclose(mark["y"], 1e3 * y * np.ones(base.size), atol=1e-5)
    assert [mark["side"] for mark in (above, below, carried, pin)] == [1, -1, 1, -1]
    assert any(above["lit"]) or any(below["lit"])

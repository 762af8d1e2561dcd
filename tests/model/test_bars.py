"""Bars: frequencies of linear elements, waves, damping of every mode, statics, engines."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from project import ROOT

from delam_fem import CaseError, load_case, run
from delam_fem.api import Case, assemble
from delam_fem.engines.session import ENGINES
from delam_fem.model.layout import point_load

E, RHO, L, AREA = 2e11, 7800.0, 1.0, 1e-4
BAR = {
    "name": "one", "motion": "axial", "length": L, "width": 0.01, "thickness": 0.01, "density": RHO,
    "young_modulus": E, "damping_ratio": 0.02,
}  # fmt: skip
FORCE = {"kind": "force", "lamina": "one", "position": L, "amplitude": 0.0, "frequency": 100.0}

SHAKER = {"kind": "harmonic", "amplitude": 1e-4, "frequency": 100.0}


def case_of(**sections: Any) -> Case:
    data = {
        "name": "bar", "lamina": [BAR], "mesh": {"elements": 8}, "excitation": FORCE,
        "contact": {"law": "penalty"}, "damping": {"rayleigh": "every mode"},
    }  # fmt: skip
    return Case(**(data | sections))


def test_frequencies_are_those_of_linear_elements() -> None:
    """ω² = 6 E/(ρ h²) (1 - cos θ)/(2 + cos θ), θ = (2k - 1) π/2n; lumped: 3 in place of the sum."""
    n = 8
    angle = (np.arange(n) + 0.5) * np.pi / n
    for mass, expected in (
        ("consistent", 6.0 * (1.0 - np.cos(angle)) / (2.0 + np.cos(angle))),
        ("lumped", 2.0 * (1.0 - np.cos(angle))),
    ):
        o = assemble(case_of(time={"mass": mass}), needs_dolfinx=False).operators
        eigenvalues = scipy.linalg.eigh(o.stiffness.toarray(), o.mass.toarray(), eigvals_only=True)
        np.testing.assert_allclose(eigenvalues, expected * E / RHO * n**2 / L**2, rtol=1e-9)


@pytest.mark.parametrize("ends", [("clamped", "free"), ("free", "clamped"), ("free", "free")])
def test_each_mode_has_the_ratio_and_rigid_motions_no_force(ends: tuple[str, str]) -> None:
    case = case_of(excitation=SHAKER, support=dict(zip(("start", "end"), ends, strict=True)))
    o = assemble(case, needs_dolfinx=False).operators
    squares, shapes = scipy.linalg.eigh(o.stiffness.toarray(), o.mass.toarray())
    ratios = shapes.T @ o.damping @ shapes
    expected = 2.0 * 0.02 * np.sqrt(np.maximum(squares, 0.0))
    np.testing.assert_allclose(ratios, np.diag(expected), atol=1e-6 * expected.max())
    for matrix, column in ((o.stiffness, o.base.stiffness), (o.damping, o.base.damping)):
        force = matrix @ np.ones(o.n_dofs) + column
        np.testing.assert_allclose(force, 0.0, atol=1e-9 * matrix.max())
    mass = float(np.ones(o.n_dofs) @ (o.mass @ np.ones(o.n_dofs) + 2.0 * o.base.mass))
    assert mass + o.base.corner[0] == pytest.approx(RHO * AREA * L)


def test_a_force_between_nodes_stretches_what_is_before_it() -> None:
    """u(x) = F x/EA at and beyond the force: straight between nodes, so exact at nodes."""
    structure = assemble(case_of(), needs_dolfinx=False)
    o, x = structure.operators, 0.7 * L
    load = point_load(structure.layout, structure.layout.parts[0], x, o.n_dofs)
    u = scipy.linalg.solve(o.stiffness.toarray(), load)
    assert u[-1] == pytest.approx(x / (E * AREA), rel=1e-12)
    assert u[3] == pytest.approx(0.5 * L / (E * AREA), rel=1e-12)


def test_a_bar_leaves_a_wall_after_two_passages_of_the_wave() -> None:
    """Force ρ c A v for 2 L/c, then a rebound with nearly the whole velocity (d'Alembert)."""
    c, v = math.sqrt(E / RHO), 0.1
    case = case_of(
        lamina=[BAR | {"damping_ratio": 0.0}], mesh={"elements": 200},
        support={"start": "free", "end": "free"}, damping={"rayleigh": "two-mode"},
        initial=[{"velocity": v}], stop=[{"lamina": "one", "side": "above", "gap": 0.0,
                                         "stiffness": 2e9}],
        sensor=[{"name": "wall", "quantity": "contact force", "stop": 1}],
        excitation=FORCE | {"frequency": c / (3.0 * L)},
        time={"steps_per_period": 3000, "periods": 1}, output={"window_periods": 1},
    )  # fmt: skip
    history = run(case, engine="compiled").history
    force = history["sensor_wall"].to_numpy()
    step = 3.0 * L / c / 3000
    assert np.flatnonzero(force)[-1] * step == pytest.approx(2.0 * L / c, rel=0.02)
    assert force.sum() * step == pytest.approx(2.0 * RHO * AREA * L * v, rel=0.01)
    assert force[1000] == pytest.approx(RHO * c * AREA * v, rel=0.02)


def test_engines_agree_on_the_rod() -> None:
    case = load_case(ROOT / "docs/examples/others/rod.toml").with_overrides({"time.periods": 15})
    one, other = (run(case, engine=engine) for engine in ENGINES)
    name = "tip_displacement"
    np.testing.assert_allclose(one.history[name], other.history[name], rtol=0.0, atol=1e-9)
    assert float(one.history[name].max()) > 2e-4, "the stop is struck"
    assert max(one.summary["energy_residual"], other.summary["energy_residual"]) < 1e-8


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"lamina": [BAR, BAR | {"name": "two", "motion": "lateral"}], "gap": {"tip": 1e-3}},
         "lamina: .*given several"),
        ({"model": {"kind": "solid"}}, r"model\.kind: "),
        ({"support": [{"side": "end", "kind": "pinned", "rotational_stiffness": 1.0}]},
         "support: "),
        ({"lamina": [BAR | {"motion": "lateral"}]}, r"damping\.rayleigh: "),
        ({"sensor": [{"name": "s", "quantity": "strain", "lamina": "one", "position": 0.5}]},
         "sensor: "),
    ],
)  # fmt: skip
def test_what_bars_do_not_have_is_told(change: dict[str, Any], expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        case_of(**change)


def test_bars_keep_the_mass_of_their_nodes() -> None:
    with pytest.raises(CaseError, match=r"time.mass: "):
        case_of(time={"mass": "massless"}, contact={"law": "none"})

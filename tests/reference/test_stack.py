"""Bonded stacks of the reference beside both assemblers of the package, and in motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from delam_fem import compare
from delam_fem.api import Case, CaseError, assemble, preset
from delam_fem.reference import matrices
from delam_fem.reference.compare import operator_differences

ROUND_OFF = 1e-9
"""Relative to the diagonal; the saddle point problem loses digits."""
SIZES = {"length": 0.4, "width": 0.02}
LAMINAE = [
    {"name": "a", "thickness": 0.001, "material": "steel", "damping_ratio": 0.01, **SIZES},
    {"name": "b", "thickness": 0.002, "material": "glass-epoxy", "damping_ratio": 0.02, **SIZES},
    {"name": "c", "thickness": 0.0005, "material": "aluminium", "damping_ratio": 0.005, **SIZES},
]
CROSSING = [
    {"between": ["a", "b"], "start": 0.1, "end": 0.25, "opening": 1e-3},
    {"between": ["b", "c"], "start": 0.2, "end": 0.4},
]
TOUCHING = [
    {"between": ["a", "b"], "start": 0.0, "end": 0.2},
    {"between": ["b", "c"], "start": 0.2, "end": 0.3},
]


def case(delaminations: list[dict[str, object]], supports: str, **overrides: object) -> Case:
    start, end = supports.split()
    data = {
        "lamina": LAMINAE,
        "delamination": delaminations,
        "mesh.elements": 8,
        "support.start": start,
        "support.end": end,
    }
    return preset("embedded", data | overrides)


@pytest.mark.parametrize("delaminations", [CROSSING, TOUCHING])
@pytest.mark.parametrize(
    ("supports", "yields"),
    [
        ("clamped clamped", False),
        ("pinned clamped", False),
        ("clamped free", False),
        ("free free", False),
        ("free pinned", False),
        ("clamped clamped", True),
        ("free clamped", True),
    ],
)
@pytest.mark.parametrize("mass", ["consistent", "lumped"])
def test_constraints_give_what_the_transformation_gives(
    delaminations: list[dict[str, object]], supports: str, yields: bool, mass: str
) -> None:
    turn = {"support.rotational_stiffness": 20.0} if yields else {}
    stack_case = case(delaminations, supports, **{"time.mass": mass}, **turn)
    made = assemble(stack_case, needs_dolfinx=False)
    expected = matrices.assemble(stack_case, made.layout.x, made.layout.probes[0].point)
    differences = operator_differences(made.operators, expected)
    assert max(differences.values()) < ROUND_OFF, differences


@pytest.mark.parametrize("kind", ["stiffness", "mass"])
def test_damping_models_agree(kind: str) -> None:
    stack_case = case(CROSSING, "clamped clamped", **{"damping.rayleigh": kind})
    made = assemble(stack_case, needs_dolfinx=False)
    expected = matrices.assemble(stack_case, made.layout.x, 3)
    assert operator_differences(made.operators, expected)["C"] < ROUND_OFF


@pytest.mark.parametrize("end", ["start", "end"])
def test_openings_agree(end: str, tmp_path: Path) -> None:
    edges = {"start": 0.0, "end": 0.2} if end == "start" else {"start": 0.2, "end": 0.4}
    supports = "free clamped" if end == "start" else "clamped free"
    (tmp_path / "t.csv").write_text("x,gap\n0,0\n0.1,1e-3\n0.17,2e-3\n0.3,1e-3\n0.4,0\n")
    shapes: list[dict[str, object]] = [
        {"shape": "power", "exponent": 1.5, "opening": 2e-3},
        {"opening": 2e-3},
        {"file": str(tmp_path / "t.csv")},
    ]
    for shape in shapes:
        stack_case = case([{"between": ["a", "b"], **edges, **shape}], supports)
        made = assemble(stack_case, needs_dolfinx=False)
        expected = matrices.assemble(stack_case, made.layout.x, 3)
        assert made.operators.gap0.max() > 1e-3
        assert made.operators.gap0 == pytest.approx(expected.gap0, abs=1e-15)


def test_the_embedded_beam_moves_alike_over_its_first_impacts() -> None:
    newmark = {"time.scheme": "newmark", "mesh.elements": 20}
    comparison = compare(preset("embedded", newmark), periods=2, impacts=1000)
    motion = comparison.motion
    assert motion is not None
    assert motion.impacts[0] == motion.impacts[1] > 1000
    assert np.ptp(motion.values) > 1e-6
    assert motion.until_impact < 1e-8
    assert comparison.frequencies < 1e-8


PARTED = [{"between": [*pair], "start": 0.0, "end": 0.4, "opening": 1e-3} for pair in ("ab", "bc")]


@pytest.mark.parametrize("opening", [{"delamination": PARTED}, {"gap": {"tip": 1e-3}}])
def test_three_laminae_that_are_apart_are_cantilevers(opening: dict[str, object]) -> None:
    keys = {"lamina": LAMINAE, "mesh.elements": 8, "time.scheme": "newmark"}
    data = keys | opening | {"delamination": opening.get("delamination"), "support": None}
    if "delamination" in opening:
        data["support"] = {"start": "clamped", "end": "free"}
    comparison = compare(preset("embedded", data), periods=1, impacts=10)
    assert max(comparison.matrices.values()) < ROUND_OFF and comparison.frequencies < ROUND_OFF
    assert comparison.motion is not None and comparison.motion.until_impact < ROUND_OFF


def test_points_inside_elements_are_refused() -> None:
    stack_case = case(CROSSING, "clamped clamped", **{"contact.points_per_element": 2})
    with pytest.raises(CaseError, match=r"expected contact\.points_per_element = 1"):
        matrices.assemble(stack_case, np.linspace(0.0, 0.4, 9), 3)

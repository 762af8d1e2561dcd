"""Supports inside the span beside exact frequencies and statics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from delam_fem import CaseError, run
from delam_fem.api import Case, assemble, lowest
from delam_fem.engines.session import ENGINES

EI, L, RHO_A = 10.0, 0.5, 0.1
LAMINA = {
    "name": "one", "length": L, "width": 0.02, "thickness": 0.002, "mass_per_length": RHO_A,
    "bending_stiffness": EI, "damping_ratio": 0.01,
}  # fmt: skip
PINNED = {"start": "pinned", "end": "pinned"}


def case_of(*supports: dict[str, Any], **sections: Any) -> Case:
    data = {
        "name": "support", "lamina": [LAMINA], "mesh": {"elements": 16}, "support": [*supports],
        "excitation": {"kind": "harmonic", "amplitude": 1e-4, "frequency": 20.0},
        "contact": {"law": "newton"}, "time": {"steps_per_period": 500, "periods": 3},
        "output": {"window_periods": 3},
    }  # fmt: skip
    return Case(**(data | sections))


def first(case: Case, n: int = 1) -> float:
    o = assemble(case, needs_dolfinx=False).operators
    return float(lowest(o.stiffness, o.mass, n)[0][-1])


def test_a_pin_leaves_the_modes_that_have_a_node_there() -> None:
    """The first mode of three pins at equal distances is the second of two."""
    case = case_of(PINNED, {"position": 0.5 * L, "kind": "pinned"})
    exact = (2.0 * np.pi / L) ** 2 * np.sqrt(EI / RHO_A) / (2.0 * np.pi)
    assert first(case) == pytest.approx(exact, rel=1e-4)


def test_a_clamp_leaves_a_cantilever() -> None:
    """At a place that is no node of a uniform mesh."""
    case = case_of({"position": 0.37 * L, "kind": "clamped"})
    exact = (1.875104 / (0.63 * L)) ** 2 * np.sqrt(EI / RHO_A) / (2.0 * np.pi)
    assert first(case) == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("kind", ["pinned", "clamped"])
def test_stiff_springs_are_rigid_supports(kind: str) -> None:
    """Also inside an element, and whichever assembly it is; a soft spring is none."""
    place, stiff = {"position": 0.37 * L}, {"stiffness": 1e8}
    if kind == "clamped":
        stiff["rotational_stiffness"] = 1e6
    rigid, spring = (
        first(case_of(PINNED, place | support))
        for support in ({"kind": kind}, {"kind": "spring"} | stiff)
    )
    assert spring == pytest.approx(rigid, rel=2e-2)  # no element bends to both sides of a clamp
    soft = first(case_of(PINNED, place | {"kind": "spring", "stiffness": 1e-6}))
    free = first(case_of(PINNED))
    assert soft == pytest.approx(free, rel=1e-6)
    case = case_of(PINNED, place | {"kind": "spring"} | stiff)
    one, other = assemble(case).operators, assemble(case, needs_dolfinx=False).operators
    difference = abs(one.stiffness - other.stiffness).max()
    assert difference < 1e-9 * abs(other.stiffness).max()


def test_a_spring_at_a_place_moves_smoothly_with_it() -> None:
    """The frequency over the position has no steps where elements end."""
    at = np.linspace(0.3, 0.45, 31) * L
    spring = {"kind": "spring", "stiffness": 2e3}
    f = np.array([first(case_of(PINNED, spring | {"position": float(x)})) for x in at])
    assert np.abs(np.diff(f, 2)).max() < 0.04 * np.abs(np.diff(f)).max()


@pytest.mark.parametrize("place", [0.01, 0.5, 0.99])
def test_a_spring_holds_no_node(place: float) -> None:
    """The reference is the middle, as without it, also where the node nearest to it is an end."""
    case = case_of(PINNED, {"position": place * L, "kind": "spring", "stiffness": 10.0})
    (probe,) = assemble(case, needs_dolfinx=False).layout.probes
    assert probe == assemble(case_of(PINNED), needs_dolfinx=False).layout.probes[0]


def test_a_slow_base_carries_springs_and_pins_along() -> None:
    slow = {"kind": "harmonic", "amplitude": 1e-3, "frequency": 0.2}
    spring = {"position": 0.6 * L, "kind": "spring", "stiffness": 1e4, "damping": 0.1}
    case = case_of(spring, {"position": 0.3 * L, "kind": "pinned"}, excitation=slow)
    history = run(case, engine="compiled").history
    moved = history["displacement"][0, -1] - history["base_displacement"][-1]
    assert np.abs(moved).max() < 1e-2 * 1e-3
    assert abs(float(history["tip_displacement"].max()) / 1e-3 - 1.0) < 1e-2


def test_engines_agree_and_the_ledger_closes() -> None:
    """With springs that damp, a pin beside two laminae, and stops."""
    stop = {"lamina": "one", "side": "both", "gap": 5e-5, "position": 0.8 * L}
    spring = {"position": 0.63 * L, "kind": "spring", "stiffness": 300.0, "damping": 0.5}
    supports = [{"position": 0.4 * L, "kind": "pinned", "rotational_stiffness": 5.0}, spring]
    two = {
        "lamina": [LAMINA, LAMINA | {"name": "two", "bending_stiffness": 4.0}],
        "delamination": [
            {"between": ["one", "two"], "start": 0.0, "end": L, "opening": 1e-4, "shape": "power"}
        ],
    }
    for sections in ({}, two):
        case = case_of(*supports, stop=[stop], **sections)
        case = case.with_overrides({"excitation.amplitude": 5e-4})
        results = [
            run(case, engine=name, structure=assemble(case, needs_dolfinx=False))
            for name in ENGINES
        ]
        both = [result.history["tip_displacement"].to_numpy() for result in results]
        n = np.searchsorted(results[0].history["time"], results[0].history["event_time"][:10])[-1]
        np.testing.assert_allclose(both[0][:, :n], both[1][:, :n], rtol=0.0, atol=1e-9)
        for result in results:
            assert result.summary["energy_residual"] < 1e-8


def test_supports_survive_files_and_overrides() -> None:
    case = case_of(PINNED, {"position": 0.2, "kind": "pinned"})
    assert Case.from_toml(case.to_toml()) == case
    moved = case.with_overrides({"support.2.position": 0.31})
    assert moved.support.inside[0].position == 0.31
    assert moved.support.start == "pinned"
    assert first(moved) != pytest.approx(first(case), rel=1e-2)


@pytest.mark.parametrize(
    ("supports", "expected"),
    [
        ([{"position": 0.6, "kind": "pinned"}], "support.*given 0.6"),
        ([{"position": 0.2, "kind": "pinned"}] * 2, "apart from the ends and from one another"),
        ([{"position": 0.2, "kind": "spring"}], "stiffness: missing"),
        ([{"position": 0.2, "kind": "pinned", "stiffness": 1.0}], "stiffness: "),
        ([{"position": 0.2, "kind": "spring", "stiffness": -1.0}], "stiffness: "),
        ([{"position": 0.2, "kind": "pinned", "lamina": "x"}], "expected one of one, given 'x'"),
        ([PINNED, PINNED], "missing, but required of all"),
    ],
)
def test_bad_supports_are_told(supports: list[dict[str, Any]], expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        case_of(*supports)


@pytest.mark.parametrize(
    ("inner", "rigid"),
    [
        ({"kind": "pinned"}, 1),
        ({"kind": "pinned", "rotational_stiffness": 5.0}, 0),
        ({"kind": "clamped"}, 0),
        ({"kind": "spring", "stiffness": 100.0}, 1),
    ],
)
def test_what_inner_supports_leave_free_of_a_beam(inner: dict[str, object], rigid: int) -> None:
    ends = {"start": "free", "end": "free"}
    assert case_of(ends, {"position": 0.3 * L} | inner).n_rigid == rigid

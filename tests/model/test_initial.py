"""Points in place of beams, and initial states, beside exact solutions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from delam_fem import CaseError, Result, preset as df_preset, run
from delam_fem.api import Case, EngineName, Structure, assemble
from delam_fem.engines.session import ENGINES

M, K, D = 2.0, 800.0, 0.05
"""Angular frequency 20 rad/s."""
POINT = {"name": "one", "mass": M, "stiffness": K, "damping_ratio": D}
EI, L = 10.0, 0.5
BEAM = {
    "name": "one", "length": L, "width": 0.02, "thickness": 0.002, "mass_per_length": 0.1,
    "bending_stiffness": EI, "damping_ratio": 0.0,
}  # fmt: skip


def case_of(lamina: dict[str, Any], *initial: dict[str, Any], **sections: Any) -> Case:
    data = {
        "name": "start", "lamina": [lamina], "mesh": {"elements": 1 if "mass" in lamina else 8},
        "excitation": {"kind": "harmonic", "amplitude": 0.0, "frequency": 5.0},
        "contact": {"law": "none"}, "initial": initial,
        "time": {"steps_per_period": 2000, "periods": 3}, "output": {"window_periods": 3},
    }  # fmt: skip
    return Case(**(data | sections))


def motion(result: Result) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    history = result.history
    return tuple(history[n].to_numpy() for n in ("time", "tip_displacement", "tip_velocity"))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_point_swings_as_it_must(engine: EngineName) -> None:
    case = case_of(POINT, {"displacement": 2e-3}, {"velocity": -0.03})
    t, (u,), _ = motion(run(case, engine=engine))
    omega = np.sqrt(K / M)
    damped_omega = omega * np.sqrt(1.0 - D**2)
    b = (-0.03 + D * omega * 2e-3) / damped_omega
    exact = np.exp(-D * omega * t) * (
        2e-3 * np.cos(damped_omega * t) + b * np.sin(damped_omega * t)
    )
    np.testing.assert_allclose(u, exact, atol=1e-8)


def test_a_base_moves_a_point_by_spring_and_damper() -> None:
    """Absolute transmissibility sqrt((1 + (2 D r)²) / ((1 - r²)² + (2 D r)²))."""
    shaker = {"kind": "harmonic", "amplitude": 1e-3, "frequency": 5.0}
    case = case_of(POINT, excitation=shaker).with_overrides({"time.periods": 60})
    _, (u,), _ = motion(run(case, engine="compiled"))
    r = 2.0 * np.pi * 5.0 / np.sqrt(K / M)
    exact = 1e-3 * np.hypot(1.0, 2 * D * r) / np.hypot(1.0 - r**2, 2.0 * D * r)
    assert np.abs(u).max() == pytest.approx(exact, rel=1e-3)


def test_a_beam_begins_in_a_mode_or_bent_by_a_force() -> None:
    case = case_of(BEAM, {"shape": "mode", "mode": 2, "displacement": -1e-3})
    t, (u,), _ = motion(run(case, engine="compiled"))
    omega = float(case.lamina[0].angular_frequencies(2)[1])
    np.testing.assert_allclose(u[:400], -1e-3 * np.cos(omega * t[:400]), atol=3e-5)  # of the steps
    bent = {"lamina": "one", "shape": "force", "position": 0.6 * L, "displacement": 1e-3}
    fast = case_of(BEAM, bent).with_overrides({"time.steps_per_period": 100000, "time.periods": 1})
    start = run(
        fast.with_overrides({"output.fields_per_period": 100000}), engine="compiled"
    ).history
    x, u0 = start["x"].to_numpy(), start["displacement"][0, 0].to_numpy()
    a = 0.6 * L
    exact = np.where(x < a, x**2 * (3.0 * a - x), a**2 * (3.0 * x - a))
    np.testing.assert_allclose(u0, 1e-3 * exact / exact[-1], atol=1e-6)


@pytest.mark.parametrize("kind", ["base", "ground"])
def test_a_start_counts_in_the_fixed_frame_beside_any_stop(kind: str) -> None:
    """A stop on the base changes the dofs, not the state that they begin with."""
    shaker = {"kind": "harmonic", "amplitude": 1e-3, "frequency": 5.0}
    stop = {"lamina": "one", "side": "above", "gap": 1.0, "on": kind}
    case = case_of(POINT, {"velocity": 0.1}, excitation=shaker, stop=[stop])
    _, (u,), (v,) = motion(run(case, engine="compiled"))
    assert v[0] == pytest.approx(0.1, rel=1e-2)
    assert abs(u[0]) < 1e-4


@pytest.mark.parametrize(
    ("lamina", "initial", "sections", "expected"),
    [
        (POINT, [{"lamina": "two"}], {}, r"initial\.1\.lamina: .*given 'two'"),
        (POINT, [{"mode": 2}], {}, "mode: "),
        (POINT, [], {"mesh": {"elements": 2}}, r"expected of points mesh\.elements = 1"),
        ({"name": "one", "mass": 1.0, "damping_ratio": 0.0}, [], {}, r"stiffness: missing"),
        (POINT | {"mass": -1.0}, [], {}, "mass: "),
        (POINT, [{"shape": "mode", "mode": 3}], {}, r"initial\.1\.mode: "),
    ],
)
def test_bad_input_is_told(
    lamina: dict[str, Any], initial: list[dict[str, Any]], sections: dict[str, Any], expected: str
) -> None:
    with pytest.raises(CaseError, match=expected):
        run(case_of(lamina, *initial, **sections), engine="compiled")


SLENDER = {
    "name": "one", "length": L, "width": 0.02, "thickness": 0.002, "mass_per_length": 0.1,
    "damping_ratio": 0.0,
}  # fmt: skip
BENT, STRETCHED = SLENDER | {"bending_stiffness": EI}, SLENDER | {
    "young_modulus": 2e9, "motion": "axial",
}  # fmt: skip
FREE_FREE = [0.0, 0.0, 4.7300407, 7.8532046, 10.9956079, 14.1371655]
PINNED_FREE = [0.0, 3.9266023, 7.0685827, 10.2101761, 13.3517688]
PI = np.pi
ROOTS = {  # of the beam: βL, of the bar: ω L/c; rigid motions have 0 (Blevins, Formulas, table 8-1)
    ("beam", "free", "free"): FREE_FREE,
    ("beam", "pinned", "free"): PINNED_FREE,
    ("beam", "clamped", "free"): [1.8751041, 4.6940911, 7.8547574, 10.9955407],
    ("beam", "clamped", "pinned"): PINNED_FREE[1:],
    ("beam", "pinned", "pinned"): [PI, 2.0 * PI, 3.0 * PI, 4.0 * PI],
    ("beam", "clamped", "clamped"): FREE_FREE[2:],
    ("bar", "free", "free"): [0.0, PI, 2.0 * PI, 3.0 * PI],
    ("bar", "clamped", "free"): [0.5 * PI, 1.5 * PI, 2.5 * PI],
    ("bar", "clamped", "clamped"): [PI, 2.0 * PI, 3.0 * PI],
}


def started(kind: str, start: str, end: str, n: int, *initial: dict[str, Any]) -> Structure:
    return assemble(
        case_of(
            BENT if kind == "beam" else STRETCHED, *initial, mesh={"elements": n},
            support={"start": start, "end": end},
        ),
        needs_dolfinx=False,
    )  # fmt: skip


@pytest.mark.parametrize("n", [7, 10, 16, 25])
@pytest.mark.parametrize(("kind", "start", "end"), list(ROOTS))
def test_every_structure_begins_in_each_of_its_modes(
    kind: str, start: str, end: str, n: int
) -> None:
    """The shape fulfils K u = ω² M u with the exact ω, rigid motions first."""
    for number, root in enumerate(ROOTS[kind, start, end], start=1):
        initial = {"shape": "mode", "mode": number, "displacement": 1e-3}
        o = started(kind, start, end, n, initial).operators
        assert o.start is not None
        u = o.start[0]
        square = float(u @ o.stiffness @ u / (u @ o.mass @ u))
        exact = (root / L) ** 4 * EI / 0.1 if kind == "beam" else (root / L) ** 2 * 2e9 * 4e-5 / 0.1
        # the highest of these modes have few elements to a half wave; bars are of linear elements
        coarse = (root / n) ** 4 / 100.0 if kind == "beam" else (root / n) ** 2 / 10.0
        assert square == pytest.approx(exact, rel=coarse + 1e-6, abs=1e-3)
        residual = np.abs(o.stiffness @ u - square * (o.mass @ u)).max()
        assert residual <= 1e-9 * np.abs(o.stiffness).max() * np.abs(u).max()


@pytest.mark.parametrize("n", [4, 9, 20])
def test_rigid_motions_are_a_translation_and_then_a_turn(n: int) -> None:
    for mode, expected in ((1, np.ones(n + 1)), (2, np.linspace(1.0, -1.0, n + 1))):
        initial = {"shape": "mode", "mode": mode, "displacement": 1e-3}
        structure = started("beam", "free", "free", n, initial)
        place = structure.layout.parts[0].dofs[:, 0]
        assert structure.operators.start is not None
        deflection = structure.operators.start[0][place]
        np.testing.assert_allclose(deflection, 1e-3 * expected, atol=1e-9)


def test_a_free_point_begins_in_its_only_mode_and_flies_on() -> None:
    point = {"name": "one", "mass": M, "stiffness": 0.0, "damping_ratio": 0.0}
    t, (u,), _ = motion(run(case_of(point, {"shape": "mode", "velocity": 0.3}), engine="compiled"))
    np.testing.assert_allclose(u, 0.3 * t, rtol=1e-9)


@pytest.mark.parametrize("n", [4, 7, 10, 16, 25])
@pytest.mark.parametrize(("kind", "start", "end"), list(ROOTS))
def test_a_static_shape_is_that_of_what_is_held_alone(
    kind: str, start: str, end: str, n: int
) -> None:
    force = {"lamina": "one", "shape": "force", "position": 0.3, "displacement": 1e-3}
    if 0.0 in ROOTS[kind, start, end]:
        with pytest.raises(CaseError, match=r"initial\.1\.shape: .*not held"):
            started(kind, start, end, n, force)
    else:
        start_ = started(kind, start, end, n, force).operators.start
        assert start_ is not None
        assert np.abs(start_[0]).max() > 0.0


WALL = {"lamina": "one", "side": "above", "gap": 1e-3}


def test_a_start_beyond_a_rigid_stop_is_refused_with_pair_and_depth() -> None:
    keys = {"stop": [WALL], "contact": {"law": "newton"}}
    with pytest.raises(CaseError, match=r"initial: .*stop 1.*0\.002 m.*displacement"):
        run(case_of(POINT, {"displacement": 3e-3}, **keys), engine="compiled")
    open_ = run(case_of(POINT, {"displacement": 0.9e-3}, **keys), engine="compiled")
    assert not any(text.startswith("initial") for text in open_.summary["warnings"])


def test_a_start_beyond_an_elastic_stop_is_told_with_pair_and_depth() -> None:
    keys = {"stop": [WALL | {"stiffness": 1e4}], "contact": {"law": "penalty"}}
    result = run(case_of(POINT, {"displacement": 3e-3}, **keys), engine="compiled")
    (text,) = [text for text in result.summary["warnings"] if text.startswith("initial")]
    assert "stop 1" in text
    assert "0.002 m" in text


def test_a_start_beyond_the_gap_of_two_laminae_is_refused() -> None:
    case = df_preset("default", {"initial": [{"lamina": "thick", "displacement": 20e-3}]})
    with pytest.raises(CaseError, match=r"initial: .*thick and thin at x = .*closed by"):
        assemble(case, needs_dolfinx=False)
    beyond = case.with_overrides({"contact.law": "none"})
    assert assemble(beyond, needs_dolfinx=False).operators.start is not None

"""Springs and dampers at ends, and supports beside [gap], beside exact values and one another."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from covertable import make
from scipy.linalg import eigh
from scipy.optimize import brentq
from support import recorded, require_equal_engines

import delam_fem as df
from delam_fem import CaseError
from delam_fem.api import Case, assemble, lowest
from delam_fem.reference import matrices

EI, L, RHO_A = 10.0, 0.5, 0.1
LOWER = {
    "name": "lower", "length": L, "width": 0.02, "thickness": 0.002, "mass_per_length": RHO_A,
    "bending_stiffness": EI, "damping_ratio": 0.01,
}  # fmt: skip
UPPER = LOWER | {"name": "upper", "bending_stiffness": 4.0, "damping_ratio": 0.02}
TWO = {"lamina": [LOWER, UPPER], "gap": {"tip": 2e-4, "root": 1e-4}}
START = {"side": "start", "kind": "pinned", "rotational_stiffness": 30.0}
TIP = {"side": "end", "kind": "spring", "stiffness": 500.0, "rotational_stiffness": 2.0,
       "damping": 0.7}  # fmt: skip


def case_of(*supports: dict[str, Any], **sections: Any) -> Case:
    data = {
        "name": "ends", "lamina": [LOWER], "mesh": {"elements": 20}, "support": [*supports],
        "excitation": {"kind": "harmonic", "amplitude": 1e-4, "frequency": 20.0},
        "contact": {"law": "newton"}, "time": {"steps_per_period": 200, "periods": 2},
        "output": {"window_periods": 2},
    }  # fmt: skip
    return Case(**(data | sections))


def first(case: Case, n: int = 1) -> float:
    o = assemble(case, needs_dolfinx=False).operators
    return float(lowest(o.stiffness, o.mass, n)[0][-1])


def exact(rows: Any, bracket: tuple[float, float]) -> float:
    """Return the frequency at which four end conditions on cosh, sinh, cos, sin have a solution.

    Args:
        rows: function of β -> the conditions on w = a cosh βx + b sinh βx + c cos βx + d sin βx,
            shape (4, 4).
        bracket: of βL.
    """
    B = float(brentq(lambda B: np.linalg.det(rows(B / L)), *bracket))
    return (B / L) ** 2 * np.sqrt(EI / RHO_A) / (2.0 * np.pi)


def derivatives(beta: float, x: float) -> np.ndarray[Any, Any]:
    """Return w, w', w'', w''' of the four functions at x, shape (4 derivatives, 4 functions)."""
    b = beta * x
    ch, sh, c, s = np.cosh(b), np.sinh(b), np.cos(b), np.sin(b)
    rows = [[ch, sh, c, s], [sh, ch, -s, c], [ch, sh, -c, -s], [sh, ch, s, -c]]
    return np.array([beta**k * np.array(row) for k, row in enumerate(rows)])


@pytest.mark.parametrize("k", [200.0, 2000.0])
def test_a_cantilever_on_a_spring_has_its_exact_frequency(k: float) -> None:
    """EI w'''(L) = k w(L)."""

    def rows(beta: float) -> np.ndarray[Any, Any]:
        start, end = derivatives(beta, 0.0), derivatives(beta, L)
        return np.array([start[0], start[1], end[2], EI * end[3] - k * end[0]])

    case = case_of({"side": "end", "kind": "spring", "stiffness": k})
    assert first(case) == pytest.approx(exact(rows, (1.9, 3.8)), rel=1e-6)


def test_a_soft_clamp_has_its_exact_frequency() -> None:
    """EI w''(0) = k w'(0), in each of its three forms."""
    k = 30.0

    def rows(beta: float) -> np.ndarray[Any, Any]:
        start, end = derivatives(beta, 0.0), derivatives(beta, L)
        return np.array([start[0], EI * start[2] - k * start[1], end[2], end[3]])

    soft = exact(rows, (0.5, 1.8))
    clamp = {"side": "start", "rotational_stiffness": k}
    for support in (clamp | {"kind": "pinned"}, clamp | {"kind": "clamped"},
                    {"start": "clamped", "rotational_stiffness": k}):  # fmt: skip
        assert first(case_of(support)) == pytest.approx(soft, rel=1e-6)


def test_a_free_beam_on_a_soft_spring_bounces_as_a_mass() -> None:
    """With the spring in the middle, above the free turn; the frequency is sqrt(k/m)."""
    k = 1.0
    case = case_of(
        {"side": "start", "kind": "free"}, {"position": 0.5 * L, "kind": "spring", "stiffness": k}
    )
    assert case.n_rigid == 1
    o = assemble(case, needs_dolfinx=False).operators
    squares = eigh(o.stiffness.toarray(), o.mass.toarray(), eigvals_only=True)
    assert abs(squares[0]) < 1e-3 * squares[1]
    assert squares[1] == pytest.approx(k / (RHO_A * L), rel=1e-3)


def bar_of(*supports: dict[str, Any], **sections: Any) -> Case:
    bar = LOWER | {"motion": "axial", "young_modulus": 7e10, "damping_ratio": 0.0}
    del bar["bending_stiffness"]
    frequency = np.sqrt(bar["young_modulus"] * 0.02 * 0.002 / RHO_A) / (0.4 * L)  # of 0.4 L
    excitation = {"kind": "harmonic", "amplitude": 1e-6, "frequency": frequency}
    sections = {"lamina": [bar], "mesh": {"elements": 200}, "excitation": excitation} | sections
    return case_of(*supports, **sections)


@pytest.mark.parametrize("ratio", [1.0, 3.0, 0.2])
def test_a_damper_at_the_end_of_a_bar_reflects_what_its_impedance_says(ratio: float) -> None:
    """R = (1 - r) / (1 + r) of a damper r ρcA: with r = 1 it absorbs all."""
    (bar,) = bar_of().lamina
    impedance = np.sqrt(bar.young_modulus * bar.width * bar.thickness * RHO_A)
    frequency = bar_of().excitation.top_frequency
    case = bar_of(
        {"side": "start", "kind": "free"},
        {"side": "end", "kind": "spring", "stiffness": 0.0, "damping": ratio * impedance},
        excitation={"kind": "force", "lamina": "lower", "position": 0.0, "amplitude": 1.0,
                    "frequency": frequency},
    )  # fmt: skip
    o = assemble(case, needs_dolfinx=False).operators
    w = 2.0 * np.pi * frequency
    dynamic = (o.stiffness + 1j * w * o.damping - w**2 * o.mass).toarray()
    load = np.eye(o.n_dofs)[0]
    size = np.abs(np.linalg.solve(dynamic, load))
    reflection = (size.max() - size.min()) / (size.max() + size.min())
    assert reflection == pytest.approx(abs(1.0 - ratio) / (1.0 + ratio), abs=2e-3)


def test_a_pulse_vanishes_in_an_absorbing_end() -> None:
    """A blow at the free start of a bar that absorbs at its end leaves it where it has passed."""
    (bar,) = bar_of().lamina
    impedance = np.sqrt(bar.young_modulus * bar.width * bar.thickness * RHO_A)
    crossing = L * RHO_A / impedance
    case = bar_of(
        {"side": "start", "kind": "free"},
        {"side": "end", "kind": "spring", "stiffness": 0.0, "damping": impedance},
        excitation={"kind": "hammer", "lamina": "lower", "position": 0.0, "amplitude": 100.0,
                    "duration": 0.4 * crossing},
        contact={"law": "none"},
        time={"step": 0.002 * crossing, "duration": 3.0 * crossing},
        output={"fields_per_period": 2},
    )  # fmt: skip
    recorder = recorded(case, "compiled")
    speed = np.abs(np.concatenate([record.v for record in recorder.window]))
    assert speed[-1] < 2e-3 * speed.max()
    assert recorder.energy_residual() < 1e-8


def test_words_and_tables_of_ends_are_one_case() -> None:
    """Bit by bit, and in the case file; a table of one end leaves the other as it is."""
    words = case_of({"start": "pinned", "end": "pinned"})
    tables = case_of(*({"side": end, "kind": "pinned"} for end in ("start", "end")))
    one, other = (assemble(case, needs_dolfinx=False).operators for case in (words, tables))
    for name in ("mass", "damping", "stiffness"):
        assert (getattr(one, name) != getattr(other, name)).nnz == 0
    assert Case.from_toml(tables.to_toml()) == tables
    assert tables.with_overrides({"support.2.kind": "free"}).support.kind("end") == "free"
    assert case_of({"side": "end", "kind": "free"}).is_apart
    assert case_of(TIP).support.holds("start")
    assert not case_of(TIP).is_apart


def test_each_lamina_beside_a_gap_is_the_single_one_on_the_same_supports() -> None:
    """Matrices of two laminae are those of each alone, damping at their own modes included."""
    inner = {"position": 0.63 * L, "kind": "spring", "stiffness": 300.0, "damping": 0.5}
    supports = (START, TIP, inner, {"position": 0.4 * L, "kind": "pinned"})
    both = assemble(case_of(*supports, **TWO), needs_dolfinx=False)
    o = both.operators
    for lamina, part in zip((LOWER, UPPER), both.layout.parts, strict=True):
        alone = assemble(case_of(*supports, lamina=[lamina]), needs_dolfinx=False).operators
        dofs = part.own_dofs
        for name in ("mass", "damping", "stiffness"):
            block = getattr(o, name)[dofs][:, dofs].toarray()
            single = getattr(alone, name).toarray()
            np.testing.assert_allclose(block, single, rtol=1e-7, atol=1e-11 * np.abs(single).max())
            row = getattr(alone.base, name)
            np.testing.assert_allclose(
                getattr(o.base, name)[dofs], row, rtol=1e-7, atol=1e-10 * np.abs(single).max()
            )


@pytest.mark.parametrize("kind", ["gap", "bonded", "free"])
def test_weak_forms_and_the_reference_have_the_same_elastic_ends(kind: str) -> None:
    """Springs of one lamina and of all, a damper, a clamp that yields."""
    ends = ({"side": "end", "kind": "spring", "stiffness": 80.0, "lamina": "upper"}, START)
    sections: dict[str, Any] = TWO
    if kind != "gap":
        opening = {"between": ["lower", "upper"], "start": 0.25, "end": L, "opening": 1e-4}
        sections = {"lamina": [LOWER, UPPER], "delamination": [opening | {"shape": "power"}]}
    if kind == "free":
        ends = (TIP | {"side": "start"}, TIP)
    case = case_of(*ends, **sections)
    one, other = (assemble(case), assemble(case, needs_dolfinx=False))
    judge = matrices.assemble(case, other.layout.parts[0].x)
    for name in ("mass", "damping", "stiffness", "gap_matrix"):
        mine, closed, judged = (getattr(o, name) for o in (one.operators, other.operators, judge))
        assert abs(mine - closed).max() < 1e-8 * abs(closed).max()
        assert abs(judged - closed).max() < 1e-7 * abs(closed).max()
    for name in ("mass", "damping", "stiffness"):
        column, judged = getattr(other.operators.base, name), getattr(judge.base, name)
        np.testing.assert_allclose(judged, column, rtol=1e-6, atol=1e-7 * np.abs(column).max())


FACTORS: dict[str, list[Any]] = {
    "support": [(START,), (TIP,), (START, TIP), (TIP | {"lamina": "upper"},),
                ({"side": "start", "kind": "pinned"}, {"side": "end", "kind": "pinned"}),
                ({"position": 0.6 * L, "kind": "spring", "stiffness": 50.0, "damping": 1.0},)],
    "structure": ["gap", "delaminated", "bars"],
    "method": ["newton@moreau-jean", "newton-penalty", "penalty", "none"],
    "drive": ["base", "force"],
    "mass": ["consistent", "lumped"],
}  # fmt: skip


@pytest.mark.parametrize("cell", make(FACTORS), ids=str)
def test_engines_agree_with_any_support(cell: dict[str, Any]) -> None:
    supports = cell["support"]
    sections: dict[str, Any] = TWO | {"mesh": {"elements": 6}}
    frequency = 20.0
    if cell["structure"] == "delaminated":
        opening = {"between": ["lower", "upper"], "start": 0.2, "end": 0.4, "opening": 2e-5}
        sections |= {"gap": None, "delamination": [opening]}
    if cell["structure"] == "bars":
        bars = [lamina | {"motion": "axial", "young_modulus": 1e8} for lamina in (LOWER, UPPER)]
        for bar in bars:
            del bar["bending_stiffness"]
        supports = [{k: v for k, v in table.items() if not k.startswith("rot")}
                    for table in supports]  # fmt: skip
        sections |= {"lamina": bars}
    excitation = {"kind": "harmonic", "amplitude": 4e-4, "frequency": frequency}
    if cell["drive"] == "force":
        excitation |= {"kind": "force", "lamina": "lower", "position": 0.3, "amplitude": 3.0}
    law, _, scheme = cell["method"].partition("@")
    case = case_of(
        *supports,
        **{key: value for key, value in sections.items() if value is not None},
        excitation=excitation,
        contact={"law": law, "penalty_stiffness": 2e3, "restitution": 0.3},
        time={"scheme": scheme or "newmark", "mass": cell["mass"], "steps_per_period": 400,
              "periods": 2},
    )  # fmt: skip
    require_equal_engines(case)


@pytest.mark.parametrize(
    ("supports", "expected"),
    [
        ([{"side": "end", "position": 0.2, "kind": "pinned"}], "either position, or side"),
        ([{"position": 0.2, "kind": "free"}], '"free" only with side'),
        ([{"side": "end", "kind": "spring"}], "stiffness: missing"),
        ([{"side": "end", "kind": "free", "rotational_stiffness": 1.0}], "expected none"),
        ([{"side": "end", "kind": "pinned", "lamina": "lower"}], "expected only with kind"),
        ([{"end": "free"}, {"side": "end", "kind": "free"}], "expected none beside a table"),
        ([TIP, TIP], "expected one .*given 2"),
        ([TIP | {"side": "middle"}], "'start' or 'end'"),
    ],
)
def test_ends_that_contradict_are_told(supports: list[dict[str, Any]], expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        case_of(*supports)


def test_a_point_needs_no_mesh() -> None:
    point = {"name": "one", "mass": 0.2, "stiffness": 50.0, "damping_ratio": 0.0}
    with_mesh = case_of(lamina=[point], mesh={"elements": 1})
    data = with_mesh.model_dump(exclude_unset=True, exclude_none=True)
    del data["mesh"], data["support"]
    case = Case(**data)
    assert first(case) == pytest.approx(np.sqrt(50.0 / 0.2) / (2.0 * np.pi), rel=1e-12)
    with pytest.raises(CaseError, match="mesh: missing"):
        Case(**(data | {"lamina": [LOWER]}))


@pytest.mark.parametrize("support", [START, TIP | {"rotational_stiffness": 0.0}])
def test_solids_on_elastic_ends_are_near_the_beam(support: dict[str, Any]) -> None:
    """Frequencies of laminae 250 times as long as thick."""
    beam = {"young_modulus": 12.0 * EI / (0.02 * 0.002**3)}
    lamina = {k: v for k, v in LOWER.items() if k != "bending_stiffness"} | beam
    case = case_of(support, lamina=[lamina], mesh={"elements": 16})
    solid = case.with_overrides({"model.kind": "plane-stress"})
    o = assemble(solid).operators
    f = float(lowest(o.stiffness, o.mass, 1)[0][0])
    assert f == pytest.approx(first(case), rel=2e-3)


@pytest.mark.parametrize(
    "support", [START, TIP | {"damping": 0.0}, {"side": "end", "kind": "pinned"}]
)
def test_massless_contact_points_move_on_elastic_ends_as_others_do(support: dict[str, Any]) -> None:
    """Without contact, beside the consistent mass."""
    case = case_of(support, **TWO, contact={"law": "none"})
    massless = case.with_overrides({"time.mass": "massless"})
    tips = [df.run(entry).history["tip_displacement"].to_numpy() for entry in (case, massless)]
    assert np.abs(tips[1] - tips[0]).max() < 2e-2 * np.abs(tips[0]).max()


def test_a_damper_beside_massless_contact_points_is_refused() -> None:
    case = case_of(TIP, **TWO, contact={"law": "none"})
    with pytest.raises(CaseError, match=r"support\.1\.damping: expected 0"):
        case.with_overrides({"time.mass": "massless"})

"""Laminae that change along x beside exact frequencies, statics, solids, and one another."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from covertable import make
from scipy.linalg import expm
from scipy.optimize import brentq
from support import require_equal_engines

import delam_fem as df
from delam_fem import CaseError
from delam_fem.api import Case, assemble, lowest, nodal, reduced_case
from delam_fem.model.layout import bending_moment
from delam_fem.reference import matrices
from delam_fem.studies.identification.unknowns import value_of
from delam_fem.studies.sweeps.grid import unit_of

L, B, H, E, RHO = 0.5, 0.02, 0.002, 7e10, 2700.0
LAMINA = {
    "name": "one", "length": L, "width": B, "thickness": H, "density": RHO, "young_modulus": E,
    "damping_ratio": 0.01,
}  # fmt: skip
WAVE = np.sqrt(E * H**2 / (12.0 * RHO))
TAPER = {"x": [0.0, L], "value": [H, 0.4 * H]}
STEPS = {"x": [0.0, 0.3 * L, 0.65 * L], "value": [H, 1.4 * H, 0.6 * H], "steps": True}


def case_of(lamina: dict[str, Any], *more: dict[str, Any], **sections: Any) -> Case:
    data = {
        "name": "varying", "lamina": [LAMINA | lamina, *(LAMINA | other for other in more)],
        "mesh": {"elements": 40}, "support": {"start": "clamped", "end": "free"},
        "excitation": {"kind": "harmonic", "amplitude": 1e-4, "frequency": 5.0},
        "contact": {"law": "none"}, "time": {"steps_per_period": 200, "periods": 1},
        "output": {"window_periods": 1},
    }  # fmt: skip
    return Case(**{key: value for key, value in (data | sections).items() if value is not None})


def frequencies(case: Case, n: int = 3) -> Any:
    o = assemble(case, needs_dolfinx=False).operators
    return lowest(o.stiffness, o.mass, n)[0]


def exact(sections: list[tuple[float, float, Any, Any]], n: int, guess: Any) -> list[float]:
    """Return frequencies of a cantilever by transfer matrices of (w, w', M, Q), clamped at 0.

    Args:
        sections: start, end, EI(x) and ρA(x) of each piece.
        n: number of frequencies.
        guess: near them [Hz]; they are bracketed within 3 %.
    """

    def residual(f: float) -> float:
        T = np.eye(4)
        for start, end, EI, rhoA in sections:
            x = np.linspace(start, end, 401)
            d = x[1] - x[0]
            for a in x[:-1]:  # Magnus expansion of order 4 with two Gauss points
                g = d * np.sqrt(3.0) / 6.0
                A = [
                    np.array([[0, 1, 0, 0], [0, 0, 1 / EI(s), 0], [0, 0, 0, 1],
                              [(2 * np.pi * f) ** 2 * rhoA(s), 0, 0, 0]])
                    for s in (a + 0.5 * d - g, a + 0.5 * d + g)
                ]  # fmt: skip
                W = 0.5 * d * (A[0] + A[1])
                W = W + np.sqrt(3.0) / 12.0 * d**2 * (A[1] @ A[0] - A[0] @ A[1])
                T = expm(W) @ T
        return float(np.linalg.det(T[2:, 2:]))

    return [float(brentq(residual, 0.97 * g, 1.03 * g, xtol=1e-10)) for g in guess[:n]]


def EI_of(h: Any, b: Any = B, e: Any = E) -> Any:
    return e * b * h**3 / 12.0


def test_a_wedge_has_the_frequencies_that_bessel_functions_give() -> None:
    """Linear taper to 1/5 in thickness: w = x^(-1/2) Z_1 forms of the truncated wedge.

    With s = x from the point of the wedge, (s³ w'')'' = κ⁴ s w has the solutions s^(-1/2) times
    J_1, Y_1, I_1, K_1 of 2 κ s^(1/2). Source: G. Kirchhoff (1879).
    """
    from scipy.special import iv, jv, kv, yv

    end = 0.2 * H
    slope = (H - end) / L  # thickness over the distance from the point
    s_clamp, s_tip = H / slope, end / slope

    def rows(f: float, s: float) -> np.ndarray[Any, Any]:
        """Return w, w', w'', w''' by the derivatives of Z_n: d(s^(-n/2) Z_n) = ± κ s^(-(n+1)/2)."""
        kappa = (12.0 * RHO * (2.0 * np.pi * f) ** 2 / (E * slope**2)) ** 0.25
        z = 2.0 * kappa * np.sqrt(s)
        signs = {jv: -1.0, yv: -1.0, iv: 1.0, kv: -1.0}
        return np.array(
            [
                [(sign * kappa) ** k * s ** (-0.5 * (1 + k)) * Z(1 + k, z)
                 for Z, sign in signs.items()]
                for k in range(4)
            ]
        )  # fmt: skip

    def residual(f: float) -> float:
        clamp, tip = rows(f, s_clamp), rows(f, s_tip)
        moment = s_tip**3 * tip[2]
        shear = s_tip**3 * tip[3] + 3.0 * s_tip**2 * tip[2]
        matrix = np.array([clamp[0], clamp[1], moment, shear])
        return float(np.linalg.det(matrix / np.abs(matrix).max(axis=0)))

    guess = frequencies(case_of({"thickness": {"x": [0.0, L], "value": [H, end]}}))
    truth = [brentq(residual, 0.98 * g, 1.02 * g, xtol=1e-12) for g in guess]
    np.testing.assert_allclose(guess, truth, rtol=1e-5)
    coarse = frequencies(
        case_of({"thickness": {"x": [0.0, L], "value": [H, end]}}, mesh={"elements": 20})
    )
    orders = np.log2((coarse - truth) / (guess - truth))
    assert np.all((orders > 3.7) & (orders < 4.4)), orders


def test_steps_have_the_frequencies_of_transfer_matrices() -> None:
    case = case_of({"thickness": STEPS})
    ends = [*STEPS["x"], L]  # type: ignore[misc]
    pieces = [
        (a, b, lambda x, h=h: EI_of(h), lambda x, h=h: RHO * B * h)
        for a, b, h in zip(ends[:-1], ends[1:], STEPS["value"], strict=True)  # type: ignore[arg-type]
    ]
    truth = exact(pieces, 3, frequencies(case))
    np.testing.assert_allclose(frequencies(case), truth, rtol=1e-5)


def test_every_property_may_change_at_once() -> None:
    """Thickness, width, density and modulus, of different tables."""
    tables = {
        "thickness": TAPER, "width": {"x": [0.0, 0.4 * L, L], "value": [B, 1.5 * B, 0.8 * B]},
        "density": {"x": [0.0, L], "value": [RHO, 1.3 * RHO]},
        "young_modulus": {"x": [0.0, L], "value": [E, 0.7 * E]},
    }  # fmt: skip
    case = case_of(tables)

    def at(key: str, x: float) -> float:
        return float(np.interp(x, tables[key]["x"], tables[key]["value"]))

    def EI(x: float) -> float:
        return EI_of(at("thickness", x), at("width", x), at("young_modulus", x))

    def rhoA(x: float) -> float:
        return at("density", x) * at("width", x) * at("thickness", x)

    truth = exact([(0.0, 0.4 * L, EI, rhoA), (0.4 * L, L, EI, rhoA)], 3, frequencies(case))
    np.testing.assert_allclose(frequencies(case), truth, rtol=1e-5)


def test_a_table_of_one_value_is_the_number() -> None:
    """Beams, bonded beams and bars; with it in another lamina, where it changes no matrix."""
    flat = {"thickness": {"x": [0.0, L], "value": [H, H]}}
    upper = {"name": "two", "thickness": 0.5 * H}
    opening = {"between": ["one", "two"], "start": 0.2, "end": 0.4, "opening": 1e-4}
    ends = {"start": "clamped", "end": "pinned"}
    bonded = {"delamination": [opening], "support": ends}
    gap = {"gap": {"tip": 1e-3}}
    bars = {"motion": "axial"}
    for more, sections, extra in (
        ((), {}, {}), ((upper,), bonded, {}), ((upper,), gap, {}), ((), {}, bars),
    ):  # fmt: skip
        laminae = [other | extra for other in more]
        one = assemble(case_of(extra, *laminae, **sections), needs_dolfinx=False).operators
        other = assemble(case_of(extra | flat, *laminae, **sections), needs_dolfinx=False).operators
        for name in ("mass", "damping", "stiffness"):
            difference = abs(getattr(one, name) - getattr(other, name)).max()
            scale = 1e-3 if name == "damping" else 1e-8  # exact modes, or those of the mesh
            assert difference < scale * abs(getattr(one, name)).max(), (name, sections)


@pytest.mark.parametrize("table", [TAPER, STEPS])
def test_a_force_at_the_tip_bends_as_the_integral_says(table: dict[str, Any]) -> None:
    """w(L) = F ∫ (L - x)²/EI dx, and the strain at x is F (L - x) h / 2 EI."""
    sensors = [
        {"name": f"s{k}", "quantity": "strain", "lamina": "one", "position": x}
        for k, x in enumerate((0.21, 0.4))
    ]
    case = case_of({"thickness": table}, sensor=sensors)
    structure = assemble(case, needs_dolfinx=False)
    o = structure.operators
    u = np.linalg.solve(o.stiffness.toarray(), np.eye(o.n_dofs)[-2])
    (lamina,) = case.lamina
    x = (np.arange(200_000) + 0.5) * L / 200_000
    h = lamina.along("thickness", x)
    w = np.sum((L - x) ** 2 / EI_of(h)) * L / 200_000
    assert u[-2] == pytest.approx(w, rel=2e-6)
    assert o.sensors is not None
    places = np.array([0.21, 0.4])
    h = lamina.along("thickness", places)
    strain = (L - places) * 0.5 * h / EI_of(h)
    np.testing.assert_allclose(np.abs(o.sensors @ u), strain, rtol=2e-3)


def test_a_bar_of_changing_width_stretches_as_the_integral_says() -> None:
    width = {"x": [0.0, L], "value": [B, 0.3 * B]}
    o = assemble(case_of({"motion": "axial", "width": width}), needs_dolfinx=False).operators
    axial = np.linalg.solve(o.stiffness.toarray(), np.eye(o.n_dofs)[-1])[-1]
    truth = L / (E * H * 0.7 * B) * np.log(1.0 / 0.3)
    assert axial == pytest.approx(truth, rel=1e-3)


BONDED = {
    "gap": None,
    "delamination": [{"between": ["one", "two"], "start": 0.15, "end": 0.35, "opening": 1e-4}],
    "support": {"start": "clamped", "end": "clamped"},
}


@pytest.mark.parametrize("kind", ["gap", "bonded"])
def test_weak_forms_closed_forms_and_the_reference_agree(kind: str) -> None:
    lower, upper = {"thickness": TAPER}, {"name": "two", "thickness": STEPS, "width": 0.5 * B}
    sections: dict[str, Any] = {"gap": {"tip": 1e-3}} if kind == "gap" else BONDED
    sections = sections | {"mesh": {"elements": 20}}
    case = case_of(lower, upper, **sections)
    for mass in ("consistent", "lumped"):
        case = case.with_overrides({"time.mass": mass})
        one, other = (assemble(case), assemble(case, needs_dolfinx=False))
        for name in ("mass", "damping", "stiffness"):
            a, b = (getattr(structure.operators, name) for structure in (one, other))
            assert abs(a - b).max() < 1e-8 * abs(b).max(), name
        np.testing.assert_allclose(
            one.operators.lumped_mass, other.operators.lumped_mass, rtol=1e-9
        )
    case = case.with_overrides({"time.mass": "consistent"})
    x = other.layout.parts[0].x
    if kind == "bonded":
        with pytest.raises(CaseError, match="reference: expected uniform laminae"):
            matrices.assemble(case, x)
        return
    judge = matrices.assemble(case, x)
    o = assemble(case, needs_dolfinx=False).operators
    for name in ("mass", "damping", "stiffness"):
        assert (
            abs(getattr(judge, name) - getattr(o, name)).max() < 1e-8 * abs(getattr(o, name)).max()
        )


@pytest.mark.parametrize("kind", ["plane-stress", "solid"])
def test_solids_follow_the_thickness(kind: str) -> None:
    """Frequencies of a tapered cantilever and of a tapered, delaminated clamped beam."""
    taper = {"x": [0.0, L], "value": [3.0 * H, 1.5 * H]}
    half = {"x": [0.0, L], "value": [1.5 * H, 0.75 * H]}
    upper = {"name": "two", "thickness": half}
    for lamina, more, sections in (
        ({"thickness": taper}, (), {}), ({"thickness": half}, (upper,), BONDED),
    ):  # fmt: skip
        case = case_of(lamina, *more, **(sections | {"mesh": {"elements": 20}}))
        solid = case.with_overrides({"model.kind": kind})
        o = assemble(solid).operators
        n = 2 if kind == "plane-stress" else 1  # the next one bends to the side
        f = lowest(o.stiffness, o.mass, n)[0]
        np.testing.assert_allclose(f, frequencies(case, n), rtol=1e-2 if more else 2e-3)


def test_massless_nodes_converge_as_the_others_do() -> None:
    """Order 4 of the masses at middles, with the moments of a varying section."""
    truth = frequencies(case_of({"thickness": TAPER}, mesh={"elements": 160}), 2)
    errors = []
    for n in (20, 40):
        case = case_of({"thickness": TAPER}, mesh={"elements": n}, time={"mass": "massless"})
        o = assemble(case, needs_dolfinx=False).operators
        K, M = o.stiffness.toarray(), o.mass.toarray()
        squares = 1.0 / np.linalg.eigvals(np.linalg.solve(K, M)).real.clip(1e-300)
        errors.append(np.sqrt(np.sort(squares)[:2]) / (2.0 * np.pi) / truth - 1.0)
    orders = np.log2(np.abs(errors[0] / errors[1]))
    assert np.all(orders > 3.5), orders
    assert np.abs(errors[1]).max() < 2e-5


FACTORS: dict[str, list[Any]] = {
    "structure": ["gap", "bonded", "bars"],
    "table": [TAPER, STEPS],
    "key": ["thickness", "width", "density", "young_modulus"],
    "method": ["newton@moreau-jean", "newton-penalty", "penalty"],
    "mass": ["consistent", "lumped"],
}


@pytest.mark.parametrize("cell", make(FACTORS), ids=str)
def test_engines_agree_on_laminae_that_change(cell: dict[str, Any]) -> None:
    size = {"thickness": H, "width": B, "density": RHO, "young_modulus": E}[cell["key"]]
    table = cell["table"] | {"value": [size * v / H for v in cell["table"]["value"]]}
    bar = {"motion": "axial"} if cell["structure"] == "bars" else {}
    sections: dict[str, Any] = BONDED if cell["structure"] == "bonded" else {"gap": {"tip": 2e-4}}
    law, _, scheme = cell["method"].partition("@")
    case = case_of(
        bar | {cell["key"]: table}, bar | {"name": "two", "thickness": 0.5 * H},
        **(sections | {
            "mesh": {"elements": 8},
            "excitation": {"kind": "harmonic", "amplitude": 2e-3, "frequency": 20.0},
            "contact": {"law": law, "penalty_stiffness": 2e3, "restitution": 0.3},
            "time": {"scheme": scheme or "newmark", "mass": cell["mass"],
                     "steps_per_period": 400, "periods": 2},
            "output": {"window_periods": 2},
        }),
    )  # fmt: skip
    require_equal_engines(case)


@pytest.mark.parametrize(
    ("lamina", "expected"),
    [
        ({"thickness": {"x": [0.0, L], "value": [H]}}, r"thickness\.value: expected two or more"),
        ({"thickness": {"x": [0.1, L], "value": [H, H]}}, r"thickness\.x: expected places that"),
        ({"thickness": {"x": [0.0, 0.3], "value": [H, H]}}, r"thickness\.x: expected a last place"),
        ({"thickness": STEPS | {"x": [0.0, 0.1, L]}}, r"thickness\.x: expected steps before"),
        ({"thickness": TAPER, "bending_stiffness": 1.0}, r"bending_stiffness: expected none"),
        ({"density": {"x": [0.0, L], "value": [RHO, -1.0]}}, r"density\.value: expected a list"),
        ({"thickness": {"y": [0.0]}}, r"thickness\.y: unknown key"),
    ],
)
def test_tables_that_cannot_be_are_told(lamina: dict[str, Any], expected: str) -> None:
    with pytest.raises(CaseError, match=expected):
        case_of(lamina)


def test_tables_survive_files_units_and_overrides() -> None:
    case = case_of({"thickness": {"x": ["0 mm", "500 mm"], "value": ["2 mm", "0.8 mm"]}})
    assert frequencies(case) == pytest.approx(frequencies(case_of({"thickness": TAPER})))
    assert Case.from_toml(case.to_toml()) == case
    entry = case.with_overrides({"lamina.one.thickness.value.2": H})
    assert frequencies(entry) == pytest.approx(frequencies(case_of({})))
    assert case.with_overrides({"lamina.one.thickness": 1e-3}).lamina[0].is_uniform
    with pytest.raises(CaseError, match="a place from 1 to 2"):
        case.with_overrides({"lamina.one.thickness.value.3": H})


@pytest.mark.slow
def test_a_run_shows_what_changes(tmp_path: Any) -> None:
    """Figures and fields are drawn, with finite moments."""
    case = case_of(
        {"thickness": TAPER}, {"name": "two", "thickness": 0.5 * H},
        support=None, gap={"tip": 1e-3}, mesh={"elements": 20},
        output={"window_periods": 1, "fields_per_period": 10},
    )  # fmt: skip
    result = df.run(case)
    assert np.isfinite(result.history["moment"]).all()
    result.save(tmp_path / "run")


@pytest.mark.parametrize("is_reduced", [False, True])
def test_moments_of_a_static_shape_converge_to_the_lever_arm(is_reduced: bool) -> None:
    """M = F (L - x) of a force at the tip, in second order, of the beam and of its reduced file."""
    errors = []
    for n in (10, 20, 40):
        force = {"kind": "force", "lamina": "one", "position": L, "amplitude": 1, "frequency": 5}
        case = case_of({"thickness": TAPER}, mesh={"elements": n}, excitation=force)
        structure = reduced_case(case, 8).structure if is_reduced else assemble(case)
        o = structure.operators
        u = np.linalg.solve(o.stiffness.toarray(), -o.base.stiffness)
        nodal_values = nodal(structure.layout, u[None], np.zeros(1))
        moment = bending_moment(structure.layout, *nodal_values)[0, 0]
        errors.append(np.abs(moment - (L - structure.layout.x)).max() / L)
    assert errors[-1] < 2e-3
    assert np.log2(errors[0] / errors[1]) > 1.5 and np.log2(errors[1] / errors[2]) > 1.7


def test_numbers_of_tables_are_keys_of_sweeps_and_fits() -> None:
    """With their units and values; the table as a whole is no number."""
    case = case_of({"thickness": TAPER})
    units = [unit_of(f"lamina.one.{key}", case) for key in (
        "thickness.value.2", "thickness.x.2", "density.value.1", "thickness")]  # fmt: skip
    assert units == ["m", "m", "kg/m3", "m"]
    assert value_of(case, "lamina.one.thickness.value.2") == pytest.approx(0.4 * H)
    assert np.isnan(value_of(case, "lamina.one.thickness"))


def test_compare_finds_the_motion_of_the_reference() -> None:
    """Tapered and stepped laminae on a soft clamp, with contact."""
    clamp = {"side": "start", "kind": "pinned", "rotational_stiffness": 40.0}
    case = case_of(
        {"thickness": TAPER}, {"name": "two", "width": STEPS | {"value": [B, 0.8 * B, 1.2 * B]}},
        support=[clamp], gap={"tip": 1e-4}, mesh={"elements": 8},
        contact={"law": "newton-penalty", "impulse": "lumped"},
    )  # fmt: skip
    comparison = df.compare(case, periods=2)
    assert max(comparison.matrices.values()) < 1e-9
    assert comparison.frequencies < 1e-9
    assert comparison.motion is not None
    assert comparison.motion.until_impact < 1e-9

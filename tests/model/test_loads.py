"""Weight and constant loads: static shapes, frequencies under axial forces, the state of rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg

import delam_fem as df
from delam_fem.api import EngineName, FloatArray, Structure, assemble, lowest

L, B, H, RHO, E = 0.3, 0.03, 0.001, 7850.0, 2.1e11
EI = E * B * H**3 / 12.0
LINE_MASS = RHO * B * H
G = 9.80665
ROUND_OFF = 1e-10
"""Of static solutions with a condition of some 1e6."""


def case_of(**tables: Any) -> df.Case:
    """Return a case of one steel strip with other tables in place of its own."""
    data: dict[str, Any] = {
        "name": "strip",
        "lamina": [lamina("strip")],
        "support": {"start": "clamped", "end": "free"},
        "mesh": {"elements": 10},
        "excitation": {"kind": "harmonic", "frequency": 5.0, "amplitude": 1e-3},
        "contact": {"law": "none"},
        "time": {"periods": 2, "steps_per_period": 100},
    }
    return df.Case(**(data | tables))


def lamina(name: str, thickness: float = H, **numbers: Any) -> dict[str, Any]:
    """Return a table of a steel strip."""
    table = {
        "name": name, "length": L, "width": B, "thickness": thickness, "density": RHO,
        "young_modulus": E, "damping_ratio": 0.01,
    }  # fmt: skip
    return table | numbers


def tips(structure: Structure) -> Any:
    """Return the displacements of the tips at rest."""
    operators = structure.operators
    assert operators.equilibrium is not None
    return operators.probes @ operators.equilibrium.displacement


def power_series(gamma: float, frequency: float, terms: int = 120) -> float:
    """Return the determinant of a standing cantilever of length 1, whose zeros are frequencies.

    w'''' + γ ((1 - x) w')' = λ² w with w(0) = w'(0) = 0, w''(1) = w'''(1) = 0, by
    w = Σ a_n xⁿ: (n+4)…(n+1) a_{n+4} = λ² a_n - γ ((n+2)(n+1) a_{n+2} - (n+1)² a_{n+1}).
    """
    rows = []
    for first in ((1.0, 0.0), (0.0, 1.0)):
        a = np.zeros(terms + 4)
        a[2:4] = first
        for n in range(terms):
            pull = (n + 2) * (n + 1) * a[n + 2] - (n + 1) ** 2 * a[n + 1]
            a[n + 4] = (frequency**2 * a[n] - gamma * pull) / np.prod(np.arange(n + 1, n + 5))
        n = np.arange(a.size)
        rows.append((np.sum(n * (n - 1) * a), np.sum(n * (n - 1) * (n - 2) * a)))
    return float(np.linalg.det(np.array(rows)))


def roots(gamma: float, count: int) -> list[float]:
    """Return the lowest λ of `power_series`, by bisection."""
    grid = np.linspace(0.05, 70.0, 1400)
    values = [power_series(gamma, x) for x in grid]
    found_roots = []
    for a, b, fa, fb in zip(grid[:-1], grid[1:], values[:-1], values[1:], strict=True):
        if fa * fb < 0.0:
            for _ in range(60):
                middle = 0.5 * (a + b)
                if power_series(gamma, middle) * fa > 0.0:
                    a = middle
                else:
                    b = middle
            found_roots.append(0.5 * (a + b))
    return found_roots[:count]


def standing(gamma: float, elements: int = 20) -> df.Case:
    """Return a strip that stands (γ > 0) or hangs."""
    return case_of(
        mesh={"elements": elements},
        gravity={
            "acceleration": abs(gamma) * EI / (LINE_MASS * L**3),
            "inclination": 90.0 if gamma > 0.0 else -90.0,
        },
    )


def frequencies(structure: Structure, n: int = 3) -> Any:
    """Return ω √(ρA L⁴/EI) of the lowest modes."""
    hertz, _ = lowest(structure.operators.stiffness, structure.operators.mass, n)
    return 2.0 * np.pi * hertz * np.sqrt(LINE_MASS * L**4 / EI)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gamma", "exact"), [(1.0, 3.284923383), (4.0, 2.462967205), (-10.0, 5.291783357)]
)
def test_a_standing_strip_has_the_frequencies_of_the_power_series(
    gamma: float, exact: float
) -> None:
    assert roots(gamma, 1)[0] == pytest.approx(exact, rel=1e-9)
    structure = assemble(standing(gamma, 40), needs_dolfinx=False)
    assert frequencies(structure) == pytest.approx(roots(gamma, 3), rel=2e-6)


def test_its_frequencies_converge_as_those_of_uniform_beams() -> None:
    exact = roots(4.0, 2)[1]
    errors = [
        frequencies(assemble(standing(4.0, n), needs_dolfinx=False))[1] / exact - 1.0
        for n in (4, 8, 16)
    ]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders == pytest.approx([4.0, 4.0], abs=0.25)


def test_weak_forms_and_closed_forms_have_one_geometric_stiffness() -> None:
    case = standing(4.0, 6)
    weak, closed = (assemble(case, needs_dolfinx=value).operators for value in (True, False))
    difference = abs(weak.stiffness - closed.stiffness).max()
    assert difference < 1e-12 * abs(closed.stiffness).max()
    assert weak.buckling_factor == pytest.approx(closed.buckling_factor, rel=1e-8)


def tapered(elements: int, inclination: float) -> df.Case:
    """Return a strip whose thickness falls to half of it at its end, under ten times its weight."""
    lamina = {"name": "strip", "length": L, "width": 0.02, "damping_ratio": 0.01,
              "thickness": {"x": [0.0, L], "value": [0.001, 0.0005]},
              "density": 2700.0, "young_modulus": 7e10}  # fmt: skip
    return case_of(
        lamina=[lamina],
        mesh={"elements": elements},
        gravity={"acceleration": 20.0, "inclination": inclination},
    )


def ritz(inclination: float, n: int = 14) -> FloatArray:
    """Return the lowest frequencies of `tapered` by polynomials of degree n + 1 [Hz]."""
    s, w = np.polynomial.legendre.leggauss(60)
    x = 0.5 * L * (s + 1.0)
    weight = 0.5 * L * w
    h = 0.001 * (1.0 - 0.5 * x / L)
    behind = 2700.0 * 0.02 * 0.001 * ((L - x) - 0.25 * (L**2 - x**2) / L)
    force = -20.0 * np.sin(np.radians(inclination)) * behind
    square = np.polynomial.Polynomial([0.0, 0.0, 1.0 / L**2])
    shapes = [square * np.polynomial.Legendre.basis(k, [0.0, L]).convert(
        kind=np.polynomial.Polynomial) for k in range(n)]  # fmt: skip
    values, slopes, curvatures = (np.array([f.deriv(d)(x) for f in shapes]) for d in (0, 1, 2))
    stiffness = (curvatures * (weight * 7e10 * 0.02 * h**3 / 12.0)) @ curvatures.T
    stiffness += (slopes * (weight * force)) @ slopes.T
    mass = (values * (weight * 2700.0 * 0.02 * h)) @ values.T
    squares = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    return np.asarray(np.sqrt(squares[:3]) / (2.0 * np.pi))


@pytest.mark.parametrize("inclination", [90.0, -90.0, 30.0])
def test_weight_along_a_tapered_strip_changes_its_frequencies(inclination: float) -> None:
    exact = ritz(inclination)
    plain = ritz(0.0)
    errors = []
    for elements in (10, 40):
        o = assemble(tapered(elements, inclination), needs_dolfinx=False).operators
        hertz, _ = lowest(o.stiffness, o.mass, 3)
        errors.append(np.abs(hertz / exact - 1.0).max())
    assert np.abs(exact / plain - 1.0).max() > 0.005
    assert errors[1] < 1e-5
    assert errors[0] > 100.0 * errors[1]  # the order is 4, as of uniform strips


@pytest.mark.slow
def test_weight_along_a_tapered_solid_is_that_along_a_beam() -> None:
    case = tapered(20, 90.0).with_overrides({"model.kind": "plane-stress", "model.poisson": 0.0})
    o = assemble(case).operators
    (hertz,), _ = lowest(o.stiffness, o.mass, 1)
    assert hertz == pytest.approx(ritz(90.0)[0], rel=1e-3)
    assert abs(hertz / ritz(0.0)[0] - 1.0) > 1e-2


def test_weak_forms_know_weight_along_a_tapered_strip() -> None:
    case = tapered(8, 90.0)
    closed, weak = (assemble(case, needs_dolfinx=needs).operators for needs in (False, True))
    difference = closed.stiffness - weak.stiffness
    assert abs(difference).max() < 1e-11 * abs(closed.stiffness).max()


def test_a_strip_falls_over_beyond_its_buckling_load() -> None:
    structure = assemble(standing(7.8, 20), needs_dolfinx=False)
    assert structure.operators.buckling_factor == pytest.approx(7.837347 / 7.8, rel=1e-5)
    with pytest.raises(df.CaseError, match=r"it bears 0.9992 of its weight"):
        assemble(standing(7.844, 20), needs_dolfinx=False)


def pinned(axial: float, **numbers: float) -> df.Case:
    """Return a strip on two pins under tension."""
    return case_of(
        lamina=[lamina("strip", **numbers)],
        support={"start": "pinned", "end": "pinned"},
        mesh={"elements": 40},
        load=[{"axial": axial}],
    )


def test_a_beam_on_pins_under_tension_has_its_exact_frequencies() -> None:
    N = 40.0
    n = np.arange(1, 4)
    wave = n * np.pi / L
    exact = np.sqrt((EI * wave**4 + N * wave**2) / LINE_MASS) * np.sqrt(LINE_MASS * L**4 / EI)
    for needs_dolfinx in (True, False):
        structure = assemble(pinned(N), needs_dolfinx=needs_dolfinx)
        assert frequencies(structure) == pytest.approx(exact, rel=3e-6)


def test_it_buckles_under_euler_s_load() -> None:
    euler = EI * np.pi**2 / L**2
    structure = assemble(pinned(-0.5 * euler), needs_dolfinx=False)
    assert structure.operators.buckling_factor == pytest.approx(2.0, rel=1e-6)
    with pytest.raises(df.CaseError, match="buckles"):
        assemble(pinned(-1.001 * euler), needs_dolfinx=False)


def test_a_string_has_the_frequencies_of_a_string() -> None:
    N = 100.0
    stiffness = 1e-6 * N * L**2 / np.pi**2
    structure = assemble(pinned(N, bending_stiffness=stiffness), needs_dolfinx=False)
    hertz, _ = lowest(structure.operators.stiffness, structure.operators.mass, 2)
    exact = np.array([1.0, 2.0]) / (2.0 * L) * np.sqrt(N / LINE_MASS)
    assert hertz == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("needs_dolfinx", [True, False])
@pytest.mark.parametrize(("roll", "sign"), [(0.0, -1.0), (180.0, 1.0), (90.0, 0.0)])
def test_a_level_strip_sags_by_q_l4_over_8_ei(
    roll: float, sign: float, needs_dolfinx: bool
) -> None:
    structure = assemble(case_of(gravity={"roll": roll}), needs_dolfinx=needs_dolfinx)
    exact = LINE_MASS * G * L**4 / (8.0 * EI)
    if not sign:
        assert structure.operators.load is None
    else:
        assert tips(structure) == pytest.approx([sign * exact], rel=ROUND_OFF)
        assert df.rest(case_of(gravity={"roll": roll})).displacement[0, -1] == pytest.approx(
            sign * exact, rel=ROUND_OFF
        )


def test_point_masses_and_forces_bend_it_as_formulas_say() -> None:
    a = 0.37 * L  # inside an element
    mass = {"lamina": "strip", "mass": 0.02, "position": a}
    case = case_of(gravity={"inclination": 60.0}, point_mass=[mass])
    weight = LINE_MASS * G * 0.5 * L**4 / (8.0 * EI)
    point = 0.02 * G * 0.5 * a**2 * (3.0 * L - a) / (6.0 * EI)
    axial = case.without_loads.model_copy(
        update={"load": case_of(load=[{"lamina": "strip", "position": a, "force": 1.5}]).load}
    )
    flat = assemble(axial, needs_dolfinx=False)
    assert tips(flat) == pytest.approx([1.5 * a**2 * (3.0 * L - a) / (6.0 * EI)], rel=ROUND_OFF)
    straight = assemble(case, needs_dolfinx=False).operators
    assert straight.load is not None
    level = assemble(case_of(point_mass=[mass]), needs_dolfinx=False).operators
    sag = np.linalg.solve(level.stiffness.toarray(), straight.load)
    assert level.probes @ sag == pytest.approx([-weight - point], rel=ROUND_OFF)


def test_a_force_per_length_ends_inside_elements() -> None:
    a, b, p = 0.13 * L, 0.88 * L, 7.0
    load = {"lamina": "strip", "start": a, "end": b, "per_length": p}
    structure = assemble(case_of(load=[load]), needs_dolfinx=False)

    def until(x: float) -> float:
        return p / EI * (x**3 * L / 6.0 - x**4 / 24.0)  # ∫ x² (3 L - x) / 6

    assert tips(structure) == pytest.approx([until(b) - until(a)], rel=ROUND_OFF)


def two(**tables: Any) -> df.Case:
    """Return two strips, of which the upper one lies on the lower one at its tip."""
    defaults: dict[str, Any] = {
        "lamina": [lamina("lower", 0.004), lamina("upper", H)],
        "gap": {"tip": 1e-3, "exponent": 3.0},
        "support": {},
        "gravity": {},
        "contact": {"law": "newton", "restitution": 0.0},
        "time": {"periods": 3, "steps_per_period": 400, "scheme": "moreau-jean"},
        "output": {"window_periods": 1, "fields_per_period": 4},
    }
    data = case_of(**(defaults | tables)).model_dump(exclude_unset=True)
    del data["support"]
    return df.Case(**data)


@pytest.mark.slow
def test_strips_that_lie_on_one_another_carry_each_other_s_weight() -> None:
    case = two(mesh={"elements": 1})  # the tips are the only pair
    structure = assemble(case, needs_dolfinx=False)
    EI_lower = E * B * 0.004**3 / 12.0
    free = [q * L**4 / 8.0 for q in (-4.0 * LINE_MASS * G / EI_lower, -LINE_MASS * G / EI)]
    soft = [L**3 / 3.0 / stiffness for stiffness in (EI_lower, EI)]
    overlap = free[0] - free[1] - 1e-3
    force = overlap / sum(soft)
    assert force > 0.0
    equilibrium = structure.operators.equilibrium
    assert equilibrium is not None
    assert equilibrium.force == pytest.approx([force], rel=ROUND_OFF)
    expected = [free[0] - force * soft[0], free[1] + force * soft[1]]
    assert tips(structure) == pytest.approx(expected, rel=ROUND_OFF)
    numbers = df.rest(case)
    assert float(numbers.gap[0]) == pytest.approx(0.0, abs=1e-15)
    assert str(numbers.contact[0].values) == "lower-upper"


LAWS = [
    {"contact.law": "newton", "time.scheme": "moreau-jean"},
    {"contact.law": "penalty", "time.scheme": "newmark", "contact.penalty_stiffness": 2000.0},
    {"contact.law": "newton-penalty", "time.scheme": "newmark", "contact.penalty_stiffness": 900.0},
    {"contact.law": "none", "time.scheme": "newmark"},
    {"contact.law": "none", "time.scheme": "central-difference", "time.mass": "lumped"},
    {"contact.law": "newton", "time.mass": "massless", "model.kind": "modes", "model.modes": 3},
]


@pytest.mark.parametrize("keys", LAWS, ids=lambda keys: "-".join(map(str, keys.values())))
def test_what_is_at_rest_stays_at_rest_in_all_engines(keys: dict[str, Any]) -> None:
    case = two(mesh={"elements": 4}).with_overrides(keys | {"excitation.amplitude": 1e-12})
    if keys["time.scheme" if "time.scheme" in keys else "time.mass"] == "central-difference":
        case = case.with_overrides({"time.steps_per_period": 20000, "time.periods": 1})
    expected = tips(assemble(case, needs_dolfinx=False))
    engines = ("petsc",) if case.is_massless else ("petsc", "compiled")
    for engine in engines:
        summary = df.run(case, engine=engine).summary  # type: ignore[arg-type]
        for name in ("tip_min", "tip_max"):
            assert summary[name] == pytest.approx(expected, rel=1e-7), (engine, name)
        assert summary["rest"]["tip_displacement"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("keys", LAWS[:4], ids=lambda keys: keys["contact.law"])
def test_engines_move_alike_under_weight(keys: dict[str, Any]) -> None:
    case = two(mesh={"elements": 6}).with_overrides(keys | {"excitation.amplitude": 2e-3})
    petsc, compiled = (df.run(case, engine=engine) for engine in ("petsc", "compiled"))
    for name in ("tip_displacement", "energy_strain", "energy_kinetic", "energy_base_work"):
        first, second = petsc.history[name].values, compiled.history[name].values
        assert np.abs(second - first).max() < 1e-10 * np.abs(first).max(), name
    for result in (petsc, compiled):
        assert abs(result.summary["energy_residual"]) < 1e-10


def test_what_is_pressed_together_needs_a_law_that_holds_it() -> None:
    with pytest.raises(df.CaseError, match="they would sink into one another"):
        df.run(two().with_overrides({"time.scheme": "newmark"}))


def test_gaps_in_place_are_those_under_weight() -> None:
    case = two(mesh={"elements": 4}, gravity={"gaps": "in place"})
    o = assemble(case, needs_dolfinx=False).operators
    assert o.equilibrium is not None and not o.equilibrium.force.any()
    x = np.arange(1, 5) / 4.0
    gap = o.gap_matrix @ o.equilibrium.displacement + o.gap0
    assert gap == pytest.approx(1e-3 * x**3, rel=1e-9)


def test_a_load_that_has_no_effect_is_refused() -> None:
    for load, words in (
        ({"lamina": "strip", "force": 1.0}, "load.1.position: missing"),
        ({"lamina": "strip", "position": 0.0, "force": 1.0}, "load.1: expected a place"),
        ({"lamina": "other", "per_length": 1.0}, "load.1.lamina"),
        ({"lamina": "strip", "per_length": 1.0, "axial": 2.0}, "load.1.force: expected one of"),
        ({"lamina": "strip", "per_length": 1.0, "position": 0.1}, "load.1.position"),
    ):
        with pytest.raises(df.CaseError, match=words):
            assemble(case_of(load=[load]), needs_dolfinx=False)


def test_weight_across_a_bar_is_refused() -> None:
    bar = {"lamina": [lamina("strip", motion="axial")]}
    assert case_of(**bar, gravity={"inclination": 30.0}).is_loaded
    with pytest.raises(df.CaseError, match=r"gravity\.inclination: expected an angle"):
        case_of(**bar, gravity={})


def table_tennis(**tables: Any) -> df.Case:
    """Return a free ball of 2.7 g above a table that moves."""
    data: dict[str, Any] = {
        "name": "ball",
        "lamina": [{"name": "ball", "mass": 0.0027, "stiffness": 0.0, "damping_ratio": 0.0}],
        "mesh": {"elements": 1},
        "stop": [{"lamina": "ball", "side": "below", "gap": 0.0}],
        "gravity": {},
        "excitation": {"kind": "harmonic", "frequency": 10.0, "amplitude": 1e-3},
        "contact": {"law": "newton", "restitution": 0.5},
        "time": {"periods": 4, "steps_per_period": 1000, "scheme": "moreau-jean"},
        "output": {"window_periods": 4},
    }
    return df.Case(**(data | tables))


def test_a_ball_lies_on_its_table_and_moves_with_it() -> None:
    at_rest = df.rest(table_tennis())
    assert at_rest.contact_force.values == pytest.approx([0.0027 * G], rel=1e-9)
    case = table_tennis(contact={"law": "newton", "restitution": 0.0})
    result = df.run(case, engine="compiled")  # Aω² = 3.9 m/s² < g
    q = 1e-3 * np.sin(2.0 * np.pi * 10.0 * result.history.time.values)
    ball = result.history.tip_displacement.values[0]
    # the base sets out with Aω, which the ball has from the end of the first step on
    assert np.abs(ball - q).max() == pytest.approx(2.0 * np.pi * 10.0 * 1e-3 * 0.5e-4, rel=1e-3)


def test_a_ball_falls_freely_if_the_run_does_not_begin_at_rest() -> None:
    case = table_tennis(
        stop=[{"lamina": "ball", "side": "below", "gap": 1.0, "on": "ground"}],
        time={"begin": "unloaded", "periods": 2, "steps_per_period": 100},
        contact={"law": "none"},
    )
    for engine in ("petsc", "compiled"):
        history = df.run(case, engine=engine).history  # type: ignore[call-overload]
        t = history.time.values
        assert np.abs(history.tip_displacement.values[0] + 0.5 * G * t**2).max() < 1e-12


def test_something_that_falls_for_ever_has_no_state_of_rest() -> None:
    with pytest.raises(df.CaseError, match="no state of rest"):
        df.rest(table_tennis(stop=[]))


@pytest.mark.parametrize("engine", ["petsc", "compiled"])
def test_a_pressed_point_lifts_off_at_the_acceleration_of_its_force(engine: EngineName) -> None:
    force = 0.0027 * 30.0
    lifts = []
    for acceleration in (29.9, 30.1):
        amplitude = acceleration / (2.0 * np.pi * 10.0) ** 2
        case = table_tennis(
            gravity=None,
            load=[{"lamina": "ball", "force": -force}],
            excitation={"kind": "harmonic", "frequency": 10.0, "amplitude": amplitude},
            contact={"law": "newton", "restitution": 0.0},
            time={"periods": 2, "steps_per_period": 4000, "scheme": "moreau-jean"},
        )
        history = df.run(case, engine=engine).history
        q = amplitude * np.sin(2.0 * np.pi * 10.0 * history.time.values)
        lifts.append(float(np.ptp(history.tip_displacement.values[0, 1:] - q[1:])) / amplitude)
    assert lifts[0] < 1e-5 < lifts[1]


def test_modes_say_at_which_drive_a_pressed_point_opens() -> None:
    force, stiffness = 0.5, 40.0
    case = table_tennis(
        gravity=None,
        lamina=[{"name": "ball", "mass": 0.0027, "stiffness": stiffness, "damping_ratio": 0.01}],
        load=[{"lamina": "ball", "force": -force}],
    )
    numbers = df.modes(case, 1).report.numbers
    assert numbers is not None
    # it moves with its base, so that neither spring nor damper counts: m A ω² = F, ω² = k / m
    assert numbers["opening_amplitude"] == pytest.approx([force / stiffness], rel=1e-9)
    assert df.modes(case.without_loads, 1).report.numbers["opening_amplitude"] == (None,)  # type: ignore[index]

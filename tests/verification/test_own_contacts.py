"""Contacts with numbers of their own beside `[contact]`: exact motions, relations, both engines.

A mass m without a spring of its own flies between contacts. A rigid contact sends it back with e
times its speed. An elastic one keeps it for π/ω_d, with ω_d² = k/m - (c/2m)², and sends it back
with exp(-π c / 2 m ω_d) times its speed: the damper acts until the gap is open.
"""

from __future__ import annotations

import math
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from covertable import make
from support import slow_beyond

from delam_fem import CaseError, Result, load_case, load_sweep, run, run_sweep, save_case
from delam_fem.api import COMBINATIONS, Case, EngineName, assemble, preset, reduced_case
from delam_fem.engines.session import ENGINES
from delam_fem.reference.loop import refused_motion
from delam_fem.studies.orbits.maps import CaseFamily

MASS, GAP = 2.0, 0.1003
POINT = {"name": "ball", "mass": MASS, "stiffness": 0.0, "damping_ratio": 0.0}
EXACT = 1e-12
"""m/s; round-off of some impacts at speeds of 1 m/s."""
SAME = 1e-8
"""Of the largest value; round-off that some impacts have amplified."""
CLOSED = 1e-9
"""Relative residual of the ledger; round-off of some hundred steps."""


def between(
    above: dict[str, Any], below: dict[str, Any], law: str, scheme: str, **contact: Any
) -> Case:
    """Return the case of a mass that flies between two stops at 1 m/s."""
    stop = {"lamina": "ball", "gap": GAP}
    force = {"kind": "force", "lamina": "ball", "amplitude": 0.0, "frequency": 1.0}
    return Case(
        name="between",
        lamina=[POINT],
        mesh={"elements": 1},
        excitation=force,
        contact={"law": law, "restitution": 0.9, **contact},
        initial=[{"lamina": "ball", "velocity": 1.0}],
        stop=[stop | {"side": "above"} | above, stop | {"side": "below"} | below],
        time={"scheme": scheme, "steps_per_period": 2000, "periods": 6},
        output={"window_periods": 6, "fields_per_period": 0},
    )


def flights(result: Result) -> list[float]:
    """Return the velocities of the free flights, one after the other [m/s]."""
    history = result.history
    v = history["tip_velocity"].to_numpy()[0]
    is_free = np.abs(history["tip_displacement"].to_numpy()[0]) < 0.9 * GAP
    begins = np.flatnonzero(np.diff(is_free.astype(int)) == 1) + 1
    return [1.0, *v[begins].tolist()]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("scheme", ["newmark", "central-difference", "moreau-jean"])
def test_each_stop_has_its_restitution(scheme: str, engine: EngineName) -> None:
    case = between({"restitution": 0.5}, {"restitution": 0.8}, "newton", scheme)
    speeds = flights(run(case, engine))
    factors = np.resize([0.5, 0.8], len(speeds) - 1)
    expected = np.cumprod([1.0, *-factors])
    assert len(speeds) > 5
    np.testing.assert_allclose(speeds, expected, rtol=0.0, atol=EXACT)


def test_impulses_and_approach_of_each_stop_are_its_own() -> None:
    case = between({"restitution": 0.5}, {}, "newton", "newmark")
    above, below = run(case, "compiled").summary["contacts"]
    speeds = np.cumprod([1.0, 0.5, 0.9, 0.5, 0.9, 0.5, 0.9])
    for contact, first, e in ((above, 0, 0.5), (below, 1, 0.9)):
        n = round(6 * contact["strikes_per_period"])
        approach = speeds[first::2][:n].mean()
        assert contact["approach_velocity"] == pytest.approx(approach, rel=1e-9)
        assert contact["impulse"] == pytest.approx(MASS * (1.0 + e) * approach, rel=1e-9)
        assert contact["peak_force"] is None


SPRINGS = [{"stiffness": 400.0}, {"stiffness": 90.0, "damping": 3.0}]


def elastic(k: float, c: float) -> tuple[float, float]:
    """Return the time in contact with a spring [s], and the factor of the speed."""
    omega = math.sqrt(k / MASS - (0.5 * c / MASS) ** 2)
    return math.pi / omega, math.exp(-0.5 * math.pi * c / (MASS * omega))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("law", "scheme"),
    [("penalty", "newmark"), ("newton", "newmark"), ("newton", "central-difference"),
     ("newton-penalty", "newmark")],
)  # fmt: skip
def test_each_stop_has_its_spring_and_damper(law: str, scheme: str, engine: EngineName) -> None:
    """Times of contact and speeds are those of each spring, in any law."""
    result = run(between(*SPRINGS, law, scheme), engine)
    (first, same), (second, loss) = elastic(400.0, 0.0), elastic(90.0, 3.0)
    speeds = flights(result)
    expected = np.cumprod([1.0, *np.resize([-same, -loss], len(speeds) - 1)])
    np.testing.assert_allclose(speeds, expected, rtol=2e-3, atol=0.0)
    above, below = result.summary["contacts"]
    for contact, duration in ((above, first), (below, second)):
        n = 6 * contact["strikes_per_period"]
        assert n >= 4
        # a strike ends and begins at steps; the last one may be cut off by the end of the run
        assert contact["closed_share"] * 6.0 / n == pytest.approx(duration, rel=1.0 / (n - 1))
    assert above["peak_force"] == pytest.approx(math.sqrt(400.0 * MASS), rel=1e-3)
    if scheme == "newmark":
        assert result.summary["energy_residual"] < CLOSED


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("law", ["newton", "newton-penalty"])
def test_a_rigid_stop_beside_an_elastic_one(law: str, engine: EngineName) -> None:
    result = run(between({"stiffness": 400.0}, {"restitution": 0.7}, law, "newmark"), engine)
    speeds = flights(result)
    expected = np.cumprod([1.0, *np.resize([-1.0, -0.7], len(speeds) - 1)])
    np.testing.assert_allclose(speeds, expected, rtol=1e-3, atol=0.0)
    above, below = result.summary["contacts"]
    assert above["peak_force"] == pytest.approx(math.sqrt(400.0 * MASS), rel=1e-3)
    assert below["peak_force"] is None
    assert set(result.history["event_stop"].to_numpy().tolist()) == {1}, "springs have no events"
    assert result.summary["energy_residual"] < CLOSED


@pytest.mark.parametrize("engine", ENGINES)
def test_a_rigid_stop_rests_on_its_own_spring_below_its_own_threshold(engine: EngineName) -> None:
    """e = 0 leaves the mass at rest at the stop; a force F presses it into k by 2 F/k and back."""
    stop = {"restitution": 0.0, "stiffness": 5e3, "threshold_velocity": 0.05}
    case = between(stop, {}, "newton-penalty", "newmark", threshold_velocity=0.0)
    force = {"amplitude": 40.0, "frequency": 1e-2, "kind": "force", "lamina": "ball"}
    case = case.with_overrides(
        {"excitation": force, "time.steps_per_period": 100_000, "time.periods": 1,
         "output.window_periods": 1, "initial": []}
    )  # fmt: skip
    history = run(case, engine).history
    u = history["tip_displacement"].to_numpy()[0]
    largest = int(np.argmax(history["force"].to_numpy()))
    mean = u[largest - 3000 : largest + 3000].mean()
    assert mean - GAP == pytest.approx(40.0 / 5e3, rel=0.02)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("scheme", ["newmark", "moreau-jean"])
def test_each_interface_has_its_restitution(scheme: str, engine: EngineName) -> None:
    """Three carts: the middle one strikes the upper (e = 0.2), then the lower (e = 0.75)."""
    masses = {"lower": 3.0, "middle": 1.0, "upper": 0.5}
    laminae = [
        {"name": name, "mass": m, "stiffness": 0.0, "damping_ratio": 0.0, "length": 1.0}
        for name, m in masses.items()
    ]
    gaps = {"start": 0.0, "end": 1.0, "opening": 0.05}
    case = Case(
        name="carts",
        lamina=laminae,
        mesh={"elements": 1},
        excitation={"kind": "force", "lamina": "middle", "amplitude": 0.0, "frequency": 1.0},
        contact={"law": "newton", "restitution": 0.0},
        delamination=[
            gaps | {"between": ["lower", "middle"], "restitution": 0.75},
            gaps | {"between": ["middle", "upper"], "restitution": 0.2},
        ],
        initial=[{"lamina": "middle", "velocity": 1.0}],
        time={"scheme": scheme, "steps_per_period": 2000, "periods": 1},
        output={"window_periods": 1, "fields_per_period": 0},
    )
    history = run(case, engine).history
    lower, middle, upper = history["tip_velocity"].to_numpy()[:, -1]
    v = np.array([0.0, 1.0, 0.0])
    m = np.array([*masses.values()])
    for a, b, e in ((1, 2, 0.2), (0, 1, 0.75)):
        if v[b] < v[a]:  # they meet
            p = (1.0 + e) * (v[a] - v[b]) / (1.0 / m[a] + 1.0 / m[b])
            v[a] -= p / m[a]
            v[b] += p / m[b]
    np.testing.assert_allclose([lower, middle, upper], v, rtol=0.0, atol=EXACT)


BASES = {
    "apart": ("paper", {"mesh.elements": 4, "excitation.frequency": 1.6,
                        "excitation.amplitude": 0.01}),
    "points within": ("paper", {"mesh.elements": 4, "excitation.frequency": 1.6,
                                "excitation.amplitude": 0.01, "contact.points_per_element": 2}),
    "layered": ("embedded", {"mesh.elements": 10, "excitation.frequency": 60.0,
                             "excitation.amplitude": 3.5e-4, "excitation.acceleration": None,
                             "contact.points_per_element": 1}),
    "bars": ("default", {}),
    "points": ("default", {}),
}  # fmt: skip
BAR = {"length": 0.3, "width": 0.02, "thickness": 0.002, "density": 2700.0,
       "young_modulus": 7e10, "damping_ratio": 0.01, "motion": "axial"}  # fmt: skip
OPEN = {"between": ["lower", "upper"], "opening": 2e-5}
SETTINGS = {
    "contact.penalty_stiffness": 300.0, "contact.penalty_damping": 0.3,
    "contact.threshold_velocity": 1e-2, "contact.restitution": 0.5,
    "time.steps_per_period": 400, "time.periods": 3, "output.window_periods": 3,
    "output.fields_per_period": 20,
}  # fmt: skip
METHODS = [
    (*key, impulse)
    for key, row in COMBINATIONS.items()
    for impulse in (("consistent", "lumped") if "impulse" in row.reads else ("consistent",))
    if key[0] != "none"
]
RIGID_ONE, OTHER_ONE = {"restitution": 0.1, "threshold_velocity": 0.0}, {"restitution": 0.9}
SPRING, DAMPED = {"stiffness": 500.0}, {"stiffness": 900.0, "damping": 0.6}
KINDS = {
    "rigid": (RIGID_ONE, OTHER_ONE),
    "first elastic": (DAMPED, OTHER_ONE),
    "second elastic": (RIGID_ONE, DAMPED),
    "elastic": (SPRING, DAMPED),
    "at rest on springs": (RIGID_ONE | SPRING, OTHER_ONE | {"stiffness": 200.0}),
}
"""Numbers of the first and of the second contact of a case."""
ARRAY = make(
    {
        "method": METHODS, "structure": [*BASES], "kind": [*KINDS], "refine": [1, 3, 12],
        "mass": ["consistent", "lumped"],
    },
    constraints=[
        {"operator": "fn", "requires": ["method", "kind"],
         "evaluate": lambda c: c["method"][1] != "moreau-jean" or "elastic" not in c["kind"]},
        {"operator": "fn", "requires": ["method", "structure"],
         "evaluate": lambda c: c["method"][2] != "lumped" or c["structure"] != "points within"},
    ],
)  # fmt: skip


def case_of(row: dict[str, Any], first: dict[str, Any], second: dict[str, Any]) -> Case:
    """Return a case with two contacts: laminae and a stop, or two delaminations."""
    (law, scheme, impulse), structure = row["method"], row["structure"]
    name, keys = BASES[structure]
    data = preset(name).model_dump(exclude_unset=True, exclude_none=True)
    data["contact"]["law"], data["time"]["scheme"] = law, scheme  # before they are checked
    stop = {"lamina": "thin", "side": "above", "gap": 2e-3, "position": 0.685} | second
    if structure == "layered":
        places = ({"start": 0.06, "end": 0.14}, {"start": 0.22, "end": 0.3})
        pairs = zip(places, (first, second), strict=True)
        data["delamination"] = [OPEN | place | numbers for place, numbers in pairs]
    elif structure in ("bars", "points"):
        one = (
            BAR if structure == "bars" else {"mass": 0.2, "stiffness": 80.0, "damping_ratio": 0.01}
        )
        data["lamina"] = [{"name": "thick"} | one, {"name": "thin"} | one]
        data["gap"] = {"tip": 1e-3, "exponent": 2.0} | first
        data["stop"] = [{k: v for k, v in stop.items() if k != "position"}]
        f = 4000.0 if structure == "bars" else 3.0
        data["excitation"] = {"kind": "force", "lamina": "thin", "amplitude": 0.4, "frequency": f}
        if structure == "bars":
            data["excitation"] |= {"position": 0.3, "amplitude": 2e4}
        data["mesh"] = {"elements": 4 if structure == "bars" else 1}
    else:
        data["gap"] |= first
        data["stop"] = [stop]
    if scheme == "central-difference":
        keys = keys | {"time.steps_per_period": 8000 if structure != "layered" else 4000}
    keys = SETTINGS | keys | {
        "contact.law": law, "contact.impulse": impulse, "time.scheme": scheme,
        "time.refine": row["refine"], "time.mass": row["mass"],
    }  # fmt: skip
    return Case.checked(data, "two contacts").with_overrides(keys)


@pytest.mark.parametrize(
    "row", slow_beyond(ARRAY), ids=lambda row: "-".join(map(str, row.values()))
)
def test_engines_agree(row: dict[str, Any]) -> None:
    case = case_of(row, *KINDS[row["kind"]])
    structure = assemble(case, needs_dolfinx=False)
    petsc, compiled = (run(case, engine, structure=structure) for engine in ENGINES)
    one, other = petsc.history, compiled.history
    events = one["event_time"].to_numpy()
    end = events[19] if events.size > 19 else math.inf  # round-off grows with each impact
    is_before = one["time"].to_numpy() < end
    for name in ("tip_displacement", "tip_velocity"):
        a, b = (history[name].to_numpy()[:, is_before] for history in (one, other))
        assert np.abs(b - a).max() < SAME * np.abs(a).max()
    if events.size <= 19:
        ledger = [name for name in one if str(name).startswith("energy_")]
        a, b = (np.array([history[name] for name in ledger]) for history in (one, other))
        assert np.abs(b - a).max() < SAME * np.abs(a).max()
        for first, second in zip(
            petsc.summary["contacts"], compiled.summary["contacts"], strict=True
        ):
            assert first.keys() == second.keys()
            for key in first:
                is_number = isinstance(first[key], float)
                expected = pytest.approx(second[key], rel=1e-6) if is_number else second[key]
                assert first[key] == expected, key
    if case.time.scheme != "central-difference":
        assert petsc.summary["energy_residual"] < CLOSED
        assert compiled.summary["energy_residual"] < CLOSED


EQUAL = make(
    {"method": METHODS, "structure": [*BASES], "engine": [*ENGINES], "refine": [1, 3],
     "mass": ["consistent"]},
    constraints=[
        {"operator": "fn", "requires": ["method", "structure"],
         "evaluate": lambda c: c["method"][2] != "lumped" or c["structure"] != "points within"},
    ],
)  # fmt: skip


@pytest.mark.parametrize(
    "row", slow_beyond(EQUAL), ids=lambda row: "-".join(map(str, row.values()))
)
def test_the_numbers_of_the_law_at_each_contact_change_no_bit(row: dict[str, Any]) -> None:
    """Those of `[contact]`, written at each contact; where springs rest, their stiffness too."""
    law = row["method"][0]
    numbers = {"restitution": 0.5, "threshold_velocity": 1e-2}
    if law == "newton-penalty":
        numbers |= {"stiffness": 300.0}
    if law == "penalty":
        numbers = {"stiffness": 300.0, "damping": 0.3}
    plain, same = (case_of(row, keys, keys) for keys in ({}, numbers))
    one, other = (
        run(case, row["engine"], structure=assemble(case, needs_dolfinx=False)).history
        for case in (plain, same)
    )
    for name in one.data_vars:
        np.testing.assert_array_equal(one[name], other[name], err_msg=str(name))


REFUSED: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "an elastic stop within a step": (
        {"stop": [{"lamina": "thin", "side": "above", "gap": 1e-3, "stiffness": 1e3}],
         "contact.law": "newton@moreau-jean"},
        {}, "stop.1.stiffness",
    ),
    "an elastic interface within a step": (
        {"gap.stiffness": 1e3, "contact.law": "newton@moreau-jean"}, {}, "gap.stiffness",
    ),
    "damping alone": ({"gap.damping": 1.0}, {}, "gap.damping"),
    "restitution above 1": ({"gap.restitution": 1.2}, {}, "gap.restitution"),
    "a ball that bounces": (
        {"impactor": [{"lamina": "thin", "mass": 0.1, "radius": 0.01, "velocity": 1.0,
                       "restitution": 0.5}]},
        {}, "impactor.1.restitution",
    ),
    "nothing to be a multiple of": (
        {"gap.stiffness": 1e3, "contact.law": "penalty", "contact.penalty_stiffness": 0.0,
         "stop": [{"lamina": "thin", "side": "above", "gap": 1e-3}]},
        {}, "contact.penalty_stiffness",
    ),
    "massless points that bounce": (
        {"gap.restitution": 0.3, "contact.restitution": 0.0, "time.mass": "massless",
         "contact.law": "newton@moreau-jean", "time.refine": 4},
        {}, "gap.restitution",
    ),
    "massless points on springs": (
        {"gap.stiffness": 1e3, "contact.restitution": 0.0, "time.mass": "massless",
         "contact.law": "newton@moreau-jean", "time.refine": 4},
        {}, "gap.stiffness",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_go_together_is_told(name: str) -> None:
    keys, _, expected = REFUSED[name]
    with pytest.raises(CaseError, match=expected.replace(".", r"\.")):
        preset("paper", keys)


def two_contacts(**keys: object) -> Case:
    """Return two laminae with e of their own, and an elastic stop."""
    row = {"method": ("newton", "newmark", "consistent"), "structure": "apart", "refine": 3,
           "mass": "consistent"}  # fmt: skip
    return case_of(row, {"restitution": 0.2}, SPRING).with_overrides(keys)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_checkpoint_goes_on_bit_for_bit(engine: EngineName, tmp_path: Path) -> None:
    def interrupt(done: int, _: int) -> None:
        if done == 1:
            signal.raise_signal(signal.SIGINT)

    case = two_contacts()
    at_once = run(case, engine).history
    run(case, engine, directory=tmp_path, progress=interrupt, checkpoint_seconds=0.0)
    after = run(case, engine, directory=tmp_path, resume=True).history
    for name in at_once.data_vars:
        np.testing.assert_array_equal(after[name], at_once[name], err_msg=str(name))


SWEEP = """
name = "own"
base = "case.toml"

[[axis]]
key = "{key}"
values = [0.2, 0.7]

[record]
strobes = 2
"""


@pytest.mark.slow
@pytest.mark.parametrize("key", ["gap.restitution", "stop.1.stiffness"])
def test_a_sweep_over_a_number_of_a_contact_is_its_runs(key: str, tmp_path: Path) -> None:
    case = two_contacts()
    save_case(case, tmp_path)
    (tmp_path / "sweep.toml").write_text(SWEEP.format(key=key))
    data = run_sweep(load_sweep(tmp_path / "sweep.toml"), tmp_path / "sweep", workers=1)
    for k, value in enumerate((0.2, 0.7)):
        structure = assemble(changed := case.with_overrides({key: value}), needs_dolfinx=False)
        summary = run(changed, "compiled", structure=structure).summary
        np.testing.assert_array_equal(data["tip_max"][k], summary["tip_max"])
    assert data["tip_max"][0].to_numpy().tolist() != data["tip_max"][1].to_numpy().tolist()


def test_orbits_take_numbers_of_contacts() -> None:
    """The map with e at the only contact is that with e of the law, and e is a parameter."""
    keys = {"mesh.elements": 4, "time.steps_per_period": 200, "contact.law": "newton@newmark"}
    case = preset("paper", keys)
    of_law = CaseFamily(case, "contact.restitution").problem(0.3)
    of_contact = CaseFamily(case, "gap.restitution").problem(0.3)
    other = CaseFamily(case, "gap.restitution").problem(0.6)
    state = np.zeros(2 * of_law.operators.n_dofs)
    for _ in range(4):
        before, state = state, of_law.end(state, 0.0)
        np.testing.assert_array_equal(of_contact.end(before, 0.0), state)
    assert np.abs(other.end(before, 0.0) - state).max() > 1e-6


def test_modes_have_the_numbers_of_their_beams(tmp_path: Path) -> None:
    row = {"method": ("newton-penalty", "newmark", "consistent"), "structure": "layered",
           "refine": 1, "mass": "consistent"}  # fmt: skip
    case = case_of(row, RIGID_ONE | SPRING, DAMPED)
    _, path = reduced_case(case, 6).save(tmp_path)
    full, modes = (assemble(c, needs_dolfinx=False).operators for c in (case, load_case(path)))
    np.testing.assert_allclose(modes.pair_weights, full.pair_weights, rtol=1e-15)
    for name in ("is_elastic", "restitution", "relaxation", "threshold", "shares"):
        both = (getattr(o.pair_numbers, name) for o in (modes, full))
        np.testing.assert_array_equal(*both, err_msg=name)
    assert full.pair_numbers.is_elastic.tolist() == [False, True]


def test_the_independent_solver_says_that_it_does_not_have_them() -> None:
    assert refused_motion(two_contacts(stop=[])).startswith("gap.restitution")


def test_solids_have_them_as_beams() -> None:
    """A plane with e of the law at its delamination has the bits of the law's e."""
    keys = {"model.kind": "plane-stress", "mesh.elements": 10, "time.steps_per_period": 60,
            "time.periods": 2, "output.window_periods": 2, "delamination.1.opening": 1e-5,
            "excitation.acceleration": 20.0, "contact.restitution": 0.4}  # fmt: skip
    plain = preset("embedded", keys)
    one, same, other = (
        run(plain.with_overrides({"delamination.1.restitution": e})).history["tip_displacement"]
        for e in (None, 0.4, 0.0)
    )
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1e-9

"""Weight and loads of solids: frequencies under axial stress, static shapes, rest, modes, ranks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi_pool import Crew
from plates import patched, plate

import delam_fem as df
from delam_fem.api import Case, CaseError, assemble, lowest, reduced_case

L, B, H, RHO, E = 0.3, 0.03, 0.002, 7850.0, 2.1e11
EI = E * B * H**3 / 12.0
LINE_MASS = RHO * B * H
G = 9.80665
SLENDER = 2e-3
"""Of a solid beside a beam: shear, and elements of degree 2."""


def case_of(*names: str, **tables: Any) -> Case:
    """Return a case of steel strips as solids, with other tables in place of its own."""
    strip = {
        "length": L, "width": B, "thickness": H, "density": RHO, "young_modulus": E,
        "damping_ratio": 0.02,
    }  # fmt: skip
    data: dict[str, Any] = {
        "name": "strip",
        "lamina": [strip | {"name": name} for name in names or ("strip",)],
        "model": {"kind": "plane-stress"},
        "mesh": {"elements": 20},
        "excitation": {"kind": "none"},
        "contact": {"law": "none"},
        "time": {"step": 1e-3, "duration": 0.05},
    }
    return df.Case(**(data | tables))


def upright(gamma: float, **tables: Any) -> Case:
    """Return a strip that stands (γ above 0) or hangs, with γ = ρ A g L³ / EI."""
    gravity = {
        "acceleration": abs(gamma) * EI / (LINE_MASS * L**3),
        "inclination": 90.0 if gamma > 0.0 else -90.0,
    }
    return case_of(gravity=gravity, **tables)


@pytest.mark.parametrize(("gamma", "root"), [(1.0, 3.284923383), (4.0, 2.462967205),
                                             (-10.0, 5.291783357)])  # fmt: skip
def test_a_strip_that_stands_or_hangs_has_the_frequency_of_a_beam(
    gamma: float, root: float
) -> None:
    o = assemble(upright(gamma)).operators
    (frequency,), _ = lowest(o.stiffness, o.mass, 1)
    assert 2.0 * np.pi * frequency * np.sqrt(LINE_MASS * L**4 / EI) == pytest.approx(
        root, rel=SLENDER
    )
    if gamma > 0.0:
        assert o.buckling_factor == pytest.approx(7.8373474 / gamma, rel=SLENDER)
    else:
        assert o.buckling_factor is None


def test_a_plate_strip_that_stands_has_the_frequency_of_a_beam() -> None:
    o = assemble(upright(4.0, model={"kind": "solid"}, mesh={"elements": 10})).operators
    (frequency,), _ = lowest(o.stiffness, o.mass, 1)
    value = 2.0 * np.pi * frequency * np.sqrt(LINE_MASS * L**4 / EI)
    assert value == pytest.approx(2.462967205, rel=5e-3)


def test_what_its_weight_buckles_is_refused() -> None:
    with pytest.raises(CaseError, match=r"buckles: it bears 0\.98"):
        assemble(upright(8.0))


def test_a_mass_at_the_tip_presses_too() -> None:
    """P = m g buckles a cantilever at π² EI / 4 L², without the weight of the strip."""
    mass = 0.2
    g = 0.5 * np.pi**2 * EI / (4.0 * L**2) / mass
    light = {"density": 1e-3 * RHO}
    case = case_of(
        gravity={"acceleration": g, "inclination": 90.0},
        point_mass=[{"lamina": "strip", "position": L, "mass": mass}],
    )
    case = case.with_overrides({f"lamina.strip.{key}": value for key, value in light.items()})
    assert assemble(case).operators.buckling_factor == pytest.approx(2.0, rel=SLENDER)


def test_tension_raises_the_frequency_of_a_pinned_strip() -> None:
    tension = 500.0
    ends = {"start": "pinned", "end": "pinned"}
    o = assemble(case_of(support=ends, load=[{"axial": tension}])).operators
    (frequency,), _ = lowest(o.stiffness, o.mass, 1)
    k = np.pi / L
    exact = np.sqrt((EI * k**4 + tension * k**2) / LINE_MASS) / (2.0 * np.pi)
    assert frequency == pytest.approx(exact, rel=SLENDER)


@pytest.mark.parametrize(("roll", "inclination"), [(0.0, 0.0), (180.0, 0.0), (60.0, 30.0)])
def test_a_strip_sags_as_a_beam_does(roll: float, inclination: float) -> None:
    gravity = {"acceleration": G, "roll": roll, "inclination": inclination}
    beam, solid = (
        assemble(case_of(gravity=gravity, model={"kind": kind})).operators
        for kind in ("beam", "plane-stress")
    )
    tips = [o.probes @ o.equilibrium.displacement for o in (beam, solid)]
    assert tips[1] == pytest.approx(tips[0], rel=SLENDER)


def test_two_strips_that_lie_on_each_other_press_as_beams_do() -> None:
    tables = {
        "gravity": {"acceleration": G},
        "gap": {"tip": 2e-4, "exponent": 1.0},
        "load": [{"lamina": "upper", "position": L, "force": -1.0}],
        "contact": {"law": "newton@moreau-jean", "impulse": "consistent"},
    }
    forces = []
    for kind in ("beam", "plane-stress"):
        o = assemble(case_of("lower", "upper", **tables, model={"kind": kind})).operators
        forces.append(float(o.equilibrium.force.sum()))
    assert forces[0] > 0.1
    assert forces[1] == pytest.approx(forces[0], rel=1e-2)


def sheet(**tables: Any) -> Case:
    """Return a clamped plate of 4 × 4 cells with a sensor beside its middle line."""
    sensor = {"name": "corner", "quantity": "displacement", "lamina": "sheet",
              "position": [0.2, -0.09], "surface": "top"}  # fmt: skip
    return plate({"start": "clamped"}, 4, 4, **({"sensor": [sensor]} | tables))


def test_a_force_acts_at_its_place_on_a_plate() -> None:
    """Maxwell: what a force there does here, a force here does there; the other side differs."""
    places = {"corner": [0.2, -0.09], "inside": [0.11, 0.05]}
    responses = {}
    for (read, sensor_at), (_, force_at) in (
        (("corner", places["corner"]), ("inside", places["inside"])),
        (("inside", places["inside"]), ("corner", places["corner"])),
        (("mirrored", [0.11, -0.05]), ("corner", places["corner"])),
    ):
        force = {"lamina": "sheet", "position": force_at, "force": 2.0, "surface": "top"}
        sensor = {"name": "here", "quantity": "displacement", "lamina": "sheet",
                  "position": sensor_at, "surface": "top"}  # fmt: skip
        o = assemble(sheet(load=[force], sensor=[sensor])).operators
        assert o.equilibrium is not None and o.sensors is not None
        responses[read] = float((o.sensors @ o.equilibrium.displacement)[0])
    assert responses["corner"] == pytest.approx(responses["inside"], rel=1e-9)
    assert abs(responses["mirrored"]) > 1.2 * abs(responses["inside"])


def test_the_weight_of_a_mass_on_a_plate_acts_at_its_place() -> None:
    spot = {"lamina": "sheet", "position": [0.15, 0.06], "surface": "top"}
    mass = assemble(sheet(point_mass=[spot | {"mass": 0.02}], gravity={})).operators
    alone = assemble(sheet(gravity={})).operators
    force = assemble(sheet(load=[spot | {"force": -0.02 * G}])).operators
    assert mass.load is not None and alone.load is not None and force.load is not None
    size = np.abs(force.load).max()
    assert mass.load - alone.load == pytest.approx(force.load, abs=1e-9 * size)


def test_places_of_loads_are_those_of_plates_alone() -> None:
    for table, words in (
        ({"position": [0.1, 0.0], "force": 1.0}, "load.1.position: expected a number but on a"),
        ({"position": 0.1, "force": 1.0, "surface": "top"}, "load.1.surface: expected none but"),
        ({"per_length": 1.0, "surface": "top"}, "load.1.surface: expected only with a force"),
    ):
        with pytest.raises(CaseError, match=words):
            case_of(load=[{"lamina": "strip"} | table])
    with pytest.raises(CaseError, match=r"load\.1\.position: expected z from"):
        sheet(load=[{"lamina": "sheet", "position": [0.1, 0.2], "force": 1.0}])


@pytest.mark.parametrize("kind", ["plane-stress", "solid"])
def test_what_floats_lies_on_two_stops_by_the_law_of_the_lever(kind: str) -> None:
    """Of a strip with free ends; a single stop beside its middle does not hold it."""
    stops = [
        {"lamina": "strip", "position": 0.1, "side": "below", "gap": 1e-4},
        {"lamina": "strip", "position": 0.25, "side": "below", "gap": 2e-4},
    ]
    data: dict[str, Any] = {
        "name": "floating",
        "lamina": [
            {"name": "strip", "length": 0.4, "width": 0.02, "thickness": 3e-3,
             "density": 2700.0, "young_modulus": 7e10, "damping_ratio": 0.01}
        ],
        "model": {"kind": kind, "poisson": 0.0},
        "mesh": {"elements": 12},
        "support": [{"side": side, "kind": "free"} for side in ("start", "end")],
        "stop": stops,
        "gravity": {"acceleration": 9.81},
        "contact": {"law": "newton@moreau-jean"},
        "excitation": {"kind": "force", "lamina": "strip", "position": 0.2, "amplitude": 0.01,
                       "frequency": 30.0},
    }  # fmt: skip
    equilibrium = assemble(Case(**data)).operators.equilibrium
    assert equilibrium is not None
    weight = 0.4 * 0.02 * 3e-3 * 2700.0 * 9.81
    assert equilibrium.force == pytest.approx([weight / 3.0, weight / 1.5], rel=1e-6)
    with pytest.raises(CaseError, match="no state of rest"):
        assemble(Case(**data | {"stop": stops[:1]}))


def test_a_run_that_begins_at_rest_stays_there() -> None:
    tables = {
        "gravity": {"acceleration": G}, "gap": {"tip": 2e-4, "exponent": 1.0},
        "load": [{"between": ["lower", "upper"], "per_length": 2.0}],
        "contact": {"law": "newton@moreau-jean", "impulse": "consistent"},
    }  # fmt: skip
    result = df.run(case_of("lower", "upper", **tables))
    equilibrium = result.summary["rest"]
    assert result.history["tip_displacement"].to_numpy() == pytest.approx(
        np.array(equilibrium["tip_displacement"])[:, None] * np.ones(52), abs=1e-9
    )
    assert equilibrium["contact_force"]["lower-upper"] > 0.1
    assert np.abs(result.history["energy_residual"]).max() < 1e-10


def test_a_reduced_model_keeps_weight_and_loads(tmp_path: Path) -> None:
    tables = {
        "gravity": {"acceleration": G, "inclination": 40.0},
        "load": [{"lamina": "strip", "position": 0.2, "force": 3.0}, {"axial": 50.0}],
        "excitation": {"kind": "harmonic", "frequency": 20.0, "amplitude": 1e-3},
        "time": {"steps_per_period": 100, "periods": 2},
    }
    case = case_of(**tables)
    file, _ = reduced_case(case, modes=8).save(tmp_path)
    reduced = case.with_overrides({"model.kind": "modes", "model.file": str(file)})
    full, modes = (df.run(one) for one in (case, reduced))
    rests = [run.summary["rest"] for run in (full, modes)]
    assert rests[1]["tip_displacement"] == pytest.approx(rests[0]["tip_displacement"], rel=1e-6)
    assert rests[1]["buckling_factor"] == rests[0]["buckling_factor"]
    tips = [run.history["tip_displacement"].to_numpy() for run in (full, modes)]
    assert tips[1] == pytest.approx(tips[0], abs=1e-3 * np.abs(tips[0]).max())
    with pytest.raises(CaseError, match=r"gravity\.inclination: expected 40\.0"):
        assemble(reduced.with_overrides({"gravity.inclination": 41.0}))


SCRIPT = """
import json
import numpy as np
import delam_fem as df
from delam_fem.api import assemble, reduced_case
from delam_fem.cli.endings import ended_together
from delam_fem.model.sharing import shared

RUNS, LINEAR = (json.loads(argument) for argument in arguments)
CLOSE = 1e-7  # of the largest value of a signal


def off(one, many):
    one, many = (np.nan_to_num(np.array(values, dtype=float)) for values in (one, many))
    return np.abs(one - many).max() / (np.abs(one).max() or 1.0)


def linear(case):
    modes, model = df.modes(case, 4), reduced_case(case, 4)
    o = model.structure.operators
    flexible = (o.gap_matrix.toarray() / o.stiffness.diagonal()) @ o.gap_matrix.T.toarray()
    moved = o.gap_matrix @ (o.load / o.stiffness.diagonal())
    return modes.frequencies, modes.buckling_factor or 0.0, flexible, moved


with ended_together(comm):
    for data in RUNS:
        case = df.Case(**data)
        operators = assemble(case, comm=comm).operators
        assert operators.n_own < operators.n_dofs
        many = df.run(case, comm=comm)
        if comm.rank > 0:
            continue
        one = df.run(case)
        for name in one.history:
            if str(name).startswith(("tip_", "sensor_", "displacement", "contact_force")):
                a, b = (run.history[name].to_numpy() for run in (one, many))
                assert off(a, b) < CLOSE, (case.name, name, off(a, b))
        a, b = (run.summary["rest"] for run in (one, many))
        assert off(a["tip_displacement"], b["tip_displacement"]) < CLOSE, (a, b)
        assert off([*a["contact_force"].values()], [*b["contact_force"].values()]) < CLOSE, (a, b)
        assert off(a["buckling_factor"] or 0.0, b["buckling_factor"] or 0.0) < CLOSE, (a, b)
        for name in ("settled", "blow_steps", "outcome"):
            assert str(one.summary[name]) == str(many.summary[name]), name
    for data in LINEAR:
        case = df.Case(**data)
        many = shared(comm, lambda: linear(case))
        if comm.rank == 0:
            for a, b in zip(linear(case), many):
                assert off(a, b) < 1e-9, (case.name, off(a, b))
"""
SHORT = {"time": {"steps_per_period": 40, "periods": 1},
         "output": {"fields_per_period": 4, "window_periods": 1}}  # fmt: skip
RIGID = {"contact": {"law": "newton@moreau-jean", "impulse": "consistent"}}


def sent(*cases: Case) -> str:
    """Return cases as an argument of a program of ranks."""
    return "[" + ", ".join(case.model_dump_json(exclude_unset=True) for case in cases) + "]"


def loaded_solids() -> tuple[Case, ...]:
    """Return solids under weight and loads: strips that stand, a pressed plate, one on a stop."""
    base = {"kind": "harmonic", "frequency": 20.0, "amplitude": 1e-3}
    upright = case_of(
        "lower", "upper", gravity={"inclination": 80.0, "gaps": "in place"}, gap={"tip": 2e-3},
        excitation=base,
        load=[{"lamina": "upper", "position": 0.2, "force": 0.02}], mesh={"elements": 6},
        **SHORT, **RIGID,
    )  # fmt: skip
    pressed = patched(
        6, gravity={"roll": 30.0},
        load=[{"between": ["lower", "upper"], "per_length": 20.0},
              {"lamina": "upper", "position": [0.1, 0.04], "force": -2.0, "surface": "top"}],
        **SHORT, **RIGID,
    )  # fmt: skip
    stop = {"lamina": "strip", "position": 0.27, "side": "below", "gap": 0.0, "on": "ground"}
    drive = base | {"kind": "force", "lamina": "strip", "position": L, "amplitude": 0.5}
    lying = case_of(
        gravity={}, stop=[stop], mesh={"elements": 6}, excitation=drive, **SHORT, **RIGID
    )
    return upright, pressed, lying


@pytest.mark.mpi
def test_ranks_share_strips_with_weight_and_loads(crew: Crew) -> None:
    """The buckling factor, the state of rest and what follows are those of one rank."""
    upright, _, _ = loaded_solids()
    crew.run(2, SCRIPT, sent(upright), sent())


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_share_plates_with_weight_and_loads(ranks: int, crew: Crew) -> None:
    """Pairs are pressed together; modes, too, and what a reduced model has."""
    _, pressed, lying = loaded_solids()
    crew.run(ranks, SCRIPT, sent(pressed, lying), sent(pressed))

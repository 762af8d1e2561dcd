"""Orbits of maps in closed form, and maps of cases, in full; kicks, periods and grids differ."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import golden
import numpy as np
import pytest
from mixed import STOPS, apart
from toys import Cubic, DelayedLogistic, Henon, Steep

from delam_fem.case.definition import Case
from delam_fem.studies.orbits.maps import CaseFamily, ModalMap, Nature, PeriodMap, Problem, tip_of
from delam_fem.studies.orbits.newton import (
    Border,
    Ensemble,
    Guess,
    Perturbations,
    Powered,
    by_parameter,
    derivative,
    newton,
    shoot,
    solved,
)
from delam_fem.studies.orbits.search import (
    alternating,
    coarse_orbit,
    exact_orbit,
    map_of,
    mean_of_motion,
    multipliers,
    run_on,
    sampled,
    settled,
    start_of,
    usual,
    within,
)

Check = Callable[..., None]
GIVEN = Perturbations(copies=6, size=0.03, kick=0.05, seed=4)
BEGIN = np.array([0.6, 0.4])
MAPS: dict[str, tuple[Any, float, int]] = {
    "Henon": (Henon(), 0.3, 1),
    "Henon, doubled": (Henon(), 0.62, 2),
    "rough": (Henon(0.004), 0.25, 1),
    "logistic": (DelayedLogistic(), 1.8, 1),
    "turning": (DelayedLogistic(), 2.06, 3),
    "cubic": (Cubic(), 0.7, 1),
    "steep": (Steep(), 1.3, 2),
}


def of_solved(found: Any) -> dict[str, Any]:
    """Return a solved point without what is round-off."""
    small = found.residual < 1e-9
    return {
        "state": found.state, "parameter": found.parameter, "scale": found.scale,
        "residual": 0.0 if small else found.residual,
        "error": 0.0 if found.residual_error < 1e-9 else found.residual_error,
        "uncertainty": np.where(found.uncertainty < 1e-9, 0.0, found.uncertainty),
        "solved": found.is_solved, "n": found.iterations,
        "away": 0.0 if found.away < 1e-9 else found.away,
    }  # fmt: skip


@pytest.mark.parametrize("name", MAPS)
def test_orbits_of_maps_are_the_stored_ones(name: str, stored: Check) -> None:
    map_, a, periods = MAPS[name]
    state = settled(map_, a, BEGIN, 200)
    scale = float(np.linalg.norm(state))
    ensemble = Ensemble(map_, periods, GIVEN)
    mean = ensemble.mean(state, a, scale)
    J = ensemble.derivatives(state, a, scale)
    at = Guess(state, a, scale)
    decays = ensemble.decays(state, a, scale)
    found = multipliers(decays, 3)
    tangent = np.array([0.48, 0.6, 0.64])
    border = Border(tangent, np.array([0.7, 0.3, 1.1]), 0.5, by_parameter(ensemble, at, 0.02))
    bordered = solved(ensemble, at, J.mean(axis=0), border)
    alone = solved(ensemble, at, J.mean(axis=0))
    root = newton(map_, state + 0.01, a, periods, shift=0.25)
    shot = shoot(map_, state + 0.02, a, periods=periods, iterations=6, kick=0.04)
    states, multiple = sampled(map_, a, state, 1)
    middle, scatter, _ = mean_of_motion(map_, a, state, periods)
    told = {
        "offsets": GIVEN.offsets(3), "shifts": GIVEN.shifts(), "mean": mean, "J": J,
        "decays": np.where(np.abs(decays) < 1e-6, 0.0, decays), "values": found.values,
        "errors": None if "doubled" in name else found.errors,  # of the state's round-off there
        "largest": found.largest, "fitted": found.derivative,
        "stability": [found.stability, found.of_larger], "doubling": found.doubling,
        "torus": found.torus, "angle": found.angle, "by": border.by_parameter,
        "bordered": of_solved(bordered), "alone": of_solved(alone),
        "root": [root.state, root.shift, root.iterations], "exact": root.is_exact,
        "powered": derivative(Powered(map_, a, periods, 0.1), state, 1e-4),
        "shot": shot,
        "states": states, "multiple": multiple, "middle": middle,
        "scatter": scatter if scatter > 1e-6 else 0.0,
        "kick": within(ensemble, at, multiple).perturbations.kick,
    }  # fmt: skip
    away, beside = run_on(ensemble, alone)
    told |= {"away": away if away > 1e-6 else 0.0, "beside": beside}
    if name in ("Henon, doubled", "turning", "steep"):
        told["alternating"] = alternating(Ensemble(map_, 1, GIVEN), at)
    stored(golden.of_object(told))


@pytest.mark.parametrize("name", ["Henon, doubled", "rough", "logistic", "steep"])
def test_searches_are_the_stored_ones(name: str, stored: Check) -> None:
    map_, a, periods = MAPS[name]
    state = settled(map_, a, BEGIN, 150)
    coarse = coarse_orbit(map_, a, state, periods, GIVEN)
    own = coarse.multipliers
    told = {
        "coarse": of_solved(coarse.solved), "kick": coarse.kick, "stability": coarse.stability,
        "away": coarse.away if coarse.away > 1e-6 else 0.0, "multiple": coarse.multiple,
        "values": own.values, "largest": own.largest,
        "errors": None if "doubled" in name else own.errors,  # of the state's round-off there
    }  # fmt: skip
    exact, best = exact_orbit(map_, a, state, periods)
    told |= {"best": best.state if best.residual < 1e-6 else None, "shift": best.shift}
    told |= {"exact": None if exact is None else exact.values}
    stored(golden.of_object(told))


def case_of(**more: Any) -> Case:
    """Return laminae that clap between stops."""
    given = {
        "mesh": {"elements": 4}, "sensor": [], "impactor": [], "stop": STOPS[1:2],
        "excitation": {"kind": "harmonic", "amplitude": 2e-3, "frequency": 27.0},
        "time": {"steps_per_period": 120, "periods": 5}, "point_mass": [],
        "contact": {"law": "newton", "restitution": 0.3},
    }  # fmt: skip
    return apart(**given | more)


def of_map(map_: PeriodMap, parameter: float, moved: float) -> dict[str, Any]:
    """Return what a map does to states that differ."""
    state = settled(map_, parameter, None, 6)
    sizes = map_.nature.scales(state)
    states = state + moved * sizes * np.cos(np.arange(3 * state.size)).reshape(3, -1)
    opened, begun = map_.opened(state, parameter)
    return {
        "nature": [map_.nature.name, repr(map_.nature.parts), map_.nature.is_stepped],
        "scales": sizes, "basis": np.abs(map_.slow.basis), "dual": np.abs(map_.slow.dual),
        "unit": map_.slow.dual @ map_.slow.basis, "of": np.abs(map_.slow.of(states)),
        "lifted": map_.slow.lifted(map_.slow.of(states)),
        "after": map_.after(states, parameter),
        "shifted": map_.after(states, parameter, np.array([-0.3, 0.0, 0.41])),
        "elsewhere": map_.after(states, 1.1 * parameter), "seen": map_.watched(state, parameter, 3),
        "phase": getattr(opened, "phase", None), "begun": begun,
        "opened": opened.watched(begun, parameter, 2),
        "further": opened.after(begun[None], parameter, np.array([0.2])),
        "again": getattr(opened.opened(opened.after(begun[None], parameter)[0], parameter)[0],
                         "phase", None),
    }  # fmt: skip


def test_maps_of_cases_are_the_stored_ones(stored: Check) -> None:
    case = case_of()
    family = CaseFamily(case, "excitation.frequency")
    problem = family.problem(26.0)
    assert isinstance(problem, Problem)
    found = of_map(family.map(), 26.5, 0.02)
    found |= {"tip": tip_of(family.structure(case)), "of 26": problem.span.time_step}
    found |= {"at": family.at(31.0).excitation.top_frequency, "usual": usual(case)}
    other = CaseFamily(case, "contact.restitution")
    found |= {"e": other.map().after(np.ones((1, 32)) * 1e-4, 0.7)}
    stored(golden.of_object(found))
    springs = {"law": "penalty", "penalty_stiffness": 3e3, "penalty_damping": 0.3}
    moving = case_of(contact=springs, initial=[{"lamina": "mid", "displacement": 1e-4}])
    found = of_map(map_of(moving, "excitation.frequency"), 26.5, 0.01)
    stored(golden.of_object(found | {"start": start_of(moving)}), ".springs")


def test_maps_in_modes_are_the_stored_ones(stored: Check) -> None:
    case = case_of(
        contact={"law": "newton", "restitution": 0.0},
        model={"kind": "modes", "modes": 3},
        time={"steps_per_period": 120, "periods": 5, "mass": "massless", "refine": 4},
    )
    found = of_map(ModalMap(case, "excitation.frequency"), 26.5, 0.01)
    for name in ("after", "shifted", "elsewhere", "lifted"):
        found[name] = np.abs(found[name])
    for name in ("begun", "further"):
        found[name] = np.abs(found[name])
    for name in ("seen", "opened"):
        passage = found[name]
        found[name] = {
            key: getattr(passage, key)
            for key in ("strobes", "low", "high", "smallest_gap", "gaps", "openings", "history")
        }
    stored(golden.of_object(found | {"usual": usual(case), "start": start_of(case)}))


def test_natures_are_the_stored_ones(stored: Check) -> None:
    own = Nature("told", {"a": 2, "b": 3, "c": 1})
    state = np.array([0.3, -0.7, 0.0, 0.0, 0.0, -2.0])
    stored(golden.of_object({"split": own.split(state), "scales": own.scales(state)}))

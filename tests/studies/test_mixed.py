"""Linear motions, modes, comparisons of models and words on orbits in full."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import golden
import numpy as np
import pytest
from mixed import FORCE, IMPACTORS, INNER, MASSES, apart, bonded

from delam_fem.case.definition import Case
from delam_fem.case.files import preset
from delam_fem.engines.cost import Cost, require_affordable, run_cost, step_hours
from delam_fem.model import discretise
from delam_fem.model.beams import closed_form
from delam_fem.studies import linear
from delam_fem.studies.models import Measured, ModelComparison, Motion, difference_until, variants
from delam_fem.studies.modes import modes, structure_modes
from delam_fem.studies.orbits.maps import Nature, Passage
from delam_fem.studies.orbits.newton import Root, Solved
from delam_fem.studies.orbits.run import Orbit
from delam_fem.studies.orbits.search import Coarse, Exact, Multiple, Multipliers
from delam_fem.system.errors import CaseError

Check = Callable[..., None]
PLAIN: dict[str, Any] = {"stop": [], "impactor": [], "sensor": [], "mesh": {"elements": 8}}
FINE: dict[str, Any] = PLAIN | {"mesh": {"elements": 14}}
CASES: dict[str, Case] = {
    "apart": apart(**PLAIN, point_mass=[]),
    "masses": apart(**PLAIN, point_mass=MASSES),
    "force": apart(**PLAIN, point_mass=[], excitation=FORCE),
    "bonded": bonded(**FINE),
    "held": bonded(
        **FINE, delamination=INNER, support=[{"start": "clamped", "end": "pinned"}],
        excitation={"kind": "harmonic", "acceleration": 3.0, "frequency": 27.0},
    ),
    "free": bonded(**FINE, delamination=INNER, support=[{"start": "free", "end": "free"}],
                   excitation=FORCE),
    "impactors": bonded(**FINE | {"impactor": IMPACTORS}),
}  # fmt: skip


def waves(*shape: int) -> np.ndarray:
    """Return numbers without a pattern."""
    return np.cos(np.arange(np.prod(shape)) ** 1.3 + 0.2).reshape(shape)


@pytest.mark.parametrize("name", [name for name in CASES if name != "free"])
def test_linear_motions_are_the_stored_ones(name: str, stored: Check) -> None:
    case = CASES[name]
    structure = closed_form.assemble(case)
    found: dict[str, Any] = {
        "amplitudes": linear.linear_amplitudes(case, np.array([3.0, 27.0, 90.0])),
        "frequencies": linear.first_frequencies(case), "decay": linear.slowest_decay(case),
        "periods": [linear.settling_periods(case), linear.settling_periods(case, 0.3)],
    }  # fmt: skip
    if not case.impactor:
        found["open"] = linear.steady_motion(case, structure, is_closed=False)
        found["closed"] = linear.steady_motion(case, structure)
    stored(golden.of_object(found))


@pytest.mark.parametrize("kind", ["free", "closed"])
@pytest.mark.parametrize("name", ["masses", "bonded", "held", "free"])
def test_modes_of_structures_are_the_stored_ones(name: str, kind: Any, stored: Check) -> None:
    case = CASES[name]
    found = structure_modes(closed_form.assemble(case), case, 5, kind=kind)
    if name == "free":  # rigid motions of one frequency are any of a plane
        found = replace(
            found, frequencies=found.frequencies[2:], shapes=found.shapes[2:],
            openings=found.openings[2:], partners=found.partners[2:],
            partner_frequencies=found.partner_frequencies[2:],
        )  # fmt: skip
    stored("\n".join([golden.of_object(found), golden.of_finding(found.report)]))


def test_modes_of_laminae_are_the_stored_ones(stored: Check) -> None:
    lines = []
    for name, n in (("apart", 4), ("bonded", 2)):
        found = modes(CASES[name], n)
        lines.append(golden.of_finding(found.report))
    for n, kind in ((0, "free"), (999, "free"), (3, "open"), (30, "closed")):
        try:
            modes(CASES["apart"], n, delaminations=kind)  # type: ignore[arg-type]
        except CaseError as error:
            lines.append(str(error))
    stored("\n".join(lines))


def motion(frequency: float, k: float) -> Motion:
    """Return a made-up motion."""
    t = 0.002 * np.arange(1, 401)
    turns = 2.0 * np.pi * frequency * t
    tips = np.array([1e-3 * k * np.sin(turns), 2e-3 * np.cos(turns + k), 1e-4 * k + 0.0 * t])
    summary = {
        "tip_min": [-1e-3 * k, -2e-3, 0.0], "tip_max": [1e-3, 2e-3 * k, 1e-4],
        "tip_amplitude": [1e-3 * k, 2e-3, 1e-4], "periodicity": 2 if k > 1.0 else None,
        "periodicity_class": "period 2", "strobe_scatter": 0.013 * k,
        "distortion_factor": [0.1 * k, 0.02, 0.3], "thd": [0.4, 0.2 * k, 0.7],
        "tip_contacts_per_period": 1.5 * k, "impacts_per_period": 7.0 * k,
        "minimum_tip_gap": -2e-5 * k, "strobe_displacement": [0.1, 0.2, 0.3],
    }  # fmt: skip
    energies = {"base_work": 3e-3 * k, "force_work": 1e-4, "damping_loss": 2e-3,
                "contact_damping_loss": 5e-4, "impact_loss": 6e-4 * k}  # fmt: skip
    x = np.linspace(0.0, 0.5, 9)
    return Motion(
        frequency, t, tips, 0.31 * k if k < 1.5 else np.inf, summary, energies, 1e-9 * k, x,
        1e-3 * k * (1.0 + waves(9)), (0.7 * k, 333.0 + k),
    )  # fmt: skip


def test_comparisons_of_models_are_the_stored_ones(stored: Check) -> None:
    models = tuple(
        Measured(
            name, 40 * k, 7 + k, 0.1 * k, 10.0 * np.arange(1.0, 4.0) * (1.0 + 0.01 * k),
            ("f1", "f2", "f3"), np.array([1e-3, 2e-3, 3e-3]) * (1.0 + 0.02 * k),
            (motion(3.0, 0.6 + 0.4 * k), motion(5.0, 1.2 - 0.1 * k)),
        )
        for k, name in enumerate(("beam", "plane-stress", "solid"), 1)
    )  # fmt: skip
    found = ModelComparison(bonded(**FINE), models)
    lines = [golden.of_finding(found.report)]
    for a, b in ((1.0, 1.2), (0.6, 2.0), (2.0, 1.7)):
        lines.append(golden.of_object(list(difference_until(motion(3.0, a), motion(3.0, b)))))
    for names in (["beam", "modes", "plane-stress", "modes"], ["modes"], ["beam", "shell"]):
        try:
            made = variants(CASES["apart"], names, 3)
            told = [
                [v.name, v.engine, v.structure.operators.n_dofs, v.case.model.kind] for v in made
            ]
            lines.append(repr(told))
        except CaseError as error:
            lines.append(str(error))
    stored("\n".join(lines))


def orbit(**more: Any) -> Orbit:
    """Return a made-up orbit."""
    values = np.array([0.6 + 0.5j, 0.6 - 0.5j, -0.3, 0.1])
    samples = values * (1.0 + 0.02 * waves(40, 4))
    own = Multipliers(values, samples, samples[::2] * 1.01, np.eye(4))
    state = 1e-3 * waves(8)
    at = Solved(state, 3.1, 0.02, 3e-4, 2e-4, 1e-4 * np.ones(4), 5)
    coarse = Coarse(at, 0.03, own, 0.004, None)
    history = 1e-3 * waves(60, 2)
    passage = Passage(
        waves(2, 8), 1e-3 * waves(2, 2), history.min(axis=0), history.max(axis=0), 2e-4,
        np.array([2e-4, 3e-4]), np.array([1e-2, 2e-2]), history,
    )  # fmt: skip
    nature = Nature("finite elements", {"displacement": 4, "velocity": 4}, is_stepped=True)
    given = {
        "case": preset("paper"), "periods": 2, "coarse": coarse, "exact": None,
        "best_residual": 4e-6, "scatter": 0.07, "nature": nature, "passage": passage,
        "seconds": 12.0, "evaluations": 4711,
    }  # fmt: skip
    return Orbit(**given | more)


def test_words_on_orbits_are_the_stored_ones(stored: Check) -> None:
    base = orbit()
    coarse = base.coarse
    exact_values = np.array([0.9 + 0.1j, 0.9 - 0.1j, 0.04, -0.5], dtype=complex)
    root = Root(2e-3 * waves(8), 0.25, 3e-12, np.eye(8), 4)
    exact = Exact(root, exact_values, 1e-4 * np.arange(1.0, 5.0))
    smooth = replace(base.nature, is_stepped=False, name="4 modes")
    wild = replace(coarse.multipliers, values=2.0 * coarse.multipliers.values,
                   samples=2.0 * coarse.multipliers.samples,
                   larger=2.0 * coarse.multipliers.larger)  # fmt: skip
    wide = replace(coarse.multipliers, larger=1.6 * coarse.multipliers.larger)
    small = replace(coarse.multipliers, samples=np.concatenate([
        coarse.multipliers.samples[:20], 1.4 * coarse.multipliers.samples[20:]]))  # fmt: skip
    unsolved = replace(coarse.solved, residual=0.3)
    variants_ = {
        "coarse": base, "single": replace(base, periods=1), "exact": replace(base, exact=exact),
        "smooth": replace(base, exact=exact, nature=smooth),
        "outside": replace(base, nature=smooth,
                           exact=replace(exact, values=1.3 * exact_values)),
        "unsolved": replace(base, coarse=replace(coarse, solved=unsolved)),
        "away": replace(base, coarse=replace(coarse, away=0.4)),
        "wild": replace(base, coarse=replace(coarse, multipliers=wild)),
        "wild away": replace(base, coarse=replace(coarse, multipliers=wild, away=0.4)),
        "wide": replace(base, coarse=replace(coarse, multipliers=wide)),
        "wide away": replace(base, coarse=replace(coarse, multipliers=wide, away=0.1001)),
        "at the bound": replace(base, coarse=replace(coarse, multipliers=wide, away=0.1)),
        "held": replace(base, coarse=replace(coarse, multipliers=small, away=0.001)),
        "multiple": replace(base, coarse=replace(coarse, multiple=Multiple(3, 0.12))),
    }  # fmt: skip
    lines = []
    for name, own in variants_.items():
        numbers = {k: v for k, v in own.numbers.items() if k != "versions"}
        lines += [name, golden.told(numbers), golden.of_object(own.state, "state")]
    stored("\n".join(lines))
    for name in ("coarse", "smooth", "outside", "unsolved"):
        report = variants_[name].report
        told = {k: v for k, v in (report.numbers or {}).items() if k != "versions"}
        stored(golden.of_finding(replace(report, numbers=told)), f".{name}")


def test_costs_are_the_stored_ones(stored: Check, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = []
    time = {"steps_per_period": 150, "periods": 7}
    penalty = {"law": "penalty", "penalty_stiffness": 3e3, "penalty_damping": 0.3}
    for name, case in {
        "plain": apart(**PLAIN, contact={"law": "none"}),
        "points": apart(**PLAIN, contact=penalty | {"points_per_element": 3}),
        "divided": bonded(**FINE, contact=penalty | {"points_per_element": 2},
                          time=time | {"refine": 4}),
        "steps": bonded(**FINE, contact={"law": "newton", "restitution": 0.2},
                        time=time | {"scheme": "moreau-jean"}),
        "open steps": bonded(**FINE, contact={"law": "none"},
                             time=time | {"scheme": "moreau-jean"}),
        "plane": bonded(**FINE, model={"kind": "plane-stress", "layers": 3},
                        output={"window_periods": 1, "fields_per_period": 10}),
        "solid": bonded(**FINE, model={"kind": "solid", "strips": 2, "degree": 3}),
    }.items():  # fmt: skip
        for engine in ("petsc", "compiled"):
            cost = run_cost(case, engine)
            times = [3600.0 * step_hours(case, engine), 3600.0 * cost.hours]
            sizes = [cost.memory, cost.disk, cost.programs]
            lines += [golden.of_object(own, f"{name} {engine}") for own in (times, sizes)]
    for own in (
        Cost(24.0, 4e9, 4e9), Cost(24.001, 1.0, 1.0), Cost(0.0, 4.001e9, 1.0), Cost(0.02, 1.0, 5e9),
        Cost(0.0277, 3e8, 9.995e8), Cost(0.0279, 2e8, 1e9, 3e8), Cost(1.99, 0.0, 0.0),
        Cost(2.0, 0.0, 0.0), Cost(1e-5, 0.0, 0.0),
    ):  # fmt: skip
        lines.append(f"{own.is_large} {own}".replace("about", "some"))
    import delam_fem.engines.cost as module

    monkeypatch.setattr(module, "_machine_memory", lambda: 2e9)
    usage = type("Usage", (), {"free": 3e8})
    monkeypatch.setattr(module.shutil, "disk_usage", lambda path: usage)
    for own in (
        Cost(1.0, 1.2e9, 3e8), Cost(1.0, 1.4e9, 1e8), Cost(1.0, 1.2e9, 3.1e8), Cost(25.0, 1.0, 1.0),
        Cost(1.0, 1.4e9, 1e8, 5e8),
    ):  # fmt: skip
        for is_confirmed in (False, True):
            try:
                require_affordable(own, "case x", is_confirmed=is_confirmed)
                lines.append("fine")
            except CaseError as error:
                lines.append(str(error).partition(", but /")[0].replace("about", "some"))
    stored("\n".join(lines).replace("needs some", "wants some"))


def test_what_studies_do_not_take_is_told_as_stored(stored: Check) -> None:
    bars = apart(
        lamina=[own.model_dump(exclude_none=True) | {"motion": "axial"} for own in apart().lamina],
        **PLAIN | {"point_mass": []}, damping={"rayleigh": "every mode"}, excitation=FORCE,
    )  # fmt: skip
    solid = bonded(**FINE, model={"kind": "solid"})
    whole = apart(contact={"law": "penalty", "penalty_stiffness": 3e3, "penalty_damping": 0.3})
    inside = bonded(**FINE, support=[{"start": "clamped"}, {"position": 0.1, "kind": "pinned"}])
    massless = preset("default", {"time.mass": "massless", "model.kind": "modes",
                                  "contact.law": "newton", "contact.restitution": 0.0})  # fmt: skip
    lines = []
    for case in (bars, solid, whole, inside, massless, CASES["apart"]):
        for call in (
            lambda c: discretise.require_bending(c, "study"),
            lambda c: discretise.require_plain(c, "study"),
            lambda c: discretise.require_mass(c, "study", "reason"),
            *(lambda c, k=kind: discretise.require_kind(c, k) for kind in discretise.KINDS),
        ):
            try:
                call(case)
                lines.append("fine")
            except CaseError as error:
                lines.append(str(error))
    stored("\n".join(lines))

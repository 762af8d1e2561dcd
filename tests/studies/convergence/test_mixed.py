"""Ladders of unlike laminae in full: their rungs, pages, pictures, verdicts and warnings."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import golden
import numpy as np
import pytest
from mixed import apart, bonded

from delam_fem.case.files import preset
from delam_fem.studies.convergence.analysis import Convergence, page, verdict
from delam_fem.studies.convergence.ladder import (
    FREE,
    LIMIT,
    Ladder,
    PointMesh,
    Rung,
    method,
    refinement_warnings,
    short_waves,
    usual_methods,
)
from delam_fem.studies.convergence.rung import (
    RungResult,
    amplitudes,
    converging,
    fitted_frequency,
    general,
    may_be_judged,
    statistics,
)
from delam_fem.system.errors import CaseError

Check = Callable[..., None]
RIGID = {"law": "newton", "restitution": 0.35}
PLAIN: dict[str, Any] = {"stop": [], "impactor": [], "sensor": [], "point_mass": []}


def waves(*shape: int) -> np.ndarray:
    """Return numbers without a pattern."""
    return np.cos(np.arange(np.prod(shape)) ** 1.3 + 0.2).reshape(shape)


def ladder(name: str) -> Ladder:
    """Return a ladder of points inside elements, of steps alone, of meshes alone, or of both."""
    texts = "newton@moreau-jean,penalty,newton-penalty@newmark:8/lumped".split(",")
    methods = tuple(map(method, texts))
    case = apart(**PLAIN, contact=RIGID)
    if name == "points":
        meshes = (5, PointMesh(5, 2), PointMesh(5, 4), PointMesh(10, 4))
        return Ladder(case, methods[:2], meshes, (250, 500, 1000), limit_steps=32000)
    if name == "steps":
        return Ladder(case, methods, (8,), (100, 200, 400, 20000), 17, 64000, "petsc")
    if name == "meshes":
        return Ladder(bonded(**PLAIN, contact=RIGID), methods[:1], (14, 20, 31), (300,), 7, 0)
    given = case.with_overrides({"contact.restitution": 1.0})
    judged = ("amplitude", "modal_impulse")
    return Ladder(given, methods[:2], (4, 8, 16), (250, 600, 1000), 60, 9000, judged=judged)


NAMES = ("points", "steps", "meshes", "both")


def result(rung: Rung, rate: float) -> RungResult:
    """Return made-up numbers that converge at some rate, with some scatter."""
    if rung.method == "penalty@newmark" and rung.points == 8 and rung.steps < 600:
        return RungResult(rung.key, "diverged", "diverged in period 3", {}, 1.1, 3)
    size = 1e-3 * (1.0 + 30.0 / rung.steps**rate + 0.3 / rung.points)
    n = len(rung.case.lamina)
    found = {}
    for k, q in enumerate(converging(n), 1):
        sign = -1.0 if "min" in q.name else 1.0
        found[q.name] = (sign * size * (1.0 + 0.1 * k), 1e-7 * k)
    for i in range(1, n + 1):
        found[f"frequency_{i}"] = (3.0 * i * (1.0 + 1.0 / rung.points**4), 0.0)
        found.setdefault(f"amplitude_{i}", (2e-3 * i * (1.0 - 3.0 / rung.steps**2), 0.0))
    found |= {"blocks": (9.0, 0.0), "periodicity": (float(rung.points % 3), 0.0)}
    found |= {"impacts": (41.0, 1.0)}
    micro = 0.1 * rung.points + (0.3 if rung.method == FREE.name else 0.5)
    return RungResult(rung.key, "completed", "", found, micro, 60)


@pytest.mark.parametrize("name", NAMES)
def test_rungs_are_the_stored_ones(name: str, stored: Check) -> None:
    own, lines = ladder(name), []
    for rung in own.rungs():
        keys = rung.case.contact, rung.case.time, rung.case.output, rung.case.mesh
        lines.append(f"{rung.key}: {rung.mesh_text}, {rung.points} points, {rung.periods}")
        lines += [repr(key) for key in keys]
    told = {
        "refines": own.refines, "limit": own.has_limit, "identity": own.identity,
        "meshes": repr(own.meshes_of(FREE)), "of a method": repr(own.meshes_of(own.methods[0])),
        "limit of": own.limit_of(own.meshes[0]).key if own.has_limit else None,
        "along": [rung.key for rung in own.along_meshes(LIMIT, 1234)],
        "in itself": own.is_in(own.identity), "in another": own.is_in(ladder("both").identity),
    }  # fmt: skip
    stored("\n".join([*lines, golden.told(told)]))


@pytest.mark.parametrize("rate", [0.5, 1.4])
@pytest.mark.parametrize("name", NAMES)
def test_pages_are_the_stored_ones(name: str, rate: float, stored: Check) -> None:
    own = ladder(name)
    found = Convergence(own, {rung.key: result(rung, rate) for rung in own.rungs()})
    text = [page(found, verdict(found)), golden.of_report(found.report)]
    if rate > 1.0:
        text.append(golden.of_finding(found.report))
    del found.results[own.rungs()[-1].key]
    intervals = [
        found.interval(rung, own.along_steps(own.methods[0], rung.mesh), "steps")
        for rung in own.along_steps(own.methods[0], own.meshes[-1])
    ]
    text += [golden.of_object(intervals), str(found.is_complete), found.what, verdict(found)]
    stored("\n".join(text))


def test_warnings_methods_and_waves_are_the_stored_ones(stored: Check) -> None:
    cases = {
        "apart": apart(**PLAIN, contact=RIGID), "bonded": bonded(**PLAIN, contact=RIGID),
        "mass": apart(**PLAIN, contact=RIGID, damping={"rayleigh": "mass"}),
        "stiff": apart(**PLAIN, contact=RIGID, damping={"rayleigh": "stiffness"}),
        "elastic": apart(contact={"law": "penalty", "penalty_stiffness": 3e3,
                                  "penalty_damping": 0.3}),
        "massless": preset("default", {"time.mass": "massless", "model.kind": "modes",
                                       "contact.law": "newton", "contact.restitution": 0.0}),
    }  # fmt: skip
    lines = []
    for name, case in cases.items():
        lines.append(golden.of_object(short_waves(case), name))
        lines += refinement_warnings(case, [5, 40, 170, 3000, 300])
        lines += [f"{own.name} {own.overrides}" for own in usual_methods(case)]
    for text in (
        "newton", "penalty", "newton-penalty", "newton@moreau-jean:64", "penalty@newmark/lumped",
        "newton@central-difference:2/consistent", "none", "newton@none", "newton:x", "newton/soft",
        "glue", "penalty@moreau-jean", "newton:", "newton/", "",
    ):  # fmt: skip
        try:
            lines.append(f"{method(text).name} {method(text).overrides}")
        except CaseError as error:
            lines.append(str(error))
    base: dict[str, Any] = {"meshes": (4, 8), "steps": (100, 200)}
    for more in (
        {"steps": ()}, {"steps": (200, 200)}, {"meshes": ()}, {"meshes": (8, 4)}, {"periods": 0},
        {"meshes": (PointMesh(4, 2), 8)},
    ):  # fmt: skip
        try:
            Ladder(cases["apart"], (method("newton"),), **base | more)
        except CaseError as error:
            lines.append(str(error))
    stored("\n".join(lines))


def test_statistics_are_the_stored_ones(stored: Check) -> None:
    n, rng = 23, waves(23, 2)
    t = 0.02 * np.arange(1, 160)
    found: dict[str, Any] = {}
    for kind in ("irregular", "doubled"):
        turn = (-1.0) ** np.arange(n) if kind == "doubled" else 3.0 * waves(n)
        rows = [
            {
                "tip_min": -1.0 - 0.01 * rng[k] - 0.1 * turn[k], "tip_max": 2.0 + 0.02 * rng[-k],
                "harmonics": (0.5 + 0.1j * turn[k]) * (waves(2, 7) + 1j * waves(7, 2).T),
                "modal_impulse": 0.3 + 0.1 * turn[k], "impacts": float(k), "impact_gain": 0.01 * k,
                "contact_work": 0.2 * k, "steps": 100.0 + k,
            }
            for k in range(n)
        ]  # fmt: skip
        strobe = np.stack([0.4 * turn + 0.001 * waves(n), 0.2 * turn[::-1]])
        own = statistics(rows, strobe)
        found[kind] = {name: list(values) for name, values in own.items()}
    found["frequency"] = [
        fitted_frequency(t, np.cos(w * t + 0.4) + 0.02 * waves(t.size), 7.0)
        for w in (6.9, 7.03)
    ]  # fmt: skip
    shown = (*converging(2), *general(3), *amplitudes(1, 2), *may_be_judged(2))
    found["shown"] = [f"{q.heading} {q.name} {q.factor:g} {q.lamina}" for q in shown]
    assert math.isfinite(found["frequency"][0])
    stored(golden.of_object(found))

"""The compiled engine against the PETSc engine, where the covering array does not reach."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from delam_fem.api import (
    LEDGER,
    Case,
    EngineName,
    Recorder,
    State,
    assemble,
    preset,
    run,
    session_of,
)
from delam_fem.engines.session import ENGINES
from delam_fem.model.layout import tributary_lengths

SAME = 1e-9
"""m, m/s; round-off that some hundred impacts have amplified (seen: 1e-11 and less)."""
SAME_ENERGY = 1e-9
"""J; the laminae exchange some 1e-2 J in a period."""
CLOSED = 1e-9
"""Relative residual of the ledger; round-off of a thousand steps (seen: 1e-11)."""
FIRST_IMPACTS = 20


def case_of(law: str, impulse: str, mass: str, scheme: str, **more: Any) -> Case:
    settings = {
        "contact.law": law,
        "contact.impulse": impulse,
        "time.mass": mass,
        "time.scheme": scheme,
        "time.periods": 2,
        "output.window_periods": 2,
        "excitation.frequency": 3.25,
    }
    if law == "penalty":
        settings |= {"contact.penalty_damping": 0.3}
    if scheme == "central-difference":  # few elements, else it needs very small steps
        settings |= {
            "mesh.elements": 5, "time.steps_per_period": 4000, "damping.rayleigh": "mass",
            "time.periods": 3, "output.window_periods": 3,
        }  # fmt: skip
    return preset("paper", settings | more)


def compute(case: Case, name: EngineName, initial: State | None = None) -> tuple[Recorder, State]:
    """Run a case on closed-form operators, which need no quadrature."""
    operators = assemble(case, needs_dolfinx=False).operators
    with session_of(case, operators, initial=initial, engine=name) as opened:
        assert opened.run() == "completed"
        return opened.recorder, opened.engine.state()


def impacts(recorder: Recorder) -> list[tuple[int, int, int]]:
    """Return (period, step, pair) of all impacts."""
    tables = [record.jumps.columns() for record in recorder.window]
    return [
        (period, int(step), int(pair))
        for period, jumps in enumerate(tables)
        for step, pair in zip(np.repeat(jumps.ticks, jumps.sizes), jumps.hit, strict=True)
    ]


def assert_same(one: Recorder, other: Recorder) -> None:
    for a, b in zip(one.window, other.window, strict=True):
        assert a.n_steps == b.n_steps
        np.testing.assert_allclose(a.u[:, 3:], b.u[:, 3:], rtol=0.0, atol=SAME)
        np.testing.assert_allclose(a.v, b.v, rtol=0.0, atol=100.0 * SAME)  # modes up to 1 kHz
        np.testing.assert_allclose(a.u[:, :3], b.u[:, :3], rtol=1e-7, atol=1e-7)
        assert len(a.frames) == len(b.frames) > 0
        for frame, same in zip(a.frames, b.frames, strict=True):
            np.testing.assert_allclose(frame[0], same[0], rtol=0.0, atol=SAME)
        np.testing.assert_array_equal(np.array(a.contact), np.array(b.contact))
    np.testing.assert_allclose(one.ledger, other.ledger, rtol=0.0, atol=SAME_ENERGY)
    # impulses [N s], counts, and energy gained [J], which is round-off or nothing
    np.testing.assert_allclose(one.impulse, other.impulse, rtol=1e-7, atol=1e-15)


@pytest.mark.parametrize("elements", [1, 2, 7])
def test_any_number_of_elements(elements: int) -> None:
    more = {"mesh.elements": elements, "excitation.frequency": 1.6}
    case = case_of("newton-penalty", "consistent", "consistent", "newmark", **more)
    petsc, compiled = (compute(case, name)[0] for name in ("petsc", "compiled"))
    assert impacts(petsc) == impacts(compiled)
    assert_same(petsc, compiled)


def test_stiff_springs_on_many_pairs() -> None:
    more = {"contact.penalty_stiffness": 1e4, "contact.penalty_damping": 3.0}
    case = case_of("penalty", "consistent", "consistent", "newmark", **more)
    petsc, compiled = (compute(case, name)[0] for name in ("petsc", "compiled"))
    assert compiled.ledger[:, LEDGER.index("contact_damping_loss")].min() > 0.0
    assert_same(petsc, compiled)
    assert compiled.energy_residual() < CLOSED


@pytest.mark.parametrize("law", ["penalty", "newton-penalty"])
def test_weighted_pairs(law: str) -> None:
    """Springs per length: what a pair carries is its tributary length times the stiffness."""
    more = {"contact.penalty_stiffness": 3e3, "contact.threshold_velocity": 0.05}
    case = case_of(law, "consistent", "consistent", "newmark", **more)
    structure = assemble(case, needs_dolfinx=False)
    weights = tributary_lengths(structure.layout.parts, structure.layout.interfaces[0])
    operators = replace(structure.operators, pair_weights=weights)
    recorders = []
    for name in ENGINES:
        with session_of(case, operators, engine=name) as opened:
            assert opened.run() == "completed"
            recorders.append(opened.recorder)
    assert_same(*recorders)
    assert recorders[0].energy_residual() < CLOSED
    unweighted, _ = compute(case, "compiled")
    assert np.abs(unweighted.strobe - recorders[0].strobe).max() > 1e3 * SAME


def test_small_steps_choose_the_other_product() -> None:
    more = {"mesh.elements": 4, "time.steps_per_period": 40000, "damping.rayleigh": "mass"}
    case = case_of("newton-penalty", "lumped", "lumped", "newmark", **more)
    petsc, compiled = (compute(case, name)[0] for name in ("petsc", "compiled"))
    assert_same(petsc, compiled)


@pytest.mark.parametrize(
    ("law", "scheme"),
    [("newton-penalty", "newmark"), ("newton", "moreau-jean")],
)
def test_engines_take_over_from_one_another(law: str, scheme: str) -> None:
    case = case_of(law, "consistent", "consistent", scheme)
    _, state = compute(case, "petsc")
    petsc, compiled = (compute(case, name, state)[0] for name in ("petsc", "compiled"))
    assert impacts(petsc)[:FIRST_IMPACTS] == impacts(compiled)[:FIRST_IMPACTS]
    assert_same(petsc, compiled)


def test_run_on_dolfinx_operators() -> None:
    case = case_of("newton-penalty", "lumped", "lumped", "newmark", **{"time.periods": 3})
    petsc, compiled = (run(case, engine) for engine in ("petsc", "compiled"))
    assert compiled.summary["engine"] == compiled.history.attrs["engine"] == "compiled"
    for name in ("tip_displacement", "displacement", "strobe_displacement"):
        difference = petsc.history[name].values - compiled.history[name].values
        assert np.abs(difference).max() < SAME
    np.testing.assert_array_equal(petsc.history.event_node, compiled.history.event_node)
    assert compiled.summary["energy_residual"] < CLOSED

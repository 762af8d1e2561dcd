"""Both engines in a covering array: any two settings that go together meet in some cell.

Cells are compared in full: motion, impacts, steps, frames, ledger. Quick are those in which each
setting is twice. In the cells of `-m nightly` any three settings meet.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from typing import Any

import numpy as np
import pytest
from covertable import make
from support import slow_beyond

from delam_fem.api import (
    COMBINATIONS,
    Case,
    EngineName,
    FloatArray,
    Operators,
    PeriodRecord,
    Recorder,
    assemble,
    preset,
    session_of,
)
from delam_fem.engines.session import ENGINES

SAME = 1e-8
"""Of the largest displacement; round-off that some hundred impacts have amplified (seen: 5e-10). A
stiffness matrix carries the round-off of its largest eigenvalue, 1e8 times the lowest."""
SAME_IMPULSE = 1e-7
"""Of the largest impulse of a period."""
CLOSED = 1e-9
"""Relative residual of the ledger; round-off of some thousand steps (seen: 6e-12)."""

FACTORS: dict[str, Sequence[Any]] = {
    # whether impulses are lumped is part of the method, because most methods do not read it
    "method": [
        (*key, impulse)
        for key, row in COMBINATIONS.items()
        for impulse in (("consistent", "lumped") if "impulse" in row.reads else ("consistent",))
    ],
    # contact points per element and number of elements decide how the compiled engine stores it
    "structure": [
        ("apart", 2, 4), ("apart", 3, 5), ("apart", 1, 4), ("apart", 1, 7), ("embedded", 1, 10),
        ("embedded", 2, 10), ("edge", 1, 10), ("pinned", 3, 10), ("bonded", 1, 10), ("free", 2, 10),
    ],
    "refine": [12, 3, 1],
    "refine_velocity": [0.02, 0.0],
    "mass": ["consistent", "lumped"],
    "damping": ["two-mode", "stiffness", "mass"],
    "drive": ["base", "force", "base and force", "forces"],
    "restitution": [0.5, 0.0, 1.0],
}  # fmt: skip
ENDS = {
    "embedded": ("clamped", "clamped"), "pinned": ("pinned", "pinned"), "free": ("free", "free"),
}  # fmt: skip
OPEN = {"between": ["lower", "upper"], "start": 0.12, "end": 0.28, "opening": 2e-5}
DELAMINATIONS: dict[str, list[dict[str, Any]]] = {
    "embedded": [OPEN | {"opening": 0.0}],
    "pinned": [OPEN],
    "free": [OPEN],
    "edge": [OPEN | {"start": 0.24, "end": 0.4, "shape": "power"}],
    "bonded": [],
}


CONSTRAINTS = [
    {  # points inside an element share its nodes
        "operator": "fn",
        "requires": ["method", "structure"],
        "evaluate": lambda cell: cell["method"][2] != "lumped" or cell["structure"][1] == 1,
    },
    {  # laws that look at the end of a step: round-off alone decides which closed pairs are hit
        "operator": "fn",
        "requires": ["method", "structure"],
        "evaluate": lambda cell: (
            cell["structure"][0] != "embedded"
            or not cell["method"][0].startswith("newton")
            or cell["method"][1] == "moreau-jean"
        ),
    },
    {  # nothing holds it that could move
        "operator": "fn",
        "requires": ["structure", "drive"],
        "evaluate": lambda cell: (
            cell["structure"][0] != "free" or cell["drive"].startswith("force")
        ),
    },
]


def cells(n: int) -> list[dict[str, Any]]:
    """Return cells in which any n settings that go together meet.

    Any three settings beside method and structure meet too, which takes no more cells than two.
    """
    dense = {"fields": [name for name in FACTORS if name not in ("method", "structure")]}
    rows: list[dict[str, Any]] = make(
        FACTORS, strength=n, constraints=CONSTRAINTS, sub_models=[dense | {"strength": 3}]
    )
    return rows


def name_of(cell: dict[str, Any]) -> str:
    """Return the settings of a cell in a row."""
    flat = ((*v,) if isinstance(v, tuple) else (v,) for v in (cell[name] for name in FACTORS))
    return "-".join(str(v) for values in flat for v in values)


def case_of(cell: dict[str, Any]) -> Case:
    """Return the case of a cell: few elements and periods, and contact from the first period on."""
    (law, scheme, impulse), (name, points, elements) = cell["method"], cell["structure"]
    is_apart = name == "apart"
    data = preset("paper" if is_apart else "embedded").model_dump(
        exclude_unset=True, exclude_none=True
    )
    frequency, steps = (1.6, 400) if is_apart else (60.0, 400)
    if scheme == "central-difference":
        steps = 8000 if is_apart else 2000
    lower, upper, *_ = (lamina["name"] for lamina in data["lamina"])
    base = {"kind": "harmonic", "amplitude": 0.01 if is_apart else 3.5e-4, "frequency": frequency}
    force = {"kind": "force", "amplitude": 0.1 if is_apart else 1.0, "frequency": frequency}
    force |= {"lamina": upper, "position": 0.3}
    other = {"kind": "force", "amplitude": 0.2, "frequency": 2.0 * frequency}
    other |= {"lamina": lower, "position": 0.17}
    drives = {
        "base": base, "force": force, "base and force": [other, base], "forces": [force, other],
    }  # fmt: skip
    data |= {
        "mesh": {"elements": elements},
        "damping": {"rayleigh": cell["damping"]},
        "excitation": drives[cell["drive"]],
        "contact": {
            "law": law, "impulse": impulse, "restitution": cell["restitution"],
            "points_per_element": points, "threshold_velocity": 1e-2,
            "penalty_stiffness": 300.0, "penalty_damping": 0.3,
        },
        "time": {
            "scheme": scheme, "mass": cell["mass"], "refine": cell["refine"],
            "refine_velocity": cell["refine_velocity"], "steps_per_period": steps, "periods": 3,
        },
        "output": {"window_periods": 3, "fields_per_period": 20},
    }  # fmt: skip
    if not is_apart:
        start, end = ENDS.get(name, ("clamped", "free"))
        data |= {"support": {"start": start, "end": end}, "delamination": DELAMINATIONS[name]}
    return Case.checked(data, "cell")


def compute(case: Case, operators: Operators, engine: EngineName) -> Recorder:
    with session_of(case, operators, engine=engine) as opened:
        assert opened.run() == "completed"
        return opened.recorder


def assert_same(cell: dict[str, Any], H: FloatArray, petsc: Recorder, compiled: Recorder) -> None:
    """Check that both engines have made the same steps and hit the same pairs as hard."""
    np.testing.assert_array_equal(compiled.effort, petsc.effort)
    size = max(np.abs(record.u[:, 3:]).max() for record in petsc.window)
    speed = max(np.abs(record.v).max() for record in petsc.window)
    for a, b in zip(petsc.window, compiled.window, strict=True):
        assert np.abs(b.u - a.u)[:, 3:].max() < SAME * size
        assert np.abs(b.v - a.v).max() < 10.0 * SAME * speed
        assert np.abs(b.u - a.u)[:, :3].max() < 1e-6 * np.abs(a.u[:, :3]).max()
        np.testing.assert_array_equal(b.is_divided, a.is_divided)
        frames, same = np.array(a.frames)[:, 0], np.array(b.frames)[:, 0]
        assert np.abs(same - frames).max() < SAME * np.abs(frames).max()
        one, other = impacts(a), impacts(b)
        if cell["structure"][1] == 1:
            np.testing.assert_array_equal(np.array(b.contact), np.array(a.contact))
        else:  # more pairs than dofs: how they share impulses is free, the load Hᵀ p is not
            one, other = one[:1] @ H, other[:1] @ H
        for x, y in zip(one, other, strict=True):
            assert np.abs(y - x).max(initial=0.0) <= SAME_IMPULSE * np.abs(x).max(initial=0.0)
        (ticks, _, energies, *_), (same_ticks, _, same, *_) = a.jumps.columns(), b.jumps.columns()
        assert ticks.tolist() == same_ticks.tolist()
        assert np.abs(energies - same).max(initial=0.0) <= SAME * np.abs(petsc.ledger).max()
    exchanged = np.abs(petsc.ledger).max()
    assert np.abs(compiled.ledger - petsc.ledger).max() < SAME * exchanged
    assert np.abs(compiled.works - petsc.works).max(initial=0.0) < SAME * exchanged
    law, hits = cell["method"][0], petsc.impulse[:, 1].sum()
    assert (hits > 0) == (law.startswith("newton") and cell["structure"][0] != "bonded")
    if cell["method"][1] != "central-difference":  # its ledger is of the order of the step
        assert petsc.energy_residual() < CLOSED
        assert compiled.energy_residual() < CLOSED


def impacts(record: PeriodRecord) -> FloatArray:
    """Return p, p · rate before and p · its change of each pair at each tick of a period.

    So a pair that is hit by round-off alone does not count.
    """
    jumps, n_ticks = record.jumps.columns(), (len(record.u) - 1) * record.ticks_per_step
    result = np.zeros((3, n_ticks + 1, record.resting.size))
    at, p = (np.repeat(jumps.ticks, jumps.sizes), jumps.hit), jumps.impulses
    result[0][at], result[1][at] = p, p * jumps.rate_pre
    result[2][at] = p * (jumps.rate_post - jumps.rate_pre)
    return result


def check(cell: dict[str, Any]) -> None:
    case = case_of(cell)
    operators = assemble(case, needs_dolfinx=False).operators
    H = operators.gap_matrix.toarray()
    assert_same(cell, H, *(compute(case, operators, engine) for engine in ENGINES))


@pytest.mark.parametrize("cell", slow_beyond(cells(2), name_of))
def test_both_engines_agree(cell: dict[str, Any]) -> None:
    check(cell)


@pytest.mark.nightly
def test_both_engines_agree_wherever_three_settings_meet() -> None:
    failures = []
    for cell in cells(3):
        try:
            check(cell)
        except AssertionError as error:
            failures.append(f"{name_of(cell)}: {error}")
    assert not failures, "\n".join(failures)


def test_any_two_settings_that_go_together_meet() -> None:
    """The library must not lose what its constraints leave."""
    all_cells = [dict(zip(FACTORS, row, strict=True)) for row in product(*FACTORS.values())]
    valid = (cell for cell in all_cells if all(rule["evaluate"](cell) for rule in CONSTRAINTS))
    assert pairs_in(valid) == pairs_in(cells(2))


def pairs_in(given: Iterable[dict[str, Any]]) -> set[tuple[Any, ...]]:
    """Return all pairs of settings that meet in some cells."""
    return {(a, b, cell[a], cell[b]) for cell in given for a, b in combinations(FACTORS, 2)}

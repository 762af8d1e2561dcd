"""What tests share: calls of the command and of compiled code, refusals, covering arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from _pytest.mark import ParameterSet
from covertable import make
from typer.testing import CliRunner, Result

from delam_fem.api import Case, CaseError, EngineName, Recorder, assemble, session_of
from delam_fem.cli.app import app
from delam_fem.system.caches import _Outermost

SMALL = ("--set", "mesh.elements=4", "--set", "time.steps_per_period=60", "--set", "time.periods=3")
"""Overrides that make a preset quick."""
SAME_MOTION, CLOSED = 1e-7, 1e-8
"""Largest difference of the engines over the motion, and residual of the ledger; round-off grows
over the impacts of a few periods."""
SWEEP = """base = "paper"
[set]
"mesh.elements" = 4
"time.periods" = 3
"time.steps_per_period" = 60
[[axis]]
key = "excitation.frequency"
values = [3.0, 3.5]
"""
"""A sweep file of two such cases."""


def invoke(*arguments: str | Path) -> Result:
    """Call the command in this process."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def compiled(function: Any) -> Any:
    """Return a function that Python can call, of one that is for compiled code alone."""
    return numba.njit(pipeline_class=_Outermost)(lambda *arguments: function(*arguments))


def refusal(call: Callable[[], object]) -> str:
    """Return the message with which a call is refused."""
    with pytest.raises(CaseError) as error:
        call()
    return str(error.value)


def covering(*axes: Sequence[Any]) -> list[ParameterSet]:
    """Return combinations in which any two values meet, and nightly ones in which any three do."""
    numbers = [list(range(len(axis))) for axis in axes]
    of_two = sorted(map(tuple, make(numbers)))
    of_three = sorted(map(tuple, make(numbers, strength=min(3, len(axes)))))
    further = [cell for cell in of_three if cell not in of_two]
    return [
        pytest.param(
            *(axis[k] for axis, k in zip(axes, cell, strict=True)),
            marks=pytest.mark.nightly if cell in further else (),
        )
        for cell in (*of_two, *further)
    ]


TWICE = 2
"""How often each setting of an array occurs in its quick rows."""


def settings_in_a_row(row: dict[str, Any]) -> str:
    """Return the settings of a row of an array as the name of a test."""
    return "-".join(map(str, row.values()))


def slow_beyond(
    rows: Iterable[dict[str, Any]], name_of: Callable[[dict[str, Any]], str] = settings_in_a_row
) -> list[ParameterSet]:
    """Return the rows of an array as parameters; quick are those in which each setting is twice."""
    times: Counter[tuple[str, str]] = Counter()
    parameters = []
    for row in rows:
        settings = [(name, str(value)) for name, value in row.items()]
        is_quick = any(times[setting] < TWICE for setting in settings)
        if is_quick:
            times.update(settings)
        marks = () if is_quick else pytest.mark.slow
        parameters.append(pytest.param(row, id=name_of(row), marks=marks))
    return parameters


def recorded(case: Case, engine: EngineName) -> Recorder:
    """Return what an engine has recorded of a case of beams from closed forms."""
    with session_of(case, assemble(case, needs_dolfinx=False).operators, engine=engine) as opened:
        assert opened.run() == "completed"
        return opened.recorder


def require_equal_engines(case: Case) -> None:
    """Assert that both engines give a case the same motion, with a closed ledger."""
    petsc, compiled = recorded(case, "petsc"), recorded(case, "compiled")
    size = max(np.abs(record.u).max() for record in petsc.window)
    for a, b in zip(petsc.window, compiled.window, strict=True):
        assert np.abs(b.u - a.u).max() < SAME_MOTION * size
    assert max(petsc.energy_residual(), compiled.energy_residual()) < CLOSED

"""What tests share: calls of the command and of compiled code, refusals, covering arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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

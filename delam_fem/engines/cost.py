"""Estimate time, memory and disk of a computation before it starts.

The numbers are rough, a factor of two up or down on a processor that has nothing else to do
(docs/usage.md has some beside what was measured). They are there to notice a zero too many.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.engines.choose import EngineName

MOST_HOURS = 24.0
"""Computing time of which a computation must be confirmed [h]."""
MOST_BYTES = 4e9
"""Memory or disk of which a computation must be confirmed [bytes]."""
_STEP_MICROSECONDS: dict[EngineName, tuple[float, float]] = {
    "petsc": (5.0, 0.035),
    "compiled": (0.2, 0.005),
}
"""Time of a step, and of each of its dofs [µs]; see docs/performance.md."""
START_SECONDS, STUDY_SECONDS = 6.0, 3.0
"""Time of start, figures, fields and page of a run; the same of a sweep or a ladder [s]."""
RUN_BYTES, WORKER_BYTES = 0.7e9, 0.3e9
"""Memory of a run with its pictures, and of a worker of a sweep, before they keep anything."""
FILE_BYTES = 4e6
"""Size of figures and pages, whatever is computed [bytes]."""
_DOUBLE = 8
_ROW_NUMBERS, _ROW_NUMBERS_IN_FILES = 24, 240
"""Numbers that a run keeps of each period; the figure of all periods draws each."""
_STEP_NUMBERS, _STEP_NUMBERS_IN_FILES = 16, 5
"""Numbers that a run keeps of each step of its window."""
_NODE_NUMBERS, _NODE_NUMBERS_IN_FILES = 24, 14
"""Numbers of each node and frame."""
_GIGA = 1e9


@dataclass(frozen=True)
class Cost:
    """What a computation needs.

    Attributes:
        hours: computing time [h].
        memory: memory of what is computed [bytes].
        disk: size of the files [bytes].
        programs: memory of the programs themselves [bytes].
    """

    hours: float
    memory: float
    disk: float
    programs: float = RUN_BYTES

    @property
    def is_large(self) -> bool:
        """Whether a user should be asked first."""
        return self.hours > MOST_HOURS or max(self.memory, self.disk) > MOST_BYTES

    def __str__(self) -> str:
        """Return the cost in words."""
        return (
            f"about {_duration(self.hours)}, {_size(self.memory + self.programs)} of memory and "
            f"{_size(self.disk)} of files"
        )


def n_steps(case: Case) -> float:
    """Return the number of time steps of a case, without refined ones."""
    return float(case.n_periods) * case.steps_per_period


def step_hours(case: Case, engine: EngineName) -> float:
    """Return the time of the steps of a case on one processor [h]."""
    fixed, per_dof = _STEP_MICROSECONDS[engine]
    return n_steps(case) * (fixed + per_dof * _n_dofs(case)) * 1e-6 / 3600.0


def run_cost(case: Case, engine: EngineName) -> Cost:
    """Return the cost of the run of a case."""
    window = case.n_window_periods
    recorded = float(window) * case.steps_per_period
    values = float(window) * case.frames_per_period * _n_dofs(case) / 2.0
    rows = float(case.n_periods)
    memory = _ROW_NUMBERS * rows + _STEP_NUMBERS * recorded + _NODE_NUMBERS * values
    disk = (
        _ROW_NUMBERS_IN_FILES * rows
        + _STEP_NUMBERS_IN_FILES * recorded
        + _NODE_NUMBERS_IN_FILES * values
    )
    hours = START_SECONDS / 3600.0 + step_hours(case, engine)
    return Cost(hours, _DOUBLE * memory, FILE_BYTES + _DOUBLE * disk)


def require_affordable(
    cost: Cost, what: str, *, is_confirmed: bool, folder: Path | None = None
) -> None:
    """Refuse a computation that needs much, unless the user has confirmed it.

    Args:
        cost: the estimated cost.
        what: name of the computation, for the message.
        is_confirmed: whether the user has said `--yes`.
        folder: where the files go, which need not exist; None: the working directory.

    Raises:
        CaseError: the computation is large, or the machine has less than it needs, and the user
            has not confirmed it.
    """
    if cost.is_large and not is_confirmed:
        raise CaseError(
            f"{what}: needs {cost}; more than {MOST_HOURS:g} h or {MOST_BYTES / _GIGA:g} GB must "
            "be confirmed by --yes"
        )
    if not is_confirmed:
        _require_machine(cost, what, (folder or Path()).absolute())


def _require_machine(cost: Cost, what: str, folder: Path) -> None:
    """Refuse a computation that needs more than the machine has.

    Raises:
        CaseError: the disk of the folder, or the memory, is too small. Workers are not counted,
            as they may be on other machines.
    """
    there = next(path for path in (folder, *folder.parents) if path.exists())
    free = shutil.disk_usage(there).free
    if cost.disk > free:
        raise CaseError(
            f"{what}: needs about {_size(cost.disk)} of files, but {there} has {_size(free)} free; "
            "choose another folder, or confirm by --yes"
        )
    memory, needed = _machine_memory(), cost.memory + min(cost.programs, RUN_BYTES)
    if needed > memory:
        raise CaseError(
            f"{what}: needs about {_size(needed)} of memory, but the machine has {_size(memory)}; "
            "record less, or confirm by --yes"
        )


def _machine_memory() -> float:
    """Return the memory of the machine [bytes]; infinite where the system does not tell."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return float("inf")


def _duration(hours: float) -> str:
    """Return a time in the unit that suits it."""
    seconds = 3600.0 * hours
    if seconds < 100.0:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60.0:.0f} min" if hours < 2.0 else f"{hours:.3g} h"


def _size(number: float) -> str:
    """Return a number of bytes in the unit that suits it."""
    return f"{number / 1e6:.0f} MB" if number < _GIGA else f"{number / _GIGA:.3g} GB"


def _n_dofs(case: Case) -> float:
    """Return the number of dofs; for a mesh file, whose size is not known yet, that of a few."""
    return 2.0 * len(case.lamina) * (case.mesh.elements or 50)

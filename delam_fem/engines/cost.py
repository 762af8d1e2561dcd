"""Estimate time, memory and disk of a computation before it starts.

The numbers are rough, a factor of three up or down in processor time (docs/usage.md has some beside
what was measured). They serve to notice a zero too many. A step has a cost for each entry of the
stiffness matrix, times a factor if lasting contact is solved for in it; a period and a point of a
sweep have a cost whatever they compute.
"""

from __future__ import annotations

import math
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from delam_fem.case.definition import Case
from delam_fem.engines.session import EngineName
from delam_fem.model import discretise
from delam_fem.model.mesh import node_coordinates, read_file
from delam_fem.system import mpi
from delam_fem.system.errors import CaseError

MOST_HOURS = 24.0
"""Computing time above which a computation must be confirmed [h]."""
MOST_BYTES = 4e9
"""Memory or disk above which a computation must be confirmed [bytes]."""
_STEP: dict[EngineName, tuple[float, float, float]] = {
    "petsc": (4.5, 2.0e-3, 2.0e-3),
    "compiled": (0.1, 0.4e-3, 1.3e-3),
}
"""Time of a step, and of each entry of the stiffness matrix, of beams and of solids [µs]."""
CONTACT: dict[EngineName, float] = {"petsc": 8.0, "compiled": 0.1}
"""Time that lasting contact adds to a step [µs]."""
LASTING, REFINED, INSIDE = 1.5, 4.0, 0.25
"""Factor of a step with lasting contact; factor where steps are refined near contact; what each
further contact point of an element adds to the factor."""
PERIOD: dict[EngineName, float] = {"petsc": 50.0, "compiled": 100.0}
"""Time of a period beside its steps: its record, its ledger [µs]."""
POINT_SECONDS = 0.0035
"""Time of a point of a sweep beside its periods [s]."""
START_SECONDS, STUDY_SECONDS = 6.0, 3.0
"""Time of start, figures, fields and page of a run; the same of a sweep or a refinement [s]."""
ENTRY_BYTES = 140.0
"""Memory of matrices and factors for each entry of the stiffness matrix [bytes]."""
RUN_BYTES, WORKER_BYTES = 0.7e9, 0.3e9
"""Memory of a run with its pictures, and of a worker of a sweep, before they keep anything."""
FILE_BYTES = 4e6
"""Size of figures and pages, whatever is computed [bytes]."""
_DOUBLE = 8
_ROW_NUMBERS, _ROW_NUMBERS_IN_FILES = 24, 240
"""Numbers that a run keeps of each period, in memory and in files: a figure draws each period."""
_STEP_NUMBERS, _STEP_NUMBERS_IN_FILES = 16, 5
"""Numbers that a run keeps of each step of its window, in memory and in files."""
_NODE_NUMBERS, _NODE_NUMBERS_IN_FILES = 24, 14
"""Numbers that a run keeps of each node and frame, in memory and in files."""
_GIGA = 1e9


@dataclass(frozen=True)
class Cost:
    """The time, memory and disk that a computation needs.

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


def step_hours(case: Case, engine: EngineName) -> float:
    """Return the time of the periods of a case on one processor [h]."""
    n_dofs, per_dof = _size_of(case)
    fixed, of_beams, of_solids = _STEP[engine]
    step = fixed + (of_solids if case.model.is_continuum else of_beams) * n_dofs * per_dof
    contact, time = case.contact, case.time
    if contact.law != "none" and (time.scheme == "moreau-jean" or time.refine > 1):
        step = (step + CONTACT[engine]) * (LASTING if time.refine == 1 else REFINED)
        step *= 1.0 + INSIDE * (contact.points_per_element - 1)
    return case.n_periods * (case.steps_per_period * step + PERIOD[engine]) * 1e-6 / 3600.0


def run_cost(case: Case, engine: EngineName) -> Cost:
    """Return the cost of the run of a case on the ranks of this process's communicator."""
    n_dofs, per_dof = _size_of(case)
    window = case.n_window_periods
    recorded = float(window) * case.steps_per_period
    values = float(window) * case.frames_per_period * n_dofs / 2.0
    rows = float(case.n_periods)
    memory = _ROW_NUMBERS * rows + _STEP_NUMBERS * recorded + _NODE_NUMBERS * values
    disk = (
        _ROW_NUMBERS_IN_FILES * rows
        + _STEP_NUMBERS_IN_FILES * recorded
        + _NODE_NUMBERS_IN_FILES * values
    )
    # MPI starts with its name: the workers of a sweep of beams start none
    ranks = min(mpi.MPI.COMM_WORLD.size, len(case.lamina)) if case.model.is_continuum else 1
    hours = START_SECONDS / 3600.0 + step_hours(case, engine) / ranks
    matrices = ENTRY_BYTES * n_dofs * per_dof
    return Cost(hours, _DOUBLE * memory + matrices, FILE_BYTES + _DOUBLE * disk)


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
        folder = (folder or Path()).absolute()
        there = next(path for path in (folder, *folder.parents) if path.exists())
        free = shutil.disk_usage(there).free
        if cost.disk > free:
            raise CaseError(
                f"{what}: needs about {_size(cost.disk)} of files, but {there} has {_size(free)} "
                "free; choose another folder, or confirm by --yes"
            )
        # workers are not counted, as they may be on other machines
        memory, needed = _machine_memory(), cost.memory + min(cost.programs, RUN_BYTES)
        if needed > memory:
            raise CaseError(
                f"{what}: needs about {_size(needed)} of memory, but the machine has "
                f"{_size(memory)}; record less, or confirm by --yes"
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


def _size_of(case: Case) -> tuple[float, float]:
    """Return the number of dofs of a case, and of the entries in a row of its stiffness matrix.

    A row of a reduced model has those of the gaps, whose matrix is dense. A row of solids has an
    entry for each component of each node of the neighbouring cells.

    Raises:
        CaseError: the file of a mesh or of a reduced model cannot be used.
    """
    model = case.model
    file = case.mesh.file
    if model.file is not None:
        o = discretise.assemble(case).operators
        return o.n_dofs, 1.0 + 0.5 * o.n_pairs
    if not model.is_continuum:
        n = case.mesh.elements or node_coordinates(case).size
        return 2.0 * len(case.lamina) * n, 6.0
    p = model.degree
    dim = 2 if model.kind == "plane-stress" else 3
    if file is not None:  # of triangles and tetrahedra half as many neighbours
        return float(dim * p**dim * len(read_file(file).points)), 0.5 * dim * (p + 2.0) ** dim
    n_across = case.mesh.across or model.strips
    through = max(model.layers * len(lamina.layers) for lamina in case.lamina)
    across = [p * n + 1 for n in (through, n_across)[: dim - 1]]
    neighbours = math.prod(min(n, p + 2) for n in across) * (p + 2.0)
    n_nodes = (case.mesh.elements or 0) * p * math.prod(across)
    return float(dim * len(case.lamina) * n_nodes), dim * neighbours

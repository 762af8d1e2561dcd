"""Reduce a case to modes.

The basis has residual shapes for the places of stops, impactors and sensors, and the initial state
is in its span. The file of a reduced structure is in `reduction_file.py`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.files import CaseSource, find_case, save_case
from delam_fem.case.sections import Model
from delam_fem.model.component_modes import Basis, basis_of, projected
from delam_fem.model.discretise import assemble, require_bending, require_mass
from delam_fem.model.layout import Structure
from delam_fem.model.loads import slowest
from delam_fem.model.operators import times
from delam_fem.model.places import places_of_case
from delam_fem.model.reduction_file import require_coupled, write
from delam_fem.model.sharing import together
from delam_fem.model.stops_sensors import striking_rows, with_start
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError, require

if TYPE_CHECKING:
    from delam_fem.system.mpi import MPI

NAME = "reduced.npz"
"""Name of the file of a reduced structure in its folder."""


@dataclass(frozen=True)
class Reduction:
    """A reduced case.

    Attributes:
        case: the case that was reduced.
        full: its structure without stops, impactors and an initial state; on several ranks, as in
            the basis, the share of the first one.
        basis: the modes and residual shapes.
        structure: the reduced structure, without stops, impactors and sensors.
        strains: what the strain sensors of the case read, as `reduction_file.write` takes it.
        seconds: time of the assembly, and of the reduction [s].
    """

    case: Case
    full: Structure
    basis: Basis
    structure: Structure
    strains: FloatArray
    seconds: tuple[float, float]

    @property
    def frequencies(self) -> FloatArray:
        """The lowest frequencies of the full and of the reduced structure, shape (2, k) [Hz]."""
        squares = np.sort(self.basis.squares)
        count = min(squares.size, self.basis.lowest.size)
        both = np.stack([self.basis.lowest[:count], squares[:count]])
        return np.asarray(np.sqrt(both) / (2.0 * np.pi))

    @property
    def highest_mode(self) -> float:
        """The highest frequency of a normal mode that is kept [Hz]."""
        return float(np.sqrt(self.basis.squares[self.basis.is_mode].max()) / (2.0 * np.pi))

    @property
    def highest(self) -> float:
        """The highest frequency of the reduced structure, that of a residual shape [Hz]."""
        return float(np.sqrt(self.basis.squares.max()) / (2.0 * np.pi))

    def save(self, directory: Path | str) -> list[Path]:
        """Write the reduced structure, and the case that is computed with it.

        Args:
            directory: the folder; it is made if it does not exist.

        Raises:
            OSError: a file cannot be written.
        """
        path = (Path(directory) / NAME).absolute()
        write(path, self.structure, self.case, self.strains)
        model = Model(kind="modes", file=path)
        sensors = tuple(s.model_copy(update={"mass": None}) for s in self.case.sensor)  # it is in M
        case = self.case.model_copy(update={"model": model, "sensor": sensors})
        return [path, save_case(case, directory)]


def reduced_case(
    case: CaseSource,
    modes: int = 20,
    *,
    coordinates: int | None = None,
    full: Structure | None = None,
) -> Reduction:
    """Reduce a case to normal modes and residual flexibility; see `component_modes.py`.

    Args:
        case: the case, or the name or file of one.
        modes: number of normal modes of each body.
        coordinates: largest number of coordinates; None: all shapes that are independent.
        full: the discretised case, which this process has as a whole; None, or beside stops,
            impactors, initial states and loads: it is assembled.

    Raises:
        CaseError: the case has a reduced model already, its impulses act on a lumped mass, or it
            cannot be reduced with these numbers.
    """
    case = find_case(case)
    if case.model.kind == "modes":
        raise CaseError('model.kind: expected a model that is not reduced yet, given "modes"')
    require_bending(case, "reduce")
    require_mass(case, "reduce", "the case computes its motion in modes already")
    if not case.has_one_length:
        raise CaseError("lamina: reduce: expected laminae of one length, given unequal ones")
    require(modes >= 1, "modes", "at least 1", modes)
    require_coupled(case)
    if full is None or case.stop or case.impactor or case.initial or case.is_loaded:
        return together(_reduced, case, modes, coordinates)
    return _reduced(case, modes, coordinates, full, comm=None)


def _reduced(
    case: Case,
    modes: int,
    coordinates: int | None,
    full: Structure | None = None,
    *,
    comm: MPI.Intracomm | None,
) -> Reduction:
    """Reduce a case (collective); see `reduced_case`."""
    begin = time.perf_counter()
    if full is None:
        full = assemble(case.without_strikes.before_loads, comm=comm)
    if case.is_plate and full.body is not None:
        from delam_fem.model.solids.body import sheets_of, with_places  # need dolfinx

        sheets = sheets_of(full.body)
        full = with_places(full, places_of_case(case))  # those of stops and initial states too
        full = replace(full, layout=replace(full.layout, sheets=sheets))
    start = with_start(full, case).operators.start
    assembled = time.perf_counter()
    o = full.operators
    loads = striking_rows(full, case)
    if start is not None:
        stretched = sp.csr_matrix(times(o.stiffness, start.T).T)
        loads = sp.vstack([loads, stretched], format="csr")
    if o.load is not None:
        loads = sp.vstack([loads, sp.csr_matrix(o.load)], format="csr")
    try:
        basis = basis_of(
            o,
            modes,
            shift=slowest(case) ** 2 if case.n_rigid else 0.0,
            max_coordinates=coordinates,
            loads=loads,
        )
    except ValueError as error:
        raise CaseError(str(error)) from None
    structure = projected(full, basis)
    if start is not None:
        projection = o.total(start @ times(o.mass, basis.vectors))
        structure = replace(structure, operators=replace(structure.operators, start=projection))
    strains = _strains(case, full, basis)
    seconds = (assembled - begin, time.perf_counter() - assembled)
    return Reduction(case, full, basis, structure, strains, seconds)


def _strains(case: Case, full: Structure, basis: Basis) -> FloatArray:
    """Return what the strain sensors of a case read, shape (k, m + 1)."""
    o = full.operators
    rows = [
        np.append(o.total(o.sensors[sensor.of_u].toarray()[0] @ basis.vectors), sensor.of_base[0])
        for sensor, case_sensor in zip(
            full.layout.sensors, case.without_strikes.sensor, strict=True
        )
        if case_sensor.quantity == "strain" and sensor.of_u is not None
    ]
    return np.array(rows).reshape(len(rows), basis.squares.size + 1)

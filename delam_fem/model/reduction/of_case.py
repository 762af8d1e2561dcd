"""Reduce a case: its structure, its reduced structure, and what the reduction costs in accuracy."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from delam_fem.case.definition import Case
from delam_fem.case.files import save_case
from delam_fem.case.sections import Model
from delam_fem.case.toml import CaseError
from delam_fem.model.beams.bonded import n_rigid
from delam_fem.model.discretise import assemble
from delam_fem.model.layout import Structure
from delam_fem.model.reduction import file
from delam_fem.model.reduction.basis import Basis, basis_of
from delam_fem.model.reduction.projection import projected
from delam_fem.numerics.arrays import FloatArray

NAME = f"reduced{file.SUFFIX}"
"""Name of the file of a reduced structure in its folder."""


@dataclass(frozen=True)
class Reduction:
    """A reduced case.

    Attributes:
        case: the case that was reduced.
        full: its structure.
        basis: the modes and residual shapes.
        structure: the reduced structure, without sensors.
        seconds: time of the assembly, and of the reduction [s].
    """

    case: Case
    full: Structure
    basis: Basis
    structure: Structure
    seconds: tuple[float, float]

    @property
    def frequencies(self) -> FloatArray:
        """The lowest frequencies of the full and of the reduced structure, shape (2, k) [Hz]."""
        full = self.basis.lowest
        both = np.stack([full, np.sort(self.basis.squares)[: full.size]])
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
        path.parent.mkdir(parents=True, exist_ok=True)
        file.write(path, self.structure, self.case, self._strains())
        model = Model(kind="reduced", file=path)
        return [path, save_case(self.case.model_copy(update={"model": model}), directory)]

    def _strains(self) -> FloatArray:
        """Return what the strain sensors of the case read; see `file.write`."""
        sensors, V = self.full.operators.sensors, self.basis.vectors
        rows = [
            np.append(sensors[own.of_u].toarray()[0] @ V, own.of_base[0])
            for own, given in zip(self.full.layout.sensors, self.case.sensor, strict=True)
            if given.quantity == "strain" and own.of_u is not None
        ]
        return np.array(rows).reshape(len(rows), self.basis.squares.size + 1)


def reduced_case(
    case: Case, modes: int = 20, *, coordinates: int | None = None, full: Structure | None = None
) -> Reduction:
    """Reduce a case to normal modes and residual flexibility; see `basis.py`.

    Args:
        case: the case.
        modes: number of normal modes of each body.
        coordinates: largest number of coordinates; None: all shapes that are independent.
        full: the discretised case; None: it is assembled.

    Raises:
        CaseError: the case is of a reduced model already, acts on a lumped mass, or cannot be
            reduced so.
    """
    if case.model.kind == "reduced":
        raise CaseError('model.kind: expected a model that is not reduced yet, given "reduced"')
    if modes < 1:
        raise CaseError(f"modes: expected at least 1, given {modes}")
    file.require_coupled(case)
    is_floating = not case.is_apart and n_rigid(case) > 0
    slowest = min(float(own.angular_frequencies(1)[0]) for own in case.lamina)
    begin = time.perf_counter()
    full = assemble(case) if full is None else full
    assembled = time.perf_counter()
    try:
        basis = basis_of(
            full.operators, modes, shift=slowest**2 if is_floating else 0.0, most=coordinates
        )
    except ValueError as error:
        raise CaseError(str(error)) from None
    structure = projected(full, basis)
    return Reduction(
        case, full, basis, structure, (assembled - begin, time.perf_counter() - assembled)
    )

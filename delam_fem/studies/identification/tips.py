"""Read the measured motion of the tips of a case."""

from __future__ import annotations

from pathlib import Path

from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.numerics.arrays import FloatArray
from delam_fem.results.measured.reading import read_measured


def tips_of(case: Case, path: Path) -> tuple[FloatArray, FloatArray]:
    """Return times, shape (n,) [s], and tip displacements, shape (n_laminae, n) [m], of a file.

    Raises:
        CaseError: the file cannot be read, or it has not the tips of all laminae.
    """
    data = read_measured(path)
    names = [lamina.name for lamina in case.lamina]
    if "tip_displacement" not in data or not set(names) <= set(data["lamina"].to_numpy()):
        raise CaseError(
            f"{path}: expected the tip displacements of {' and '.join(names)}; delam-fem measure "
            "FILE --channel 'tip NAME=COLUMN:UNIT' makes such a file"
        )
    return data["time"].to_numpy(), data["tip_displacement"].sel(lamina=names).to_numpy()

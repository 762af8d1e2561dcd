"""Write the operators of a case for other programs: NumPy's .npz, or MATLAB's .mat.

    M u'' + C u' + K u = -(m_b q_b'' + c_b q_b' + k_b q_b) + Hᵀ λ,   gap = H u + g0

The numbers are SI, and the matrices are dense: beams have some hundred dofs at most.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from delam_fem.case.atomic import atomic_file
from delam_fem.case.definition import Case
from delam_fem.case.toml import CaseError
from delam_fem.model.layout import Structure

FORMATS = (".npz", ".mat")


def write_operators(structure: Structure, case: Case, path: str | Path) -> Path:
    """Write the operators of a structure to a file that ends in .npz or .mat.

    Args:
        structure: the discretised case.
        case: gives the drive and the text of the case.
        path: the file; its folder is made where it does not exist.

    Raises:
        CaseError: the file name has another ending.
    """
    path = Path(path)
    if path.suffix not in FORMATS:
        raise CaseError(f"operators: expected a file that ends in .npz or .mat, given {path.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    content = operators_of(structure, case)
    with atomic_file(path) as temporary:
        if path.suffix == ".npz":
            np.savez_compressed(temporary, **content)
        else:
            savemat(temporary, content, oned_as="column", do_compression=True)
    return path


def operators_of(structure: Structure, case: Case) -> dict[str, Any]:
    """Return the arrays of a file by name; docs/reduced.md explains them.

    Returns:
        `M`, `C`, `K` of shape (n, n); `m_b`, `c_b`, `k_b` of shape (n,), `M_bb`, `C_bb`, `K_bb`;
        `H` of shape (n_pairs, n) and `g0`; `P` of shape (n_probes, n), the rows of the tips;
        `lamina`, `x` and `component` (0 displacement, 1 slope) of each dof, numbers from 0, -1 of
        the coordinates of a reduced model, shape (n,); `pair_x` [m]; `drive_frequency` [Hz] and
        `drive_amplitude` [m or N] (NaN if the drive is not harmonic); `drive_is_force`;
        `case`, the case as TOML.
    """
    o, layout = structure.operators, structure.layout
    of_dofs = np.full((3, o.n_dofs), -1.0)
    for number, part in enumerate(layout.parts if layout.reading is None else ()):
        for component, dofs in enumerate(part.dofs.T):
            free = dofs >= 0
            of_dofs[0, dofs[free]], of_dofs[2, dofs[free]] = number, component
            of_dofs[1, dofs[free]] = part.x[free]
    lower = [(layout.parts[i.parts[0]], i) for i in layout.interfaces]
    given = case.excitation
    frequency = given.top_frequency if given.is_periodic else np.nan
    amplitude = getattr(given, "amplitude", np.nan)
    if given.is_periodic and hasattr(given, "displacement_amplitude"):
        amplitude = given.displacement_amplitude(frequency)
    return {
        "M": o.mass.toarray(),
        "C": o.damping.toarray(),
        "K": o.stiffness.toarray(),
        "m_b": o.base.mass,
        "c_b": o.base.damping,
        "k_b": o.base.stiffness,
        **dict(zip(("M_bb", "C_bb", "K_bb"), o.base.corner, strict=True)),
        "H": o.gap_matrix.toarray(),
        "g0": o.gap0,
        "P": o.probes.toarray(),
        "lamina": of_dofs[0].astype(np.int64),
        "x": of_dofs[1],
        "component": of_dofs[2].astype(np.int64),
        "pair_x": np.concatenate([part.positions(i.places(0)) for part, i in lower]),
        "drive_frequency": frequency,
        "drive_amplitude": np.nan if amplitude is None else amplitude,
        "drive_is_force": int(o.base.is_force),
        "case": case.to_toml(),
    }

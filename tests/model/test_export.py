"""Operators for other programs: both formats hold the numbers of the case."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import delam_fem as df
from delam_fem.api import assemble
from delam_fem.results.export import write_operators


@pytest.mark.parametrize("ending", [".npz", ".mat"])
def test_a_file_holds_the_operators(ending: str, tmp_path: Path) -> None:
    case = df.preset("default", {"mesh.elements": 3, "contact.points_per_element": 2})
    structure = assemble(case, needs_dolfinx=False)
    path = write_operators(structure, case, tmp_path / "new" / f"case{ending}")
    read = dict(np.load(path)) if ending == ".npz" else loadmat(path, squeeze_me=True)
    o = structure.operators
    for name, matrix in {"M": o.mass, "C": o.damping, "K": o.stiffness, "H": o.gap_matrix}.items():
        np.testing.assert_array_equal(read[name], matrix.toarray())
    np.testing.assert_array_equal(read["g0"], o.gap0)
    np.testing.assert_array_equal(read["k_b"], o.base.stiffness)
    assert float(read["M_bb"]) == o.base.corner[0]
    np.testing.assert_allclose(read["pair_x"], 0.685 * np.arange(1, 7) / 6)
    np.testing.assert_array_equal(read["lamina"], np.repeat([0, 1], 6))
    np.testing.assert_array_equal(read["component"], np.tile([0, 1], 6))
    np.testing.assert_allclose(read["x"][::2], np.tile(0.685 * np.arange(1, 4) / 3, 2))
    assert (float(read["drive_frequency"]), float(read["drive_amplitude"])) == (3.25, 0.0025)
    assert df.Case.from_toml(str(read["case"])) == case


def test_a_drive_that_is_not_harmonic_has_no_frequency(tmp_path: Path) -> None:
    sweep = {"kind": "sweep", "start_frequency": 1.0, "end_frequency": 2.0, "duration": 9.0}
    case = df.preset("default", {f"excitation.{k}": v for k, v in sweep.items()})
    path = write_operators(assemble(case, needs_dolfinx=False), case, tmp_path / "a.npz")
    assert np.isnan(np.load(path)["drive_frequency"])


def test_other_files_are_refused(tmp_path: Path) -> None:
    case = df.preset("default", {"mesh.elements": 2})
    with pytest.raises(df.CaseError, match=r"ends in .npz or .mat, given a.txt"):
        write_operators(assemble(case, needs_dolfinx=False), case, tmp_path / "a.txt")

"""Orbits of a reduced model through the commands of the full one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import delam_fem as df
from delam_fem.studies.orbits.newton import Perturbations
from delam_fem.studies.orbits.search import map_of, usual
from delam_fem.system.errors import CaseError

SMALL = {"mesh.elements": 8, "time.steps_per_period": 200, "excitation.frequency": 3.45}
REDUCED: dict[str, Any] = {"model": "reduced", "modes": 3, "refine": 8}
FEW = Perturbations(copies=4, size=1e-3, kick=0.03)


def test_an_orbit_of_a_reduced_case(tmp_path: Path) -> None:
    found = df.orbit(df.preset("default", SMALL), settle=100, perturbations=FEW, **REDUCED)
    assert found.kind == "exact"
    assert found.numbers["residual"] <= 1e-10
    assert found.numbers["model"] == "3 modes of each part, r = 8"
    assert "grid" not in " ".join(found.words)
    # the motion that is drawn closes, and a settled motion of the model ends on it
    end = found.passage.states[-1]
    np.testing.assert_allclose(end, found.state, atol=1e-8 * np.abs(found.state).max())
    found.save(tmp_path)
    with np.load(tmp_path / "orbit.npz") as file:
        assert file["modal_displacement"].shape == file["modal_velocity"].shape == (6,)
        assert file["late_force"].shape == (16,)
        assert file["tip_displacement"].shape == (200, 2)
    assert (tmp_path / "orbit.png").stat().st_size > 10_000


def test_a_branch_of_a_reduced_case(tmp_path: Path) -> None:
    case, over = df.preset("default", SMALL), ("excitation.frequency", 3.43, 3.45)
    options: dict[str, Any] = {"settle": 60, "perturbations": FEW, "step": 0.4, **REDUCED}
    data = df.follow(case, *over, tmp_path, **options)
    assert data.attrs["model"] == "3 modes of each part, r = 8"
    assert data.attrs["endings"] == "range"
    assert np.isfinite(data["smallest_gap"]).all()
    with pytest.raises(CaseError, match="another continuation"):
        df.follow(case, *over, tmp_path, resume=True, **options | {"modes": 4})


def test_models_have_their_own_perturbations_and_options() -> None:
    case = df.preset("default", SMALL)
    assert usual("reduced").size < usual("full").size
    with pytest.raises(CaseError, match="model: expected full or reduced, given 'small'"):
        usual("small")  # type: ignore[arg-type]
    with pytest.raises(CaseError, match="modes: expected with model 'reduced' only, given 8"):
        map_of(case, "excitation.frequency", modes=8)
    with pytest.raises(CaseError, match="refine: expected at least 1, given 0"):
        map_of(case, "excitation.frequency", "reduced", refine=0)

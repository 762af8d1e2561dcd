"""Orbits in modes with massless contact points, as those of the finite elements."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from massless import massless

import delam_fem as df
from delam_fem.api import CaseError
from delam_fem.studies.orbits.newton import Perturbations
from delam_fem.studies.orbits.search import default_perturbations, map_of

SMALL = {"mesh__elements": 8, "time__steps_per_period": 200, "excitation__frequency": 3.45}
FEW = Perturbations(copies=4, size=1e-3, kick=0.03)


def test_an_orbit_of_a_case_in_modes(tmp_path: Path) -> None:
    orbit = df.orbit(massless(3, 8, **SMALL), settle=100, perturbations=FEW)
    assert orbit.kind == "exact"
    assert orbit.numbers["residual"] <= 1e-10
    assert orbit.numbers["model"] == "3 modes of each part, r = 8"
    assert "grid" not in " ".join(orbit.words)
    # the motion that is drawn closes, and a settled motion of the model ends on it
    end = orbit.trajectory.states[-1]
    np.testing.assert_allclose(end, orbit.state, atol=1e-8 * np.abs(orbit.state).max())
    orbit.save(tmp_path)
    with np.load(tmp_path / "orbit.npz") as file:
        assert file["modal_displacement"].shape == file["modal_velocity"].shape == (6,)
        assert file["late_force"].shape == (16,)
        assert file["tip_displacement"].shape == (200, 2)
    assert (tmp_path / "orbit.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_branch_of_a_case_in_modes(tmp_path: Path) -> None:
    case, over = massless(3, 8, **SMALL), ("excitation.frequency", 3.43, 3.45)
    options: dict[str, Any] = {"settle": 60, "perturbations": FEW, "step": 0.4}
    data = df.follow(case, *over, tmp_path, **options)
    assert data.attrs["model"] == "3 modes of each part, r = 8"
    assert data.attrs["endings"] == "range"
    assert np.isfinite(data["smallest_gap"]).all()
    with pytest.raises(CaseError, match=r"model\.modes: 3 there, 4 here"):
        df.follow(massless(4, 8, **SMALL), *over, tmp_path, resume=True, **options)


def test_models_have_their_own_perturbations() -> None:
    assert default_perturbations(massless()).size < default_perturbations(df.preset("default")).size


def test_modes_without_contact_have_no_map_and_too_many_are_refused() -> None:
    with pytest.raises(CaseError, match="expected a law with contact, given 'none'"):
        map_of(massless(contact__law="none"), "excitation.frequency")
    with pytest.raises(CaseError, match="the modes beyond the lowest 30"):
        map_of(massless(30), "excitation.frequency")

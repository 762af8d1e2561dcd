"""What a map returned is on disk, so that a search that was killed does not compute it again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from massless import massless

import delam_fem as df
from delam_fem.api import identity
from delam_fem.studies.orbits import maps
from delam_fem.studies.orbits.maps import KeptMap
from delam_fem.studies.orbits.newton import Perturbations


class Counted:
    """A map that doubles its states, and counts."""

    info = "doubling"

    def __init__(self) -> None:
        self.calls = 0

    def after(self, states, parameter, shifts=None):  # type: ignore[no-untyped-def]
        self.calls += 1
        return 2.0 * states + parameter + (0.0 if shifts is None else shifts[:, None])

    def started_at_widest_gap(self, state, parameter):  # type: ignore[no-untyped-def]
        return self, state


def results(folder: Path, case: df.Case | None = None) -> tuple[list[np.ndarray], int]:
    """Return what a kept map gives for four different questions, and how many were computed."""
    counted_map = Counted()
    map_ = KeptMap(counted_map, folder, identity(case or df.preset("paper")))  # type: ignore[arg-type]
    assert map_.info == "doubling"
    states = np.array([[1.0, 2.0]])
    ends = [map_.after(states, 0.5), map_.after(states, 0.6)]
    ends.append(map_.after(states, 0.5, np.array([0.25])))
    inner, first = map_.started_at_widest_gap(states[0], 0.5)
    ends.append(inner.after(first[None], 0.5))
    return ends, counted_map.calls


def test_a_second_search_computes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(maps, "CHECKPOINT_SECONDS", 0.0)
    (computed, n), (again, none) = results(tmp_path / "k"), results(tmp_path / "k")
    assert (n, none) == (4, 0)
    np.testing.assert_array_equal(again, computed)
    with pytest.raises(df.CaseError, match=r"excitation.amplitude: 0.0025 there, 0.004 here"):
        results(tmp_path / "k", df.preset("paper", {"excitation.amplitude": 0.004}))
    for path in (tmp_path / "k").glob("*.npz"):
        path.write_bytes(path.read_bytes()[:100])
    once_more, n = results(tmp_path / "k")
    assert n == 3  # those of the map that was opened are whole
    np.testing.assert_array_equal(once_more, computed)


@pytest.mark.slow
def test_an_orbit_goes_on_with_what_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(maps, "CHECKPOINT_SECONDS", 0.0)
    keys = {"mesh__elements": 8, "time__steps_per_period": 200, "excitation__frequency": 3.45}
    case, few = massless(3, 8, **keys), Perturbations(copies=4, size=1e-3, kick=0.03)
    options = {"settle": 50, "perturbations": few}
    first = df.orbit(case, kept=tmp_path, **options)
    n_files = len(list(tmp_path.rglob("*.npz")))
    second = df.orbit(case, kept=tmp_path, **options)
    np.testing.assert_array_equal(second.state, first.state)
    assert n_files > 50 and len(list(tmp_path.rglob("*.npz"))) == n_files

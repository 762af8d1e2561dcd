"""Keys of a case from a natural frequency over time, beside an exact beam."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from measurements import write_csv

import delam_fem as df
from delam_fem import CaseError, read_measured
from delam_fem.api import Case
from delam_fem.studies.identification.unknowns import drawn, of_rig
from delam_fem.studies.signals.writing import write_measured

EI, L, RHO_A, PLACES, ERROR = 10.0, 0.5, 0.1, (0.12, 0.2), 0.2
"""A beam, places of a clamp inside its span [m], and the error of a frequency [Hz]."""
CASE = Case(
    name="moving", support=[{"start": "clamped"}, {"kind": "clamped", "position": 0.1}],
    lamina=[{"name": "one", "length": L, "width": 0.02, "thickness": 0.002,
             "mass_per_length": RHO_A, "bending_stiffness": EI, "damping_ratio": 0.01}],
    mesh={"elements": 4}, contact={"law": "none"},
    excitation={"kind": "harmonic", "amplitude": 0.0, "frequency": 20.0},
)  # fmt: skip


def exact(place: float | np.ndarray) -> np.ndarray:
    """Return the first frequency of the cantilever beyond the clamp [Hz]."""
    return np.asarray((1.875104 / (L - place)) ** 2 * np.sqrt(EI / RHO_A) / (2.0 * np.pi))


def measured(path: Path, frequencies: np.ndarray) -> Path:
    """Write a history with free vibrations, as `measure response --free` does."""
    errors = np.full(frequencies.size, ERROR)
    errors[np.isnan(frequencies)] = np.nan
    times = np.arange(frequencies.size, dtype=float)
    samples = np.linspace(0.0, 1.0, 11)
    history = write_csv(path.with_suffix(".csv"), samples, {"y": np.cos(samples)})
    data = read_measured(history).assign_coords(free_time=times)
    data["free_frequency"] = ("free_time", frequencies)
    data["free_frequency_error"] = ("free_time", errors)
    return write_measured(data, path)


def test_each_time_has_the_place_of_its_own_and_an_interval_as_wide_as_the_error(
    tmp_path: Path,
) -> None:
    """The slope of the exact frequency says how wide: the error is the only doubt."""
    path = measured(tmp_path / "m.nc", np.array([exact(PLACES[0]), np.nan, exact(PLACES[1])]))
    told: list[tuple[int, int]] = []
    result = df.natural(
        CASE, tmp_path / "out", measured=path, unknown=("support.2.position=0.05:0.25",),
        uncertain=(), simulations=60, progress=lambda *counts: told.append(counts),
    )  # fmt: skip
    assert told == [(k, 60) for k in range(1, 61)]
    assert result.time.tolist() == [0.0, 2.0]
    for (low, middle, high), place in zip(result.quantiles[:, :, 0], PLACES, strict=True):
        width = 2.0 * 1.645 * ERROR / float(exact(place + 5e-4) - exact(place - 5e-4)) * 1e-3
        assert low < place < high
        assert middle == pytest.approx(place, abs=0.5 * width)
        assert 0.8 * width < high - low < 1.25 * width
    numbers = json.loads((tmp_path / "out" / "natural.json").read_text())
    assert numbers["unknowns"]["support.2.position"]["median"] == pytest.approx(PLACES, abs=2e-3)
    assert (tmp_path / "out" / "natural.png").stat().st_size > 10_000


def test_what_is_no_such_measurement_is_refused(tmp_path: Path) -> None:
    path = measured(tmp_path / "m.nc", np.array([np.nan]))
    with pytest.raises(CaseError, match=r"m.nc: "):
        df.natural(CASE, measured=path, unknown=("support.2.position=0.05:0.25",))
    path = measured(path, np.array([20.0]))
    with pytest.raises(CaseError, match=r"position: .*given multiples"):
        df.natural(CASE, measured=path, unknown=("support.2.position=0.9x:1.1x",))


@pytest.mark.parametrize("ends", [[{"start": "clamped"}], []])
def test_clamps_of_cases_with_inner_supports_yield(ends: list[dict[str, str]]) -> None:
    """Whether the case names its ends or not, and without a word of what is uncertain."""
    data = CASE.model_dump(exclude_unset=True) | {
        "support": [{"kind": "pinned", "position": 0.1}, *ends]
    }
    case = Case(**data)
    [stiffness] = drawn(of_rig(case), case, 1, 1)["support.rotational_stiffness"]
    changed = case.with_overrides(
        {"support.rotational_stiffness": stiffness, "support.end": "pinned"}
    )
    assert changed.support.rotational_stiffness == stiffness
    assert (changed.support.end, changed.support.inside) == ("pinned", case.support.inside)

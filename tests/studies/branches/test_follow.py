"""Branches of a case: what is written, and a kill that changes nothing."""

from __future__ import annotations

import inspect
import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import delam_fem as df
from delam_fem import follow
from delam_fem.api import CaseError
from delam_fem.studies.orbits import follow as following
from delam_fem.studies.orbits.follow import FOLDER, RESULT
from delam_fem.studies.orbits.newton import Perturbations
from delam_fem.studies.orbits.study import Follow

SMALL = {"mesh.elements": 3, "time.steps_per_period": 60, "excitation.frequency": 3.8}
FEW = Perturbations(copies=4)
STEP = 0.2


def small(
    folder: Path,
    *,
    resume: bool = False,
    stop: float = 4.0,
    step: float = STEP,
    **options: Any,
) -> xr.Dataset:
    case = df.preset("paper", {**SMALL, "contact.law": "none"})
    return follow(
        case, "excitation.frequency", 3.7, stop, folder, settle=400, perturbations=FEW, step=step,
        resume=resume, **options,
    )  # fmt: skip


@pytest.fixture(scope="module")
def linear(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a branch of linear motions."""
    folder = tmp_path_factory.mktemp("linear")
    small(folder)
    return folder


@pytest.mark.slow
def test_a_linear_branch_is_the_linear_response(linear: Path) -> None:
    data = xr.load_dataset(linear / RESULT, engine="h5netcdf")
    assert data.attrs["outcome"] == "completed" and data.attrs["endings"] == "range"
    assert (data.stability == "stable").all() and data.sizes["event"] == 0
    assert float(data.parameter[0]) == 3.7 and float(data.parameter[-1]) > 4.0
    case = df.preset("paper", SMALL)
    amplitude = 0.5 * (data.high - data.low).to_numpy()
    for i in range(2):
        exact = case.linear_amplitude(i, data.parameter.to_numpy())
        # three elements and sixty steps a period shift the resonance at 3.17 Hz by some parts in
        # a thousand
        assert amplitude[:, i] == pytest.approx(exact, rel=0.03)


def half_written(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:1000])


def of_another_shape(path: Path) -> None:
    with np.load(path) as file:
        arrays = dict(file)
    np.savez(path, **{**arrays, "state": np.full(3, np.nan), "parameter": np.zeros(2)})


@pytest.mark.slow
@pytest.mark.parametrize("damage", [half_written, of_another_shape])
def test_a_branch_that_is_broken_off_goes_on_the_same(
    damage: Callable[[Path], None], linear: Path, tmp_path: Path
) -> None:
    complete_branch = xr.load_dataset(linear / RESULT, engine="h5netcdf")
    shutil.copytree(linear, tmp_path / "cut")
    points = sorted((tmp_path / "cut" / FOLDER).glob("*.npz"))
    points[-1].unlink()
    damage(points[-2])
    counted: list[int] = []
    resumed = small(
        tmp_path / "cut", resume=True, report=lambda branch, count, at: counted.append(count)
    )
    assert counted == [len(points) - 1, len(points)]
    assert resumed.drop_attrs().identical(complete_branch.drop_attrs())
    assert (
        xr.load_dataset(tmp_path / "cut" / RESULT, engine="h5netcdf")
        .drop_attrs()
        .identical(complete_branch.drop_attrs())
    )
    with pytest.raises(CaseError, match=r"stop: .* there, 4.1 here"):
        small(tmp_path / "cut", resume=True, stop=4.1)


SHORT = 3.72
"""Where a branch of few steps ends [Hz]."""
LONG_STEP = 5.0


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a branch of few steps."""
    folder = tmp_path_factory.mktemp("short")
    small(folder, stop=SHORT, step=LONG_STEP)
    return folder


@pytest.mark.parametrize(("key", "is_same"), [('motion = "lateral"', True), ("width", False)])
def test_a_branch_goes_on_if_its_case_lacks_a_default(
    key: str, is_same: bool, short: Path, tmp_path: Path
) -> None:
    shutil.copytree(short, tmp_path / "kept")
    about = tmp_path / "kept" / FOLDER / "identity.json"
    content = json.loads(about.read_text("utf-8"))
    lines = [line for line in content["case"].splitlines() if not line.startswith(key)]
    about.write_text(json.dumps({**content, "case": "\n".join(lines)}), "utf-8")
    counted: list[int] = []
    with nullcontext() if is_same else pytest.raises(CaseError, match="belongs to another"):
        small(
            tmp_path / "kept",
            resume=True,
            stop=SHORT,
            step=LONG_STEP,
            report=lambda *now: counted.append(now[1]),
        )
    assert not counted


def test_a_branch_is_interrupted_between_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []

    @contextmanager
    def stops() -> Iterator[Callable[[], bool]]:
        yield lambda: len(counts) >= 2

    monkeypatch.setattr(following, "stop_signals", stops)
    data = small(tmp_path, report=lambda branch, count, at: counts.append(count))
    assert data.attrs["outcome"] == "interrupted" and data.sizes["point"] == 2


@pytest.mark.slow
def test_any_key_of_numbers_is_a_parameter(tmp_path: Path) -> None:
    case = df.preset("paper", {**SMALL, "contact.law": "none"})
    data = follow(
        case, "lamina.thin.thickness", 0.001, 0.0011, tmp_path, settle=400, perturbations=FEW,
        step=0.2,
    )  # fmt: skip
    assert float(data.parameter[-1]) > 0.0011
    moved = np.ptp(data.strobe_displacement.isel(cycle=0).to_numpy(), axis=0)
    assert moved[1] > 1e-6 and moved[0] < 0.02 * moved[1]  # only the thin lamina changes


@pytest.mark.parametrize(
    ("key", "start", "stop", "message"),
    [
        ("contact.restitution", 0.1, 0.1, "expected a range"),
        ("contact.restitution", 0.1, 1.5, "restitution"),
        ("contact.nothing", 0.1, 0.2, "nothing"),
    ],
)
def test_bad_ranges_are_refused(
    tmp_path: Path, key: str, start: float, stop: float, message: str
) -> None:
    with pytest.raises(CaseError, match=message):
        follow(df.preset("paper", SMALL), key, start, stop, tmp_path)


def test_defaults_are_those_of_the_command() -> None:
    parameters = inspect.signature(follow).parameters
    defaults = {field.name: field.default for field in fields(Follow)}
    for name, option in (("periods", "period"), ("doublings", "doublings"), ("step", "step")):
        assert parameters[name].default == defaults[option], name

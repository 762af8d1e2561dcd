"""The commands `measure` and `show export`: what they write, show and refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from measurements import recorded, write_csv
from synthetic import small_case, synthetic_history
from typer.testing import CliRunner

from delam_fem.api import save_case
from delam_fem.cli.app import app


def call(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Write a table of two tips in mm, 100 samples per second."""
    t = np.arange(200) / 100.0
    rows = zip(t, 3.0 * np.sin(t), 4.0 * np.cos(t), strict=True)
    path = tmp_path / "tips.csv"
    path.write_text("time [s],a,b\n" + "\n".join(",".join(map(str, row)) for row in rows))
    return path


def test_measure_writes_a_dataset_and_says_what_it_holds(table: Path, tmp_path: Path) -> None:
    status, output = call(
        "measure", "read", table, "-o", tmp_path / "out", "--units", "mm",
        "--channel", "tip thick=a", "--channel", "tip thin=col3:um",
    )  # fmt: skip
    assert status == 0, output
    assert "200 samples, 100 per second, 1.99 s" in output and "displacement" in output
    data = xr.load_dataset(tmp_path / "out" / "measured.nc", engine="h5netcdf")
    assert float(data["tip_displacement"].sel(lamina="thick").max()) == pytest.approx(
        3e-3, rel=1e-3
    )
    assert float(data["tip_displacement"].sel(lamina="thin").max()) == pytest.approx(4e-6)
    status, output = call("measure", "read", table, "-o", tmp_path / "out", "--units", "mm")
    assert status == 2 and "not empty" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "no unit; expected one in the heading"),
        (("--units", "mmm"), "expected a unit such as mm"),
        (("--units", "mm", "--channel", "tip thick"), "expected NAME=SOURCE"),
        (("--units", "mm", "--channel", "c=d"), "there is no column 'd'"),
        (("--units", "mm", "--channel", "c=a", "--channel", "c=b"), "given 'c' twice"),
        (("--units", "mm", "--channel", "c=a:mm@here"), "expected a position such as 0.12"),
    ],
)
def test_measure_refuses_what_is_not_clear(
    table: Path, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    status, output = call("measure", "read", table, "-o", tmp_path / "out", *arguments)
    assert status == 2 and message in output
    assert not (tmp_path / "out").exists()


def test_responses_need_to_be_asked_for(table: Path, tmp_path: Path) -> None:
    status, output = call("measure", "response", table, "-o", tmp_path / "out", "--units", "mm")
    assert status == 2 and "expected --excitation NAME, --poles LOW HIGH or both" in output
    assert not (tmp_path / "out").exists()


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Write the numbers of a run."""
    case = small_case()
    save_case(case, tmp_path / "run")
    history = synthetic_history(case)
    history.to_netcdf(tmp_path / "run" / "result.nc", engine="h5netcdf")
    return tmp_path / "run"


def test_overlay_says_how_a_measurement_differs(run: Path, tmp_path: Path) -> None:
    history = xr.load_dataset(run / "result.nc", engine="h5netcdf")
    t, (a, b) = recorded(history, period=small_case().period, start=14.4, noise=1e-4)
    path = write_csv(tmp_path / "m.csv", t, {"tip thick": a, "tip thin": 1.5 * b})
    status, output = call("measure", "overlay", path, run)
    assert status == 0, output
    assert "tip thin: measured 1.5 ±" in output and "time of the run =" in output
    assert (run / "overlay" / "overlay.html").is_file()
    status, output = call(
        "measure", "overlay", run, path, "--channel", "a=tip thick", "--channel", "b=tip thin"
    )
    assert status == 2 and "none of its channels (a, b) is in the run" in output
    status, output = call("measure", "overlay", tmp_path, path)
    assert status == 2 and "result.nc" in output
    status, output = call("measure", "overlay", path, tmp_path / "none")
    assert status == 2 and "the folder of one run" in " ".join(output.split())


@pytest.mark.parametrize("to", ["csv", "mat", "uff", "vtkhdf"])
def test_export_writes_beside_the_run(run: Path, to: str) -> None:
    status, output = call("show", "export", run, "--to", to)
    assert status == 0, output
    assert f"paper.{to}" in output.replace(" ", "")
    assert (run / "export" / f"paper.{to}").stat().st_size > 100


def test_export_refuses_other_formats(run: Path) -> None:
    status, output = call("show", "export", run, "--to", "xls")
    assert status == 2 and "expected one of csv, mat, uff, vtkhdf" in output

"""The command `delam-fem show film`: what it writes and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from synthetic import small_case, synthetic_history
from typer.testing import CliRunner

from delam_fem.api import save_case
from delam_fem.cli.app import app


def animate(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["show", "film", *(str(argument) for argument in arguments)])
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the numbers of a run."""
    folder, case = tmp_path_factory.mktemp("run"), small_case()
    save_case(case, folder)
    synthetic_history(case).to_netcdf(folder / "result.nc", engine="h5netcdf")
    return folder


def test_a_run_becomes_films(run: Path, tmp_path: Path) -> None:
    files = tmp_path / "new" / "a.gif", tmp_path / "b.mp4"
    status, output = animate(
        run, "-o", files[0], "-o", files[1], "--periods", "0.2", "--rate", "10"
    )
    assert status == 0, output
    assert str(files[0]) in output.replace("\n", "") and files[1].stat().st_size > 1000
    with Image.open(files[0]) as film:
        assert (film.n_frames, film.info["duration"]) == (4, 100)
    assert not (run / "laminae.gif").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "film.avi"), "expected a file that ends in .gif or .mp4, given film.avi"),
        (("-o", "a.gif", "-o", "a.gif"), "one of them twice"),
        (("--periods", "0"), "--periods: "),
        (("--stretch", "nan"), "--stretch: "),
    ],
)
def test_bad_input_is_refused(run: Path, arguments: tuple[str, ...], message: str) -> None:
    status, output = animate(run, *arguments)
    assert status == 2
    assert message in " ".join(output.split())


def test_a_folder_without_a_run_or_without_frames_is_refused(tmp_path: Path) -> None:
    status, output = animate(tmp_path)
    assert status == 2 and "result.nc" in output
    case = small_case()
    save_case(case, tmp_path)
    none = synthetic_history(case).isel(frame=slice(0, 0))
    none.to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    status, output = animate(tmp_path)
    assert status == 2 and "output.fields_per_period above 0" in " ".join(output.split())
    assert not list(tmp_path.glob("*.gif"))

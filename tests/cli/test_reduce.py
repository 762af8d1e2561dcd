"""The command `delam-fem reduce`, and the commands that take what it writes."""

import json
from pathlib import Path

import pytest
from mpi_pool import Crew
from typer.testing import CliRunner

from delam_fem.cli.app import app

SMALL = ("--set", "mesh.elements=6")
SHORT = ("--set", "time.steps_per_period=200", "--set", "time.periods=3", "--set",
         "output.window_periods=2", "--set", "output.fields_per_period=4")  # fmt: skip


def call(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a reduction."""
    path = tmp_path_factory.mktemp("reduce") / "model"
    status, output = call("reduce", "default", *SMALL, "--modes", "4", "-o", path)
    assert status == 0, output
    assert "normal modes │ 8 of 2 bodies" in output
    assert "1 │ 1.43571 │ 1.43571 │ +0.0e+00" in output
    return path


def test_a_reduced_case_is_computed_by_both_engines(folder: Path, tmp_path: Path) -> None:
    for engine in ("petsc", "compiled"):
        run = tmp_path / engine
        drawn = () if engine == "petsc" else ("--no-figures",)
        line = ("run", folder / "case.toml", *SHORT, *drawn, "--engine", engine, "-o", run)
        status, output = call(*line)
        assert status == 0, output
        assert (run / "reduced.npz").is_file()  # the run can be repeated from its folder
        for name in ("figures/envelope.png", "fields"):
            assert (run / name).exists() == (engine == "petsc")
    summaries = [
        json.loads((tmp_path / e / "summary.json").read_text()) for e in ("petsc", "compiled")
    ]
    assert summaries[0]["tip_max"] == pytest.approx(summaries[1]["tip_max"], rel=1e-9)
    assert call("run", tmp_path / "petsc" / "case.toml", "--dry-run")[0] == 0


def test_results_are_replaced_only_when_asked(folder: Path) -> None:
    again = ("reduce", "default", *SMALL, "--modes", "4", "-o", folder)
    status, output = call(*again)
    assert status == 2 and "--overwrite" in output
    assert call(*again, "--overwrite", "-q") == (0, "")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("paper",), "contact.impulse: "),
        (("default", "--modes", "20", "--coordinates", "7"), "coordinates: "),
    ],
)
def test_bad_input_is_refused(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    status, output = call("reduce", *arguments, *SMALL, "-o", tmp_path / "a")
    assert status == 2
    assert message in output
    assert not (tmp_path / "a").exists()


def test_a_sweep_computes_points_with_the_file(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(
        f"""base = "{folder / "case.toml"}"
[set]
"time.periods" = 3
"time.steps_per_period" = 100
[[axis]]
key = "excitation.frequency"
values = [3.0, 3.5]
[[axis]]
key = "gap.tip"
values = [0.010, 0.012]
""",
        encoding="utf-8",
    )
    status, output = call(
        "sweep", tmp_path / "s.toml", "-o", tmp_path / "sweep", "--executor", "serial"
    )
    assert status == 0, output
    assert (tmp_path / "sweep" / "sweep.nc").is_file()


RANKS = """
import numpy as np
import delam_fem as df

keys = {"time.steps_per_period": 200, "time.periods": 3, "output.window_periods": 2}
case = df.load_case(arguments[0], keys)
one, two = df.run(case).history, df.run(case, comm=comm).history
for name in ("tip_displacement", "displacement", "velocity"):
    np.testing.assert_allclose(two[name], one[name], atol=1e-10)
"""


@pytest.mark.mpi
def test_two_ranks_read_the_whole_file(folder: Path, crew: Crew) -> None:
    crew.run(2, RANKS, folder / "case.toml")

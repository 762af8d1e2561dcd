"""The commands `delam-fem reduced` and `delam-fem show operators`."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from delam_fem.cli.app import app

SMALL = ("--set", "mesh.elements=6", "--set", "time.steps_per_period=200", "--set",
         "time.periods=4", "--set", "output.window_periods=2", "--set",
         "output.fields_per_period=0")  # fmt: skip


def call(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, " ".join(result.output.split())


def test_a_reduced_case_becomes_the_folder_of_a_run(tmp_path: Path) -> None:
    run: tuple[str | Path, ...]
    run = ("reduced", "default", *SMALL, "--modes", "5", "--refine", "8", "-o", tmp_path / "run")
    status, output = call(*run)
    assert status == 0, output
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["model"] == {"kind": "reduced", "modes": 5, "refine": 8}
    assert summary["outcome"] == "completed"
    assert (tmp_path / "run" / "report.html").stat().st_size > 1000
    status, output = call(*run)
    assert status == 2 and "--overwrite" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("reduced", "default", "--modes", "30"), "modes: the modes beyond the lowest 30"),
        (("show", "operators", "default", "-o", "a.csv"), "ends in .npz or .mat, given a.csv"),
    ],
)
def test_bad_input_is_refused(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    status, output = call(*arguments)
    assert status == 2
    assert message in output


def test_operators_are_written(tmp_path: Path) -> None:
    status, output = call("show", "operators", "default", *SMALL, "-o", tmp_path / "a.mat")
    assert status == 0, output
    assert (tmp_path / "a.mat").stat().st_size > 1000

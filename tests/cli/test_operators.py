"""A run in modes, and the command `delam-fem show operators`."""

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


MASSLESS = ("model.kind=modes", "time.mass=massless", "contact.law=newton",
            "contact.restitution=0")  # fmt: skip


def test_a_case_in_modes_becomes_the_folder_of_a_run(tmp_path: Path) -> None:
    keys = [
        word for key in (*MASSLESS, "model.modes=5", "time.refine=8") for word in ("--set", key)
    ]
    run = ("run", "default", *SMALL, *keys, "-o", tmp_path / "run")
    status, output = call(*run)
    assert status == 0, output
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert (summary["engine"], summary["outcome"]) == ("modal", "completed")
    assert (tmp_path / "run" / "report.html").stat().st_size > 1000
    assert 'kind = "modes"' in (tmp_path / "run" / "case.toml").read_text()
    status, output = call(*run)
    assert status == 2 and "--overwrite" in output
    status, output = call("run", tmp_path / "run" / "case.toml", "--resume", "-o", tmp_path / "run")
    assert status == 0, output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("run", "default", "--set", "time.mass=massless"),
            "without mass is rigid and cannot bounce",
        ),
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

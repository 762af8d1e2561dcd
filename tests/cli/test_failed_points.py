"""A sweep with points that were not completed ends with status 1 and says how many they are."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from delam_fem.cli.app import app

SWEEP = """
name = "s"
base = "paper"
[set]
"mesh.elements" = 3
"time.steps_per_period" = 40
"time.periods" = 3
"output.window_periods" = 2
"output.fields_per_period" = 0
[[axis]]
key = "excitation.frequency"
values = [3.0, 3.5, 4.0]
[[axis]]
key = "time.scheme"
values = {schemes}
"""
"""Forty steps a period are too few for the central difference: its points fail."""


WITHOUT = '["newmark"]'
WITH = '["newmark", "central-difference"]'


@pytest.mark.parametrize(
    ("schemes", "status", "quiet"),
    [
        (WITHOUT, 0, ["-q"]),
        (WITH, 1, []),
        pytest.param(WITHOUT, 0, [], marks=pytest.mark.slow),
        pytest.param(WITH, 1, ["-q"], marks=pytest.mark.slow),
    ],
)
def test_the_number_of_failed_points_is_told(
    schemes: str, status: int, quiet: list[str], tmp_path: Path
) -> None:
    path, folder = tmp_path / "s.toml", tmp_path / "out"
    path.write_text(SWEEP.replace("{schemes}", schemes))
    line = ["sweep", str(path), "-o", str(folder), "-j", "1", *quiet]
    result = CliRunner().invoke(app, line)
    assert result.exit_code == status, result.output
    assert (folder / "sweep.nc").is_file() and (folder / "report.html").is_file()
    assert ("3 failed of 6 points" in result.stderr) == bool(status)
    again = CliRunner().invoke(app, [*line, "--resume"])
    assert again.exit_code == status

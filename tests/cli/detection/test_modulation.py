"""The command `delam-fem detect modulate`."""

import json
from pathlib import Path

from typer.testing import CliRunner

from delam_fem.cli.app import app

SMALL = ("--set", "mesh.elements=20", "--set", "time.steps_per_period=100")


def test_modulate(tmp_path: Path) -> None:
    pump = ("--pump-frequency", "60", "--pump-amplitude", "0.1", "--periods", "2")
    case = ("detect", "modulate", "embedded", "--set", "excitation.frequency=350", *SMALL)
    result = CliRunner().invoke(app, [*case, *pump, "-o", str(tmp_path)])
    assert result.exit_code == 0, result.output
    numbers = json.loads((tmp_path / "modulation.json").read_text("utf-8"))
    assert numbers["called"] and not numbers["intact_called"]
    assert len(numbers["ratio_to_intact"]) == len(numbers["x"]) == 41
    assert (tmp_path / "figures" / "modulation.png").is_file()
    assert "Sidebands of 350 Hz" in (tmp_path / "report.html").read_text("utf-8")

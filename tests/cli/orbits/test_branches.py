"""The command `delam-fem orbit follow`: what it writes, says and refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import xarray as xr
from typer.testing import CliRunner

from delam_fem.cli.app import app
from delam_fem.studies.orbits import search

SMALL = (
    "--set", "mesh.elements=1", "--set", "time.steps_per_period=50", "--step", "0.4",
    "--set", "contact.law=none",
)  # fmt: skip
RANGE = ("--from", "3.7", "--to", "3.8")


def invoke(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(
        app, ["orbit", "follow", *(str(argument) for argument in arguments)]
    )
    return result.exit_code, result.output


@pytest.mark.slow
def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "USUAL", replace(search.USUAL, copies=4))  # no impacts scatter here
    sweep = tmp_path / "s.toml"
    sweep.write_text(
        'name = "s"\nbase = "paper"\nengine = "compiled"\n[[axis]]\nkey = "excitation.frequency"\n'
        'values = [3.7, 3.8]\n[set]\n"mesh.elements" = 3\n"time.steps_per_period" = 50\n'
        '"time.periods" = 8\n"output.fields_per_period" = 0\n'
    )
    swept = CliRunner().invoke(
        app, ["sweep", str(sweep), "-o", str(tmp_path / "s"), "--executor", "serial", "-q"]
    )
    assert swept.exit_code == 0, swept.output
    folder = tmp_path / "b"
    status, output = invoke("paper", *SMALL, *RANGE, "-o", folder, "--over", tmp_path / "s")
    assert status == 0, output
    assert "the branches end: range" in " ".join(output.split())
    with xr.open_dataset(folder / "branch.nc", engine="h5netcdf") as data:
        assert data.attrs["key"] == "excitation.frequency"
        assert float(data.parameter[0]) == 3.7
        assert set(data.stability.values) == {"stable"}
    assert (folder / "branch.png").stat().st_size > 10_000
    status, output = invoke("paper", *SMALL, *RANGE, "-o", folder)
    assert status == 2 and "--resume" in output
    status, output = invoke("paper", *SMALL, *RANGE, "-o", folder, "--resume", "-q")
    assert status == 0, output
    status, output = invoke(
        "paper", "contact.restitution", *SMALL, "--from", "0.1", "--to", "0.2",
        "-o", tmp_path / "c", "--over", tmp_path / "s",
    )  # fmt: skip
    assert status == 2 and "expected a sweep over contact.restitution" in " ".join(output.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--from", "3.7", "--to", "3.7"), "expected a range"),
        (("contact.law", "--from", "1", "--to", "2"), "contact.law"),
        (("--from", "3.7", "--to", "-1"), "excitation.frequency"),
    ],
)
def test_bad_input(tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    status, output = invoke("paper", *arguments, "-o", tmp_path / "b")
    assert status == 2 and message in " ".join(output.split())
    assert not (tmp_path / "b").exists()

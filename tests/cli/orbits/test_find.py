"""The command `delam-fem orbit find`: what it writes, says and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import delam_fem as df
from delam_fem.cli.app import app

SOFT = (
    "--set", "excitation.frequency=1.25", "--set", "contact.law=penalty",
    "--set", "mesh.elements=4", "--set", "time.steps_per_period=200",
)  # fmt: skip


def invoke(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["orbit", "find", *(str(argument) for argument in arguments)])
    return result.exit_code, result.output


def test_an_exact_orbit(tmp_path: Path) -> None:
    folder = tmp_path / "o"
    status, output = invoke("paper", *SOFT, "--settle", "150", "-o", folder)
    assert status == 0, output
    content = json.loads((folder / "orbit.json").read_text("utf-8"))
    assert content["kind"] == "exact" and "An exact orbit" in " ".join(output.split())
    assert content["residual"] <= 1e-10 and content["residual_error"] == 0.0
    assert content["period"] == pytest.approx(0.8) and content["drive_periods"] == 1
    assert content["stability"] == "stable"
    moduli = [abs(complex(*mu)) for mu in content["multipliers"]]
    assert moduli == sorted(moduli, reverse=True) and 0.8 < moduli[0] < 1.0
    assert (folder / "orbit.png").stat().st_size > 10_000
    with np.load(folder / "orbit.npz") as file:
        assert file["displacement"].shape == file["velocity"].shape == (16,)
    assert df.load_case(folder / "case.toml").excitation.frequency == 1.25


def test_a_coarse_orbit_says_so(tmp_path: Path) -> None:
    few = ("--set", "mesh.elements=6", "--set", "time.steps_per_period=300", "--settle", "100")
    status, output = invoke("paper", *few, "-o", tmp_path / "o")
    assert status == 0, output
    content = json.loads((tmp_path / "o" / "orbit.json").read_text("utf-8"))
    assert content["kind"] == "coarse" and content["residual_error"] > 1e-6
    assert content["exact_search"]["smallest_residual"] > content["exact_search"]["needed"]
    assert content["coarse"]["kick"] <= 0.03
    assert len(content["multipliers"]) == len(content["multipliers_error"]) == 8


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("paper", "--period", "0"), "period: "),
        (("nothing",), "neither a file nor a preset"),
    ],
)
def test_bad_input(tmp_path: Path, arguments: tuple[str, ...], message: str) -> None:
    status, output = invoke(*arguments, "-o", tmp_path / "o")
    assert status == 2 and message in " ".join(output.split())
    assert not (tmp_path / "o").exists()


@pytest.mark.nightly
def test_an_orbit_in_modes(tmp_path: Path) -> None:
    few = ("--set", "mesh.elements=6", "--set", "time.steps_per_period=100", "--settle", "60")
    keys = ("model.kind=modes", "model.modes=2", "time.mass=massless", "time.refine=4",
            "contact.law=newton", "contact.restitution=0")  # fmt: skip
    model = [word for key in keys for word in ("--set", key)]
    status, output = invoke("default", *few, *model, "--quiet", "-o", tmp_path / "o")
    assert status == 0, output
    content = json.loads((tmp_path / "o" / "orbit.json").read_text("utf-8"))
    assert content["model"] == "2 modes of each part, r = 4"
    assert content["coarse"]["kick"] <= 0.03

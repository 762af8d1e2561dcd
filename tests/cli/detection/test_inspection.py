"""The commands `delam-fem excite`, `pod` and `infer`."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from delam_fem.cli.app import app

FAST = ("--set", "mesh.elements=20", "-j", "1", "-q")


def invoke(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.output


def test_excite(tmp_path: Path) -> None:
    grid = ("--from", "80", "--to", "110", "-n", "2")
    status, output = invoke("excite", "embedded", *FAST, *grid, "-o", tmp_path)
    assert status == 0, output
    numbers = json.loads((tmp_path / "excitation.json").read_text("utf-8"))
    assert numbers["frequency"] == [80.0, 110.0]
    assert numbers["recommended_frequency"] in (80.0, 110.0)
    assert (tmp_path / "figures" / "excitation.png").is_file()
    assert "<img" in (tmp_path / "report.html").read_text("utf-8")
    status, output = invoke("excite", "embedded", *FAST, *grid, "-o", tmp_path)
    assert status == 2
    status, output = invoke("excite", "embedded", *FAST, *grid, "-o", tmp_path, "--resume")
    assert status == 0, output


@pytest.mark.nightly
def test_pod(tmp_path: Path) -> None:
    options = ("--frequencies", "365", "--supports", "clamped", "--noise-db", "40")
    status, output = invoke("pod", "embedded", "--frequencies", "high", "-o", tmp_path)
    assert status == 2
    assert "numbers with commas" in output
    status, output = invoke("pod", "embedded", *options, "-j", "1", "-q", "-o", tmp_path)
    assert status == 0, output
    line = json.loads((tmp_path / "pod.json").read_text("utf-8"))["lines"][0]
    assert line["specimens"] == 120
    assert line["hits"] > 90
    assert line["a90"] < line["a90_95"] < 0.25 * 0.4
    assert line["false_calls"] <= 10
    assert line["median_end_error"] <= 0.03 * 0.4


@pytest.mark.nightly
def test_infer(tmp_path: Path) -> None:
    status, output = invoke("infer", "embedded", "-n", "200", "-j", "1", "-q", "-o", tmp_path)
    assert status == 0, output
    found = json.loads((tmp_path / "inference.json").read_text("utf-8"))
    for truth, (low, high) in zip(found["truth"], found["interval_90"], strict=True):
        assert low < truth < high
    assert (tmp_path / "figures" / "posterior.png").is_file()

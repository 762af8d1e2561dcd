"""The commands `delam-fem detect excite`, `pod` and `infer`."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from delam_fem.cli.app import app

COARSE = ("--set", "mesh.elements=20", "--set", "time.steps_per_period=100")
FAST = (*COARSE, "-j", "1", "-q")


def invoke(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.output


def test_excite(tmp_path: Path) -> None:
    grid = ("--from", "80", "--to", "110", "-n", "2")
    status, output = invoke("detect", "excite", "embedded", *FAST, *grid, "-o", tmp_path)
    assert status == 0, output
    numbers = json.loads((tmp_path / "excitation.json").read_text("utf-8"))
    assert numbers["frequency"] == [80.0, 110.0]
    assert numbers["recommended_frequency"] in (80.0, 110.0)
    assert (tmp_path / "figures" / "excitation.png").is_file()
    assert "<img" in (tmp_path / "report.html").read_text("utf-8")
    status, output = invoke("detect", "excite", "embedded", *FAST, *grid, "-o", tmp_path)
    assert status == 2
    status, output = invoke(
        "detect", "excite", "embedded", *FAST, *grid, "-o", tmp_path, "--resume"
    )
    assert status == 0, output


@pytest.mark.nightly
def test_pod(tmp_path: Path) -> None:
    options = ("--frequencies", "365", "--supports", "clamped", "--noise-db", "40")
    status, output = invoke("detect", "pod", "embedded", "--frequencies", "high", "-o", tmp_path)
    assert status == 2
    assert "with commas between them" in " ".join(output.replace("│", " ").split())
    status, output = invoke("detect", "pod", "embedded", *options, "-j", "1", "-q", "-o", tmp_path)
    assert status == 0, output
    line = json.loads((tmp_path / "pod.json").read_text("utf-8"))["lines"][0]
    assert line["specimens"] == 120
    assert line["hits"] > 90
    assert line["a90"] < line["a90_95"] < 0.25 * 0.4
    assert line["false_calls"] <= 10
    assert line["median_end_error"] <= 0.03 * 0.4


@pytest.mark.nightly
def test_infer(tmp_path: Path) -> None:
    status, output = invoke(
        "detect", "infer", "embedded", "-n", "200", "-j", "1", "-q", "-o", tmp_path
    )
    assert status == 0, output
    inference = json.loads((tmp_path / "inference.json").read_text("utf-8"))
    for truth, (low, high) in zip(inference["truth"], inference["interval_90"], strict=True):
        assert low < truth < high
    assert (tmp_path / "figures" / "posterior.png").is_file()


@pytest.mark.slow
def test_infer_takes_a_measured_scan(tmp_path: Path) -> None:
    import numpy as np

    from delam_fem.api import preset
    from delam_fem.studies.detection.detect import simulated
    from delam_fem.studies.detection.study import Scan

    keys = {"mesh.elements": 20, "excitation.frequency": 250.0, "time.steps_per_period": 100}
    scan = Scan(spacing=0.02, first=0.02)  # neither the first point nor the last is at a clamp
    measurement = simulated(preset("embedded", keys), scan)
    measurement = measurement.noisy(measurement.noise_of(scan), 3)
    header = ",".join(["time [s]", *(f"P{k} [m/s]" for k in range(18))])
    table = np.column_stack([measurement.times, measurement.field[:, :18]])
    np.savetxt(tmp_path / "scan.csv", table, delimiter=",", header=header, comments="")
    places = [
        text
        for k in range(18)
        for text in ("--channel", f"p{k}=P{k}:m/s@{measurement.x[k]:.3f}/upper")
    ]
    options = ("--measured", tmp_path / "scan.csv", "--frequency", "250", "-n", "130")
    command = ("detect", "infer", "embedded", *options, *FAST)
    status, output = invoke(*command, *places, "-o", tmp_path / "a")
    assert status == 0, output
    inference = json.loads((tmp_path / "a" / "inference.json").read_text("utf-8"))
    assert inference["is_measured"] and inference["truth"] is None and inference["mismatch"] is None
    for truth, (low, high) in zip((0.12, 0.28, 0.0006), inference["interval_90"], strict=True):
        assert low < truth < high
    assert np.diff(inference["interval_90"][:2], axis=1).max() < 0.13  # the prior has 0.19 m
    assert [entry["key"] for entry in inference["uncertain"]] == [
        "lamina.*.young_modulus", "lamina.*.damping_ratio", "support.rotational_stiffness",
    ]  # fmt: skip
    status, output = invoke(*command, *places, "--frequency", "92", "-o", tmp_path / "b")
    assert status == 2 and "one file per frequency" in output
    wrong = [text.replace("@0.100/", "@0.107/") for text in places]
    status, output = invoke(*command, *wrong, "-o", tmp_path / "c")
    assert status == 2 and "equidistant" in output

"""The command `delam-fem detect scan`: what it writes, says and refuses."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

from delam_fem.cli.app import app
from delam_fem.engines import session

FAST = ("--set", "mesh.elements=20", "--set", "time.steps_per_period=100")
CUT = 7
"""Blocks of periods after which a run is interrupted."""


def invoke(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.output


@pytest.mark.usefixtures("pictures")
def test_the_command(tmp_path: Path) -> None:
    status, output = invoke("detect", "scan", "embedded", *FAST, "-o", tmp_path)
    assert status == 0, output
    assert "marks 0.12 to 0.28 m" in output
    numbers = json.loads((tmp_path / "detection.json").read_text("utf-8"))
    assert numbers["detected"] and not numbers["intact_called"]
    pictures = sorted(path.name for path in (tmp_path / "figures").iterdir())
    assert pictures == ["detection.png", "indices.png", "shapes.png"]
    page = (tmp_path / "report.html").read_text("utf-8")
    assert page.count("<img") == 3


@pytest.mark.parametrize(
    ("command", "result"),
    [
        (("detect", "scan", "embedded", *FAST), "detection.json"),
        pytest.param(
            ("detect", "modulate", "embedded", *FAST, "--pump-frequency", "60",
             "--pump-amplitude", "0.1", "--set", "excitation.frequency=350", "--periods", "1"),
            "modulation.json",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ("identify", "resonance", "paper", "--set", "mesh.elements=6",
             "--set", "excitation.kind=sweep", "--set", "excitation.start_frequency=2",
             "--set", "excitation.end_frequency=6", "--set", "excitation.duration=60",
             "--set", "time.steps_per_period=50"),
            "resonance.json",
            marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_what_was_interrupted_goes_on_to_the_same_numbers(
    command: tuple[str, ...], result: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[None] = [None] * CUT

    @contextmanager
    def stops() -> Iterator[Callable[[], bool]]:
        yield lambda: asked.append(None) or len(asked) == CUT

    monkeypatch.setattr(session, "stop_signals", stops)
    assert invoke(*command, "-o", tmp_path / "whole")[0] == 0
    n_whole = len(asked) - CUT
    asked.clear()
    status, output = invoke(*command, "-o", tmp_path / "cut")
    assert status == 130, output
    assert list((tmp_path / "cut" / "checkpoints").glob("*.npz"))
    status, output = invoke(*command, "-o", tmp_path / "cut", "--resume")
    assert status == 0, output
    assert len(asked) == n_whole  # no period was computed again
    assert not (tmp_path / "cut" / "checkpoints").exists()
    contents = [(tmp_path / name / result).read_text() for name in ("whole", "cut")]
    assert contents[1] == contents[0]


def test_a_bad_scan_leaves_no_folder_behind(tmp_path: Path) -> None:
    status, output = invoke("detect", "scan", "embedded", "--spacing", "1", "-o", tmp_path / "d")
    assert status == 2
    assert "at least 5 points" in output
    assert not (tmp_path / "d").exists()


@pytest.mark.slow
def test_a_measured_file_is_judged_like_a_simulated_scan(tmp_path: Path) -> None:
    import numpy as np

    from delam_fem.api import preset
    from delam_fem.studies.detection.detect import simulated
    from delam_fem.studies.detection.study import Scan

    case = preset("embedded", {"mesh.elements": 20, "excitation.frequency": 80.0})
    measurement = simulated(case, Scan())
    measurement = measurement.noisy(measurement.noise_of(Scan()), 3)
    points = [k for k in range(41) if k % 2 == 0]  # every 20 mm
    names = [f"P{k}" for k in points]
    table = np.column_stack([measurement.times, measurement.field[:, points]])
    header = ",".join(["time [s]", *(f"{name} [m/s]" for name in names)])
    np.savetxt(tmp_path / "scan.csv", table, delimiter=",", header=header, comments="")
    channels = [
        text
        for k, name in zip(points, names, strict=True)
        for text in ("--channel", f"p{k}={name}:m/s@{measurement.x[k]:.3f}/upper")
    ]
    keys = ("--set", "excitation.frequency=80", "--measured", tmp_path / "scan.csv")
    status, output = invoke(
        "detect", "scan", "embedded", *FAST, *keys, *channels, "-o", tmp_path / "d"
    )
    assert status == 0, output
    numbers = json.loads((tmp_path / "d" / "detection.json").read_text("utf-8"))
    assert numbers["is_measured"] and numbers["detected"] and not numbers["intact_called"]
    assert (numbers["start"], numbers["end"]) == (0.12, 0.28)
    assert numbers["frequency"] == 80.0
    status, output = invoke("detect", "scan", "embedded", *FAST, *keys, "-o", tmp_path / "e")
    assert status == 2, output
    for wrong in ("40", "160", "60"):  # half, twice, another
        keys = ("--set", f"excitation.frequency={wrong}", "--measured", tmp_path / "scan.csv")
        status, output = invoke(
            "detect", "scan", "embedded", *FAST, *keys, *channels, "-o", tmp_path / "f"
        )
        assert status == 2 and f"a record of {wrong} Hz" in output and "one of 79.999" in output
        assert not (tmp_path / "f").exists()

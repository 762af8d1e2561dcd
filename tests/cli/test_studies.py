"""What all commands of studies have in common: help, checks, folder, words, exit status."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import matplotlib
import pytest
from matplotlib.figure import Figure
from support import invoke

import delam_fem as df
from delam_fem.api import Finding, Report, RunContext, Table
from delam_fem.plugins.discovery import studies
from delam_fem.studies.detection import excitation
from delam_fem.studies.detection.study import Detect, Excite, Infer, Modulate, Pod, Scan
from delam_fem.system.docstrings import meanings, summary

pytestmark = pytest.mark.usefixtures("elsewhere")
MID_PLANE = ("--set", "lamina.1.thickness=0.001", "--set", "lamina.2.thickness=0.001")


class Found(Finding):
    """Something that a study has found."""

    left = ""
    grid: bool | None = None

    @property
    def report(self) -> Report:
        """Return all that a report can have."""

        def draw() -> Figure:
            Found.grid = matplotlib.rcParams["axes.grid"]
            return Figure(figsize=(1, 1))

        return Report(
            name="found", numbers={"value": float("nan")}, case=df.preset("embedded"),
            title="A title", tables=[Table("A table", ("a [m]",), [("1",)])],
            sentences=["A sentence."], remarks=["a remark"], left=self.left,
            pictures={"figures/one": (draw, "A caption")},
        )  # fmt: skip


@pytest.fixture
def places(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, RunContext]]:
    """Put a study in place of `excite` that computes nothing, and return what it is given."""
    calls: list[tuple[Any, RunContext]] = []

    def compute(case: df.Case, options: Excite, place: RunContext) -> Found:
        calls.append((options, place))
        return Found()

    monkeypatch.setattr(excitation, "compute", compute)
    return calls


def test_a_command_gives_its_options_and_writes_and_says_what_was_found(
    places: list[tuple[Any, RunContext]],
) -> None:
    done = invoke("detect", "excite", "embedded", "--from", "50", "-n", "3", "-j", "2", "-o", "out")
    assert done.exit_code == 0, done.output
    ((options, place),) = places
    assert options == Excite(lowest=50.0, number=3)
    assert (place.folder, place.workers, place.resume) == (Path("out"), 2, False)
    written = {path.relative_to("out").as_posix() for path in Path("out").rglob("*.*")}
    assert written == {
        ".delam_fem.txt",
        "case.toml",
        "found.json",
        "figures/one.png",
        "report.html",
    }
    assert json.loads(Path("out/found.json").read_text("utf-8")) == {"value": None}
    assert Found.grid, "pictures have the style of the house"
    page = Path("out/report.html").read_text("utf-8")
    for text in ("A title", "A table", "A sentence. a remark", "A caption", "a [m]"):
        assert text in page
    for text in ("A sentence.", "a [m]", "out/found.json"):
        assert text in done.stdout
    assert "warning: a remark" in done.stderr
    again = invoke("detect", "excite", "embedded", "-o", "out")
    assert again.exit_code == 2 and "is not empty" in " ".join(again.stderr.split())
    for option in ("--resume", "--overwrite"):
        assert invoke("detect", "excite", "embedded", "-o", "out", option, "-q").stdout == ""
    assert (
        invoke("detect", "excite", "embedded").exit_code == 0
        and Path("runs/embedded-excite").is_dir()
    )


def test_a_study_without_checkpoints_leaves_those_of_others() -> None:
    Path("out/checkpoints").mkdir(parents=True)
    Path("out/checkpoints/of_another.npz").write_text("", encoding="utf-8")
    done = invoke("modes", "paper", "--set", "mesh.elements=3", "-n", "1", "-o", "out", "-q")
    assert (done.exit_code, done.stdout) == (0, "")
    assert Path("out/checkpoints/of_another.npz").is_file() and Path("out/modes.json").is_file()


def test_what_is_left_is_told(
    places: list[tuple[Any, RunContext]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Found, "left", "after 3 points")
    cut = invoke("detect", "excite", "embedded", "-o", "out")
    assert (cut.exit_code, Path("out/found.json").is_file()) == (130, True)
    assert "interrupted after 3 points; --resume goes on" in cut.stderr


def test_every_study_says_that_no_delamination_opens(places: list[tuple[Any, RunContext]]) -> None:
    told = invoke("detect", "excite", "embedded", *MID_PLANE, "-o", "out")
    assert "warning: no delamination ever opens" in told.stderr
    assert "ever opens" not in invoke("detect", "excite", "embedded", "-o", "other").stderr


@pytest.mark.parametrize("name", studies())
def test_help_is_the_docstring_of_the_options_with_units(name: str) -> None:
    text = " ".join(re.sub("[│╭╮╰╯─]", " ", invoke(*name.split(), "--help").stdout).split())
    options = studies()[name].options
    assert summary(options) in text
    for meaning in meanings(options).values():
        words = meaning[1:].split("[")
        assert all(f"[{word[:4]}" in text for word in words[1:]), meaning


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Detect(index="V9"), "index: .*given 'V9'"),
        (lambda: Detect(periods=3), "periods: "),
        (lambda: Scan(averages=1.5), "averages: .*given 1.5"),
        (lambda: Scan(spacing="far"), "spacing: .*given 'far'"),
        (lambda: Modulate(pump_frequency=60, pump_amplitude=float("nan")), "at least 0, given nan"),
        (lambda: Pod(frequencies="92,high"), "frequencies: .*given 'high'"),
        (lambda: Infer(number=10), "number: .* at least 100, given 10"),
    ],
)
def test_options_are_checked_when_they_are_made(make: Any, told: str) -> None:
    with pytest.raises(df.CaseError, match=told):
        make()


def test_python_takes_numbers_as_well_as_texts() -> None:
    assert Pod(frequencies="92, 250") == Pod(frequencies=[92, 250.0])
    assert Infer(measured=["a.csv"]).inputs == [Path("a.csv")]
    for study in (df.detect, df.excite, df.pod, df.infer, df.modulate, df.resonance, df.identify):
        with pytest.raises(df.CaseError, match="spacings"):
            study("embedded", spacings=1.0)

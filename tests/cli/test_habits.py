"""Habits of the command: new cases, checks before work, dry runs, logs, messages told once."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console
from support import SMALL, SWEEP, invoke

from delam_fem import Sweep
from delam_fem.api import CaseError, load_case, preset
from delam_fem.cli import console as messages
from delam_fem.cli.console import progress
from delam_fem.studies.diagrams import require_drawable
from delam_fem.studies.sweeps.grid import sweep_of

pytestmark = pytest.mark.usefixtures("elsewhere")
AXIS: dict[str, object] = {"key": "excitation.frequency", "values": [3.0, 3.5]}


def test_a_new_case_is_valid_and_never_replaced() -> None:
    assert invoke("new", "mine", "--kind", "layered").exit_code == 0
    assert load_case("mine.toml") == preset("embedded", {"name": "mine"})
    before = Path("mine.toml").read_bytes()
    again = invoke("new", "mine")
    assert (again.exit_code, Path("mine.toml").read_bytes()) == (2, before)
    assert "new mine.toml: exists" in again.stderr
    assert "expected a name fit for a folder" in invoke("new", "a?").stderr
    assert "expected an existing folder" in invoke("new", "nowhere/a").stderr


def test_several_cases_are_checked_and_each_problem_is_told() -> None:
    Path("s.toml").write_text(SWEEP, encoding="utf-8")
    good = invoke("check", "paper", "s.toml")
    assert good.exit_code == 0, good.stderr
    assert "685 × 40 × 2 mm" in good.stdout and "newton-penalty@newmark" in good.stdout
    assert "2 values, 3.0 … 3.5 Hz" in good.stdout and "about" in good.stdout
    bad = invoke("check", "nothing.toml", "paper", "--set", "contact.restitution=2")
    assert bad.exit_code == 2
    assert "nothing.toml: no such file" in bad.stderr
    assert "contact.restitution: expected a number from 0 to 1, given 2" in bad.stderr


def test_a_dry_run_tells_and_writes_nothing() -> None:
    Path("s.toml").write_text(SWEEP, encoding="utf-8")
    for command in (
        ("run", "paper", *SMALL),
        ("sweep", "s.toml"),
        ("converge", "paper", "--steps", "100,200"),
    ):
        told = invoke(*command, "-o", "out", "--dry-run")
        assert told.exit_code == 0, told.stderr
        assert "of memory" in told.stdout
        assert not Path("out").exists()
    absurd = invoke("run", "paper", "--set", "time.periods=1000000000", "--dry-run")
    assert (absurd.exit_code, "must be confirmed by --yes" in absurd.stderr) == (2, True)
    checked = invoke("check", "paper", "--set", "time.periods=1000000000")
    assert (checked.exit_code, "must be confirmed by --yes" in checked.stderr) == (2, True)
    steps = ("--steps", "90000000", "--limit-steps", "0")
    assert "must be confirmed by --yes" in invoke("converge", "paper", *steps).stderr


def test_a_diagram_that_cannot_be_drawn_is_refused_before_the_sweep() -> None:
    Path("s.toml").write_text(SWEEP, encoding="utf-8")
    refused = invoke("show", "diagram", "plane", "s.toml", "-o", "out")
    assert refused.exit_code == 2
    assert "expected a sweep over 2 axes, given frequency; nothing was" in refused.stderr
    assert not Path("out").exists()


def small_sweep(**keys: object) -> Sweep:
    return sweep_of({"name": "s", "base": "paper", "axis": [AXIS], **keys})


@pytest.mark.parametrize(
    ("kind", "keys", "text"),
    [
        ("lyapunov", {}, "expected record.lyapunov of at least 1 in the sweep file, given 0"),
        ("response", {"record": {"summary": False}}, "record.summary of at least true .* false"),
        ("bifurcation", {"record": {"strobes": 0}}, "record.strobes of at least 1 .* given 0"),
        ("basins", {}, "expected a sweep over 2 axes, given frequency"),
    ],
)
def test_what_a_diagram_needs(kind: str, keys: dict[str, object], text: str) -> None:
    with pytest.raises(CaseError, match=text):
        require_drawable(kind, small_sweep(**keys))  # type: ignore[arg-type]
    require_drawable("response", small_sweep())
    axes = [AXIS, {"key": "gap.tip", "values": [0.01, 0.02]}]
    record = {"strobes": 64}
    require_drawable("plane", small_sweep(axis=axes, record=record))
    with pytest.raises(CaseError, match=r"record\.strobes of at least 64 .* given 40"):
        require_drawable("plane", small_sweep(axis=axes, record={"strobes": 40}))
    with pytest.raises(CaseError, match="a map shows one direction"):
        require_drawable("plane", small_sweep(axis=axes, record=record, order="both"))
    with pytest.raises(CaseError, match="a map shows one direction"):
        require_drawable("lyapunov", small_sweep(axis=axes, record={"lyapunov": 9}, order="both"))


@pytest.mark.slow
def test_numbers_alone_and_their_figures_later() -> None:
    first = invoke("run", "paper", *SMALL, "-o", "a", "-q")
    second = invoke("run", "paper", *SMALL, "-o", "b", "--no-figures", "-q", "--log", "b.log")
    assert (first.exit_code, second.exit_code) == (0, 0), second.stderr
    assert not {"figures", "fields", "report.html"} & set(os.listdir("b"))
    assert invoke("show", "page", "b", "-q").exit_code == 0
    for name in sorted(os.listdir("a/figures")):
        assert Path("a/figures", name).read_bytes() == Path("b/figures", name).read_bytes(), name
    assert sorted(os.listdir("a/fields")) == sorted(os.listdir("b/fields"))
    log = Path("b.log").read_text(encoding="utf-8")
    assert "begin: " in log and "end after" in log and "period 3 of 3" in log


def test_a_log_file_that_cannot_be_written_is_told() -> None:
    refused = invoke("new", "--list", "--log", "nowhere/x.log")
    assert refused.exit_code == 2
    assert "--log nowhere/x.log: cannot be written (No such file" in refused.stderr


def test_a_message_is_shown_once_and_logged_each_time(capsys: pytest.CaptureFixture[str]) -> None:
    log = logging.getLogger("delam_fem.somewhere")
    with messages.shown(logging.DEBUG, Path("x.log")):
        for _ in range(3):
            log.warning("soft springs")
        log.info("note")
        log.debug("detail")
        with progress(Console(stderr=True, quiet=True)) as report:
            report(5, 5)  # a bar shows it
    assert capsys.readouterr().err.splitlines() == ["warning: soft springs", "note", "detail"]
    text = Path("x.log").read_text(encoding="utf-8")
    assert text.count("WARNING soft springs") == 3 and "DEBUG   point 5 of 5" in text


def test_a_warning_is_not_glued_to_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path("screen").open("w+", encoding="utf-8") as screen:
        monkeypatch.setattr(sys, "stderr", screen)
        console = Console(file=screen, force_terminal=True, width=80, color_system=None)
        with progress(console, 1000) as report:
            report(1, 5)
            messages.tell("warning: soft springs")
            report(5, 5)
        screen.seek(0)
        lines = screen.read().replace("\r", "\n").split("\n")
    (line,) = (line for line in lines if "soft springs" in line)
    assert line.endswith("warning: soft springs") and "period" not in line


def test_the_shell_completes_commands() -> None:
    asked = {
        "_DELAM_FEM_COMPLETE": "complete_bash",
        "COMP_WORDS": "delam-fem ch",
        "COMP_CWORD": "1",
    }
    code = "from delam_fem.cli.app import app; app(prog_name='delam-fem')"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, capture_output=True, text=True
    )
    assert done.stdout.split() == ["check"]

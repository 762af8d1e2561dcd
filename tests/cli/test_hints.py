"""What the command says of slips: which command is meant, which key, quotes, commas, units."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from rich.console import Console
from support import SMALL, SWEEP, invoke

import delam_fem as df
from delam_fem.api import CaseError, apply_overrides, preset, save_case
from delam_fem.cli.console import progress
from delam_fem.studies.orbits import search

pytestmark = pytest.mark.usefixtures("elsewhere")


def refused(*arguments: str) -> str:
    result = invoke(*arguments)
    assert result.exit_code == 2, result.output
    assert not list(Path("runs").glob("*")) if Path("runs").exists() else True
    return " ".join(result.stderr.split())


def test_a_file_for_another_command_names_it() -> None:
    Path("s.toml").write_text(SWEEP, encoding="utf-8")
    save_case(preset("paper"), ".")
    assert "case s.toml: is a sweep; compute it with delam-fem sweep s.toml" in refused(
        "run", "s.toml"
    )
    told = "sweep case.toml: is a case; compute it with delam-fem run case.toml"
    assert told in refused("sweep", "case.toml") and told in refused(
        "show", "diagram", "response", "case.toml"
    )


def test_a_typo_in_the_key_of_an_axis_is_named_before_its_value() -> None:
    text = SWEEP.replace("frequency", "frequncy").replace(
        "values = [3.0, 3.5]", 'start = "9.5 Hz"\nstop = "12 Hz"\ncount = 3'
    )
    Path("s.toml").write_text(text, encoding="utf-8")
    message = refused("check", "s.toml")
    assert "axis.1.key" in message and "'excitation.frequncy'; did you mean frequency?" in message
    assert "axis.1.start" not in message


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('law = "newton-penalty"', "law = newton", 'a text stands in quotes: law = "newton"'),
        ("tip = 0.012", "tip = 0,012", "a number has a decimal point: tip = 0.012"),
        ("tip = 0.012", 'tip = "2,0 mm"', "gap.tip: "),
    ],
)  # fmt: skip
def test_quotes_and_commas_are_named(old: str, new: str, told: str) -> None:
    text = preset("paper").to_toml()
    assert old in text
    Path("a.toml").write_text(text.replace(old, new), encoding="utf-8")
    assert told in refused("check", "a.toml")
    assert "a text stands" not in refused("check", "nothing.toml")


def test_entries_have_names() -> None:
    changed = preset("embedded", {"delamination.lower-upper.end": 0.25})
    assert changed.delamination[0].end == 0.25
    with pytest.raises(CaseError, match=r"no entry 'upper-lower'; expected one of lower-upper or"):
        preset("embedded", {"delamination.upper-lower.end": 0.25})
    assert preset("embedded", {"delamination.1.end": 0.25}) == changed
    for key in ("lamina.0.length", "delamination.0.end"):
        with pytest.raises(
            CaseError, match=r"no entry '0'; expected one of .* or a number from 1$"
        ):
            preset("embedded", {key: 0.25})
    data: dict[str, object] = {"delamination": 2 * [{"between": ["a", "b"], "end": 0.1}]}
    with pytest.raises(CaseError, match=r"2 entries 'a-b'; give a number from 1"):
        apply_overrides(data, {"delamination.a-b.end": 0.2})
    told = "override point_mass.1.mass: the case has no [[point_mass]]; write one into a case file"
    assert told in refused("run", "paper", "--set", "point_mass.1.mass=0.01")


def test_a_window_is_no_longer_than_the_run() -> None:
    keys = ("--set", "time.periods=5", "--set", "output.window_periods=10")
    told = "output.window_periods: expected at most the 5 periods of the run, given 10"
    assert told in refused("check", "paper", *keys)
    assert invoke("check", "paper", *keys[:2]).exit_code == 0  # the preset has 10


@pytest.mark.slow
def test_units_of_branches_are_read_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "USUAL", replace(search.USUAL, copies=4))  # no impacts scatter here
    bad = refused("orbit", "follow", "paper", "--from", "9.5 mm", "--to", "10")
    assert "--from: expected a frequency" in bad and "'9.5 mm'" in bad
    assert "--to: expected a number, given 'fast'" in refused(
        "orbit", "follow", "paper", "--from", "3", "--to", "fast"
    )
    small = ("--set", "mesh.elements=1", "--set", "time.steps_per_period=50")
    keys = ("--set", "contact.law=none", *small, "--step", "0.5", "--doublings", "0")
    result = invoke(
        "orbit", "follow", "paper", "--from", "2500 mHz", "--to", "2.6 Hz", *keys, "-o", "b"
    )
    assert result.exit_code == 0, result.output
    assert "excitation.frequency = 2.5 Hz" in result.stderr
    with h5py.File("b/branch.nc") as file:
        assert file["parameter"].attrs["units"] in ("Hz", b"Hz")
        assert float(file["parameter"][0]) == 2.5


def test_a_compiled_run_is_extended_by_its_engine() -> None:
    for more in (("--engine", "compiled"), ("--extend", "2")):
        result = invoke("run", "paper", *SMALL, "-o", "r", "--no-figures", *more)
        assert result.exit_code == 0, result.stderr
    summary = json.loads(Path("r/summary.json").read_text(encoding="utf-8"))
    assert (summary["engine"], summary["periods"]) == ("compiled", 5)


def test_the_page_of_a_sweep_is_written_again() -> None:
    Path("s.toml").write_text(SWEEP, encoding="utf-8")
    assert invoke("sweep", "s.toml", "-o", "s", "--executor", "serial").exit_code == 0
    page = next(path for path in Path("s").glob("*.html"))
    before = page.read_bytes()
    page.unlink()
    result = invoke("show", "page", "s")
    assert (result.exit_code, page.read_bytes()) == (0, before)
    assert page.name in result.stdout


def test_laminae_that_are_apart_are_not_searched_for_delaminations() -> None:
    told = "detect: expected a case with [[delamination]], given none"
    assert told in refused("detect", "scan", "default", "-o", "d")


def test_a_quiet_console_writes_nothing_at_all(tmp_path: Path) -> None:
    with (tmp_path / "out").open("w+") as file:
        console = Console(file=file, quiet=True, force_terminal=True)
        with progress(console, 100) as report:
            report(1, 2)
    assert (tmp_path / "out").read_bytes() == b""


@pytest.mark.slow
def test_solids_and_ribbons_lie_at_the_same_height() -> None:
    few = {"mesh.elements": 4, "time.periods": 1, "time.steps_per_period": 60}
    plane = preset("default", few | {"model.kind": "plane-stress"})
    df.run(plane).save("p", figures=False)
    assert invoke("show", "page", "p").exit_code == 0
    heights = []
    for name in ("fields", "solid"):
        with h5py.File(next(Path("p").rglob(f"{name}.vtkhdf"))) as file:
            y = np.asarray(file["VTKHDF/Points"])[:, 1]
            heights.append((y.min(), y.max()))
    assert heights[0] == pytest.approx(heights[1], abs=1e-9)


@pytest.mark.slow
def test_a_quiet_run_on_a_terminal_prints_no_escapes() -> None:
    master, terminal = os.openpty()
    command = [sys.executable, "-m", "delam_fem", "run", "paper", *SMALL, "-q", "--no-figures"]
    subprocess.run(command, stdout=terminal, stderr=terminal, check=True)
    os.close(terminal)
    os.set_blocking(master, False)
    try:
        assert b"\x1b" not in os.read(master, 65536)
    except (BlockingIOError, OSError):  # nothing, and nobody at the other end
        pass
    os.close(master)

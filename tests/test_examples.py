"""The examples of docs/examples run as they stand and give the numbers that they promise."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from project import ROOT

from delam_fem import load_sweep

FOLDER = ROOT / "docs" / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))
SWEEPS = sorted(FOLDER.glob("*.toml"))
LONGEST = 600  # s; with nothing compiled before
SAID = {
    "body": r"^25 impacts, lowest tip -1\.02\d+ mm$",
    "clapping": r"^tip contacts per period: 1\.00$",
    "free_vibration": r"^logarithmic decrement: 0\.050267, exact 0\.050267$",
    "hermite_demo": r"orders: \[3\.99 3\.94 3\.87\]$",
    "modes": r"^order of convergence: (3\.9|4\.0)\d \(thick\), (3\.9|4\.0)\d \(thin\)$",
    "one_impact": r"^\d\d single impacts, the strongest lost \d\.\d+e-05 J$",
    "plate": r"^frequency 3\.824, exact 3\.824; \d+ impacts$",
    "timoshenko": r"^\d+ impacts, lowest tip -12\.2\d mm$",
    "tap": r"^200 mm: 1\.4[45] ms, 6\.5\d N; as a spring of 3\.50e\+05 N/m 1\.38 ms, 5\.69 N$",
    "frets": r"^energy left after 0\.05 s: 3\.03\d\d 3\.02\d\d 3\.02\d\d mJ$",
    "own_law": r"^speeds of approach \[m/s\]: \[1\. +0\.5333\d 0\.3368\d 0\.2306\d\] exact",
    "own_operators": r"^pairs hit: \[0 1 0\] velocities at the end \[m/s\]: \[-0\.25 +-0\.125\]$",
    "two_masses": r"^settled; blows at \[0\.1588\d .* exact 0\.15936 m/s$",
    "sweep": r"^3\.65 Hz: period 2, 0\.50 tip contacts per period$",
}
"""A line that each example prints; a new one must at least print a number."""


ALONE = ("sweep",)
"""Examples that start processes."""
OWN_FORMS = ("body", "plate", "timoshenko")
LONGEST_FORM = 40  # lines: the promise of a short way in


def printed(path: Path, folder: Path, *launcher: str) -> str:
    """Run an example in a folder of its own and return what it prints."""
    searched = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [*launcher, sys.executable, str(path)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(searched), "MPLBACKEND": "Agg"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=LONGEST,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [path for path in SCRIPTS if path.stem not in ALONE], ids=lambda path: path.stem
)
def test_example_runs_and_says_its_numbers(
    path: Path, elsewhere: None, capsys: pytest.CaptureFixture[str]
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        runpy.run_path(str(path), run_name="__main__")
    assert re.search(SAID.get(path.stem, r"\d"), capsys.readouterr().out, re.MULTILINE)


@pytest.mark.slow
def test_a_sweep_in_a_script_runs_and_says_its_numbers(tmp_path: Path) -> None:
    assert re.search(SAID["sweep"], printed(FOLDER / "sweep.py", tmp_path), re.MULTILINE)


@pytest.mark.nightly
def test_a_form_on_two_ranks_moves_as_on_one(tmp_path: Path) -> None:
    """Lowest deflections agree to the six decimals of a millimetre that are printed."""
    two = "mpirun --allow-run-as-root --oversubscribe --mca mpi_yield_when_idle 1 -n 2".split()
    body = FOLDER / "body.py"
    printed_by = [printed(body, tmp_path, *launcher) for launcher in ((), two)]
    assert re.search(SAID["body"], printed_by[0], re.MULTILINE)
    one, shared = (re.findall(r"\d+ impacts, .* mm", text) for text in printed_by)
    assert one == shared and len(one) == 1
    assert {"result.nc", "report.html"} <= {path.name for path in (tmp_path / "body").iterdir()}


@pytest.mark.parametrize("name", OWN_FORMS)
def test_own_forms_take_few_lines(name: str) -> None:
    lines = (FOLDER / f"{name}.py").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= LONGEST_FORM


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_example_explains_itself_and_checks_its_numbers(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.startswith('"""')
    assert re.search(r"^assert ", text, re.MULTILINE)


@pytest.mark.parametrize("path", SWEEPS, ids=lambda path: path.stem)
def test_example_of_a_sweep_is_read(path: Path) -> None:
    assert load_sweep(path).n_points > 1


def test_all_examples_are_listed() -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"\]\((\w+\.(?:py|toml))\)", text))
    assert listed == {path.name for path in [*SCRIPTS, *SWEEPS]}
    assert set(SAID) <= {path.stem for path in SCRIPTS}

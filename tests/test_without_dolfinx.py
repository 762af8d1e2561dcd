"""Beams run where dolfinx, PETSc and MPI are not installed; what needs them says so."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import delam_fem as df

pytestmark = pytest.mark.slow
KEYS = {
    "time.periods": 4, "time.steps_per_period": 200, "mesh.elements": 8,
    "output.window_periods": 2, "output.fields_per_period": 4,
}  # fmt: skip
PROGRAM = f"""
import importlib.util, json, sys
MISSING = {{"dolfinx", "petsc4py", "mpi4py", "ufl", "basix", "ffcx"}}
seen, whole = set(), importlib.util.find_spec

class NotInstalled:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top in MISSING:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=top)

def find_spec(name, package=None):
    return None if name.partition(".")[0] in MISSING else whole(name, package)

importlib.util.find_spec = find_spec
sys.meta_path.insert(0, NotInstalled())
import delam_fem as df
from delam_fem.cli.app import app
from typer.testing import CliRunner

def command(*words):
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, done.output

keys = {KEYS!r}
found = {{}}
for name in ("default", "embedded"):
    result = df.run(df.preset(name, keys))
    found[name] = [result.summary["tip_max"], result.summary["engine"]]
found["modes"] = df.modes(df.preset("default", keys), 2).frequencies.tolist()
found["refinement"] = len(df.converge(
    df.preset("default", keys), "refinement", elements=[2, 4], limit_steps=0, periods=2, workers=1,
    laws=["newton@moreau-jean"]).results)
sweep = df.Sweep(df.preset("default", keys), {{"excitation.frequency": [3.2, 3.3]}})
found["sweep"] = df.run_sweep(sweep, "sweep", "serial").outcome.values.tolist()
flags = [f"--set={{key}}={{value}}" for key, value in keys.items()]
found["run"] = command("run", "default", "-o", "run", "-q", *flags)
found["orbit"] = command("orbit", "find", "default", "-o", "orbit", "-q", *flags)
found["solid"] = command("run", "default", "-o", "solid", "--set", "model.kind=solid")
found["compare"] = command("compare", "default", "-o", "compare")
try:
    pair = df.preset("default", keys)
    from delam_fem.model import discretise
    o = discretise.assemble(pair).operators
    drive = df.HarmonicMotion(3.0, 1e-3)
    df.run(o, law="newton", scheme="newmark", drive=drive, steps_per_period=100, periods=1)
except df.CaseError as error:
    found["petsc"] = str(error)
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    folder = tmp_path_factory.mktemp("without")
    program = folder / "program.py"
    program.write_text(PROGRAM)
    line = [sys.executable, str(program)]
    done = subprocess.run(line, capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "dolfinx is not installed: beams come from closed forms" in done.stderr
    assert "PETSc is not installed: the compiled engine" in done.stderr
    assert (folder / "run" / "report.html").is_file()
    assert not (folder / "solid").exists()
    return dict(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.parametrize("name", ["default", "embedded"])
def test_runs_give_the_same_numbers(name: str, found: dict[str, object]) -> None:
    tips, engine = found[name]  # type: ignore[misc]
    assert engine == "compiled"
    expected = df.run(df.preset(name, KEYS), "compiled").summary["tip_max"]  # by weak forms
    assert tips == pytest.approx(expected, rel=1e-6)


def test_modes_are_those_of_the_weak_forms(found: dict[str, object]) -> None:
    expected = df.modes(df.preset("default", KEYS), 2).frequencies
    assert found["modes"] == pytest.approx(expected, rel=1e-9)


def test_studies_and_commands_work(found: dict[str, object]) -> None:
    assert found["sweep"] == ["completed", "completed"]
    assert found["refinement"] == 4
    assert (found["run"][0], found["orbit"][0]) == (0, 0)  # type: ignore[index]


def test_what_needs_dolfinx_says_how_to_get_it(found: dict[str, object]) -> None:
    for name, missing in (("solid", "dolfinx"), ("compare", "petsc4py")):
        status, text = found[name]  # type: ignore[misc]
        assert status == 2
        text = " ".join(str(text).split())
        assert f"{missing} is not installed" in text
        assert "apt-get install python3-dolfinx" in text
    assert found["petsc"] == 'engine: expected "compiled", as petsc4py is not installed'

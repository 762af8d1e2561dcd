"""Wheel and sdist: complete, and installable where there is nothing but the distribution."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from test_without_dolfinx import PROGRAM

ROOT = Path(__file__).parents[1]
CONSTRAINTS = ROOT / ".venv" / "constraints.txt"

pytestmark = pytest.mark.once


def call(*arguments: object, folder: Path) -> str:
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL"))}
    done = subprocess.run(
        [str(a) for a in arguments], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Build both from what git has."""
    folder = tmp_path_factory.mktemp("build")
    source, out = folder / "source", folder / "out"
    for name in ("pyproject.toml", "README.md", "LICENSE", "delam_fem"):
        target = source / name
        target.parent.mkdir(parents=True, exist_ok=True)
        call("cp", "-r", ROOT / name, target, folder=folder)
    call(sys.executable, "-m", "build", "--outdir", out, source, folder=folder)
    (wheel,), (sdist,) = out.glob("*.whl"), out.glob("*.tar.gz")
    return {"wheel": wheel, "sdist": sdist}


@pytest.mark.slow
def test_both_hold_the_whole_package_and_nothing_else(built: dict[str, Path]) -> None:
    wanted = {
        path.relative_to(ROOT).as_posix()
        for pattern in ("*.py", "py.typed", "*.toml", "*.css", "*.js")
        for path in (ROOT / "delam_fem").rglob(pattern)
    }
    assert {"delam_fem/py.typed", "delam_fem/results/pages/film.js"} <= wanted
    with zipfile.ZipFile(built["wheel"]) as wheel:
        names = set(wheel.namelist())
    assert {name for name in names if ".dist-info/" not in name} == wanted
    assert any(name.endswith("licenses/LICENSE") for name in names)
    with tarfile.open(built["sdist"]) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    assert wanted | {"LICENSE", "README.md", "pyproject.toml"} <= names


@pytest.mark.parametrize("dependencies", ["of this environment", "declared", "without dolfinx"])
@pytest.mark.nightly
def test_both_install_in_a_clean_environment(
    dependencies: str, built: dict[str, Path], tmp_path: Path
) -> None:
    base = Path(sys.base_prefix) / "bin" / "python3"
    distribution = [] if dependencies == "without dolfinx" else ["--system-site-packages"]
    call(base, "-m", "venv", *distribution, tmp_path / "venv", folder=tmp_path)
    python = tmp_path / "venv" / "bin" / "python"
    install = [python, "-m", "pip", "install", "--no-input", "--quiet", "--no-compile"]
    constraints = ["-c", CONSTRAINTS] if CONSTRAINTS.exists() else []
    if dependencies != "of this environment":
        call(*install, *constraints, built["wheel"], folder=tmp_path)
    else:  # after the environment's own packages come those of this one, without this project
        (site,) = (tmp_path / "venv" / "lib").glob("python*/site-packages")
        here = [path for path in sys.path if Path(path).name in ("site-packages", "dist-packages")]
        (site / "others.pth").write_text("\n".join(here))
    again = ["--no-deps", "--force-reinstall"]
    for archive in (built["wheel"], built["sdist"]):
        call(*install, *again, archive, folder=tmp_path)
        place = call(python, "-c", "import delam_fem; print(delam_fem.__file__)", folder=tmp_path)
        assert Path(place.strip()).is_relative_to(tmp_path)
        command = tmp_path / "venv" / "bin" / "delam-fem"
        assert call(command, "new", "--list", folder=tmp_path).split()[:1] == ["paper"]
    run = ["run", "paper", "--set", "time.periods=1", "--set", "output.window_periods=1"]
    call(command, *run, "-o", "run", folder=tmp_path)
    assert (tmp_path / "run" / "report.html").is_file()
    has_dolfinx = "import importlib.util as i; print(i.find_spec('dolfinx') is not None)"
    assert call(python, "-c", has_dolfinx, folder=tmp_path).strip() == str(bool(distribution))
    if not distribution:  # runs, studies, commands and refusals
        (tmp_path / "covering").mkdir()
        content = json.loads(
            call(python, "-c", PROGRAM, folder=tmp_path / "covering").splitlines()[-1]
        )
        assert content["sweep"] == ["completed", "completed"] and content["run"][0] == 0
        assert content["solid"][0] == content["compare"][0] == 2

"""The scripts of the shell: what they promise without installing anything."""

import os
import re
import subprocess
import sys
import tomllib
from functools import partial
from importlib import metadata
from pathlib import Path

import project
import pytest

import delam_fem

ROOT = Path(__file__).parents[1]
SETUP = ROOT / "scripts" / "setup.sh"
STAMP = ROOT / ".venv" / "delam_fem-setup-test.sha256"
CI = ROOT / ".ci" / "run"
COMMANDS = [*sorted(ROOT.glob("scripts/*.sh")), CI]
SOURCED = "clean_environment.sh"
READ_BY_SETUP = (SOURCED, "setup.sh", "constraints-bookworm.txt")
NOT_TO_STAY = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "CONDA_PREFIX", "CC")

needs_setup = pytest.mark.skipif(
    not STAMP.exists(), reason="this environment was not made by scripts/setup.sh test"
)


shell = partial(project.shell, SETUP)


@pytest.fixture
def misleading(tmp_path: Path) -> dict[str, str]:
    """Return an environment in which another Python would be found everywhere."""
    for name in ("python3", "python", "pip", "gcc", "pkg-config"):
        program = tmp_path / name
        program.write_text("#!/bin/sh\nexit 99\n")
        program.chmod(0o755)
    (tmp_path / "numpy.py").write_text("raise SystemExit('the wrong numpy')\n")
    return {
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "PYTHONPATH": str(tmp_path),
        "PYTHONHOME": str(tmp_path),
        "VIRTUAL_ENV": str(tmp_path),
        "CONDA_PREFIX": str(tmp_path),
        "CC": str(tmp_path / "gcc"),
        "PIP_USER": "1",
    }


@pytest.mark.parametrize("path", COMMANDS, ids=lambda path: path.name)
def test_script_is_sound_bash(path: Path) -> None:
    subprocess.run(["bash", "-n", path], check=True)
    if path.name != SOURCED:
        assert os.access(path, os.X_OK)
        assert "set -euo pipefail" in path.read_text(encoding="utf-8")


@needs_setup
@pytest.mark.parametrize("extra", [[], ["test"]])
def test_a_second_setup_has_nothing_to_do_anywhere_and_is_not_misled(
    extra: list[str], misleading: dict[str, str], tmp_path: Path
) -> None:
    current = shell('EXTRA=test; is_done "$(debian_codename /etc/os-release)"').returncode == 0
    assert current, "what the set-up depends on has changed: run scripts/setup.sh test"
    done = subprocess.run(
        [SETUP, *extra],
        cwd=tmp_path,
        env={**os.environ, **misleading},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    assert "nothing to do" in done.stdout


@pytest.mark.parametrize("file", ["pyproject.toml", *(f"scripts/{f}" for f in READ_BY_SETUP)])
def test_setup_is_done_again_when_what_it_reads_changes(tmp_path: Path, file: str) -> None:
    (tmp_path / "scripts").mkdir()
    for name in ("pyproject.toml", *(f"scripts/{f}" for f in READ_BY_SETUP)):
        (tmp_path / name).touch()
    before, same, after = shell(
        f"ROOT='{tmp_path}'; fingerprint bookworm; fingerprint bookworm;"
        f"echo more >>'{tmp_path}/{file}'; fingerprint bookworm"
    ).stdout.splitlines()
    assert before == same != after


@needs_setup
def test_environment_is_recognised_and_a_foreign_one_is_not(tmp_path: Path) -> None:
    assert shell("venv_is_usable").returncode == 0
    assert shell("PYTHON=/bin/false; venv_is_usable").returncode != 0
    (tmp_path / "pyvenv.cfg").write_text("include-system-site-packages = false\n")
    assert shell(f"VENV='{tmp_path}'; venv_is_usable").returncode != 0


@needs_setup
def test_packages_of_the_user_do_not_come_before_the_distribution(tmp_path: Path) -> None:
    python = ROOT / ".venv" / "bin" / "python"
    place = "import site; print(site.getusersitepackages())"
    environment = {**os.environ, "PYTHONUSERBASE": str(tmp_path)}
    user_site = subprocess.check_output([python, "-c", place], env=environment, text=True).strip()
    Path(user_site).mkdir(parents=True)
    Path(user_site, "numpy.py").write_text("raise SystemExit('the wrong numpy')\n")
    subprocess.run([python, "-c", "import numpy.linalg"], env=environment, check=True)


def test_clean_environment_leaves_nothing_that_misleads(misleading: dict[str, str]) -> None:
    lines = 'source "$ROOT/scripts/clean_environment.sh"; command -v python3 gcc; env'
    done = shell(lines, **misleading)
    left = done.stdout.splitlines()
    assert left[0] in {"/usr/bin/python3", "/bin/python3", "/usr/local/bin/python3"}
    assert not [line for line in left[1:] if line.startswith(tuple(f"{k}=" for k in NOT_TO_STAY))]


@pytest.mark.parametrize(
    ("release", "codename"),
    [
        ("ID=debian\nVERSION_CODENAME=bookworm\n", "bookworm"),
        ("ID=debian\nVERSION_CODENAME=trixie\n", "trixie"),
        ("ID=debian\n", "sid"),
    ],
)
def test_debian_release_is_recognised(tmp_path: Path, release: str, codename: str) -> None:
    (tmp_path / "os-release").write_text(release)
    assert shell(f"debian_codename '{tmp_path}/os-release'").stdout.strip() == codename


@pytest.mark.parametrize("release", ["ID=fedora\nVERSION_CODENAME=x\n", None])
def test_other_systems_are_told_of_conda_and_docker(tmp_path: Path, release: str | None) -> None:
    if release is not None:
        (tmp_path / "os-release").write_text(release)
    done = shell(f"debian_codename '{tmp_path}/os-release'; echo went on")
    assert done.returncode == 1
    assert "expected Debian" in done.stderr and "went on" not in done.stdout
    assert "conda create" in done.stderr and "docker run" in done.stderr


def test_without_root_and_sudo_the_administrator_is_told_what_to_run() -> None:
    fakes = (
        "id() { echo 1000; }; sudo() { return 1; }; missing_packages() { echo python3-dolfinx; }"
    )
    done = shell(f"{fakes}; install_packages; echo went on")
    assert done.returncode == 1
    assert "went on" not in done.stdout
    assert "apt-get install -y --no-install-recommends python3-dolfinx" in done.stderr


def test_only_missing_packages_are_installed_and_lists_fetched_only_when_old() -> None:
    fakes = """
        PACKAGES=(there absent)
        dpkg-query() { [[ ${!#} == there ]] && echo installed; }
        as_root() { echo "ran: $*"; }
        lists_are_fresh() { [[ $fresh == yes ]]; }
    """
    runs = [
        line
        for fresh in ("yes", "no")
        for line in shell(f"fresh={fresh}{fakes}\ninstall_packages").stdout.splitlines()
        if line.startswith("ran: ")
    ]
    verbs = [("install" if " install " in line else "update") for line in runs]
    assert verbs == ["install", "update", "install"]
    assert all(line.endswith(" absent") for line in runs if " install " in line)
    assert all("DEBIAN_FRONTEND=noninteractive" in line for line in runs)


@pytest.mark.parametrize(
    ("version", "numpy"),
    [("1:1.24.2-1+deb12u1", "1.24.2"), ("1:2.2.4+ds-1", "2.2.4"), ("2.4.6-1", "2.4.6")],
)
def test_numpy_of_the_distribution_is_held(version: str, numpy: str) -> None:
    fake = f"dpkg-query() {{ printf '{version}'; }}"
    assert shell(f"{fake}; distribution_numpy").stdout.strip() == numpy
    assert shell(f"{fake}; constraints no-such-release").stdout == f"numpy=={numpy}\n"


def test_constraints_of_bookworm_pin_every_direct_dependency() -> None:
    lines = shell("constraints bookworm").stdout.splitlines()
    pinned = {line.split("==")[0] for line in lines if not line.startswith("#")}
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    extras = project["optional-dependencies"]
    asked = [*project["dependencies"], *extras["test"], *extras["docs"]]
    names = {entry.split(">")[0].split("[")[0] for entry in asked} - {project["name"]}
    assert names - pinned == {"meshio"}, "meshio comes from the distribution"


def test_another_setup_of_the_same_folder_is_waited_for(tmp_path: Path) -> None:
    # The first holds the folder's lock until the second waits for it.
    (tmp_path / "scripts").mkdir()
    for file in ("pyproject.toml", *(f"scripts/{name}" for name in READ_BY_SETUP)):
        (tmp_path / file).touch()
    fakes = f"""
        ROOT='{tmp_path}'; VENV='{tmp_path}'
        debian_codename() {{ echo bookworm; }}
        is_done() {{ [[ -e $(stamp) ]]; }}
        said() {{ until grep -q "$1" '{tmp_path}/log' 2>/dev/null; do sleep 0.01; done; }}
        install_packages() {{ echo began | tee -a '{tmp_path}/log'; said waiting; }}
        say() {{ echo "$*" | tee -a '{tmp_path}/log'; }}
        make_venv() {{ :; }}; install_python_packages() {{ :; }}; verify() {{ :; }}
    """
    done = shell(f"{fakes}\nmain & said began; main; wait")
    assert done.stdout.count("began") == 1, done.stdout
    assert "waiting for another" in done.stdout and "done by the other" in done.stdout


def test_setup_for_tests_adds_to_the_setup_for_running(tmp_path: Path) -> None:
    """Each has a stamp; the larger one writes both, and asks pip for the extra."""
    (tmp_path / "scripts").mkdir()
    (tmp_path / "bin").mkdir()
    for file in ("pyproject.toml", *(f"scripts/{name}" for name in READ_BY_SETUP)):
        (tmp_path / file).touch()
    for name in ("python", "delam-fem"):
        (tmp_path / "bin" / name).write_text('#!/bin/sh\necho "ran: $*"\n')
        (tmp_path / "bin" / name).chmod(0o755)
    fakes = f"""
        ROOT='{tmp_path}'; VENV='{tmp_path}'
        debian_codename() {{ echo bookworm; }}
        install_packages() {{ :; }}; make_venv() {{ :; }}; verify() {{ :; }}
    """
    runs = [shell(f"{fakes}\nmain {extra}") for extra in ("", "", "test", "test", "", "other")]
    asked = [r.stdout.split() for r in runs]
    requirement = f"{tmp_path}[test]"
    assert [str(tmp_path) in a for a in asked] == [True, False, False, False, False, False]
    assert [requirement in a for a in asked] == [False, False, True, False, False, False]
    assert [r.returncode for r in runs] == [0, 0, 0, 0, 0, 1]
    assert 'expected no argument or "test", given "other"' in runs[-1].stderr
    (tmp_path / "pyproject.toml").write_text("changed")
    assert "ran: " in shell(f"{fakes}\nmain test").stdout
    assert "nothing to do" in shell(f"{fakes}\nmain").stdout


@pytest.mark.parametrize(
    ("tests", "nightly", "versions", "expected"),
    [(0, 0, 0, 0), (0, 0, 77, 0), (0, 0, 1, 0), (1, 0, 0, 1), (0, 1, 0, 1)],
)
def test_ci_passes_what_could_not_be_tested_and_no_failure(
    tmp_path: Path, tests: int, nightly: int, versions: int, expected: int
) -> None:
    fakes = {
        ".ci/run": CI.read_text(encoding="utf-8"),
        "scripts/setup.sh": f"ROOT='{tmp_path}'; say() {{ echo $*; }}; apt_get() {{ false; }}",
        "scripts/test.sh": f"echo tests $*; exit {tests}",
        ".venv/bin/python": f"echo python $*; exit {nightly}",
        "scripts/test_versions.sh": f"echo versions; exit {versions}",
    }
    for name, text in fakes.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(f"#!/bin/bash\n{text}\n")
        path.chmod(0o755)
    done = subprocess.run([tmp_path / ".ci" / "run"], capture_output=True, text=True)
    assert done.returncode == expected, done.stderr
    assert "no python3-siconos here" in done.stdout
    assert "no chromium here" in done.stdout
    assert re.search("^tests .*--cov", done.stdout, re.MULTILINE)
    assert ("-m nightly" in (tmp_path / "runs" / "nightly.log").read_text()) or tests
    assert ("-m nightly" in done.stdout) == (tests == 0)
    assert ("versions\n" in done.stdout) == (tests == nightly == 0)


def test_version_of_the_package_is_the_projects() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        version = tomllib.load(file)["project"]["version"]
    assert delam_fem.__version__ == metadata.version("delam_fem") == version


def test_command_of_the_package_is_the_command_line() -> None:
    command = Path(sys.executable).parent / "delam-fem"
    done = subprocess.run([command, "new", "--list"], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[:1] == ["paper"]

"""What holds on every release: the first impacts, and the script that tests them all."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
import tomllib
from contextlib import suppress
from functools import cache, partial
from pathlib import Path

import numpy as np
import project
import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "scripts" / "test_versions.sh"
RELEASES = sorted(
    path.stem.removeprefix("constraints-") for path in ROOT.glob("scripts/constraints-*.txt")
)
SAME = 1e-9  # m: versions differ by round-off, which 20 impacts raise to no more than 1e-12 m
SAME_RELATIVE = 1e-6  # of velocities and impulses: SAME of the smallest motion between impacts


first_impacts = cache(partial(project.script, "first_impacts"))


@cache
def kept() -> dict[str, np.ndarray]:
    with np.load(first_impacts().KEPT) as file:
        return dict(file)


def distance(frequency: float, computed: dict[str, np.ndarray]) -> float:
    """Return the largest difference of displacements from those kept [m]."""
    return float(np.abs(computed["displacement"] - kept()[f"{frequency:.2f} displacement"]).max())


@pytest.mark.parametrize("frequency", [1.25, 1.60, 3.25, 3.65])
def test_first_impacts_are_those_of_every_version(frequency: float) -> None:
    computed = first_impacts().first_impacts(frequency)
    for name in ("step", "node", "state_step"):
        np.testing.assert_array_equal(computed[name], kept()[f"{frequency:.2f} {name}"])
    assert len(computed["step"]) == 20
    assert distance(frequency, computed) < SAME
    for name in ("velocity_before", "impulse"):
        scale = np.abs(computed[name]).max()
        expected = kept()[f"{frequency:.2f} {name}"]
        np.testing.assert_allclose(computed[name], expected, rtol=0.0, atol=SAME_RELATIVE * scale)


def test_another_model_is_told_apart() -> None:
    # The first impacts, near the clamp, are weak; one percent of the restitution still shows.
    changed = first_impacts().first_impacts(3.25, contact__restitution=0.101)
    assert changed["displacement"].shape == kept()["3.25 displacement"].shape
    assert distance(3.25, changed) > 10 * SAME


def test_kept_impacts_are_small_and_of_all_reference_motions() -> None:
    module = first_impacts()
    assert module.KEPT.stat().st_size < 100_000
    assert {name.split()[0] for name in kept()} == {f"{f:.2f}" for f in module.FREQUENCIES}


# -- scripts/test_versions.sh ------------------------------------------------------------------


shell = partial(project.shell, SCRIPT)


@pytest.mark.parametrize("release", RELEASES)
def test_constraints_pin_every_direct_dependency(release: str) -> None:
    lines = (ROOT / "scripts" / f"constraints-{release}.txt").read_text("utf-8").splitlines()
    pinned = {line.split("==")[0] for line in lines if not line.startswith("#")}
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    extras = project["optional-dependencies"]
    asked = [*project["dependencies"], *extras["test"], *extras["docs"]]
    names = {re.split(r"[\[<>=!~ ]", entry)[0] for entry in asked} - {project["name"]}
    of_the_distribution = {"meshio"} | ({"numpy", "scipy"} if release == "sid" else set())
    assert names - pinned == of_the_distribution


def test_sid_follows_the_numpy_of_the_distribution() -> None:
    setup = ROOT / "scripts" / "setup.sh"
    fake = "dpkg-query() { printf '1:9.8.7+ds-1'; }"
    for release, line in (("sid", "numpy==9.8.7"), ("trixie", "numpy==2.2.4")):
        done = subprocess.run(
            ["bash", "-c", f"source '{setup}'; {fake}; constraints {release}"],
            capture_output=True,
            text=True,
        )
        assert [x for x in done.stdout.splitlines() if x.startswith("numpy")] == [line]


@pytest.mark.parametrize("name", ["PRETTY_NAME='Debian GNU/Linux forky/sid'", ""])
def test_testing_and_unstable_are_sid(tmp_path: Path, name: str) -> None:
    codename = "VERSION_CODENAME=forky\n" if name else ""
    (tmp_path / "os-release").write_text(f"ID=debian\n{codename}{name}\n")
    setup = ROOT / "scripts" / "setup.sh"
    line = f"source '{setup}'; debian_codename '{tmp_path}/os-release'"
    assert subprocess.check_output(["bash", "-c", line], text=True) == "sid\n"


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        ("sources.list", "deb https://a.org/debian/ bookworm main", "https://a.org/debian"),
        ("sources.list", "deb [signed-by=/k] http://a.org/debian x main", "http://a.org/debian"),
        ("sources.list.d/d.sources", "URIs: http://b.org/debian\n", "http://b.org/debian"),
        ("sources.list", "deb http://a.org/debian-security x main", "http://deb.debian.org/debian"),
        ("other", "", "http://deb.debian.org/debian"),
    ],
)
def test_archive_is_that_of_the_machine(
    tmp_path: Path, file: str, text: str, expected: str
) -> None:
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text(text)
    assert shell(f"mirror '{tmp_path}'").stdout.strip() == expected


def test_set_up_is_the_readmes_own() -> None:
    done = shell('readme_setup "$ROOT/README.md"')
    assert (done.returncode, done.stdout) == (0, "scripts/setup.sh\n")


def test_a_readme_without_set_up_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("scripts/setup.sh\n```text\nscripts/setup.sh\n```\n")
    assert shell(f"readme_setup '{tmp_path}/README.md'").returncode != 0


def test_short_tests_exist() -> None:
    names = shell('printf "%s\\n" "${SHORT_TESTS[@]}"').stdout.split()
    assert names
    assert [name for name in names if not (ROOT / name).exists()] == []


def test_unknown_release_is_refused() -> None:
    for options in ([], ["--short"]):
        done = subprocess.run([SCRIPT, *options, "slink"], capture_output=True, text=True)
        assert done.returncode == 2
        assert "constraints-RELEASE.txt, given slink" in done.stderr


def test_what_cannot_be_tested_is_not_passed() -> None:
    done = shell("obstacle() { echo 'no root'; }; id() { echo 0; }; main trixie sid")
    assert done.stdout.splitlines() == [
        "trixie: not tested: no root",
        "sid: not tested: no root",
    ]
    assert done.returncode == 77


@pytest.mark.parametrize(
    ("results", "status"),
    [
        (["passed: all"], 0),
        (["passed: all\nSKIPPED [1] a: b", "not tested: no archive"], 77),
        (["not tested: no archive", "failed: 1 failed"], 1),
        (["failed: 1 failed", "not tested: no archive"], 1),
        (["passed: all", None], 1),
    ],
)
def test_verdicts_make_the_exit_status(
    tmp_path: Path, results: list[str | None], status: int
) -> None:
    names = [f"r{k}" for k in range(len(results))]
    for name, result in zip(names, results, strict=True):
        (tmp_path / name).mkdir()
        (tmp_path / name / "log").write_text(f"log of {name}\n")
        if result is not None:
            (tmp_path / name / "result").write_text(result + "\n")
    done = shell(f"ROOT='{tmp_path}/root'; WORK='{tmp_path}'; report {' '.join(names)}")
    assert done.returncode == status
    for name, result in zip(names, results, strict=True):
        expected = result or "failed: ended without a result"
        assert f"{name}: {expected.splitlines()[0]}\n" in done.stdout
        is_kept = (tmp_path / "root" / "runs" / "versions" / f"{name}.log").exists()
        assert is_kept == (not expected.startswith("passed"))
    if "SKIPPED" in str(results[0]):
        assert "r0:   SKIPPED [1] a: b\n" in done.stdout


def test_summary_of_pytest_is_found(tmp_path: Path) -> None:
    (tmp_path / "log").write_text("1 passed the ball\n3 passed, 1 skipped in 2.05s\nbye\n")
    assert shell(f"tests_summary '{tmp_path}/log'").stdout == "3 passed, 1 skipped in 2.05s\n"


def can_mount() -> bool:
    command = ["unshare", "--mount", "--pid", "--fork", "true"]
    try:
        return os.geteuid() == 0 and subprocess.run(command, capture_output=True).returncode == 0
    except FileNotFoundError:
        return False


def commands_with(text: str) -> list[bytes]:
    """Return the command lines that contain a text, of all processes."""
    lines = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has just ended
            lines.append(path.read_bytes())
    return [line for line in lines if text.encode() in line]


@pytest.fixture
def fake_debootstrap(tmp_path: Path) -> dict[str, str]:
    """Return an environment in which debootstrap does what the file `do` says."""
    program = tmp_path / "bin" / "debootstrap"
    program.parent.mkdir()
    program.write_text(f"#!/bin/bash\nmkdir -p \"$3/proc\"; . '{tmp_path}/do'\n")
    program.chmod(0o755)
    (tmp_path / "trees").mkdir()
    return {
        **os.environ,
        "PATH": f"{program.parent}:{os.environ['PATH']}",
        "TMPDIR": str(tmp_path / "trees"),
    }


@pytest.mark.once
@pytest.mark.skipif(not can_mount(), reason="only root may mount")
def test_archive_that_cannot_be_reached_is_not_tested(
    tmp_path: Path, fake_debootstrap: dict[str, str]
) -> None:
    (tmp_path / "do").write_text("echo 'E: Failed getting release file' >&2; exit 1\n")
    done = subprocess.run([SCRIPT, "trixie"], env=fake_debootstrap, capture_output=True, text=True)
    assert done.returncode == 77, done.stdout + done.stderr
    assert "\ntrixie: not tested: no tree from http" in done.stdout
    assert "E: Failed getting release file" in done.stdout
    assert list((tmp_path / "trees").iterdir()) == []


@pytest.mark.once
@pytest.mark.skipif(not can_mount(), reason="only root may mount")
@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_script_leaves_nothing(
    tmp_path: Path, fake_debootstrap: dict[str, str], signal_number: signal.Signals
) -> None:
    mark = f"{tmp_path}/mark"
    (tmp_path / "do").write_text(
        f"mount -t proc proc \"$3/proc\"; touch '{mark}'; exec -a {tmp_path.name} sleep 600\n"
    )
    command = ["env", "--default-signal", SCRIPT, "trixie"]  # in the background SIGINT is ignored
    process = subprocess.Popen(command, env=fake_debootstrap, stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 30.0
    while not Path(mark).exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert Path(mark).exists()
    process.send_signal(signal_number)
    assert process.wait(timeout=300.0) == 128 + signal_number
    assert list((tmp_path / "trees").iterdir()) == []
    assert str(tmp_path) not in Path("/proc/mounts").read_text()
    deadline = time.monotonic() + 10.0  # the kernel ends what is in a namespace in its own time
    while (running := commands_with(tmp_path.name)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not running

"""Where a result comes from."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from project import ROOT

from delam_fem.api import schema
from delam_fem.results.schema import blas, git_revision


def test_blas_is_the_library_that_is_loaded() -> None:
    """Debian's alternatives are links; the file behind the link counts."""
    import scipy.linalg  # noqa: F401

    names = blas().split(", ")
    maps = Path("/proc/self/maps").read_text()
    assert names and all(f"/{name}" in maps for name in names)
    assert all("blas" in name or "mkl" in name for name in names)


def test_another_blas_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    maps = tmp_path / "maps"
    maps.write_text(
        "7f00-7f01 r-xp 00000000 08:01 1 /usr/lib/a/blas/libblas.so.3.11.0\n"
        "7f02-7f03 r-xp 00000000 08:01 2 /usr/lib/a/libc.so.6\n"
    )
    monkeypatch.setattr(schema, "_MAPS", maps)
    assert blas() == "blas/libblas.so.3.11.0"
    monkeypatch.setattr(schema, "_MAPS", tmp_path / "none")
    assert blas() == "unknown"


def test_the_revision_is_that_of_the_checkout(tmp_path: Path) -> None:
    def git(*arguments: str) -> str:
        done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True)
        return done.stdout.strip()

    if shutil.which("git") is None or git("rev-parse", "--show-toplevel") != str(ROOT):
        assert git_revision() == "none"
        return
    assert git_revision().removesuffix("-dirty") == git("rev-parse", "HEAD")
    assert git_revision().endswith("-dirty") == bool(
        [line for line in git("status", "--porcelain").splitlines() if not line.startswith("??")]
    )


def test_the_command_is_that_of_the_process(tmp_path: Path) -> None:
    program = tmp_path / "p.py"
    program.write_text(
        "from delam_fem.results.schema import provenance\nprint(provenance()['command'])"
    )
    command = [sys.executable, str(program), "--set", "a b=1"]
    environment = {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=600)
    assert done.stdout.strip() == f"{program} --set 'a b=1'"

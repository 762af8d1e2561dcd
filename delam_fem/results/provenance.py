"""Say where a result comes from: program, libraries, machine and command.

Which numbers are equal bit by bit depends on all of them; see docs/reliability.md.
"""

from __future__ import annotations

import platform
import re
import shlex
import subprocess
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path

import numba
import numpy as np
import scipy

_BLAS = re.compile(r"/(lib(?:open)?blas|libmkl_rt|libblis|libatlas|libflexiblas|libscipy_openblas)")
"""Start of the name of a library with BLAS."""
_MAPS = Path("/proc/self/maps")
_CPU = Path("/proc/cpuinfo")
UNKNOWN = "unknown"
_GIT_SECONDS = 5.0


@cache
def versions() -> dict[str, str]:
    """Return the versions of the program and of the libraries that all results need."""
    return {
        "delam_fem": version("delam_fem"),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": numba.__version__,
    }


@cache
def solvers() -> dict[str, str]:
    """Return the versions of dolfinx and of PETSc's Python; "none" of what is not installed."""
    found = {}
    for name, package in (("dolfinx", "fenics-dolfinx"), ("petsc", "petsc4py")):
        try:
            found[name] = distribution(package).version
        except PackageNotFoundError:
            found[name] = "none"
    return found


def provenance() -> dict[str, str]:
    """Return versions, BLAS, machine, git revision and command line by name."""
    return origin() | occasion()


def origin() -> dict[str, str]:
    """Return versions and git revision: what is the same on all machines of a cluster."""
    return {
        **versions(),
        "python": sys.version.split()[0],
        "git_revision": git_revision(),
    }


def occasion() -> dict[str, str]:
    """Return BLAS, machine and command line of this process."""
    return {
        "blas": blas(),
        "host": platform.node() or UNKNOWN,
        "processor": processor(),
        "command": shlex.join(sys.argv),
    }


def blas() -> str:
    """Return the files of the BLAS libraries that this process has loaded."""
    try:
        lines = _MAPS.read_text("utf-8", "replace").splitlines()
    except OSError:
        return UNKNOWN
    paths = {Path(line.split(maxsplit=5)[5]) for line in lines if _BLAS.search(line)}
    names = sorted({f"{path.parent.name}/{path.name}" for path in paths})
    return ", ".join(names) or UNKNOWN


@cache
def processor() -> str:
    """Return the model of the processor."""
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", _CPU.read_text("utf-8", "replace"), re.M)
    except OSError:
        found = None
    return found[1].strip() if found else platform.processor() or platform.machine() or UNKNOWN


@cache
def git_revision() -> str:
    """Return the revision of the checkout that the package runs from, with "-dirty" if changed.

    "none" if the package is not run from a checkout.
    """
    root = Path(__file__).resolve().parents[2]
    if _git(root, "rev-parse", "--show-toplevel") != str(root):
        return "none"
    return _git(root, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*") or "none"


def _git(root: Path, *arguments: str) -> str:
    """Return what git says; empty if it fails."""
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_GIT_SECONDS,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()

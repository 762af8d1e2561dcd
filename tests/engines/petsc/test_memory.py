"""What a process of the PETSc engine holds: nothing twice, nothing that it has freed."""

from __future__ import annotations

import subprocess
import sys

import scipy.sparse as sp

from delam_fem.api import MPI
from delam_fem.engines.petsc import linear_algebra  # noqa: F401  # it starts PETSc
from delam_fem.model.operators import matrix


def test_a_matrix_of_one_rank_is_in_the_memory_of_its_rows() -> None:
    rows = sp.identity(3, format="csr")
    petsc_matrix = matrix(rows, MPI.COMM_SELF)
    rows.data[0] = 7.0
    assert petsc_matrix.getValue(0, 0) == 7.0


FREEING = """
import resource
from pathlib import Path

import numpy as np

import delam_fem.engines.petsc.linear_algebra  # it starts PETSc

def held():
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

before = held()
large = np.ones(20_000_000)
last = np.ones(10)  # above it in the memory
assert held() > before + large.nbytes // 2
del large
assert held() < before + 8e7, (before, held(), last)
"""


def test_freed_memory_goes_back_to_the_system() -> None:  # SuperLU_DIST forbids it
    """In a process of its own: another one may have a hole of that size, which it keeps."""
    subprocess.run([sys.executable, "-c", FREEING], check=True)

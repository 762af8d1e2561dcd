"""The door to MPI: what it sets before MPI starts, and what it takes away again."""

import json
import os
import subprocess
import sys

import pytest
from project import ROOT

from delam_fem.system.mpi import ALONE

SHOW = """
import os, sys, types
seen = {}
class Recording(types.ModuleType):
    def __getattr__(self, name):
        seen.update(os.environ)
        return object()
sys.modules["mpi4py"] = Recording("mpi4py")
import delam_fem.system.mpi
assert not seen
delam_fem.system.mpi.MPI
import json
names = [name for name in {**seen, **os.environ} if name.startswith(("OMPI_MCA", "PETSC_OPT"))]
print(json.dumps([{n: e[n] for n in names if n in e} for e in (seen, os.environ)]))
"""


def shown(**variables: str) -> tuple[dict[str, str], dict[str, str]]:
    """Return the variables of MPI while it starts, and afterwards."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI", "PETSC", "PMI"))}
    environment = {**clean, "PYTHONPATH": str(ROOT), **variables}
    done = subprocess.run(
        [sys.executable, "-c", SHOW], env=environment, capture_output=True, text=True, check=True
    )
    during, after = json.loads(done.stdout)
    return during, after


def test_a_process_alone_needs_no_network() -> None:
    during, after = shown()
    assert {name: during[name] for name in ALONE} == ALONE
    assert after == {}


@pytest.mark.parametrize("name", ["OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK"])
def test_under_a_launcher_nothing_is_set(name: str) -> None:
    during, _ = shown(**{name: "1"})
    assert not set(ALONE) & set(during)


def test_what_the_user_has_set_stays() -> None:
    during, after = shown(OMPI_MCA_btl="tcp,self", PETSC_OPTIONS="-log_view")
    assert during["OMPI_MCA_btl"] == after["OMPI_MCA_btl"] == "tcp,self"
    assert after["PETSC_OPTIONS"] == "-log_view"

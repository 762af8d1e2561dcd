"""What a run imports, and what it does not."""

import subprocess
import sys

from project import ROOT

SLOW = ("pkg_resources", "scipy.stats", "matplotlib.pyplot", "pyvista")
PROGRAM = f"""
import sys
from importlib.metadata import version
import delam_fem.pipeline, ufl, ffcx
from delam_fem.results.fields import pictures, vtx
from delam_fem.results.figures import run
from delam_fem.results.pages import report
print(*(name for name in {SLOW} if name in sys.modules))
assert ufl.__version__ == version("fenics-ufl")
assert ffcx.__version__ == version("fenics-ffcx")
try:
    import pkg_resources
except ImportError:
    sys.exit()  # newer versions of setuptools are without it
assert pkg_resources.parse_version("2.10") > pkg_resources.parse_version("2.9")
"""


def test_a_run_imports_no_slow_module_that_it_does_not_need() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr


WORKER = """
import sys
import delam_fem as df
from delam_fem.studies.sweeps.point import PointRunner
sweep = df.load_sweep(sys.argv[1], {"time.periods": 1, "time.steps_per_period": 60})
assert PointRunner(sweep).point(7, None)[0].outcome == "completed"
print(*sorted(name for name in sys.modules if name in ("mpi4py.MPI", "petsc4py.PETSc", "xarray")))
from delam_fem.system.mpi import MPI
print(MPI.COMM_WORLD.size)
"""


def test_a_worker_of_a_sweep_of_beams_starts_no_mpi_and_loads_little() -> None:
    plane = ROOT / "docs" / "examples" / "plane.toml"
    command = [sys.executable, "-W", "ignore", "-c", WORKER, str(plane)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "\n1\n"), done.stderr


def test_the_command_looks_for_garbage_rarely_and_not_at_its_end() -> None:
    program = """
import atexit, gc
import delam_fem.cli
atexit.unregister(gc.freeze)
assert gc.get_threshold()[0] == 50_000
gc.freeze = lambda: print("frozen")
delam_fem.system.imports.keep_garbage()
"""
    done = subprocess.run(
        [sys.executable, "-c", program], check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, "frozen\n"), done.stderr


def test_tests_set_the_threads_of_blas_before_it_is_loaded() -> None:
    program = (
        "import sys, conftest; print('numpy' in sys.modules, conftest.os.environ[sys.argv[1]])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, "OMP_NUM_THREADS"],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT / "tests",
        env={"PATH": "/usr/bin:/bin"},
    )
    assert (done.returncode, done.stdout) == (0, "False 1\n"), done.stderr

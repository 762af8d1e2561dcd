"""What a run imports, and what it does not."""

import subprocess
import sys

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

"""dolfinx, the wheels with HDF5 and pyvista work in one process, whatever was imported first."""

import subprocess
import sys
from itertools import permutations
from pathlib import Path

import pytest

PACKAGES = ("dolfinx", "delam_fem", "h5py", "netCDF4", "pyvista")
PROGRAM = """
import sys
from importlib import import_module

package = {name: import_module(name) for name in sys.argv[1:]}


def of_dolfinx(dolfinx):
    from mpi4py import MPI
    dolfinx.mesh.create_unit_interval(MPI.COMM_SELF, 3)


def of_delam_fem(df):
    import xarray
    short = {"time.periods": 1, "time.steps_per_period": 50, "output.window_periods": 1}
    df.run(df.preset("paper", {"mesh.elements": 4, **short})).save("run", figures=False)
    with xarray.open_dataset("run/result.nc") as history:
        assert history["tip_displacement"].load().notnull().all()


def of_h5py(h5py):
    with h5py.File("a.h5", "w") as file:
        file["x"] = [1.0, 2.0]
    with h5py.File("a.h5") as file:
        assert file["x"][1] == 2.0


def of_netCDF4(netCDF4):
    with netCDF4.Dataset("b.nc", "w") as file:
        file.createDimension("k", 2)
        file.createVariable("v", "f8", ("k",))[:] = [1.0, 2.0]
    with netCDF4.Dataset("b.nc") as file:
        assert file["v"][1] == 2.0


def of_pyvista(pyvista):
    plot = pyvista.Plotter(off_screen=True, window_size=(200, 200))
    ball = pyvista.Sphere()
    ball["z"] = ball.points[:, 2]
    plot.add_mesh(ball, scalars="z")  # with a scalar bar
    plot.screenshot("c.png")


for name in package:
    globals()[f"of_{name}"](package[name])
"""


def is_curable(order: tuple[str, ...]) -> bool:
    """Return whether nothing was imported between dolfinx and the package that guards it."""
    return order.index("delam_fem") - order.index("dolfinx") <= 1


QUICK = ("dolfinx", "delam_fem", "pyvista", "netCDF4", "h5py")


@pytest.mark.slow
@pytest.mark.parametrize(
    "order",
    [
        pytest.param(order, marks=() if order == QUICK else pytest.mark.nightly, id="-".join(order))
        for order in permutations(PACKAGES)
        if is_curable(order)
    ],
)
def test_every_package_works_after_the_others(order: tuple[str, ...], tmp_path: Path) -> None:
    command = [sys.executable, "-c", PROGRAM, *order]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "c.png").stat().st_size > 1000

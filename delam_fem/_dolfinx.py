"""The one door to dolfinx: imports it safely and hides what its versions name differently.

Written against dolfinx 0.11 names and tested with 0.5.2, 0.9.0 and 0.11.0; no other file asks for a
version. The import itself needs care. dolfinx up to 0.7 switches the process to RTLD_GLOBAL for
good; later ones, where Numba is installed, have llvmlite load PETSc so, and HDF5 with it. After
either, vtk, netCDF4 and h5py wheels take symbols of those libraries for their own and break, so
both are held still meanwhile.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding
import numpy as np
import numpy.typing as npt


@contextmanager
def _symbols_stay_local() -> Iterator[None]:
    """Let what makes the symbols of libraries visible to all others do nothing."""
    held = [(sys, "setdlopenflags"), (llvmlite.binding, "load_library_permanently")]
    originals = [getattr(owner, name) for owner, name in held]
    for owner, name in held:
        setattr(owner, name, lambda *_: None)
    try:
        yield
    finally:
        for (owner, name), original in zip(held, originals, strict=True):
            setattr(owner, name, original)


with _symbols_stay_local():
    import dolfinx
    import dolfinx.fem.petsc
    import dolfinx.mesh

import ufl  # noqa: E402  (after dolfinx, which brings it)
from mpi4py import MPI  # noqa: E402

version: str = dolfinx.__version__


@contextmanager
def _compiling_in_silence() -> Iterator[None]:
    """Keep setuptools, with which ffcx compiles, from telling each of its commands."""
    before = logging.root.manager.disable
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.disable(before)


@_compiling_in_silence()
def create_interval_mesh(
    comm: MPI.Intracomm, x: npt.NDArray[np.float64], cells: npt.NDArray[np.int64]
) -> Any:
    """Build a 1D mesh of intervals that need not be connected.

    Args:
        comm: communicator of the mesh.
        x: node coordinates, shape (n_nodes,) [m]; rank 0's are used.
        cells: node pairs, shape (n_cells, 2); rank 0's are used.

    Returns:
        The mesh, distributed over `comm`; both ends of an interface facet may be on any rank.
    """
    if comm.rank > 0:
        x, cells = np.empty(0), np.empty((0, 2), dtype=np.int64)
    points = np.ascontiguousarray(x, dtype=np.float64).reshape(-1, 1)
    cells = np.ascontiguousarray(cells, dtype=np.int64)
    if hasattr(dolfinx.fem, "functionspace"):
        import basix.ufl

        coordinates = basix.ufl.element("Lagrange", "interval", 1, shape=(1,))
        # by name, for until 0.9 the points come before the element
        return dolfinx.mesh.create_mesh(comm, cells, e=coordinates, x=points)
    domain = ufl.Mesh(ufl.VectorElement("Lagrange", ufl.Cell("interval", geometric_dimension=1), 1))
    return dolfinx.mesh.create_mesh(comm, cells, points, domain)


@_compiling_in_silence()
def pair_space(mesh: Any) -> Any:
    """Return the mixed space P1 × P1 on a mesh of intervals."""
    if hasattr(dolfinx.fem, "functionspace"):
        import basix.ufl

        linear = basix.ufl.element("Lagrange", "interval", 1)
        return dolfinx.fem.functionspace(mesh, basix.ufl.mixed_element([linear, linear]))
    linear = ufl.FiniteElement("Lagrange", mesh.ufl_cell(), 1)
    return dolfinx.fem.FunctionSpace(mesh, ufl.MixedElement([linear, linear]))


@_compiling_in_silence()
def discontinuous_space(mesh: Any, degree: int) -> Any:
    """Return the discontinuous Lagrange space of a degree."""
    kind = ("Discontinuous Lagrange", degree)
    if hasattr(dolfinx.fem, "functionspace"):
        return dolfinx.fem.functionspace(mesh, kind)
    return dolfinx.fem.FunctionSpace(mesh, kind)


def cell_nodes(mesh: Any) -> npt.NDArray[np.int32]:
    """Return the geometry nodes of the cells that this rank owns, shape (n_cells, n_nodes)."""
    geometry = mesh.geometry
    table = geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap
    count = mesh.topology.index_map(mesh.topology.dim).size_local
    if isinstance(table, np.ndarray):
        return table[:count]
    return np.array([table.links(c) for c in range(count)], dtype=np.int32).reshape(count, -1)


@_compiling_in_silence()
def assemble_matrix(form: Any) -> Any:
    """Assemble a bilinear UFL form into a PETSc matrix that the caller owns."""
    matrix = dolfinx.fem.petsc.assemble_matrix(dolfinx.fem.form(form))
    matrix.assemble()
    return matrix


def function(space: Any, fill: Callable[[npt.NDArray[np.float64]], None]) -> Any:
    """Return a function of `space` after `fill` has written its local values."""
    result = dolfinx.fem.Function(space)
    fill(result.x.array)
    result.x.scatter_forward()
    return result

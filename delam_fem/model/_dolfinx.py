"""The only module that imports dolfinx; it hides differences between dolfinx versions.

The code is written for the names of dolfinx 0.11 and tested with 0.5.2, 0.9.0 and 0.11.0. No other
file asks for a version.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system import caches
from delam_fem.system.caches import ensure_home
from delam_fem.system.errors import CaseError
from delam_fem.system.imports import elsewhere
from delam_fem.system.mpi import MPI, start_petsc

ensure_home()  # dolfinx asks for it when it is imported
start_petsc()  # before dolfinx does
import basix  # noqa: E402
import dolfinx  # noqa: E402  (see `delam_fem.system.imports`)
import dolfinx.fem.petsc  # noqa: E402
import dolfinx.geometry  # noqa: E402
import dolfinx.graph  # noqa: E402
import dolfinx.io  # noqa: E402
import dolfinx.jit  # noqa: E402
import dolfinx.mesh  # noqa: E402
import ffcx.codegeneration.jit  # noqa: E402
import ufl  # noqa: E402

_is_old = not hasattr(dolfinx.fem, "functionspace")
_OPTIONS = "options" if hasattr(ffcx, "options") else "params"
if _OPTIONS == "options":
    _FORM_DEFAULTS = ffcx.options.FFCX_DEFAULT_OPTIONS
    _JIT_DEFAULTS = dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS
else:
    _FORM_DEFAULTS = ffcx.parameters.FFCX_DEFAULT_PARAMETERS
    _JIT_DEFAULTS = dolfinx.jit.DOLFINX_DEFAULT_JIT_PARAMETERS
_FORM_OPTIONS = {key: row[1] if len(row) > 2 else row[0] for key, row in _FORM_DEFAULTS.items()}
_JIT_OPTIONS = {key: row[0] for key, row in _JIT_DEFAULTS.items() if key != "cache_dir"}
with elsewhere():  # both read their files of options once: a damaged one would end every run
    for _reader in (ffcx, dolfinx.jit):
        _read = getattr(_reader, "get_options", None) or _reader.get_parameters
        with suppress(ValueError):  # of the file in the home folder; the compilation tells it
            _read()
version: str = dolfinx.__version__
has_adios2: bool = dolfinx.common.has_adios2


def _is_warning(record: logging.LogRecord) -> bool:
    return record.levelno >= logging.WARNING


@contextmanager
def _compiling_in_silence() -> Iterator[None]:
    """Silence setuptools, which ffcx compiles with; it writes each command to the root logger."""
    logging.root.addFilter(_is_warning)
    try:
        yield
    finally:
        logging.root.removeFilter(_is_warning)


def _compiled(comm: MPI.Intracomm, what: str, make: Callable[..., Any]) -> Any:
    """Return what `make` compiles, with all options given, so that no file of options counts.

    Args:
        comm: communicator of the mesh.
        what: text that differs where the compiled code would.
        make: a function of dolfinx that takes options for its compilers.
    """
    key = f"{what} {_FORM_OPTIONS} {_JIT_OPTIONS} {ffcx.__version__} {EXTENSION_SUFFIXES[0]}"

    def in_folder(folder: Path) -> Any:
        jit = {**_JIT_OPTIONS, "cache_dir": folder}
        return make(**{f"form_compiler_{_OPTIONS}": dict(_FORM_OPTIONS), f"jit_{_OPTIONS}": jit})

    with _compiling_in_silence():
        return caches.compiled(comm, key, in_folder)


def _space(mesh: Any, element: Any) -> Any:
    """Return the space of an element, or of (family, degree, shape), on a mesh."""
    make = getattr(dolfinx.fem, "functionspace", None) or dolfinx.fem.FunctionSpace
    if not hasattr(ffcx.codegeneration.jit, "compile_elements"):
        return make(mesh, element)
    what = f"{element!r} on {mesh.ufl_cell()!r}"
    return _compiled(mesh.comm, what, partial(make, mesh, element))


def create_mesh(
    comm: MPI.Intracomm, cell: str, x: FloatArray, cells: IntArray, ranks: IntArray | None = None
) -> Any:
    """Build a mesh with straight cells that need not be connected.

    Args:
        comm: communicator of the mesh.
        cell: "interval", "triangle", "quadrilateral", "tetrahedron" or "hexahedron".
        x: node coordinates, shape (n_nodes,) or (n_nodes, dim) [m]; only those of rank 0 are used.
        cells: vertices of the cells, shape (n_cells, k); only those of rank 0 are used.
        ranks: the rank that owns each cell, shape (n_cells,); None: a graph partitioner decides.

    Returns:
        The mesh, distributed over `comm`; both ends of a facet may be on any rank.
    """
    points = np.ascontiguousarray(x, dtype=np.float64).reshape(len(x), -1)
    cells = np.ascontiguousarray(cells, dtype=np.int64)
    further: dict[str, Any] = {}
    if ranks is not None and comm.size > 1:
        further["partitioner"] = _given_ranks(cells, ranks, is_first=comm.rank == 0)
    if comm.rank > 0:
        points = points[:0]
        cells = cells[:0]
    dim = points.shape[1]
    if hasattr(dolfinx.fem, "functionspace"):
        import basix.ufl

        coordinates = basix.ufl.element("Lagrange", cell, 1, shape=(dim,))
        # keyword arguments, because up to 0.9 the points come before the element
        return dolfinx.mesh.create_mesh(comm, cells, e=coordinates, x=points, **further)
    shape = ufl.Cell(cell, geometric_dimension=dim)
    # FFCx gives the element this variant when it compiles a form, which would change the signatures
    # of the forms after it, so that the cache would not have them
    domain = ufl.Mesh(ufl.VectorElement("Lagrange", shape, 1, variant="equispaced"))
    return dolfinx.mesh.create_mesh(comm, cells, points, domain, **further)


def _given_ranks(cells: IntArray, ranks: IntArray, *, is_first: bool) -> Callable[..., Any]:
    """Return a partitioner that sends cells to given ranks, and copies to those of neighbours.

    Args:
        cells: vertices of all cells, shape (n_cells, k).
        ranks: the rank of each cell, shape (n_cells,).
        is_first: whether this is rank 0, which has the cells.
    """
    n, k = cells.shape
    touches = sp.csr_matrix((np.ones(n * k), (np.repeat(np.arange(n), k), cells.ravel())))
    owns = sp.csr_matrix((np.ones(n), (np.arange(n), ranks)))
    near = (touches @ (touches.T @ owns)).tolil().rows
    lists = [[r, *(q for q in near[c] if q != r)] for c, r in enumerate(ranks) if is_first]
    flat = np.array([rank for ranks_of_cell in lists for rank in ranks_of_cell], dtype=np.int32)
    offsets = np.cumsum([0, *map(len, lists)]).astype(np.int32)

    def partition(*_: Any) -> Any:
        name = "create_adjacencylist" if _is_old else "adjacencylist"
        destinations = getattr(dolfinx.graph, name)(flat, offsets)
        return getattr(destinations, "_cpp_object", destinations)

    return partition


def mixed_space(mesh: Any, n: int) -> Any:
    """Return the mixed space P1 × … × P1 of n components on a mesh of intervals."""
    if _is_old:
        linear = ufl.FiniteElement("Lagrange", mesh.ufl_cell(), 1)
        return _space(mesh, ufl.MixedElement([linear] * n))
    import basix.ufl

    linear = basix.ufl.element("Lagrange", "interval", 1)
    return _space(mesh, basix.ufl.mixed_element([linear] * n))


def space(mesh: Any, family: str, degree: int) -> Any:
    """Return the scalar space of a family ("Lagrange", "Discontinuous Lagrange") and degree."""
    return _space(mesh, (family, degree))


def vector_space(mesh: Any, degree: int) -> Any:
    """Return the Lagrange space of vectors of a degree, with a component for each dimension."""
    dim = mesh.geometry.dim
    if _is_old:
        return _space(mesh, ufl.VectorElement("Lagrange", mesh.ufl_cell(), degree, dim))
    return _space(mesh, ("Lagrange", degree, (dim,)))


def tabulate(cell: str, degree: int, derivatives: int, points: FloatArray) -> FloatArray:
    """Return the basis of `vector_space`, for one component, at points of the reference cell.

    Args:
        cell: name of the cell.
        degree: degree of the space.
        derivatives: highest order of derivatives.
        points: reference coordinates, shape (n, dim).

    Returns:
        Values in the order of the dofs of a cell, shape (n_derivatives, n, n_basis); first the
        values, then the first derivatives along each reference coordinate.
    """
    table = _lagrange(cell, degree).tabulate(derivatives, np.ascontiguousarray(points, np.float64))
    return np.asarray(table[:, :, :, 0], dtype=np.float64)


def reference_nodes(cell: str, degree: int) -> FloatArray:
    """Return the places of the dofs of `vector_space` in the reference cell, (n_basis, dim)."""
    return np.asarray(_lagrange(cell, degree).points, dtype=np.float64)


def _lagrange(cell: str, degree: int) -> Any:
    """Return basix's element of one component of `vector_space`."""
    shape = getattr(basix.CellType, cell)
    variant = basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, shape, degree, variant)


def quadrature(cell: str, degree: int) -> tuple[FloatArray, FloatArray]:
    """Return points, shape (n, dim), and weights, shape (n,), of a rule on a reference cell.

    Args:
        cell: name of the cell.
        degree: degree of the polynomials that the rule integrates exactly.
    """
    points, weights = basix.make_quadrature(getattr(basix.CellType, cell), degree)
    return np.asarray(points, dtype=np.float64), np.asarray(weights, dtype=np.float64)


def cell_dofs(space: Any) -> npt.NDArray[np.int32]:
    """Return the local dofs of all cells of this rank, ghosts included, shape (n_cells, k).

    A dof of a space of vectors stands for all components.
    """
    table = space.dofmap.list
    if isinstance(table, np.ndarray):
        return table
    return np.asarray(table.array).reshape(table.num_nodes, space.dofmap.dof_layout.num_dofs)


def facet_dofs(space: Any, n_facets: int) -> list[list[int]]:
    """Return the positions in `cell_dofs` of the dofs on each facet of a cell, edges included."""
    layout = space.dofmap.dof_layout
    dim = space.mesh.topology.dim
    of_facet = layout.entity_closure_dofs
    return [[int(k) for k in of_facet(dim - 1, facet)] for facet in range(n_facets)]


def constant(mesh: Any, value: float | FloatArray) -> Any:
    """Return a constant of forms, whose value may change without another compilation."""
    return dolfinx.fem.Constant(mesh, np.asarray(value, dtype=np.float64))


def input_nodes(linear: Any) -> IntArray:
    """Return the input node of each dof of a P1 space on this rank, shape (n_local_dofs,)."""
    dofmap = linear.dofmap
    geometry = linear.mesh.geometry
    nodes = np.empty(dofmap.index_map.size_local + dofmap.index_map.num_ghosts, dtype=np.int64)
    mesh_nodes = cell_nodes(linear.mesh)
    nodes[cell_dofs(linear)[: len(mesh_nodes)]] = np.asarray(geometry.input_global_indices)[
        mesh_nodes
    ]
    return nodes


def write_vtx(
    path: str,
    mesh: Any,
    times: FloatArray,
    fields: Callable[[int], Mapping[str, FloatArray]],
) -> None:
    """Write nodal values for ParaView with ADIOS2; call it only if `has_adios2`.

    Args:
        path: a folder whose name ends in .bp.
        mesh: a mesh of cells of degree 1.
        times: times of the frames, shape (n_frames,) [s].
        fields: values of a frame by name, each of shape (n_nodes,), or of vectors (n_nodes, 3), in
            the order of the input nodes; the same names at all frames.
    """
    linear = space(mesh, "Lagrange", 1)
    dim = mesh.geometry.dim
    nodes = input_nodes(linear)
    first = fields(0)
    vectors = vector_space(mesh, 1) if any(array.ndim == 2 for array in first.values()) else None
    functions = {
        name: dolfinx.fem.Function(linear if array.ndim == 1 else vectors, name=name)
        for name, array in first.items()
    }
    with dolfinx.io.VTXWriter(mesh.comm, path, list(functions.values()), "BP4") as writer:
        for k, time in enumerate(times):
            for name, values in fields(k).items():
                here = values[nodes]
                functions[name].x.array[:] = here if here.ndim == 1 else here[:, :dim].ravel()
            writer.write(float(time))


def cell_nodes(mesh: Any) -> npt.NDArray[np.int32]:
    """Return the geometry nodes of the cells that this rank owns, shape (n_cells, n_nodes)."""
    geometry = mesh.geometry
    table = geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap
    count = mesh.topology.index_map(mesh.topology.dim).size_local
    if isinstance(table, np.ndarray):
        return table[:count]
    rows = [table.links(c) for c in range(count)]
    return np.array(rows, dtype=np.int32).reshape(count, len(rows[0]) if rows else 0)


def assemble_matrix(form: Any) -> Any:
    """Assemble a bilinear UFL form into a PETSc matrix that the caller owns."""
    mesh = form.arguments()[0].ufl_function_space().mesh
    compiled = _compiled(mesh.comm, form.signature(), partial(dolfinx.fem.form, form))
    matrix = dolfinx.fem.petsc.assemble_matrix(compiled)
    matrix.assemble()
    return matrix


def function(space: Any, values: FloatArray) -> Any:
    """Return a new function of `space` with given local values, ghosts included."""
    result = dolfinx.fem.Function(space)
    result.x.array[:] = values
    result.x.scatter_forward()
    return result


def assemble_own(form: Any) -> Any:
    """Assemble a user's form, compiled as dolfinx does it, into a PETSc matrix of the caller."""
    with _compiling_in_silence():
        matrix = dolfinx.fem.petsc.assemble_matrix(dolfinx.fem.form(form))
    matrix.assemble()
    return matrix


def held_by(conditions: Sequence[Any], like: Any) -> FloatArray:
    """Return the values of Dirichlet conditions at own dofs, NaN where there is none, (n_own,).

    Args:
        conditions: Dirichlet conditions of dolfinx.
        like: matrix of PETSc whose rows are the dofs.
    """
    arrays = []
    for start in (0.0, 1.0):
        vector = like.createVecLeft()
        vector.set(start)
        dolfinx.fem.petsc.set_bc(vector, list(conditions))
        arrays.append(np.array(vector.array))
        vector.destroy()
    return np.where(arrays[0] == arrays[1], arrays[0], np.nan)


NEAR = 1e-9
"""Distance from a mesh, in parts of its extent, at which a point belongs to it."""


def cells_at(mesh: Any, points: FloatArray) -> IntArray:
    """Return the local cell in which each point lies, -1 where another rank has it (collective).

    Args:
        mesh: a mesh.
        points: the same on all ranks, shape (n, 3) [m].

    Raises:
        CaseError: a point is outside the mesh.
    """
    geometry = dolfinx.geometry
    dim = mesh.topology.dim
    comm = mesh.comm
    x = mesh.geometry.x
    low = x.min(axis=0, initial=np.inf)
    high = x.max(axis=0, initial=-np.inf)
    ends = np.array(comm.allgather((low, high)))
    reach = NEAR * float(np.linalg.norm(ends[:, 1].max(axis=0) - ends[:, 0].min(axis=0)))
    local_cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    if hasattr(geometry, "bb_tree"):
        tree = geometry.bb_tree(mesh, dim, entities=local_cells, padding=reach)
        candidates = geometry.compute_collisions_points(tree, points)
    else:
        tree = geometry.BoundingBoxTree(mesh, dim, local_cells, reach)
        candidates = geometry.compute_collisions(tree, points)
    cells = np.full(len(points), -1, dtype=np.int64)
    away = np.full(len(points), np.inf)
    for k, point in enumerate(points):
        near = candidates.links(k)
        if len(near):
            square = geometry.squared_distance(mesh, dim, near, np.tile(point, (len(near), 1)))
            cells[k], away[k] = near[np.argmin(square)], np.min(square)
    everywhere = np.array(comm.allgather(away))
    lost = np.flatnonzero(everywhere.min(axis=0) > reach**2)
    if lost.size:
        raise CaseError(f"point: expected one in the mesh, given {points[lost[0]].tolist()}")
    cells[everywhere.argmin(axis=0) != comm.rank] = -1
    return cells


def rows_at(space: Any, points: FloatArray, along: Sequence[float]) -> sp.csr_matrix:
    """Return rows that evaluate along · u at points, own columns (collective), CSR (n, n_own).

    Args:
        space: of any element that dolfinx can evaluate, or a mixture of such.
        points: the same on all ranks, shape (n, dim) [m].
        along: one number for each component.
    """
    comm = space.mesh.comm
    dofmap = space.dofmap
    at = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    cells = cells_at(space.mesh, at)
    count = space.num_sub_spaces
    first = 0
    subs = [space.sub(i).collapse() for i in range(count)] or [(space, None)]
    entries: list[tuple[int, int, float]] = []
    for sub, parents in subs:
        shape = dolfinx.fem.Function(sub)
        size = 0
        of_parent = None if parents is None else np.ravel(parents)  # from 0.10 on a list of arrays
        for k in np.flatnonzero(cells >= 0).tolist():
            bs = sub.dofmap.bs
            for dof in (bs * sub.dofmap.cell_dofs(cells[k])[:, None] + np.arange(bs)).ravel():
                # the function with this dof alone is the dof's basis function, on any element
                shape.x.array[dof] = 1.0
                value = np.atleast_1d(shape.eval(at[k], cells[k : k + 1].astype(np.int32)))
                shape.x.array[dof] = 0.0
                weight = float(np.dot(along[first : first + value.size], value))
                entries.append((k, int(dof if of_parent is None else of_parent[dof]), weight))
                size = value.size
        first += max([size, *comm.allgather(size)])
    # a rank may have the cell of a point, but not all of its dofs: every rank keeps its own columns
    rows, dofs, weights = np.array(entries).reshape(-1, 3).T
    bs = dofmap.index_map_bs
    node, component = np.divmod(dofs.astype(np.int32), bs)
    where = bs * dofmap.index_map.local_to_global(node).astype(np.int64) + component
    pieces = comm.allgather((rows.astype(np.int64), where, weights))
    row, column, weight = (np.concatenate(piece) for piece in zip(*pieces, strict=True))
    start, stop = (bs * end for end in dofmap.index_map.local_range)
    is_local = (column >= start) & (column < stop) & (weight != 0.0)
    return sp.csr_matrix(
        (weight[is_local], (row[is_local], column[is_local] - start)),
        shape=(len(points), stop - start),
    )

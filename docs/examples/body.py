"""A form of your own on your own mesh of gmsh: a bar with a hole meets a stop, on any ranks."""

import dolfinx
import gmsh
import numpy as np
import ufl
from mpi4py import MPI
from ufl import inner, sym, tr

import delam_fem as df

comm, E, nu, rho = MPI.COMM_WORLD, 2e9, 0.3, 1200.0
gmsh.initialize(["gmsh", "-v", "0", "-clmax", "0.0025"])
if comm.rank == 0:
    bar = gmsh.model.occ.addRectangle(0, 0, 0, 0.1, 0.01)
    hole = gmsh.model.occ.addDisk(0.08, 0.005, 0, 0.003, 0.003)
    ((_, left),), _ = gmsh.model.occ.cut([(2, bar)], [(2, hole)])
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [left], 1)
    gmsh.model.mesh.generate(2)
try:  # dolfinx 0.10 and later
    mesh = __import__("dolfinx.io.gmsh").io.gmsh.model_to_mesh(gmsh.model, comm, 0, gdim=2).mesh
except ImportError:
    mesh = __import__("dolfinx.io.gmshio").io.gmshio.model_to_mesh(gmsh.model, comm, 0, gdim=2)[0]
V = getattr(dolfinx.fem, "VectorFunctionSpace", None) or dolfinx.fem.functionspace
V = V(mesh, ("Lagrange", 2) if V.__name__ == "VectorFunctionSpace" else ("Lagrange", 2, (2,)))
u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
e, f = sym(ufl.grad(u)), sym(ufl.grad(v))  # a width of 1 m, in plane stress
K = E / (1 - nu**2) * inner((1 - nu) * e + nu * tr(e) * ufl.Identity(2), f) * ufl.dx
start = dolfinx.fem.locate_dofs_geometrical(V, lambda x: x[0] < 1e-9)
base, tip = [dolfinx.fem.dirichletbc(np.array([0.0, 1.0]), start, V)], ([0.1, 0.0], (0.0, 1.0))
further = {"base": base, "gap": df.Gap(*tip, 0.001), "probes": {"tip": tip}}
o = df.Operators.from_forms(rho * inner(u, v) * ufl.dx, K, (5.0, 1e-6), **further)
drive = {"drive": df.HarmonicMotion(200.0, 2e-4), "steps_per_period": 100, "periods": 5}
run = df.run(o, law="newton", scheme="moreau-jean", name="A bar with a hole", **drive)
impacts, lowest = run.history.sizes["event"], run.summary["probe_min"][0]
if comm.rank == 0:
    run.save("body")
    print(f"{impacts} impacts, lowest tip {1e3 * lowest:.6f} mm")
assert impacts and run.summary["energy_residual"] < 1e-6

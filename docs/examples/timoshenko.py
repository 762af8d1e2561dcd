"""A form of your own: a Timoshenko strip, P2-P1 with reduced integration, claps against stops."""

import dolfinx
import numpy as np
import ufl
from mpi4py import MPI

import delam_fem as df

L, b, h, E, G, rho = 0.685, 0.04, 0.002, 5.85e10, 2.2e10, 2680.0
A, EI, kGA = b * h, E * b * h**3 / 12, 5 / 6 * G * b * h
mesh = dolfinx.mesh.create_interval(MPI.COMM_SELF, 40, [0.0, L])
try:  # dolfinx 0.7 and later
    from basix.ufl import element, mixed_element

    pair = mixed_element([element("Lagrange", "interval", degree) for degree in (2, 1)])
    V = dolfinx.fem.functionspace(mesh, pair)
except ImportError:
    both = [ufl.FiniteElement("Lagrange", mesh.ufl_cell(), degree) for degree in (2, 1)]
    V = dolfinx.fem.FunctionSpace(mesh, ufl.MixedElement(both))
(w, t), (v, s) = ufl.TrialFunctions(V), ufl.TestFunctions(V)
dx, reduced = ufl.dx, ufl.dx(metadata={"quadrature_degree": 2})
mass = rho * A * (w * v + h**2 / 12 * t * s) * dx
stiffness = EI * t.dx(0) * s.dx(0) * dx + kGA * (w.dx(0) - t) * (v.dx(0) - s) * reduced
start = dolfinx.mesh.locate_entities_boundary(mesh, 0, lambda x: x[0] < 1e-9)
clamp = [  # the deflection follows the base, the turn rests
    dolfinx.fem.dirichletbc(
        share, dolfinx.fem.locate_dofs_topological(V.sub(i), 0, start), V.sub(i)
    )
    for i, share in enumerate((np.float64(1.0), np.float64(0.0)))
]
stops = df.Gap(points=[[L / 2], [L]], along=(1.0, 0.0), at_rest=[0.006, 0.012])  # below the strip
probes = {"middle": ([L / 2], (1.0, 0.0)), "tip": ([L], (1.0, 0.0))}
strip = df.Operators.from_forms(mass, stiffness, (0.26, 0.0), base=clamp, gap=stops, probes=probes)
how = {"law": df.Law("newton", restitution=0.1), "drive": df.HarmonicMotion(3.25, 0.0025)}
run = df.run(strip, scheme="moreau-jean", steps_per_period=500, periods=10, name="Strip", **how)
run.save("timoshenko")
tip = float(run.history["probe_displacement"].sel(probe="tip").min())
print(f"{run.history.sizes['event']} impacts, lowest tip {1e3 * tip:.2f} mm")
assert 0.0 <= -tip - 0.012 < 3e-4 and run.summary["energy_residual"] < 1e-6

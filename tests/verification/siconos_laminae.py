"""Integrate a linear system with unilateral contacts by Siconos; a process of its own.

    python siconos_laminae.py PROBLEM.npz RESULT.npz

Nothing of the package is imported: the problem comes as arrays, the method is all Siconos'
(MoreauJeanOSI with θ = 1/2 unless given, Newton impacts, Lemke's algorithm for the
complementarity problem).
"""

from __future__ import annotations

import sys

import numpy as np
import numpy.typing as npt
import siconos.kernel as sk

THETA = 0.5


class LoadedSystem(sk.LagrangianLinearTIDS):  # type: ignore[misc]
    """M a + C v + K q = load(t) + contact, from a given start; Siconos asks for the load."""

    def __init__(
        self, problem: dict[str, npt.NDArray[np.float64]], load: npt.NDArray[np.float64]
    ) -> None:
        n = len(problem["mass"])
        start = problem.get("start", np.zeros((2, n)))
        super().__init__(
            start[0], start[1], problem["mass"], problem["stiffness"], problem["damping"]
        )
        self._load, self._time_step = load, float(problem["time_step"])
        self.setFExtPtr(np.zeros(n))

    def computeFExt(self, time: float) -> None:
        """Write the load at a time; the name is that of Siconos."""
        self.fExt()[:] = self._load[round(time / self._time_step)]


def integrate(problem: dict[str, npt.NDArray[np.float64]]) -> dict[str, npt.NDArray[np.float64]]:
    """Return displacements and velocities of the probes after each step, and its hits and impulses.

    Args:
        problem: mass, damping, stiffness (n, n), gap_matrix (p, n), gap0 (p,), base (3, n): columns
            of stiffness, damping and mass that couple to the base, base_states (n_steps + 1, 3):
            its displacement, velocity and acceleration, time_step, restitution, probes (k, n);
            if not from rest with θ = 1/2: start (2, n), displacements and velocities, and theta.
    """
    dt = float(problem["time_step"])
    n_steps = len(problem["base_states"]) - 1
    load = -problem["base_states"] @ problem["base"]
    load = np.vstack([load, load[-1:]])  # Siconos may look one step ahead at the end
    body = LoadedSystem(problem, load)
    system = sk.NonSmoothDynamicalSystem(0.0, (n_steps + 2) * dt)
    system.insertDynamicalSystem(body)
    law = sk.NewtonImpactNSL(float(problem["restitution"]))
    theta = float(problem.get("theta", THETA))
    pairs = []
    for row, rest_gap in zip(problem["gap_matrix"], problem["gap0"], strict=True):
        pairs.append(
            sk.Interaction(law, sk.LagrangianLinearTIR(row[None, :], np.array([rest_gap])))
        )
        system.link(pairs[-1], body)
    simulation = sk.TimeStepping(
        system, sk.TimeDiscretisation(0.0, dt), sk.MoreauJeanOSI(theta), sk.LCP()
    )
    simulation.setNewtonOptions(sk.SICONOS_TS_LINEAR)
    probes = problem["probes"]
    u = np.empty((n_steps, len(probes)))
    v, hits, impulses = np.empty_like(u), np.zeros(n_steps, dtype=np.int64), np.zeros(n_steps)
    for step in range(n_steps):
        simulation.computeOneStep()
        u[step], v[step] = probes @ body.q(), probes @ body.velocity()
        pushed = np.array([pair.lambda_(1)[0] for pair in pairs])
        hits[step], impulses[step] = np.count_nonzero(pushed > 0.0), pushed.sum()
        simulation.nextStep()
    return {"u": u, "v": v, "hits": hits, "impulses": impulses}


if __name__ == "__main__":
    with np.load(sys.argv[1]) as file:
        arrays = dict(file)
    np.savez(sys.argv[2], **integrate(arrays))

"""A plucked bass string that strikes the frets of its neck: 862 measured modes, 20 or 862 pairs.

The equations are those of the modes, with a damping of each; the gaps are sums over all modes. The
files, and where they come from, are in docs/examples/frets. No numbers were published for them.
"""

from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.sparse import csr_matrix, diags

import delam_fem as df

FILES = Path(__file__).with_name("frets")
LENGTH, DENSITY, UNTIL, RATE = 0.863, 0.0067, 0.05, 1960.0  # m, kg/m, s, Hz


def column(name: str) -> np.ndarray:
    """Return the only variable of a file."""
    return loadmat(FILES / f"pb2_{name}.mat", appendmat=False).popitem()[1].ravel()


frequency, decay, height, pluck = map(column, ("frequs", "amortissements", "h", "q2"))
n = frequency.size
place = np.arange(1, n + 1) / (n + 1)
shapes = np.sqrt(2.0 / LENGTH) * np.sin(np.pi * np.outer(place, np.arange(1, n + 1)))
inside = height[1:-1]
frets = 1 + np.flatnonzero((inside > height[:-2]) & (inside > height[2:]))


def heard(points: np.ndarray, restitution: float, doublings: int) -> df.OperatorsResult:
    """Return the motion over some points of the neck, in steps of 1/(2**doublings RATE)."""
    string = df.Operators(
        mass=diags(np.full(n, DENSITY), format="csr"),
        damping=diags(2.0 * DENSITY * decay, format="csr"),
        stiffness=diags(DENSITY * (2.0 * np.pi * frequency) ** 2, format="csr"),
        base=df.BaseCoupling.none(n),
        gap_matrix=csr_matrix(shapes[points]),
        gap0=-height[points],
    )
    return df.run(
        string,
        "compiled",
        law=df.Law("newton", restitution=restitution),
        scheme="moreau-jean",
        initial=df.State(np.array([pluck, 0.0 * pluck, 0.0 * pluck]), np.zeros(points.size, bool)),
        time_step=UNTIL / (steps := round(UNTIL * RATE * 2**doublings)),
        steps_per_period=steps,
        periods=1,
    )


def energy(run: df.OperatorsResult) -> float:
    """Return the energy at the end [mJ]."""
    return 1e3 * float(run.history["energy_kinetic"][-1] + run.history["energy_strain"][-1])


few, all_of_them = heard(frets, 0.9, 5), heard(np.arange(n), 0.9, 5)
apart = np.abs(shapes @ (few.state.motion[0] - all_of_them.state.motion[0])).max()
hits = set(all_of_them.history["event_pair"].to_numpy().tolist())
print(f"{frets.size} frets; {len(hits)} of {n} points are hit, all of them frets")
assert hits <= set(frets.tolist()) and apart < 1e-12

rows = []
for doublings in (5, 6, 7, 8, 9, 11):
    runs = [heard(frets, restitution, doublings) for restitution in (0.0, 0.9, 1.0)]
    assert all(run.summary["energy_residual"] < 1e-9 for run in runs)
    lost = [1e3 * float(run.history["energy_impact_loss"][-1]) for run in runs]
    rows.append((doublings, [shapes @ run.state.motion[0] for run in runs], lost, runs))
*_, (_, finest, _, runs) = rows
print("e = 0, 0.9, 1; from the finest steps [mm]; lost by impacts [mJ]")
for doublings, moved, lost, _ in rows:
    apart = 1e3 * np.sqrt(np.mean((np.array(moved) - finest) ** 2, axis=1))
    print(f"1/{RATE * 2**doublings:.0f} s:", *(f"{value:.4f}" for value in (*apart, *lost)))
left = [energy(run) for run in runs]
print("energy left after 0.05 s:", *(f"{value:.4f}" for value in left), "mJ")
assert np.ptp(left) < 0.005 * left[0]  # e matters ever less: a point of the string has no mass

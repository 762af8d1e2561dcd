"""Operators and a law of your own, with names, figures and a verdict: two masses and a stop.

A shaking base carries a mass of 1 kg on a spring, and that a second one of 0.5 kg, which strikes a
stop. The faster the blow, the less of it comes back: e(v) = e0 / (1 + v/v0). The motion settles to
one blow in each period, and that blow is known: the motion between two blows is linear.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm, solve
from scipy.optimize import fsolve
from scipy.sparse import csr_matrix

import delam_fem as df
from delam_fem.api import Kinematics, LawContext

f, A, gap, e0, v0 = 1.0, 0.01, 0.014, 0.6, 0.5  # Hz, m, m, -, m/s


@dataclass(frozen=True)
class Fading:
    """The law; it acts between two steps, on each pair alone."""

    name: str = "fading restitution"
    spring: tuple[float, float] = (0.0, 0.0)  # pairs never rest on a spring
    is_coupled: bool = True  # impulses act through the mass matrix
    setting: LawContext | None = None

    def supervisor(self, scheme: df.Scheme, setting: LawContext) -> "Fading":
        """Set the law up for a problem."""
        return Fading(setting=setting)

    def examine(self, seen: Kinematics) -> df.Decision | None:
        """Return what jumps at the end of a step."""
        rate = seen.rate_pre()
        hit = np.flatnonzero((seen.gap <= 0.0) & (rate < 0.0))
        if hit.size == 0:
            return None
        after = e0 / (1.0 - rate[hit] / v0) * -rate[hit]
        impulses = (after - rate[hit]) / self.setting.compliance.diagonal(hit)  # N s
        return df.Decision(hit, impulses, rate[hit], after)


M, K = np.diag([1.0, 0.5]), np.array([[300.0, -100.0], [-100.0, 100.0]])  # kg, N/m
C = 0.5 * M  # N s/m
masses = df.Operators(
    mass=csr_matrix(M),
    damping=csr_matrix(C),
    stiffness=csr_matrix(K),
    base=df.BaseCoupling(np.zeros(2), np.zeros(2), np.array([-200.0, 0.0]), (0.0, 0.0, 200.0)),
    gap_matrix=csr_matrix([[0.0, -1.0]]),  # from the second mass to the stop
    gap0=np.array([gap]),
    probes=csr_matrix(np.eye(2)),
    names=("inner", "outer"),
)
drive = df.HarmonicMotion(f, A)
length = {"steps_per_period": 2000, "periods": 80, "window_periods": 5}
run = df.run(masses, law=Fading(), scheme="newmark", drive=drive, name="two masses", **length)
run.save("two_masses")  # result.nc, summary.json, figures, report.html
blows = run.history["event_velocity_before"].to_numpy()

# Between two blows z' = B z for z = (u, v) less the steady motion p(t) without a stop.
w = 2.0 * np.pi * f
U = solve(K + 1j * w * C - w**2 * M, [200.0 * A, 0.0])
B = np.block([[np.zeros((2, 2)), np.eye(2)], [-solve(M, K), -solve(M, C)]])
turn = expm(B / f)


def closes(x: np.ndarray) -> np.ndarray:
    """Return what a state before a blow and its phase lack to repeat after a period."""
    before, after = x[:4], x[:4].copy()
    after[3] *= -e0 / (1.0 + before[3] / v0)
    p = (np.concatenate([U, 1j * w * U]) * np.exp(1j * x[4])).imag
    return np.append(turn @ (after - p) + p - before, before[1] - gap)


t = float(run.history["event_time"][-1])
state = run.history.sel(time=t, method="nearest")
start = [*state["probe_displacement"], *state["probe_velocity"], w * t % (2.0 * np.pi)]
start[3] = -blows[-1]
exact = fsolve(closes, start, xtol=1e-13)
print(f"{run.summary['settled']}; blows at {-blows.round(5)} m/s, exact {exact[3]:.5f} m/s")
assert run.summary["settled"] == "settled" and blows.size == 5
assert np.allclose(-blows, exact[3], rtol=5e-3)  # a blow comes up to a step late

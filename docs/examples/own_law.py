"""A contact law of your own: restitution that falls with the speed of approach.

    e(v) = e0 / (1 + v/v0)

A law has two halves (`contact.laws.ContactLaw`, `contact.decisions.Supervisor`). The first tells
the engine what the law needs. The second is asked in steps with a closed gap and answers with a
`Decision`, or with None. The engine "petsc", which `df.run` takes by default, runs any such law.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

import delam_fem as df
from delam_fem.api import Kinematics, LawContext


@dataclass(frozen=True)
class FadingRestitution:
    """The law with its numbers."""

    e0: float
    v0: float  # m/s
    name: str = "fading restitution"
    spring: tuple[float, float] = (0.0, 0.0)  # pairs never rest on a spring
    is_coupled: bool = True  # impulses act through the mass matrix

    def restitution(self, speed: np.ndarray) -> np.ndarray:
        """Return e at speeds of approach [m/s]."""
        return self.e0 / (1.0 + speed / self.v0)

    def supervisor(self, scheme: df.Scheme, setting: LawContext) -> "Impacts":
        """Set the law up for a problem."""
        if scheme.has_impulses_within:
            raise ValueError(f'{self.name} goes with "newmark", given "{scheme.name}"')
        return Impacts(self, setting)


@dataclass(frozen=True)
class Impacts:
    """The law, set up for one problem. Each pair is treated alone."""

    law: FadingRestitution
    setting: LawContext

    def examine(self, seen: Kinematics) -> df.Decision | None:
        """Return what jumps at the end of a step."""
        rate = seen.rate_pre()
        hit = np.flatnonzero((seen.gap <= 0.0) & (rate < 0.0))
        if hit.size == 0:
            return None
        before = rate[hit]
        after = -self.law.restitution(-before) * before
        impulses = (after - before) / self.setting.compliance.diagonal(hit)  # N s
        return df.Decision(hit, impulses, before, after)


# A unit mass on a unit spring, with a stop where the spring is relaxed: the mass returns after half
# a period with the speed it left with. So the speeds of approach are v, e(v) v, …
one = csr_matrix([[1.0]])
mass_and_stop = df.Operators(one, 0.0 * one, one, df.BaseCoupling.none(1), one, np.zeros(1))
start = df.State(np.array([[1.0], [0.0], [0.0]]), np.zeros(1, dtype=bool))  # let go at 1 m
law = FadingRestitution(e0=0.8, v0=2.0)
length = {"time_step": 1e-3, "steps_per_period": 12_000, "periods": 1}
run = df.run(mass_and_stop, law=law, scheme="newmark", initial=start, **length)

computed = -run.history["event_velocity_before"].to_numpy()
exact = [1.0]
for _ in computed[1:]:
    exact.append(law.restitution(exact[-1]) * exact[-1])
print("speeds of approach [m/s]:", computed.round(5), "exact:", np.round(exact, 5))
assert computed.size == 4
assert np.allclose(computed, exact, rtol=1e-5)

"""Operators of your own: two carts on a track and a stop. No beam, no case, no file.

Cart 1 rolls at 1 m/s towards cart 2, which stands half a metre in front of a stop.
"""

import numpy as np
from scipy.sparse import csr_matrix

import delam_fem as df

nothing = csr_matrix((2, 2))
carts = df.Operators(
    mass=csr_matrix(np.diag([1.0, 2.0])),  # kg
    damping=nothing,
    stiffness=nothing,
    base=df.BaseCoupling.none(2),
    gap_matrix=csr_matrix([[-1.0, 1.0], [0.0, -1.0]]),  # between the carts; from cart 2 to the stop
    gap0=np.array([0.2, 0.5]),  # m
)
start = df.State(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]]), np.zeros(2, dtype=bool))
law = df.Law("newton", restitution=0.5)
length = {"time_step": 1e-3, "steps_per_period": 5000, "periods": 1}
run = df.run(carts, law=law, scheme="newmark", initial=start, **length)
_, velocity, _ = run.state.motion
hit = run.history["event_pair"].to_numpy()

# By hand, with e = 1/2. Cart 1 stops and cart 2 leaves with 1/2 m/s; the stop returns it with
# -1/4 m/s; it meets cart 1 again, which leaves with -1/4 m/s, and follows with -1/8 m/s.
print("pairs hit:", hit, "velocities at the end [m/s]:", velocity)
assert hit.tolist() == [0, 1, 0]
assert np.allclose(velocity, [-0.25, -0.125], atol=1e-12)

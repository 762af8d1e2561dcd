"""What an impact costs: ½ (1 - e²) U̇² / W.

A pair of points that approach each other with the gap rate U̇ leaves with -e U̇. If the impulse acts
through the mass matrix of the time integration, the energy lost is exactly ½ (1 - e²) U̇² / W. Here
W = H M⁻¹ Hᵀ is the compliance of the pair, and 1/W is the mass that takes part in the impact.
"""

import numpy as np

import delam_fem as df
from delam_fem.api import assemble

e = 0.3
case = df.preset(
    "paper",
    {
        "contact.law": "newton",
        "contact.impulse": "consistent",
        "contact.restitution": e,
        "time.periods": 3,
        "output.window_periods": 3,  # impacts of the window are listed one by one
    },
)
structure = assemble(case, needs_dolfinx=False)
history = df.run(case, "compiled", structure=structure).history

# Some pairs are hit at the same instant and share the energy. The formula is for a single pair.
times, counts = np.unique(history.event_time, return_counts=True)
alone = np.isin(history.event_time, times[counts == 1])

operators = structure.operators
H = operators.gap_matrix.toarray()
W = np.diag(H @ np.linalg.solve(operators.mass.toarray(), H.T))
pair = history.event_node.to_numpy()[alone] - 1  # node 0 is the clamp, which is no pair
rate = history.event_velocity_before.to_numpy()[alone]

exact = 0.5 * (1.0 - e**2) * rate**2 / W[pair]
computed = -history.event_energy.to_numpy()[alone]
error = np.max(np.abs(computed - exact)) / exact.max()
print(f"{alone.sum()} single impacts, the strongest lost {computed.max():.4e} J")
print(f"largest difference from the formula: {error:.0e} of that")
assert alone.sum() > 20
assert error < 1e-9

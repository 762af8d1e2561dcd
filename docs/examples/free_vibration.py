"""Free vibration without contact: the logarithmic decrement.

A lamina that starts in its first mode swings with the damped frequency f sqrt(1 - D²), and its
amplitude falls by the factor exp(-δ) per cycle,

    δ = 2π D / sqrt(1 - D²).
"""

import math

import numpy as np

import delam_fem as df
from delam_fem.api import assemble, initial_state

D = 0.008  # damping ratio of the first mode in the preset
cycles = 20

# Time steps are counted in periods of the base, also where the base stands still (amplitude 0).
# With the damped frequency of the thick lamina as that of the base, a period is a cycle.
natural = df.preset("paper").lamina[0].angular_frequencies(1)[0] / (2.0 * math.pi)
case = df.preset(
    "paper",
    {
        "contact.law": "none",
        "excitation.amplitude": 0.0,
        "excitation.frequency": natural * math.sqrt(1.0 - D**2),
        "time.periods": cycles,
    },
)

# The tip of the thick lamina is let go at 10 mm, the whole lamina in its first mode.
structure = assemble(case, needs_dolfinx=False)
start = initial_state(structure, {"thick.displacement": 0.010})
result = df.run(case, "compiled", structure=structure, initial=start)

# The dataset has the displacement at the end of each period: one number per cycle.
tip = result.history.strobe_displacement.sel(lamina="thick").to_numpy()
measured = math.log(tip[0] / tip[-1]) / (cycles - 1)
exact = 2.0 * math.pi * D / math.sqrt(1.0 - D**2)
print(f"logarithmic decrement: {measured:.6f}, exact {exact:.6f}")
assert abs(measured / exact - 1.0) < 1e-4

# The ledger of the run: what the laminae lost is what the damping took.
energy = result.history.energy_kinetic + result.history.energy_strain
lost = float(energy[0] - energy[-1])
damped = float(result.history.energy_damping_loss[1:].sum())
print(f"energy lost: {lost:.6e} J, by damping: {damped:.6e} J")
assert np.isclose(lost, damped, rtol=1e-9)

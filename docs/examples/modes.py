"""Natural frequencies of the laminae beside those of the exact cantilever.

Each lamina is a cantilever. Its natural frequencies are known exactly,

    f_k = (B_k/L)² sqrt(EI/ρA) / 2π,    cos B cosh B = -1,

so that the finite elements can be judged without any experiment.
"""

import numpy as np

import delam_fem as df
from delam_fem import modes

# The preset has the two laminae of the paper, 20 elements each.
case = df.preset("paper")
result = modes(case, 3)

for name, computed, exact in zip(result.names, result.frequencies, result.exact, strict=True):
    for k in range(3):
        print(f"{name}, mode {k + 1}: {computed[k]:.4f} Hz, exact {exact[k]:.4f} Hz")

# The first frequencies are those of the given EI: 3.1649 Hz (thick) and 1.4357 Hz (thin).
assert np.allclose(result.frequencies[:, 0], [3.1649, 1.4357], atol=5e-5)
# Cubic elements are a little too stiff: mode 3 comes out 2e-5 too high.
assert np.all(np.abs(result.relative_differences) < 3e-5)

# With twice as many elements the error falls by 2⁴ = 16: the order is 4. Mode 3 shows it well above
# round-off.
fine = modes(case.with_overrides({"mesh.elements": 40}), 3)
order = np.log2(result.relative_differences[:, 2] / fine.relative_differences[:, 2])
print(f"order of convergence: {order[0]:.2f} (thick), {order[1]:.2f} (thin)")
assert np.all(np.abs(order - 4.0) < 0.1)

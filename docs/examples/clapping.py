"""The clapping laminae of the paper: a short run and a picture.

The base moves by 2.5 mm at 3.25 Hz, just above the first natural frequency of the thick lamina.
Both laminae start from rest. Soon the thick one strikes the thin one once a period.
"""

from matplotlib.figure import Figure

import delam_fem as df

case = df.preset("paper", {"time.periods": 40, "output.window_periods": 3})
result = df.run(case, "compiled")
history, summary = result.history, result.summary

print(f"tip contacts per period: {summary['tip_contacts_per_period']:.2f}")
print(f"smallest y1: {1e3 * summary['tip_min'][0]:.1f} mm")
assert abs(summary["tip_contacts_per_period"] - 1.0) < 0.1
# The energy ledger accounts for all that the base put in.
print(f"energy that the ledger does not account for: {summary['energy_residual']:.0e}")
assert summary["energy_residual"] < 1e-9

# The dataset is an xarray.Dataset. Displacements count from the stress-free shape of each lamina,
# and the thin one stands off by the gap.
figure = Figure(figsize=(8.0, 4.0), layout="constrained")
axes = figure.subplots()
gap = float(history.gap0[-1])
axes.plot(history.time, 1e3 * history.tip_displacement.sel(lamina="thick"), label="thick")
axes.plot(history.time, 1e3 * (gap + history.tip_displacement.sel(lamina="thin")), label="thin")
axes.set(xlabel="time [s]", ylabel="position of the tip [mm]", title="The last three periods")
axes.legend()
figure.savefig("clapping.png")
print("picture: clapping.png")
# `result.save("runs/clapping")` would write all numbers, figures, fields and a report.

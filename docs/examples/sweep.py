"""A short sweep: from one strike per period to one strike in two.

Between 3.25 and 3.65 Hz the period of the motion doubles. A sweep computes a case at many points
and puts all of them into one dataset. `df.load_sweep` reads a sweep from a file (the .toml files
beside this one are such files); `sweep_of` takes the same keys as a dictionary.
"""

import delam_fem as df
from delam_fem.studies.sweeps.grid import sweep_of

sweep = sweep_of(
    {
        "name": "doubling",
        "base": "paper",
        "set": {"time.periods": 150},
        "axis": [{"key": "excitation.frequency", "values": [3.25, 3.6, 3.65]}],
    }
)

# "serial" computes in this process. Without it, `run_sweep` starts one worker process per core; the
# script then needs `if __name__ == "__main__":`, because workers import it again.
data = df.run_sweep(sweep, "doubling", "serial")

for frequency in data.frequency.to_numpy():
    point = data.sel(frequency=frequency)
    print(
        f"{frequency:.2f} Hz: period {float(point.periodicity):.0f}, "
        f"{float(point.tip_contacts_per_period):.2f} tip contacts per period"
    )

# The paper: one contact per period at 3.25 Hz, one contact in two periods at 3.65 Hz.
assert float(data.periodicity.sel(frequency=3.25)) == 1.0
assert float(data.periodicity.sel(frequency=3.65)) == 2.0
assert abs(float(data.tip_contacts_per_period.sel(frequency=3.65)) - 0.5) < 0.05

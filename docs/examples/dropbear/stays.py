"""Print the best known free vibration of each stay of the roller in runs/test4."""

import numpy as np
import xarray as xr


def stays(folder):
    """Return voltage, and the segment that is known best, of each stay of the roller."""
    data = xr.load_dataset(f"{folder}/measured.nc")
    segments = []
    for k, (t, error) in enumerate(
        zip(data["free_time"].values, data["free_frequency_error"].values, strict=True)
    ):
        volts = data["sensor_roller"].sel(time=slice(t - 0.25, t + 0.25)).values
        if np.ptp(volts) > 0.1 or not np.isfinite(error):
            continue  # it moves
        if not segments or abs(volts.mean() - segments[-1][0]) > 0.2:
            segments.append((volts.mean(), k, error))
        elif error < segments[-1][2]:
            segments[-1] = (volts.mean(), k, error)
    return data, [(volts, k) for volts, k, _ in segments]


if __name__ == "__main__":
    data, segments = stays("runs/test4")
    for volts, k in segments[1:]:  # nothing vibrates in the first
        best = data.isel(free_time=k)
        print(f"{volts:.2f} V {best['free_frequency']:.2f} Hz {100 * best['free_damping']:.2f} %")

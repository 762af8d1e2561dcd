"""Compare places that `identify natural` has found with those of the roller, in millimetres."""

import json

import matplotlib.pyplot as plt
import numpy as np
from stays import stays


def answers(record, folder):
    """Return voltages, and ends and middles of the intervals, of all stays [mm]."""
    data, segments = stays(record)
    numbers = json.load(open(f"{folder}/natural.json"))
    place = numbers["unknowns"]["support.2.position"]
    at = [
        np.abs(np.array(numbers["time_s"]) - data["free_time"].values[k]).argmin()
        for _, k in segments
    ]
    rows = 1e3 * np.array([[place[name][k] for name in ("low", "median", "high")] for k in at])
    return np.array([volts for volts, _ in segments]), rows, np.array(numbers["time_s"])[at]


if __name__ == "__main__":
    volts, rows, _ = answers("runs/test0", "runs/where0")
    line = np.polyfit(volts, rows[:, 1], 1)
    print(f"test0: {line[0]:.1f} mm/V {line[1]:+.1f} mm")
    volts, rows, time = answers("runs/test4", "runs/where4")
    for v, (low, middle, high) in zip(volts, rows, strict=True):
        truth = np.polyval(line, v)
        print(
            f"{v:.2f} V: {truth:.0f} mm, found {middle:.0f} ({low:.0f} ... {high:.0f})",
            "" if low < truth < high else "outside",
        )

    data, _ = stays("runs/test4")
    plt.plot(
        data["time"], np.polyval(line, data["sensor_roller"]), color="0.5", label="measured roller"
    )
    plt.errorbar(
        time,
        rows[:, 1],
        [rows[:, 1] - rows[:, 0], rows[:, 2] - rows[:, 1]],
        fmt="o",
        capsize=3,
        label="from the acceleration, 90 %",
    )
    plt.xlabel("time [s]")
    plt.ylabel("position [mm]")
    plt.legend()
    plt.savefig("moving_support.png", dpi=120)

"""Give the operators of a case to pyHarm, and follow its forced response by harmonic balance.

    delam-fem show operators soft.toml -o soft.npz
    python to_pyharm.py soft.npz 2.6 3.1 --stiffness 5

pyHarm (PyPI `pyHarm-os`) needs a newer SciPy and h5py than Debian 12 has beside dolfinx: install it
in an environment of its own. The file is all that it needs. Contact is the law "penalty" without
damping: a spring of the given stiffness on each closed pair. Unknowns are seen from the base,
w = u - q_b.
"""

import argparse

import numpy as np
from pyHarm.Maestro import Maestro


def input_of(data, stiffness, band, harmonics, times):
    """Return the input of pyHarm: one substructure, a spring for each pair, forces on each dof."""
    K = data["K"]
    iota = -np.linalg.solve(K, data["k_b"])  # what moves with the base
    if np.abs(data["H"] @ iota).max() > 1e-6:
        raise SystemExit("the base opens the gaps: this script is for laminae that are apart")
    inertia = data["m_b"] + data["M"] @ iota
    drag = data["c_b"] + data["C"] @ iota
    amplitude = float(data["drive_amplitude"])
    connectors = {}
    for dof in range(len(K)):
        node, direction = divmod(dof, 2)
        for order, load in ((2, inertia), (1, drag)):  # -m q_b'' - c q_b', q_b = A sin(ωt)
            if abs(load[dof]) > 1e-12 * np.abs(load).max() > 0.0:
                connectors[f"force_{dof}_{order}"] = {
                    "type": "GOForcing", "connect": {"beam": [node]}, "dirs": [direction],
                    "dto": order, "ho": 1, "phi": np.pi / 2.0, "amp": -amplitude * load[dof],
                }  # fmt: skip
    for pair, row in enumerate(data["H"]):
        lower, upper = int(np.flatnonzero(row < 0)[0]), int(np.flatnonzero(row > 0)[0])
        connectors[f"pair_{pair}"] = {
            "type": "PenaltyUnilateralGap", "dirs": [0],
            "connect": {"beam": [lower // 2], "INTERNAL": [upper // 2]},
            "g": float(data["g0"][pair]), "k": stiffness,
        }  # fmt: skip
    low, high = (2.0 * np.pi * f for f in band)
    return {
        "system": {"type": "Base", "nh": harmonics, "nti": times},
        "substructures": {
            "beam": {"matrix": {name: data[name] for name in "MCK"}, "ndofs": 2},
        },
        "connectors": connectors,
        "analysis": {
            "FRF": {
                "study": "frf", "puls_inf": low, "puls_sup": high, "puls_start": low,
                "ds0": 0.05, "ds_max": 0.2, "ds_min": 1e-6, "verbose": False,
            },
        },
    }  # fmt: skip


def tips(data, x, harmonics, times=2000):
    """Return the smallest and largest displacement of both tips, base included [m]."""
    q, n = x[:-1].reshape(2 * harmonics + 1, -1), np.arange(1, harmonics + 1)
    t = 2.0 * np.pi * np.arange(times) / times
    rows = [np.ones(times)]
    for k in n:
        rows += [np.cos(k * t), np.sin(k * t)]
    w = (data["P"] @ q.T) @ np.array(rows)
    u = w + float(data["drive_amplitude"]) * np.sin(t)
    return u.min(axis=1), u.max(axis=1)


def main():
    """Read the arguments, follow the response and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("band", type=float, nargs=2, help="from, to [Hz]")
    parser.add_argument("--stiffness", type=float, required=True, help="of each pair [N/m]")
    parser.add_argument("--harmonics", type=int, default=12)
    parser.add_argument("--times", type=int, default=1024, help="instants per period")
    options = parser.parse_args()
    data = dict(np.load(options.file))
    study = Maestro(
        input_of(data, options.stiffness, options.band, options.harmonics, options.times)
    )
    study.operate()
    print("frequency [Hz]   y1 min, max [mm]       y2 min, max [mm]")
    for solution in study.nls["FRF"].SolList:
        if solution.flag_accepted:
            low, high = (1e3 * y for y in tips(data, solution.x, options.harmonics))
            frequency = solution.x[-1] / (2.0 * np.pi)
            print(
                f"{frequency:10.6f}  {low[0]:10.4f} {high[0]:9.4f}  {low[1]:10.4f} {high[1]:9.4f}"
            )


if __name__ == "__main__":
    main()

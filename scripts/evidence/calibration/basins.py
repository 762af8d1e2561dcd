"""`show diagram basins`: attractors.

25 starts of the thin lamina of `paper` and `default`, 200 periods, 3.49 to 3.56 Hz, where two
motions live; the truth is that of 1000 periods. No share is printed; 95 % is the aim.

Maps of 25 starts of the thin lamina (tip to ± 50 mm and ± 1 m/s, as in docs/examples/basins.toml)
of the presets `paper` and `default`, with 200 periods, at frequencies drawn from 3.49 to 3.56
Hz, where two motions live. The truth is what the same starts do after 1000 periods, by the means
over 100 of them: motions are the same if a chain of others joins them in steps of 7 % of the
amplitude. Each cell is asked whether it reaches the attractor of another one, drawn from its map.
Grey and hatched cells (isolated, not settled) are undecided. No share is printed; 95 % is the aim.
The diagram tells motions apart that differ by more than 12 %. With 20 %, on other maps, 58 of 73
cells of `default` were right: close behind its doubling live motions that are 17 % apart.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from calibration.row import Row
from scipy.cluster.hierarchy import fcluster, linkage

import delam_fem as df
from delam_fem.api import IntArray, settling
from delam_fem.studies.diagrams import is_unsettled
from delam_fem.studies.sweeps.grid import sweep_of

NOMINAL, JOINED = 0.95, 0.07
CELLS = (5, 3)
MAPS = (6, 1)
"""Starts along an axis, and maps of a preset, of the long and of the short form."""
PERIODS = 200
LATER = (1000, 240)
KEPT = 100
FINGERPRINT = ("tip_min", "tip_max", "strobe_displacement")


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return how often two starts are told to reach the same attractor, or another, rightly."""
    rng = np.random.default_rng(43)
    result = []
    for preset in ("paper", "default")[: 2 if is_long else 1]:
        right: list[bool] = []
        truths = others = 0
        for k, frequency in enumerate(rng.uniform(3.49, 3.56, MAPS[not is_long])):
            map_folder = folder / f"{preset}-{k}"
            said = shown(swept(preset, frequency, PERIODS, 10, is_long, map_folder / "short"))
            later = LATER[not is_long]
            true = reached(swept(preset, frequency, later, KEPT, is_long, map_folder / "long"))
            truths += said.size
            decided = np.flatnonzero(said >= 0)
            for i in decided:
                j = rng.choice(np.setdiff1d(decided, [i]))
                right.append(bool((said[i] == said[j]) == (true[i] == true[j])))
                others += bool(true[i] != true[j])
        result.append(
            Row("same attractor, or another", f"{preset}, five times as long", NOMINAL,
                sum(right), truths, truths - len(right), at_least=True,
                note=f"{others} pairs on different ones")
        )  # fmt: skip
    return result


def swept(
    preset: str, frequency: float, periods: int, window: int, is_long: bool, folder: Path
) -> xr.Dataset:
    """Return the sweep over the starts."""
    count = CELLS[not is_long]
    keys = {
        "excitation.frequency": frequency, "time.periods": periods,
        "output.window_periods": window, "output.fields_per_period": 0,
    }  # fmt: skip
    axes = [
        {"key": f"initial.thin.{name}", "start": -most, "stop": most, "count": count}
        for name, most in (("displacement", 0.05), ("velocity", 1.0))
    ]
    wanted = {"name": "basins", "base": preset, "set": keys, "axis": axes,
              "record": {"strobes": max(40, window)}}  # fmt: skip
    with df.run_sweep(sweep_of(wanted), folder, "serial", resume=True) as data:
        return data.load()


def shown(data: xr.Dataset) -> IntArray:
    """Return the attractors of the cells as the diagram shows them, -1 for undecided ones."""
    fingerprints = data[["periodicity", *FINGERPRINT]].where(~is_unsettled(data))
    attractors = settling.attractors(
        *(fingerprints[name].to_numpy() for name in ("periodicity", *FINGERPRINT))
    )
    return np.where(settling.is_isolated(attractors.number), -1, attractors.number).ravel()


def reached(data: xr.Dataset) -> IntArray:
    """Return the attractors that long motions are on."""
    low, high, strobes = (data[name].to_numpy() for name in FINGERPRINT)
    prints = np.stack([low, high, strobes.mean(axis=-1), strobes.std(axis=-1)], axis=-1)
    amplitude = 0.5 * float(np.median((high - low).max(axis=-1)))
    joined = linkage(prints.reshape(low[..., 0].size, -1) / amplitude, "single", "chebyshev")
    return fcluster(joined, JOINED, "distance")

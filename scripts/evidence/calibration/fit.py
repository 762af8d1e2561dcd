"""`identify keys`: frequency responses.

A clamped stack of two laminae with an open delamination and a spring at its tip; a laser at the tip
and an accelerometer measure 400 lines from 20 to 1,020 Hz with noise of 1 or 5 % of each. *As
modelled* stiffness (± 10 %), clamps that yield and gains of the sensors (2 %) are drawn, too.
Responses are those of twice as many elements.

Truths are drawn from the priors, which were tuned on others. Clamps of the other rigs but soft ones
are rigid, beyond the prior. The base is driven. Sought are the end of the delamination, the damping
ratio of both laminae, and the stiffness of the spring.
The note has the median width of the intervals as a share of the prior.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import xarray as xr
from calibration.row import OWN, Row

from delam_fem.api import Case, FloatArray, assemble, of_channels
from delam_fem.studies.identification.fit import of_responses
from delam_fem.studies.identification.unknowns import Unknown, drawn, of_rig
from delam_fem.studies.signals.writing import write_measured

LEVEL = 0.9
TRUTHS = 20
NOISE = (0.01, 0.05)
LAMINA = {"length": 0.3, "width": 0.02, "density": 2700.0, "young_modulus": 7e10,
          "damping_ratio": 0.01}  # fmt: skip
CASE = Case(
    name="stack",
    lamina=[{"name": "lower", "thickness": 0.002, **LAMINA},
            {"name": "upper", "thickness": 0.0015, **LAMINA}],
    support=[{"start": "clamped"}, {"side": "end", "kind": "spring", "stiffness": 2000.0}],
    delamination=[{"between": ["lower", "upper"], "start": 0.10, "end": 0.2, "opening": 1e-3}],
    sensor=[{"name": "acc", "quantity": "acceleration", "lamina": "upper", "position": 0.15},
            {"name": "laser", "quantity": "displacement", "lamina": "lower", "position": 0.3}],
    mesh={"elements": 30}, contact={"law": "newton"},
    excitation={"kind": "harmonic", "amplitude": 1e-6, "frequency": 20.0},
)  # fmt: skip
KEYS = {
    "delamination.1.end": (0.16, 0.24),
    "lamina.*.damping_ratio": (0.005, 0.02),
    "support.2.stiffness": (1000.0, 4000.0),
}
CHANNELS = ("laser", "acc")
FREQUENCY = np.linspace(20.0, 1020.0, 400)


def measured(
    path: Path, keys: dict[str, float], noise: float, gains: dict[str, float],
    rng: np.random.Generator,
) -> Path:  # fmt: skip
    """Write the responses of a rig as `measure response` does."""
    rig = CASE.with_overrides({"mesh.elements": 60, **keys})
    s = 2j * np.pi * FREQUENCY
    channels = of_channels(assemble(rig, needs_dolfinx=False), rig, s)
    names = ["base", *CHANNELS]
    rows = []
    for name in CHANNELS:
        H = gains.get(name, 1.0) * channels[name] / s**2
        parts = rng.standard_normal((2, H.size))
        rows.append(H + noise * np.abs(H) * (parts[0] + 1j * parts[1]))
    time = 1e-3 * np.arange(16.0)
    data = xr.Dataset(
        {name: ("time", time) for name in ("sensor_base", "sensor_laser", "sensor_acc")},
        coords={"time": time, "frequency": FREQUENCY, "output": names[1:], "channel": names},
        attrs={"title": "measurement", "schema": "delam_fem measurement", "notes": ""},
    )
    about = {"units": "see response_units", "excitation": "base", "excitation_units": "m/s2"}
    data["response"] = (("frequency", "output"), np.array(rows).T, about)
    rows_of = {
        "variable": ["sensor_base", "sensor_laser", "sensor_acc"],
        "units": ["m/s2", "m", "m/s2"],
        "quantity": ["acceleration", "displacement", "acceleration"],
        "position": [np.nan, 0.3, 0.15],
        "lamina": ["", "lower", "upper"],
        "source": ["a", "b", "c"],
    }
    for name, values in rows_of.items():
        data[f"channel_{name}"] = ("channel", values)
    return write_measured(data, path)


def truths(number: int, rig: str, count: int) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return keys of the rigs and gains of their sensors, shape (count, 2)."""
    rng = np.random.default_rng([59, number])
    keys = {key: rng.uniform(low, high, count) for key, (low, high) in KEYS.items()}
    ratio = keys.pop("lamina.*.damping_ratio")
    keys |= {f"lamina.{name}.damping_ratio": ratio for name in ("lower", "upper")}
    others = drawn(of_rig(CASE), CASE, count, 200 + number)
    gains = np.ones((count, len(CHANNELS)))
    modulus = {key: 7e10 for key in others if key.endswith("young_modulus")}
    if rig == OWN:
        gains = np.exp(0.02 * rng.standard_normal(gains.shape))
        keys |= {key: values for key, values in others.items() if "damping" not in key}
    elif rig.startswith("EI"):
        factor = 1.05 if "+" in rig else 0.95
        keys |= {key: np.full(count, factor * value) for key, value in modulus.items()}
    elif rig.startswith("soft"):
        soft = 2.0 * of_rig(CASE)[-1].low
        keys["support.rotational_stiffness"] = np.full(count, soft)
    elif rig.startswith("sensor"):
        gains[:, 1] = 1.02
    return keys, gains


def rows(is_long: bool, folder: Path) -> list[Row]:
    """Return the rows of the page."""
    rigs = (OWN, "EI + 5 %", "EI − 5 %", "soft clamps (k L/EI = 100)", "sensor + 2 %")
    count = TRUTHS if is_long else 2
    drawn_rigs = {rig: truths(n, rig, count) for n, rig in enumerate(rigs if is_long else rigs[:1])}
    ends_of = {rig: [] for rig in drawn_rigs}
    for k in range(count):
        for rig, (keys, gains) in drawn_rigs.items():
            mine = {key: float(values[k]) for key, values in keys.items()}
            of_sensors = dict(zip(CHANNELS, gains[k].tolist(), strict=True))
            path = folder / f"{rigs.index(rig)}-{k}.nc"
            ends_of[rig].append(intervals(path, mine, NOISE[k % 2], of_sensors))
    truth = {
        rig: np.stack([keys[key.replace("*", "lower")] for key in KEYS], axis=1)
        for rig, (keys, _) in drawn_rigs.items()
    }
    result = []
    width_of_prior = np.array([high - low for low, high in KEYS.values()])
    for rig, ends in ends_of.items():
        low, high = np.moveaxis(np.array(ends), 2, 0)  # (count, n_keys) each
        inside = (low <= truth[rig]) & (truth[rig] <= high)
        share = 100.0 * (high - low) / width_of_prior
        for j, key in enumerate(KEYS):
            note = f"{np.median(share[:, j]):.2g} % of the prior"
            verdict = f"{key}, 90 % interval"
            result.append(Row(verdict, rig, LEVEL, int(inside[:, j].sum()), count, note=note))
        for j, noise in enumerate(NOISE):
            chosen = inside[j :: len(NOISE)]
            verdict = f"the three keys, {100.0 * noise:g} % noise"
            result.append(Row(verdict, rig, LEVEL, int(chosen.sum()), chosen.size))
    return result


def intervals(
    path: Path, keys: dict[str, float], noise: float, gains: dict[str, float]
) -> list[list[float]]:
    """Return the ends of the intervals of `KEYS`; those that the folder has are used again."""
    stored = path.with_suffix(".json")
    if not stored.exists():
        number, k = path.stem.split("-")
        rng = np.random.default_rng([60, int(number), int(k)])
        measured(path, keys, noise, gains, rng)
        unknowns = tuple(Unknown(key, *ends) for key, ends in KEYS.items())
        finding = of_responses(CASE, [path], unknowns, of_rig(CASE))
        stored.write_text(json.dumps(finding.posterior.interval(LEVEL).tolist()), "utf-8")
    return json.loads(stored.read_text("utf-8"))

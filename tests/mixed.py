"""Cases in which no two numbers are alike: laminae, places, supports, stops, sensors and drives.

A comparison of two ways to the same result notices a wrong index, sign, factor or bound in one of
them wherever it has an effect.
"""

from __future__ import annotations

from typing import Any

from delam_fem.api import Case

LAMINAE = [
    {"name": "low", "thickness": 0.003, "material": "steel", "damping_ratio": 0.011},
    {"name": "mid", "thickness": 0.002, "material": "glass-epoxy", "damping_ratio": 0.007},
    {"name": "top", "thickness": 0.0012, "material": "aluminium", "damping_ratio": 0.004},
]
SIZE = {"length": 0.5, "width": 0.023}
BASE = {"kind": "harmonic", "amplitude": 3e-4, "frequency": 27.0}
FORCE = {"kind": "force", "lamina": "mid", "position": 0.31, "amplitude": 2.0, "frequency": 31.0}
CROSSING = [
    {"between": ["low", "mid"], "start": 0.08, "end": 0.29, "opening": 2e-4,
     "shape": "half-cosine"},
    {"between": ["mid", "top"], "start": 0.2, "end": 0.5, "opening": 7e-4, "shape": "power",
     "exponent": 1.6},
]  # fmt: skip
INNER = [CROSSING[0], {"between": ["mid", "top"], "start": 0.2, "end": 0.46, "opening": 7e-4}]

SENSORS = [
    {"name": "d", "quantity": "displacement", "lamina": "mid", "position": 0.17},
    {"name": "v", "quantity": "velocity", "lamina": "low", "position": 0.43},
    {"name": "a", "quantity": "acceleration", "lamina": "low", "position": 0.35},
    {"name": "e", "quantity": "strain", "lamina": "mid", "position": 0.23, "surface": "bottom"},
    {"name": "f", "quantity": "contact force", "between": ["low", "mid"]},
]
STOPS = [
    {"lamina": "mid", "side": "above", "position": 0.47, "gap": 3e-3, "stiffness": 900.0,
     "damping": 0.09},
    {"lamina": "low", "side": "below", "start": 0.12, "end": 0.33, "gap": 1e-3, "opening": 5e-4,
     "stiffness": 7e3, "damping": 0.7, "on": "ground"},
    {"lamina": "low", "side": "both", "position": 0.44, "gap": 2e-3},
]  # fmt: skip
IMPACTORS = [
    {"lamina": "low", "mass": 0.03, "position": 0.21, "side": "below", "gap": 4e-4,
     "velocity": 0.6, "stiffness": 4e3, "damping": 0.4},
    {"lamina": "mid", "mass": 0.05, "position": 0.37, "gap": 6e-4, "spring": 50.0,
     "spring_damping": 0.2, "on": "base"},
]  # fmt: skip
MASSES = [
    {"lamina": "low", "mass": 0.04, "position": 0.26},
    {"lamina": "mid", "mass": 0.013, "position": 0.5},
    {"lamina": "low", "mass": 0.021},
]
INSIDE = [
    {"position": 0.14, "kind": "spring", "stiffness": 2e3, "damping": 0.5,
     "rotational_stiffness": 3.0},
    {"position": 0.4, "kind": "pinned", "lamina": "low"},
]  # fmt: skip
INITIAL = [
    {"lamina": "mid", "shape": "mode", "mode": 2, "displacement": 1e-4},
    {"lamina": "low", "shape": "force", "position": 0.3, "displacement": -2e-4},
    {"velocity": 0.02},
]


def mixed(n_laminae: int = 2, **sections: Any) -> Case:
    """Return a case of unlike laminae with everything that it may have.

    Args:
        n_laminae: how many laminae lie on one another.
        sections: what replaces its sections.
    """
    data: dict[str, Any] = {
        "name": "mixed", "lamina": [lamina | SIZE for lamina in LAMINAE[:n_laminae]],
        "mesh": {"elements": 9}, "excitation": BASE, "stop": STOPS, "impactor": IMPACTORS,
        "point_mass": MASSES, "sensor": SENSORS,
        "contact": {"law": "penalty", "penalty_stiffness": 3e3, "penalty_damping": 0.3},
        "time": {"steps_per_period": 200, "periods": 2}, "output": {"window_periods": 2},
    }  # fmt: skip
    data |= sections
    if data["contact"]["law"] != "penalty":  # all pairs of a case follow one law
        for name in ("stop", "impactor"):
            data[name] = [
                {key: value for key, value in entry.items() if key not in ("stiffness", "damping")}
                for entry in data[name]
            ]
    return Case(**data)


def apart(**sections: Any) -> Case:
    """Return two laminae side by side with a gap between them."""
    gap = {"root": 1e-4, "tip": 2e-3, "exponent": 1.7}
    return mixed(**({"gap": gap} | sections))


def bonded(**sections: Any) -> Case:
    """Return three laminae with two delaminations that overlap."""
    more = {"delamination": CROSSING, "damping": {"rayleigh": "two-mode"}}
    sensors = [*SENSORS, {"name": "g", "quantity": "contact force", "between": ["mid", "top"]}]
    return mixed(3, **(more | {"sensor": sensors, "mesh": {"elements": 14}} | sections))


BEAMS = {
    "apart": apart(
        contact={"law": "penalty", "points_per_element": 3, "penalty_stiffness": 2e3,
                 "penalty_damping": 0.2}, initial=INITIAL,
    ),
    "apart, lumped": apart(
        time={"mass": "lumped", "steps_per_period": 150, "periods": 2}, excitation=FORCE,
        contact={"law": "newton", "impulse": "lumped"}, damping={"rayleigh": "mass"}, impactor=[],
        stop=[STOPS[2] | {"position": 0.5}],
    ),
    "bonded": bonded(
        support=[{"start": "clamped", "end": "pinned"}, *INSIDE], initial=INITIAL,
        delamination=INNER,
    ),
    "bonded, free": bonded(
        support=[{"start": "free", "end": "clamped", "rotational_stiffness": 80.0}],
        delamination=INNER,
        contact={"law": "newton", "points_per_element": 2},
        time={"mass": "lumped", "steps_per_period": 150, "periods": 2},
    ),
    "bonded, force": bonded(
        support=[{"start": "pinned", "end": "free"}, INSIDE[0]], excitation=FORCE,
        damping={"rayleigh": "stiffness"}, stop=[], impactor=[],
    ),
}  # fmt: skip

SOLIDS = {
    "plane stress": bonded(
        model={"kind": "plane-stress", "poisson": 0.21, "layers": 2},
        support=[{"start": "clamped", "end": "pinned"}, *INSIDE], initial=INITIAL[1:],
        delamination=INNER,
    ),
    "plane stress, apart": apart(
        model={"kind": "plane-stress", "poisson": 0.13, "degree": 3}, excitation=FORCE,
        contact={"law": "newton", "points_per_element": 2}, mesh={"elements": 12},
    ),
    "solid": bonded(
        model={"kind": "solid", "poisson": 0.21, "strips": 2}, mesh={"elements": 11},
        damping={"rayleigh": "mass"}, support=[{"start": "pinned", "end": "free"}, INSIDE[0]],
    ),
}  # fmt: skip

BARS = {
    "bars": apart(
        lamina=[lamina | SIZE | {"motion": "axial"} for lamina in LAMINAE[:2]],
        damping={"rayleigh": "every mode"}, point_mass=MASSES[:2], stop=STOPS[:2],
        gap=None, sensor=[], excitation=FORCE,
        delamination=[{"between": ["low", "mid"], "start": 0.0, "end": 0.5, "opening": 3e-4}],
    ),
    "points": apart(
        lamina=[
            {"name": "low", "mass": 2.0, "stiffness": 800.0, "damping_ratio": 0.05},
            {"name": "mid", "mass": 0.7, "stiffness": 500.0, "damping_ratio": 0.02},
        ],
        mesh={"elements": 1}, gap={"tip": 3e-4}, point_mass=[], sensor=[],
        stop=[{"lamina": "mid", "side": "above", "gap": 3e-3, "stiffness": 900.0}],
        impactor=[{"lamina": "low", "mass": 0.3, "side": "below", "gap": 4e-4, "velocity": 0.6}],
        contact={"law": "penalty", "penalty_stiffness": 3e3},
    ),
}  # fmt: skip

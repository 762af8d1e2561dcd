"""Each key of each table changes a result, is refused, or is listed as unread.

Each base is a small case. One key of one of its tables gets another value, and the case is computed
again. Differences that round-off explains do not count as a change.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from copy import deepcopy
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import delam_fem as df
from delam_fem.api import Case, CaseError, assemble, preset, tables, toml_text
from delam_fem.case.keys import Key, KeyTable

ROUND_OFF = 1e-9
"""Largest difference, relative to the largest value of a variable, that is none."""
LENGTH = {"mesh.elements": 4, "time.steps_per_period": 40, "time.periods": 3,
          "output.window_periods": 2, "output.fields_per_period": 4}  # fmt: skip
CLAPS = LENGTH | {"gap.tip": 1e-3, "lamina.thin.bending_stiffness": None}
"""Two laminae that clap within three periods; of the thin one the modulus counts."""
SENSORS = [
    {"name": "place", "lamina": "thin", "position": 0.5, "quantity": "displacement",
     "noise": 1e-4, "sampling_rate": 50.0},
    {"name": "strain", "lamina": "thin", "position": 0.3, "quantity": "strain"},
    {"name": "force", "quantity": "contact force", "between": ["thick", "thin"]},
]  # fmt: skip
BONDED = LENGTH | {"mesh.elements": 10, "delamination.1.opening": 1e-5,
                   "excitation.acceleration": 20.0}  # fmt: skip
SUPPORTS = [
    {"start": "clamped", "end": "pinned", "rotational_stiffness": 50.0},
    {"position": 0.2, "kind": "spring", "stiffness": 100.0, "rotational_stiffness": 1.0,
     "damping": 0.1, "lamina": "lower"},
]  # fmt: skip
BEAM = {"name": "beam", "length": 0.3, "width": 0.02, "thickness": 0.002, "density": 2700.0,
        "young_modulus": 7e10, "damping_ratio": 0.01}  # fmt: skip
SINGLE: dict[str, Any] = {
    "lamina": [BEAM], "gap": None, "contact": {"law": "penalty"}, "mesh.elements": 4,
    "excitation.frequency": 15.0, "output": {"window_periods": 2, "fields_per_period": 4},
    "time": {"scheme": "newmark", "steps_per_period": 200, "periods": 2},
}  # fmt: skip
RIGID = {"contact": {"law": "newton", "restitution": 0.5},
         "time": {"scheme": "moreau-jean", "steps_per_period": 200, "periods": 2}}  # fmt: skip
POINT = SINGLE | RIGID | {"lamina": [{"name": "beam", "mass": 0.1, "stiffness": 100.0,
                                      "damping_ratio": 0.01}],
                          "mesh.elements": 1, "excitation.frequency": 5.0}  # fmt: skip
STOP = {"lamina": "beam", "side": "above", "gap": 1e-3}
STRETCH = STOP | {"side": "below", "start": 0.1, "end": 0.2, "opening": 1e-4, "shape": "power",
                  "stiffness": 500.0}  # fmt: skip
IMPACTOR = {"lamina": "beam", "mass": 0.01, "side": "below", "gap": 1e-3, "velocity": 0.05,
            "spring": 1.0, "spring_damping": 0.1}  # fmt: skip
FORCE = {"kind": "force", "lamina": "thin", "position": 0.6, "amplitude": 0.05, "frequency": 3.0}
SWEPT_FORCE = {"kind": "force", "lamina": "thin", "position": 0.6, "amplitude": 0.05,
               "start_frequency": 3.0, "end_frequency": 5.0, "duration": 0.8}  # fmt: skip
SWEEP = {"kind": "sweep", "amplitude": 2.5e-3, "start_frequency": 3.0, "end_frequency": 5.0,
         "duration": 0.8}  # fmt: skip
BLOW = {"kind": "hammer", "lamina": "thin", "position": 0.6, "amplitude": 5.0, "duration": 0.02}
SECONDS = {"mesh.elements": 4, "gap.tip": 1e-3, "output": {}}
BAND = {"low": 2.0, "high": 12.0}
AT_POINT = {"acts_on": "force", "lamina": "thin", "position": 0.6}

BASES: dict[str, tuple[str, dict[str, Any]]] = {
    "apart": ("default", CLAPS | {
        "time.refine": 4, "sensor": SENSORS, "point_mass": [{"lamina": "thin", "mass": 0.01}],
    }),
    "literal": ("paper", CLAPS),
    "penalty": ("paper", CLAPS | {"contact.law": "penalty", "contact.penalty_damping": 0.1}),
    "linear": ("default", CLAPS | {
        "contact.law": "none", "time.refine": 4,
        "stop": [{"lamina": "thin", "side": "above", "gap": 1e-3, "stiffness": 1e3}],
        "impactor": [{"lamina": "thin", "mass": 0.01, "radius": 0.01, "velocity": 0.1}],
    }),
    "sweep": ("paper", CLAPS | {"excitation": SWEEP}),
    "force": ("paper", CLAPS | {
        "excitation": FORCE, "stop": [{"lamina": "thin", "side": "above", "gap": 1e-3}],
    }),
    "swept force": ("paper", CLAPS | {"excitation": SWEPT_FORCE}),
    "hammer": ("paper", SECONDS | {"excitation": BLOW, "time": {"step": 2e-3, "duration": 0.3}}),
    "table": ("paper", SECONDS | {
        "excitation": {"kind": "table", "file": "base.csv", "acts_on": "base"},
        "time": {"step": 4e-3},
    }),
    "accelerations": ("paper", SECONDS | {
        "excitation": {"kind": "table", "file": "accelerations.csv", "acts_on": "base",
                       "offset": "remove"},
        "time": {"step": 4e-3},
    }),
    "random": ("paper", SECONDS | {
        "excitation": {"kind": "random", **BAND, "rms": 3.0, "duration": 1.0},
        "time": {"steps_per_period": 20},
    }),
    "burst": ("paper", SECONDS | {
        "excitation": {"kind": "burst", **BAND, "rms": 1.0, "duration": 1.0, "share": 0.5,
                       **AT_POINT},
        "time": {"steps_per_period": 20},
    }),
    "multisine": ("paper", SECONDS | {
        "excitation": {"kind": "multisine", **BAND, "spacing": 1.0, "rms": 3.0, "in": "velocity",
                       "realisations": 2, "periods": 1, "lines": "odd-random"},
        "time": {"steps_per_period": 20},
    }),
    "forced multisine": ("paper", SECONDS | {
        "excitation": {"kind": "multisine", **BAND, "spacing": 1.0, "amplitude": 1.0, **AT_POINT},
        "time": {"steps_per_period": 20, "periods": 1},
    }),
    "forced random": ("paper", SECONDS | {
        "excitation": {"kind": "random", **BAND, "rms": 1.0, "duration": 1.0, **AT_POINT},
        "time": {"steps_per_period": 20},
    }),
    "shaken burst": ("paper", SECONDS | {
        "excitation": {"kind": "burst", **BAND, "rms": 3.0, "duration": 1.0},
        "time": {"steps_per_period": 20},
    }),
    "record": ("paper", SECONDS | {
        "excitation": {"kind": "record", "file": "base.csv", "channel": "a", "in": "displacement",
                       "high_pass": 2.0},
        "time": {"step": 4e-3},
    }),
    "forced record": ("paper", SECONDS | {
        "excitation": {"kind": "record", "file": "force.csv", "channel": "a", **AT_POINT},
        "time": {"step": 4e-3},
    }),
    "no drive": ("paper", SECONDS | {
        "excitation": {"kind": "none"}, "time": {"step": 4e-3, "duration": 0.3},
        "initial": [{"shape": "mode", "mode": 1, "velocity": 0.05}],
    }),
    "bonded": ("embedded", BONDED | {
        "delamination.1.shape": "half-cosine", "support": SUPPORTS,
        "initial": [{"shape": "mode", "mode": 2, "velocity": 0.01}],
    }),
    "closed": ("embedded", BONDED | {"delamination.1.opening": 0.0,
                                     "delamination.1.shape": "half-cosine"}),
    "edge": ("edge", BONDED | {"delamination.1.shape": "power", "delamination.1.exponent": 3.0}),
    "plane": ("embedded", BONDED | {"model.kind": "plane-stress", "model.poisson": 0.3}),
    "layers": ("embedded", BONDED | {
        "model.kind": "plane-stress", "lamina.1.material": "cfrp-ud", "lamina.1.angle": 20.0,
        "lamina.2.material": "gfrp-ud",
    }),
    "plate": ("embedded", BONDED | {
        "model": {"kind": "solid", "poisson": 0.3}, "mesh": {"elements": 7, "across": 6},
        "delamination.1.across": [-0.005, 0.003], "delamination.1.shape_in_plane": "ellipse",
        "scan.spacing": [0.1, 0.005],
    }),
    "massless": ("embedded", BONDED | {"time.mass": "massless", "time.refine": 4}),
    "modes": ("embedded", BONDED | {"time.mass": "massless", "model.kind": "modes",
                                    "model.modes": 8}),
    "bar": ("default", SINGLE | RIGID | {
        "lamina": [BEAM | {"motion": "axial", "bending_stiffness": 1.0}],
        "excitation.frequency": 3000.0, "stop": [STOP | {"gap": 1e-4}],
    }),
    "point": ("default", POINT | {
        "stop": [STOP], "point_mass": [{"lamina": "beam", "mass": 0.01}],
    }),
    "elastic stops": ("default", SINGLE | {"stop": [STOP | {"stiffness": 1e3}, STRETCH]}),
    "rigid blows": ("default", SINGLE | RIGID | {"stop": [STOP], "impactor": [IMPACTOR]}),
    "ball": ("default", SINGLE | {"impactor": [
        {"lamina": "beam", "mass": 0.01, "velocity": 0.1, "radius": 0.01}
    ]}),
    "own numbers": ("paper", CLAPS | {
        "gap.restitution": 0.3, "gap.stiffness": 150.0, "gap.threshold_velocity": 1e-3,
        "stop": [STOP | {"lamina": "thin", "stiffness": 500.0, "damping": 0.5}],
        "impactor": [IMPACTOR | {"lamina": "thick", "stiffness": 500.0, "damping": 0.2}],
    }),
    "own springs": ("paper", CLAPS | {"gap.stiffness": 150.0, "gap.damping": 0.5}),
    "own delamination": ("embedded", BONDED | {
        "contact.law": "newton-penalty@newmark", "delamination.1.restitution": 0.3,
        "delamination.1.stiffness": 1e4, "delamination.1.threshold_velocity": 1e-3,
    }),
    "own elastic delamination": ("embedded", BONDED | {
        "contact.law": "newton@newmark", "delamination.1.stiffness": 1e5,
        "delamination.1.damping": 1.0,
    }),
    "own stop": ("paper", CLAPS | {
        "stop": [STOP | {"lamina": "thin", "restitution": 0.3, "threshold_velocity": 1e-3}],
        "impactor": [IMPACTOR | {"lamina": "thick", "restitution": 0.3,
                                 "threshold_velocity": 1e-3}],
    }),
    "loaded": ("embedded", BONDED | {
        "gravity": {"acceleration": 9.0, "inclination": 20.0, "roll": 30.0},
        "load": [
            {"lamina": "lower", "position": 0.2, "force": 0.5},
            {"between": ["lower", "upper"], "start": 0.15, "end": 0.25, "per_length": 20.0},
            {"lamina": "upper", "axial": 5.0},
        ],
    }),
    "nothing touches": ("default", SINGLE | {"contact": {"law": "newton", "restitution": 0.5}}),
}  # fmt: skip
"""Presets with what makes small cases of all kinds of them."""

CHOSEN: dict[str, tuple[object, ...]] = {
    "time.theta": (0.6,),
    "time.beta": (0.3,),
    "time.gamma": (0.55,),
    "output.window_periods": (1,), "contact.threshold_velocity": (0.0, 0.2),
    "time.refine_velocity": (1.0,), "time.most_periods": (77,),
    "lamina.bending_stiffness": (2.0,), "lamina.mass": (0.02,), "lamina.stiffness": (200.0,),
    "lamina.material": ("steel",), "lamina.angle": (33.0,), "lamina.plies": ([90.0, 0.0],),
    "lamina.mass_per_length": (0.2,), "lamina.name": ("other",),
    "gap.root": (2e-4,), "gap.exponent": (3.0,), "gap.file": ("gap.csv",),
    "mesh.file": ("mesh.msh",), "model.file": ("model.npz",), "model.modes": (9,),
    "excitation.low": (3.5,), "excitation.high": (10.0,), "excitation.spacing": (0.5,),
    "excitation.rms": (2.0,), "excitation.psd": ("density.csv",), "excitation.amplitude": (2.0,),
    "excitation.in": ("displacement",), "excitation.channel": ("b",), "excitation.share": (0.7,),
    "excitation.periods": (2,), "excitation.realisations": (3,), "excitation.high_pass": (4.0,),
    "excitation.file": ("other.csv",), "excitation.lamina": ("thick",),
    "excitation.position": (0.5,), "excitation.acceleration": (3.0,),
    "excitation.frequency": (4.0,), "excitation.duration": (0.5,), "excitation.start": (0.03,),
    "excitation.start_frequency": (2.0,), "excitation.end_frequency": (5.0,),
    "point_mass.lamina": ("thick", "beam"), "point_mass.position": (0.4,),
    "stop.lamina": ("thick",), "stop.position": (0.15,), "stop.start": (0.1,), "stop.end": (0.2,),
    "stop.opening": (2e-5,), "stop.exponent": (3.0,), "stop.file": ("stop.csv",),
    "gap.restitution": (0.4,), "gap.stiffness": (222.0,), "gap.damping": (0.2,),
    "gap.threshold_velocity": (0.2,), "delamination.restitution": (0.8,),
    "delamination.stiffness": (5e4,), "delamination.damping": (3.0,),
    "delamination.threshold_velocity": (0.2,), "stop.restitution": (0.8,),
    "stop.threshold_velocity": (0.5,), "impactor.restitution": (0.8,),
    "impactor.threshold_velocity": (0.5,),
    "stop.damping": (0.3,), "stop.stiffness": (200.0,), "impactor.lamina": ("thick",),
    "impactor.position": (0.15,), "impactor.stiffness": (200.0,), "impactor.damping": (0.3,),
    "impactor.gap": (7e-4,), "impactor.radius": (0.02,), "impactor.spring": (2.0,),
    "impactor.spring_damping": (0.2,), "initial.lamina": ("lower",), "initial.position": (0.2,),
    "initial.displacement": (1e-5,), "sensor.name": ("other",), "sensor.lamina": ("thick",),
    "sensor.between": (["thin", "thick"],), "sensor.stop": (1,), "sensor.impactor": (1,),
    "sensor.mass": (0.05,), "sensor.resonance": (40.0,), "sensor.resonance_damping": (0.3,),
    "sensor.corner": (20.0,), "sensor.order": (3,), "sensor.range": (1e-4,), "sensor.bits": (8,),
    "sensor.noise": (1e-3,), "sensor.seed": (3,), "sensor.sampling_rate": (60.0,),
    "support.rotational_stiffness": (70.0,), "support.lamina": ("upper",),
    "support.stiffness": (70.0,), "support.damping": (0.3,), "support.position": (0.3,),
    "delamination.between": (["upper", "lower"],), "delamination.start": (0.11,),
    "delamination.exponent": (3.0,), "delamination.file": ("gap.csv",),
    "delamination.opening": (2e-5,), "time.step": (3e-3,), "time.duration": (0.5,),
    "mesh.across": (7,), "delamination.across": ([-0.004, 0.003],), "support.side": ("end",),
    "model.poisson": (0.2,), "model.degree": (3,), "model.layers": (2,), "model.strips": (2,),
    "contact.restitution": (0.4,), "contact.points_per_element": (2,),
    "contact.penalty_stiffness": (222.0,), "contact.penalty_damping": (0.2,),
    "load.lamina": ("upper",), "load.between": (["upper", "lower"],),
    "scan.lamina": ("lower",), "scan.surface": ("bottom",), "scan.spacing": ([0.08, 0.004],),
    "scan.file": ("points.csv",),
    "scan.points": ([[0.04 * k, 0.001 * (-1) ** k] for k in range(1, 10)],),
}  # fmt: skip
"""Other values of keys; of keys that a base has, numbers get 0.8 of their value."""
SHOWN_BY = {
    "gap.restitution": "own numbers", "gap.stiffness": "own numbers",
    "gap.threshold_velocity": "own numbers", "gap.damping": "own springs",
    "delamination.restitution": "own delamination",
    "delamination.threshold_velocity": "own delamination",
    "delamination.stiffness": "own elastic delamination",
    "delamination.damping": "own elastic delamination",
    "stop.restitution": "own stop", "stop.threshold_velocity": "own stop",
    "impactor.restitution": "own stop", "impactor.threshold_velocity": "own stop",
    "time.beta": "literal",
    "time.gamma": "literal",
    "contact.threshold_velocity": "literal", "contact.penalty_damping": "penalty",
    "contact.penalty_stiffness": "penalty", "time.refine_velocity": "apart",
    "excitation.lamina": "force", "excitation.position": "force",
    "time.begin": "loaded", "time.most_periods": "apart", "model.poisson": "plane",
    "lamina.angle": "layers", "lamina.plies": "layers",
    "impactor.radius": "ball", "mesh.across": "plate", "delamination.across": "plate",
    "delamination.shape_in_plane": "plate",
}  # fmt: skip
"""Bases that show the effect of keys that do not always have one; of others the first base."""


@pytest.fixture(scope="module", autouse=True)
def files(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Work in a folder with the tables that the bases name."""
    folder = tmp_path_factory.mktemp("unread")
    time = np.arange(60) * 0.01
    for name, size in (("base.csv", 1.0), ("other.csv", 0.7)):
        rows = np.column_stack([time, size * np.sin(100.0 * time / 3.0)]).tolist()
        text = "".join(f"{t!r}, {a!r}\n" for t, a in rows)
        (folder / name).write_text(f"time [s], a [mm]\n{text}", encoding="utf-8")
    wave = np.sin(40.0 * time).tolist()
    for name, unit, mean in (("force.csv", "N", 0.0), ("accelerations.csv", "m/s2", 2.0)):
        text = "".join(f"{t!r}, {mean + a!r}\n" for t, a in zip(time.tolist(), wave, strict=True))
        (folder / name).write_text(f"time [s], a [{unit}]\n{text}", encoding="utf-8")
    (folder / "density.csv").write_text("f [Hz], S [m2/s4/Hz]\n1, 1\n20, 2\n", encoding="utf-8")
    points = "\n".join(f"{0.04 * k},{0.001 * (-1) ** k}" for k in range(1, 10))
    (folder / "points.csv").write_text(f"x,z\n{points}\n", encoding="utf-8")
    (folder / "gap.csv").write_text("x [m], gap [m]\n0, 0.0005\n0.685, 0.001\n", encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield


def base_case(name: str) -> Case:
    """Return the case of a base."""
    of, keys = BASES[name]
    return preset(of, keys)


@cache
def tables_of_base(name: str) -> dict[str, Any]:
    """Return what the case file of a base has; to be copied before it is changed."""
    content = base_case(name).model_dump(exclude_unset=True, exclude_none=True)
    return tomllib.loads(toml_text(content))


Numbers = dict[str, NDArray[Any]]


def numbers_of(case: Case) -> Numbers:
    """Return what a run computes, without what the case itself says and without times."""
    result = df.run(case, structure=assemble(case, needs_dolfinx=False))
    variables = result.history.variables
    numbers: Numbers = {str(name): values.to_numpy() for name, values in variables.items()}
    del numbers["heat"]
    numbers.pop("stop_on_base", None)
    for name in (
        "tip_min",
        "tip_max",
        "tip_amplitude",
        "impacts_per_period",
        "periods",
        "settling",
    ):
        numbers[f"summary {name}"] = np.array(str(result.summary[name]))
    return numbers


@cache
def numbers_of_base(name: str) -> Numbers:
    """Return what the run of a base computes."""
    return numbers_of(base_case(name))


def differs(before: Numbers, now: Numbers) -> bool:
    """Return whether numbers differ by more than round-off, or in their names, shapes or words."""
    names = [name for name in before if not name.startswith("summary")]
    if before.keys() != now.keys():
        return True
    for name in names:
        one, other = before[name], now[name]
        if one.shape != other.shape:
            return True
        if one.dtype.kind != "f":
            if not np.array_equal(one, other):
                return True
            continue
        largest = max(np.nanmax(np.abs(one), initial=0.0), np.finfo(float).tiny)
        is_energy = name.startswith(("energy", "event_energy"))  # sums of small differences
        tolerance = (1e3 if is_energy else 1.0) * ROUND_OFF * largest
        if not np.allclose(one, other, rtol=0.0, atol=tolerance, equal_nan=True):
            return True
    return False


def entries_of(data: dict[str, Any], table: KeyTable) -> list[dict[str, Any]]:
    """Return the tables of a case that a model checks, in place; a missing one is made."""
    if table.is_array or table.name == "support":
        entries = data.get(table.name, [])
        entries = entries if isinstance(entries, list) else [entries]
        if table.name != "support":
            return list(entries)
        return [entry for entry in entries if ("position" in entry) == table.is_array]
    entry = data.setdefault(table.name, {})
    return [entry] if table.name != "excitation" or entry.get("kind") == table.kind else []


def others(table: KeyTable, key: Key, entry: dict[str, Any]) -> tuple[object, ...]:
    """Return other values of a key."""
    present = entry.get(key.name, key.default)
    if key.choices:
        return tuple(choice for choice in key.choices if choice != present)
    chosen = CHOSEN.get(f"{table.name}.{key.name}", ())
    different = tuple(value for value in chosen if value != present)
    if different:
        return different
    if isinstance(present, bool | str) or present is None:
        return ()
    return (present + 1,) if isinstance(present, int) else (0.8 * present,)


TRIALS = [
    pytest.param(
        table,
        key,
        id=f"{table.name}-{table.kind or table.model.__name__}-{key.name}",
        marks=pytest.mark.slow if SHOWN_BY.get(f"{table.name}.{key.name}") == "plate" else (),
    )
    for table in tables()
    for key in table.keys
    if table.name and key.name != "kind"
]


def bases_with(table: KeyTable, key: Key) -> list[str]:
    """Return the bases that have a table, the one that shows the effect of a key first."""
    names = [name for name in BASES if entries_of({**tables_of_base(name)}, table)]
    first = SHOWN_BY.get(f"{table.name}.{key.name}")
    return sorted(names, key=lambda name: name != first)


def effects(name: str, table: KeyTable, key: Key) -> Iterator[tuple[str, object]]:
    """Yield what comes of each other value of a key in each table of a base."""
    before = deepcopy(tables_of_base(name))
    for number, entry in enumerate(entries_of(before, table)):
        for value in others(table, key, entry):
            data = deepcopy(before)
            changed = entries_of(data, table)[number]
            changed[key.name] = value
            try:
                case = Case.checked(data, "case").with_files_checked("case")
                numbers = numbers_of(case)
            except CaseError:
                yield "refused", value
                continue
            entry_name = changed.get("name", number + 1)
            place = f"{table.name}.{entry_name}" if table.is_array else table.name
            is_changed = differs(numbers_of_base(name), numbers)
            if f"{place}.{key.name}" in case.unread:
                yield "listed, but changes a result" if is_changed else "listed", value
            else:
                yield "changes a result" if is_changed else "silent", value


@pytest.mark.parametrize(("table", "key"), TRIALS)
def test_a_key_changes_a_result_is_refused_or_is_listed(table: KeyTable, key: Key) -> None:
    name = bases_with(table, key)[0]
    outcomes = list(effects(name, table, key))
    assert outcomes, "no other value is known: add one to CHOSEN"
    words = {word for word, _ in outcomes}
    assert "listed, but changes a result" not in words, (name, outcomes)
    assert words != {"silent"}, (name, outcomes)


@pytest.mark.nightly
@pytest.mark.parametrize(("table", "key"), TRIALS)
def test_a_key_that_is_listed_changes_no_result_of_any_base(table: KeyTable, key: Key) -> None:
    for name in bases_with(table, key):
        outcomes = list(effects(name, table, key))
        assert "listed, but changes a result" not in {word for word, _ in outcomes}, (
            name,
            outcomes,
        )


@pytest.mark.parametrize(
    ("name", "listed"),
    [
        ("linear", {"stop.1.stiffness", "impactor.1.radius", "time.refine"}),
        ("bar", {"lamina.beam.bending_stiffness"}),
        ("point", {"damping.rayleigh"}),
        ("closed", {"delamination.1.shape"}),
        ("nothing touches", {"contact.restitution"}),
    ],
)
def test_what_has_no_effect_is_listed(name: str, listed: set[str]) -> None:
    assert listed <= set(base_case(name).unread)


@pytest.mark.parametrize("name", BASES)
def test_a_case_that_is_written_and_read_lists_the_same_keys(name: str) -> None:
    case = base_case(name)
    again = Case.from_toml(case.to_toml())
    assert again == case
    assert again.unread == case.unread

"""Random solids with random features: every signal on several ranks is that of one.

Differences are relative to the largest signal of a quantity.
"""

from __future__ import annotations

import json
import random
from typing import Any

import pytest
from mpi_pool import Crew

from delam_fem.api import COMBINATIONS, Case

L = 0.5
LOWER = {
    "name": "lower", "length": L, "width": 0.02, "thickness": 0.005, "mass_per_length": 0.1,
    "bending_stiffness": 10.0, "damping_ratio": 0.01,
}  # fmt: skip
UPPER = LOWER | {"name": "upper", "bending_stiffness": 4.0}
BATCH = 5
"""Cases of one program."""

PROGRAM = """
import json
import numpy as np
import delam_fem as df
from delam_fem.cli.endings import ended_together

failures = []


def run(case, **further):
    try:
        return df.run(case, engine, **further), None
    except df.CaseError as error:
        return None, str(error)


with ended_together(comm):
    for seed, engine, data in json.loads(arguments[0]):
        case = df.Case(**data)
        one, refusal = run(case) if comm.rank == 0 else (None, None)
        refusal = comm.bcast(refusal)
        if refusal:
            failures.append(f"{seed}: refused on one rank: {refusal}")
            continue
        many, refusal = run(case, comm=comm)
        if refusal:
            failures.append(f"{seed}: refused on ranks: {refusal}")
        elif comm.rank == 0:
            one, many = one.history, many.history
            signals = [n for n in one if str(n).startswith(("tip_", "sensor_", "energy_", "imp"))]
            # a strain where nothing bends has no size of its own
            sizes = {}
            for name in (n for n in signals if one[n].dtype.kind == "f"):
                kind = name.removesuffix("-lower").removesuffix("-upper")
                size = np.abs(np.nan_to_num(one[name].values)).max(initial=0.0)
                sizes[kind] = max(size, sizes.get(kind, 0.0))
            for name in (n for n in signals if one[n].dtype.kind == "f"):
                a, b = (np.nan_to_num(history[name].values) for history in (one, many))
                if a.shape != b.shape:
                    failures.append(f"{seed}: {name}: shapes {a.shape}, {b.shape}")
                    continue
                size = sizes[name.removesuffix("-lower").removesuffix("-upper")]
                off = np.abs(a - b).max(initial=0.0) / (size or 1.0)
                if name.startswith("energy_residual") or off <= LIMIT:
                    continue
                failures.append(f"{seed}: {name}: {off:.1e}")
    assert not failures, "\\n".join(failures)
"""


def case_of(seed: int) -> tuple[str, Case]:
    """Return the engine and a case with a few features, drawn with a seed."""
    draw = random.Random(seed)

    def likely(share: float) -> bool:
        return draw.random() < share

    kind = draw.choice(["plane-stress", "plane-stress", "solid"])
    law, scheme = draw.choice(sorted(COMBINATIONS))
    is_bonded = likely(0.5)
    contact: dict[str, Any] = {"law": law}
    if law != "none":
        contact["impulse"] = "consistent"
    if "penalty" in law:
        contact["penalty_stiffness"] = 2e3
    if law == "newton-penalty":
        contact["threshold_velocity"] = 1e-3
    data: dict[str, Any] = {
        "name": f"random{seed}",
        "lamina": [LOWER, UPPER],
        "mesh": {"elements": draw.randint(5, 9)},
        "model": {"kind": kind, "poisson": 0.0, "degree": 2},
        "contact": contact,
        "time": {"scheme": scheme, "steps_per_period": 60, "periods": 1},
        "output": {"window_periods": 1, "fields_per_period": draw.choice([0, 3])},
    }
    if is_bonded:
        data["delamination"] = [
            {"between": ["lower", "upper"], "start": 0.2, "end": L, "opening": 1e-4,
             "shape": "power"}
        ]  # fmt: skip
    else:
        data["gap"] = {"tip": 4e-4}
    force = {"kind": "force", "lamina": draw.choice(["lower", "upper"]), "position": 0.42}
    data["excitation"] = draw.choice(
        [
            {"kind": "harmonic", "amplitude": 4e-4, "frequency": 20.0},
            force | {"amplitude": 0.5, "frequency": 20.0},
            {"kind": "sweep", "amplitude": 4e-4, "start_frequency": 15.0, "end_frequency": 30.0,
             "duration": 0.05},
            {"kind": "hammer", "lamina": "upper", "position": 0.42, "amplitude": 1.0,
             "duration": 4e-3},
            {"kind": "multisine", "low": 20.0, "high": 60.0, "spacing": 20.0, "rms": 2e-4},
        ]
    )  # fmt: skip
    if data["excitation"]["kind"] in ("sweep", "hammer"):
        data["time"] = {"scheme": scheme, "step": 8e-4, "duration": 0.05}
        data["output"]["window_periods"] = 100
    if scheme == "central-difference":  # its steps are short beside any motion of a lamina
        data["excitation"] = {
            "kind": "hammer", "lamina": "upper", "position": 0.42, "amplitude": 10.0,
            "duration": 3e-6,
        }  # fmt: skip
        data["time"] = {"scheme": scheme, "step": 5e-8, "duration": 5e-6}
        data["output"]["window_periods"] = 100
    if likely(0.3) and scheme != "central-difference" and law != "none":
        data["time"]["refine"] = draw.choice([2, 4])
    if likely(0.3):
        data["point_mass"] = [{"lamina": "upper", "mass": 0.02, "position": 0.3}]
    if likely(0.3):
        data["support"] = [
            {"position": 0.1, "kind": "spring", "stiffness": 2e3, "damping": 0.5}
            if likely(0.5)
            else {"position": 0.1, "kind": "pinned"}
        ]
    if likely(0.3):
        data["stop"] = [{"lamina": "upper", "position": 0.45, "side": "above", "gap": 2e-4}]
    if likely(0.3):
        data["impactor"] = [
            {"lamina": "upper", "position": 0.4, "mass": 0.01, "velocity": 0.3, "gap": 1e-3}
        ]
    if likely(0.3):
        data["initial"] = [
            draw.choice(
                [
                    {"velocity": 0.05},
                    {"shape": "mode", "mode": 2, "displacement": 4e-7},
                    {"shape": "force", "lamina": "upper", "position": L, "displacement": 4e-7},
                ]
            )
        ]
    data["sensor"] = [
        {"name": f"{quantity}-{lamina}", "quantity": quantity, "lamina": lamina, "position": x}
        for quantity in ("displacement", "velocity", "acceleration", "strain")
        for lamina, x in (("lower", 0.43), ("upper", 0.26))
    ]
    if law != "none":
        data["sensor"] += [
            {"name": "contact", "quantity": "contact force", "between": ["lower", "upper"]}
        ]
    engine = draw.choice(["petsc", "petsc", "compiled"])
    if likely(0.2) and "initial" not in data:
        data["gravity"] = {"acceleration": 0.2}
    if likely(0.2) and "initial" not in data:
        data["load"] = [{"lamina": "upper", "position": 0.3, "force": 0.02}]
    return engine, Case.model_validate(data)


def compared(seeds: range, ranks: int, crew: Crew) -> None:
    cases = [(seed, *case_of(seed)) for seed in seeds]
    data = [
        (k, engine, case.model_dump(mode="json", exclude_unset=True)) for k, engine, case in cases
    ]
    crew.run(ranks, "LIMIT = 1e-7\n" + PROGRAM, json.dumps(data))


@pytest.mark.mpi
@pytest.mark.slow
def test_a_few_random_solids_are_the_same_on_two_ranks(crew: Crew) -> None:
    compared(range(4), 2, crew)


@pytest.mark.mpi
@pytest.mark.nightly
@pytest.mark.parametrize("batch", range(12))
def test_random_solids_are_the_same_on_ranks(batch: int, crew: Crew) -> None:
    """Every sixth case runs on three ranks."""
    compared(range(BATCH * batch, BATCH * batch + BATCH), 3 if batch % 6 == 5 else 2, crew)

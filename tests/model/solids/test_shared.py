"""What ranks assemble together has the numbers of one rank, and no rank has it as a whole."""

from __future__ import annotations

import numpy as np
import pytest
from mpi_pool import Crew
from plates import patched, plate

from delam_fem.api import Case, assemble, lowest

RANKS = pytest.mark.parametrize("ranks", [2, 3])

DAMPING = """
import json
import numpy as np
from delam_fem.api import Case, assemble
from delam_fem.cli.endings import ended_together

with ended_together(comm):
    for data in json.loads(arguments[0]):
        case = Case(**data)
        many = assemble(case, comm=comm).operators
        assert many.n_own < many.n_dofs
        one = comm.bcast(assemble(case).operators.rayleigh if comm.rank == 0 else None)
        for values, of_all in zip(many.rayleigh, one):
            assert of_all[0] > 0.0
            assert np.allclose(values, of_all[0], rtol=1e-9, atol=0.0)
"""


RUNS = """
import json
import numpy as np
import delam_fem as df
from delam_fem.api import Case, assemble, largest_stable_time_step
from delam_fem.cli.endings import ended_together

CLOSE = 1e-7  # of the largest value of a signal


def off(one, many):
    one, many = (np.nan_to_num(np.array(values, dtype=float)) for values in (one, many))
    return np.abs(one - many).max(initial=0.0) / (np.abs(one).max(initial=0.0) or 1.0)


with ended_together(comm):
    for data in json.loads(arguments[0]):
        case = Case(**data)
        structure = assemble(case, comm=comm)
        o = structure.operators
        assert o.n_own < o.n_dofs
        limit = largest_stable_time_step(o, 1e4)
        many = df.run(case, comm=comm)
        if comm.rank > 0:
            continue
        limits = largest_stable_time_step(assemble(case).operators, 1e4), limit
        assert off(*limits) < 1e-9, limits
        one = df.run(case)
        assert one.history.event_time.size == many.history.event_time.size
        for name in one.history:
            if str(name).startswith(("tip_", "sensor_", "displacement", "impactor_", "contact_f")):
                a, b = (run.history[name].to_numpy() for run in (one, many))
                assert off(a, b) < CLOSE, (case.name, name, off(a, b))
"""


def sent(*cases: Case) -> str:
    """Return cases as an argument of a program of ranks."""
    return "[" + ", ".join(case.model_dump_json(exclude_unset=True) for case in cases) + "]"


@pytest.mark.mpi
@RANKS
def test_damping_of_plates_has_the_coefficients_of_one_rank(ranks: int, crew: Crew) -> None:
    """With pairs to keep closed; without any, and floating."""
    crew.run(ranks, DAMPING, sent(patched(6), plate({}, 3, 3)))


def test_modes_need_no_damping() -> None:
    case = patched(6)
    with_damping, without = (
        assemble(case, needs_damping=needed).operators for needed in (True, False)
    )
    assert with_damping.damping.nnz and not without.damping.nnz
    assert not without.base.damping.any() and without.rayleigh is None
    frequencies = [lowest(o.stiffness, o.mass, 4)[0] for o in (with_damping, without)]
    assert np.array_equal(*frequencies)


SHORT = {
    "time": {"steps_per_period": 60, "periods": 1},
    "output": {"fields_per_period": 4, "window_periods": 1},
    "contact": {"law": "newton@newmark", "impulse": "consistent"},
}  # fmt: skip


def strips(**sections: object) -> Case:
    """Return two clamped strips in plane stress with a gap, on a base that moves."""
    strip = {"length": 0.5, "width": 0.02, "thickness": 0.005, "density": 2700.0,
             "young_modulus": 7e10, "damping_ratio": 0.01}  # fmt: skip
    data: dict[str, object] = {
        "name": "strips", "lamina": [strip | {"name": name} for name in ("lower", "upper")],
        "gap": {"tip": 4e-4}, "mesh": {"elements": 6},
        "model": {"kind": "plane-stress", "poisson": 0.0},
        "excitation": {"kind": "harmonic", "amplitude": 4e-4, "frequency": 20.0},
    }  # fmt: skip
    return Case.model_validate(data | SHORT | sections)


@pytest.mark.mpi
@RANKS
def test_ranks_share_central_differences(ranks: int, crew: Crew) -> None:
    """The limit of stability is that of one rank, with springs; a blow of some steps follows."""
    blow = {"kind": "hammer", "lamina": "upper", "position": 0.42, "amplitude": 10.0,
            "duration": 3e-6}  # fmt: skip
    case = strips(
        time={"scheme": "central-difference", "step": 5e-8, "duration": 5e-6},
        contact={"law": "penalty", "penalty_stiffness": 2e3, "impulse": "consistent"},
        excitation=blow, output={"window_periods": 100, "fields_per_period": 0},
    )  # fmt: skip
    crew.run(ranks, RUNS, sent(case))


@pytest.mark.mpi
@RANKS
def test_ranks_share_solids_that_impactors_strike(ranks: int, crew: Crew) -> None:
    """A free one, one on a spring of the base, and a stop there, which changes all dofs."""
    free = {"lamina": "upper", "position": 0.45, "mass": 0.01, "velocity": 0.3, "gap": 1e-3}
    ball = {"lamina": "lower", "position": 0.4, "side": "below", "mass": 0.02, "gap": 1e-3,
            "spring": 500.0, "on": "base", "stiffness": 2e4}  # fmt: skip
    stop = {"lamina": "upper", "position": 0.3, "side": "above", "gap": 3e-4}
    crew.run(ranks, RUNS, sent(strips(impactor=[free, ball], stop=[stop])))


@pytest.mark.mpi
@pytest.mark.slow
@RANKS
def test_ranks_share_a_plate_that_an_impactor_strikes(ranks: int, crew: Crew) -> None:
    ball = {"lamina": "upper", "position": [0.09, 0.02], "side": "above", "mass": 0.005,
            "velocity": 0.5, "gap": 1e-5, "radius": 0.01}  # fmt: skip
    crew.run(ranks, RUNS, sent(patched(6, impactor=[ball], **SHORT)))

"""Solids on several ranks: the motion of one rank over the first impacts, and runs that go on."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi_pool import Crew

SCRIPT = """
import os, signal
import numpy as np
import delam_fem as df
from delam_fem.cli.endings import ended_together

ROUND_OFF = 1e-8  # of 2 cm; bending is a small difference of large forces in a sheet of 1 mm

kind, folder = arguments
keys = {"model.kind": kind, "mesh.elements": 6, "time.periods": 2, "time.steps_per_period": 40}
keys |= {"contact.law": "newton@moreau-jean", "contact.impulse": "consistent"}
case = df.preset("paper", keys | {"output.fields_per_period": 4})


def interrupt(period, periods):
    if period == 1:
        os.kill(os.getpid(), signal.SIGINT)


with ended_together(comm):
    many = df.run(case, comm=comm)
    shared = comm.bcast(many.history)
    assert shared.equals(many.history)  # all ranks have the same bits
    if comm.rank == 0:
        one = df.run(case).history
        first = np.unique(one.event_time)[:3]  # the first three impacts
        assert np.allclose(first, np.unique(many.history.event_time)[:3], rtol=1e-12)
        until = one.time.values <= first[-1]
        for name in ("tip_displacement", "displacement"):
            rows = until if name == "tip_displacement" else slice(0, 1)
            a, b = (h[name].values for h in (one, many.history))
            a, b = (x[:, rows] for x in (a, b))
            assert np.abs(a - b).max() < ROUND_OFF, np.abs(a - b).max()
        for name in ("envelope_max", "impulse_sum", "energy_damping_loss"):
            a, b = (h[name].values for h in (one, many.history))
            assert np.allclose(a, b, rtol=1e-3), name

    cut = df.run(case, comm=comm, directory=folder, progress=interrupt)
    assert cut.summary["outcome"] == "interrupted"
    comm.Barrier()
    again = df.run(case, comm=comm, directory=folder, resume=True)
    if comm.size == 2:  # a lamina on each rank, with a factor of its own
        assert again.history.equals(many.history)
        assert np.array_equal(again.state.motion, many.state.motion)
    else:  # a distributed factor adds what several ranks send in the order of its arrival
        a, b = (h.tip_displacement.values for h in (again.history, many.history))
        assert np.abs(a - b).max() < ROUND_OFF
        assert np.allclose(again.state.motion, many.state.motion, rtol=1e-5, atol=1e-6)

    # another number of ranks goes on, either way
    calm = case.with_overrides({"contact.law": "none@newmark", "time.periods": 3})
    whole = df.run(calm, comm=comm)
    for former in (True, False):
        place = os.path.join(folder, str(former))
        if (comm.rank == 0) or former:
            cut = {"directory": place, "progress": interrupt}
            kept = df.run(calm, **cut, **({"comm": comm} if former else {}))
            assert kept.summary["outcome"] == "interrupted"
        comm.Barrier()
        if comm.rank == 0 or not former:
            ended = df.run(calm, directory=place, resume=True, **({} if former else {"comm": comm}))
            for name in ("tip_displacement", "tip_velocity", "energy_strain"):
                a, b = (history[name].values for history in (ended.history, whole.history))
                assert np.abs(a - b).max() <= 1e-7 * np.abs(a).max(), name
            off = np.abs(ended.state.motion[0] - whole.state.motion[0]).max()
            assert off < ROUND_OFF, off
        comm.Barrier()
"""


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("kind", "ranks"),
    [
        pytest.param("plane-stress", 2, marks=pytest.mark.nightly),
        ("plane-stress", 3),
        pytest.param("solid", 2, marks=pytest.mark.nightly),
        pytest.param("solid", 3, marks=pytest.mark.nightly),
    ],
)
def test_ranks_share_a_solid(kind: str, ranks: int, crew: Crew, tmp_path: Path) -> None:
    crew.run(ranks, SCRIPT, kind, tmp_path)

"""The PETSc engine on several ranks: histories of one rank, with and without coupled ranks."""

from __future__ import annotations

import pytest
from mpi_pool import Crew

SCRIPT = """
from dataclasses import replace

import numpy as np
from delam_fem.case.files import preset
from delam_fem.contact.decisions import PairNumbers
from delam_fem.engines.session import scheme_of
from delam_fem.engines.session import solve
from delam_fem.model.beams import closed_form
from delam_fem.model.operators import DistributedOperators, matrix
from delam_fem.model.operators import BaseCoupling
from delam_fem.case.excitation import drive
from delam_fem.simulation.refinement import Refinement

STEPS = 200


def numbers_of(n):
    none = np.full(n, np.nan)
    e = np.linspace(0.3, 0.6, n)
    return PairNumbers(np.zeros(n, bool), e, none, none, np.ones(n))


def compare(way, law, impulse, refine, numbers):
    keys = {"time.periods": 2, "time.steps_per_period": STEPS, "mesh.elements": 6}
    case = preset("paper", keys | {"contact.law": law, "contact.impulse": impulse})
    structure = closed_form.assemble(case)
    o = structure.operators
    if numbers == "own":
        o = replace(o, pair_numbers=numbers_of(o.n_pairs))
    given = o
    if way == "uncoupled":  # each lamina on a rank of its own; further ranks have no dofs
        laminae = [part.own_dofs for part in structure.layout.parts]
        of_rank = [*laminae, *[np.zeros(0, int)] * (comm.size - 2)]
        order, own = np.concatenate(of_rank), of_rank[comm.rank]
        M, C, K = (matrix(m.tocsr()[own][:, order], comm) for m in (o.mass, o.damping, o.stiffness))
        b = o.base
        given = DistributedOperators(
            M, C, K, BaseCoupling(b.mass[own], b.damping[own], b.stiffness[own], b.corner),
            o.gap_matrix[:, own], o.gap0, o.lumped_mass[own], o.pair_weights,
            o.probes[:, own], comm=comm, is_uncoupled=True,
            pair_numbers=o.pair_numbers,
        )
    options = dict(steps_per_period=STEPS, periods=2, time_step=case.time_step, frames_per_period=4,
                   refinement=Refinement(int(refine)))
    args = case.contact_law, scheme_of(case), drive(case.excitation)
    one = solve(o, *args, **options)
    both = solve(given, *args, **options, comm=comm)
    assert one.recorder.window[0].jumps.columns().ticks.size > 0
    for mine, its in zip(one.recorder.window, both.recorder.window, strict=True):
        a, b = mine.jumps.columns(), its.jumps.columns()
        assert np.array_equal(a.ticks, b.ticks) and np.array_equal(a.hit, b.hit)
        scale = np.abs(mine.u).max(axis=0)
        assert (np.abs(mine.u - its.u).max(axis=0) <= 1e-9 * scale).all(), (mine.u - its.u) / scale
        own = its.u, its.v, b.impulses
        assert all(np.array_equal(x, y) for x, y in zip(comm.bcast(own), own, strict=True))
    if numbers == "own":  # each pair leaves with its own e
        jumps = one.recorder.window[0].jumps.columns()
        e = -jumps.rate_post / jumps.rate_pre
        assert np.allclose(e, o.pair_numbers.restitution[jumps.hit], atol=1e-9), e
        assert e.min() > 0.29 > case.contact.restitution, e
    ledger = one.recorder.ledger
    assert np.allclose(ledger, both.recorder.ledger, rtol=1e-6, atol=1e-9 * ledger.max())
    assert both.recorder.energy_residual() < 1e-9
    frame = comm.allgather(both.recorder.window[0].frames[1])
    if way == "uncoupled":
        expected = one.recorder.window[0].frames[1][:, order]
        assert np.allclose(np.concatenate(frame, axis=1), expected, rtol=1e-8, atol=1e-10)


for words in arguments:
    compare(*words.split())
"""


HALVES = "uncoupled newton-penalty lumped 1 law"
REFINED = "uncoupled newton@moreau-jean consistent 4 law"
SLICES = "sliced newton@moreau-jean consistent 1 law"
OWN = "uncoupled newton lumped 1 own"


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [pytest.param(2, marks=pytest.mark.nightly), 3])
def test_ranks_have_the_histories_of_one(ranks: int, crew: Crew) -> None:
    """The third rank has no dofs where the laminae are apart, and a slice of both elsewhere."""
    crew.run(ranks, SCRIPT, HALVES, REFINED, SLICES, OWN)

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

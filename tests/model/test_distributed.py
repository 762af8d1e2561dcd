"""Operators spread over ranks: what a rank owns, and shapes that do not fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delam_fem import DistributedOperators
from delam_fem.api import MPI, assemble, preset
from delam_fem.model.operators import gather, spread


@pytest.fixture
def alone() -> DistributedOperators:
    return spread(assemble(preset("paper"), needs_dolfinx=False).operators, MPI.COMM_SELF)


def test_a_single_rank_owns_everything(alone: DistributedOperators) -> None:
    o = assemble(preset("paper"), needs_dolfinx=False).operators
    assert (alone.n_own, alone.own) == (o.n_dofs, slice(0, o.n_dofs))
    x = np.arange(o.n_dofs) / o.n_dofs
    vector, image = alone.stiffness.createVecs()
    vector.array[:] = x
    alone.stiffness.mult(vector, image)
    assert image.array == pytest.approx(o.stiffness @ x)
    assert np.array_equal((alone.observed @ x), o.observed @ x)
    assert np.array_equal(gather(x, alone.comm), x)


@pytest.mark.parametrize("name", ["gap_matrix", "probes", "lumped_mass"])
def test_columns_of_other_dofs_are_refused(name: str, alone: DistributedOperators) -> None:
    wrong = getattr(alone, name)[..., :-1]
    with pytest.raises(ValueError, match=f"distributed operators: {name} has shape"):
        replace(alone, **{name: wrong})


def test_impulses_on_a_missing_lumped_mass_are_refused(alone: DistributedOperators) -> None:
    with pytest.raises(ValueError, match="lumped_mass is missing"):
        replace(alone, lumped_mass=None).require_lumped_mass()

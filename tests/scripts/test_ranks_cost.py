"""The script that measures large bodies on ranks, in its short form."""

from __future__ import annotations

import pytest
from project import script

NODES_OF_COLUMN = 5
"""Of two bonded laminae with one quadratic cell each."""


def test_modes_and_reduction_of_a_short_plate_agree() -> None:
    ranks_cost = script("ranks_cost")
    mesh = (ranks_cost.SHORT, 2, 1)
    modes, reduction = (ranks_cost.measured("plate", mesh, job) for job in ("modes", "reduce"))
    assert reduction["first_hz"] == pytest.approx(modes["first_hz"], rel=1e-6)
    held_ends = 2
    nodes = (2 * ranks_cost.SHORT + 1 - held_ends) * 5 * NODES_OF_COLUMN
    assert reduction["dofs"] > 3 * nodes  # laminae that are apart have nodes of their own
    assert reduction["coordinates"] <= ranks_cost.N_MODES + reduction["pairs"] + 3
    assert len(modes["peak_mb"]) == len(modes["cpu_s"]) == 1

"""The columns in which impacts are kept."""

from __future__ import annotations

import numpy as np

from delam_fem import Decision
from delam_fem.simulation.recorder import Columns, Jumps


def decision(*pairs: int) -> Decision:
    """Return impulses on some pairs, all numbers of which tell the pair."""
    hit = np.array(pairs)
    return Decision(hit, 0.5 * hit, -1.0 * hit, 0.25 * hit)


GIVEN = [(3, (4, 5), -1e-3), (7, (2,), 2e-3), (7, (9, 1, 6), -4e-3)]
"""Instant, pairs and energy of impacts in the order of time."""


def jumps() -> Jumps:
    made = Jumps()
    for instant, pairs, energy in GIVEN:
        made.append(instant, decision(*pairs), energy)
    return made


def told(table: Columns) -> list[tuple[int, tuple[int, ...], float]]:
    """Return instants, pairs and energies; the other numbers must belong to the pairs."""
    numbers = np.array([table.impulses, table.rate_pre, table.rate_post])
    np.testing.assert_array_equal(numbers, np.outer([0.5, -1.0, 0.25], table.hit))
    pairs = np.split(table.hit, np.cumsum(table.sizes))[:-1]
    rows = zip(table.ticks.tolist(), pairs, table.energies.tolist(), strict=True)
    return [(tick, tuple(pair_numbers.tolist()), energy) for tick, pair_numbers, energy in rows]


def test_impacts_come_back_as_they_were_given() -> None:
    assert told(jumps().columns()) == GIVEN
    assert told(Jumps().columns()) == []


def test_one_table_holds_them_all_and_makes_them_again() -> None:
    table = jumps().columns()
    assert [column.tolist() for column in table[:4]] == [
        [3, 7, 7], [2, 1, 3], [-1e-3, 2e-3, -4e-3], [4, 5, 2, 9, 1, 6],
    ]  # fmt: skip
    again = Jumps(table)
    assert told(again.columns()) == GIVEN
    again.append(8, decision(3), 0.0)
    assert told(again.columns()) == [*GIVEN, (8, (3,), 0.0)]
    assert again.columns().hit.tolist() == [4, 5, 2, 9, 1, 6, 3]
    assert Jumps(Columns.room(0, 0)).columns().hit.size == 0


def test_a_part_of_columns_and_its_copy() -> None:
    table = jumps().columns()
    sizes = [0, *np.cumsum(table.sizes).tolist()]
    for i, j in ((0, 2), (1, 3), (1, 1)):
        assert told(table.part((i, j), (sizes[i], sizes[j]))) == GIVEN[i:j]
    table.copy().impulses[:] = 0.0
    assert told(table) == GIVEN
    room = Columns.room(2, 5)
    assert [column.size for column in room] == [2, 2, 2, 5, 5, 5, 5]
    assert not any(column.any() for column in room)

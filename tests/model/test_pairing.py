"""Contact pairs: three laminae, a delamination that is embedded, held points."""

from __future__ import annotations

import numpy as np
import pytest

from delam_fem.api import Part, selection
from delam_fem.model.layout import (
    BASE,
    FIXED,
    Interface,
    gap_matrix,
    in_order,
    opposite,
    tributary_lengths,
)

X = np.array([0.0, 0.1, 0.3, 0.4])


def stack(n: int) -> list[Part]:
    """Return n laminae clamped at x = 0, dofs part by part and point by point."""
    parts = []
    for i in range(n):
        dofs = np.vstack([[BASE, FIXED], 6 * i + np.arange(6).reshape(3, 2)])
        parts.append(Part(f"lamina {i}", X, dofs, np.ones(3), np.ones(3)))
    return parts


def test_every_neighbour_of_three_laminae_has_its_pairs() -> None:
    parts = stack(3)
    lower, upper = in_order((opposite(parts, 0, 1), opposite(parts, 1, 2)))
    H = gap_matrix(parts, (lower, upper), 18)
    u = np.zeros(18)
    u[[0, 6, 12]] = 1.0, 3.0, 10.0  # displacement of point 1 of each lamina
    assert (H @ u).tolist() == [2.0, 0.0, 0.0, 7.0, 0.0, 0.0]
    assert (lower.pairs, upper.pairs) == (slice(0, 3), slice(3, 6))


def test_points_where_both_parts_are_held_are_no_pairs() -> None:
    assert opposite(stack(2), 0, 1).places.tolist() == [1, 2, 3]


def test_a_pair_with_one_held_point_feels_the_other() -> None:
    parts = stack(2)
    dofs = parts[0].dofs.copy()
    dofs[2] = FIXED
    other_parts = [Part("held", X, dofs, np.ones(3), np.ones(3)), parts[1]]
    H = gap_matrix(other_parts, (opposite(other_parts, 0, 1),), 12).toarray()
    assert H[1].tolist() == [0.0] * 8 + [1.0, 0.0, 0.0, 0.0]


def test_an_embedded_delamination_has_pairs_inside_alone() -> None:
    parts = stack(2)
    inside = Interface("inside", (0, 1), np.array([1.0, 2.0]))
    assert gap_matrix(parts, (inside,), 12).shape == (2, 12)
    assert tributary_lengths(parts, inside) == pytest.approx([0.15, 0.15])


def test_tributary_lengths_of_a_whole_interface_are_the_length_but_for_the_clamp() -> None:
    parts = stack(2)
    lengths = tributary_lengths(parts, opposite(parts, 0, 1))
    assert lengths == pytest.approx([0.15, 0.15, 0.05])
    assert lengths.sum() == pytest.approx(0.4 - 0.05)


def test_selected_dofs_are_shown_as_they_are() -> None:
    assert (selection([4, 0], 5) @ np.arange(5.0)).tolist() == [4.0, 0.0]

"""The schemes of the table, and what they promise."""

from __future__ import annotations

import pytest

from delam_fem.contact.laws import SCHEMES, Scheme


def test_the_table_has_average_acceleration_central_difference_and_the_midpoint() -> None:
    assert {name: (s.name, s.beta, s.gamma, s.theta) for name, s in SCHEMES.items()} == {
        "newmark": ("newmark", 0.25, 0.5, 0.5),
        "central-difference": ("central-difference", 0.0, 0.5, 0.5),
        "moreau-jean": ("moreau-jean", 0.25, 0.5, 0.5),
    }


@pytest.mark.parametrize(
    ("scheme", "within", "explicit"),
    [
        (SCHEMES["newmark"], False, False),
        (SCHEMES["central-difference"], False, True),
        (SCHEMES["moreau-jean"], True, False),
        (Scheme("newmark", beta=0.0), False, True),
        (Scheme("newmark", beta=1.0 / 6.0), False, False),
        (Scheme("moreau-jean", beta=0.0), True, False),
    ],
)
def test_where_impulses_act_and_whether_a_step_has_a_limit(
    scheme: Scheme, within: bool, explicit: bool
) -> None:
    assert scheme.has_impulses_within is within
    assert scheme.is_explicit is explicit


def test_a_scheme_of_its_own_is_average_acceleration_unless_told() -> None:
    assert Scheme() == SCHEMES["newmark"]

"""The table of laws and of the schemes that they go with."""

from typing import get_args

import numpy as np
import pytest
from stand_ins import seen, setting

from delam_fem.case.sections import Contact
from delam_fem.contact.laws import COMBINATIONS, LAWS, Law, LawName, combination
from delam_fem.numerics.schemes import SCHEMES, SchemeName


def test_the_tables_have_the_names_of_case_files() -> None:
    assert set(get_args(LawName)) == set(LAWS)
    assert set(get_args(SchemeName)) == set(SCHEMES)
    assert {law for law, _ in COMBINATIONS} == set(LAWS)
    assert {scheme for _, scheme in COMBINATIONS} == set(SCHEMES)


@pytest.mark.parametrize(("law", "scheme"), COMBINATIONS)
def test_every_combination_can_be_set_up_and_reads_keys_of_a_case(
    law: LawName, scheme: str
) -> None:
    supervisor = Law(law).supervisor(SCHEMES[scheme], setting(np.eye(2)))
    assert supervisor.examine(seen([1.0, 1.0], [0.0, 0.0])) is None
    assert set(combination(law, scheme).reads) <= set(Contact.model_fields) - {"law"}


@pytest.mark.parametrize(
    ("law", "scheme", "fitting"),
    [
        ("penalty", "moreau-jean", '"newmark" or "central-difference"'),
        ("newton-penalty", "moreau-jean", '"newmark" or "central-difference"'),
    ],
)
def test_what_does_not_go_together_is_refused(law: LawName, scheme: str, fitting: str) -> None:
    with pytest.raises(ValueError, match=f'goes with the scheme {fitting}, given "{scheme}"'):
        Law(law).supervisor(SCHEMES[scheme], setting(np.eye(1)))


def test_only_laws_with_springs_have_one() -> None:
    numbers = {"penalty_stiffness": 5.0, "penalty_damping": 2.0}
    springs = {name: Law(name, **numbers).spring for name in get_args(LawName)}
    assert springs == {
        "none": (0.0, 0.0),
        "newton": (0.0, 0.0),
        "newton-penalty": (5.0, 0.0),
        "penalty": (5.0, 2.0),
    }

"""The table of laws and of the schemes that they go with."""

import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from fakes import seen, setting

from delam_fem import Decision
from delam_fem.api import COMBINATIONS, LAWS, SCHEMES, CaseError, Contact, Law, Scheme
from delam_fem.contact.decisions import LawNumbers
from delam_fem.contact.laws import Combination, LawName, SchemeName, combination


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
    first = fitting.split('"')[1]
    text = f'goes with the scheme {fitting}, given "{scheme}"; for example {law}@{first}$'
    with pytest.raises(ValueError, match=text):
        Law(law).supervisor(SCHEMES[scheme], setting(np.eye(1)))


@pytest.mark.parametrize("name", get_args(LawName))
def test_only_laws_with_springs_have_one(name: LawName) -> None:
    springs = {"newton-penalty": (5.0, 0.0), "penalty": (5.0, 2.0)}
    law = Law(name, penalty_stiffness=5.0, penalty_damping=2.0)
    assert law.spring == springs.get(name, (0.0, 0.0))


def test_a_law_of_the_table_acts_through_the_mass_and_has_no_numbers_unless_told() -> None:
    plain = Law("newton-penalty")
    assert (plain.restitution, plain.spring, plain.threshold_velocity) == (0.0, (0.0, 0.0), 0.0)
    assert plain.is_coupled
    assert not Law("newton", impulse="lumped").is_coupled


def test_a_supervisor_has_the_numbers_of_its_law() -> None:
    """Two pairs, W = [[2, 1], [1, 2]], both with -1 m/s."""
    W = np.array([[2.0, 1.0], [1.0, 2.0]])
    closed = seen([-1.0, -1.0], [-1.0, -1.0])

    def impact(law: Law, scheme: str) -> tuple[list[float], list[bool] | None]:
        decision = law.supervisor(SCHEMES[scheme], setting(W)).examine(closed)
        assert decision is not None
        resting = None if decision.pair_state is None else decision.pair_state.resting.tolist()
        return decision.impulses.tolist(), resting

    numbers = {"restitution": 0.5, "threshold_velocity": 0.75}
    lumped, coupled = [0.75, 0.75], pytest.approx([0.5, 0.5])
    assert impact(Law("newton", impulse="lumped", **numbers), "newmark") == (lumped, None)
    assert impact(Law("newton", **numbers), "newmark") == (coupled, None)
    rests = [True, True]
    assert impact(Law("newton-penalty", impulse="lumped", **numbers), "newmark") == (lumped, rests)
    assert impact(Law("newton-penalty", **numbers), "central-difference") == (coupled, rests)
    slower = {"restitution": 0.5, "threshold_velocity": 0.25}
    assert impact(Law("newton-penalty", **slower), "newmark") == (coupled, None)
    assert impact(Law("newton", **numbers), "moreau-jean") == (coupled, None)
    numbers["threshold_velocity"] = 1.25
    assert impact(Law("newton", **numbers), "moreau-jean") == (coupled, rests)


def test_numbers_that_are_not_given() -> None:
    numbers = LawNumbers(1)
    assert (numbers.is_coupled, numbers.restitution, numbers.threshold) == (False, 0.0, -math.inf)
    assert (numbers.stiffness, numbers.damping) == (0.0, 0.0)
    assert not numbers.differ and not numbers.of_pairs.size
    assert Scheme() == Scheme("newmark", 0.25, 0.5, 0.5)
    assert Combination(2).reads == ()
    none = np.zeros(0)
    assert Decision(none, none, none, none).pair_state is None


def test_courant_numbers_are_those_of_the_scheme() -> None:
    """1 / √(γ/2 - β): 2 of central differences, √12 of linear acceleration."""
    assert SCHEMES["central-difference"].courant == 2.0
    assert Scheme(beta=1.0 / 6.0).courant == pytest.approx(math.sqrt(12.0))
    assert Scheme().courant == Scheme("moreau-jean", beta=0.0).courant == math.inf


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"beta": -0.1}, "beta: expected a number from 0 or more, given -0.1"),
        ({"gamma": 0.49}, "gamma: expected a number from 0.5 or more, given 0.49"),
        ({"theta": 0.49}, "theta: expected a number from 0.5 to 1, given 0.49"),
        ({"theta": 1.01}, "theta: expected a number from 0.5 to 1, given 1.01"),
        ({"name": "euler"}, "scheme: expected one of newmark, central-difference, moreau-jean, "
         "given 'euler'"),
    ],
)  # fmt: skip
def test_schemes_out_of_range_are_refused(changed: dict[str, object], message: str) -> None:
    with pytest.raises(CaseError) as error:
        replace(Scheme(), **changed)
    assert str(error.value) == message
    assert Scheme(beta=0.0, gamma=0.5, theta=1.0).theta == 1.0


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"restitution": 1.01}, "restitution: expected a number from 0 to 1, given 1.01"),
        ({"penalty_stiffness": -1.0}, "penalty_stiffness: expected a number from 0 or more, given "
         "-1.0"),
        ({"penalty_damping": -1.0}, "penalty_damping: expected a number from 0 or more, given "
         "-1.0"),
        ({"threshold_velocity": -1.0}, "threshold_velocity: expected a number from 0 or more, "
         "given -1.0"),
        ({"impulse": "x"}, "impulse: expected one of lumped, consistent, given 'x'"),
        ({"name": "x"}, f"law: expected one of {', '.join(LAWS)}, given 'x'"),
    ],
)  # fmt: skip
def test_laws_out_of_range_are_refused(changed: dict[str, object], message: str) -> None:
    with pytest.raises(CaseError) as error:
        replace(Law("newton"), **changed)
    assert str(error.value) == message
    assert Law("newton", restitution=1.0).restitution == 1.0

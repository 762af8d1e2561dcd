"""Ways to step through contact: those on dense matrices and on modes beside the package's."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from support import compiled
from trials import compare as trials, schemes as ts, steps
from trials.runners import (
    LIMIT,
    RESTITUTION,
    by_modes,
    densely,
    runners,
)

from delam_fem.api import assemble, motion_of

SAME = 1e-9  # m: round-off of the first periods, which impacts raise to 1e-11


@pytest.mark.nightly
def test_dense_steps_are_those_of_the_package() -> None:
    case = trials.case_of(250, 4)
    operators = assemble(case, needs_dolfinx=False).operators
    arguments = (ts.MOREAU, RESTITUTION)
    dense = densely(steps.theta_step, ts.theta_matrices, arguments, case, operators)
    of_package = runners()[LIMIT](case, operators)
    np.testing.assert_allclose(dense, of_package, rtol=0.0, atol=SAME)


@pytest.mark.slow
def test_exact_steps_are_exact_without_contact() -> None:
    step = compiled(steps.exact_step)
    for arguments in ((0.1, False), (0.1, True)):
        motions = []
        for n in (100, 200):
            case = trials.case_of(n, 2)
            operators = assemble(case, needs_dolfinx=False).operators
            operators = dataclasses.replace(operators, gap0=np.full(operators.n_pairs, 5.0))
            bases = motion_of(case)(0)
            m = ts.exact_matrices(ts.Problem.of(operators), case.time_step, *arguments)
            u, v, a = np.zeros((3, operators.n_dofs))
            W = m.of.H @ m.push
            for j in range(1, n + 1):
                step(m, W, u, v, a, bases[j - 1], bases[j])
            motions.append(u)
        np.testing.assert_allclose(
            *motions, rtol=0.0, atol=1e-5
        )  # the load is linear within a step


def test_all_modes_are_the_whole_problem() -> None:
    case = trials.case_of(250, 2)
    operators = assemble(case, needs_dolfinx=False).operators
    np.testing.assert_allclose(
        by_modes(LIMIT, operators.n_dofs // 2, case, operators),
        runners()[LIMIT](case, operators),
        rtol=0.0,
        atol=1e-8,
    )

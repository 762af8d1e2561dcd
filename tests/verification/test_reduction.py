"""A reduced beam against the full one: the same motion, convergence with the modes, the engines."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from delam_fem.api import (
    Case,
    EngineName,
    FloatArray,
    IntArray,
    Structure,
    assemble,
    preset,
    session_of,
)
from delam_fem.engines.compiled import inner_points
from delam_fem.model.component_modes import basis_of, projected

ALL, SOME = 20, 6
"""Modes of a lamina of ten elements: all there are; some, and the rest's flexibility."""
ROUND_OFF = 1e-10
"""m; of two forms of one model through a hundred impacts (seen: 3e-13)."""
SAME = 1e-6
"""m; tips just after the first impacts, whose local waves six modes resolve (seen: 4e-7)."""
LATER = 1e-4
"""m; tips of 23 mm at the end of the period, after a hundred impacts (seen: 3e-5)."""

EXTREMES, MEANS = 1e-2, 4e-3
"""Of the largest tip displacement (seen: 4e-3, 2e-3)."""


def case_of(**keys: object) -> Case:
    changed = {key.replace("__", "."): value for key, value in keys.items()}
    small = {"mesh.elements": 10, "time.periods": 1, "output.window_periods": 1}
    return preset("default", {**small, **changed})


@lru_cache(maxsize=1)
def full() -> Structure:
    return assemble(case_of(), needs_dolfinx=False)


def reduced(n: int) -> Structure:
    return projected(full(), basis_of(full().operators, n))


def motion(
    structure: Structure, case: Case, engine: EngineName = "compiled"
) -> tuple[FloatArray, IntArray]:
    """Return the tips at every step of a period, shape (N + 1, 2), and the ticks of impacts."""
    with session_of(case, structure.operators, engine=engine) as opened:
        assert opened.run() == "completed"
        (record,) = opened.recorder.window
        assert opened.recorder.energy_residual() < 1e-9
        return record.u[:, 3:5].copy(), record.jumps.columns().ticks.copy()


def test_all_modes_are_the_full_model() -> None:
    case = case_of()
    (tips, ticks), (expected, when) = motion(reduced(ALL), case), motion(full(), case)
    np.testing.assert_array_equal(ticks, when)
    np.testing.assert_allclose(tips, expected, atol=ROUND_OFF)


def test_some_modes_are_close_through_the_first_impacts_and_not_far_later() -> None:
    case = case_of()
    (tips, ticks), (expected, when) = motion(reduced(SOME), case), motion(full(), case)
    np.testing.assert_array_equal(ticks[:4], when[:4])
    first = int(when[3]) // case.time.refine + 1
    np.testing.assert_allclose(tips[:first], expected[:first], atol=SAME)
    np.testing.assert_allclose(tips, expected, atol=LATER)
    assert np.abs(tips - expected).max() > ROUND_OFF  # it is another model


def test_without_contact_the_error_falls_with_the_modes() -> None:
    case = case_of(contact__law="none", time__refine=1)
    expected, _ = motion(full(), case)
    motions = [motion(reduced(n), case)[0] for n in (2, 6)]
    errors = [float(np.abs(tips - expected)[500:].max()) for tips in motions]
    assert errors[0] < 1e-6 and errors[1] < 0.1 * errors[0]


@pytest.mark.parametrize(
    ("law", "scheme"),
    [("newton", "moreau-jean"), ("newton-penalty", "newmark"), ("penalty", "newmark")],
)
def test_engines_agree_on_dense_gaps(law: str, scheme: str) -> None:
    structure = reduced(SOME)
    assert inner_points.is_reduced(structure.operators)
    assert not inner_points.is_reduced(full().operators)
    case = case_of(contact__law=law, time__scheme=scheme)
    (tips, ticks), (expected, when) = (
        motion(structure, case, engine) for engine in ("compiled", "petsc")
    )
    np.testing.assert_array_equal(ticks[:20], when[:20])
    np.testing.assert_allclose(tips, expected, atol=1e-9)


def test_a_state_is_resumed_bit_for_bit() -> None:
    structure, case = reduced(SOME), case_of()
    with session_of(case, structure.operators, engine="compiled") as opened:
        opened.run()
        state = opened.engine.state()
    with session_of(case, structure.operators, engine="compiled", initial=state) as opened:
        np.testing.assert_array_equal(opened.engine.state().motion, state.motion)


@pytest.mark.parametrize("frequency", [1.25, 1.60, 3.25, 3.65])
def test_settled_tips_have_the_extremes_of_the_full_model(frequency: float) -> None:
    """After hundreds of impacts runs share statistics, not histories: extremes, and their means."""
    case = preset("default", {"excitation.frequency": frequency, "time.periods": 80})
    full_structure = assemble(case, needs_dolfinx=False)
    some = projected(full_structure, basis_of(full_structure.operators, 8))
    envelopes = []
    for structure in (some, full_structure):
        with session_of(case, structure.operators, engine="compiled") as opened:
            assert opened.run() == "completed"
            envelopes.append(opened.recorder.envelope[40:80].copy())
    extremes = [np.append(e[:, 0].min(axis=0), e[:, 1].max(axis=0)) for e in envelopes]
    means = [e.mean(axis=0) for e in envelopes]
    largest = np.abs(extremes[1]).max()
    np.testing.assert_allclose(extremes[0], extremes[1], atol=EXTREMES * largest)
    np.testing.assert_allclose(means[0], means[1], atol=MEANS * largest)

"""Delaminated beams beside the exact frequencies of the split beam, and beside published numbers.

λ² = ω L² √(ρA/EI) of a clamped–clamped beam with a centred delamination.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from split_beam import SplitBeam

from delam_fem.api import Case, lowest, preset
from delam_fem.model.beams import closed_form, forms
from delam_fem.model.linear import kept_closed

E, RHO, H, L, B = 70e9, 2700.0, 0.002, 0.4, 0.02
UNIT = 2.0 * math.pi * L**2 * math.sqrt(12.0 * RHO / (E * H**2))
"""λ² per hertz."""
PUBLISHED = {
    0.1: (22.3727, 60.8087),
    0.2: (22.3549, 55.9986),
    0.3: (22.2375, 49.0036),
    0.4: (21.8315, 43.8927),
    0.5: (20.8863, 41.5239),
}
"""λ² of modes 1 and 2 with a mid-plane delamination, by its length over that of the beam."""
DIGITS = 1e-4
"""Of the published numbers."""


def exact(
    share: float, upper: float = 0.5, *, center: float = 0.5, closed: bool = False
) -> SplitBeam:
    """Return the split beam with a delamination of length share L below `upper` of the height."""
    half = 0.5 * share * L
    return SplitBeam(
        L,
        B,
        center * L - half,
        center * L + half,
        (E, RHO, (1.0 - upper) * H),
        (E, RHO, upper * H),
        is_closed=closed,
    )


def case(share: float, upper: float = 0.5, *, center: float = 0.5, elements: int = 80) -> Case:
    half = 0.5 * share * L
    return preset(
        "embedded",
        {
            "lamina.lower.thickness": (1.0 - upper) * H,
            "lamina.upper.thickness": upper * H,
            "delamination.1.start": center * L - half,
            "delamination.1.end": center * L + half,
            "mesh.elements": elements,
        },
    )


def computed(given: Case, n: int, *, closed: bool = False, weak: bool = False) -> np.ndarray:
    structure = (forms if weak else closed_form).assemble(given)
    o = structure.operators
    S = kept_closed(structure.layout, o.n_dofs)
    K, M = (S.T @ m @ S if closed else m for m in (o.stiffness, o.mass))
    return lowest(K, M, n)[0]


@pytest.mark.parametrize("share", PUBLISHED)
def test_published_numbers_of_a_mid_plane_delamination(share: float) -> None:
    assert UNIT * exact(share).frequencies(2) == pytest.approx(PUBLISHED[share], abs=DIGITS)
    assert UNIT * computed(case(share), 2) == pytest.approx(PUBLISHED[share], abs=DIGITS)


def test_published_numbers_of_both_models() -> None:
    free, closed = exact(0.6, 0.3), exact(0.6, 0.3, closed=True)
    assert UNIT * free.frequencies(1) == pytest.approx([16.614], abs=5e-4)
    assert UNIT * closed.frequencies(1) == pytest.approx([20.486], abs=5e-4)
    split_case = case(0.6, 0.3)
    assert UNIT * computed(split_case, 1) == pytest.approx([16.614], abs=5e-4)
    assert UNIT * computed(split_case, 1, closed=True) == pytest.approx([20.486], abs=5e-4)


def test_opening_mode_of_a_mid_plane_delamination() -> None:
    formula = 22.3733 * 0.5 / 0.5**2  # (h_U/h) (L/a)²
    assert UNIT * exact(0.5).frequencies(3)[2] == pytest.approx(formula, rel=1e-5)
    assert UNIT * computed(case(0.5), 3)[2] == pytest.approx(formula, rel=1e-5)


@pytest.mark.parametrize("closed", [False, True])
def test_frequencies_converge_at_order_four_to_the_exact_ones(closed: bool) -> None:
    true = exact(0.4, 0.3, center=0.45, closed=closed).frequencies(4)
    errors = []
    for n in (20, 40):
        split_case = case(0.4, 0.3, center=0.45, elements=n)
        errors.append(computed(split_case, 4, closed=closed) / true - 1.0)
    order = np.log2(errors[0] / errors[1])
    assert np.abs(errors[1]).max() < 1e-4
    assert ((order > 3.9) & (order < 4.1)).all()


def test_weak_forms_give_the_exact_frequencies() -> None:
    split_case = case(0.4, 0.3, center=0.45)
    true = exact(0.4, 0.3, center=0.45).frequencies(4)
    assert computed(split_case, 4, weak=True) == pytest.approx(true, rel=1e-5)


@pytest.mark.parametrize("supports", [("clamped", "free"), ("pinned", "pinned")])
def test_two_materials_on_other_supports(supports: tuple[str, str]) -> None:
    split_case = case(0.4, 0.3, center=0.45).with_overrides(
        {
            "support.start": supports[0],
            "support.end": supports[1],
            "lamina.upper.material": "steel",
        }
    )
    split = SplitBeam(
        L, B, 0.1, 0.26, (E, RHO, 0.7 * H), (210e9, 7850.0, 0.3 * H), supports=supports
    )
    assert computed(split_case, 3) == pytest.approx(split.frequencies(3), rel=1e-5)


def test_a_delamination_of_no_thickness_ratio_leaves_the_intact_beam() -> None:
    intact = 4.730040744862704**2 / UNIT
    assert exact(0.002).frequencies(1) == pytest.approx([intact], rel=1e-5)

"""Reductions of cases: solids, floating structures, numbers of the table."""

from typing import Any

import numpy as np
import pytest

from delam_fem.api import preset, reduced_case
from delam_fem.model import layout, reduction
from delam_fem.model.component_modes import Basis, basis_of

FREE = {"mesh.elements": 16, "support.start": "free", "support.end": "free", "excitation": {
    "kind": "force", "lamina": "upper", "position": 0.1, "frequency": 9.0, "amplitude": 1.0,
}}  # fmt: skip
ROUND_OFF = 3e-4
"""Of a solid's stiffness, against which a sheet bends: K⁻¹ k_b itself is off by 8e-5."""


@pytest.mark.parametrize("kind", ["plane-stress", "solid"])
def test_a_solid_becomes_a_diagonal_system_of_its_middle_lines(kind: str) -> None:
    case = preset("default", {"mesh.elements": 8, "model.kind": kind})
    reduced_model = reduced_case(case, 4)
    o, full = reduced_model.structure.operators, reduced_model.full.operators
    assert o.n_dofs < full.n_dofs / 3
    C, squares = o.damping, o.stiffness.diagonal()
    assert (C - np.diag(C.diagonal()) == 0.0).all()
    part = reduced_model.structure.layout.reading.part
    for i in range(2):
        alpha, beta = case.rayleigh(i)
        of_part = part == i
        np.testing.assert_allclose(
            C.diagonal()[of_part], alpha + beta * squares[of_part], rtol=1e-6
        )
    # the lowest frequencies are those of the cantilevers
    for i, lamina in enumerate(case.lamina):
        lowest = np.sqrt(squares[part == i].min())
        assert lowest == pytest.approx(lamina.angular_frequencies(1)[0], rel=5e-3)
    # a slow base carries the middle lines
    q = -o.base.stiffness / squares
    u, slope = layout.nodal(reduced_model.structure.layout, q[None], np.ones(1))
    np.testing.assert_allclose(u, 1.0, atol=ROUND_OFF)
    np.testing.assert_allclose(slope, 0.0, atol=10.0 * ROUND_OFF)


def test_a_floating_stack_keeps_its_rigid_motions() -> None:
    reduced_model = reduced_case(preset("embedded", FREE), 6)
    squares = np.sort(reduced_model.basis.squares)
    assert squares[1] < 1e-6 * squares[2]
    full, reduced_frequencies = reduced_model.frequencies
    np.testing.assert_allclose(reduced_frequencies[2:6], full[2:6], rtol=1e-6)
    assert reduced_model.highest > reduced_model.highest_mode > reduced_frequencies[5] * 0.99


def test_only_what_floats_is_shifted(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the square of the lowest frequency of a lamina that is clamped."""
    shifts: list[float] = []

    def noted(*given: Any, shift: float, **more: Any) -> Basis:
        shifts.append(shift)
        return basis_of(*given, shift=shift, **more)

    monkeypatch.setattr(reduction, "basis_of", noted)
    floating = preset("embedded", FREE)
    for case in (floating, preset("embedded", {"mesh.elements": 16})):
        reduced_case(case, 3)
    slowest = min(lamina.angular_frequencies(1)[0] for lamina in floating.lamina)
    assert shifts == [pytest.approx(slowest**2), 0.0]

"""Weak forms equal closed forms for laminae in which no two numbers are alike."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from mixed import BARS, BEAMS

from delam_fem.api import assemble
from delam_fem.model.beams import forms

ROUND_OFF = 1e-10
"""Of the largest entry."""


@pytest.mark.parametrize("name", BEAMS)
def test_weak_forms_equal_closed_forms(name: str) -> None:
    case = BEAMS[name]
    expected = assemble(case, needs_dolfinx=False).operators
    operators = forms.assemble(case).operators
    for matrix in ("mass", "damping", "stiffness", "gap_matrix", "probes", "sensors"):
        assert_same(getattr(operators, matrix), getattr(expected, matrix), matrix)
    for vector in ("gap0", "pair_weights", "lumped_mass", "start"):
        assert_same(getattr(operators, vector), getattr(expected, vector), vector)
    for vector in ("mass", "damping", "stiffness", "corner"):
        assert_same(getattr(operators.base, vector), getattr(expected.base, vector), vector)


def assert_same(value: object, expected: object, name: str) -> None:
    """Compare two arrays, sparse or not, or two that are not there."""
    if expected is None:
        assert value is None, name
        return
    arrays = [x.toarray() if sp.issparse(x) else np.asarray(x, dtype=float)
              for x in (value, expected)]  # fmt: skip
    scale = np.abs(arrays[1]).max(initial=0.0)
    np.testing.assert_allclose(arrays[0], arrays[1], atol=ROUND_OFF * scale, err_msg=name)


@pytest.mark.parametrize("name", [*BEAMS, *BARS])
def test_matrices_are_symmetric_and_nothing_gains_energy(name: str) -> None:
    operators = assemble((BEAMS | BARS)[name], needs_dolfinx=False).operators
    for matrix in (operators.mass, operators.damping, operators.stiffness):
        dense = matrix.toarray()
        scale = np.abs(dense).max()
        np.testing.assert_allclose(dense, dense.T, atol=ROUND_OFF * scale)
        assert np.linalg.eigvalsh(dense).min() > -ROUND_OFF * scale

"""The state at t = 0 that a case asks for: shapes of displacement and of velocity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from delam_fem.case.definition import Case
from delam_fem.case.sections import Initial
from delam_fem.model.layout import DISPLACEMENT, Structure, interpolation_rows, place_of
from delam_fem.model.linear import lowest
from delam_fem.numerics.types import FloatArray
from delam_fem.system.errors import CaseError


def with_start(structure: Structure, case: Case) -> Structure:
    """Return beams with the initial state of their case, before their dofs are shifted.

    Raises:
        CaseError: there is no such shape.
    """
    if not case.initial:
        return structure
    start = np.zeros((2, structure.operators.n_dofs))
    for number, own in enumerate(case.initial, start=1):
        size = np.array([[own.displacement], [own.velocity]])
        start += size * _shape(structure, own, f"initial.{number}")
    return replace(structure, operators=replace(structure.operators, start=start))


def _shape(structure: Structure, own: Initial, key: str) -> FloatArray:
    """Return a shape whose largest deflection at a node is 1, shape (n,)."""
    o, layout = structure.operators, structure.layout
    parts = [part for part in layout.parts if own.lamina in (None, part.name)]
    dofs = np.unique(np.concatenate([part.own_dofs for part in parts]))
    deflections = np.unique(np.concatenate([part.dofs[:, DISPLACEMENT] for part in parts]))
    deflections = deflections[deflections >= 0]
    shape = np.zeros(o.n_dofs)
    if own.shape == "uniform":
        shape[deflections] = 1.0
        return shape
    K, M = o.stiffness[dofs][:, dofs], o.mass[dofs][:, dofs]
    if own.shape == "mode":
        if own.mode > dofs.size:
            raise CaseError(f"{key}.mode: expected at most {dofs.size}, given {own.mode}")
        shape[dofs] = lowest(K, M, own.mode)[1][:, -1]
    else:
        assert own.position is not None
        place = np.array([place_of(parts[0], own.position)])
        load = interpolation_rows(parts[0], place, o.n_dofs).toarray()[0, dofs]
        try:
            shape[dofs] = splu(sp.csc_matrix(K)).solve(load)
        except RuntimeError:
            text = f"{key}.shape: expected laminae that are held, given free ones"
            raise CaseError(text) from None
    largest = deflections[np.abs(shape[deflections]).argmax()]
    if not shape[largest]:
        raise CaseError(f"{key}.position: expected a point that can move, given {own.position} m")
    return np.asarray(shape / shape[largest])

"""The operators and the layout of a reduced structure.

    u = V q:   I q'' + Vᵀ C V q' + Ω² q = -Vᵀ (m_b q_b'' + c_b q_b' + k_b q_b) + (H V)ᵀ λ

H V is dense. Deflections and slopes of the parts are readings of q.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from delam_fem.model.layout import Layout, Reading, Structure
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.model.reduction.basis import Basis
from delam_fem.numerics.arrays import IntArray


def projected(structure: Structure, basis: Basis) -> Structure:
    """Return a structure in the coordinates of a basis.

    There is no lumped mass: impulses act through M = I. Sensors are left out, see
    `sensors.with_sensors`.

    Args:
        structure: the full structure.
        basis: of its operators.
    """
    return Structure(operators_in(structure.operators, basis), layout_in(structure.layout, basis))


def operators_in(o: Operators, basis: Basis) -> Operators:
    """Return operators in the coordinates of a basis, without sensors."""
    V, n = basis.vectors, basis.squares.size
    base = BaseCoupling(
        V.T @ o.base.mass,
        V.T @ o.base.damping,
        V.T @ o.base.stiffness,
        o.base.corner,
        o.base.is_force,
    )
    return Operators(
        mass=sp.identity(n, format="csr"),
        damping=sp.csr_matrix(basis.damping),
        stiffness=sp.diags(basis.squares, format="csr"),
        base=base,
        gap_matrix=sp.csr_matrix(o.gap_matrix @ V),
        gap0=o.gap0,
        pair_weights=o.pair_weights,
        probes=sp.csr_matrix(o.probes @ V),
    )


def layout_in(layout: Layout, basis: Basis) -> Layout:
    """Return a layout whose deflections and slopes are readings of the coordinates.

    Args:
        layout: of the full structure.
        basis: of its operators.
    """
    V = basis.vectors
    given = layout.reading
    rows, base = (V, np.zeros(len(V))) if given is None else (given.matrix @ V, given.base)
    reading = Reading(sp.csr_matrix(rows), base, _parts(layout, basis))
    return replace(layout, reading=reading, sensors=(), gap_row=None)


def _parts(layout: Layout, basis: Basis) -> IntArray:
    """Return the part to which each coordinate belongs, -1 where bonded parts share it."""
    of_body = np.full(1 + int(basis.body.max()), -1)
    owners: dict[int, set[int]] = {}
    for number in range(len(layout.parts)):
        for body in np.unique(basis.body_of_dof[layout.own_dofs(number)]).tolist():
            owners.setdefault(body, set()).add(number)
    for body, parts in owners.items():
        if len(parts) == 1:
            of_body[body] = parts.pop()
    return np.asarray(of_body[basis.body])

"""Assemble what does not bend: bars, and points in place of beams.

A bar stretches, E A u'' = ρ A ü, in linear elements. A point is a mass on a spring and a damper,

    m u'' + c (u' - q') + k (u - q) = contact,   c = 2 D √(k m)

a bar of one element whose mass is at its end. Nodes are held against turning; between them
displacements are straight.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from delam_fem.case.definition import Case
from delam_fem.model.beams.network import parts_of, side_by_side
from delam_fem.model.layout import BASE, FIXED, Structure
from delam_fem.numerics.types import FloatArray, IntArray

_RIGID = 1e-12
"""Square of a frequency over the largest, below which a motion is rigid but for round-off."""


def assemble(case: Case, x: FloatArray) -> Structure:
    """Return the operators and the layout of a case of bars or points with nodes at x [m]."""
    h, last, count = np.diff(x), x.size - 1, len(case.lamina)
    ends = ((0, case.support.start), (last, case.support.end))
    free = np.delete(np.arange(x.size), [node for node, kind in ends if kind != "free"])
    start, end = (sp.eye(last, x.size, k=k, format="csr") for k in (0, 1))  # nodes of cells
    laminae, lumped, damping = [], [], []
    for own in case.lamina:
        masses = sp.diags(own.mass_per_length * h)
        k = own.axial_rigidity / h if own.stiffness is None else np.array([own.stiffness])
        diagonal = 0.5 * (start + end).T @ masses.diagonal()
        if own.mass is not None:
            diagonal = own.mass * np.eye(x.size)[last]
        M = sum(N.T @ masses @ N for N in (start, end, start + end)) / 6.0
        if own.mass is not None or case.time.mass == "lumped":
            M = sp.diags(diagonal)
        K = (end - start).T @ sp.diags(k) @ (end - start)
        if case.damping.rayleigh == "every mode":
            damping.append(_damped(M, K, own.damping_ratio, free))
        laminae.append((M, K))
        lumped.append(diagonal)
    dofs = np.full((count, x.size, 2), FIXED)
    dofs[..., 0] = BASE
    dofs[:, free, 0] = np.arange(count * free.size).reshape(count, free.size)
    sections = np.zeros((2, count, last))
    sections[1] = [[own.mass_per_length] for own in case.lamina]
    parts = parts_of(case, x, dofs, sections)
    straight = np.diag([1.0, 0.0])  # the slopes have no stiffness and no mass
    M, K = (sp.kron(sp.block_diag(own), straight) for own in zip(*laminae, strict=True))
    C = sp.kron(sp.block_diag(damping), straight) if damping else None
    return side_by_side(case, parts, (M, K), np.kron(np.concatenate(lumped), straight[0]), C)


def _damped(M: sp.spmatrix, K: sp.spmatrix, ratio: float, free: IntArray) -> sp.csr_matrix:
    """Return C = M Σ 2 D ω φ φᵀ M, which acts on motions relative to the base, with φᵀ M φ = 1."""
    M_free, K_free = (sp.csr_matrix(A)[free][:, free].toarray() for A in (M, K))
    squares, shapes = eigh(K_free, M_free)
    momenta = M_free @ shapes
    squares[squares < _RIGID * squares[-1]] = 0.0
    C = momenta * (2.0 * ratio * np.sqrt(squares)) @ momenta.T
    relative = np.eye(M.shape[0])[free]
    for node in np.setdiff1d(np.arange(M.shape[0]), free)[:1]:  # all held nodes are the base
        relative[:, node] = -1.0
    return sp.csr_matrix(relative.T @ C @ relative)

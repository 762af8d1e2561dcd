"""What does not bend: bars, and points in place of beams.

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
from delam_fem.model.beams.network import completed, gap_at_rest, probes_of, with_masses
from delam_fem.model.layout import (
    BASE,
    FIXED,
    Layout,
    Part,
    Structure,
    Support,
    gap_matrix,
    neighbours,
    probe_rows,
)
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.numerics.types import FloatArray, IntArray


def assemble(case: Case, x: FloatArray) -> Structure:
    """Return the operators and the layout of a case of bars or points with nodes at x [m]."""
    h, last, count = np.diff(x), x.size - 1, len(case.lamina)
    ends = ((0, case.support.start), (last, case.support.end))
    held = [(node, kind) for node, kind in ends if kind != "free"]
    free = np.delete(np.arange(x.size), [node for node, _ in held])
    n = count * free.size
    numbers = np.full((count, x.size), BASE)
    numbers[:, free] = np.arange(n).reshape(count, free.size)
    both = [sp.eye(last, x.size, k=k, format="csr") for k in (0, 1)]  # nodes at the ends of cells
    sums = [sp.csr_matrix((n + 1, n + 1)) for _ in range(3)]
    lumped = np.zeros(n + 1)
    for i, own in enumerate(case.lamina):
        to = sp.csr_matrix((np.ones(x.size), (np.arange(x.size), numbers[i] % (n + 1))))
        to.resize(x.size, n + 1)  # column n is the base
        start, end = (N @ to for N in both)
        masses = sp.diags(own.mass_per_length * h)
        k = own.axial_rigidity / h if own.stiffness is None else np.array([own.stiffness])
        diagonal = 0.5 * (start + end).T @ masses.diagonal()
        if own.mass is not None:
            diagonal = own.mass * to.toarray()[last]
        M = sum(N.T @ masses @ N for N in (start, end, start + end)) / 6.0
        if own.mass is not None or case.time.mass == "lumped":
            M = sp.diags(diagonal)
        K = (end - start).T @ sp.diags(k) @ (end - start)
        alpha, beta = case.rayleigh(i)
        C = alpha * M + beta * K
        if case.damping.rayleigh == "every mode":
            C = _damped(M, K, own.damping_ratio, numbers[i, free])
        sums = [A + added for A, added in zip(sums, (M, C, K), strict=True)]
        lumped += diagonal
    slopes = np.full(x.size, FIXED)
    parts = tuple(
        Part(own.name, x, np.column_stack([dofs, slopes]), np.zeros(last),
             np.full(last, own.mass_per_length))
        for own, dofs in zip(case.lamina, numbers, strict=True)
    )  # fmt: skip
    layout = Layout(
        parts,
        neighbours(parts, 1),
        probes_of(case, x),
        tuple(Support(i, node, kind) for i in range(count) for node, kind in held),
    )
    mass, damping, stiffness = (sp.csr_matrix(A[:n, :n]) for A in sums)
    m, c, k = (A[:n, n].toarray().ravel() for A in map(sp.csr_matrix, sums))
    m_aa, c_aa, k_aa = (float(A[n, n]) for A in map(sp.csr_matrix, sums))
    operators = Operators(
        mass=mass,
        damping=damping,
        stiffness=stiffness,
        lumped_mass=lumped[:n],
        base=BaseCoupling(m, c, k, corner=(m_aa, c_aa, k_aa)),
        gap_matrix=gap_matrix(layout.parts, layout.interfaces, n),
        gap0=gap_at_rest(case, layout),
        probes=probe_rows(layout, n),
    )
    return completed(with_masses(Structure(operators, layout), case), case)


def _damped(M: sp.spmatrix, K: sp.spmatrix, ratio: float, dofs: IntArray) -> sp.csr_matrix:
    """Return C = M Σ 2 D ω φ φᵀ M of motions relative to the base, with φᵀ M φ = 1."""
    n_columns = M.shape[0]
    M, K = (sp.csr_matrix(A)[dofs][:, dofs].toarray() for A in (M, K))
    squares, shapes = eigh(K, M)
    momenta = M @ shapes
    C = momenta * (2.0 * ratio * np.sqrt(np.maximum(squares, 0.0))) @ momenta.T
    entries = np.ones(dofs.size), (np.arange(dofs.size), dofs)
    relative = sp.csr_matrix(entries, shape=(dofs.size, n_columns)).tolil()
    relative[:, -1] = -1.0
    return sp.csr_matrix(relative.T @ C @ relative)

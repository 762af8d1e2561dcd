"""Store two laminae as four chains of nodes that run from both ends to the middle, side by side.

Each lamina is a chain of 2×2 blocks (u, φ) that are coupled to their neighbours only. Eliminating
it from the clamp and from the tip at once, up to the middle, makes two chains of half the length.
Two laminae make four chains, and these are the four lanes of a vector:

    row      lane 0 (lamina 1)   lane 1 (lamina 1)   lane 2 (lamina 2)   lane 3 (lamina 2)
    0        node 1              node n              node 1              node n
    1        node 2              node n - 1          node 2              node n - 1
    …                            (n odd: lanes 1 and 3 begin with an empty row instead of node n)
    m - 1    node m              node m + 1          node m              node m + 1

The row that follows the last row is the last row with its neighbouring lanes swapped, so that every
kernel in lane_kernels.py treats the middle as any other row. A "tape" holds coefficients row by row
in the order in which a kernel reads them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from delam_fem.engines.compiled import simd
from delam_fem.engines.compiled.lane_kernels import ROW
from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray, IntArray

BLOCK = 2
"""Dofs per node."""
LANES = simd.WIDTH
RAYLEIGH_TOLERANCE = 1e-13
"""Largest entry of C - αM - βK relative to C that is round-off of an assembly."""


@dataclass(frozen=True)
class Chains:
    """A block tridiagonal matrix in lane order.

    Attributes:
        before: coupling of each row to the row before it, shape (m, lanes, 2, 2).
        middle: diagonal blocks, shape (m, lanes, 2, 2); blocks of empty rows are 0, not identities.
        after: coupling of each row to the next row, shape (m, lanes, 2, 2); the last row couples to
            itself with swapped lanes.
    """

    before: FloatArray
    middle: FloatArray
    after: FloatArray

    def __add__(self, other: Chains) -> Chains:
        """Return the sum of two matrices."""
        return Chains(
            self.before + other.before, self.middle + other.middle, self.after + other.after
        )

    def scaled(self, factors: FloatArray) -> Chains:
        """Return the matrix with each lane multiplied by its own factor; factors: shape (4,)."""
        by = factors[None, :, None, None]
        return Chains(by * self.before, by * self.middle, by * self.after)


def lane_order(n_elements: int) -> IntArray:
    """Return the place of each dof of two laminae in lane order, shape (4 n,)."""
    m = (n_elements + 1) // 2
    dof = np.arange(4 * n_elements)
    lamina, rest = np.divmod(dof, 2 * n_elements)
    node, component = rest // BLOCK + 1, rest % BLOCK
    is_far = node > m
    row = np.where(is_far, 2 * m - node, node - 1)
    return np.asarray(row * ROW + component * LANES + 2 * lamina + is_far, dtype=np.int64)


def chains(matrix: sp.csr_matrix, order: IntArray) -> Chains | None:
    """Return a matrix in lane order, or None if it couples more than neighbours of a lamina."""
    m = -(-matrix.shape[0] // (4 * BLOCK))
    entries = sp.coo_matrix(matrix)
    entries.sum_duplicates()
    values, there = entries.data, entries.data != 0.0
    (row, i, lane), (column, j, other) = (
        _place(order[index[there]]) for index in (entries.row, entries.col)
    )
    values = values[there]
    step, is_last = column - row, (row == m - 1) & (column == m - 1)
    across = (other == (lane ^ 1)) & is_last
    kinds = {
        "before": (lane == other) & (step == -1),
        "middle": (lane == other) & (step == 0),
        "after": ((lane == other) & (step == 1)) | across,
    }
    if not np.logical_or.reduce(list(kinds.values())).all():
        return None
    blocks = {}
    for name, mine in kinds.items():
        blocks[name] = np.zeros((m, LANES, BLOCK, BLOCK))
        blocks[name][row[mine], lane[mine], i[mine], j[mine]] = values[mine]
    return Chains(**blocks)


def _place(index: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return row, component and lane of places in lane order."""
    return index // ROW, index % ROW // LANES, index % LANES


def rayleigh(operators: Operators) -> tuple[FloatArray, FloatArray] | None:
    """Return (α [1/s], β [s]) of both laminae, each of shape (2,), such that C = αM + βK.

    Return None if C does not have this form to round-off.
    """
    half = operators.n_dofs // 2
    found = []
    for part in (slice(0, half), slice(half, None)):
        C, M, K = (
            sp.csr_matrix(matrix)[part, part]
            for matrix in (operators.damping, operators.mass, operators.stiffness)
        )
        scales = [abs(matrix).max() or 1.0 for matrix in (M, K)]
        columns = [M / scales[0], K / scales[1]]
        normal = np.array([[a.multiply(b).sum() for b in columns] for a in columns])
        right = np.array([a.multiply(C).sum() for a in columns])
        alpha, beta = np.linalg.lstsq(normal, right, rcond=None)[0] / scales
        if abs(C - alpha * M - beta * K).max() > RAYLEIGH_TOLERANCE * (abs(C).max() or 1.0):
            return None
        found.append((float(alpha), float(beta)))
    return np.array(found)[:, 0], np.array(found)[:, 1]


# -- tapes ------------------------------------------------------------------------------------


def product_tape(matrix: Chains) -> FloatArray:
    """Return the coefficients of y = A x: before, middle, after of each row, shape (48 m,)."""
    return _tape(matrix.before, matrix.middle, matrix.after)


def diagonal_tape(matrix: Chains) -> FloatArray:
    """Return the diagonal of A, shape (8 m,)."""
    return flat(np.einsum("rlii->ril", matrix.middle))


def form_tape(matrix: Chains) -> FloatArray:
    """Return the coefficients of xᵀ A x, with each pair of rows once, shape (28 m,).

    Each row has D00, D01 + D10, D11 and its coupling to the next row from both sides.
    """
    D, both = matrix.middle, matrix.after.copy()
    both[:-1] += matrix.before[1:].swapaxes(-1, -2)  # at the middle each lane has its own side
    diagonal = np.stack([D[..., 0, 0], D[..., 0, 1] + D[..., 1, 0], D[..., 1, 1]], axis=1)
    coupling = both.transpose(0, 2, 3, 1).reshape(len(D), 4, LANES)
    return flat(np.concatenate([diagonal, coupling], axis=1))


def solution_tape(matrix: Chains) -> FloatArray:
    """Factorise A from both ends to the middle; return its tape, shape (48 m,).

        y_j = r_j - L_j y_{j-1},   x_j = D_j⁻¹ y_j - U_j x_{j+1}
        L_j = B_j D_{j-1}⁻¹,   D_j = A_jj - L_j F_{j-1},   U_j = D_j⁻¹ F_j

    B and F are the couplings to the row before and to the next row. In the last row the two chains
    of a lamina meet in a 4×4 system. The blocks of its inverse take the places of D⁻¹ and U, and
    the swapped y takes the place of the next x.

    Returns:
        -L_j, D_j⁻¹, -U_j of each row.
    """
    m = len(matrix.middle)
    is_empty = ~matrix.middle.any(axis=(2, 3))
    D = matrix.middle.copy()
    D[is_empty] = np.eye(BLOCK)
    lower, inverse, upper = (np.zeros_like(D) for _ in range(3))
    for j in range(m):
        if j:
            lower[j] = -matrix.before[j] @ inverse[j - 1]
            D[j] += lower[j] @ matrix.after[j - 1]
        if j < m - 1:
            inverse[j] = np.linalg.inv(D[j])
            upper[j] = -inverse[j] @ matrix.after[j]
    for near, far in ((0, 1), (2, 3)):
        meeting = np.linalg.inv(
            np.block([[D[-1, near], matrix.after[-1, near]], [matrix.after[-1, far], D[-1, far]]])
        )
        inverse[-1, near], upper[-1, near] = meeting[:2, :2], meeting[:2, 2:]
        upper[-1, far], inverse[-1, far] = meeting[2:, :2], meeting[2:, 2:]
    return _tape(lower, inverse, upper)


def _tape(*blocks: FloatArray) -> FloatArray:
    """Return 2×2 blocks of shape (m, lanes, 2, 2) as one tape, each entry for all lanes."""
    return flat(np.stack([block.transpose(0, 2, 3, 1) for block in blocks], axis=1))


def flat(values: FloatArray) -> FloatArray:
    """Return all values as one row that begins at a cache line."""
    result = simd.aligned_zeros(values.size)
    result[:] = values.ravel()
    return result

"""The semi-discrete equations of motion, whatever made them.

    M a + C v + K u = -(m_b q''_b + c_b q'_b + k_b q_b) + H^T lambda,   gap = H u + g0

u holds the free dofs in the fixed frame, q_b(t) the one motion that all clamped dofs share (paper
eq. 10). What the matrices come from (beam, continuum, point mass) and how they are integrated is
known elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from delam_fem.numerics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class BaseCoupling:
    """Columns and corner of M, C, K that belong to the moving base (paper eq. 9).

    Attributes:
        mass: M_ba summed over the base dofs, shape (n,) [kg].
        damping: C_ba likewise, shape (n,) [N s/m].
        stiffness: K_ba likewise, shape (n,) [N/m].
        corner: (M_aa, C_aa, K_aa) summed over the base dofs [kg, N s/m, N/m].
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    corner: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def none(cls, n: int) -> BaseCoupling:
        """Return the coupling of n dofs to a base that does nothing."""
        return cls(np.zeros(n), np.zeros(n), np.zeros(n))


@dataclass(frozen=True)
class Operators:
    """Matrices of one semi-discrete contact problem; SI units, float64, never changed.

    Attributes:
        mass: M, the mass matrix of the time integration, CSR (n, n).
        damping: C, CSR (n, n).
        stiffness: K, CSR (n, n).
        lumped_mass: diagonal of the lumped mass matrix, shape (n,); "lumped" impulses act on it.
        base: coupling of the free dofs to the base.
        gap_matrix: H, CSR (n_pairs, n); gap rate = H v.
        gap0: gap at rest, shape (n_pairs,) [m]; positive is open.
        observed: dofs whose motion is recorded at each step, shape (n_observed,).
    """

    mass: sp.csr_matrix
    damping: sp.csr_matrix
    stiffness: sp.csr_matrix
    lumped_mass: FloatArray
    base: BaseCoupling
    gap_matrix: sp.csr_matrix
    gap0: FloatArray
    observed: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            ValueError: a matrix or vector does not fit the number of dofs or of pairs.
        """
        n, pairs = self.n_dofs, self.n_pairs
        shapes = {
            "mass": (self.mass.shape, (n, n)),
            "damping": (self.damping.shape, (n, n)),
            "stiffness": (self.stiffness.shape, (n, n)),
            "lumped_mass": (self.lumped_mass.shape, (n,)),
            "base.mass": (self.base.mass.shape, (n,)),
            "base.damping": (self.base.damping.shape, (n,)),
            "base.stiffness": (self.base.stiffness.shape, (n,)),
            "gap_matrix": (self.gap_matrix.shape, (pairs, n)),
        }
        for name, (given, expected) in shapes.items():
            if given != expected:
                raise ValueError(f"operators: {name} has shape {given}, expected {expected}")
        if self.observed.size and not (0 <= self.observed.min() <= self.observed.max() < n):
            raise ValueError(f"operators: observed dofs must lie in 0..{n - 1}: {self.observed}")

    @property
    def n_dofs(self) -> int:
        """Number of free dofs."""
        return int(self.mass.shape[0])

    @property
    def n_probes(self) -> int:
        """Number of probes."""
        return int(self.observed.size)

    @property
    def n_pairs(self) -> int:
        """Number of contact pairs."""
        return int(self.gap0.shape[0])

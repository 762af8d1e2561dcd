"""The semi-discrete equations of motion, independent of the discretisation.

    M a + C v + K u = -(m_b q''_b + c_b q'_b + k_b q_b) + H^T lambda,   gap = H u + g0

u holds the free dofs in the fixed frame, q_b(t) is the motion that all clamped dofs share (paper
eq. 10). This module does not know where the matrices come from (beam, continuum, point mass) or how
they are integrated in time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
import scipy.sparse as sp

from delam_fem.numerics.arrays import FloatArray
from delam_fem.system.errors import CaseError, require


@dataclass(frozen=True)
class BaseCoupling:
    """The columns and the corner of M, C, K that belong to the moving base (paper eq. 9).

    Attributes:
        mass: M_ba summed over the base dofs, shape (n,) [kg].
        damping: C_ba summed over the base dofs, shape (n,) [N s/m].
        stiffness: K_ba summed over the base dofs, shape (n,) [N/m].
        corner: (M_aa, C_aa, K_aa) summed over the base dofs [kg, N s/m, N/m].
        is_force: whether the columns are those of a force; see `force`.
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    corner: tuple[float, float, float] = (0.0, 0.0, 0.0)
    is_force: bool = False

    @classmethod
    def force(cls, load: FloatArray) -> BaseCoupling:
        """Return the coupling of a force while the base rests.

        The drive q(t) is then the force [N], and K_ba = -load: engines need not know what q is.

        Args:
            load: loads on the free dofs by a unit force, shape (n,) [N/N].
        """
        nothing = np.zeros(load.size)
        return cls(nothing, nothing, -load, is_force=True)

    @classmethod
    def none(cls, n: int) -> BaseCoupling:
        """Return the coupling of n dofs to a base that has no effect on them."""
        return cls(np.zeros(n), np.zeros(n), np.zeros(n))


class Recorded:
    """What operators have whatever holds their matrices: numbers of pairs, probes and sensors."""

    gap0: FloatArray
    lumped_mass: FloatArray | None
    probes: sp.csr_matrix
    sensors: sp.csr_matrix

    def _complete(self, n: int, further: Mapping[str, tuple[int, ...]], text: str) -> None:
        """Replace missing probes and sensors by an empty matrix; check the shapes.

        Args:
            n: number of own dofs.
            further: expected shapes of further arrays by name, which are checked first.
            text: of the error, with {name}, {given} and {expected}.

        Raises:
            ValueError: an array has another shape.
        """
        for name in ("probes", "sensors"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, sp.csr_matrix((0, n)))
        shapes: dict[str, tuple[int, ...]] = {
            **further,
            "lumped_mass": (n,),
            "base.mass": (n,),
            "base.damping": (n,),
            "base.stiffness": (n,),
            "gap_matrix": (self.n_pairs, n),
            "pair_weights": (self.n_pairs,),
            "probes": (self.n_probes, n),
            "sensors": (self.n_sensors, n),
        }
        for name, expected in shapes.items():
            array = attrgetter(name)(self)
            if array is not None and array.shape != expected:
                raise ValueError(text.format(name=name, given=array.shape, expected=expected))

    @property
    def n_probes(self) -> int:
        """Number of probes."""
        return int(self.probes.shape[0])

    @property
    def n_sensors(self) -> int:
        """Number of functionals of sensors."""
        return int(self.sensors.shape[0])

    @property
    def observed(self) -> sp.csr_matrix:
        """Probes and sensors, all that is recorded of u and of v: their rows, own columns."""
        return sp.vstack([self.probes, self.sensors], format="csr")

    @property
    def n_pairs(self) -> int:
        """Number of contact pairs."""
        return int(self.gap0.shape[0])

    def require_lumped_mass(self) -> FloatArray:
        """Return the diagonal of the lumped mass at the own dofs, shape (n_own,).

        Raises:
            ValueError: there is no lumped mass.
        """
        if self.lumped_mass is None:
            raise ValueError(
                'operators: lumped_mass is missing, but impulse = "lumped" acts on it; give it, or '
                'take impulse = "consistent"'
            )
        return self.lumped_mass


@dataclass(frozen=True)
class Operators(Recorded):
    """Matrices of one semi-discrete contact problem, in SI units and float64; never changed.

    Attributes:
        mass: M, the mass matrix of the time integration, CSR (n, n).
        damping: C, CSR (n, n).
        stiffness: K, CSR (n, n).
        base: coupling of the free dofs to the base.
        gap_matrix: H, CSR (n_pairs, n); gap rate = H v.
        gap0: gap at rest, shape (n_pairs,) [m]; positive is open.
        lumped_mass: diagonal of the lumped mass matrix, on which "lumped" impulses act, shape (n,);
            None: there is none.
        pair_weights: factors of the stiffness and damping of each pair's spring, shape (n_pairs,):
            tributary lengths [m] for springs per length, areas [m2] for springs per area. None:
            springs are per pair, as in the paper.
        probes: the quantities that are recorded at every step, as linear functionals of u and of v,
            CSR (n_probes, n). None: no probes (an empty matrix).
        sensors: further functionals of u and of v that are recorded at every step, from which
            signals of sensors follow, CSR (n_sensors, n). None: none.
        rayleigh: α and β at each dof, constant on each body, if C = α M + β K holds to round-off,
            each of shape (n,) [1/s, s]; engines may then need fewer products. None: no word on C.
    """

    mass: sp.csr_matrix
    damping: sp.csr_matrix
    stiffness: sp.csr_matrix
    base: BaseCoupling
    gap_matrix: sp.csr_matrix
    gap0: FloatArray
    lumped_mass: FloatArray | None = None
    pair_weights: FloatArray | None = None
    probes: sp.csr_matrix = None
    sensors: sp.csr_matrix = None
    rayleigh: tuple[FloatArray, FloatArray] | None = None

    def __post_init__(self) -> None:
        """Check the shapes; replace missing probes and sensors by an empty matrix.

        Raises:
            CaseError: a matrix is not sparse or not finite, or a mass is negative.
            ValueError: a matrix or vector does not fit the number of dofs or of pairs.
        """
        for name in ("mass", "damping", "stiffness", "gap_matrix"):
            given = getattr(self, name)
            if not sp.issparse(given):
                raise CaseError(
                    f"operators: {name}: expected a sparse matrix, given {type(given).__name__}; "
                    f"write scipy.sparse.csr_matrix({name})"
                )
            require(np.isfinite(given.data).all(), f"operators: {name}", "finite numbers", given)
        least = float(self.mass.diagonal().min(initial=0.0))
        require(least >= 0.0, "operators: mass", "a diagonal without negative numbers", least)
        n = self.n_dofs
        square = {"mass": (n, n), "damping": (n, n), "stiffness": (n, n)}
        self._complete(n, square, "operators: {name} has shape {given}, expected {expected}")

    @property
    def n_dofs(self) -> int:
        """Number of free dofs."""
        return int(self.mass.shape[0])

    @property
    def n_own(self) -> int:
        """Number of free dofs of this process, which has them all."""
        return self.n_dofs

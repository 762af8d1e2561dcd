"""A few modes of each part, and the flexibility of the modes that are left out.

The displacement is split as u = ι q_b + Φ q + u_r. Φ has the lowest modes of each part, φᵀ M φ = 1.
The part u_r of the omitted modes has no inertia (a massless boundary), but Rayleigh damping
C = α M + β K makes it creep:

    q'' + c q' + ω² q = Φᵀ (f + Hᵀ λ),   c = α + β ω² = 2 ζ ω                                  (R1)
    β s' + s = λ,   u_r = Σ X s,   X = R Hᵀ,   R = K⁻¹ - Φ ω⁻² Φᵀ                              (R2)
    gap = g0 + h q_b + G q + Σ W s,   h = H ι,   G = H Φ,   W = H R Hᵀ                         (R3)

Sums run over the parts, each of which has its own β. s is the contact force of each pair as the
omitted modes of a part feel it, late by β. The drive q_b is the motion of the base, with the static
deflection ι = -K⁻¹ k_b: u - ι q_b is the motion seen from the base, and

    f = -(m_b + M ι) q_b'' - (c_b + C ι) q_b'                                                  (R4)

If the drive is a force, ι = -R k_b is the static deflection of the omitted modes, f = -k_b q_b. R2
neglects α, the inertia of omitted modes, and what f does to them, each of order (ω/ω_omitted)².

W is positive definite as long as enough modes are left out. Contact forces are then bounded, and
rigid contact, 0 <= λ ⊥ gap >= 0, needs no coefficient of restitution.

Under constant loads f all of this counts from the static shape K⁻¹ f, which the gaps at rest and
the displacements then contain.

Source: D. Monjaraz-Tec, J. Gross, M. Krack, "A massless boundary component mode synthesis method
for elastodynamic contact problems", Comput. Struct. 260 (2022); MacNeal, Comput. Struct. 1 (1971).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from delam_fem.model.factors import factored, regular
from delam_fem.model.linear import lowest, normalised
from delam_fem.model.operators import Operators
from delam_fem.numerics.types import FloatArray, IntArray
from delam_fem.system.errors import CaseError, require

NOT_RAYLEIGH = 1e-6
"""Largest entry of C - α M - β K relative to that of C, above which C is not of Rayleigh's form."""
MASSLESS = 1e-9
"""Eigenvalue of M, scaled to a unit diagonal, below which a motion has no mass."""
ROUND_OFF = 1e-13
"""Flexibility without mass at a pair over that of the modes, below which there is none."""
TOO_RIGID = 1e-11
"""Smallest eigenvalue of W, scaled to a unit diagonal, below which pairs lack flexibility."""


@dataclass(frozen=True)
class Reduced:
    """A reduced problem with m modes, n pairs, c parts and p probes.

    Attributes:
        squares: ω², part by part and increasing within each, shape (m,) [1/s2].
        damping: c of R1, shape (m,) [1/s].
        creep: β of each part, shape (c,) [s].
        gap_modes: G, shape (n, m).
        compliance: W of each part, shape (c, n, n) [m/N].
        gap0: gap at rest, shape (n,) [m].
        gap_drive: h of the drive and of each further force, shape (d, n).
        loads: modal loads by -q_b'', -q_b' and -q_b (R4), shape (3, m).
        force_loads: modal loads by a unit of each further force, shape (d - 1, m).
        base_mass: mass that moves with the base where q = 0 [kg].
        base_damping: damping of that motion [N s/m].
        probes: rows that read the probes, CSR (p, n_dofs).
        shapes: Φ, shape (n_dofs, m).
        residual: X of each part, shape (c, n_dofs, n) [m/N].
        drive: ι of the drive and of each further force, shape (n_dofs, d).
        sag: K⁻¹ f under the constant loads f of the operators, from which q and s count, (n_dofs,).
        sag_energy: potential of the loads and strain energy there, -f·sag / 2 [J].
    """

    squares: FloatArray
    damping: FloatArray
    creep: FloatArray
    gap_modes: FloatArray
    compliance: FloatArray
    gap0: FloatArray
    gap_drive: FloatArray
    loads: FloatArray
    force_loads: FloatArray
    base_mass: float
    base_damping: float
    probes: sp.csr_matrix
    shapes: FloatArray
    residual: FloatArray
    drive: FloatArray
    sag: FloatArray
    sag_energy: float

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.squares.size)

    @property
    def n_pairs(self) -> int:
        """Number of contact pairs."""
        return int(self.gap0.size)

    @property
    def n_parts(self) -> int:
        """Number of parts."""
        return int(self.creep.size)

    @property
    def n_state(self) -> int:
        """Length of a state (q, q', s of each part)."""
        return 2 * self.n_modes + self.n_parts * self.n_pairs

    def displacement(self, q: FloatArray, s: FloatArray, drive: FloatArray) -> FloatArray:
        """Return the displacements of all dofs, shape (k, n_dofs).

        Args:
            q: amplitudes of the modes, shape (k, m).
            s: late contact forces, shape (k, c, n) [N].
            drive: q_b and further forces, shape (k, d).
        """
        late = np.einsum("kcn,cdn->kd", s, self.residual, optimize=True)
        return np.asarray(q @ self.shapes.T + late + drive @ self.drive.T + self.sag)

    def velocity(self, v: FloatArray, drive_rate: FloatArray) -> FloatArray:
        """Return the velocities of all dofs without that of u_r, shape (k, n_dofs).

        Args:
            v: rates of the amplitudes of the modes, shape (k, m).
            drive_rate: q_b' and the rates of further forces, shape (k, d).
        """
        return np.asarray(v @ self.shapes.T + drive_rate @ self.drive.T)


def reduce(operators: Operators, modes: int) -> Reduced:
    """Return the reduced problem of operators.

    Parts are groups of dofs that M, C and K do not couple: the laminae if they are apart, the whole
    structure if they are bonded somewhere.

    Args:
        operators: the semi-discrete problem; every part is held.
        modes: number of modes kept of each part, at most all that have mass.

    Raises:
        CaseError: damping is not of Rayleigh's form, a part can move as a rigid body, or the
            omitted modes have no flexibility at some pairs.
    """
    require(modes >= 1, "model.modes", "at least 1", modes)
    o = operators
    H = operators.gap_matrix
    k_b = operators.base.stiffness
    each = [_piece(o, dofs, matrices, modes) for dofs, *matrices in o.bodies()]
    of_part, damping, creep, Phi, at_gaps, at_drive = zip(*each, strict=True)
    W = np.stack([H @ response for response in at_gaps])
    W = 0.5 * (W + W.transpose(0, 2, 1))
    shapes = np.concatenate(Phi, axis=1)
    squares = np.concatenate(of_part)
    G = H @ shapes
    _require_flexible(W.sum(axis=0), (G**2 / squares).sum(axis=1), squares.size // len(each))
    of_drives = -sum(at_drive, np.zeros((k_b.size, 1 + o.n_forces)))
    iota = of_drives[:, 0]
    columns = np.stack([o.base.mass, o.base.damping, k_b])
    moved = columns + np.stack([A @ iota for A in (o.mass, o.damping, o.stiffness)])
    if o.base.is_force:
        loads = columns @ shapes
        base_mass = 0.0
        base_damping = 0.0
    else:
        loads = moved @ shapes
        loads[2] = 0.0  # K ι + k_b is round-off
        base_mass, base_damping = (
            float(iota @ (moved[j] + columns[j]) + o.base.corner[j]) for j in range(2)
        )
    sag = np.zeros_like(k_b) if o.load is None else factored(o.stiffness).solve(o.load)
    return Reduced(
        squares=squares,
        damping=np.concatenate(damping),
        creep=np.array(creep),
        gap_modes=np.ascontiguousarray(G),
        compliance=W,
        gap0=o.gap0 + H @ sag if sag.any() else o.gap0,
        gap_drive=np.ascontiguousarray((H @ of_drives).T),
        loads=loads,
        force_loads=o.forces.T @ shapes,
        base_mass=base_mass,
        base_damping=base_damping,
        probes=o.probes,
        shapes=shapes,
        residual=np.stack(at_gaps),
        drive=of_drives,
        sag=sag,
        sag_energy=0.0 if o.load is None else -0.5 * float(o.load @ sag),
    )


def _piece(
    o: Operators, dofs: IntArray, matrices: Sequence[sp.csc_matrix], modes: int
) -> tuple[FloatArray, FloatArray, float, FloatArray, FloatArray, FloatArray]:
    """Return the modes of the part that has some dofs, and the flexibility of its omitted modes.

    Returns:
        ω² and c of R1, β; Φ in all dofs; R Hᵀ; K⁻¹ k_b of a base, or R k_b of a force, and R k_b
        of further forces.
    """
    M, C, K = matrices
    if modes >= dofs.size:
        size = M.diagonal()  # there are as many modes as independent motions that have mass
        scale = sp.diags(1.0 / np.sqrt(np.where(size > 0.0, size, 1.0)))
        modes = int(np.linalg.matrix_rank((scale @ M @ scale).toarray(), MASSLESS, hermitian=True))
    frequencies, vectors = lowest(K, M, min(max(modes, 2), dofs.size))
    vectors = normalised(vectors, M)
    squares = (2.0 * np.pi * frequencies) ** 2
    alpha, beta = _rayleigh(M, C, K, squares, vectors)
    squares = squares[:modes]
    vectors = vectors[:, :modes]
    n_pairs = o.n_pairs
    loads = np.column_stack(
        [o.gap_matrix[:, dofs].T.toarray(), o.base.stiffness[dofs], -o.forces[dofs]]
    )
    with np.errstate(all="ignore"):
        solution = regular(K)(loads)
    if not np.isfinite(solution).all():
        raise CaseError("model.modes: a part is not held; support each part")
    # K r + M Φ μ = f, Φᵀ M r = 0 is R f without the cancellation of K⁻¹ f - Φ ω⁻² Φᵀ f
    of_modes = sp.csc_matrix(M @ vectors)
    bordered = sp.bmat([[K, of_modes], [of_modes.T, None]], format="csc")
    residual = np.zeros((o.n_dofs, loads.shape[1]))
    residual[dofs] = regular(bordered)(np.pad(loads, ((0, squares.size), (0, 0))))[: dofs.size]
    if not o.base.is_force:
        residual[dofs, n_pairs] = solution[:, n_pairs]
    shapes = np.zeros((o.n_dofs, squares.size))
    shapes[dofs] = vectors
    at_gaps, at_drives = np.split(residual, [n_pairs], axis=1)
    return squares, alpha + beta * squares, beta, shapes, at_gaps, at_drives


def _rayleigh(
    M: sp.csc_matrix, C: sp.csc_matrix, K: sp.csc_matrix, squares: FloatArray, vectors: FloatArray
) -> tuple[float, float]:
    """Return α and β of C = α M + β K, from the two lowest modes.

    Raises:
        CaseError: C has another form.
    """
    d = np.einsum("ij,ij->j", vectors, C @ vectors)
    beta = float((d[1] - d[0]) / (squares[1] - squares[0])) if d.size > 1 else 0.0
    alpha = float(d[0] - beta * squares[0])
    if abs(C - alpha * M - beta * K).max() > NOT_RAYLEIGH * abs(C).max():
        raise CaseError("model.modes: expected C = alpha M + beta K in each part")
    is_round_off = abs(beta) * squares[-1] <= 1e-9 * abs(d[-1])
    return alpha, 0.0 if is_round_off else beta


def _require_flexible(W: FloatArray, of_modes: FloatArray, modes: int) -> None:
    """Check that the omitted modes give way at every pair.

    Args:
        W: flexibility of the omitted modes at the pairs, shape (n, n) [m/N].
        of_modes: flexibility of the modes at each pair, shape (n,) [m/N].
        modes: number of modes of each part.

    Raises:
        CaseError: they do not give way at some pairs.
    """
    diagonal = W.diagonal()
    scale = 1.0 / np.sqrt(np.where(diagonal > ROUND_OFF * of_modes, diagonal, 1e300))
    if W.size and np.linalg.eigvalsh(scale[:, None] * W * scale)[0] < TOO_RIGID:
        raise CaseError(
            f"model.modes: the modes beyond the lowest {modes} cannot follow all {len(W)} contact "
            "points; use fewer modes, more mesh.elements, fewer contact.points_per_element or, "
            "beside beams, stops and impactors at nodes"
        )

"""Operators and layout of a bonded stack, from the matrices of its unknowns.

Both discretisations (closed_form.py and beam.py) give mass and stiffness in the unknowns of
`network.py`; this module does the rest, which both share.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.case.layers import Delamination, open_ends
from delam_fem.model.beams.laminae import completed, gap_at_rest, pair_weights
from delam_fem.model.beams.masses import added_mass
from delam_fem.model.beams.network import Network, eliminated, surface_strain
from delam_fem.model.layout import Layout, Part, Probe, Structure, Support
from delam_fem.model.operators import BaseCoupling, Operators
from delam_fem.model.pairing import gap_matrix, neighbours, probe_rows
from delam_fem.model.vibration import kept_closed, lowest
from delam_fem.numerics import rayleigh
from delam_fem.numerics.arrays import FloatArray

_TWO_PI = 2.0 * np.pi


def structure(
    case: Case, network: Network, mass: sp.spmatrix, stiffness: sp.spmatrix, lumped: FloatArray
) -> Structure:
    """Return the discretised stack.

    Args:
        case: the case.
        network: its unknowns.
        mass: M in the columns of the network.
        stiffness: K in the columns of the network.
        lumped: diagonal of the lumped mass in the columns of the network.
    """
    n = network.n_free
    layout = layout_of(case, network)
    if case.time.mass == "lumped":
        mass = sp.diags(lumped)
    added, diagonal = added_mass(case, layout, n)
    M = sp.csr_matrix(sp.csr_matrix(mass)[: n + 1, : n + 1] + added)
    K = eliminated(stiffness, n + 1) + _springs(case, network)
    alpha, beta = damping(case, layout, M[:n, :n], K[:n, :n])
    C = sp.csr_matrix(alpha * M + beta * K)
    m, c, k = (matrix[:n, n].toarray().ravel() for matrix in (M, C, K))
    corner = tuple(float(matrix[n, n]) for matrix in (M, C, K))
    operators = Operators(
        mass=sp.csr_matrix(M[:n, :n]),
        damping=sp.csr_matrix(C[:n, :n]),
        stiffness=sp.csr_matrix(K[:n, :n]),
        lumped_mass=lumped[:n] + diagonal[:n],
        base=BaseCoupling(m, c, k, corner=(corner[0], corner[1], corner[2])),
        gap_matrix=gap_matrix(layout.parts, layout.interfaces, n),
        gap0=gap_at_rest(case, layout),
        pair_weights=pair_weights(case, layout),
        probes=probe_rows(layout, n),
    )
    return completed(Structure(operators, layout), case, surface_strain(network, stiffness))


def _springs(case: Case, network: Network) -> sp.csr_matrix:
    """Return the stiffness of the slopes at clamped ends that yield, with the base as last row."""
    ends = ((0, case.support.start), (-1, case.support.end))
    slopes = [network.dofs[:, node, 1] for node, kind in ends if kind == "clamped"]
    diagonal = np.zeros(network.n_free + 1)
    if slopes and case.support.rotational_stiffness is not None:
        diagonal[np.concatenate(slopes)] = case.support.rotational_stiffness
    return sp.csr_matrix(sp.diags(diagonal))


def layout_of(case: Case, network: Network) -> Layout:
    """Return the parts, interfaces, probes and supports of a stack."""
    x = network.x
    cells = x.size - 1
    parts = tuple(
        Part(
            lamina.name,
            x,
            network.dofs[i],
            np.full(cells, lamina.flexural_rigidity),
            np.full(cells, lamina.mass_per_length),
        )
        for i, lamina in enumerate(case.lamina)
    )
    interfaces = neighbours(parts, case.contact.points_per_element)
    held = ((0, case.support.start), (cells, case.support.end))
    supports = tuple(
        Support(i, node, kind) for i in range(len(parts)) for node, kind in held if kind != "free"
    )
    return Layout(parts, interfaces, probes_of(case, x), supports)


def probes_of(case: Case, x: FloatArray) -> tuple[Probe, ...]:
    """Return the probes: a reference probe on each lamina, and both sides of each delamination.

    The reference probes are at the free end of the longest delamination, or at its middle.
    """
    node, name = _reference(case, x)
    probes = [Probe(name, i, node) for i in range(len(case.lamina))]
    names = [lamina.name for lamina in case.lamina]
    for number, own in enumerate(case.delamination):
        middle = _nearest(x, 0.5 * (own.start + own.end))
        for side in own.between:
            part = names.index(side)
            if (part, middle) not in {(probe.part, probe.point) for probe in probes}:
                probes.append(Probe(f"delamination-{number}-{side}", part, middle))
    return tuple(probes)


def _reference(case: Case, x: FloatArray) -> tuple[int, str]:
    """Return node and name of the reference probes."""
    L, kinds = case.length, (case.support.start, case.support.end)
    ends = {"start": 0, "end": x.size - 1}
    if not case.delamination:
        free = [node for node, kind in zip(ends.values(), kinds, strict=True) if kind == "free"]
        return (free[-1], "tip") if free else (_nearest(x, 0.5 * L), "middle")
    longest: Delamination = max(case.delamination, key=lambda own: own.end - own.start)
    free_ends = open_ends(longest, L, case.support)
    if free_ends:
        return ends[free_ends[-1]], "tip"
    return _nearest(x, 0.5 * (longest.start + longest.end)), "middle"


def _nearest(x: FloatArray, place: float) -> int:
    """Return the inner node nearest to a place."""
    return 1 + int(np.argmin(np.abs(x[1:-1] - place)))


def damping(case: Case, layout: Layout, M: sp.csr_matrix, K: sp.csr_matrix) -> tuple[float, float]:
    """Return alpha [1/s] and beta [s] of C = alpha M + beta K of a stack.

    The damping ratio holds at the lowest modes of the structure with its delaminations kept closed.
    Where laminae have different ratios, each counts with its share of the strain energy of the
    bonded stack in bending.

    Args:
        case: damping ratios and model.
        layout: of the structure.
        M: mass of the free dofs.
        K: stiffness of the free dofs.
    """
    S = kept_closed(layout, M.shape[0])
    rigid = n_rigid(case)
    found, _ = lowest(S.T @ K @ S, S.T @ M @ S, rigid + 2, is_floating=rigid > 0)
    first, second = (_TWO_PI * found[rigid : rigid + 2]).tolist()
    return rayleigh.coefficients(_damping_ratio(case), first, second, case.damping.rayleigh)


def n_rigid(case: Case) -> int:
    """Return the number of rigid motions that the supports leave to a stack kept closed."""
    kinds = (case.support.start, case.support.end)
    if "clamped" in kinds:
        return 0
    return 2 - kinds.count("pinned")


def _damping_ratio(case: Case) -> float:
    """Return the damping ratio of the bonded stack: the mean, weighted by bending stiffness."""
    EA = np.array([lamina.axial_rigidity for lamina in case.lamina])
    thickness = np.array([lamina.thickness for lamina in case.lamina])
    z = np.cumsum(thickness) - 0.5 * thickness
    z = z - EA @ z / EA.sum()
    weights = np.array([lamina.flexural_rigidity for lamina in case.lamina]) + EA * z**2
    ratios = [lamina.damping_ratio for lamina in case.lamina]
    if len(set(ratios)) == 1:
        return ratios[0]
    return float(weights @ ratios / weights.sum())

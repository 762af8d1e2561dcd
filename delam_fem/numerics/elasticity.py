"""Linear elasticity of materials: isotropic ones, orthotropic layers, laminates of such layers.

Stresses and strains are vectors (Voigt): xx, yy, xy in two dimensions, which are in plane stress,
and xx, yy, zz, xy, xz, yz in three; shear strains are 2 eps_ij. x lies along a lamina, y through
its thickness, z across.

An orthotropic material has three axes: 1 along its fibres, 2 across them in the plane of the
layer, 3 through its thickness. Its compliance there is (S. W. Tsai, H. T. Hahn, "Introduction to
Composite Materials" (1980), section 1.4; R. M. Jones, "Mechanics of Composite Materials", 2nd ed.
(1999), section 2.3)

    S_11 = 1/E1,  S_22 = 1/E2,  S_33 = 1/E3,  S_12 = -nu12/E1,  S_13 = -nu13/E1,  S_23 = -nu23/E2,
    and 1/G12, 1/G13, 1/G23 of the shears.

`angle` turns axis 1 from x towards z.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from delam_fem.numerics.types import FloatArray

DIRECTIONS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))}
"""Directions i, j of the components of stresses and strains, by dimension."""
IN_PLANE = (0, 1, 3)
"""Components of three dimensions that plane stress keeps: xx, yy, xy."""
OF_LAYER = (0, 2, 4)
"""Components of three dimensions in the plane of a layer: xx, zz, xz."""


def isotropic(dim: int, poisson: float) -> FloatArray:
    """Return the elasticity D of an isotropic material for E = 1, in 2D that of plane stress.

    Returns:
        Shape (3, 3) or (6, 6), see above [-].
    """
    nu = poisson
    if dim == 2:
        direct = np.array([[1.0, nu], [nu, 1.0]]) / (1.0 - nu**2)
    else:
        direct = (np.eye(3) + nu / (1.0 - 2.0 * nu)) / (1.0 + nu)
    result = np.zeros((3 * dim - 3, 3 * dim - 3))
    result[:dim, :dim] = direct
    shear = np.arange(dim, 3 * dim - 3)
    result[shear, shear] = 0.5 / (1.0 + nu)
    return result


def compliance(
    moduli: Sequence[float], shear_moduli: Sequence[float], ratios: Sequence[float]
) -> FloatArray:
    """Return the compliance S of an orthotropic material whose fibres lie along x.

    Args:
        moduli: E1, E2, E3 [Pa].
        shear_moduli: G12, G13, G23 [Pa].
        ratios: Poisson's ratios nu12, nu13, nu23 [-].

    Returns:
        Shape (6, 6) [1/Pa]: axis 1 is x, 2 is z, 3 is y.
    """
    E1, E2, E3 = moduli
    G12, G13, G23 = shear_moduli
    nu12, nu13, nu23 = ratios
    S = np.diag([1.0 / E1, 1.0 / E3, 1.0 / E2, 1.0 / G13, 1.0 / G12, 1.0 / G23])
    S[0, 2] = S[2, 0] = -nu12 / E1
    S[0, 1] = S[1, 0] = -nu13 / E1
    S[1, 2] = S[2, 1] = -nu23 / E2
    return S


def is_admissible(S: FloatArray) -> bool:
    """Return whether any strain of a compliance has a positive energy."""
    scale = 1.0 / np.sqrt(np.diag(S))
    return bool(np.linalg.eigvalsh(scale[:, None] * S * scale).min() > 0.0)


def turned(S: FloatArray, angle: float) -> FloatArray:
    """Return a compliance in x, y, z whose axis 1 is turned from x towards z.

    Args:
        S: compliance of fibres along x, shape (6, 6) [1/Pa].
        angle: [deg].
    """
    # cosine and sine of quarter turns are exact: 0 and 90 degrees couple nothing
    quarters, remainder = divmod(angle, 90.0)
    turn = np.deg2rad(remainder)
    first = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])[int(quarters) % 4]
    c, s = first @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    axes = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])  # rows: 1, y, 2 in x, y, z
    # strains in the material's axes from those in x, y, z, both with 2 eps_ij
    T = np.empty((6, 6))
    for row, (i, j) in enumerate(DIRECTIONS[3]):
        for column, (k, m) in enumerate(DIRECTIONS[3]):
            value = axes[i, k] * axes[j, m]
            if k != m:
                value = 0.5 * (value + axes[i, m] * axes[j, k])
            T[row, column] = value * (1.0 if i == j else 2.0)
    # sigma' S sigma is the same energy in both: stresses turn with the inverse transpose of T
    inverse = np.linalg.inv(T)
    result = inverse @ S @ inverse.T
    result[np.abs(result) < _NOTHING * np.abs(result).max()] = 0.0
    return np.asarray(0.5 * (result + result.T))


_NOTHING = 1e-15
"""Compliances below this share of the largest one are round-off."""


def stiffness(S: FloatArray, dim: int) -> FloatArray:
    """Return the elasticity D of a compliance, in 2D that of plane stress, (3, 3) or (6, 6) [Pa].

    What plane stress takes for zero are the stresses with a component along z.
    """
    if dim == 2:
        S = S[np.ix_(IN_PLANE, IN_PLANE)]
    D = np.linalg.inv(S)
    return np.asarray(0.5 * (D + D.T))


def laminate(
    compliances: Sequence[FloatArray], heights: Sequence[float]
) -> tuple[FloatArray, float, float]:
    """Return the stiffness of a laminate and what of it a narrow beam along x has.

    Classical laminate theory: forces and moments per width are (N, M) = [[A, B], [B, D]] (eps_0,
    kappa), with A, B, D = Σ ∫ Q (1, y, y²) dy and Q the stiffness of each layer in plane stress
    (R. M. Jones, section 4.2). A narrow beam has no forces and moments but N_x and M_x: it is free
    to curve across and to twist.

    Args:
        compliances: of the layers from the bottom, in x, y, z, each of shape (6, 6) [1/Pa].
        heights: of the layers [m].

    Returns:
        [[A, B], [B, D]] about the middle of the height, shape (6, 6) [N/m, N, N m]; the stiffness
        N_x / eps_x [N/m] and the bending stiffness M_x / kappa_x [N m] per width.
    """
    y = np.cumsum([0.0, *heights]) - 0.5 * sum(heights)
    A, B, D = np.zeros((3, 3, 3))
    for S, low, high in zip(compliances, y[:-1], y[1:], strict=True):
        Q = np.linalg.inv(S[np.ix_(OF_LAYER, OF_LAYER)])
        A += Q * (high - low)
        B += Q * (high**2 - low**2) / 2.0
        D += Q * (high**3 - low**3) / 3.0
    matrix = np.block([[A, B], [B, D]])
    flexibility = np.linalg.inv(matrix)
    return matrix, float(1.0 / flexibility[0, 0]), float(1.0 / flexibility[3, 3])

"""One lamina over rigid ground, where each contact pair is a node and a point that never moves.

    gap_k = u_k + s_k,   H has one entry, 1, in each row,   g0 = s

The ground touches the straight, unstressed lamina along its whole length, or at its tip only. u
counts upwards from the shape s <= 0 in which the lamina would hang under its weight if there were
no ground, so the equation of motion has no load. Laws and schemes see the same `Operators` as with
two laminae.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import scipy.sparse as sp

from delam_fem.api import (
    CURVATURE,
    BaseCoupling,
    FloatArray,
    Lamina,
    Operators,
    Part,
    beam,
    beams,
    columns_of,
    harmonics,
    place_of,
    selection,
)

Touching = Literal["everywhere", "tip"]
"""The nodes that can touch the ground."""
Lift = Literal["tip force", "uniform load", "first mode"]
"""The load that holds the lamina up before it is released."""

N_CLAMP = 2
"""Number of dofs of the clamped node; they are removed."""
GRAVITY = 9.81
"""Acceleration of gravity [m/s2]."""
_BELOW = 1e-9
"""A lifted shape may lie this deep below the ground: round-off, relative to the tip's height."""


def steel_strip(
    frequency: float = 20.0,
    *,
    length: float | None = None,
    thickness: float = 0.003,
    width: float = 0.040,
    damping_ratio: float = 0.0,
) -> Lamina:
    """Return a steel strip (E = 2.1e11 Pa, 7850 kg/m3) with a given lowest frequency.

    The paper gives only the lowest period, about 50 ms; thickness and width are our choice.

    Args:
        frequency: frequency of the first mode as a cantilever [Hz].
        length: length of the strip; if given, it replaces the frequency [m].
        thickness: thickness of the strip [m].
        width: width of the strip [m].
        damping_ratio: D of modes 1 and 2 [-].
    """
    young_modulus, density = 2.1e11, 7850.0
    kappa = thickness * math.sqrt(young_modulus / (12.0 * density))
    fitting = float(beams.cantilever_roots(1)[0]) * math.sqrt(kappa / (2.0 * math.pi * frequency))
    return Lamina(
        name="steel",
        length=length or fitting,
        width=width,
        thickness=thickness,
        density=density,
        young_modulus=young_modulus,
        damping_ratio=damping_ratio,
    )


def nodes(lamina: Lamina, n: int) -> FloatArray:
    """Return the positions of the free nodes of n elements, shape (n,) [m]."""
    return lamina.length * np.arange(1, n + 1) / n


def sag(lamina: Lamina, gravity: float) -> float:
    """Return how far the tip would hang down if there were no ground, ρA g L⁴/(8 EI) [m].

    Args:
        lamina: the strip.
        gravity: g [m/s2].
    """
    return lamina.mass_per_length * gravity * lamina.length**4 / (8.0 * lamina.flexural_rigidity)


def on_ground(
    lamina: Lamina,
    n: int,
    touching: Touching,
    *,
    gravity: float = 0.0,
    gauges: Sequence[float] = (),
) -> Operators:
    """Return the operators of n Hermite elements, clamped at x = 0, over the ground.

    The free dofs run node by node from the clamp to the tip, u before φ. Rayleigh damping gives
    modes 1 and 2 the damping ratio of the lamina.

    Args:
        lamina: the strip.
        n: number of elements, at least 2.
        touching: which nodes are contact pairs.
        gravity: g [m/s2]; 0: a strip without weight.
        gauges: positions of strain gauges from the clamp [m].

    Returns:
        The operators; the probes are u of the tip, and the strains ε = (t/2) u″ at the gauges,
        positive in tension on the side of the ground.

    Raises:
        ValueError: n is below 2.
    """
    if n < 2:
        raise ValueError(f"lamina over ground: expected at least 2 elements, given {n}")
    *matrices, lumped = beam(
        lamina.flexural_rigidity, lamina.mass_per_length, np.full(n, lamina.length / n)
    )
    M, K = (matrix[N_CLAMP:, N_CLAMP:].tocsr() for matrix in matrices)
    first, second = lamina.angular_frequencies(2).tolist()
    alpha, beta = harmonics.coefficients(lamina.damping_ratio, first, second)
    pairs = np.arange(n) if touching == "everywhere" else np.array([n - 1])
    x = np.append(0.0, nodes(lamina, n))
    strip = Part(lamina.name, x, np.arange(-N_CLAMP, 2 * n).reshape(-1, 2), x[1:], x[1:])
    strains = [  # at a node that of the element that begins there
        0.5
        * lamina.mean("thickness")
        * columns_of(strip, place, 2 * n, CURVATURE, min(int(place), n - 1))[:, :-1]
        for place in (place_of(strip, at) for at in gauges)
    ]
    return Operators(
        mass=M,
        damping=sp.csr_matrix(alpha * M + beta * K),
        stiffness=K,
        lumped_mass=lumped[N_CLAMP:],
        base=BaseCoupling.none(2 * n),
        gap_matrix=selection(2 * pairs, 2 * n),
        gap0=-lying(lamina, n, gravity)[2 * pairs],
        probes=sp.vstack([selection([2 * n - 2], 2 * n), *strains], format="csr"),
    )


def lying(lamina: Lamina, n: int, gravity: float) -> FloatArray:
    """Return the shape on the ground, measured from the hanging shape, u and φ, shape (2 n,)."""
    return _shape(lamina, n, "uniform load", sag(lamina, gravity))


def lifted(lamina: Lamina, n: int, tip: float, by: Lift, *, gravity: float = 0.0) -> FloatArray:
    """Return the shape in which the lamina is held up, u and φ of the free dofs, shape (2 n,).

    Args:
        lamina: the strip.
        n: number of elements.
        tip: height of the tip above the ground [m].
        by: the load that holds the lamina, besides its weight.
        gravity: g [m/s2]; 0: a strip without weight.

    Raises:
        ValueError: the weight would keep a part of the strip on the ground.
    """
    hanging = sag(lamina, gravity)
    u = _shape(lamina, n, by, tip + hanging)
    height = u - lying(lamina, n, gravity)
    if height[::2].min() < -_BELOW * tip:
        raise ValueError(
            f"height of the tip: expected enough to lift the whole strip off the ground (a third "
            f"of its sag of {hanging:g} m with a force at the tip), given {tip:g} m"
        )
    return u


def _shape(lamina: Lamina, n: int, by: Lift, tip: float) -> FloatArray:
    """Return the shape of a cantilever without weight under the load `by`, u and φ."""
    xi = nodes(lamina, n) / lamina.length
    if by == "tip force":
        u = (3.0 * xi**2 - xi**3) / 2.0
        slope = (6.0 * xi - 3.0 * xi**2) / 2.0
    elif by == "uniform load":
        u = (6.0 * xi**2 - 4.0 * xi**3 + xi**4) / 3.0
        slope = (12.0 * xi - 12.0 * xi**2 + 4.0 * xi**3) / 3.0
    else:
        step = 1e-4  # the error of the central difference, step² B⁴ / 6, is 2e-8
        u = beams.cantilever_mode(1, xi)
        inside = np.minimum(xi, 1.0 - step)  # the curvature is 0 at the tip
        ends = beams.cantilever_mode(1, inside + step) - beams.cantilever_mode(1, inside - step)
        slope = ends / (2.0 * step)
    return np.ravel(np.column_stack([tip * u, tip / lamina.length * slope]))

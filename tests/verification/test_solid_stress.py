"""Stresses of bent solids beside those of beam theory, which equilibrium alone gives.

A force F at the tip of a cantilever bends it by the moment M = F (L - x), whatever its stiffness.
With y upwards from the middle line, sigma_xx = -M y / I and the largest von Mises stress is its
magnitude. Within some thicknesses of the ends the stress is another.
"""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

import delam_fem as df
from delam_fem.api import assemble

FORCE = 0.5
SOLIDS = {
    "plane-stress": ({"model.kind": "plane-stress", "mesh.elements": 40}, 1e-3),
    "nu 0.3": ({"model.kind": "plane-stress", "mesh.elements": 40, "model.poisson": 0.3}, 1e-3),
    "degree 3": ({"model.kind": "plane-stress", "mesh.elements": 20, "model.degree": 3}, 1e-3),
    "solid": ({"model.kind": "solid", "mesh.elements": 40}, 1e-3),
}
"""Keys, and tolerance relative to the largest stress. Measured: at most 8e-5,
3e-4 with degree 3."""


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("lamina", [0, 1])
def test_bending_stress_of_a_cantilever(name: str, lamina: int) -> None:
    keys, tolerance = SOLIDS[name]
    case = df.preset("paper", keys)
    structure = assemble(case)
    o, body = structure.operators, structure.body
    assert body is not None
    u = spsolve(o.stiffness.tocsc(), FORCE * o.probes[lamina].toarray().ravel())
    shape = body.shape()
    sigma = shape.recovery.stress(body.gathered(u[None], np.zeros(1))[0])
    layer, x = case.lamina[lamina], shape.points[:, 0]
    y = shape.points[:, 1] - 0.5 * layer.thickness - lamina * case.lamina[0].thickness
    expected = -FORCE * (layer.length - x) * y / (layer.width * layer.thickness**3 / 12.0)
    largest = FORCE * layer.length * 6.0 / (layer.width * layer.thickness**2)
    chosen = (shape.lamina == lamina) & (x > 0.1 * layer.length) & (x < 0.95 * layer.length)
    assert np.abs(sigma[chosen, 0] - expected[chosen]).max() < tolerance * largest
    at_top = chosen & (y > 0.4 * layer.thickness)
    assert sigma[at_top, 0].max() < 0.0, "a force upwards compresses the top"
    assert np.abs(sigma[shape.lamina != lamina]).max() < 1e-9 * largest

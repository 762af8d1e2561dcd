"""A discretised case: its operators and what is needed to draw the laminae.

What assembles it (closed form, dolfinx) and what integrates it is known elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from delam_fem.model.operators import Operators
from delam_fem.numerics.arrays import FloatArray


@dataclass(frozen=True)
class Model:
    """Two discretised laminae with opposite nodes.

    The free dofs are ordered lamina by lamina, node by node from the clamp to the tip (the clamped
    node left out), displacement u [m] before slope phi [-].

    Attributes:
        operators: M, C, K, base coupling, gap operator and gap at rest.
        x: positions of the nodes, clamp included, increasing, shape (n_nodes,) [m].
        flexural_rigidity: EI of each cell of each lamina, shape (2, n_nodes - 1) [N m2].
        mass_per_length: rho A of each cell of each lamina, shape (2, n_nodes - 1) [kg/m].
    """

    operators: Operators
    x: FloatArray
    flexural_rigidity: FloatArray
    mass_per_length: FloatArray

    def __post_init__(self) -> None:
        """Check the shapes.

        Raises:
            ValueError: an array does not fit the nodes, or the nodes do not increase.
        """
        if self.x.ndim != 1 or self.x.size < 2 or not np.all(np.diff(self.x) > 0.0):
            raise ValueError(f"model: x must increase over at least two nodes, given {self.x}")
        cells = (2, self.x.size - 1)
        for name in ("flexural_rigidity", "mass_per_length"):
            given = getattr(self, name).shape
            if given != cells:
                raise ValueError(f"model: {name} has shape {given}, expected {cells}")
        if self.operators.n_dofs != 4 * self.n_elements:
            raise ValueError(
                f"model: {self.operators.n_dofs} dofs, expected {4 * self.n_elements} "
                f"for {self.n_elements} elements per lamina"
            )

    @property
    def n_elements(self) -> int:
        """Number of elements per lamina."""
        return self.x.size - 1

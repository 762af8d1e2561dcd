"""Points in place of beams: masses, each on a spring and a damper to the base.

    m u'' + c (u' - q') + k (u - q) = contact,   c = 2 D √(k m)

A point is a part of two nodes, the base and the mass. Both are held against turning, so that the
interpolant between them is one for pictures alone.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from delam_fem.case.definition import Case
from delam_fem.model.beams.network import completed, gap_at_rest, with_masses
from delam_fem.model.layout import (
    BASE,
    FIXED,
    Layout,
    Part,
    Probe,
    Structure,
    Support,
    gap_matrix,
    neighbours,
    probe_rows,
)
from delam_fem.model.operators import BaseCoupling, Operators


def assemble(case: Case) -> Structure:
    """Return the operators and the layout of a case of points."""
    n, L = len(case.lamina), case.length
    m = np.array([own.mass for own in case.lamina], dtype=np.float64)
    k = np.array([own.stiffness for own in case.lamina], dtype=np.float64)
    c = np.array([case.rayleigh(i)[1] for i in range(n)]) * k
    parts = tuple(
        Part(
            own.name,
            np.array([0.0, L]),
            np.array([[BASE, FIXED], [i, FIXED]]),
            np.array([k[i] * L**3 / 12.0]),  # a beam with both ends held against turning
            np.array([m[i] / L]),
        )
        for i, own in enumerate(case.lamina)
    )
    layout = Layout(
        parts,
        neighbours(parts, 1),
        tuple(Probe("tip", i, 1) for i in range(n)),
        tuple(Support(i, 0) for i in range(n)),
    )
    operators = Operators(
        mass=sp.diags(m, format="csr"),
        damping=sp.diags(c, format="csr"),
        stiffness=sp.diags(k, format="csr"),
        lumped_mass=m,
        base=BaseCoupling(np.zeros(n), -c, -k, corner=(0.0, float(c.sum()), float(k.sum()))),
        gap_matrix=gap_matrix(layout.parts, layout.interfaces, n),
        gap0=gap_at_rest(case, layout),
        probes=probe_rows(layout, n),
    )
    return completed(with_masses(Structure(operators, layout), case), case)
